"""A real car with a cheap IMU through RTK outages: one configuration for five sets of windows (docs/driving.md).

Bounds on metres are the marks of the issue or, for the sets without a mark, what the peers reach on the published set.
Bounds on normalised errors are wide because eleven windows are few: their mean is known to about +-0.5.
"""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from places import ROOT

from schuler import frames, rotation, units
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.errors import OutageError, TrajectoryErrors, outage_errors, trajectory_errors
from schuler.navigation.result import NavigationResult
from schuler.navigation.run import navigate
from schuler.recording.io import read
from schuler.recording.recording import Recording
from schuler.recording.trajectory import Trajectory

EXAMPLE = ROOT / "examples" / "rtkexp_drive.toml"
#: Start of the first window: the published set, and four whose windows lie elsewhere. [s]
SETS = (40.0, 25.0, 55.0, 32.0, 47.0)
README_MOUNT_RPY = (180.0, -6.79, 185.35)  # deg, IMU to vehicle, as the data's README prints it
README_CLOCK_SHIFT = -0.125  # s

pytestmark = pytest.mark.realdata


def settings() -> dict:
    return tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def recording(shared_data) -> Recording:
    return read(shared_data / "rtkexp_drive", **settings()["recording"])


@dataclass(frozen=True)
class Outcome:
    result: NavigationResult
    causal: list[OutageError]
    smoothed: list[OutageError]
    nees: float  # horizontal, per degree of freedom
    nees_3d: float
    nees_smoothed: float

    @property
    def mean(self) -> float:
        return float(np.mean([o.max_horizontal for o in self.causal]))

    @property
    def mean_smoothed(self) -> float:
        return float(np.mean([o.max_horizontal for o in self.smoothed]))


def at_antenna(result: NavigationResult, reference: Trajectory) -> TrajectoryErrors:
    """Errors at the antenna as the run has it in the end: lever arm as given and what was estimated of it."""
    lever = result.lever_arm_b + result.parameter("lever")[-1]
    return trajectory_errors(result.trajectory.moved_by(lever), reference)


def outage_nees(result: NavigationResult, errors: TrajectoryErrors, axes: int) -> float:
    """Mean NEES of position per degree of freedom, at the records from one second after the start of an outage."""
    P = result.covariance[:, 6 : 6 + axes, 6 : 6 + axes]
    values = []
    for start, stop in result.outages:
        for k in np.flatnonzero((result.t >= start + 1.0) & (result.t < stop)):
            j = int(np.argmin(np.abs(errors.t - result.t[k])))
            if abs(errors.t[j] - result.t[k]) < 0.06:
                d = errors.position_n[j, :axes]
                values.append(d @ np.linalg.solve(P[k], d) / axes)
    return float(np.mean(values))


def run(recording: Recording, first_s: float, data: dict | None = None) -> Outcome:
    data = copy.deepcopy(settings() if data is None else data)
    data["outages"] = {"every_s": 45.0, "length_s": 15.0, "first_s": first_s}
    result = navigate(recording, data)
    smoothed = result.smooth()
    g = recording.gnss
    reference = Trajectory.from_geodetic(g.t, g.llh, g.v_n)
    errors, errors_smoothed = at_antenna(result, reference), at_antenna(smoothed, reference)
    return Outcome(
        result,
        outage_errors(errors, result.outages),
        outage_errors(errors_smoothed, result.outages),
        outage_nees(result, errors, 2),
        outage_nees(result, errors, 3),
        outage_nees(smoothed, errors_smoothed, 2),
    )


@pytest.fixture(scope="module")
def outcomes(recording) -> Callable[[float], Outcome]:
    """Outcome of a set, run when it is first asked for."""
    return cache(lambda first: run(recording, first))


@pytest.mark.campaign
def test_the_published_windows(outcomes):
    """Best peer 4.8 m causal with wheels, 0.44 m from both sides; marks of the issue 4.0 and 0.40 m."""
    o = outcomes(40.0)
    assert len(o.causal) == 11
    assert o.mean < 2.5  # seen 1.82
    assert o.mean_smoothed < 0.25  # seen 0.17
    assert 0.5 < o.nees < 2.0  # seen 0.72
    assert 0.5 < o.nees_3d < 2.0  # seen 0.87
    assert 0.5 < o.nees_smoothed < 2.0  # seen 1.13


