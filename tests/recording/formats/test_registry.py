"""What every format of the registry keeps to, and how files reach it."""

import ast
import inspect
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from places import ROOT, TESTS

from schuler.exceptions import FileFormatError, InputError, MissingExtraError
from schuler.recording import ImuSeries, Recording
from schuler.recording.formats import registry
from schuler.recording.io import parts, read, write
from schuler.recording.io.dispatch import WRITERS as OWN_WRITERS
from schuler.recording.io.dispatch import left_out
from schuler.recording.io.hint_texts import SATELLITES, SERIES, parse_origin, parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.streams import Stream, choose, table
from schuler.timebase import TimeBase

NAMES = [name for name, _ in registry.FORMATS]


@pytest.mark.parametrize("name", NAMES)
def test_a_format_has_what_the_registry_asks_of_it(name):
    module = registry.module(name)
    assert list(inspect.signature(module.sniff).parameters) == ["head", "path"]
    assert list(inspect.signature(module.read).parameters) == ["path", "hints"]
    for optional in ("sniff_folder", "contents", "holds"):
        if hasattr(module, optional):
            assert len(inspect.signature(getattr(module, optional)).parameters) == 1
    assert len(module.__doc__.splitlines()[0]) <= 120


@pytest.mark.parametrize(
    "head", [b"\x00", b"\xff" * 300, b"\n", b"a,b\n1,2\n", b"t,ax,ay,az,gx,gy,gz\n0,0,0,9.8,0,0,0\n"]
)
def test_a_format_claims_nothing_by_accident(head, tmp_path):
    path = tmp_path / "x.dat"
    path.write_bytes(head)
    modules = {name: registry.module(name) for name in NAMES}
    assert [name for name, module in modules.items() if module.sniff(head, path) is not False] == []
    of_folders = {name: module.sniff_folder for name, module in modules.items() if hasattr(module, "sniff_folder")}
    for folder in (tmp_path, tmp_path / "nothing"):
        assert [name for name, sniff_folder in of_folders.items() if sniff_folder(folder) is not False] == []


def test_names_and_suffixes_are_used_once():
    suffixes = [*OWN_WRITERS, *registry.suffixes()]
    assert len(suffixes) == len(set(suffixes))
    assert len(NAMES) == len(set(NAMES))
    assert {part for _, _, parts in registry.WRITERS for part in parts} <= {*SERIES, *SATELLITES}
    for name, _, _ in registry.WRITERS:
        module, _ = registry.find_writer(Path("x"), name)
        assert list(inspect.signature(module.write).parameters)[:2] == ["recording", "path"]


def test_the_extras_exist():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    for _, extra in registry.FORMATS:
        if extra is not None:
            assert extra in extras
            assert extra in " ".join(extras["all"])


def test_formats_import_no_foreign_library_at_their_top():
    """Their modules are imported whenever any file is read."""
    own = {"schuler", "numpy", *sys.stdlib_module_names}
    for path in (Path(registry.__file__).parent).glob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            names = (
                [alias.name for alias in node.names]
                if isinstance(node, ast.Import)
                else [node.module or ""]
                if isinstance(node, ast.ImportFrom)
                else []
            )
            assert {name.partition(".")[0] for name in names} <= own, path


@pytest.mark.parametrize(
    ("library", "name", "extra"),
    [("rosbags", "x.bag", "ros"), ("pyulog", "x.ulg", "px4"), ("rosbags", "x.mcap", "ros")],
)
def test_a_missing_library_is_named_with_its_extra(library, name, extra, tmp_path, monkeypatch):
    heads = {"x.bag": b"#ROSBAG V2.0\n", "x.ulg": b"ULog\x01\x12\x35\x01"}
    for module in [m for m in sys.modules if m.partition(".")[0] == library]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setattr(sys, "meta_path", [Blocked(library), *sys.meta_path])
    path = tmp_path / name
    recording = Recording(imu=ImuSeries([1.0, 2.0], np.zeros((2, 3)), np.ones((2, 3))))
    if name in heads:
        path.write_bytes(heads[name])
    with pytest.raises(MissingExtraError, match=rf"pip install 'schuler\[{extra}\]'"):
        _ = read(path) if name in heads else write(recording, path)
    assert [p for p in tmp_path.iterdir() if p != path] == []


