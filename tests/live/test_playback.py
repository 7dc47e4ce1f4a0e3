"""A recording as the stream that it was: in order, with nothing lost and nothing repeated."""

from dataclasses import replace

import numpy as np
import pytest
from format_drives import drive

from schuler.live.messages import Fix, Heading, Height, ImuBlock, Speed
from schuler.live.playback import messages
from schuler.recording import OdometerSeries, ScalarSeries


@pytest.fixture(scope="module")
def recording():
    """A drive with every series that is played, some of their times those of samples, some between, some outside."""
    made = drive(6.0)
    t, n = made.imu.t, len(made.imu)
    imu = replace(made.imu, temperature=np.arange(n, dtype=np.float64))
    odometer = OdometerSeries(t[::7].copy(), np.arange(len(t[::7])) * 0.1, np.full(len(t[::7]), 0.1))
    heading = ScalarSeries(t[3::40] + 0.003, 0.1 * np.arange(len(t[3::40])), np.full(len(t[3::40]), 0.02))
    height = ScalarSeries(np.array([t[0] - 1.0, t[5], t[-1] + 1.0]), np.array([1.0, 2.0, 3.0]), np.full(3, 0.5))
    return replace(made, imu=imu, odometer=odometer, heading=heading, height=height)


@pytest.mark.parametrize("piece_s", [1.0, 0.05, 1e-6])
def test_a_measurement_comes_before_the_sample_of_its_time(recording, piece_s):
    newest, waiting, came = -np.inf, [], []
    for t, message in messages(recording, piece_s):
        came.append(t)
        if isinstance(message, ImuBlock):
            assert all(newest < m <= message.t[0] for m in waiting)
            assert message.t[-1] - message.t[0] <= piece_s
            assert t == message.t[-1]
            newest, waiting = message.t[-1], []
        else:
            assert t == message.t
            waiting.append(message.t)
    assert came == sorted(came)


@pytest.mark.parametrize("piece_s", [1.0, 0.05, 1e-6])
def test_nothing_is_lost_or_repeated(recording, piece_s):
    made = [message for _, message in messages(recording, piece_s)]
    blocks = [m for m in made if isinstance(m, ImuBlock)]
    for name in ("t", "gyro", "accel", "temperature"):
        np.testing.assert_array_equal(np.concatenate([getattr(m, name) for m in blocks]), getattr(recording.imu, name))
    assert [(m.t, m.speed, m.sigma) for m in made if isinstance(m, Speed)] == list(
        zip(*(getattr(recording.odometer, name).tolist() for name in ("t", "speed", "sigma")), strict=True)
    )
    for kind, series in ((Heading, recording.heading), (Height, recording.height)):
        rows = zip(series.t.tolist(), series.value.tolist(), series.sigma.tolist(), strict=True)
        assert [(m.t, m.value, m.sigma) for m in made if type(m) is kind] == list(rows)
    fixes = [m for m in made if isinstance(m, Fix)]
    for name in ("t", "llh", "cov_r_n", "v_n", "cov_v_n"):
        np.testing.assert_array_equal([getattr(m, name) for m in fixes], getattr(recording.gnss, name))


def test_fixes_come_when_they_were_delivered(recording):
    """Not at the time that they are of; one that overtook another is given first."""
    received = recording.gnss.t + 0.3
    received[2] += 1.5
    late = replace(recording, gnss=replace(recording.gnss, received=received))
    newest, order = -np.inf, []
    for t, message in messages(late):
        if isinstance(message, ImuBlock):
            newest = message.t[-1]
        elif isinstance(message, Fix):
            order.append(message.t)
            assert t == received[np.flatnonzero(recording.gnss.t == message.t)[0]]
            assert newest < t
            after = recording.imu.t[recording.imu.t > newest]
            assert not len(after) or t <= after[0]
    assert order == recording.gnss.t[np.argsort(received, kind="stable")].tolist()
