"""Real recordings: the good ones raise no alarm, and the traps their READMEs tell of are found."""

from __future__ import annotations

from dataclasses import replace

import corruption_drives as drives
import numpy as np
import pytest
from real_recordings import GOOD

from schuler.diagnosis import diagnose_log
from schuler.diagnosis.result import SURE
from schuler.diagnosis.run import diagnose
from schuler.recording.io import read

pytestmark = pytest.mark.realdata


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", GOOD)
def test_good_recordings_raise_no_alarm(shared_data, name):
    options, so_it_is = GOOD[name]
    diagnosis = diagnose_log(shared_data / name.partition("#")[0], **options)
    assert diagnosis.codes() == so_it_is, diagnosis.summary()
    assert diagnosis.ok


#: Estimators' references, and files of ephemerides and orbits.
NO_LOGS = {"allantools_refs", "gnss_nav_files"}
#: Added to judge defaults on recordings that were not looked at before; their own alarms are not gone through yet.
UNSEEN = {
    "euroc_imu", "llio_foot", "mikoff_mpu9150", "morpinet_car", "oan_phone_drive", "pyshoe_more", "urbannav_tst",
}  # fmt: skip


def test_every_recording_of_the_readme_is_among_them(shared_data):
    folders = {p.name for p in shared_data.iterdir() if p.is_dir()} - NO_LOGS - UNSEEN
    assert {name.split("/")[0] for name in GOOD} == folders


@pytest.mark.campaign
def test_nothing_stops_the_use_of_a_good_recording(shared_data):
    """What ``navigate`` and ``calibrate`` ask first; raw counts and turns by hand included."""
    for name, (options, _) in GOOD.items():
        if "ferraris_session" in name:
            options = options | {"allow": "norm"}
        diagnose(read(shared_data / name.partition("#")[0], **options), quick=True).require()


def _drive(shared_data, imu=(), gnss=()):
    options = {part: dict(entry) for part, entry in drives.REAL.items()}
    options["imu"] |= dict(imu)
    options["gnss"] = {name: value for name, value in (options["gnss"] | dict(gnss)).items() if value is not None}
    return diagnose_log(shared_data / "rtkexp_drive", **options)


def test_trap_heights_of_rtklib_above_sea_level(shared_data):
    diagnosis = _drive(shared_data, gnss={"height": None, "geoid_separation": None})
    assert diagnosis.codes() == ("height_level",)
    assert any("height='msl'" in option for option in diagnosis.options())


def test_trap_a_clock_an_eighth_of_a_second_late(shared_data):
    diagnosis = _drive(shared_data, imu={"offset": 0.0})
    assert diagnosis.codes() == ("time_offset",)
    # others' tuning: -0.125 s; the estimate is between what positions and velocities say, 0.13 s apart
    assert diagnosis.estimates["time_offset_s"] == pytest.approx(-0.125, abs=0.04)


def test_the_option_for_a_clock_counts_what_was_added_already(shared_data):
    option = next(o for o in _drive(shared_data, imu={"offset": 0.5}).options() if o.startswith("offset="))
    assert float(option.split()[0].partition("=")[2]) == pytest.approx(-0.125, abs=0.04)


def test_trap_axes_of_the_drive(shared_data):
    diagnosis = _drive(shared_data, imu={"axes": "FLU"})
    assert (diagnosis.codes(), diagnosis.options()) == (("axes",), ("axes='BRU'",))


@pytest.mark.parametrize(
    ("how", "codes"),
    [
        ({"units": "m/s^2,rad/s"}, ("kind", "axes")),  # increments read as rates
        ({"units": "m/s,rad", "kind": "increment"}, ("axes",)),  # right, forward, up read as forward, right, down
        ({"units": "m/s,rad", "kind": "increment", "axes": "RFU"}, ()),
    ],
)
def test_trap_increments_right_forward_up(shared_data, how, codes):
    path = shared_data / "psins_tc" / "insgpseo_tc.mat"
    diagnosis = diagnose_log(path, variable="imu", columns="gx,gy,gz,ax,ay,az,t", **how)
    assert set(diagnosis.codes()) <= set(codes), diagnosis.summary()
    assert diagnosis.codes()[:1] == codes[:1]
    if codes == ("axes",):
        assert "RFU" in diagnosis.options()[0]


def test_trap_noise_added_to_positions(shared_data):
    """As NaveGo adds it to its rover's GNSS (that file is not among these): white, alike on all axes."""
    drive = drives.real(shared_data, seconds=200.0)
    rng = np.random.default_rng(4)
    g = drive.gnss
    step = rng.normal(0.0, 1.0, g.llh.shape) * [1.0 / 6.36e6, 1.0 / 4.89e6, 1.0]
    diagnosis = diagnose(replace(drive, gnss=replace(g, llh=g.llh + step)))
    assert diagnosis.codes() == ("gnss_noise",)
    level = next(f for f in diagnosis.findings if f.code == "gnss_noise")
    assert "noise added by a program" in level.text
    assert np.allclose(level.evidence["noise_m"], 1.0, atol=0.15)  # statistical


def test_trap_stamps_of_the_thermal_chamber(shared_data):
    options, _ = GOOD["imu_thermal/imu_raw_data.csv"]
    diagnosis = diagnose_log(shared_data / "imu_thermal" / "imu_raw_data.csv", **options)
    assert "within 4.24 s" in diagnosis.findings[0].text


@pytest.mark.campaign
def test_a_folder_whose_clocks_nobody_stated(shared_data):
    """Its stamps are seconds of the GPS week, which the motion tells; the rest is judged on that clock."""
    diagnosis = diagnose_log(shared_data / "rtkexp_drive")
    assert diagnosis.codes() == ("clock_unknown", "axes", "time_offset", "height_level")
    assert diagnosis.options()[0].startswith("time='gps-tow:2374'")
    mended = diagnosis.options()[0].split("'")[1]
    assert "clock_unknown" not in _drive(shared_data, imu={"time": mended}).codes()


@pytest.mark.campaign
def test_a_counter_of_milliseconds_beside_gps_time(shared_data):
    """The raw log of the drive: its counter and GPS share no number, but the same motion."""
    imu = {"file": "imu_1934.csv", "columns": "ax,ay,az,gx,gy,gz,t", "units": "g,deg/s,ms", "axes": "BRU"}
    diagnosis = diagnose_log(shared_data / "rtkexp_drive", imu=imu, gnss=drives.REAL["gnss"])
    assert diagnosis.codes() == ("clock_unknown",)
    assert diagnosis.findings[0].confidence > SURE
    time, offset = (part.partition("=")[2] for part in diagnosis.options()[0].removesuffix(" for the IMU").split(", "))
    stated = imu | {"time": time.strip("'"), "offset": float(offset)}
    again = diagnose_log(shared_data / "rtkexp_drive", imu=stated, gnss=drives.REAL["gnss"])
    assert again.codes() == (), again.summary()
