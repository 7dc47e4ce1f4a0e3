"""Septentrio logs: an encoder of the test's own, pysbf2, what is refused."""

import encode_sbf as sbf
import numpy as np
import pytest
from format_drives import WEEK, drive, same_trajectory

from schuler import units
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats import registry
from schuler.recording.io import read

FLU = np.array((1.0, -1.0, -1.0))


@pytest.fixture(scope="module")
def run():
    """A drive whose stamps are whole milliseconds."""
    return drive(rate=50.0)


def ms(t):
    return round(t * 1000)


def log_of(run, path, *, covariances=True, imu=True, ins=True):
    out = []
    if imu:
        out += [
            sbf.imu(WEEK, ms(t), f * FLU, w * FLU / units.DEG)
            for t, f, w in zip(run.imu.t, run.imu.accel, run.imu.gyro, strict=True)
        ]
    g = run.gnss
    for k, t in enumerate(g.t):
        v = g.v_n[k] * (1, 1, -1)
        out.append(sbf.pvt(WEEK, ms(t), g.llh[k], v))
        if covariances:
            for number, C in ((5906, g.cov_r_n[k]), (5908, g.cov_v_n[k])):
                out.append(sbf.covariance(number, WEEK, ms(t), C[0, 0], C[1, 1], C[2, 2], C[0, 1], -C[0, 2], -C[1, 2]))
    if ins:
        r = run.reference
        for k in range(0, len(r), 5):
            v = r.v_eb_n[k]
            roll, pitch, yaw = r.rpy_nb[k] / units.DEG
            out.append(sbf.ins(WEEK, ms(r.t[k]), r.llh[k], (yaw % 360.0, pitch, roll), (v[1], v[0], -v[2])))
    path.write_bytes(b"".join(out))
    return path


