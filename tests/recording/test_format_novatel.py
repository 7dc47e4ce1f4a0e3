"""NovAtel logs: an encoder of the test's own, NovAtel's decoder, lines printed in its manual, what is refused."""

import encode_novatel as nov
import numpy as np
import pytest
from format_drives import WEEK, drive, same_trajectory

from schuler import rotation, units
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats import registry
from schuler.recording.formats.novatel_frames import IMU_TYPES
from schuler.recording.io import read

EG320 = IMU_TYPES[41]
RFU_FROM_FRD = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
UNDULATION = -16.27
# printed in NovAtel's manual (RAWIMUSX and RAWIMUX: ASCII examples), with their CRC
MANUAL = (
    b"%RAWIMUSXA,2209,491674.014;04,41,2209,491674.013699,ea59fe00,329308016,-2706935,4508389,196192,417138,"
    b"-1000837*038422a7\r\n"
)
MANUAL_LONG = (
    b"#RAWIMUXA,USB1,0,64.5,FINESTEERING,2209,491740.110,02000020,0dc5,16809;04,41,2209,491740.109817,ea57fe00,"
    b"329394068,-2396829,4481425,321199,257329,-936077*cf9c035d\r\n"
)


def counts_of(run, kind=EG320):
    """Whole counts of a drive with increments, in the unit's axes. Shape (n, 6)."""
    accel = run.imu.accel @ RFU_FROM_FRD.T / kind.accel
    gyro = run.imu.gyro @ RFU_FROM_FRD.T / kind.gyro
    return np.round(np.concatenate((accel, gyro), axis=1)).astype(int).tolist()


def log_of(run, path, *, imu=True, fixes=True, ins=True, latency=0.0):
    """A drive as binary messages."""
    out = []
    if imu:
        out += [nov.rawimusx(WEEK, t, c) for t, c in zip(run.imu.t, counts_of(run), strict=True)]
    if fixes:
        g = run.gnss
        for k, t in enumerate(g.t):
            sigma = np.sqrt(np.diag(g.cov_r_n[k]))
            lat, lon, h = g.llh[k]
            v = g.v_n[k]
            out.append(nov.bestpos(WEEK, t, lat / units.DEG, lon / units.DEG, h - UNDULATION, UNDULATION, sigma))
            track = np.arctan2(v[1], v[0]) / units.DEG % 360.0
            out.append(nov.bestvel(WEEK, t, latency, np.hypot(v[0], v[1]), track, -v[2]))
    if ins:
        r = run.reference
        for t, llh, v, rpy in zip(r.t, r.llh, r.v_eb_n, r.rpy_nb, strict=True):
            degrees = (*(llh[:2] / units.DEG), llh[2])
            out.append(nov.inspvas(WEEK, t, degrees, (v[0], v[1], -v[2]), rpy / units.DEG % 360.0))
    path.write_bytes(b"".join(out))
    return path


@pytest.fixture(scope="module")
def run():
    return drive(rate=125.0, kind="increment")