@pytest.mark.parametrize("first", [55.0, *(pytest.param(f, marks=pytest.mark.campaign) for f in (25.0, 32.0, 47.0))])
def test_other_windows_with_the_same_configuration(outcomes, first):
    o = outcomes(first)
    assert len(o.causal) == 11  # windows before the car moves have no solution
    assert o.mean < 3.0  # seen 1.77, 2.10, 1.23, 1.98
    assert o.mean_smoothed < 0.30  # seen 0.16, 0.18, 0.18, 0.19
    assert 0.5 < o.nees < 2.0  # seen 0.57, 1.23, 1.13, 1.33
    assert 0.5 < o.nees_3d < 2.5  # seen 0.83, 1.62, 1.00, 1.96
    assert 0.5 < o.nees_smoothed < 2.0  # seen 0.77, 1.10, 1.15, 1.05


@pytest.mark.campaign
@pytest.mark.parametrize("sets", [(40.0, 55.0), SETS])
def test_the_sets_differ_in_their_windows_only(outcomes, sets):
    """Nothing of the configuration moves with the windows: the file is what every run used."""
    of_file = NavigationConfig.load(EXAMPLE).model_dump(mode="json", exclude_defaults=True)
    of_file.pop("outages")
    for first in sets:
        used = dict(outcomes(first).result.provenance["config"])
        assert used.pop("outages") == {"every_s": 45.0, "length_s": 15.0, "first_s": first}
        assert used == of_file
    starts = np.concatenate([[a for a, _ in o.result.outages] for o in map(outcomes, sets)])
    assert len(np.unique(starts.round(3))) == len(starts)


@pytest.mark.campaign
def test_wheels_bring_more_than_half(recording, outcomes):
    without = settings()
    del without["aiding"]["non_holonomic"]
    for first in (40.0, 55.0):
        free = run(recording, first, without)
        assert free.mean > 2.0 * outcomes(first).mean
        assert free.mean_smoothed > outcomes(first).mean_smoothed


def test_wheel_measurements_are_rarely_rejected_and_counted(outcomes):
    counts = outcomes(40.0).result.innovations.counts()
    for kind in ("lateral", "vertical"):
        c = counts[kind]
        assert c["accepted"] > 1900
        assert c["rejected"] + c["accepted after lock-out"] < 0.01 * c["accepted"]
        assert c["condition not met"] > 100  # standing, and squat and dive for the vertical one


def test_the_car_rests_at_traffic_stops(outcomes):
    counts = outcomes(40.0).result.innovations.counts()
    assert counts["zero_velocity"]["rejected"] == 0
    assert counts["zero_velocity"]["accepted"] > 40
    notes = outcomes(40.0).result.notes
    assert any("at rest: 9 intervals" in note for note in notes)  # five with the engine off
    assert any(note.startswith("stops that shake") for note in notes)


def predicted_over(recording: Recording, every_s: float, data: dict) -> tuple[float, float]:
    """Mean log-likelihood and normalised square of fixes predicted over ``every_s``, no window withheld.

    Thinned at four phases; the first 75 s, in which the heading is found, and the stop at the end do not count.
    """
    data = copy.deepcopy(data)
    data["outages"], data["filter"]["smooth"] = {}, False
    g, t0 = recording.gnss, recording.start
    likelihood, square = [], []
    for phase in np.arange(4) * every_s / 4.0:
        u = (g.t - t0 - 70.0 - phase) % every_s
        keep = (g.t - t0 < 70.0) | (u < 1e-3) | (u > every_s - 1e-3)
        i = navigate(replace(recording, gnss=g.where(np.flatnonzero(keep))), data).innovations.of("position")
        k = (i.t > t0 + 75.0) & (i.t < t0 + 528.0)
        x = i.innovation[k] / i.sigma[k]
        likelihood.append((-0.5 * x**2 - np.log(i.sigma[k])).sum(axis=1))
        square.append((x**2).mean(axis=1))
    return float(np.concatenate(likelihood).mean()), float(np.concatenate(square).mean())


@pytest.fixture(scope="module")
def criterion(recording) -> float:
    value, square = predicted_over(recording, 10.0, settings())
    assert 0.7 < square < 1.4  # seen 1.02; some 180 correlated fixes: +-0.1
    return value


