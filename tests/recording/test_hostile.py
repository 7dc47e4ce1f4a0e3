"""Files made to exhaust, to loop, to reach for other files, or to speak to the terminal or a spreadsheet."""

import struct
import time
import tracemalloc
import zlib

import numpy as np
import pytest

from schuler.cli import main
from schuler.exceptions import FileFormatError, printable
from schuler.plotting.table import ResultTable
from schuler.recording import Metadata
from schuler.recording.formats import mcap, rosbag, text
from schuler.recording.io import checks, dispatch, read, write


def text_of(value):
    return struct.pack("<I", len(value)) + value


def record(operation, content):
    return struct.pack("<BQ", operation, len(content)) + content


@pytest.mark.parametrize("suffix", [".mcap", ".bag"])
def test_parts_that_unpack_to_far_more_than_the_file_are_refused_by_their_sum(tmp_path, suffix):
    """Each of them is within the limit of one; nothing is unpacked for it but what the budget allows."""
    pytest.importorskip("lz4")
    path = tmp_path / f"bomb{suffix}"
    each = 60_000_000
    if suffix == ".mcap":
        from lz4.frame import compress

        inner = record(0x0F, bytes(each - 9))  # an unknown record
        packed = compress(inner)
        head = struct.pack("<QQQI", 0, 0, each, zlib.crc32(inner)) + text_of(b"lz4") + struct.pack("<Q", len(packed))
        chunks = 10 * record(mcap._CHUNK, head + packed)
        path.write_bytes(mcap.MAGIC + chunks + record(mcap._DATA_END, bytes(4)) + mcap.MAGIC)
    else:

        def field(name, value):
            return struct.pack("<I", len(name) + 1 + len(value)) + name + b"=" + value

        header = field(b"op", b"\x05") + field(b"compression", b"lz4") + field(b"size", struct.pack("<I", each))
        chunk = struct.pack("<I", len(header)) + header + struct.pack("<I", 4) + b"\x04\x22\x4d\x18"
        path.write_bytes(rosbag.MAGIC + 10 * chunk)
    with pytest.raises(FileFormatError, match=r"its parts unpack to \d+ bytes and more, in a file of"):
        read(path)


def test_arrays_that_unpack_to_far_more_than_the_file_are_refused_by_their_sum(tmp_path):
    path = tmp_path / "bomb.npz"
    zeros = np.zeros(6_000_000)
    np.savez_compressed(path, **{f"a{k}": zeros for k in range(3)})
    assert path.stat().st_size < 200_000
    with pytest.raises(FileFormatError, match=r"its arrays claim 144000\d+ bytes in a file of"):
        read(path)


def test_the_budget_of_a_packed_file():
    checks.check_unpacked(1 << 28, 10)
    checks.check_unpacked(10**10, 10**8)
    with pytest.raises(ValueError, match="unpack to"):
        checks.check_unpacked((1 << 28) + 1, 10)


@pytest.mark.skipif(not hasattr(__import__("signal"), "SIGVTALRM"), reason="systems with a clock of processor time")
def test_a_reader_that_comes_to_no_end_is_stopped(tmp_path, monkeypatch):
    path = tmp_path / "log.txt"
    path.write_text("1 2 3\n")

    def circle(*_):
        while True:
            pass

    monkeypatch.setattr(text, "read_text", circle)
    monkeypatch.setattr(dispatch, "LONGEST_S", 0.3)
    began = time.monotonic()
    with pytest.raises(FileFormatError, match=r"log\.txt: reading it came to no end"):
        read(path)
    assert time.monotonic() - began < 30.0
    import signal

    assert signal.getitimer(signal.ITIMER_VIRTUAL) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGVTALRM) == signal.SIG_DFL


