"""Edges of rests: as far out as the motion allows, not further, whatever the noise."""

import numpy as np
import pytest

from schuler.recording.series import ImuSeries
from schuler.standstill.edges import SHORTEST_S, extend_edges
from schuler.units import DEG, G0

RATE = 100.0
SIGMA = np.array([0.05, 0.05, 0.05, 1e-3, 1e-3, 1e-3])
#: The first sample of a motion and the one after its last, and the rests that a search has found around it.
ONSET, END = 1000, 1200
FOUND = np.array([[0, ONSET - 45], [END + 45, 2200]])
SHORT = round(SHORTEST_S * RATE)


def log(motion, *, seed=0, n=2200, noise=None, t=None) -> ImuSeries:
    """White noise around gravity, and a rate about x in the motion. [rad/s]"""
    x = SIGMA * np.random.default_rng(seed).standard_normal((n, 6)) if noise is None else noise
    x[:, 2] -= G0
    x[ONSET:END, 3] += motion
    return ImuSeries(np.arange(n) / RATE if t is None else t, x[:, 3:], x[:, :3])


def moved(imu, **options):
    return extend_edges(imu, FOUND, **({"reach_s": 0.5, "limit": 5.0} | options))


def test_what_begins_suddenly_costs_the_shortest_window():
    """The window with the first sample of it is given up: m - 1 samples are lost. Exact."""
    for seed in range(20):
        index = moved(log(1.0, seed=seed))
        assert index.tolist() == [[0, ONSET - SHORT + 1], [END + SHORT - 1, 2200]]


def test_backwards_it_is_the_same():
    imu = log(1.0, seed=3)
    back = ImuSeries(imu.t, imu.gyro[::-1], imu.accel[::-1])
    n = len(imu)
    forward, backward = moved(imu), extend_edges(back, n - FOUND[::-1, ::-1], reach_s=0.5, limit=5.0)
    np.testing.assert_array_equal(backward, n - forward[::-1, ::-1])


@pytest.mark.parametrize("acceleration", np.geomspace(0.1, 300.0, 12) * DEG)
def test_what_turns_inside_is_less_than_the_noise_of_carrying_on(acceleration):
    """A turn that speeds up uniformly, 0.1 to 300 deg/s^2: the angle in the rest, root mean square over 40 edges,
    beside the random walk of the time extend_edges or, where there is hardly any, of a window. A law, not a tolerance.
    """
    s = np.arange(END - ONSET) / RATE
    ramp = acceleration * np.minimum(s, s[::-1])
    angle, kept = [], []
    for seed in range(20):
        index = moved(log(ramp, seed=seed))
        for samples, gained in (
            (index[0, 1] - ONSET, index[0, 1] - FOUND[0, 1]), (END - index[1, 0], FOUND[1, 0] - index[1, 0]),
        ):  # fmt: skip
            assert gained >= 0
            angle.append(0.5 * acceleration * (max(samples, 0) / RATE) ** 2)
            kept.append(gained / RATE)
    walk = SIGMA[3] / np.sqrt(RATE) * np.sqrt(max(np.mean(kept), SHORTEST_S))
    assert np.sqrt(np.mean(np.square(angle))) < walk


def test_what_a_long_window_sees_sooner_is_given_up_by_it():
    """A hand takes hold, 1.3 sigma of a sample for 0.35 s, then it turns: 0.4 s of the first are 8 sigma, 0.1 s are 4.

    The shortest window alone would often keep all of it but 0.1 s before the turn. Statistical.
    """
    motion = np.where(np.arange(END - ONSET) < 35, 1.3 * SIGMA[3], 1.0)
    near = np.array([[0, ONSET - 5], [END + 5, 2200]])
    kept = [int(extend_edges(log(motion, seed=k), near, reach_s=0.5, limit=5.0)[0, 1]) - ONSET for k in range(20)]
    assert max(kept) < 20 < 35 - SHORT
    assert np.median(kept) < 5


def test_specific_force_tells_too():
    """A lift without any turning: 0.3 m/s^2 up."""
    imu = log(0.0)
    accel = imu.accel.copy()
    accel[ONSET:END, 2] -= 0.3
    index = moved(ImuSeries(imu.t, imu.gyro, accel))
    assert ONSET - 2 * SHORT <= index[0, 1] <= ONSET
    assert END <= index[1, 0] <= END + 2 * SHORT


def test_what_no_mean_shows_moves_no_edge():
    """Nothing at all, and a vibration of four sigma at half the sampling rate."""
    np.testing.assert_array_equal(moved(log(0.0)), FOUND)
    shaking = 4.0 * SIGMA[3] * (-1.0) ** np.arange(END - ONSET)
    np.testing.assert_array_equal(moved(log(shaking)), FOUND)


def test_only_the_edges_that_may_be_moved():
    ends = np.array([[True, False], [True, True]])
    index = moved(log(1.0), ends=ends)
    assert index[0, 1] == FOUND[0, 1]
    assert index[1, 0] == END + SHORT - 1


def test_neighbours_and_jumps_of_time_are_not_passed():
    """Half-way to the next rest at most, and not over a hole in the log."""
    imu = log(0.0)
    gyro = imu.gyro.copy()
    gyro[985:989, 0] += 1.0  # a knock nearer to the first
    close = np.array([[0, 955], [1045, 2200]])
    index = extend_edges(ImuSeries(imu.t, gyro, imu.accel), close, reach_s=0.5, limit=5.0)
    assert index.tolist() == [[0, 985 - SHORT + 1], [1045, 2200]]
    t = imu.t + np.where(np.arange(2200) >= 980, 1.0, 0.0)
    index = extend_edges(ImuSeries(t, gyro, imu.accel), close, reach_s=0.5, limit=5.0)
    np.testing.assert_array_equal(index, close)


def test_a_hand_that_sways_is_compared_with_its_swaying():
    """Correlated over half a second, 20 times the density of the white noise: edges are moved, none into the turn."""
    rng = np.random.default_rng(5)
    gained = []
    for _ in range(20):
        noise = SIGMA * rng.standard_normal((2200, 6))
        kick, slow = rng.standard_normal((2200, 6)), np.zeros(6)
        for k in range(2200):
            slow = 0.98 * slow + 0.2 * kick[k]
            noise[k] += 2.0 * SIGMA * slow
        index = moved(log(0.5, noise=noise))
        assert index[0, 1] <= ONSET
        assert index[1, 0] >= END
        gained += [index[0, 1] - FOUND[0, 1], FOUND[1, 0] - index[1, 0]]
    assert np.mean(gained) > 0.5 * (45 - SHORT)


def test_short_windows_of_the_search_and_no_rest_leave_everything():
    imu = log(1.0)
    np.testing.assert_array_equal(moved(imu, reach_s=0.05), FOUND)
    none = np.empty((0, 2), dtype=np.int64)
    assert extend_edges(imu, none, reach_s=0.5, limit=5.0).shape == (0, 2)


def test_readings_without_noise_move_no_edge():
    """Nothing to compare with: a quantised sensor that reads the same all the time."""
    np.testing.assert_array_equal(moved(log(0.0, noise=np.zeros((2200, 6)))), FOUND)
