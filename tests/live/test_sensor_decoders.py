"""SBG units and Xsens sensors as they come: samples and fixes of the file's reader, on a clock that UTC relates."""

import struct

import encode_sbg
import encode_xsens
import numpy as np
import pytest
from format_drives import WEEK, drive
from tests.live.test_decoders import GARBAGE, fed, same_fixes, same_samples
from tests.recording import test_format_sbg, test_format_xsens

from schuler import read
from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.decoders.detection import decoder
from schuler.live.decoders.sensor_clock import SensorClock
from schuler.live.messages import Fix, ImuBlock
from schuler.recording.io import ReadHints
from schuler.timebase import WEEK_S

ROUNDING_S = 1e-9  # of seconds of a week in float64, added in another order


@pytest.fixture(scope="module")
def run():
    return drive(12.0, 50.0)


def log_of(name, run, path, **options):
    module = {"sbg": test_format_sbg, "xsens": test_format_xsens}[name]
    return module.log_of(run, path, **options)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["sbg", "xsens"])
@pytest.mark.parametrize("options", [{}, {"axes": "FRD", "offset": 0.25}])
def test_on_its_own_clock_a_stream_is_the_file_to_the_last_bit(run, tmp_path, name, options, seed):
    """Over the end of the counter (71.6 minutes of SBG, five days of Xsens), with damage in between."""
    start = {"sbg": 4290.0, "xsens": 2.0**32 * 1e-4 - 5.0}[name]
    data = log_of(name, run, tmp_path / "log.bin", start=start).read_bytes()
    data = GARBAGE + data[:5000] + b"\xff\x5a\xfa\xff" + data[5000:]
    (tmp_path / "log.bin").write_bytes(data)
    hints = ReadHints.of(time="local", streams="imu=rates" if name == "xsens" else None, **options)
    log = read(tmp_path / "log.bin", hints, allow="norm")
    clock = SourceClock()
    stream = decoder(clock, hints, format=name)
    messages = fed(stream, data, seed, 2000)
    assert clock.base == log.metadata.time
    same_samples([m for m in messages if isinstance(m, ImuBlock)], log.imu)
    fixes = [m for m in messages if isinstance(m, Fix)]
    if name == "sbg":
        same_fixes(fixes, log.gnss)
    else:  # GPS time cannot be related to the samples
        assert log.gnss is None
        assert fixes == []
        assert stream.left_out["fixes without the UTC that relates them to the samples"] == len(run.gnss)
    assert stream.left_out["bytes that belong to no message with a right checksum"] >= len(GARBAGE)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["sbg", "xsens"])
def test_on_gps_time_a_stream_is_the_file_from_the_second_utc_on(run, tmp_path, name, seed):
    hints = ReadHints.of(streams="imu=rates" if name == "xsens" else None)
    data = log_of(name, run, tmp_path / "log.bin").read_bytes()
    log, clock = read(tmp_path / "log.bin", hints), SourceClock()
    messages = fed(decoder(clock, hints), data, seed, 2000)
    assert clock.base == log.metadata.time
    blocks = [m for m in messages if isinstance(m, ImuBlock)]
    t = np.concatenate([m.t for m in blocks])
    first = len(log.imu.t) - len(t)
    assert 0 < first <= 51  # one second
    np.testing.assert_allclose(t, log.imu.t[first:], rtol=0.0, atol=ROUNDING_S)
    np.testing.assert_array_equal(np.concatenate([m.accel for m in blocks]), log.imu.accel[first:])
    np.testing.assert_array_equal(np.concatenate([m.gyro for m in blocks]), log.imu.gyro[first:])
    fixes = [m for m in messages if isinstance(m, Fix)]
    first = len(log.gnss.t) - len(fixes)
    assert first <= 1
    assert [m.t for m in fixes] == log.gnss.t[first:].tolist()
    for field in ("llh", "cov_r_n", "v_n", "cov_v_n"):
        np.testing.assert_array_equal([getattr(m, field) for m in fixes], getattr(log.gnss, field)[first:])
    assert [m.quality for m in fixes] == log.gnss.quality[first:].tolist()


