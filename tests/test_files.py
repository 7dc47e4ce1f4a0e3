"""Files are replaced whole or not at all, and hashes name what a result was made from."""

import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from schuler import files
from schuler.exceptions import ConfigError, FileFormatError, InputError, OverwriteError
from schuler.files import new_folder, outputs, read_toml, replacing, sha256, write_text

posix = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no permission bits or umask")


@pytest.fixture(params=[0o022, 0o077, 0o002, 0o000], ids=lambda m: f"umask {m:03o}")
def umask(request):
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_the_file_appears_when_the_block_ends(tmp_path):
    target = tmp_path / "result.csv"
    with replacing(target) as temporary:
        assert temporary.stat().st_dev == target.parent.stat().st_dev  # so that the rename is atomic
        assert temporary.suffix == ".csv"  # libraries that choose a format by the suffix still do
        assert temporary != target
        temporary.write_text("t,x\n")
        assert not target.exists()
    assert target.read_text() == "t,x\n"
    assert names(tmp_path) == ["result.csv"]


def test_until_then_the_old_file_stays(tmp_path):
    target = tmp_path / "result.csv"
    target.write_text("old")
    with replacing(target) as temporary:
        temporary.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"


@pytest.mark.parametrize("error", [RuntimeError("disk on fire"), KeyboardInterrupt(), SystemExit(3)])
@pytest.mark.parametrize("existed", [True, False])
def test_an_error_inside_leaves_the_old_file_and_nothing_else(tmp_path, error, existed):
    target = tmp_path / "result.csv"
    if existed:
        target.write_text("old")

    def write_half():
        with replacing(target) as temporary:
            temporary.write_text("half of the n")
            raise error

    with pytest.raises(type(error)):
        write_half()
    assert names(tmp_path) == (["result.csv"] if existed else [])
    if existed:
        assert target.read_text() == "old"


def test_a_target_that_cannot_be_replaced_leaves_no_temporary(tmp_path):
    target = tmp_path / "taken"
    target.mkdir()
    with pytest.raises(OSError, match="taken"), replacing(target) as temporary:
        temporary.write_text("x")
    assert names(tmp_path) == ["taken"]


def test_a_temporary_removed_inside_the_block_is_an_error_and_no_file(tmp_path):
    target = tmp_path / "result.csv"
    with pytest.raises(FileNotFoundError), replacing(target) as temporary:
        temporary.unlink()
    assert names(tmp_path) == []


def test_missing_folders_are_made(tmp_path):
    target = tmp_path / "a" / "b" / "result.txt"
    assert write_text(target, "x") == target
    assert target.read_text() == "x"
    assert names(target.parent) == ["result.txt"]


def test_nested_and_parallel_writes_do_not_meet(tmp_path):
    target = tmp_path / "result.txt"
    with replacing(target) as first, replacing(target) as second:
        assert first != second
        first.write_text("first")
        second.write_text("second")
    assert target.read_text() == "first"  # the outer block ends last
    assert names(tmp_path) == ["result.txt"]


@posix
def test_permissions_are_those_of_an_ordinary_new_file(tmp_path, umask):
    """mkstemp makes files for the owner's eyes only; a result is made as ``open`` would make it."""
    target = write_text(tmp_path / "result.txt", "x")
    assert stat.S_IMODE(target.stat().st_mode) == 0o666 & ~umask
    plain = tmp_path / "plain.txt"
    with plain.open("w"):
        pass
    assert stat.S_IMODE(target.stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)
    current = os.umask(umask)
    assert current == umask  # asking for the mask did not change it


@posix
def test_while_it_is_written_the_file_is_private(tmp_path, umask):
    with replacing(tmp_path / "result.txt") as temporary:
        assert stat.S_IMODE(temporary.stat().st_mode) == 0o600 & ~umask


def test_text_is_utf8_and_paths_may_be_text(tmp_path):
    path = write_text(str(tmp_path / "notes.txt"), "0.125 °/√h, µg")
    assert isinstance(path, Path)
    assert path.read_bytes().decode("utf-8") == "0.125 °/√h, µg"


@pytest.mark.parametrize(
    ("content", "digest"),
    [
        # FIPS 180-2, appendix B, and the empty message
        (b"", "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"),
        (b"abc", "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"),
        (
            b"abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq",
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1",
        ),
        (b"a" * 1_000_000, "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0"),
    ],
    ids=["empty", "abc", "two blocks", "a million a"],
)
def test_sha256_of_known_messages(tmp_path, content, digest):
    path = tmp_path / "message"
    path.write_bytes(content)
    assert sha256(path) == digest
    assert sha256(str(path)) == digest


