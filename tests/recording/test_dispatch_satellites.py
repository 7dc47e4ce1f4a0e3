"""Receivers' files among other logs: told apart by what is in them, read by one call, put together in folders."""

import bz2
import gzip
import zipfile

import numpy as np
import pytest

from schuler.exceptions import FileFormatError, InputError
from schuler.gnss.signals import satellite_name
from schuler.recording.io import ReadHints, read
from schuler.recording.io.dispatch import read_one
from schuler.recording.io.lines import check_file
from schuler.recording.io.satellite_files import kinds_of, rinex_kind

TOW, WEEK = 36_000.0, 2244


def head(*lines: str) -> str:
    return "".join(f"{content:<60}{label}\n" for content, label in (line.split("|") for line in lines))


def observations(start: int = 0, n: int = 4) -> str:
    """Epochs of two satellites, GPS and GLONASS without its channel, 2023-01-08 10:00 GPS time."""
    text = head(
        "     3.04           OBSERVATION DATA    M: MIXED|RINEX VERSION / TYPE",
        "G    2 C1C D1C|SYS / # / OBS TYPES",
        "R    2 C1C D1C|SYS / # / OBS TYPES",
        "  2023     1     8    10     0    0.0000000     GPS|TIME OF FIRST OBS",
        "|END OF HEADER",
    )
    for k in range(start, start + n):
        text += f"> 2023 01 08 10 00 {k:10.7f}  0  2\n"
        text += f"G05{21735785.983 + 100 * k:14.3f}  {-500.25:14.3f}\n"
        text += f"R05{19500000.125 - 300 * k:14.3f}  {1000.5:14.3f}\n"
    return text


GLONASS = head(
    "     3.04           N: GNSS NAV DATA    M: MIXED|RINEX VERSION / TYPE", "    18|LEAP SECONDS", "|END OF HEADER"
)  # fmt: skip
GPS = GLONASS.replace("M: MIXED", "G: GPS  ")


def number(value: float) -> str:
    return f"{value:19.12E}".replace("E", "D")


def glonass_message(slot: int, channel: int) -> str:
    rows = [
        [1e-5, 0.0, 0.0], [7e3, -1.0, 0.0, 0.0], [-1e4, 2.0, 0.0, float(channel)], [2e4, 1.5, 0.0, 0.0],
    ]  # fmt: skip
    text = f"R{slot:02d} 2023 01 08 09 45 00" + "".join(map(number, rows[0])) + "\n"
    return text + "".join("    " + "".join(map(number, row)) + "\n" for row in rows[1:])


def gps_message(prn: int) -> str:
    values = [1e-5, 1e-12, 0.0] + [0.0] * 3 + [1.0] + [0.0, 0.01, 0.0, 5153.6, TOW, 0.0, 0.5, 0.0, 0.96, 0.0, 0.3, 0.0]
    values += [0.0, 0.0, float(WEEK), 0.0, 2.0, 0.0, 0.0, 0.0, TOW - 3600.0, 4.0]
    text = f"G{prn:02d} 2023 01 08 10 00 00" + "".join(map(number, values[:3])) + "\n"
    for k in range(3, len(values), 4):
        text += "    " + "".join(map(number, values[k : k + 4])) + "\n"
    return text


@pytest.fixture
def folder(tmp_path, still):
    """An IMU log, observations, and broadcast messages of two systems in two files."""
    path = tmp_path / "run"
    path.mkdir()
    still[:, 0] += TOW
    np.savetxt(path / "imu.csv", still, delimiter=",", fmt="%.17g")
    (path / "rover.obs").write_text(observations())
    (path / "gps.nav").write_text(GPS + gps_message(5))
    (path / "glonass.nav").write_text(GLONASS + glonass_message(5, 1))
    (path / "README").write_text("A run.\n")
    return path


IMU = {"file": "imu.csv", "columns": "t,ax,ay,az,gx,gy,gz", "units": "m/s^2,rad/s", "time": f"gps-tow:{WEEK}"}
PACKERS = {
    "obs": lambda path, text: path.write_bytes(text),
    "23O": lambda path, text: path.write_bytes(text),
    "rnx": lambda path, text: path.write_bytes(b"\xef\xbb\xbf" + text),
    "txt": lambda path, text: path.write_bytes(text.replace(b"\n", b"\r\n")),
    "rnx.gz": lambda path, text: path.write_bytes(gzip.compress(text)),
    "rnx.bz2": lambda path, text: path.write_bytes(bz2.compress(text)),
    "zip": lambda path, text: zipfile.ZipFile(path, "w").writestr("rover.obs", text),
}


