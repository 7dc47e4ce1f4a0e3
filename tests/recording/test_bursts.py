"""Samples that come in bursts under one stamp: spread evenly, said, and never where the stamps are their own."""

import numpy as np
import pytest

from schuler import read
from schuler.recording.io.bursts import spread_bursts

H = 0.01  # sample interval [s]


def arrivals(n, size, scatter=0.0, micro=0.0, seed=0):
    """True times and stamps of bursts: the time of the last sample, late by up to ``scatter``."""
    true = H * np.arange(1, n + 1)
    burst = np.arange(n) // size
    late = np.random.default_rng(seed).uniform(0.0, scatter, burst[-1] + 1)
    t = true[np.minimum(burst * size + size - 1, n - 1)] + late[burst] + micro * (np.arange(n) - burst * size)
    return true, t


@pytest.mark.parametrize("size", [2, 10, 25])
@pytest.mark.parametrize("micro", [0.0, 5e-5])
def test_even_bursts_give_back_the_times_of_the_samples(size, micro):
    true, t = arrivals(3000, size, micro=micro)
    spread, sentence = spread_bursts(t)
    assert np.abs(spread - true - micro * (size - 1)).max() < 1e-9  # rounding; the driver's own lateness stays
    assert f"bursts of about {size}" in sentence
    assert "100 Hz" in sentence


def test_scatter_of_the_arrivals_averages_out():
    true, t = arrivals(10_000, 10, scatter=0.02)
    spread, _ = spread_bursts(t)
    error = spread - true
    # statistical: uniform scatter 20 ms / sqrt(12) over 1000 bursts, at the ends twice the standard error of a mean
    assert np.abs(error - error.mean()).max() < 5.0 * 2.0 * 0.02 / np.sqrt(12.0 * 1000.0)


def test_a_pause_stays_a_pause():
    true, t = arrivals(4000, 10)
    shift = np.where(np.arange(4000) >= 2000, 3.0, 0.0)
    spread, _ = spread_bursts(t + shift)
    assert np.abs(spread - true - shift).max() < 1e-9


def test_a_clock_too_coarse_for_the_rate_counts_as_bursts():
    true = 0.004 * np.arange(3000)
    spread, _ = spread_bursts(np.floor(true * 100.0) / 100.0)
    error = spread - true
    assert np.abs(error - error.mean()).max() < 1e-3
    assert np.abs(error.mean()) < 0.01  # what a stamp of that clock can be wrong by


@pytest.mark.parametrize(
    "t",
    [
        H * np.arange(1000),
        H * np.arange(1000) + np.random.default_rng(1).uniform(0.0, 0.4 * H, 1000),
        np.cumsum(np.random.default_rng(2).exponential(H, 1000)),
        np.concatenate((H * np.arange(500), 100.0 + H * np.arange(500))),
        np.sort(np.concatenate((H * np.arange(500), H * np.arange(500)))) * 1.0 + 0.3 * H * (np.arange(1000) % 2),
        np.concatenate((H * np.arange(50), H * np.arange(50))),
    ],
    ids=["even", "jitter", "exponential", "pause", "pairs a third apart", "goes back"],
)
def test_stamps_of_their_own_are_left_alone(t):
    assert spread_bursts(t) is None


def test_a_log_with_ten_samples_a_stamp_opens_and_says_so(tmp_path):
    _true, t = arrivals(2000, 10)
    rng = np.random.default_rng(3)
    rows = np.column_stack(
        (t, rng.normal(0.0, 0.02, (2000, 2)), rng.normal(-9.81, 0.02, 2000), rng.normal(0, 1e-3, (2000, 3)))
    )
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t,ax,ay,az,gx,gy,gz", comments="", fmt="%.6f")
    recording = read(tmp_path / "log.csv", units="m/s^2,rad/s")
    assert np.diff(recording.imu.t) == pytest.approx(np.full(1999, H), abs=1e-9)
    assert any("bursts of about 10" in note for note in recording.metadata.notes)
