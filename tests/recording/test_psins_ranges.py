"""PSINS data: text logs of counts, and increments with ranges and ephemerides in MATLAB files."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io

import schuler
from schuler import earth, rotation, units
from schuler.exceptions import FileFormatError, InputError
from schuler.gnss.signals import SPEED_OF_LIGHT
from schuler.recording.formats.psins import looks_like_psins_imu, read_psins_imu, read_psins_ranges
from schuler.recording.io import ReadHints

WEEK = 604_800.0
HEADER = (
    "% PSINS-format SIMU log file.\n% comment\n\n0.0 0.0 -90.6 0 0 0\n34.246 108.91 380.0 12.0 10.0 9.780327\n"
    "0.1 0.1 0.2 125.0 125.0 80.0\n"
)


@pytest.fixture
def log(tmp_path: Path):
    def write(text: str) -> Path:
        path = tmp_path / "simu.imu"
        path.write_text(text)
        return path

    return write


def test_counts_become_increments_forward_right_down(log):
    r = read_psins_imu(log(HEADER + "10 20 30 1 2 125\n-10 -20 -30 -1 -2 125\n"))
    imu = r.imu
    assert imu.kind == "increment"
    np.testing.assert_allclose(imu.t, (12.01, 12.02), rtol=1e-15)  # rounding, here and below
    # x right, y forward, z up
    np.testing.assert_allclose(imu.gyro[0], np.array([20 * 0.1, 10 * 0.1, -30 * 0.2]) * units.ARCSEC, rtol=1e-14)
    np.testing.assert_allclose(imu.accel[0], np.array([2 * 125.0, 125.0, -125 * 80.0]) * units.UG, rtol=1e-14)
    assert r.metadata.axes == "RFU"
    assert any("latitude 34.246000 deg" in note for note in r.metadata.notes)


def test_stated_axes_and_time(log):
    text = HEADER + "10 20 30 1 2 125\n" * 3
    r = read_psins_imu(log(text), ReadHints(axes="FRD", time="gps-tow:2374", offset=1.0, allow="norm"))
    np.testing.assert_allclose(r.imu.gyro[0], np.array([10 * 0.1, 20 * 0.1, 30 * 0.2]) * units.ARCSEC, rtol=1e-14)
    assert r.metadata.time.epoch_gps_s == 2374 * WEEK
    assert r.imu.t[0] == pytest.approx(13.01, rel=1e-15)
    with pytest.raises(InputError, match="says this itself; leave out units"):
        read_psins_imu(log(text), ReadHints(units="g,deg/s"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEADER, "expected three lines of header and at least two"),
        (HEADER.replace("9.780327", "0.0") + "0 0 0 0 0 125\n" * 2, "5: expected 'latitude"),
        (HEADER.replace("0.2 125", "-0.2 125") + "0 0 0 0 0 125\n" * 2, "six positive weights"),
        (HEADER + "0 0 0 0 0 125\n0 0 0 0 125\n", "8: expected six numbers, got '0 0 0 0 125'"),
        (HEADER + "0 0 0 0 0 125\n0 0 x 0 0 125\n", "8: expected six numbers"),
        (HEADER + "0 0 0 0 0 12\n" * 3, "mean specific force is 0.941 m/s"),
    ],
)
def test_malformed_logs(log, text, message):
    with pytest.raises(FileFormatError, match=message):
        read_psins_imu(log(text))


def test_recognition():
    assert looks_like_psins_imu(HEADER.encode())
    assert not looks_like_psins_imu(b"% something else\n")


def arrays() -> dict[str, np.ndarray]:
    imu = np.zeros((5, 7))
    imu[:, :6] = (1e-4, 2e-4, 3e-4, 0.01, 0.02, 0.049)
    imu[:, 6] = 0.005 * np.arange(5)
    obss = np.array([[100.0, 5, 2.2e7, 2.1e7, 0.05, -443.0], [100.0, 7, 2.3e7, 2.2e7, 0.06, 10.0]])
    ephs = np.zeros((32, 31))
    ephs[:, 0] = np.arange(1, 33)
    ephs[4] = np.arange(31) + 0.5
    ephs[4, [0, 1, 5, 13, 23, 25, 26]] = (5, 7200.0, 43, 7200.0, 2183, np.nan, 0)
    return {"imu": imu, "obss": obss, "ephs": ephs, "t0": np.array([[99.5]])}


@pytest.fixture
def mat(tmp_path: Path):
    def write(**changes: np.ndarray) -> Path:
        path = tmp_path / "tc.mat"
        scipy.io.savemat(path, {k: v for k, v in (arrays() | changes).items() if v is not None})
        return path

    return write


def test_increments_ranges_and_ephemerides_on_one_time_axis(mat):
    r = read_psins_ranges(mat())
    assert r.recording.imu.kind == "increment"
    assert r.recording.imu.gyro[0].tolist() == [2e-4, 1e-4, -3e-4]
    assert r.recording.imu.accel[0].tolist() == [0.02, 0.01, -0.049]
    assert r.recording.imu.t[:2].tolist() == [99.5, 99.505]
    assert r.recording.metadata.time.epoch_gps_s == r.observations.epoch_gps_s == 2183 * WEEK
    assert r.recording.observations is r.observations
    assert r.recording.ephemerides is r.ephemerides
    o = r.observations
    assert (o.t.tolist(), o.sat.tolist(), o.signals) == ([100.0, 100.0], [5, 7], ("1C",))
    assert o.pseudorange.tolist() == [2.2e7, 2.3e7]
    assert o.range_rate.tolist() == [443.0, -10.0]
    np.testing.assert_allclose(o.carrier, np.array([2.1e7, 2.2e7]) * 1575.42e6 / SPEED_OF_LIGHT, rtol=1e-14)  # rounding
    assert r.sigma_range.tolist() == [0.05, 0.06]
    k = r.ephemerides.kepler
    assert (len(k), k.sat[0], k.issue[0], k.health[0], k.accuracy[0]) == (1, 5, 43, 0, 2.0)
    assert (k.toe[0], k.toc[0]) == (2183 * WEEK + 7200.0, 2183 * WEEK + 7200.0)
    assert (k.af0[0], k.crs[0], k.sqrt_a[0], k.idot[0], k.group_delay[0, 0]) == (2.5, 6.5, 12.5, 21.5, 27.5)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"obss": None}, "expected an array obss of numbers with 6 columns"),
        ({"imu": np.zeros((5, 6))}, r"expected an array imu .* got shape \(5, 6\)"),
        ({"ephs": np.zeros((32, 31))}, r"expected ephemerides of one week, got weeks \[\]"),
        ({"t0": np.array([[-1.0]])}, "expected t0 within a week"),
    ],
)
def test_malformed_files(mat, changes, message):
    with pytest.raises(FileFormatError, match=message):
        read_psins_ranges(mat(**changes))


def test_a_carrier_beyond_double_precision_is_a_damaged_number(mat):
    obss = arrays()["obss"]
    obss[0, 3] = 1e308
    with np.errstate(over="raise"):  # no warning of numpy's either
        read_psins_ranges(mat(obss=obss))
    with pytest.raises(FileFormatError, match=r"row 1 of observations .* carrier phase is inf cycles"):
        schuler.read(mat(obss=obss))


def test_a_damaged_file(tmp_path):
    path = tmp_path / "tc.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    with pytest.raises(FileFormatError, match="cannot be read as a MATLAB file"):
        read_psins_ranges(path)


@pytest.mark.realdata
def test_rates_and_carriers_of_the_real_file_have_the_right_sign(shared_data):
    """The range rate is the rate of pseudorange and of carrier, both in metres, on every satellite."""
    r = read_psins_ranges(shared_data / "psins_tc" / "insgpseo_tc.mat")
    assert (len(r.recording.imu), len(r.observations), len(r.ephemerides.kepler)) == (27_280, 10_584, 10)
    assert r.recording.imu.t[0] == 185_492.5
    assert r.recording.imu.rates().accel.mean(axis=0)[2] == pytest.approx(-9.8, abs=0.2)
    o, cycle = r.observations, SPEED_OF_LIGHT / 1575.42e6
    for sat in np.unique(o.sat):
        k = np.flatnonzero(o.sat == sat)
        whole = np.diff(o.t[k]) == 1.0
        mean_rate = 0.5 * (o.range_rate[k][1:] + o.range_rate[k][:-1])
        code = np.median((np.diff(o.pseudorange[k]) - mean_rate)[whole])
        phase = np.median((np.diff(o.carrier[k]) * cycle - mean_rate)[whole])
        # rates reach 700 m/s; a median over a thousand differences of centimetre noise. One satellite has 28 epochs
        limit = 0.02 if len(k) > 100 else 0.5
        assert abs(code) < limit
        assert abs(phase) < limit
    assert set(o.sat) <= set(r.ephemerides.kepler.sat)


@pytest.fixture(scope="module")
def lasergyro(shared_data):
    return read_psins_imu(shared_data / "psins_lasergyro" / "lasergyro.imu")


LLH = np.array([34.246048 * units.DEG, 108.909664 * units.DEG, 380.0])  # the header's


@pytest.mark.realdata
def test_earth_rate_of_a_laser_gyro(lasergyro):
    """15.04 deg/h within 1 %, once the slow tilt of the vehicle is taken off.

    The parked vehicle tilts by 0.2 deg in half an hour, which is 0.4 deg/h of a horizontal rate. Gravity in the first
    and last half minute says how far.
    """
    imu = lasergyro.imu.rates()
    assert len(imu) == 184_718
    n = 3000
    first, last = (f / np.linalg.norm(f) for f in (imu.accel[:n].mean(axis=0), imu.accel[-n:].mean(axis=0)))
    # u turns against the body: du = -phi x u, so the part of phi across u is du x u
    tilt_rate = np.cross(last - first, 0.5 * (first + last)) / (imu.t[-1] - imu.t[0] - n * 0.01)
    rate = imu.gyro.mean(axis=0)
    assert np.linalg.norm(rate - tilt_rate) == pytest.approx(earth.WGS84.omega_ie, rel=0.01)  # the issue's mark
    # specific force points up, Earth rate's part along it is omega sin(lat)
    up = imu.accel.mean(axis=0) / np.linalg.norm(imu.accel.mean(axis=0))
    assert rate @ up == pytest.approx(earth.WGS84.omega_ie * np.sin(LLH[0]), rel=0.01)


@pytest.mark.realdata
def test_the_heading_of_a_laser_gyro_is_the_same_from_both_halves(lasergyro):
    from schuler.filtering.states import layout_for
    from schuler.mechanization.alignment import gyrocompass
    from schuler.navigation.start.fine_alignment import fine_alignment
    from schuler.sensors.spec import ImuSpec, TriadSpec

    spec = ImuSpec(
        "laser gyro",
        TriadSpec.gyro(arw_deg_rthr=0.003, bias_deg_hr=0.01),
        TriadSpec.accelerometer(vrw_m_s_rthr=0.003, bias_ug=50.0),
    )
    increments, headings, sigma = lasergyro.imu.increments(), [], []
    for start, stop in ((0.0, 924.0), (924.0, 1847.0)):
        first = increments.between(start, start + 60.0)
        length = float(first.dt.sum())
        coarse = gyrocompass(
            first.dtheta_ib_b.sum(axis=0) / length, first.dv_ib_b.sum(axis=0) / length, float(LLH[0]),
            sigma_gyro_bias=spec.gyro.turn_on_bias, sigma_gyro_noise=3.0 * units.DEG_PER_HR,
            sigma_accel_bias=spec.accel.turn_on_bias,
        )  # fmt: skip
        initial, _ = fine_alignment(
            increments.between(start + 60.0, stop), LLH, coarse, spec, layout_for(spec, 15), sigma_velocity=0.01
        )
        headings.append(rotation.rpy_from_dcm(rotation.dcm_from_quat(initial.nav.q_nb))[2] / units.DEG)
        sigma.append(np.sqrt(initial.P[2, 2]) / units.DEG)
    # the header's -90.6 deg counts from north over west
    assert np.mean(headings) == pytest.approx(90.6, abs=0.1)
    # statistical: both have the bias of the day in common, so they agree better than the sigma of 0.055 deg
    assert abs(headings[0] - headings[1]) < 0.05
    assert max(sigma) < 0.07