@pytest.mark.parametrize("suffix", list(PACKERS))
def test_rinex_is_known_by_its_first_line_however_packed(tmp_path, suffix):
    path = tmp_path / f"rover.{suffix}"
    PACKERS[suffix](path, observations().encode())
    assert rinex_kind(path, check_file(path)) == "observations"
    r = read(path)
    assert len(r.observations) == 8
    assert r.metadata.name == path.stem
    assert r.metadata.time.epoch_gps_s == WEEK * 604_800.0
    np.testing.assert_allclose(r.observations.epochs, TOW + np.arange(4), atol=1e-9)  # rounding
    assert set(r.metadata.sources) == {path.name}
    nav = tmp_path / f"broadcast.{suffix}"
    PACKERS[suffix](nav, (GPS + gps_message(5)).encode())
    broadcast = read(nav)
    assert broadcast.observations is None
    assert [satellite_name(s) for s in broadcast.ephemerides.kepler.sat] == ["G05"]
    assert kinds_of(nav, check_file(nav)) == ("ephemerides",)


def test_hatanaka_is_known_without_its_library(tmp_path):
    path = tmp_path / "rover.crx"
    path.write_text(head("3.0                 COMPACT RINEX FORMAT|CRINEX VERS   / TYPE") + observations())
    assert kinds_of(path, check_file(path)) == ("observations",)
    pytest.importorskip("hatanaka")
    packed = pytest.importorskip("hatanaka").rnx2crx(observations())
    path.write_text(packed)
    assert len(read(path).observations) == 8


def test_other_packed_files_are_not_taken_for_rinex(tmp_path):
    for name, data in {
        "a.npz": b"PK\x03\x04rest", "a.gz": gzip.compress(b"t,ax\n1,2\n"), "b.gz": b"\x1f\x8bdamaged",
        "a.bz2": b"BZhdamaged", "a.zip": b"PK\x03\x04damaged",
    }.items():  # fmt: skip
        (tmp_path / name).write_bytes(data)
        assert kinds_of(tmp_path / name, data) == ()


def test_hints_a_rinex_file_answers_itself_are_refused(folder):
    for hints in ({"time": "gps"}, {"axes": "FLU"}, {"offset": 1.0}, {"columns": "t,ax,ay,az"}):
        with pytest.raises(InputError, match="is a RINEX file and says this itself; leave out"):
            read(folder / "rover.obs", **hints)
    assert read(folder / "rover.obs", name="lap 3").metadata.name == "lap 3"
    with pytest.raises(InputError, match="series='imu' was asked for, the file holds observations"):
        read(folder / "rover.obs", series="imu")
    assert read(folder / "rover.obs", series="observations").observations is not None


def test_a_folder_with_entries(folder):
    r = read(
        folder, imu=IMU, observations={"file": "rover.obs"}, ephemerides={"file": ["gps.nav", "glonass.nav"]}
    )  # fmt: skip
    assert (len(r.ephemerides.kepler), len(r.ephemerides.glonass)) == (1, 1)
    assert r.imu.t[0] == r.observations.t[0] == TOW
    assert r.observations.epoch_gps_s == WEEK * 604_800.0
    assert set(r.metadata.sources) == {"imu.csv", "rover.obs", "gps.nav", "glonass.nav"}
    # the GLONASS channel comes from the navigation file: 1602 MHz + 0.5625 MHz
    glonass = r.observations.sat // 100 == 1
    np.testing.assert_allclose(r.observations.range_rate[glonass], -1000.5 * 299_792_458.0 / 1602.5625e6, rtol=1e-12)
    alone = read(folder, imu=IMU, observations={"file": "rover.obs"})
    assert alone.ephemerides is None
    assert np.isnan(alone.observations.range_rate[glonass]).all()


def test_ephemerides_of_a_folder_may_be_in_several_files(folder):
    """Satellites alone are a recording: without entries, every file of ephemerides belongs to the observations."""
    (folder / "imu.csv").unlink()
    recording = read(folder)
    parts = read(folder, observations={"file": "rover.obs"}, ephemerides={"file": ["glonass.nav", "gps.nav"]})
    assert (len(recording.ephemerides.kepler), len(recording.ephemerides.glonass)) == (1, 1)
    np.testing.assert_array_equal(recording.observations.range_rate, parts.observations.range_rate)


def test_a_folder_whose_imu_counts_another_week(folder):
    """Everything comes to the time base of the first entry, observations with their own epoch."""
    late = {**IMU, "time": f"gps-tow:{WEEK - 1}"}
    r = read(folder, imu=late, observations={"file": "rover.obs"}, ephemerides={"file": "gps.nav"})
    assert r.observations.t[0] == TOW + 604_800.0
    assert r.observations.epoch_gps_s == (WEEK - 1) * 604_800.0
    with pytest.raises(InputError, match="local time"):
        read(folder, imu={**IMU, "time": "local"}, observations={"file": "rover.obs"})


