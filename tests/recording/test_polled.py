"""IMUs read faster than they measure: every sample once, at even stamps, and never where rows are their own."""

import numpy as np
import pytest

from schuler import read
from schuler.recording.io.polled import samples_once

RATE = 100.5  # of the sensor [Hz]


def polled(duration=30.0, drift=0.0, seed=0):
    """Times of rows 6 to 9 ms apart, six readings, and when the sample of each row was ready. [s]"""
    rng = np.random.default_rng(seed)
    t = 400.0 + np.cumsum(rng.choice([0.006, 0.006, 0.007, 0.009], round(duration / 0.007)))
    ready = 399.9 + np.arange(round((duration + 2.0) * RATE)) / RATE
    ready += drift * (ready - ready[0]) ** 2
    sample = np.searchsorted(ready, t, side="right") - 1
    return t, rng.standard_normal((len(ready), 6))[sample], ready[sample]


@pytest.mark.parametrize("drift", [0.0, 5e-6])
def test_samples_come_once_at_the_times_at_which_they_were_ready(drift):
    t, x, ready = polled(drift=drift)
    rows, stamps, sentence = samples_once(t, list(x.T))
    assert len(np.unique(ready)) == len(rows)
    np.testing.assert_array_equal(np.unique(ready), ready[rows])
    # statistical: middles of intervals scatter by 2 ms, 500 of them at once, at the ends half as many
    assert np.abs(stamps - ready[rows]).max() < 5.0 * 0.002 / np.sqrt(250.0)
    assert f"{len(t) - len(rows)} of {len(t)} rows repeat" in sentence
    assert "100.5 Hz" in sentence


def test_a_pause_stays_a_pause():
    t, x, ready = polled()
    kept = (t < 410.0) | (t > 412.0)
    rows, stamps, _ = samples_once(t[kept], list(x[kept].T))
    assert np.abs(stamps - ready[kept][rows])[1:].max() < 0.002  # the first behind it was ready at any time within it
    assert np.diff(stamps).max() > 1.9


def by_chance(x, t):
    new = np.random.default_rng(2).random(len(t)) > 0.3
    return x[np.maximum.accumulate(np.where(new, np.arange(len(t)), 0))]


def held_at_the_end(x, t):
    return np.where((t > t[-1] - 6.0)[:, None], x[-1], x)


def held_between(x, t):
    return np.where(((t > 412.0) & (t < 418.0))[:, None], x[len(x) // 2], x)


@pytest.mark.parametrize(
    ("what", "spoil"),
    [
        ("each row its own", lambda x, t: x),
        ("repeats by chance", by_chance),
        ("at rest without noise at the end", held_at_the_end),
        ("at rest without noise between", held_between),
        ("one reading goes on", lambda x, t: np.repeat(x[::2], 2, axis=0)[: len(t)] + np.outer(t, np.eye(6)[5])),
    ],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_other_logs_stay_as_they_are(what, spoil):
    t = 400.0 + 0.01 * np.arange(3000)
    x = spoil(np.random.default_rng(1).standard_normal((3000, 6)), t)
    assert samples_once(t, list(x.T)) is None


def test_a_table_is_read_so_and_says_so(tmp_path):
    t, x, _ = polled(5.0)
    file = tmp_path / "imu.csv"
    np.savetxt(file, np.column_stack((t, x)), delimiter=",", fmt="%.6f")
    recording = read(file, columns="t,ax,ay,az,gx,gy,gz", units="m/s^2,rad/s", allow=["norm", "magnitude"])
    once = samples_once(np.round(t, 6), list(x.T))
    np.testing.assert_allclose(recording.imu.t, once[1], atol=1e-6)
    np.testing.assert_allclose(recording.imu.accel, x[once[0], :3], atol=1e-6)
    assert once[2] in recording.metadata.notes
