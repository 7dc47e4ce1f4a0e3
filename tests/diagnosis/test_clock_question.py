"""Folders whose clocks nobody related: the motion in both tells, or each file is judged by itself."""

from __future__ import annotations

import diagnosis_drives as drives
import numpy as np
import pytest

from schuler.cli import main
from schuler.diagnosis import diagnose_log
from schuler.timebase import UNIX_TO_GPS_S, WEEK_S, leap_seconds, week_tow
from schuler.units import DEG, G0

IMU = {"file": "imu.csv", "columns": "t,ax,ay,az,gx,gy,gz", "units": "m/s^2,rad/s", "axes": "FRD"}
GNSS = {"file": "gnss.csv", "columns": "t,lat,lon,h,vn,ve,vd,sn,se,sd,svn,sve,svd", "units": "angle=deg",
        "height": "ellipsoidal", "time": "gps"}  # fmt: skip
START = 1.4e9  # GPS time of the drive [s]
LEAP = 18.0


@pytest.fixture(scope="module")
def drive():
    return drives.drive(120.0)


@pytest.fixture
def folder(tmp_path, drive):
    """Files of the drive with the IMU's stamps as a function of GPS time."""

    def made(stamp, *, accel=1.0, still=False):
        imu, g = drive.imu, drive.gnss
        rows = np.column_stack((stamp(imu.t + START), imu.accel * accel, imu.gyro))
        np.savetxt(tmp_path / "imu.csv", rows, delimiter=",", fmt="%.6f" if accel == 1.0 else "%.9f")
        sigma = np.full((len(g), 3), 0.02)
        llh, v = g.llh / [DEG, DEG, 1.0], g.v_n
        if still:
            llh, v = np.tile(llh[0], (len(g), 1)), 0.0 * v + np.random.default_rng(1).normal(0.0, 0.01, v.shape)
        table = np.column_stack((g.t + START, llh, v, sigma, sigma))
        np.savetxt(tmp_path / "gnss.csv", table, delimiter=",", fmt="%.12g")
        return tmp_path

    return made


def stamps():
    week = week_tow(START)[0]
    return [
        ("time of week", lambda t: t - week * WEEK_S, f"time='gps-tow:{week}' for the IMU"),
        ("Unix time", lambda t: t + UNIX_TO_GPS_S - LEAP, "time='unix' for the IMU"),
        ("GPS seconds", lambda t: t, "time='gps' for the IMU"),
    ]


def test_leap_seconds_of_the_drive():
    from schuler.timebase import calendar

    assert leap_seconds(calendar(START).date()) == LEAP


@pytest.mark.thinned(4)
@pytest.mark.parametrize(("name", "stamp", "option"), stamps(), ids=[s[0] for s in stamps()])
def test_the_meaning_of_the_stamps_is_named(folder, name, stamp, option):
    diagnosis = diagnose_log(folder(stamp), imu=IMU, gnss=GNSS)
    assert diagnosis.codes() == ("clock_unknown",), diagnosis.summary()
    assert diagnosis.options() == (option,)
    assert "axes" in diagnosis.checked
    stated = IMU | {"time": option.split("'")[1]}
    assert diagnose_log(folder(stamp), imu=stated, gnss=GNSS).codes() == ()


def test_a_counter_from_power_up_is_brought_over_by_the_motion(folder):
    """Whatever zero is: the option adds what is missing, to the sigma of the clock."""
    path = folder(lambda t: t - START + 777.0)
    diagnosis = diagnose_log(path, imu=IMU, gnss=GNSS)
    assert diagnosis.codes() == ("clock_unknown",)
    time, offset = (part.partition("=")[2] for part in diagnosis.options()[0].removesuffix(" for the IMU").split(", "))
    tow = START - week_tow(START)[0] * WEEK_S
    assert float(offset) == pytest.approx(tow - 777.0, abs=0.03)  # statistical, 1-sigma 8 ms
    again = diagnose_log(path, imu=IMU | {"time": time.strip("'"), "offset": float(offset)}, gnss=GNSS)
    assert again.codes() == ()


def test_other_faults_beside_the_question_are_found(folder):
    diagnosis = diagnose_log(folder(lambda t: t - START, accel=1.0 / G0), imu=IMU, gnss=GNSS)
    assert set(diagnosis.codes()) == {"clock_unknown", "accel_unit"}


def test_without_motion_each_is_judged_by_itself(folder):
    path = folder(lambda t: t - START, accel=1.0 / G0, still=True)
    diagnosis = diagnose_log(path, imu=IMU, gnss=GNSS)
    assert {"clock_unknown", "accel_unit"} <= set(diagnosis.codes())
    assert {"unit of specific force", "positions against velocities", "GNSS quality"} <= set(diagnosis.checked)
    question = next(f for f in diagnosis.findings if f.code == "clock_unknown")
    assert "each was judged by itself" in question.text
    assert "time=" in question.fix


def test_the_command_ends_with_two_and_the_option(folder, capsys):
    path = folder(lambda t: t - START)
    config = path / "drive.toml"
    entries = [f"[recording.{part}]\n" + "".join(f'{k} = "{v}"\n' for k, v in entry.items())
               for part, entry in (("imu", IMU), ("gnss", GNSS))]  # fmt: skip
    config.write_text("\n".join(entries), encoding="utf-8")
    assert main(["check", str(path), "--config", str(config)]) == 2
    out = capsys.readouterr().out
    assert "error clock_unknown" in out
    assert "checked: unit of specific force, positions against velocities, IMU clock against GNSS" in out


@pytest.mark.campaign
def test_exchanged_coordinates_do_not_hide_what_is_wrong_with_the_imu(tmp_path, drive):
    """A latitude of 109 deg is refused by the reader; the two are exchanged back and the rest is looked at."""
    imu, g = drive.imu, drive.gnss
    np.savetxt(tmp_path / "imu.csv", np.column_stack((imu.t, imu.accel / G0, imu.gyro)), delimiter=",", fmt="%.9f")
    llh = g.llh / [DEG, DEG, 1.0] + [0.0, 100.0, 0.0]
    sigma = np.full((len(g), 3), 0.02)
    for name, latlon, code in (
        ("exchanged", llh[:, [1, 0, 2]], "position_order"),
        ("u-blox", llh * [1e7, 1e7, 1.0], "position_unit"),
    ):
        table = np.column_stack((g.t, latlon, g.v_n, sigma, sigma))
        np.savetxt(tmp_path / "gnss.csv", table, delimiter=",", fmt="%.12g")
        diagnosis = diagnose_log(tmp_path, imu=IMU, gnss={k: v for k, v in GNSS.items() if k != "time"})
        assert set(diagnosis.codes()) == {code, "accel_unit"}, name
        assert "axes" in diagnosis.checked