class Blocked:
    """Finder that has a library not installed."""

    def __init__(self, library: str) -> None:
        self.library = library

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == self.library:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def test_reading_text_loads_no_foreign_library(tmp_path):
    path = tmp_path / "x.csv"
    rows = [f"{k / 100},0.1,-0.2,-9.79,0.001,{0.001 * (k % 2)},0" for k in range(200)]
    path.write_text("\n".join(["t [s],ax [m/s^2],ay [m/s^2],az [m/s^2],gx [rad/s],gy [rad/s],gz [rad/s]", *rows]))
    loaded = "print(*sorted({m.partition('.')[0] for m in sys.modules}))"
    script = f"import sys, schuler; schuler.read({str(path)!r}); {loaded}"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=120)
    assert not set(run.stdout.split()) & {"rosbags", "pyulog", "mcap", "lz4", "apsw", "h5py", "novatel_edie", "pandas"}


def test_a_format_can_be_named_and_a_wrong_name_is_not_taken(tmp_path):
    path = tmp_path / "x.bin"
    path.write_bytes(b"\xa3\x95nothing at all" * 20)
    with pytest.raises(InputError, match="belong to no message"):
        read(path, format="ardupilot")
    with pytest.raises(InputError, match="format: 'ardupilto' is not known; did you mean 'ardupilot'"):
        read(path, format="ardupilto")
    recording = Recording(imu=ImuSeries([1.0, 2.0], np.zeros((2, 3)), np.ones((2, 3))))
    with pytest.raises(InputError, match="format to write: 'px4' is not known"):
        write(recording, tmp_path / "y", format="px4")
    with pytest.raises(InputError, match=r"cannot tell the format from '\.xyz'; write to \.parquet.*\.mcap"):
        write(recording, tmp_path / "y.xyz")


def test_what_a_writer_leaves_out(run, tmp_path):
    # the fixture holds an IMU, GNSS, odometer and reference
    assert left_out(run, "x.mcap") == ""
    assert left_out(run, "x", "rosbag") == ""
    from schuler.recording.series import ScalarSeries

    alone = Recording(heading=ScalarSeries([1.0], [0.1], [0.1]))
    assert left_out(alone, "x.mcap") == "heading"
    with pytest.raises(InputError, match="this format holds imu, gnss, reference, odometer; the recording has none"):
        write(alone, tmp_path / "x.mcap")


def test_hints_of_streams_and_origin():
    assert parse_streams("imu=/a/b, gnss = none") == {"imu": "/a/b", "gnss": None}
    assert parse_streams({"imu": "x=y"}) == {"imu": "x=y"}
    assert parse_streams("imu=x=y") == {"imu": "x=y"}
    np.testing.assert_allclose(parse_origin("90,-180,10"), (np.pi / 2, -np.pi, 10.0))
    assert parse_origin([0, 0, 0]) == (0.0, 0.0, 0.0)
    for wrong in ("1,2", "a,b,c", "1,2,nan", 5):
        with pytest.raises(InputError):
            ReadHints(origin=wrong)
    for wrong in ("imu", "imu=", "=x", "velocty=/x", 5):
        with pytest.raises(InputError):
            ReadHints(streams=wrong)


def test_streams_are_listed_and_chosen():
    streams = [Stream("/a", "Imu", 11, 0.0, 1.0, "imu"), Stream("/b", "Imu", 0, part="imu"), Stream("/c", "Text", 1)]
    assert streams[0].rate_hz == pytest.approx(10.0)
    assert streams[2].rate_hz is None
    assert choose(streams, "imu", {}).name == "/a"  # an empty stream is no candidate
    assert choose(streams, "gnss", {}) is None
    assert choose(streams, "imu", {}, alone=False) is None
    lines = table(streams).splitlines()
    assert lines[1].split() == ["/a", "Imu", "11", "10", "Hz", "0.000", "s", "1.000", "s", "imu"]


