"""Every format that is read, damaged in a stated number of ways: errors of ours only, bounded memory, no half results.

What stands behind checksums is reached by ``test_format_receivers_fuzz.py`` (messages with right checksums and any
contents), text by ``test_malformed.py``. All of it is drawn from fixed seeds; a twentieth runs by default, everything
with ``-m fuzz``, about a minute on one core.
"""

import gzip
import io
import re
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import mutations
import numpy as np
import pytest
import samples
from places import ROOT

from schuler.cli import main
from schuler.exceptions import FileFormatError, SchulerError
from schuler.recording import Recording
from schuler.recording.formats import registry
from schuler.recording.io import lines, own, read

pytest.importorskip("rosbags")
pytest.importorskip("pyulog")
pytest.importorskip("h5netcdf")
pytest.importorskip("mcap")
pytest.importorskip("hatanaka")

pytestmark = pytest.mark.usefixtures("unguarded")

#: Number of damaged logs of each format and variant with ``-m fuzz``; also in docs/formats.md.
CASES = {
    "mcap": 400, "rosbag": 400, "px4": 300, "ardupilot": 400, "novatel": 150, "sbf": 150, "vectornav": 150,
    "xsens": 150, "sbg": 150, "euroc": 300, "kitti": 300, "kf_gins": 300, "sbet": 300, "netcdf": 200, "tum": 400,
    "solution": 200, "navego": 300, "psins": 300, "gnss_ins_sim": 200, "comma2k19": 200, "imr": 300, "waypoint": 400,
    "android": 200, "sensor_logger": 200, "phyphox": 200, "gpx": 200, "kml": 200,
    "oan": 200, "text": 400, "csv": 300, "parquet": 200, "matlab4": 400,
    "matlab5": 400, "npy": 400, "npz": 400, "pos": 400, "ubx": 400, "nmea": 200, "rinex_observations": 400,
    "rinex_navigation": 400,
    "rinex_gzip": 300, "hatanaka": 200, "psins_imu": 400, "psins_ranges": 300, "instinct_csv": 400, "folder": 200,
    "mcap_ros2": 100, "rosbag_lz4": 200, "rosbag_bz2": 200, "rosbag_ros2": 60, "vectornav_lines": 300,
    "netcdf_packed": 60, "hdf5": 150, "matlab73": 300, "parquet_foreign": 200, "vectornav_csv": 200, "xsens_text": 200,
}  # fmt: skip
MEMORY_MB = 200.0


def unzip(data: bytes) -> bytes:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return archive.read("imu.npy")


