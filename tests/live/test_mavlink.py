"""GPS_INPUT and ODOMETRY of MAVLink: the published check value of the CRC, bytes of pymavlink, and pymavlink itself."""

import socket
from dataclasses import replace

import numpy as np
import pytest
from tests.live.test_outputs import WEEK, solution

from schuler import frames, rotation
from schuler.exceptions import InputError
from schuler.live import mavlink
from schuler.live.clock import SourceClock
from schuler.live.mavlink import MavlinkSink, crc
from schuler.timebase import TimeBase

#: What pymavlink 2.4.50 makes of the fields of ``GPS_INPUT`` below: system 3, component 220, sequence 7.
MADE_BY_PYMAVLINK = bytes.fromhex(
    "fd4100000703dce8000010880a7dd3100600fa709914c4d1af1ce4d4fafa75faed43000000000000000000004040000080c00000003fcacbd63d"
    "bd1b0f3f0000803f0600fc080003ff3e76df47"
)
ORIGIN = np.array([0.84 - 1e-6, -0.147, 523.0])


def test_crc_check_value():
    """The published check value of CRC-16/MCRF4XX, of the digits 1 to 9."""
    assert crc(b"123456789") == 0x6F91


def test_gps_input_has_the_bytes_of_pymavlink():
    payload = mavlink.gps_input(solution(), WEEK, 47.5)
    assert mavlink.frame(mavlink._GPS_INPUT, payload, 7, 3) == MADE_BY_PYMAVLINK


def test_pymavlink_reads_and_makes_the_same():
    common = pytest.importorskip("pymavlink.dialects.v20.common", reason="pymavlink is not installed")
    made = [
        mavlink.frame(mavlink._GPS_INPUT, mavlink.gps_input(solution(), WEEK, 47.5), 7, 3),
        mavlink.frame(mavlink._ODOMETRY, mavlink.odometry(solution(), WEEK, ORIGIN), 8, 3),
    ]
    reader, writer = common.MAVLink(None), common.MAVLink(None, srcSystem=3, srcComponent=220)
    fix, pose = (reader.parse_buffer(data)[0] for data in made)
    assert (fix.time_week, fix.time_week_ms, fix.fix_type, fix.ignore_flags) == (2300, 345_600_250, 3, 6)
    assert fix.lat == round(np.rad2deg(0.84) * 1e7)
    assert fix.alt == pytest.approx(523.4567 - 47.5, abs=1e-4)
    assert fix.yaw == round(np.rad2deg(-1.0) * 100) + 36_000
    assert (pose.frame_id, pose.child_frame_id) == (common.MAV_FRAME_LOCAL_NED, common.MAV_FRAME_BODY_FRD)
    for sequence, (message, data) in enumerate(zip((fix, pose), made, strict=True), 7):
        fields = {name: value for name, value in message.to_dict().items() if name != "mavpackettype"}
        writer.seq = sequence
        encode = getattr(writer, f"{message.get_type().lower()}_encode")
        assert bytes(encode(**fields).pack(writer)) == data


def test_odometry_is_the_solution():
    made = solution()
    values = mavlink._ODOMETRY[2].unpack(mavlink.odometry(made, WEEK, ORIGIN))
    r = frames.ned_from_ecef(frames.ecef_from_llh(made.llh[None]), ORIGIN)[0]
    np.testing.assert_allclose(values[1:4], r, atol=1e-6)  # float32
    q = rotation.quat_from_dcm(rotation.dcm_from_rpy(made.rpy_nb))
    np.testing.assert_allclose(np.abs(values[4:8]), np.abs(q), atol=2e-6)  # axes a metre away
    C_nb = rotation.dcm_from_rpy(made.rpy_nb)
    np.testing.assert_allclose(C_nb @ values[8:11], made.v_eb_n, atol=1e-6)
    pose, moves = np.array(values[14:35]), np.array(values[35:56])
    diagonal = np.flatnonzero(np.equal(*np.triu_indices(6)))
    np.testing.assert_allclose(pose[diagonal], np.append(made.sigma_r_n, made.sigma_psi_n) ** 2, rtol=1e-4)
    assert moves[diagonal[:3]].sum() == pytest.approx(np.sum(made.sigma_v_n**2), rel=1e-6)  # a trace
    assert np.isnan(values[11:14]).all()
    assert np.isnan(moves[diagonal[3:]]).all()


def test_a_failed_solution_is_no_fix():
    failed = solution(health="failed")
    assert mavlink._GPS_INPUT[2].unpack(mavlink.gps_input(failed, WEEK))[16] == 1
    assert mavlink._ODOMETRY[2].unpack(mavlink.odometry(failed, WEEK, ORIGIN))[-1] == -1


def test_weeks_are_carried_over_and_a_clock_of_its_own_has_none():
    late = mavlink._GPS_INPUT[2].unpack(mavlink.gps_input(solution(604_800.5), WEEK))
    assert (late[14], late[1]) == (2301, 500)
    local = mavlink._GPS_INPUT[2].unpack(mavlink.gps_input(solution(12.5), TimeBase("local")))
    assert (local[0], local[1], local[14]) == (12_500_000, 0, 0)
    north = replace(solution(), rpy_nb=np.zeros(3))
    assert mavlink._GPS_INPUT[2].unpack(mavlink.gps_input(north, WEEK))[-1] == 36_000  # zero is not known


def test_both_are_sent():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(10.0)
        clock = SourceClock(WEEK)
        sink = MavlinkSink(f"udp://:{listener.getsockname()[1]}?system=9", clock)
        sink.solution(solution())
        heads = [listener.recv(500)[:10] for _ in range(2)]
    for _ in range(3):
        sink.solution(solution())  # to nobody
    sink.close()
    assert [int.from_bytes(head[7:10], "little") for head in heads] == [232, 331]
    assert [(head[0], head[4], head[5]) for head in heads] == [(0xFD, 0, 9), (0xFD, 1, 9)]


@pytest.mark.parametrize("place", ["tcp://:14550", "udp://:14550?system=0", "udp://:14550?system=1.5"])
def test_places_that_are_none(place):
    with pytest.raises(InputError):
        MavlinkSink(place, SourceClock())