def test_a_file_in_a_folder_is_read_by_its_entry(tmp_path):
    pytest.importorskip("rosbags")
    t = np.arange(300) / 100.0
    rng = np.random.default_rng(3)
    imu = ImuSeries(t, 1e-3 * rng.standard_normal((300, 3)), 1e-2 * rng.standard_normal((300, 3)) - (0, 0, 9.8))
    write(Recording(imu=imu), tmp_path / "x.mcap")
    recording = read(tmp_path, imu={"file": "x.mcap", "offset": 5.0})
    np.testing.assert_allclose(recording.imu.t, t + 5.0)


def test_the_encoders_of_these_tests_import_nothing_of_ours():
    encoders = [*(TESTS / "support").glob("*_encoder.py"), *(TESTS / "support").glob("encode_*.py")]
    assert len(encoders) >= 7
    for path in encoders:
        assert "schuler" not in path.read_text(encoding="utf-8")


def test_samples_out_of_order_are_left_out_while_they_are_few(tmp_path):
    t = np.arange(400.0)
    t[[50, 51, 200]] = (49.0, 30.0, np.nan)
    notes: list[str] = []
    keep = parts.later(t, "/imu", tmp_path, notes)
    assert list(np.flatnonzero(~keep)) == [50, 51, 200]
    assert notes == ["/imu: 3 samples not later than the one before were left out."]
    t[60:70] = 59.5
    with pytest.raises(FileFormatError, match=r"/imu: 12 of 400 stamps repeat or go back, the first at message 51"):
        parts.later(t, "/imu", tmp_path, notes)
    assert list(parts.later(np.array([1.0, 1.0]), "x", tmp_path, [])) == [True, False]


def test_tables_in_si_become_a_recording_with_all_the_checks(tmp_path):
    path = tmp_path / "x.dat"
    path.write_bytes(b"content")
    t = np.arange(300) / 100.0
    imu = {"t": t, **{f"g{a}": 0.0 * t for a in "xyz"}, "ax": 0.0 * t, "ay": 0.0 * t, "az": 0.0 * t + 9.8}
    base = TimeBase("gps", 604_800.0)
    made = parts.assemble(path, {"imu": parts.Table(imu, axes="FLU")}, ReadHints(name="run"), base, ["first"])
    assert made.metadata.time == base
    assert made.metadata.name == "run"
    assert made.metadata.axes == "FLU"
    assert made.metadata.notes[0] == "first"
    assert list(made.metadata.sources) == ["x.dat"]
    np.testing.assert_array_equal(made.imu.accel[0], (0.0, 0.0, -9.8))
    with pytest.raises(FileFormatError, match="look like g"):
        parts.assemble(path, {"imu": parts.Table(imu | {"az": imu["az"] / 9.8})}, ReadHints(), base)
    with pytest.raises(FileFormatError, match="row 8: gx is nan"):
        parts.assemble(path, {"imu": parts.Table(imu | {"gx": np.where(t == 0.07, np.nan, 0.0)})}, ReadHints(), base)
    with pytest.raises(FileFormatError, match="holds none of the series"):
        parts.assemble(path, {}, ReadHints(), base)
    place = {"lat": 0.1 + 0.0 * t, "lon": 0.2 + 0.0 * t, "h": 0.0 * t}
    both = parts.assemble(
        path,
        {"gnss": parts.Table({"t": t, **place}), "reference": parts.Table({"t": t, **place}, ellipsoidal=False)},
        ReadHints(sigma="1,1,2"),
        base,
    )
    assert len(both.gnss) == len(both.reference) == 300
    assert "Heights are taken as ellipsoidal (hint height says otherwise)." in both.metadata.notes


@pytest.mark.realdata
def test_recordings_of_other_kinds_are_claimed_by_nobody(shared_data):
    """Tables that look like something else at first sight are left to the readers of tables."""
    others = ("snu_staticposes/*", "rtkexp_*/*", "imu_thermal/*", "imu_tk_xsens/*", "adis16405_static/*", "*/README*")
    files = [p for pattern in others for p in shared_data.glob(pattern) if p.is_file()]
    assert len(files) > 30
    claimed = {}
    for path in files:
        with path.open("rb") as stream:
            reader = registry.find(stream.read(1 << 16), path)
        if reader is not None:
            claimed[str(path.relative_to(shared_data))] = reader.__name__
    assert claimed == {}