def test_a_folder_without_entries(folder):
    (folder / "glonass.nav").unlink()
    (folder / "imu.csv").write_text(
        "t [s],ax [m/s^2],ay [m/s^2],az [m/s^2],gx [rad/s],gy [rad/s],gz [rad/s]\n" + (folder / "imu.csv").read_text()
    )
    with pytest.raises(InputError, match="local time"):
        read(folder)  # the IMU does not say what its stamps count
    (folder / "imu.csv").unlink()
    r = read(folder)
    assert len(r.observations) == 8
    assert len(r.ephemerides.kepler) == 1
    assert any("not read: README" in note for note in r.metadata.notes)
    (folder / "second.obs").write_text(observations(start=10))
    with pytest.raises(FileFormatError, match=r"observations: rover.obs, second.obs.*say which"):
        read(folder)


def test_wrong_entries_are_explained(folder):
    with pytest.raises(InputError, match=r"ephemerides: expected an entry such as"):
        read(folder, imu=IMU, ephemerides={"files": "gps.nav"})
    with pytest.raises(InputError, match="got an empty list"):
        read(folder, imu=IMU, ephemerides={"file": []})
    with pytest.raises(InputError, match="series='observations' was asked for, the file holds ephemerides"):
        read(folder, observations={"file": "gps.nav"})
    with pytest.raises(InputError, match="series='ephemerides' was asked for, the file holds observations"):
        read(folder, ephemerides={"file": "rover.obs"})


def test_channels_given_to_a_single_file(folder):
    r = read_one(folder / "rover.obs", ReadHints(), {105: -7})
    assert np.isfinite(r.observations.range_rate).all()


# --- real files -------------------------------------------------------------------------------------------------------


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "held"),
    [
        ("rtkexp_walk/gnss_1730.obs", ("observations",)),
        ("rtkexp_walk/gnss_1730.nav", ("ephemerides",)),
        ("rtkexp_walk/gnss_1730.ubx", ("gnss", "observations")),
        ("rtkexp_walk/gnss_1730_sf.pos", ()),
        ("rtkexp_walk/imu_gpst.csv", ()),
        ("instinct_spirent/RINEX_EN_Spirent.23L", ("ephemerides",)),
        ("instinct_tckf/reach-m2-01_raw_202306291111.23O", ("observations",)),
        ("instinct_tckf/vn310-imu.csv", ("imu",)),
        ("instinct_tckf/vn310-gnss.csv", ("gnss",)),
        ("psins_lasergyro/lasergyro.imu", ("imu",)),
        ("psins_tc/insgpseo_tc.mat", ("imu", "observations")),
        ("gnss_nav_files/BRDC00WRD_S_20230730000_01D_MN.rnx", ("ephemerides",)),
        ("gnss_nav_files/brdc1180.21n", ("ephemerides",)),
        ("gnss_nav_files/COD0MGXFIN_20211180000_01D_05M_ORB.SP3", ("ephemerides",)),
        ("gnss_nav_files/Pixel4XL_derived.csv", ()),
        ("pyshoe_vicon/2017-11-22-11-22-03.mat", ()),
    ],
)
def test_real_files_are_told_apart(shared_data, name, held):
    path = shared_data / name
    if not path.exists():
        pytest.skip(f"{path} is not here")
    assert kinds_of(path, check_file(path)) == held


@pytest.mark.campaign
@pytest.mark.realdata
def test_an_entry_takes_what_it_names_out_of_a_log_of_everything(shared_data):
    pytest.importorskip("pyubx2")
    parts = {"file": "gnss_1730.ubx"}
    r = read(shared_data / "rtkexp_walk", observations=parts)
    assert r.gnss is None
    assert len(r.ephemerides.kepler) == 19  # its own, since there is no other entry
    assert any("not used are its gnss" in note for note in r.metadata.notes)
    both = read(shared_data / "rtkexp_walk", observations=parts, ephemerides={"file": "gnss_1730.nav"})
    assert len(both.ephemerides.kepler) == 28


@pytest.mark.realdata
def test_columns_still_read_the_same_files_by_hand(shared_data):
    path = shared_data / "psins_tc" / "insgpseo_tc.mat"
    whole = read(path)
    assert len(whole.observations) == 10_584
    hand = read(path, columns="gx,gy,gz,ax,ay,az,t", units="m/s,rad", axes="RFU", kind="increment")
    assert hand.observations is None
    np.testing.assert_array_equal(hand.imu.accel, whole.imu.accel)
    parts = read(path.parent, imu={"file": path.name}, observations={"file": path.name})
    assert len(parts.imu) == len(whole.imu)
    assert len(parts.ephemerides.kepler) == 10
    with pytest.raises(InputError, match="is a PSINS file of ranges and says this itself; leave out axes"):
        read(path, axes="RFU")


@pytest.mark.realdata
def test_files_that_are_not_read_are_refused_with_a_reason(shared_data):
    with pytest.raises(FileFormatError, match="no sensor is recognised"):
        read(shared_data / "gnss_nav_files" / "Pixel4XL_derived.csv")