@pytest.mark.campaign
@pytest.mark.thinned(5)
@pytest.mark.parametrize(
    ("section", "key"),
    [
        (("imu", "gyro"), "noise_deg_s_rthz"),
        (("imu", "accel"), "noise_ug_rthz"),
        (("aiding", "non_holonomic"), "lateral_sigma_m_s"),
        (("aiding", "non_holonomic"), "vertical_sigma_m_s"),
        (("aiding", "non_holonomic"), "rate_hz"),
    ],
)
def test_the_levels_are_the_likeliest(recording, criterion, section, key):
    """Criterion without outages: fixes predicted over ten seconds are less likely with 0.4 or 2.5 times the level."""
    for factor in (0.4, 2.5):
        data = settings()
        data[section[0]][section[1]][key] *= factor
        assert predicted_over(recording, 10.0, data)[0] < criterion


@pytest.mark.campaign
def test_velocities_of_this_log_are_old_differences_of_positions(recording, criterion):
    """Half an interval late: to be believed at their stamps they would have to be those of the middle difference."""
    g, t0 = recording.gnss, recording.start
    r_n = (frames.ecef_from_llh(g.llh) - frames.ecef_from_llh(g.llh[0])) @ frames.C_en(g.llh[0])
    moving = g.t[1:-1] - t0 > 50.0
    back = (r_n[1:-1] - r_n[:-2]) / 0.25
    middle = (r_n[2:] - r_n[:-2]) / 0.5
    of_back = np.std((g.v_n[1:-1] - back)[moving, :2])
    of_middle = np.std((g.v_n[1:-1] - middle)[moving, :2])
    assert of_back < 0.04 < 0.08 < of_middle
    data = settings()
    data["gnss"]["velocity"] = True
    assert predicted_over(recording, 10.0, data)[0] < criterion


@pytest.mark.campaign
def test_the_derived_stamps_are_stretched(recording, shared_data, criterion):
    """imu_gpst.csv runs 290 ppm slow against the board's own counter; the counter is the better clock."""
    folder = shared_data / "rtkexp_drive"
    data = settings()
    hints = {
        "file": "imu_gpst.csv", "columns": "t,ax,ay,az,gx,gy,gz", "units": "m/s^2,rad/s", "time": "gps-tow:2374",
        "axes": "BRU",
    }  # fmt: skip
    derived = read(folder, imu=hints, gnss=data["recording"]["gnss"])
    board = recording.imu.t[1 : 1 + len(derived.imu)]
    slope = np.polyfit(board - board[0], derived.imu.t - board, 1)[0]
    assert slope == pytest.approx(290e-6, abs=10e-6)  # stamps of whole milliseconds: 1e-6
    assert predicted_over(derived, 10.0, data)[0] < criterion - 1.0


@pytest.mark.campaign
def test_mount_angles_and_clock_are_estimated_from_the_log(recording):
    """From 10 degrees and 0.3 s of ignorance; with cross-coupling of 1 percent as any cheap IMU has it."""
    raw_axes = np.diag([-1.0, 1.0, -1.0])  # "BRU"
    C = rotation.dcm_from_rpy(np.array(README_MOUNT_RPY) * units.DEG).T @ raw_axes
    roll, pitch, yaw = rotation.rpy_from_dcm(C) / units.DEG
    np.testing.assert_allclose((roll, pitch, yaw), settings()["imu"]["mount_rpy_deg"], atol=0.002)  # printed digits
    data = settings()
    data["imu"] |= {"mount_rpy_deg": [roll, 0.0, 0.0], "clock_shift_s": 0.0}
    for triad in ("gyro", "accel"):
        data["imu"][triad]["misalignment_percent"] = 1.0
    data["filter"]["states"] = 33
    data["alignment"]["sideslip_deg"] = 8.0
    data["aiding"]["non_holonomic"]["mount_sigma_deg"] = 10.0
    data["gnss"] |= {"delay_sigma_s": 0.3, "lever_sigma_m": 0.05}
    data["outages"] = {}
    result = navigate(recording, data)
    mount, sigma = result.parameter("mount")[-1] / units.DEG, result.sigma("mount")[-1] / units.DEG
    assert np.all(sigma < 0.5)
    assert np.all(np.abs(mount - (pitch, yaw)) < 3.0 * sigma)  # statistical
    # the state says by how much fixes are later than the IMU's stamps: the shift is its negative
    delay, sigma_t = float(result.parameter("delay")[-1, 0]), float(result.sigma("delay")[-1, 0])
    assert sigma_t < 0.005
    assert abs(-delay - README_CLOCK_SHIFT) < 3.0 * sigma_t  # statistical
    # the rear axle is below the IMU, 0.65 m as the README says of the vehicle's origin
    assert np.all(np.abs(result.parameter("lever_v")[-1]) < 0.25)