def test_pieces_of_any_length_give_the_same_times(run, tmp_path):
    data = log_of("sbg", run, tmp_path / "log.bin", drift=40e-6).read_bytes()
    times = []
    for seed, largest in ((0, 50), (1, 3000), (2, len(data))):
        blocks = [m for m in fed(decoder(SourceClock(), ReadHints()), data, seed, largest) if isinstance(m, ImuBlock)]
        times.append(np.concatenate([m.t for m in blocks]))
    np.testing.assert_array_equal(times[0], times[1])
    np.testing.assert_array_equal(times[0], times[2])


@pytest.mark.parametrize("seed", range(2))
def test_increments_of_xsens_where_the_run_knows_it(tmp_path, seed):
    rng = np.random.default_rng(4)
    made = []
    for k in range(200):
        q = np.append(1.0, 1e-3 * rng.standard_normal(3))
        payload = encode_xsens.fine(100 * k) + encode_xsens.vector(0x8030, q / np.linalg.norm(q), "double")
        payload += encode_xsens.vector(0x4010, (0.0, 0.0, 0.0981), "double")
        payload += encode_xsens.vector(0x0810, (20.0 + k,)) if k % 10 == 0 else b""
        made.append(encode_xsens.message(payload))
    data = b"".join(made)
    (tmp_path / "log.mtb").write_bytes(data)
    hints = ReadHints.of(streams="imu=delta", time="local")
    log = read(tmp_path / "log.mtb", hints)
    stream = decoder(SourceClock(), hints, format="xsens")
    assert stream.kind == "increment"
    messages = fed(stream, data, seed, 3000)
    same_samples(messages, log.imu)
    held = np.concatenate([m.temperature for m in messages])
    np.testing.assert_array_equal(held, 20.0 + 10.0 * (np.arange(200) // 10))  # the last one, not interpolated
    detected = decoder(SourceClock(), hints)
    assert fed(detected, data, seed, 3000) == []
    assert any("say format=xsens" in phrase for phrase in detected.left_out)


def test_a_pause_completes_a_fix_of_sbg():
    """Velocities come after their positions: a fix waits for its own, or for the next one, or for a pause."""
    stream = decoder(SourceClock(), ReadHints.of(time="local"), format="sbg")
    position = [encode_sbg.gps_pos(k, 1000 * k, (48.0, 11.0, 500.0), 47.0, (1, 1, 2)) for k in range(9)]
    velocity = [encode_sbg.gps_vel(k, 1000 * k, (1.0, 2.0, 0.0), (0.1, 0.1, 0.1)) for k in range(9)]
    assert stream.feed(position[0], 0.0) == []
    (fix,) = stream.pause()
    assert fix.v_n is None
    assert stream.feed(position[1], 0.0) == []
    (fix,) = stream.feed(velocity[1], 0.0)
    assert fix.v_n.tolist() == [1.0, 2.0, 0.0]
    assert stream.feed(position[2] + velocity[3], 0.0) == []  # of another time
    (fix,) = stream.feed(position[3], 0.0)
    assert (fix.t, fix.v_n) == (2.0, None)
    alone = decoder(SourceClock(), ReadHints.of(time="local"), format="sbg")
    assert [len(alone.feed(p, 0.0)) for p in position[:5]] == [0, 1, 1, 2, 1]  # after three nothing is waited for


def test_another_log_of_sbg_is_taken_when_it_comes_alone():
    data = b"".join(encode_sbg.imu_data(0.01 * k, (0, 0, -9.81), (0, 0, 0)) for k in range(60))
    stream = decoder(SourceClock(), ReadHints.of(time="local"), format="sbg")
    t = np.concatenate([m.t for m in fed(stream, data, largest=100)])
    np.testing.assert_allclose(t, 0.01 * np.arange(60 - len(t), 60), atol=1e-6)
    assert 30 < len(t) <= 40
    chosen = decoder(SourceClock(), ReadHints.of(time="local", streams="imu=IMU_DATA"), format="sbg")
    assert sum(len(m.t) for m in fed(chosen, data, largest=100)) == 60


def pairs(t, gps):
    return np.asarray(t, float), np.asarray(gps, float), np.zeros(len(t))


def test_a_drifting_clock_is_followed():
    """40 ppm over half an hour: the last ten minutes' line stays within a microsecond."""
    clock = SensorClock(SourceClock(), False)
    start = WEEK * WEEK_S + 1000.0
    gps = start + np.arange(1800.0)
    t = 5.0 + (gps - start) * (1.0 + 40e-6)
    got = []
    for k in range(1800):
        pair = pairs(t[k : k + 1], gps[k : k + 1])
        got.append(float(clock.times(np.array([k + 0.5]), t[k : k + 1], np.array([k]), pair)[0][0]))
    np.testing.assert_allclose(got[180:], gps[180:] - WEEK * WEEK_S, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(got[2:180], gps[2:180] - WEEK * WEEK_S, rtol=0.0, atol=0.5 * 40e-6 * 180.0)


def test_a_sensor_that_was_restarted_gets_another_line():
    """One wrong UTC is passed over; from the third one that says otherwise on the new count is believed."""
    clock = SensorClock(SourceClock(), False)
    start = WEEK * WEEK_S
    rows = [(5.0 + k, start + k) for k in range(10)] + [(15.0, start + 99.0)] + [(16.0, start + 11.0)]
    rows += [(0.5 + k, start + 20.0 + k) for k in range(6)]
    got = []
    for k, (t, gps) in enumerate(rows):
        made, good = clock.times(np.array([k + 0.5]), np.array([t]), np.array([float(k)]), pairs([t], [gps]))
        got.append(made[0] if good[0] else np.nan)
    assert np.isnan(got[0])
    np.testing.assert_allclose(got[1:12], np.arange(1.0, 12.0), atol=1e-9)
    np.testing.assert_allclose(got[-4:], [22.0, 23.0, 24.0, 25.0], atol=1e-9)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("sbg", {"streams": "imu=IMU_LONG"}, "imu of an SBG unit is one of IMU_SHORT, IMU_DATA or none"),
        ("sbg", {"time": "unix"}, "an SBG unit has time='gps'"),
        ("xsens", {"streams": "imu=dv"}, "imu of an Xsens sensor is one of delta, rates, hr or none"),
        ("xsens", {"time": "unix"}, "an Xsens sensor has time='gps'"),
    ],
)
def test_hints_that_mean_nothing_are_refused(name, options, message):
    with pytest.raises(InputError, match=message):
        decoder(SourceClock(), ReadHints.of(**options), format=name)


def any_sbg(rng):
    number = int(rng.choice([2, 3, 13, 14, 17, 44, 8, 99]))
    return encode_sbg.frame(number, rng.bytes(int(rng.integers(0, 90))))


def any_xsens(rng):
    kinds = [0x0810, 0x1010, 0x1020, 0x1060, 0x4010, 0x4020, 0x4040, 0x7010, 0x8020, 0x8030, 0x8040, 0x9999]
    payload = b"".join(
        struct.pack(">HB", kind | int(rng.integers(0, 4)), size) + rng.bytes(size)
        for kind in rng.choice(kinds, int(rng.integers(0, 6))).tolist()
        for size in [int(rng.choice([2, 4, 12, 16, 24, 94]))]
    )
    return encode_xsens.message(payload)


@pytest.mark.parametrize(("name", "message"), [("sbg", any_sbg), ("xsens", any_xsens)])
@pytest.mark.parametrize("time", ["local", None])
def test_messages_with_any_contents_raise_nothing(name, message, time):
    rng = np.random.default_rng(11)
    for seed in range(10):
        made = [message(rng) for _ in range(60)]
        made += [m[: rng.integers(1, len(m))] for m in made[:10]]
        data = b"".join(made[k] for k in rng.permutation(len(made)))
        stream = decoder(SourceClock(), ReadHints.of(time=time), format=name)
        fed(stream, data, seed)
        assert stream.left_out["bytes that belong to no message with a right checksum"] > 0