def test_sha256_of_more_than_one_read(tmp_path):
    """Three megabytes are read in pieces; a change of the last byte changes the hash."""
    path, block = tmp_path / "log.bin", bytes(range(256)) * 4096
    path.write_bytes(block * 3)
    before = sha256(path)
    path.write_bytes(block * 3 + b"\x00")
    assert sha256(path) != before
    path.write_bytes(block * 3)
    assert sha256(path) == before


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no such scenario file"),
        (b"a = [1,", "not a TOML file"),
        (b"a = '\xff'", "not a TOML file"),
        (b"a = " + b"9" * 5000, "not a TOML file"),
        (b"a = 0x" + b"f" * 5000, "an integer has more than 64 bits"),
        (b"a = [1, { b = [9223372036854775808] }]", "an integer has more than 64 bits"),
        (b"a = " + b"[" * 100_000, "nested too deeply"),
        (b"[" + b".".join([b"a"] * 5000) + b"]", "nested too deeply"),
        (b"a" + b".a" * 60 + b" = 1", "nested too deeply"),
    ],
)
def test_toml_errors_name_the_file_and_are_of_both_kinds(tmp_path, content, message):
    path = tmp_path / "a.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=message) as caught:
        read_toml(path, missing="no such scenario file")
    assert str(caught.value).startswith(f"{path}: ")
    assert isinstance(caught.value, FileFormatError)


def test_toml_has_the_integers_and_the_depth_of_its_standard(tmp_path):
    (tmp_path / "a.toml").write_bytes(
        b"\xef\xbb\xbfa = [-9223372036854775808, 9223372036854775807]\nb" + b".b" * 40 + b" = 1"
    )
    assert read_toml(tmp_path / "a.toml")["a"] == [-(2**63), 2**63 - 1]


