"""MAVLink as it comes: bytes that pymavlink made, in pieces of any length, with garbage and other messages between."""

import struct

import numpy as np
import pytest
from tests.live.test_decoders import GARBAGE, fed

from schuler import units
from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.decoders import mavlink
from schuler.live.decoders.detection import decoder
from schuler.live.mavlink import crc
from schuler.live.messages import Fix, ImuBlock
from schuler.recording.io import ReadHints

#: Made by pymavlink 2.4.50: HEARTBEAT, HIGHRES_IMU, SCALED_IMU, RAW_IMU, GPS_RAW_INT with the values below.
BYTES = {
    2: (
        "fd090000290101000000000000000203510403328b",
        "fd3e00002a01016900004e61bc00000000000000003f000080be00001cc10000803c000000bd0000803dcdcccc3dcdcc4c3e9a99993e0000"
        "7a44000000000000c84200001242ff1f222d",
        "fd1800002b01011a00003a3000003300e7ff1efc1000e1ff3f00010002000300420e071d",
        "fd1d00002c01011b00007866bc00000000003300e7ff1efc1000e1ff3f0001000200030000420e64c4",
        "fd2b00002d0101180000e0aebb0000000000901fb11c90cb19f96290080050007800e20478690611ee49090084030000dc05000096918d",
    ),
    1: (
        "fe09290101000000000002035104034be9",
        "fe3e2a0101694e61bc00000000000000003f000080be00001cc10000803c000000bd0000803dcdcccc3dcdcc4c3e9a99993e00007a440000"
        "00000000c84200001242ff1f227b",
        "fe162b01011a3a3000003300e7ff1efc1000e1ff3f00010002000300aed1",
        "fe1a2c01011b7866bc00000000003300e7ff1efc1000e1ff3f000100020003009af0",
        "fe1e2d010118e0aebb0000000000901fb11c90cb19f96290080050007800e204786906111ff3",
    ),
}
HIGHRES = (0.5, -0.25, -9.75), (0.015625, -0.03125, 0.0625)
SCALED = np.array([51, -25, -994]) * 1e-3 * units.G0, np.array([16, -31, 63]) * 1e-3


def frames(version=2):
    return [bytes.fromhex(text) for text in BYTES[version]]


def frame(identifier, payload, *, signed=False):
    """A message of version 2, with its zeros at the end."""
    head = bytes([len(payload), 1 if signed else 0, 0, 7, 1, 1]) + identifier.to_bytes(3, "little")
    check = crc(head + payload + bytes([mavlink._MESSAGES[identifier][0]]))
    return b"\xfd" + head + payload + check.to_bytes(2, "little") + (bytes(13) if signed else b"")


def highres(us, flags=0x3F):
    return frame(105, struct.pack("<Q13fH", us, *HIGHRES[0], *HIGHRES[1], *[0.0] * 6, 20.0, flags))


def gps(us, kind=3, accuracy=(900, 1500, 150), ellipsoidal=608_750):
    where = 481_370_000, -115_750_000, 561_250
    return frame(
        24, struct.pack("<Q3i4H2Bi4IH", us, *where, 80, 120, 1250, 27_000, kind, 17, ellipsoidal, *accuracy, 0, 0)
    )


def stream(hints=None, clock=None):
    return decoder(clock or SourceClock(), hints or ReadHints(), format="mavlink")


def rows(messages):
    blocks = [m for m in messages if isinstance(m, ImuBlock)]
    return np.vstack([np.column_stack((b.t, b.gyro, b.accel)) for b in blocks])


@pytest.mark.parametrize("version", [1, 2])
def test_messages_of_pymavlink(version):
    block, fix = None, None
    for message in fed(stream(ReadHints.of(sigma="2,2,2")), b"".join(frames(version))):
        block, fix = (message, fix) if isinstance(message, ImuBlock) else (block, message)
    assert (block.t[0], len(block.t)) == (12.345678, 1)  # SCALED_IMU and RAW_IMU are other kinds
    np.testing.assert_array_equal((block.accel[0], block.gyro[0]), HIGHRES)
    np.testing.assert_array_equal(block.temperature, [36.5])
    assert (fix.t, fix.quality, fix.n_satellites) == (12.3, 1, 17)
    np.testing.assert_allclose(fix.llh[:2], np.deg2rad([48.137, -11.575]), rtol=1e-15)
    if version == 2:  # the extensions
        assert fix.llh[2] == 608.75
        np.testing.assert_allclose(np.diag(fix.cov_r_n), [0.9**2, 0.9**2, 1.5**2], rtol=1e-14)
        np.testing.assert_allclose(fix.v_n, [0.0, -12.5, 0.0], atol=1e-14)  # course 270 deg
        np.testing.assert_allclose(np.diag(fix.cov_v_n), [0.15**2, 0.15**2, 100.0], rtol=1e-12)
    else:
        assert fix.llh[2] == 561.25
        np.testing.assert_array_equal(np.diag(fix.cov_r_n), [4.0] * 3)
        assert fix.v_n is None