def rezip(data: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("imu.npy", data)
    return stream.getvalue()


DAMAGE: dict[str, Callable[[bytes, int], bytes]] = {
    "ubx": mutations.checked(mutations.ubx),
    "nmea": mutations.checked(mutations.nmea),
    "rinex_gzip": mutations.repacked(gzip.decompress, gzip.compress),
    "npz": mutations.repacked(unzip, rezip),
}


def address_space() -> float:
    """The most that this process ever asked for [MB]; 0 where the system does not tell."""
    try:
        return int(re.search(r"VmPeak:\s+(\d+) kB", Path("/proc/self/status").read_text())[1]) / 1024
    except OSError:
        return 0.0


def listed(data: bytes, path: Path) -> None:
    """What ``schuler info`` lists of it."""
    reader = registry.find(data[: 1 << 16], path)
    if hasattr(reader, "contents"):
        with suppress(SchulerError):
            reader.contents(path)


def test_the_page_states_the_cases():
    """docs/formats.md has a row for every sample with its number of cases."""
    page = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    stated = {name: int(number) for name, number in re.findall(r"`(\w+)` (\d+)(?=[ ,])", page.partition("\n## ")[0])}
    assert stated == CASES


def test_every_format_is_damaged():
    """The table holds every format of the registry and every older one, and as many variants."""
    assert set(samples.MAKERS) == {name for name, _ in registry.FORMATS} | set(samples.OLDER)
    assert set(CASES) == set(samples.ALL)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", samples.ALL)
def test_samples_are_good(name, tmp_path):
    """The undamaged log is read, and by its looks alone where no format is named."""
    sample = samples.make(name, tmp_path)
    recording = read(sample.path, **sample.hints)
    assert recording.metadata.sources


@pytest.mark.thinned(4)
@pytest.mark.parametrize("share", [0.05, pytest.param(1.0, marks=pytest.mark.fuzz)])
@pytest.mark.parametrize("name", CASES)
def test_damaged_logs_raise_only_errors_of_ours(name, share, tmp_path):
    """Whatever is damaged: an error of ours or a recording, no warning, no memory beyond what the log could need."""
    sample = samples.make(name, tmp_path)
    read(sample.path, **sample.hints)  # libraries are loaded, threads started
    good = [(path, path.read_bytes()) for path in sample.damaged]
    before, refused = address_space(), 0
    for seed in range(round(share * CASES[name])):
        path, content = good[seed % len(good)]
        data = DAMAGE.get(name, mutations.damaged)(content, seed)
        path.write_bytes(data)
        try:
            if data:
                registry.held_by(data[: 1 << 16], path)  # whose it is by its looks: raises nothing
                listed(data, path)
            assert isinstance(read(sample.path, **sample.hints), Recording)
        except SchulerError:
            refused += 1
        except BaseException as error:
            error.add_note(f"{name}, seed {seed}, {path.name}")
            raise
        finally:
            path.write_bytes(content)
    assert refused > 0 or share < 1.0
    assert address_space() - before < MEMORY_MB
    read(sample.path, **sample.hints)  # nothing was changed beside the log


def test_superscripts_are_no_digits(tmp_path):
    """Found by more seeds than run here: '²' is a digit to ``str.isdigit``, but no number to ``int``."""
    sample = samples.make("rinex_observations", tmp_path)
    sample.path.write_text(sample.path.read_text().replace("G    2 C1C", "G    ² C1C"), encoding="latin-1")
    with pytest.raises(FileFormatError, match="expected one list with a count"):
        read(sample.path)


TEXTS = (
    "text", "csv", "pos", "euroc", "tum", "kf_gins", "waypoint", "gnss_ins_sim", "sensor_logger", "xsens_text",
    "vectornav_csv", "oan",
)  # fmt: skip


@pytest.mark.thinned(3)
@pytest.mark.parametrize("cases", [6, pytest.param(120, marks=pytest.mark.fuzz)])
@pytest.mark.parametrize("name", TEXTS)
def test_compiled_reading_of_damaged_text_is_the_plain_reading(name, cases, tmp_path, monkeypatch):
    """Large tables are read by compiled code: of damaged ones it makes the same numbers, or the same error."""
    sample = samples.make(name, tmp_path)
    good = [(path, path.read_bytes()) for path in sample.damaged]
    for seed in range(cases):
        path, content = good[seed % len(good)]
        path.write_bytes(mutations.damaged(content, 10_000 + seed))
        problems = []
        for many in (1 << 60, 0):
            monkeypatch.setattr(lines, "MANY", many)
            try:
                problems.append(own.flatten(read(sample.path, **sample.hints)))
            except SchulerError as error:
                problems.append(str(error))
            except BaseException as error:
                error.add_note(f"{name}, seed {seed}, {path.name}, from {many} bytes on")
                raise
        path.write_bytes(content)
        plain, compiled = problems
        assert type(plain) is type(compiled), (seed, plain, compiled)
        if isinstance(plain, str):
            assert plain == compiled, seed
            continue
        assert plain.keys() == compiled.keys(), seed
        for part, table in plain.items():
            for column, values in table.items():
                np.testing.assert_array_equal(values, compiled[part][column], err_msg=f"{seed} {part}.{column}")


@pytest.mark.thinned(4)
@pytest.mark.parametrize("name", samples.ALL)
def test_a_refused_log_leaves_no_output(name, tmp_path, monkeypatch, capsys):
    """``schuler convert`` of a damaged log ends with code 2, a sentence, and no file or part of one."""
    sample = samples.make(name, tmp_path / "log")
    path, out = sample.damaged[0], tmp_path / "out"
    out.mkdir()
    monkeypatch.chdir(out)
    content = path.read_bytes()
    middle = content.find(b"\n", len(content) // 2) + 1
    words = content[:middle] + b"1 2 3 nonsense 5\n" + content[middle:]
    for data in (content[: len(content) // 3], content[:20] + bytes(400) + content[420:], words, b"\x00" * 50):
        path.write_bytes(data)
        try:
            read(sample.path, **sample.hints)
        except SchulerError:
            break
    else:
        pytest.fail("no damage was refused")
    given = {key: value for key, value in sample.hints.items() if key != "sigma_height"}
    hints = [word for key, value in given.items() for word in (f"--{key.replace('_', '-')}", str(value))]
    assert main(["convert", str(sample.path), "new.parquet", *hints]) == 2
    assert list(out.iterdir()) == []
    assert "log" in capsys.readouterr().err
