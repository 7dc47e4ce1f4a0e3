"""Waypoint's raw IMU files and text exports."""

import struct

import numpy as np
import pytest
from format_drives import WEEK, drive, same_trajectory

from schuler import units
from schuler.exceptions import FileFormatError
from schuler.recording.io import read


def imr(order="<", theta=1, velocity=1, n=300, utc=2, **changes):
    """A file packed field by field: 100 Hz, 1e-6 deg and 1e-5 m/s a count, at rest, x right, y forward, z up."""
    rate = 100.0
    fields = {"gyro": 1e-6 if theta else 1e-4, "accel": 1e-5 if velocity else 1e-3, "bias": 0.0, "lever": 0, **changes}
    data = struct.pack(f"{order}8sbdiidddiid", b"$IMURAW\0", order == ">", 8.8, theta, velocity, rate,
                       fields["gyro"], fields["accel"], utc, 2, fields["bias"])  # fmt: skip
    data += struct.pack(f"{order}32s4x32s12xb3i354x", b"SPAN-X", b"a test", fields["lever"], 100, -200, 1500)
    assert len(data) == 512
    w = (100, 200, 300)  # counts of increments of 1e-4, 2e-4, 3e-4 deg
    f = (1000, 2000, 9810)
    for k in range(n):
        data += struct.pack(f"{order}d6i", 345600.01 + k / rate, *w, *f)
    return data


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("theta", "velocity"), [(1, 1), (0, 0), (0, 1), (1, 0)])
def test_imr(tmp_path, order, theta, velocity):
    """Increments of degrees and metres a second in both byte orders; mixed files become increments."""
    (tmp_path / "a.imr").write_bytes(imr(order, theta, velocity, lever=1))
    run = read(tmp_path / "a.imr", time=f"gps-tow:{WEEK}", allow="norm")
    rates = run.imu.rates()
    w = np.array((2e-4, 1e-4, -3e-4)) * units.DEG * 100.0
    np.testing.assert_allclose(rates.gyro[5], w, rtol=1e-9)
    np.testing.assert_allclose(rates.accel[5], (2.0, 1.0, -9.81), rtol=1e-9)
    assert run.imu.kind == ("increment" if theta or velocity else "rate")
    assert run.imu.t[0] == pytest.approx(345600.01, abs=1e-9)
    assert any("SPAN-X" in note for note in run.metadata.notes)
    assert any("[0.1, -0.2, 1.5] m" in note for note in run.metadata.notes)


def test_imr_utc(tmp_path):
    """Seconds of week in UTC get the 18 leap seconds of 2024."""
    (tmp_path / "a.imr").write_bytes(imr(utc=1))
    run = read(tmp_path / "a.imr", time=f"gps-tow:{WEEK}", allow="norm")
    assert run.imu.t[0] == pytest.approx(345618.01, abs=1e-9)


def test_imr_refused(tmp_path):
    file = tmp_path / "a.imr"
    for data, message in (
        (imr()[:300], "header of 512"), (imr()[:-5], "cut off"), (imr(n=0), "no records"), (imr(gyro=0.0), "scales"),
        (imr(bias=1e9), "damaged"), (b"$IMURAW\0\x07" + imr()[9:], "byte order"),
    ):  # fmt: skip
        file.write_bytes(data)
        with pytest.raises(FileFormatError, match=message):
            read(file)
    file.write_bytes(imr()[:-5])
    assert len(read(file, allow="truncated,norm").imu) == 299


HEADER = """Project:     a test
Program:     Inertial Explorer Version 8.90.6611
Source:      GNSS/INS Epochs(Smoothed TC Combined)

Datum:       WGS84, (processing datum)
"""
NAMES = "Week GPSTime Latitude Longitude H-Ell VEast VNorth VUp Roll Pitch Heading SDNorth SDEast SDHeight Q"
UNITS = "(weeks) (sec) (deg) (deg) (m) (m/s) (m/s) (m/s) (deg) (deg) (deg) (m) (m) (m)"