@pytest.mark.parametrize(("name", "t"), [("scaled", 12.346), ("raw", 12.347)])
@pytest.mark.parametrize("version", [1, 2])
def test_the_imu_that_is_asked_for(name, t, version):
    made = stream(ReadHints.of(streams=f"imu={name}", sigma="2,2,2"))
    (block,) = (m for m in fed(made, b"".join(frames(version))) if isinstance(m, ImuBlock))
    np.testing.assert_allclose(block.t, [t], rtol=1e-15)
    np.testing.assert_allclose((block.accel[0], block.gyro[0]), SCALED, rtol=1e-15)
    assert (block.temperature is None) == (version == 1)
    assert version == 1 or block.temperature[0] == 36.5


def test_without_an_imu_or_by_what_comes_first():
    none = stream(ReadHints.of(streams="imu=none"))
    assert none.kind is None
    assert [type(m) for m in fed(none, b"".join(frames()))] == [Fix]
    heartbeat, _, scaled, raw, _ = frames()
    by_raw = stream()
    assert fed(by_raw, heartbeat + raw) == []
    assert any("imu=raw" in phrase for phrase in by_raw.left_out)
    by_scaled = stream()
    assert rows(fed(by_scaled, raw + scaled + highres(12_400_000) + heartbeat))[:, 0].tolist() == [12.346]
    assert by_scaled.left_out["messages: the IMU is taken from another kind"] == 1


@pytest.mark.parametrize("seed", range(4))
def test_pieces_of_any_length_with_damage_between(seed):
    heartbeat = frames()[0]
    parts = []
    for k in range(60):
        us = 1_000_000 + 10_000 * k
        parts += [heartbeat, highres(us)] if k % 3 else [highres(us), b"\xfd\x05\x00", gps(us - 3_000)]
    whole = b"".join(parts)
    damaged = GARBAGE + whole[:1500] + b"\xfe\xff" + whole[1500:] + whole[:40]
    at_once = stream()
    expected = at_once.feed(damaged, 0.0) + at_once.finish()
    made = fed(stream(), damaged, seed, 90)
    np.testing.assert_array_equal(rows(made), rows(expected))
    assert len(rows(made)) == 59  # one is damaged in its middle
    times = [m.t for m in made if isinstance(m, Fix)]
    assert times == [m.t for m in expected if isinstance(m, Fix)]
    assert len(times) == 20
    assert at_once.left_out["bytes that belong to no message with a right checksum"] > len(GARBAGE)


def test_signed_messages_and_a_wrong_checksum():
    payload = struct.pack("<Q13fH", 5_000_000, *HIGHRES[0], *HIGHRES[1], *[0.0] * 7, 0x3F)
    good, wrong = frame(105, payload, signed=True), bytearray(highres(6_000_000))
    wrong[20] ^= 1
    made = fed(stream(), good + bytes(wrong) + highres(7_000_000))
    assert rows(made)[:, 0].tolist() == [5.0, 7.0]


def test_format_is_told_by_what_comes():
    made = fed(decoder(SourceClock(), ReadHints()), b"\x01\x02" + b"".join(frames()) * 2)
    assert {type(m) for m in made} == {ImuBlock, Fix}
    assert not mavlink.looks_like(GARBAGE)


def test_unix_stamps_are_gps_time():
    clock = SourceClock()
    made = fed(stream(clock=clock), highres(1_700_000_000_250_000) + gps(1_700_000_000_100_000))
    assert clock.base.scale == "gps"
    unix_minus_gps = 315_964_800 - 18
    for message, rest in zip(made, (0.1, 0.25), strict=True):
        t = message.t if isinstance(message, Fix) else message.t[0]
        assert clock.base.epoch_gps_s + t == pytest.approx(1_700_000_000 - unix_minus_gps + rest, abs=1e-6)
    mixed = stream()  # stamps since boot beside them are of another clock
    assert len(fed(mixed, highres(1_700_000_000_250_000) + gps(9_000_000))) == 1
    assert any("clock of its own" in phrase for phrase in mixed.left_out)


def test_what_is_left_out_is_counted():
    made = stream()
    data = gps(1_000_000, kind=1) + gps(1_200_000) + gps(1_200_000) + highres(1_300_000, flags=0x07)
    data += gps(1_400_000, accuracy=(0, 0, 0))
    assert [m.t for m in fed(made, data)] == [1.2]
    assert made.left_out["epochs without a fix"] == 1
    assert made.left_out["messages repeated"] == 1
    assert made.left_out["HIGHRES_IMU without new rates and forces"] == 1
    assert any("sigma" in phrase for phrase in made.left_out)  # no accuracy, none given


def test_heights_above_sea_level_by_hints():
    hints = ReadHints.of(sigma="2,2,2", height="msl", geoid_separation=47.5)
    (fix,) = fed(stream(hints), frames(1)[4])
    assert fix.llh[2] == pytest.approx(561.25 + 47.5, abs=1e-9)


@pytest.mark.parametrize(
    ("hints", "text"), [({"streams": "imu=fast"}, "one of highres, scaled, raw"), ({"time": "unix"}, "since boot")]
)
def test_hints_that_mean_nothing_are_refused(hints, text):
    with pytest.raises(InputError, match=text):
        stream(ReadHints.of(**hints))