@pytest.mark.parametrize("kind", ["external link", "soft link", "external storage", "group"])
def test_links_out_of_an_hdf5_file_are_not_followed(run, tmp_path, kind):
    h5py = pytest.importorskip("h5py")
    pytest.importorskip("h5netcdf")
    path = write(run, tmp_path / "run.nc")[0]
    other = tmp_path / "secret.h5"
    with h5py.File(path, "a") as file, h5py.File(other, "w") as secret:
        values = file["imu/ax"][()]
        secret["x"] = values
        if kind == "group":
            file.copy("imu", secret, "imu")
            del file["imu"]
            file["imu"] = h5py.ExternalLink(str(other), "/imu")
        else:
            del file["imu/ax"]
        if kind == "external link":
            file["imu/ax"] = h5py.ExternalLink(str(other), "/x")
        elif kind == "soft link":
            file["imu/ax"] = h5py.SoftLink("/imu/ay")
        elif kind == "external storage":
            (tmp_path / "raw").write_bytes(values.tobytes())
            external = [(str(tmp_path / "raw"), 0, values.nbytes)]
            file["imu"].create_dataset("ax", values.shape, values.dtype, external=external)
    with pytest.raises(FileFormatError, match=r"not followed|not opened|is missing"):
        read(path)


def test_names_from_files_do_not_speak_to_the_terminal(tmp_path, capsys):
    hostile = "a\x1b]0;owned\x07\x1b[31mb\rc\x9b2J"
    assert printable(hostile) == "a\ufffd]0;owned\ufffd\ufffd[31mb\ufffdc\ufffd2J"
    assert printable("0.125 °/√h, µg\nnext") == "0.125 °/√h, µg\nnext"
    meta = Metadata(name=hostile, notes=(hostile,))
    assert "\x1b" not in meta.name + "".join(meta.notes)
    path = tmp_path / "log.csv"
    path.write_text("t,\x1b]0;owned\x07,q\n1,2,3\n2,3,4\n")
    assert main(["info", str(path)]) == 2
    assert "\x1b" not in capsys.readouterr().err


@pytest.mark.parametrize("name", ["=cmd|' /C calc'!A0", "+1+1", "-2+3", "@SUM(A1)", "\t=1"])
def test_names_are_no_formulas_of_a_spreadsheet(tmp_path, name):
    table = ResultTable("t", ("name", "value", "empty"), ((name, -1.5, None), ("ax", 2.0, None)))
    written = table.to_csv(tmp_path / "t.csv").read_text()
    assert f"'{name}" in written
    assert ",-1.5," in written  # a number stays one
    assert "\nax,2.0,\n" in written


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("log.csv", b"t,ax,ay,az,gx,gy,gz\n" + b"1," * 500_000 + b"\n", "a line has 1000001 characters"),
        ("log.txt", b"1 " * 500_000, "a line has 1000000 characters"),
        ("log.kml", b'<?xml version="1.0"?><kml>' + b"<Folder>" * 200_000, "more than 100 deep in each other"),
    ],
)
def test_lines_and_elements_without_an_end_are_refused_at_once(tmp_path, name, data, words):
    """A line of 10 MB took 25 s and more, elements in each other 230 bytes of memory for each of the file."""
    path = tmp_path / name
    path.write_bytes(data)
    began = time.process_time()
    with pytest.raises(FileFormatError, match=words):
        read(path)
    assert time.process_time() - began < 5.0


def test_groups_inside_one_another_without_an_end_are_refused_at_once(tmp_path):
    """Each is looked for from the root on: 3000 took more than a minute."""
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "deep.h5"
    with h5py.File(path, "w") as file:
        group = file
        for _ in range(200):
            group = group.create_group("g")
        group["t"] = np.arange(10.0)
    with pytest.raises(FileFormatError, match="more than 50 deep in each other"):
        read(path)


@pytest.mark.parametrize("claimed", [1 << 29, 400])
def test_a_variable_of_matlab_is_unpacked_no_further_than_it_claims(tmp_path, claimed):
    """What it claims is read before anything is unpacked for it; zeros beyond are left packed."""
    packer = zlib.compressobj(1)
    packed = packer.compress(struct.pack("<II", 14, claimed)) + packer.compress(bytes(1 << 26)) + packer.flush()
    path = tmp_path / "log.mat"
    header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    path.write_bytes(header + struct.pack("<II", 15, len(packed)) + packed)
    tracemalloc.start()
    with pytest.raises(
        FileFormatError, match="claim 536870912, more than" if claimed > 400 else "cannot be read as|there"
    ):
        read(path)
    assert tracemalloc.get_traced_memory()[1] < 10 << 20
    tracemalloc.stop()