def test_whole_log_comes_back(run, tmp_path):
    """IMU to half a count, positions to float64, sigma to float32, the reference to rounding."""
    back = read(log_of(run, tmp_path / "span.gps"))
    assert back.metadata.time.epoch_gps_s == WEEK * 604_800.0
    np.testing.assert_allclose(back.imu.t, run.imu.t, rtol=0.0, atol=1e-9)
    assert back.imu.kind == "increment"
    np.testing.assert_allclose(back.imu.accel, run.imu.accel, rtol=0.0, atol=0.5001 * EG320.accel)
    np.testing.assert_allclose(back.imu.gyro, run.imu.gyro, rtol=0.0, atol=0.5001 * EG320.gyro)
    np.testing.assert_allclose(back.gnss.t, run.gnss.t, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(back.gnss.llh[:, :2], run.gnss.llh[:, :2], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(
        back.gnss.llh[:, 2], run.gnss.llh[:, 2], rtol=0.0, atol=1e-6
    )  # the undulation is a float32
    np.testing.assert_allclose(back.gnss.v_n, run.gnss.v_n, rtol=0.0, atol=1e-12)
    variance = np.einsum("nii->ni", back.gnss.cov_r_n)
    np.testing.assert_allclose(variance, np.einsum("nii->ni", run.gnss.cov_r_n), rtol=3e-7)
    assert set(back.gnss.quality) == {1}
    assert set(back.gnss.n_satellites) == {18}
    same_trajectory(back.reference, run.reference, t=1e-9, r=1e-8, v=1e-12, q=1e-12)
    assert any("EPSON_G320" in note for note in back.metadata.notes)


def test_lines_of_the_manual(tmp_path):
    """The scale factors make gravity of the counts NovAtel printed, in both headers (sensor's tolerance)."""
    path = tmp_path / "manual.asc"
    rows = [nov.line(f"%RAWIMUSXA,2209,{491674.014 + k / 125:.3f};04,41,2209,{491674.013699 + k / 125:.6f},ea59fe00,"
                     "329308016,-2706935,4508389,196192,417138,-1000837") for k in range(1, 200)]  # fmt: skip
    path.write_bytes(MANUAL + b"".join(rows))
    imu = read(path).imu
    assert len(imu) == 200
    force = imu.rates().accel[0]
    assert np.linalg.norm(force) == pytest.approx(9.81, rel=0.01)
    # x of the unit is right, y forward, z up
    np.testing.assert_allclose(imu.accel[0], np.array((2706935, 4508389, -329308016)) * EG320.accel, rtol=1e-12)
    np.testing.assert_allclose(imu.gyro[0], np.array((-417138, -1000837, -196192)) * EG320.gyro, rtol=1e-12)
    path.write_bytes(MANUAL_LONG)
    assert registry.find(MANUAL_LONG, path).__name__.endswith("novatel")


def test_ascii_and_binary_agree(run, tmp_path):
    """The same fix as line and as frame."""
    path = tmp_path / "log.asc"
    text = (
        f"#BESTPOSA,COM1,0,90.5,FINESTEERING,{WEEK},403742.250,02000000,b1f6,32768;SOL_COMPUTED,NARROW_INT,"
        '51.15043874397,-114.03066788586,1097.6822,-17.0000,WGS84,0.5,0.25,0.125,"AB12",0.000,0.000,18,17,18,0,00,02,'
        "11,01"
    )
    path.write_bytes(b"<noise>\r\n" + nov.line(text))
    line = read(path).gnss
    path.write_bytes(
        nov.bestpos(WEEK, 403742.25, 51.15043874397, -114.03066788586, 1097.6822, -17.0, (0.5, 0.25, 0.125))
    )
    frame = read(path).gnss
    np.testing.assert_array_equal(line.llh, frame.llh)
    np.testing.assert_array_equal(line.cov_r_n, frame.cov_r_n)
    assert line.t[0] == frame.t[0] == 403742.25
    assert line.n_satellites[0] == 17
    assert line.quality[0] == 1
    assert frame.llh[0, 2] == pytest.approx(1080.6822, abs=1e-9)


def test_novatels_own_decoder_reads_the_encoder(run, tmp_path):
    """novatel_edie finds the same messages in what the encoder writes, so reader and encoder do not err together."""
    edie = pytest.importorskip("novatel_edie.oem")
    path = log_of(run, tmp_path / "span.gps")
    with path.open("ab") as stream:
        stream.write(nov.inspvax(WEEK, 345700.0, (48.0, 8.4, 300.0), 47.5, (1.0, 2.0, 3.0), (1.5, 2.5, 30.0),
                                 np.arange(1.0, 10.0)))  # fmt: skip
        stream.write(nov.heading2(WEEK, 345700.0, 77.0, 0.25))
    seen = {}
    for message in edie.FileParser(str(path)):
        seen.setdefault(getattr(message, "name", "?"), []).append(message)
    counts = {name: len(messages) for name, messages in seen.items()}
    assert counts["RAWIMUSX"] == len(run.imu)
    assert counts["BESTPOS"] == counts["BESTVEL"] == len(run.gnss)
    assert counts["INSPVAS"] == len(run.reference)
    assert counts["INSPVAX"] == counts["HEADING2"] == 1
    back = read(path, streams="reference=INSPVAS")
    fix = seen["BESTPOS"][3]
    assert fix.latitude * units.DEG == pytest.approx(back.gnss.llh[3, 0], abs=1e-15)
    assert fix.orthometric_height + fix.undulation == pytest.approx(back.gnss.llh[3, 2], abs=1e-9)
    raw = seen["RAWIMUSX"][700]
    # forward is y (sent as -y), right x, down -z
    np.testing.assert_allclose(
        np.array((-raw.accel_y, raw.accel_x, -raw.accel_z)) * EG320.accel, back.imu.accel[700], rtol=1e-12
    )
    pva = seen["INSPVAX"][0]
    assert (pva.azimuth, pva.roll_std_dev, pva.latitude_std_dev) == (30.0, 7.0, 1.0)
    assert seen["HEADING2"][0].heading_std_dev == 0.25


def test_velocity_latency_is_taken_off(run, tmp_path):
    """Velocities marked a quarter second late are those of the drive a quarter second before: interpolated back."""
    t = np.arange(100.0, 110.0)
    out = b"".join(
        nov.bestpos(WEEK, s, 48.0, 8.0, 400.0, 47.0, (0.1, 0.1, 0.2))
        + nov.bestvel(WEEK, s, 0.25, 2.0 * (s - 0.25), 0.0, 0.0) for s in t
    )  # fmt: skip
    (tmp_path / "v.gps").write_bytes(out)
    gnss = read(tmp_path / "v.gps").gnss
    np.testing.assert_allclose(gnss.v_n[:-1, 0], 2.0 * t[:-1], atol=1e-9)
    assert gnss.v_n[-1, 0] == pytest.approx(2.0 * (t[-1] - 0.25))  # nothing is extrapolated


def test_inspvax_heights_and_heading(tmp_path):
    sigma = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.01, 0.02, 0.05)
    out = b"".join(
        nov.inspvax(WEEK, s, (48.0, 8.0, 400.0), 47.5, (1.0, 2.0, 3.0), (1.0, -2.0, 350.0), sigma)
        + nov.heading2(WEEK, s, 350.0, 0.5) for s in (10.0, 10.5)
    )  # fmt: skip
    (tmp_path / "x.gps").write_bytes(out)
    back = read(tmp_path / "x.gps", streams="heading=HEADING2")
    np.testing.assert_allclose(back.reference.llh[0] / (units.DEG, units.DEG, 1.0), (48.0, 8.0, 400.0), atol=1e-9)
    np.testing.assert_allclose(back.reference.v_eb_n[0], (1.0, 2.0, -3.0), atol=1e-12)
    np.testing.assert_allclose(back.reference.rpy_nb[0] / units.DEG, (1.0, -2.0, -10.0), atol=1e-9)
    assert np.degrees(back.heading.value[0]) == pytest.approx(350.0)
    assert any("0.05 deg" in note for note in back.metadata.notes)
    assert read(tmp_path / "x.gps").heading is None


def test_attitude_order_is_that_of_aircraft():
    """SPAN turns about z, then x (right), then y (forward) of axes RFU; that is yaw, pitch, roll in FRD."""
    roll, pitch, azimuth = 0.3, -0.4, 1.1

    def turn(axis, angle):
        return rotation.dcm_from_quat(rotation.quat_from_rotvec(np.eye(3)[axis] * angle))

    R = turn(2, -azimuth) @ turn(0, pitch) @ turn(1, roll)  # body RFU to east-north-up
    swap = RFU_FROM_FRD  # its own inverse, and NED from ENU
    np.testing.assert_allclose(swap @ R @ swap, rotation.dcm_from_rpy(np.array((roll, pitch, azimuth))), atol=1e-14)


def test_positions_of_the_inertial_solution_are_left_out(tmp_path):
    fix = (8.0, 400.0, 47.0, (0.1, 0.1, 0.2))
    out = [nov.bestpos(WEEK, 10.0 + k, 48.0, *fix, kind=56 if k % 2 else 50) for k in range(6)]
    path = tmp_path / "fused.gps"
    path.write_bytes(b"".join(out))
    back = read(path)
    assert len(back.gnss) == 3
    assert any("BESTGNSSPOS" in note for note in back.metadata.notes)
    assert len(read(path, streams="gnss=BESTPOS").gnss) == 6
    out += [nov.bestpos(WEEK, 10.0 + k, 48.1, *fix, number=1429) for k in range(6)]
    path.write_bytes(b"".join(out))
    back = read(path)
    assert len(back.gnss) == 6
    assert back.gnss.llh[0, 0] == pytest.approx(48.1 * units.DEG)


def test_second_antenna_and_answers_are_not_taken(tmp_path):
    """Messages of another antenna and answers to commands have the same number as those of the first."""
    path = tmp_path / "two.gps"
    fix = (8.0, 400.0, 47.0, (0.1, 0.1, 0.2))
    path.write_bytes(
        nov.bestpos(WEEK, 10.0, 49.0, *fix, source=1)
        + nov.bestpos(WEEK, 10.0, 48.0, *fix)
        + nov.bestpos(WEEK, 11.0, 49.0, *fix, source=0x80)
        + nov.bestpos(WEEK, 11.0, 48.0, *fix)
    )
    np.testing.assert_allclose(read(path).gnss.llh[:, 0], 48.0 * units.DEG, rtol=1e-15)


PRINTED = {  # one count, m/s and rad, in decimals from the manual's table of raw scale factors (OEM7, RAWIMUSX)
    "HG1700_AG58": (2.27093e-9, 1.16415e-10), "HG1700_AG62": (4.54187e-9, 1.16415e-10),
    "HG1900_CA50": (2.27093e-9, 1.16415e-10), "HG1930_CA50": (2.27093e-9, 1.16415e-10),
    "HG4930_AN01": (1.86265e-9, 1.16415e-10), "HG4930_AN04": (1.86265e-9, 1.16415e-10),
    "LN200": (6.10352e-5, 1.90735e-6), "ISA100C": (2e-8, 1e-9), "LITEF_MICROIMU": (2e-8, 1e-9),
    "IMAR_FSAS": (1.52588e-6, 1.89379e-9), "KVH_1750": (1.52588e-6, 1.08507e-7),
    "ADIS16488": (9.31323e-8, 5.85167e-9), "STIM300": (2.38419e-7, 8.32236e-9),
}  # fmt: skip


def test_one_count_is_what_the_manual_prints():
    """Six printed digits."""
    kinds = {kind.name: kind for kind in IMU_TYPES.values()}
    for name, one in PRINTED.items():
        assert (kinds[name].accel, kinds[name].gyro) == pytest.approx(one, rel=5e-6), name


def test_week_rollover(run, tmp_path):
    """Samples go on over the end of a week."""
    counts = counts_of(run)[:200]
    out = []
    for k, c in enumerate(counts):
        total = 604_799.0 + k / 100.0
        out.append(nov.rawimusx(WEEK + int(total >= 604_800.0), total % 604_800.0, c, imu=58))
    (tmp_path / "roll.gps").write_bytes(b"".join(out))
    imu = read(tmp_path / "roll.gps", allow="norm").imu
    np.testing.assert_allclose(np.diff(imu.t), 0.01, rtol=0.0, atol=1e-9)
    assert imu.t[0] == 604_799.0


def test_scale_is_never_guessed(run, tmp_path):
    path = tmp_path / "raw.gps"
    path.write_bytes(b"".join(nov.rawimu(WEEK, t, c) for t, c in zip(run.imu.t, counts_of(run), strict=True)))
    with pytest.raises(FileFormatError, match="does not say which IMU"):
        read(path)
    with pytest.raises(InputError, match="no IMU whose counts are known"):
        read(path, scale="MPU6050")
    stated = read(path, scale=f"accel={EG320.accel!r},gyro={EG320.gyro!r}").imu
    np.testing.assert_allclose(stated.accel, run.imu.accel, atol=0.5001 * EG320.accel)
    # every third sample: increments are missing
    path.write_bytes(b"".join(nov.rawimu(WEEK, t, c) for t, c in zip(run.imu.t[::3], counts_of(run)[::3], strict=True)))
    with pytest.raises(FileFormatError, match="not logged"):
        read(path, scale="EPSON_G320")
    config = nov.line(f"#INSCONFIGA,COM1,0,50,FINESTEERING,{WEEK},345600.000,0,0,1;EPSON_G320,5,50,20,LAND")
    path.write_bytes(path.read_bytes() + config)
    with pytest.raises(FileFormatError, match="EPSON_G320 makes one each"):
        read(path)
    path.write_bytes(nov.rawimusx(WEEK, 10.0, [0] * 6, imu=77))
    with pytest.raises(FileFormatError, match="type 77"):
        read(path)


def test_corrected_imu_is_refused(tmp_path):
    import struct

    body = struct.pack("<Idddddddd", WEEK, 10.0, 0, 0, 0, 0, 0, 0, 0)[:60]
    (tmp_path / "c.gps").write_bytes(nov.short_frame(813, WEEK, 10_000, body))
    with pytest.raises(FileFormatError, match="no gravity"):
        read(tmp_path / "c.gps")


def test_hints_and_streams(run, tmp_path):
    path = log_of(run, tmp_path / "span.gps")
    with pytest.raises(InputError, match="leave out"):
        read(path, units="g,deg/s")
    with pytest.raises(InputError, match="is not in the log"):
        read(path, streams="gnss=PSRPOS")
    names = {s.name: s for s in registry.module("novatel").contents(path)}
    assert names["RAWIMUSX"].part == "imu"
    assert names["RAWIMUSX"].rate_hz == pytest.approx(125.0)
    assert names["BESTVEL"].part == ""
    assert names["INSPVAS"].part == "reference"
    assert read(path, series="reference").imu is None


def test_damage(run, tmp_path):
    """A cut or changed byte costs the message it is in, and is counted."""
    path = log_of(run, tmp_path / "span.gps", ins=False)
    good = path.read_bytes()
    data = bytearray(good)
    data[60 * 100 + 30] ^= 4
    path.write_bytes(bytes(data[:-7]))
    back = read(path)
    assert len(back.imu) == len(run.imu) - 1
    assert any("1 messages with a wrong CRC" in n for n in back.metadata.notes)
    assert any("cut off" in n for n in back.metadata.notes)
    head = good[:40]
    path.write_bytes(head)
    with pytest.raises(FileFormatError):
        read(path, format="novatel")
