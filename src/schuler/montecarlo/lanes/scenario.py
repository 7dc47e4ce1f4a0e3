"""The scenario that all runs of a campaign in lanes share, and what a run draws once."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from schuler import frames, rotation
from schuler.arrays import ArrayLike, FloatArray, IntArray, as_vector3
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout
from schuler.mechanization.strapdown import NavState
from schuler.montecarlo.lanes.aiding import LaneAiding
from schuler.montecarlo.lanes.errors import LaneErrors, true_parameters
from schuler.montecarlo.lanes.sky import DrawnRanges, check_layout, clock_blocks
from schuler.simulation.imu import IdealImu

LARGEST_TURN = 0.5  # a sample may turn the body by less: beyond, the kernel's series lose digits [rad]


@dataclass(frozen=True)
class LaneScenario:
    """What all runs of a campaign share.

    Attributes
    ----------
    ideal : IdealImu
        Ideal increments and true motion.
    errors : LaneErrors
        What is wrong with the IMUs.
    aiding : LaneAiding
    layout : StateLayout
        Sensor parameters; with single satellites the receiver's clocks and the ambiguities, too.
    initial : InitialState
        The **true** state at the start of ``ideal`` with the covariance of the errors the filter starts with: each run
        draws its navigation error from it, and that of its clocks. Other parameter estimates are where all runs
        start. States of ambiguities are left out.
    gyro_psd, accel_psd : array_like, shape (3,)
        ``N**2`` by axis, as the filter believes. [rad^2/s], [m^2/s^3]
    options : FilterOptions
        Covariance rate, flush angle (of the true motion), spacing of records, lock-out, Earth rotation.
    nees : tuple of str
        What normalised errors are taken of: "all", "navigation", or names of state blocks.
    """

    ideal: IdealImu
    errors: LaneErrors
    aiding: LaneAiding
    layout: StateLayout
    initial: InitialState
    gyro_psd: ArrayLike
    accel_psd: ArrayLike
    options: FilterOptions = field(default_factory=lambda: FilterOptions(record_s=10.0))
    nees: tuple[str, ...] = ("all",)

    def __post_init__(self) -> None:
        for name in ("gyro_psd", "accel_psd"):
            value = as_vector3(getattr(self, name), name)
            if np.any(value < 0.0):
                raise InputError(f"{name}: expected non-negative values of N**2")
            object.__setattr__(self, name, value)
        n = self.layout.visible.size
        if self.ideal.kind != "increment":
            raise InputError("lanes take ideal increments: ideal_imu(motion, rate_hz, kind='increment')")
        check_layout(self.layout, self.aiding.sky is not None)
        if len(self.initial.P) != n:
            raise InputError(f"the initial covariance has {len(self.initial.P)} states, the layout {n}")
        if abs(self.initial.nav.t - self.ideal.t[0]) > 1e-9:
            raise InputError(
                f"the initial state is at {self.initial.nav.t:.4f} s but the motion begins at {self.ideal.t[0]:.4f} s"
            )
        if abs(self.errors.dt * self.ideal.rate_hz - 1.0) > 1e-9:
            raise InputError(
                f"the errors are made for a sample every {self.errors.dt} s, the IMU reports {self.ideal.rate_hz} Hz"
            )
        if self.options.smoother or self.options.gap_s is not None:
            raise InputError("lanes neither smooth nor bridge pauses: smoother=False, gap_s=None")
        turn = float(np.linalg.norm(self.ideal.gyro, axis=1).max())
        if turn > 0.8 * LARGEST_TURN:
            raise InputError(
                f"the body turns by {turn:.2f} rad in a sample; lanes take up to {0.8 * LARGEST_TURN}: raise the rate"
            )
        for name in self.nees:
            self.states(name)

    def states(self, name: str) -> tuple[int, int]:
        """First state of what a NEES is taken of, and the one behind its last."""
        if name in ("all", "navigation"):
            return 0, self.layout.visible.size if name == "all" else 9
        part = self.layout[name]
        return part.start, part.stop


class Draws(NamedTuple):
    """One run: its initial state, constants of its IMU, true constant parameters, processes, random streams, ranges."""

    initial: InitialState
    constants: FloatArray
    parameters: FloatArray
    starts: FloatArray
    slopes: FloatArray
    streams: npt.NDArray[np.uint64]
    ranges: DrawnRanges | None = None


def draw_run(scenario: LaneScenario, run: int, seed: int) -> Draws:
    """What is drawn once for a run.

    Children of the seed: 0 errors, 1 start, 2 white noise, 3 in-run biases, 4 noise of measurements, 5 satellites; a
    change in one leaves the others as they were.
    """
    child = [np.random.SeedSequence(seed, spawn_key=(int(run), c)) for c in range(6)]
    drawn = scenario.errors.draw(np.random.default_rng(child[0]))
    streams = np.concatenate([c.generate_state(4, np.uint64) for c in child[2:5]])
    P, nav = scenario.initial.P, scenario.initial.nav
    start_rng = np.random.default_rng(child[1])
    dx = _drawn(P[:9, :9], start_rng)
    C = frames.C_en(nav.llh)
    start = NavState(
        nav.t,
        nav.r_eb_e + C @ dx[6:9],
        nav.v_eb_e + C @ dx[3:6],
        rotation.quat_multiply(rotation.quat_from_rotvec(C @ dx[0:3]), nav.q_eb),
    )
    parameters, ranges, shown = scenario.initial.parameters, None, scenario.layout.visible
    if scenario.aiding.sky is not None:
        ranges = scenario.aiding.sky.draw(scenario.aiding.schedule.kind, np.random.default_rng(child[5]))
        at = clock_places(shown)
        parameters = parameters.copy()
        parameters[at] = ranges.clock_states(shown, [nav.t])[0] + _drawn(P[np.ix_(at + 9, at + 9)], start_rng)
    return Draws(
        InitialState(start, P, parameters), drawn.constants, true_parameters(shown, drawn.constants), drawn.starts,
        drawn.slopes, streams, ranges,
    )  # fmt: skip


def clock_places(layout: StateLayout) -> IntArray:
    """Places of the receiver's clock states among the parameters. Shape (c,)."""
    return np.array([layout[name].start - 9 for name in clock_blocks(layout)], dtype=np.int64)


def _drawn(P: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Errors of a covariance; by a square root that also exists for a state known exactly."""
    values, vectors = np.linalg.eigh(P)
    dx: FloatArray = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(P)))
    return dx
