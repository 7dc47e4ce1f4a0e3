"""RTKLIB solutions: layouts, time forms, signs of the covariances, heights; and writing them."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from schuler import frames
from schuler.exceptions import FileFormatError, InputError
from schuler.recording import GnssSeries, Recording
from schuler.recording.io import read, write

LLH = (
    "%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)"
    "  sdeu(m)  sdun(m) age(s)  ratio"
)
LLH_V = LLH + "    vn(m/s)    ve(m/s)    vu(m/s)      sdvn     sdve     sdvu    sdvne    sdveu    sdvun"
XYZ = LLH.replace("latitude(deg) longitude(deg)  height(m)", "x-ecef(m)      y-ecef(m)      z-ecef(m)")
LONG = (
    "% program : RTKPOST\n% inp file  : a.obs\n% pos mode  : static\n%\n% (lat/lon/height=WGS84/{},Q=1:fix,2:float)\n"
)
ROW = "2025/07/08 19:34:18.499 40.0966268 -105.1474483 1601.4740 1 21 0.0100 0.0200 0.0300 {} 0.00 12.5"
CROSS = "0.0100 -0.0150 0.0120"


@pytest.fixture
def pos(tmp_path: Path):
    def write_lines(*lines: str, name: str = "rover.pos", end: str = "\n") -> Path:
        path = tmp_path / name
        path.write_text(end.join(lines) + end)
        return path

    return write_lines


def test_positions_times_and_quality(pos):
    r = read(pos(LLH, ROW.format(CROSS)))
    gnss = r.gnss
    np.testing.assert_allclose(np.rad2deg(gnss.llh[0, :2]), (40.0966268, -105.1474483), rtol=1e-15)  # rounding
    assert gnss.llh[0, 2] == 1601.474
    assert (gnss.quality[0], gnss.n_satellites[0]) == (1, 21)
    assert r.metadata.time.scale == "gps"
    assert r.metadata.time.epoch_gps_s == 2374 * 604_800.0
    assert gnss.t[0] == pytest.approx(243_258.499, abs=1e-10)  # rounding of a time of week
    assert gnss.v_n is None


def test_signed_roots_become_covariances_with_down_for_up(pos):
    """sdne, sdeu, sdun are roots that carry the sign; terms with the vertical change sign from up to down."""
    cov = read(pos(LLH, ROW.format(CROSS))).gnss.cov_r_n[0]
    expected = [
        [0.01**2, 0.01**2, -(0.012**2)],
        [0.01**2, 0.02**2, +(0.015**2)],
        [-(0.012**2), +(0.015**2), 0.03**2],
    ]
    np.testing.assert_allclose(cov, expected, rtol=1e-14)  # rounding


def test_velocities_and_their_covariances(pos):
    row = ROW.format(CROSS) + " 1.5 -2.5 0.5 0.10 0.20 0.30 -0.05 0.06 0.07"
    gnss = read(pos(LLH_V, row)).gnss
    np.testing.assert_array_equal(gnss.v_n[0], (1.5, -2.5, -0.5))
    expected = [[0.01, -0.0025, -0.0049], [-0.0025, 0.04, -0.0036], [-0.0049, -0.0036, 0.09]]
    np.testing.assert_allclose(gnss.cov_v_n[0], expected, rtol=1e-14)  # rounding


def test_earth_fixed_positions_are_the_same_as_geodetic_ones(pos):
    llh = np.array([np.deg2rad(40.0966268), np.deg2rad(-105.1474483), 1601.474])
    C_en = frames.C_en(llh)
    cov_n = read(pos(LLH, ROW.format(CROSS))).gnss.cov_r_n[0]
    c = C_en @ cov_n @ C_en.T
    v_e = C_en @ (1.5, -2.5, 0.5)
    roots = [np.sqrt(c[0, 0]), np.sqrt(c[1, 1]), np.sqrt(c[2, 2])]
    roots += [np.sign(k) * np.sqrt(abs(k)) for k in (c[0, 1], c[1, 2], c[2, 0])]
    numbers = [*(f"{x:.9f}" for x in frames.ecef_from_llh(llh)), "2 9", *(f"{x:.12f}" for x in roots), "0 0"]
    numbers += [*(f"{x:.9f}" for x in v_e), *(f"{x:.12f}" for x in roots)]
    header = XYZ + " vx(m/s) vy(m/s) vz(m/s) sdvx sdvy sdvz sdvxy sdvyz sdvzx"
    gnss = read(pos(header, "2025/07/08 19:34:18.499 " + " ".join(numbers))).gnss
    np.testing.assert_allclose(gnss.llh[0], llh, rtol=0, atol=2e-9)  # rounding of the printed nanometres
    np.testing.assert_allclose(gnss.cov_r_n[0], cov_n, atol=1e-13)  # rounding of the printed roots, here and below
    np.testing.assert_allclose(gnss.cov_v_n[0], cov_n, atol=1e-13)
    np.testing.assert_allclose(gnss.v_n[0], (1.5, -2.5, 0.5), atol=3e-9)
    assert gnss.quality[0] == 2


@pytest.mark.parametrize(
    ("header", "stamp", "tow"),
    [
        (LLH, "2025/07/08 19:34:18.499", 243_258.499),
        (LLH, "2374 243258.499", 243_258.499),
        # UTC is 18 s behind GPS time
        (LLH.replace("GPST", "UTC "), "2025/07/08 19:34:00.499", 243_258.499),
        (LLH.replace("GPST", "UTC "), "2374 243240.499", 243_258.499),
        (LLH, "2024/02/29 00:00:00.000", 345_600.0),
        (LLH, "2025/07/08 19:33:60.000", 243_240.0),
    ],
)
def test_time_forms(pos, header, stamp, tow):
    row = ROW.format(CROSS).replace("2025/07/08 19:34:18.499", stamp)
    r = read(pos(header, row))
    assert r.gnss.t[0] == pytest.approx(tow, abs=1e-9)  # rounding of a time of week
    assert any("18 leap seconds" in note for note in r.metadata.notes) == ("UTC" in header)


def test_leap_seconds_follow_the_date(pos):
    row = ROW.format(CROSS)
    rows = [row.replace("2025/07/08 19:34:18.499", f"2016/12/31 23:59:{s}.000") for s in (58, 59)]
    rows += [row.replace("2025/07/08 19:34:18.499", f"2017/01/01 00:00:0{s}.000") for s in (0, 1)]
    t = read(pos(LLH.replace("GPST", "UTC "), *rows)).gnss.t
    np.testing.assert_allclose(np.diff(t), (1.0, 2.0, 1.0), atol=1e-9)  # rounding; the leap second lies between


@pytest.mark.parametrize("delimiter", [",", "\t", ";"])
def test_other_delimiters(pos, delimiter):
    stamp, rest = ROW.format(CROSS).split(" 40.", 1)
    row = delimiter.join((stamp, *("40." + rest).split()))
    header = delimiter.join(LLH.split())
    np.testing.assert_array_equal(read(pos(header, row)).gnss.llh, read(pos(LLH, ROW.format(CROSS))).gnss.llh)


def test_heights_follow_the_header_and_the_hints(pos):
    short = pos(LLH, ROW.format(CROSS))
    r = read(short)
    assert r.gnss.llh[0, 2] == 1601.474
    assert any("Heights are taken as ellipsoidal" in note for note in r.metadata.notes)
    r = read(short, height="msl", geoid_separation=-17.0)
    assert r.gnss.llh[0, 2] == 1601.474 - 17.0
    assert any("geoid separation -17 m" in note for note in r.metadata.notes)

    ellipsoidal = pos(LONG.format("ellipsoidal") + LLH, ROW.format(CROSS), name="e.pos")
    assert not any("Heights" in note for note in read(ellipsoidal).metadata.notes)
    with pytest.raises(FileFormatError, match="the file says its heights are above the ellipsoid, the hint says msl"):
        read(ellipsoidal, height="msl", geoid_separation=-17.0)
    r = read(ellipsoidal, height="msl", geoid_separation=-17.0, allow="height")
    assert r.gnss.llh[0, 2] == 1601.474 - 17.0

    geodetic = pos(LONG.format("geodetic") + LLH, ROW.format(CROSS), name="g.pos")
    with pytest.raises(FileFormatError, match=r"above mean sea level: say height='msl' and geoid_separation"):
        read(geodetic)
    assert read(geodetic, height="msl", geoid_separation=-17.0).gnss.llh[0, 2] == 1601.474 - 17.0
    with pytest.raises(FileFormatError, match="Earth-fixed positions have no height above sea level"):
        read(pos(XYZ, ROW.format(CROSS), name="x.pos"), height="msl", geoid_separation=1.0)


def test_accuracies_of_zero_need_a_sigma(pos):
    row = ROW.format(CROSS).replace("0.0200", "0.0000").replace("19:34:18", "19:34:19")
    path = pos(LLH, ROW.format(CROSS), row)
    with pytest.raises(
        FileFormatError, match=rf"^{re.escape(str(path))}:3: expected a positive 1-sigma of position, got 0"
    ):
        read(path)
    r = read(path, sigma=(1.0, 2.0, 3.0))
    np.testing.assert_array_equal(np.diag(r.gnss.cov_r_n[1]), (1.0, 4.0, 9.0))
    assert r.gnss.cov_r_n[0, 0, 0] == pytest.approx(1e-4)


def test_covariances_spoilt_by_printing_lose_their_cross_terms(pos):
    """Roots printed to 0.1 mm can correlate by more than one, which no filter survives."""
    r = read(pos(LLH, ROW.format("0.0150 0.0000 0.0000")))
    np.testing.assert_allclose(r.gnss.cov_r_n[0], np.diag((1e-4, 4e-4, 9e-4)), rtol=1e-14)  # rounding
    assert any("not positive definite; its cross terms were dropped" in note for note in r.metadata.notes)


@pytest.mark.parametrize(
    ("lines", "line", "message"),
    [
        ((LLH, ROW.format("x 0 0")), 2, "column 15: expected a number, got 'x'"),
        ((LLH, ROW.format("0 0")), 2, "expected 13 columns after the time"),
        ((LLH, ROW.format(CROSS), ROW.format("0 0")), 3, "expected 19 columns, got 18"),
        ((LLH, ROW.format(CROSS), ROW.format(CROSS)), 3, "repeats the time of the row before"),
        ((LLH, "", ROW.format(CROSS).replace("2025/07", "2025/13")), 3, "impossible date or time"),
        ((LLH, ROW.format(CROSS).replace("2025/07/08", "1979/07/08")), 2, "impossible date or time"),
        ((LLH, ROW.format(CROSS).replace("19:34:18", "19:61:18")), 2, "impossible date or time"),
        (
            (LLH, ROW.format(CROSS).replace("2025/07/08 19:34:18.499", "2374 604800")),
            2,
            "impossible time of week 604800",
        ),
        ((LLH, ROW.format(CROSS).replace("2025/07/08 19:34:18.499", "2374.5 6048")), 2, "impossible GPS week 2374.5"),
        ((LLH, ROW.format(CROSS).replace("40.0966268", "nan")), 2, "column 7: expected a number, got nan"),
        ((LLH, ROW.format(CROSS).replace("40.0966268", "140.09")), 2, r"latitude 140.09 deg is beyond"),
        ((LLH, ROW.format(CROSS).replace(" 1 21 ", " 0 21 ")), 2, "expected a quality q of"),
        ((XYZ, ROW.format(CROSS)), 2, "from the Earth's centre is impossible"),
        ((LLH.replace("GPST", "JST "), ROW.format(CROSS)), 1, "expected times in GPST or UTC, got JST"),
        ((LLH.replace("GPST", "    "), ROW.format(CROSS)), 1, "expected times in GPST or UTC, got neither"),
        ((LLH.replace("latitude(deg)", "latitude(d'\")"), ROW.format(CROSS)), 1, "degrees, minutes and seconds"),
        (("%  GPST  e-baseline(m) n-baseline(m) u-baseline(m)", ROW.format(CROSS)), 1, "baselines from a base station"),
        (("% nothing", ROW.format(CROSS)), 2, "expected RTKLIB's line"),
        (("2025/07/08 19:34:18.499 1 2 3",), 1, "expected RTKLIB's line"),
        ((LLH, "% only comments"), None, "there are comment lines but no solutions"),
        ((LLH.replace("GPST", "UTC "), ROW.format(CROSS).replace("2025/07", "1979/07")), 2, "impossible date"),
    ],
)
def test_refusals_name_the_line(pos, lines, line, message):
    path = pos(*lines)
    where = re.escape(str(path)) + (f":{line}: " if line else ": ")
    with pytest.raises(FileFormatError, match=f"^{where}.*{message}"):
        read(path)


def test_hints_that_a_solution_answers_itself_are_refused(pos):
    with pytest.raises(InputError, match="says this itself; leave out columns, units"):
        read(pos(LLH, ROW.format(CROSS)), columns="t,lat,lon,h", units="angle=deg")


def test_a_solution_is_known_by_its_contents(pos):
    assert read(pos(LLH, ROW.format(CROSS), name="rover.txt")).gnss is not None


def test_a_solution_may_serve_as_the_reference(pos):
    row = ROW.format(CROSS) + " 1.5 -2.5 0.5 0.10 0.20 0.30 -0.05 0.06 0.07"
    r = read(pos(LLH_V, row), series="reference")
    np.testing.assert_allclose(r.reference.v_eb_n[0], (1.5, -2.5, -0.5), atol=1e-14)  # rounding
    assert r.gnss is None
    assert any("of the antenna; no lever arm" in note for note in r.metadata.notes)


def test_another_series_than_the_solution_is_refused(pos):
    with pytest.raises(InputError, match="series='imu' was asked for, the file holds gnss"):
        read(pos(LLH, ROW.format(CROSS)), series="imu")


def test_a_cut_off_last_line(pos):
    path = pos(LLH, ROW.format(CROSS), ROW.format(CROSS).replace("18.499", "19.499")[:60])
    path.write_text(path.read_text().rstrip("\n"))
    with pytest.raises(FileFormatError, match=r":3: the last line is incomplete"):
        read(path)
    assert len(read(path, allow="truncated").gnss) == 1


def test_stamps_just_below_a_minute_are_not_printed_as_sixty_seconds(run, tmp_path):
    t = 259_200.0 + np.array([59.999, 59.9996, 59.9999999, 60.0])
    gnss = GnssSeries(t, run.gnss.llh[:4], np.tile(np.eye(3) * 1.7e-14, (4, 1, 1)))
    [path] = write(Recording(gnss=gnss, metadata=run.metadata), tmp_path / "run.pos")
    assert ":60" not in path.read_text()
    back = read(path).gnss
    np.testing.assert_allclose(back.t, t, rtol=0, atol=1e-9)  # printed digits
    # accuracies of 0.1 um must not be printed as none
    np.testing.assert_allclose(back.cov_r_n, gnss.cov_r_n, rtol=1e-3, atol=1e-20)


def test_a_local_clock_cannot_be_written(still, table, tmp_path):
    path = table([(0, 48, 9, 300)], header="t,lat [deg],lon [deg],h")
    with pytest.raises(InputError, match=r"a .pos file needs GPS time, and this recording runs on local time"):
        write(read(path, sigma="1,1,1"), tmp_path / "run.pos")


def test_a_stamp_without_a_date_cannot_be_written(run, tmp_path):
    t = run.gnss.t[:4] + np.array([0.0, 1.0, 2.0, 4e10])
    gnss = GnssSeries(t, run.gnss.llh[:4], np.tile(np.eye(3), (4, 1, 1)))
    with pytest.raises(InputError, match=r"stamps up to 4.*e\+10 s have none: expected up to 8e\+09 s"):
        write(Recording(gnss=gnss, metadata=run.metadata), tmp_path / "run.pos")
    assert not (tmp_path / "run.pos").exists()
    late = replace(run.metadata, time=replace(run.metadata.time, epoch_gps_s=5e10))  # a clock that began then
    with pytest.raises(InputError, match=r"stamps up to 5e\+10 s have none"):
        write(replace(run, metadata=late), tmp_path / "run.pos")