def test_toml_of_a_folder_is_refused_in_words(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read: "):
        read_toml(tmp_path)


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "log.txt"
    path.write_text("raw")
    return path


def write_set(folder: Path, text: str = "x") -> None:
    write_text(folder / "a.csv", text)
    write_text(folder / "figures" / "b.svg", text)


def test_toml_that_never_ends_is_refused():
    with pytest.raises(ConfigError, match=r"not a TOML file: longer than 1e\+07 characters"):
        read_toml("/dev/zero")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes here")
def test_a_pipe_that_nobody_writes_to_is_refused_and_those_of_a_shell_are_read_twice(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ConfigError, match="pipe: expected a file, it is a named pipe and may wait for ever"):
        read_toml(tmp_path / "pipe")
    script = "import sys; from schuler.files import read_toml; print([read_toml(sys.argv[1]) for _ in '12'])"
    for path, command in (("/dev/stdin", 'echo "x = 3" | "$@" /dev/stdin'), ("/dev/fd", '"$@" <(echo "x = 3")')):
        done = subprocess.run(
            ["bash", "-c", command, "bash", sys.executable, "-c", script], capture_output=True, text=True, timeout=60
        )
        assert done.stdout == "[{'x': 3}, {'x': 3}]\n", (path, done.stderr)


def write_files(place):
    with outputs():
        write_text(place / "a.txt", "a")


def write_folder(place):
    with new_folder(place) as folder:
        (folder / "a.txt").touch()


@pytest.mark.parametrize("make", [write_files, write_folder])
def test_a_folder_that_another_run_makes_meanwhile_is_called_as_the_user_did(tmp_path, monkeypatch, make):
    place, rename = tmp_path / "out", os.rename

    def late(old, new):
        (place / "other").mkdir(parents=True)  # between the look and the name
        rename(old, new)

    monkeypatch.setattr(os, "rename", late)
    with pytest.raises(InputError, match=r"^\S*/out was made by another run meanwhile; nothing was written"):
        make(place)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert [path.name for path in place.iterdir()] == ["other"]


def test_a_set_of_files_appears_at_once(tmp_path):
    with outputs():
        write_set(tmp_path / "run" / "deep")
        assert [p for p in tmp_path.rglob("*") if p.name in ("run", "deep")] == []
    assert sorted(p.name for p in (tmp_path / "run" / "deep").rglob("*")) == ["a.csv", "b.svg", "figures"]
    assert names(tmp_path) == ["run"]
    assert stat.S_IMODE((tmp_path / "run").stat().st_mode) == 0o777 & ~files._umask()


@pytest.mark.parametrize("error", [RuntimeError("no"), KeyboardInterrupt(), OSError(28, "No space left on device")])
@pytest.mark.parametrize("existed", [True, False])
def test_a_set_of_files_that_is_not_complete_leaves_nothing(tmp_path, error, existed):
    if existed:
        write_text(tmp_path / "run" / "notes.txt", "mine")

    def fail_late():
        with outputs():
            write_set(tmp_path / "run")
            raise error

    with pytest.raises(type(error)):
        fail_late()
    assert [p.name for p in tmp_path.rglob("*") if p.is_file()] == (["notes.txt"] if existed else [])
    assert names(tmp_path) == (["run"] if existed else [])


def test_files_that_exist_are_kept_unless_forced(tmp_path):
    target = write_text(tmp_path / "mine" / "a.csv", "mine")
    with pytest.raises(OverwriteError, match=r"a\.csv exists and is kept: give another name, or --force"), outputs():
        write_set(target.parent)
    assert target.read_text() == "mine"
    assert names(target.parent) == ["a.csv"]
    with outputs(force=True):
        write_set(target.parent)
    assert target.read_text() == "x"


@pytest.mark.parametrize("existed", [True, False], ids=["into an empty folder", "into a new folder"])
def test_the_same_run_may_write_its_folder_again_until_somebody_changes_it(tmp_path, existed):
    folder = tmp_path / "run"
    if existed:
        folder.mkdir()
    for text in ("first", "second", "third"):
        with outputs():
            write_set(folder, text)
        assert (folder / "figures" / "b.svg").read_text() == text
    (folder / "a.csv").write_text("edited by hand")
    with pytest.raises(OverwriteError), outputs():
        write_set(folder, "fourth")
    assert (folder / "a.csv").read_text() == "edited by hand"
    assert (folder / "figures" / "b.svg").read_text() == "third"


@pytest.mark.parametrize("damage", ["", "{", "[]", '{"files": 3}', '{"files": {"a.csv": 3}}', "[" * 100_000])
def test_a_damaged_list_lets_nothing_be_replaced(tmp_path, damage):
    with outputs():
        write_set(tmp_path / "run")
    (tmp_path / "run" / files.LISTED).write_text(damage)
    with pytest.raises(OverwriteError), outputs():
        write_set(tmp_path / "run", "second")
    assert (tmp_path / "run" / "a.csv").read_text() == "x"


@pytest.mark.parametrize("how", ["name", "link", "symbolic link"])
def test_what_was_read_is_never_replaced(tmp_path, log, how):
    target = log if how == "name" else tmp_path / "other.txt"
    if how == "link":
        os.link(log, target)
    elif how == "symbolic link":
        target.symlink_to(log)

    def read_and_write():
        with outputs(force=True):
            sha256(log)
            write_text(target, "new")

    with pytest.raises(OverwriteError, match="was read by this command"):
        read_and_write()
    assert log.read_text() == "raw"


def test_a_file_may_be_written_twice_by_one_command(tmp_path):
    with outputs():
        write_text(tmp_path / "run" / "a.csv", "first")
        write_text(tmp_path / "run" / "a.csv", "second")
    assert (tmp_path / "run" / "a.csv").read_text() == "second"
    assert names(tmp_path) == ["run"]


def test_devices_are_not_replaced():
    with pytest.raises(InputError, match="it is a device"), replacing("/dev/full"):
        pass


KILLED = """
import os, sys
from schuler.files import outputs, write_text
from pathlib import Path
with outputs(force=True):
    for k in range(20):
        write_text(Path(sys.argv[1]) / f"{k}.txt", "new")
    print("written", flush=True)
    sys.stdin.read()
"""


@posix
@pytest.mark.parametrize("existed", [True, False])
def test_a_killed_run_changes_nothing_and_the_next_removes_what_it_left(tmp_path, existed):
    folder = tmp_path / "run"
    if existed:
        write_text(folder / "3.txt", "old")
    run = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with run:
        assert run.stdout.readline() == "written\n"
        place = folder if existed else tmp_path
        hidden = {p.name for p in place.iterdir() if p.name.startswith(".schuler-")}
        assert hidden
        files._tidied.clear()
        write_text(place / "meanwhile.txt", "x")
        assert {p.name for p in place.iterdir() if p.name.startswith(".schuler-")} == hidden  # it still runs
        run.kill()
    assert [p.read_text() for p in folder.glob("*.txt") if p.name != "meanwhile.txt"] == (["old"] if existed else [])
    files._tidied.clear()
    write_text(place / "next.txt", "x")
    assert [p for p in place.iterdir() if p.name.startswith(".")] == []


@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_that_is_ended_between_two_files_puts_all_in_place_first(tmp_path, number, monkeypatch):
    for name in "abc":
        write_text(tmp_path / name, "old")
    replace, ended = os.replace, []
    earlier = signal.signal(number, lambda *_: ended.append({p.read_text() for p in tmp_path.iterdir() if p.is_file()}))

    def ended_after(*names):
        replace(*names)
        signal.raise_signal(number)

    try:
        with outputs(force=True):
            for name in "abc":
                write_text(tmp_path / name, "new")
            monkeypatch.setattr(os, "replace", ended_after)
    finally:
        signal.signal(number, earlier)
    assert ended == [{"new"}]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of file size")
def test_a_full_disk_is_named_with_the_file_and_leaves_the_old_one(tmp_path):
    import resource

    target = write_text(tmp_path / "a.csv", "old")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5_000, before[1]))
    try:
        with pytest.raises(OSError, match=r"a\.csv") as caught:
            write_text(target, "x" * 100_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert caught.value.filename == str(target)
    assert target.read_text() == "old"
    assert names(tmp_path) == ["a.csv"]