def test_whole_log_comes_back(run, tmp_path):
    """Positions and IMU to float64, velocities, attitudes and covariances to float32 (6e-8 of their size)."""
    back = read(log_of(run, tmp_path / "log.sbf"))
    assert back.metadata.time.epoch_gps_s == WEEK * 604_800.0
    np.testing.assert_allclose(back.imu.t, run.imu.t, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(back.imu.accel, run.imu.accel, rtol=1e-14)
    np.testing.assert_allclose(back.imu.gyro, run.imu.gyro, rtol=1e-12, atol=1e-18)
    np.testing.assert_allclose(back.gnss.llh, run.gnss.llh, rtol=1e-15)
    np.testing.assert_allclose(back.gnss.cov_r_n, run.gnss.cov_r_n, rtol=3e-7, atol=1e-8)
    np.testing.assert_allclose(back.gnss.v_n, run.gnss.v_n, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(back.gnss.cov_v_n, run.gnss.cov_v_n, rtol=3e-7, atol=1e-9)
    assert set(back.gnss.quality) == {1}
    assert set(back.gnss.n_satellites) == {17}
    every = type(run.reference)(*(getattr(run.reference, n)[::5] for n in ("t", "r_eb_e", "v_eb_e", "q_eb")))
    same_trajectory(back.reference, every, t=1e-9, r=1e-8, v=1e-6, q=1e-6)


def test_pysbf2_reads_the_encoder(run, tmp_path):
    """An independent decoder finds the same numbers, so reader and encoder do not err together."""
    pysbf2 = pytest.importorskip("pysbf2")
    path = log_of(run, tmp_path / "log.sbf", imu=False, ins=False)
    with path.open("ab") as stream:
        stream.write(sbf.attitude(WEEK, ms(run.gnss.t[-1]), 77.5, 1.5, 0.0))
        stream.write(sbf.attitude_covariance(WEEK, ms(run.gnss.t[-1]), 0.25))
        stream.write(sbf.dilution(WEEK, ms(run.gnss.t[-1]), 85, 143))
    with path.open("rb") as stream:
        seen = {}
        for _, message in pysbf2.SBFReader(stream):
            seen.setdefault(message.identity, []).append(message)
    back = read(path)
    fix, cov, moved = seen["PVTGeodetic"][3], seen["PosCovGeodetic"][3], seen["VelCovGeodetic"][3]
    assert (fix.Latitude, fix.Longitude, fix.Height) == tuple(back.gnss.llh[3])
    assert (fix.Vn, fix.Ve, -fix.Vu) == pytest.approx(tuple(back.gnss.v_n[3]))
    assert fix.NrSV == 17
    C = back.gnss.cov_r_n[3]
    values = (cov.Cov_latlat, cov.Cov_lonlon, cov.Cov_hgthgt, cov.Cov_latlon, -cov.Cov_lathgt, -cov.Cov_lonhgt)
    assert values == pytest.approx((C[0, 0], C[1, 1], C[2, 2], C[0, 1], C[0, 2], C[1, 2]), rel=1e-6)
    assert moved.Cov_VnVn == pytest.approx(back.gnss.cov_v_n[3, 0, 0], rel=1e-6)
    attitude = seen["AttEuler"][0]
    assert attitude.Heading * units.DEG == pytest.approx(back.heading.value[0])
    dilution = seen["DOP"][0]
    np.testing.assert_allclose(back.gnss.dop[-1], (dilution.HDOP, dilution.VDOP), rtol=1e-15)  # rounding
    assert seen["AttCovEuler"][0].Cov_HeadHead == pytest.approx(0.25)
    assert back.heading.sigma[0] == pytest.approx(0.5 * units.DEG)


def test_dilutions_go_to_the_fix_of_their_time(tmp_path):
    """Hundredths; 0 is none, as is a fix without a block of its time, and a block without a fix is of no use."""
    fixes = [sbf.pvt(WEEK, 1000 * k, (0.84, 0.15, 400.0), (1, 2, 3), accuracy=(200, 400)) for k in range(1, 5)]
    blocks = [sbf.dilution(WEEK, *row) for row in ((3000, 0, 180), (1000, 85, 143), (9000, 1, 1), (4000, 92, 0))]
    (tmp_path / "a.sbf").write_bytes(b"".join(fixes + blocks))
    nan = np.nan
    expected = [[0.85, 1.43], [nan, nan], [nan, 1.8], [0.92, nan]]
    np.testing.assert_allclose(read(tmp_path / "a.sbf").gnss.dop, expected, rtol=1e-15)  # rounding
    (tmp_path / "b.sbf").write_bytes(b"".join(fixes))
    assert read(tmp_path / "b.sbf").gnss.dop is None


def test_accuracy_without_covariances(tmp_path):
    """HAccuracy is twice the radial error, VAccuracy twice the vertical one."""
    path = tmp_path / "a.sbf"
    llh = (0.84, 0.15, 400.0)
    path.write_bytes(
        sbf.pvt(WEEK, 1000, llh, (1, 2, 3), accuracy=(200, 400))
        + sbf.pvt(WEEK, 2000, llh, (1, 2, 3), accuracy=(65535, 1))
        + sbf.pvt(WEEK, 3000, llh, (-2e10,) * 3, mode=0x81, accuracy=(200, 400))
        + sbf.pvt(WEEK, 4000, llh, (0, 0, 0), mode=0)
    )  # fmt: skip
    back = read(path)
    np.testing.assert_allclose(back.gnss.t, (1.0, 3.0), rtol=0.0, atol=1e-9)
    sigma = np.sqrt(np.einsum("nii->ni", back.gnss.cov_r_n))
    np.testing.assert_allclose(sigma, ((np.sqrt(0.5), np.sqrt(0.5), 2.0), (np.sqrt(0.5), np.sqrt(0.5), 100.0)))
    np.testing.assert_array_equal(back.gnss.v_n, ((1, 2, -3), (0, 0, 0)))
    assert back.gnss.cov_v_n[1, 0, 0] == 1e6
    assert list(back.gnss.quality) == [1, 5]
    notes = " ".join(back.metadata.notes)
    assert "two-dimensional" in notes
    assert "without an accuracy" in notes
    path.write_bytes(sbf.pvt(WEEK, 1000, llh, (1, 2, 3)))
    with pytest.raises(FileFormatError, match="PosCovGeodetic"):
        read(path)
    assert read(path, sigma="1,1,2,0.2,0.2,0.3").gnss.cov_v_n[0, 2, 2] == pytest.approx(0.09)


def test_sensor_sets(tmp_path):
    """Sub-blocks longer than today's, two sensors, samples without a rate, and those not to be used."""
    path = tmp_path / "imu.sbf"
    out = [sbf.imu(WEEK, 10 * k, (0.1, 0.2, 9.81), (1.0, 2.0, 3.0), size=32) for k in range(200)]
    out.append(sbf.imu(WEEK, 2000, (0.1, 0.2, 9.81), None))
    out.append(sbf.imu(WEEK, 2010, (-2e10, 0.2, 9.81), (1.0, 2.0, 3.0)))
    out += [sbf.imu(WEEK, 10 * k, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), source=2) for k in range(200)]
    path.write_bytes(b"".join(out))
    back = read(path)
    assert len(back.imu) == 200
    np.testing.assert_allclose(back.imu.accel[0], (0.1, -0.2, -9.81))
    np.testing.assert_allclose(back.imu.gyro[0], np.array((1.0, -2.0, -3.0)) * units.DEG)
    notes = " ".join(back.metadata.notes)
    assert "2 sensors" in notes
    assert "turned from FLU" in notes
    np.testing.assert_allclose(read(path, axes="FRD", allow="norm").imu.accel[0], (0.1, 0.2, 9.81))


def test_parts_of_the_inertial_solution(tmp_path):
    """Attitude and velocity are found behind whatever parts come before them; blocks without them are left out."""
    path = tmp_path / "ins.sbf"
    lists = (0b11111, 0b01010, 0b01011, 0b00010, 0b11000)
    path.write_bytes(b"".join(
        sbf.ins(WEEK, 1000 * k, (0.84, 0.15, 400.0), (90.0, 2.0, 1.0), (1.0, 2.0, 3.0), parts)
        for k, parts in enumerate(lists)
    ))  # fmt: skip
    back = read(path).reference
    np.testing.assert_allclose(back.t, (0.0, 1.0, 2.0), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(back.rpy_nb / units.DEG, [(1.0, 2.0, 90.0)] * 3, atol=1e-9)
    np.testing.assert_allclose(back.v_eb_n, [(2.0, 1.0, -3.0)] * 3, atol=1e-12)


def test_heading_without_accuracy(tmp_path):
    path = tmp_path / "h.sbf"
    path.write_bytes(
        sbf.pvt(WEEK, 1000, (0.84, 0.15, 400.0), (0, 0, 0), accuracy=(2, 2))
        + sbf.attitude(WEEK, 1000, 370.0 - 360.0, 0, 0) + sbf.attitude(WEEK, 2000, 11.0, 0, 0, mode=0)
    )  # fmt: skip
    assert read(path).heading is None
    heading = read(path, sigma_heading_deg=0.5).heading
    np.testing.assert_allclose(heading.value / units.DEG, [10.0])


def test_streams_hints_and_damage(run, tmp_path):
    path = log_of(run, tmp_path / "log.sbf")
    names = {s.name: s for s in registry.module("sbf").contents(path)}
    assert names["ExtSensorMeas"].rate_hz == pytest.approx(50.0)
    assert names["PVTGeodetic"].part == "gnss"
    assert read(path, streams="imu=none").imu is None
    with pytest.raises(InputError, match="leave out"):
        read(path, columns="t,ax,ay,az,gx,gy,gz", format="sbf")
    data = bytearray(path.read_bytes())
    data[240] ^= 1
    path.write_bytes(bytes(data[:-5]))
    back = read(path)
    assert len(back.imu) == len(run.imu) - 1
    notes = " ".join(back.metadata.notes)
    assert "1 blocks with a wrong CRC" in notes
    assert "cut off" in notes
    path.write_bytes(sbf.block(5914, WEEK, 1000, bytes(8)))
    with pytest.raises(FileFormatError, match="block 5914"):
        read(path)
