"""Clipped gyroscopes on a foot: plateaus, the angle they hide, and what the walk is when it is put back."""

import numpy as np
import pytest

from schuler.navigation.foot import navigate_foot
from schuler.navigation.foot.clipping import clip_noise, clip_sentences, gyro_clips, restored
from schuler.recording.series import ImuSeries
from schuler.simulation import ideal_rates, walk

RATE = 200.0


def series(omega_y, kind="rate"):
    t = np.arange(len(omega_y)) / RATE
    gyro = np.zeros((len(t), 3))
    gyro[:, 1] = omega_y
    accel = np.tile([0.0, 0.0, -9.81], (len(t), 1))
    per = 1.0 / RATE if kind == "increment" else 1.0
    return ImuSeries(t, gyro * per, accel * per, kind)


def swings(top):
    """Ten swings of 0.3 s at 8 to 12 rad/s, an eighth of the time at the top, one a second."""
    t = np.arange(0.0, 10.0, 1.0 / RATE)
    phase = np.clip((t % 1.0 - 0.3) / 0.3, 0.0, 1.0)
    return top * np.sin(np.pi * phase)


@pytest.mark.parametrize("top", [9.5, 10.0, 11.0])
@pytest.mark.parametrize("kind", ["rate", "increment"])
def test_the_hidden_angle_is_that_above_the_plateau(top, kind):
    """Swings of a sine, clipped at 8.7 rad/s. Discretisation and the flanks' curvature: within the stated half."""
    whole = swings(top)
    clipped = series(np.minimum(whole, 8.7), kind)
    clips = gyro_clips(clipped)
    hidden = float((whole - np.minimum(whole, 8.7)).sum() / RATE)
    assert len(clips) == 10
    assert set(clips.axis) == {1}
    assert float(clips.angle.sum()) == pytest.approx(hidden, rel=0.5)
    back = restored(clipped, clips).rates().gyro
    assert float(back[:, 1].sum() / RATE) == pytest.approx(
        float(clipped.rates().gyro[:, 1].sum() / RATE + clips.angle.sum())
    )
    np.testing.assert_array_equal(back[:, [0, 2]], 0.0)
    # ten times the square of half the angle of one, in ten seconds
    np.testing.assert_allclose(clip_noise(clipped, clips)[1], (0.05 * clips.angle.sum()) ** 2, rtol=0.01)


@pytest.mark.parametrize(
    "omega",
    [
        swings(8.0),  # nothing clipped
        np.minimum(swings(3.4), 3.0),  # clipped below the range of any gyroscope: a foot that is turned so
        np.repeat([0.0, 8.0, 0.0], 400),  # turned steadily for two seconds
    ],
)
def test_what_is_no_plateau_of_a_clipped_gyroscope_is_left_alone(omega):
    imu = series(omega)
    clips = gyro_clips(imu)
    assert len(clips) == 0
    assert restored(imu, clips) is imu
    assert clip_sentences(imu, clips) == ([], [])
    assert not clip_noise(imu, clips).any()


@pytest.mark.parametrize(("share", "doubted"), [(0.93, False), pytest.param(0.85, True, marks=pytest.mark.campaign)])
def test_a_walk_with_a_clipped_gyroscope_is_restored_and_says_so(share, doubted):
    """A walk in closed form, its largest rate clipped: 0.8 and 2.7 m high at the end as read, restored below 0.05 m."""
    motion = walk([0.8, 0.1, 0.0], strides=12)
    t = np.arange(0.0, motion.duration, 1.0 / RATE)
    gyro, accel = ideal_rates(motion, t)
    limit = share * np.abs(gyro[:, 1]).max()
    result = navigate_foot(ImuSeries(t, np.clip(gyro, -limit, limit), accel))
    named = [
        any("gyroscope y stays at its largest rate" in text for text in of) for of in (result.notes, result.doubts)
    ]
    assert named == [not doubted, doubted]
    np.testing.assert_allclose(result.closure_n, [15.6, 0.0, 0.0], atol=0.05)


def test_much_that_is_hidden_is_doubted():
    whole = swings(13.0)
    imu = series(np.minimum(whole, 8.7))
    notes, doubts = clip_sentences(imu, gyro_clips(imu))
    assert notes == []
    assert len(doubts) == 1
    assert "498 deg/s" in doubts[0]
    assert "10 places" in doubts[0]
