"""Every command that writes, on a disk of 5 MB that fills at any moment of it, and on one that cannot be written.

The disk is a tmpfs where this process may mount one (as root, so in CI); a limit on the size of files stands for it
elsewhere.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import os
import re
import resource
import shutil
import subprocess
import sys

import pytest
from writing_commands import COMMANDS, check_complete, content, forked, hidden, visible, write_inputs

pytestmark = [
    pytest.mark.campaign,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="forks, mounts and limits of file size"),
]
SIZE = 5_000_000
CLONE_NEWNS = 0x00020000  # <linux/sched.h>: mounts of a thread's own


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    return write_inputs(tmp_path_factory.mktemp("inputs"))


@pytest.fixture(scope="module")
def own_mounts():
    """Mounts that end with this process: one left by a killed run made every later run of pytest end in an error."""
    if ctypes.CDLL(None, use_errno=True).unshare(CLONE_NEWNS):
        pytest.skip(f"no file system can be mounted here: {os.strerror(ctypes.get_errno())}")
    subprocess.run(["mount", "--make-rprivate", "/"], check=True)


@pytest.fixture
def disk(own_mounts, tmp_path):
    """A file system of 5 MB."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={SIZE}", "tmpfs", str(place)], capture_output=True, text=True, check=False
    )
    if mounted.returncode:
        pytest.skip(f"no file system can be mounted here: {mounted.stderr.strip()}")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def digests(folder):
    return {name: hashlib.sha256(data).hexdigest() for name, data in content(folder).items()}


def fill(disk, left):
    """Fill a disk but for so many bytes."""
    free = shutil.disk_usage(disk).free - left
    with (disk / "filler").open("wb") as file, contextlib.suppress(OSError):
        file.write(b"x" * free)


def used(folder):
    return sum(p.stat().st_size for p in folder.rglob("*") if p.is_file())


@pytest.mark.parametrize("name", COMMANDS)
def test_a_disk_that_fills_is_said_and_leaves_nothing_half(name, inputs, disk, tmp_path):
    """Room for nothing, a tenth, a half and nine tenths of what a command writes; with the room, the same run works."""
    command = COMMANDS[name]
    whole = tmp_path / "whole"
    shutil.copytree(inputs, whole / "in")
    before = {f"in/{n}" for n in content(inputs)}
    assert forked(whole, command).status == 0
    expected = visible(whole) - before
    needed = used(whole) - used(inputs)
    shutil.copytree(inputs, disk / "in")
    refused = 0
    for share in (0.0, 0.1, 0.5, 0.9):
        fill(disk, int(share * needed))
        status, _, words = forked(disk, command)
        assert digests(disk / "in").items() >= digests(inputs).items()
        made = visible(disk) - before - {"filler"}
        assert made <= expected
        for one in made:
            check_complete(disk / one)
        code = os.waitstatus_to_exitcode(status)
        assert code in (0, 2), words
        if code:
            refused += 1
            assert "No space left" in words, words
            assert "Traceback" not in words
        assert hidden(disk) == []
        (disk / "filler").unlink()
        for top in (disk / "out", *(disk / one for one in made)):
            shutil.rmtree(top) if top.is_dir() else top.unlink(missing_ok=True)
    assert refused >= 2
    assert forked(disk, command).status == 0
    assert visible(disk) - before == expected


@pytest.mark.parametrize("name", COMMANDS)
def test_a_disk_that_cannot_be_written_is_said(name, inputs, disk):
    shutil.copytree(inputs, disk / "in")
    subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
    status, _, words = forked(disk, COMMANDS[name])
    assert os.waitstatus_to_exitcode(status) == 2, words
    assert "Read-only file system" in words, words
    assert "Traceback" not in words
    assert visible(disk) == {f"in/{n}" for n in content(inputs)}


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "apply"])  # which has no default
def test_a_default_place_that_cannot_be_written_is_said_before_the_work(name, inputs, disk):
    shutil.copytree(inputs, disk / "in")
    subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
    command = re.sub(" --(out|report) out/[^ ]*", "", COMMANDS[name])
    status, _, words = forked(disk, command)
    if name in ("check", "reproduce"):  # they write nothing unless asked to
        assert os.waitstatus_to_exitcode(status) == 0, words
    else:
        assert os.waitstatus_to_exitcode(status) == 2, words
        assert "Expected a place to write to" in words, words


@pytest.mark.parametrize("name", COMMANDS)
def test_files_that_may_not_grow_are_said_and_leave_nothing_half(name, inputs, tmp_path, monkeypatch):
    """A limit of 300 bytes a file, as quotas and limits of services set it."""
    monkeypatch.setattr("sys.dont_write_bytecode", True)  # Python itself leaves cut bytecode of what it imports first
    folder = tmp_path / "run"
    shutil.copytree(inputs, folder / "in")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (300, limits[1]))
    try:
        status, _, words = forked(folder, COMMANDS[name])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert os.waitstatus_to_exitcode(status) == 2, words
    assert "File too large" in words, words
    assert visible(folder) == {f"in/{n}" for n in content(inputs)}
    assert hidden(folder) == []


@pytest.mark.parametrize("home", [None, "/nonexistent", "/proc"])
def test_without_a_home_commands_run(home, inputs, tmp_path):
    """As in containers and under service users; what is compiled is kept elsewhere or not at all."""
    environment = {k: v for k, v in os.environ.items() if k not in ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME")}
    if home is not None:
        environment["HOME"] = home
    command = ["navigate", str(inputs / "town.parquet"), "--config", str(inputs / "navigation.toml")]
    done = subprocess.run(
        [sys.executable, "-m", "schuler", *command, "--out", str(tmp_path / "run")],
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert (tmp_path / "run" / "solution.parquet").stat().st_size > 0