def export(path, dms=False, names=NAMES, stated=UNITS + " ()"):
    run = drive()
    T = run.reference
    rows = []
    for k in range(0, len(T), 10):
        lat, lon = np.degrees(T.llh[k, :2])
        place = f"{lat:.12f} {lon:.12f}"
        if dms:
            place = " ".join(f"{int(x)} {int(x % 1 * 60):02d} {x % 1 * 60 % 1 * 60:.9f}" for x in (lat, lon))
        v, (roll, pitch, yaw) = T.v_eb_n[k], np.degrees(T.rpy_nb[k])
        rows.append(f"{WEEK} {T.t[k]:.4f} {place} {T.llh[k, 2]:.6f} {v[1]:.9f} {v[0]:.9f} {-v[2]:.9f} {roll:.12f} "
                    f"{pitch:.12f} {yaw % 360:.12f} 0.01 0.02 0.03 1")  # fmt: skip
    if dms:
        stated = stated.replace("(deg) (deg) (m)", "(D M S) (+/-D M S) (m)", 1)
    path.write_text(f"{HEADER}\n{names}\n{stated}\n" + "\n".join(rows) + "\n")
    return run


@pytest.mark.parametrize("dms", [False, True])
def test_export(tmp_path, dms):
    """Positions to the printed digits (1e-12 deg, 1e-9 arcsec, 1e-6 m); east and north are told apart."""
    run = export(tmp_path / "a.txt", dms)
    back = read(tmp_path / "a.txt")
    assert back.metadata.time == run.metadata.time
    T = run.reference
    wanted = type(T)(T.t[::10], T.r_eb_e[::10], T.v_eb_e[::10], T.q_eb[::10])
    same_trajectory(back.reference, wanted, t=1e-4, r=2e-6, v=3e-9, q=1e-11)


def test_export_as_fixes(tmp_path):
    export(tmp_path / "a.txt")
    fixes = read(tmp_path / "a.txt", series="gnss", allow="no-velocity")
    np.testing.assert_allclose(np.sqrt(np.diag(fixes.gnss.cov_r_n[0])), (0.01, 0.02, 0.03))
    assert fixes.gnss.v_n is None
    assert any("correlated" in note for note in fixes.metadata.notes)


def test_columns_without_a_unit(tmp_path):
    """Units stand right-justified below their names; quality has none, in whatever place."""
    (tmp_path / "a.txt").write_text(
        HEADER + "\n  Week    GPSTime  Q        Latitude       Longitude     H-Ell SDNorth  SDEast SDHeight\n"
        "          (sec)           (D M S)      (+/-D M S)       (m)     (m)     (m)      (m)\n"
        "  2300  100.0000  1   8 15 36.000    -8 15 36.000   100.000    0.01    0.02     0.03\n"
        "  2300  101.0000  1   8 15 36.000    -8 15 36.000   100.000    0.01    0.02     0.03\n"
    )
    run = read(tmp_path / "a.txt")
    np.testing.assert_allclose(np.degrees(run.gnss.llh[0, :2]), (8.26, -8.26))
    assert run.metadata.time.scale == "gps"


def test_southern_zero_degrees(tmp_path):
    """Minus zero degrees is south."""
    (tmp_path / "a.txt").write_text(
        "GPSTime Latitude Longitude H-Ell SDNorth SDEast SDHeight\n(sec) (D M S) (D M S) (m) (m) (m) (m)\n"
        "1 -0 30 0.0 8 15 36 100 1 1 1\n2 -0 30 0.1 8 15 36 100 1 1 1\n3 0 30 0 8 15 36 100 1 1 1\n"
    )
    llh = read(tmp_path / "a.txt").gnss.llh
    np.testing.assert_allclose(np.degrees(llh[:, 0]), (-0.5, -0.5 - 0.1 / 3600, 0.5), atol=1e-12)
    np.testing.assert_allclose(np.degrees(llh[0, 1]), 8.26)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("GPSTime", "UTCDate", "GPSTime was not exported"), ("(sec)", "(HMS)", r"t is in \(hms\)"),
        ("H-Ell", "H-MSL", "only H-MSL"), ("(deg) (deg) (m)", "(deg) (deg) (ft)", "export metres"),
        (" Q", " Q Extra", "header names 16 columns"), ("0.01 0.02", "0.01 x", r"a\.txt:9: column 13"),
    ],
)  # fmt: skip
def test_export_refused(tmp_path, old, new, message):
    export(tmp_path / "a.txt")
    (tmp_path / "a.txt").write_text((tmp_path / "a.txt").read_text().replace(old, new, 1))
    with pytest.raises(FileFormatError, match=message):
        read(tmp_path / "a.txt")


def test_heights_above_the_sea(tmp_path):
    export(tmp_path / "a.txt")
    (tmp_path / "a.txt").write_text((tmp_path / "a.txt").read_text().replace("H-Ell", "H-MSL"))
    back = read(tmp_path / "a.txt", height="msl", geoid_separation=48.0)
    assert back.reference.llh[0, 2] == pytest.approx(348.0, abs=1e-5)
