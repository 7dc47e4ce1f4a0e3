"""Parsers of other libraries are stopped when a damaged file sends them round in circles, whatever they are doing."""

import os
import struct
import sys
import threading
import time
from itertools import pairwise

import foreign_parsers
import pytest
import ulog_encoder

from schuler.exceptions import FileFormatError, ReaderError
from schuler.recording.io import child, read

limits = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="systems with limits of time and memory")


@pytest.fixture
def path(tmp_path):
    made = tmp_path / "log.bin"
    made.write_bytes(b"12345678")
    return made


@pytest.fixture
def soon(monkeypatch):
    monkeypatch.setattr(child, "LONGEST_S", 0.2)
    monkeypatch.setattr(child, "_WAIT_S", 100.0)  # it is processor time that ends it


def test_one_process_serves_all_files_and_is_not_this_one(path):
    content, number = child.call(foreign_parsers.first_bytes, path, 3)
    assert content == b"123"
    assert number != os.getpid()
    assert child.call(foreign_parsers.first_bytes, path, 2) == (b"12", number)


def test_errors_come_as_they_were_raised(path):
    with pytest.raises(FileFormatError, match=r"log\.bin:7: it is no log of ours$") as caught:
        child.call(foreign_parsers.refuse, path)
    assert (caught.value.path, caught.value.line) == (path, 7)
    with pytest.raises(ReaderError, match=r"log\.bin: RuntimeError: a defect"):
        child.call(foreign_parsers.defect, path)


@limits
def test_circles_in_compiled_code_end_and_the_next_file_is_read(path, soon):
    began = time.monotonic()
    with pytest.raises(FileFormatError, match=r"log\.bin: reading it came to no end"):
        child.call(foreign_parsers.circles, path)
    assert time.monotonic() - began < 90.0  # two seconds of processor time, on any machine
    assert child.call(foreign_parsers.first_bytes, path, 1)[0] == b"1"


@limits
def test_a_file_that_wants_more_memory_than_its_size_explains_is_refused(path):
    with pytest.raises(MemoryError):
        child.call(foreign_parsers.hungry, path)


def test_a_crash_is_one_sentence(path):
    with pytest.raises(ReaderError, match=r"log\.bin: the library that reads it crashed"):
        child.call(foreign_parsers.crash, path)
    assert child.call(foreign_parsers.first_bytes, path, 1)[0] == b"1"


def test_time_on_the_wall_is_limited_too(path, soon, monkeypatch):
    """All that Windows has: there is no limit of processor time."""
    monkeypatch.setattr(child, "LONGEST_S", 1e4)
    monkeypatch.setattr(child, "_SLACK", 0.0)
    monkeypatch.setattr(child, "_WAIT_S", 0.2)
    with pytest.raises(FileFormatError, match="came to no end"):
        child.call(foreign_parsers.circles, path)


def test_threads_take_turns(path):
    answers = []
    each = [threading.Thread(target=lambda n=n: answers.append(child.call(foreign_parsers.first_bytes, path, n)[0]))
            for n in range(1, 7)]  # fmt: skip
    for thread in each:
        thread.start()
    for thread in each:
        thread.join()
    assert sorted(answers) == [b"12345678"[:n] for n in range(1, 7)]


def test_where_no_process_can_be_started_files_are_read_here(path, monkeypatch):
    monkeypatch.setattr(child, "_child", None)
    monkeypatch.setattr(sys, "executable", str(path.with_name("no python")))
    monkeypatch.setattr(child, "_usable", True)
    assert child.call(foreign_parsers.first_bytes, path, 1) == (b"1", os.getpid())


@pytest.mark.campaign
@limits
def test_a_damaged_heap_of_hdf5_that_sends_libhdf5_in_circles(tmp_path, soon):
    """A free block of the heap of names that is its own successor: libhdf5 2.0 comes to no end, nor does Ctrl-C."""
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file.create_group("imu")["ax"] = [1.0, 2.0]
    content = bytearray(path.read_bytes())
    at = content.index(b"HEAP")
    size, free, address = struct.unpack_from("<QQQ", content, at + 8)
    assert free < size
    struct.pack_into("<Q", content, address + free, free)
    path.write_bytes(content)
    began = time.monotonic()
    with pytest.raises(FileFormatError, match=r"log\.h5: .*(came to no end|cannot be read as HDF5)"):
        read(path, columns="t=imu.ax", units="m/s^2,rad/s")
    assert time.monotonic() - began < 90.0


@pytest.mark.parametrize("levels", [13, 40], ids=["266 bytes", "791 bytes"])
def test_messages_without_fields_inside_one_another_end(tmp_path, levels):
    """Three of the next in each: 3^13 and 3^40 of nothing, of which a message may hold 65535."""
    pytest.importorskip("pyulog")
    names = [f"{chr(97 + k % 26)}{'' if k < 26 else k}" for k in range(levels + 1)]
    formats = [f"{a}:{b} x;{b} y;{b};" for a, b in pairwise(names)] + [f"{names[-1]}:"]
    parts = [ulog_encoder.header(), *(ulog_encoder.record("F", f.encode()) for f in formats)]
    path = tmp_path / "log.ulg"
    path.write_bytes(b"".join(parts) + ulog_encoder.record("A", b"\0\0\0a"))
    began = time.monotonic()
    with pytest.raises(FileFormatError):
        read(path)
    assert time.monotonic() - began < 30.0
