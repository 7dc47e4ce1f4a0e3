"""GNSS with a rotating and a conventional IMU over one drive: what all runs of a comparison share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout, StateModel
from schuler.mechanization.strapdown import NavState
from schuler.montecarlo.lanes.aiding import true_gnss
from schuler.montecarlo.lanes.errors import LaneErrors
from schuler.montecarlo.lanes.scenario import LaneScenario
from schuler.reproduce.du.study.drives import LENGTH_S, OUTAGES_S, long_drive
from schuler.reproduce.du.study.imus import FilterImu
from schuler.rotary.du_axes import du_axis
from schuler.rotary.rotating_imu import RotatingMotion, ideal_rotating_imu
from schuler.rotary.schedule import Schedule
from schuler.rotary.schemes import continuous, fixed
from schuler.simulation.gnss import GnssModel
from schuler.simulation.imu import IdealImu
from schuler.simulation.motion import Motion
from schuler.units import DEG, DEG_PER_HR

Model = Literal["walk", "gauss-markov", "augmented"]
Truth = Literal["unit", "filter"]

#: 1-sigma of the start, north, east, down, as SPAN's alignment: attitude, velocity, position. [rad], [m/s], [m]
START = (np.array([0.1, 0.1, 0.5]) * DEG, np.full(3, 0.02), np.full(3, 0.05))
_LEFT = 50.0 * DEG_PER_HR  # of the gyroscope biases after the mean at rest, 1-sigma


@dataclass(frozen=True)
class IntegratedDrive:
    """A loosely coupled drive that is run many times.

    Attributes
    ----------
    imu : FilterImu
    schedule : Schedule, optional
        Schedule of the platform; None for the conventional IMU.
    outages : tuple of (start, stop)
        [s]
    length_s : float
    model : {"walk", "gauss-markov", "augmented"}
        Biases in the filter: random walks from their uncertainty at first, or Du's Gauss-Markov processes, which forget
        what they know of a constant with their correlation time. Augmented: random walks with the scale factors and
        cross-couplings of the gyroscopes besides, 24 states.
    truth : {"unit", "filter"}
        Sensors of the runs: units of the specification with scale factors and cross-couplings that the filter does not
        have; or exactly what the filter believes, for tests of consistency.
    layout : StateLayout, optional
        Instead of the IMU's, e.g. of :func:`schuler.reproduce.du.study.gauss_markov.static_models`.
    motion : Motion, optional
        Motion of the vehicle; default :func:`~schuler.reproduce.du.study.drives.long_drive`.
    size : float
        Noises, biases, errors at the start and of GNSS are this many times the IMU's, and the filter is told: what is
        left of a NEES above one as this goes to zero is a defect, what vanishes with its square is of second order.
        Only for truth "filter".
    """

    imu: FilterImu
    schedule: Schedule | None = None
    outages: tuple[tuple[float, float], ...] = OUTAGES_S
    length_s: float = LENGTH_S
    model: Model = "walk"
    truth: Truth = "unit"
    layout: StateLayout | None = None
    motion: Motion | None = None
    size: float = 1.0

    def __post_init__(self) -> None:
        if self.model not in ("walk", "gauss-markov", "augmented") or self.truth not in ("unit", "filter"):
            raise InputError(
                "expected model 'walk', 'gauss-markov' or 'augmented' and truth 'unit' or 'filter', got "
                f"{self.model!r}, {self.truth!r}"
            )
        if not (np.isfinite(self.size) and self.size > 0.0) or (self.size != 1.0 and self.truth != "filter"):
            raise InputError(
                f"size: expected a positive number, and truth 'filter' unless it is 1; got {self.size!r}, "
                f"{self.truth!r}"
            )
        for start, stop in self.outages:
            if not 0.0 <= start < stop <= self.length_s:
                raise InputError(f"an outage must lie within the drive of {self.length_s:g} s, got {start}..{stop} s")

    @property
    def name(self) -> str:
        """For tables."""
        return "conventional" if self.schedule is None else "rotary"

    @property
    def states(self) -> StateLayout:
        """Sensor states of the filter, scaled with the drive's size.

        Gyroscope biases start with what the mean at rest leaves and what the platform's rate adds through scale factor
        and cross-coupling, the same for the conventional IMU; without the latter where these are states.
        """
        layout = self._full_size() if self.layout is None else self.layout
        if self.size == 1.0:
            return layout
        k = self.size
        return StateLayout(
            {name: replace(m, sigma=k * m.sigma, noise=k * m.noise) for name, m in layout.models.items()}
        )

    def _full_size(self) -> StateLayout:
        gyro, accel = self.imu.spec.gyro, self.imu.spec.accel
        turning = self.imu.rate * float(np.hypot(gyro.misalignment, gyro.scale_factor))
        if self.model == "augmented":
            turning = 0.0
        first = {"b_a": accel.turn_on_bias, "b_g": float(np.hypot(_LEFT, turning))}
        models = {}
        for name, triad in (("b_a", accel), ("b_g", gyro)):
            if self.model == "gauss-markov":
                models[name] = StateModel.gauss_markov(triad.in_run_bias, triad.in_run_time, first[name])
            else:
                noise = triad.in_run_bias * float(np.sqrt(2.0 / triad.in_run_time))
                models[name] = StateModel.random_walk(float(np.hypot(first[name], triad.in_run_bias)), noise)
        if self.model == "augmented":
            models["S_g"] = StateModel.constant(gyro.scale_factor)
            models["M_g"] = StateModel.constant(gyro.misalignment)
        return StateLayout(models)

    @cached_property
    def vehicle(self) -> Motion:
        """Motion of the vehicle."""
        return long_drive(self.length_s) if self.motion is None else self.motion

    @cached_property
    def scenario(self) -> LaneScenario:
        """For :func:`schuler.montecarlo.lanes.run.run_lanes`. The antenna stands over the axis of the platform."""
        rate_hz = self.imu.spec.rate_hz or 100.0
        if self.motion is None:
            ideal = _long_ideal(self.length_s, self.schedule, rate_hz)
        else:
            ideal = ideal_rotating_imu(RotatingMotion(self.vehicle, self.schedule or fixed()), rate_hz)
        layout, k = self.states, self.size
        sigma = (k * self.imu.sigma_gnss,) * 3
        true = ideal.truth
        nav = NavState(0.0, true.r_eb_e[0], true.v_eb_e[0], true.q_eb[0])
        start = InitialState.from_sigmas(
            nav, layout, attitude=k * START[0], velocity=k * START[1], position=k * START[2]
        )
        rate = ideal.rate_hz
        if self.truth == "filter":
            gyro, accel = (np.full(3, k * t.random_walk) for t in (self.imu.spec.gyro, self.imu.spec.accel))
            errors = LaneErrors.of_layout(layout, gyro, accel, rate)
        else:
            spec = replace(self.imu.spec, gyro=replace(self.imu.spec.gyro, turn_on_bias=_LEFT))
            errors = LaneErrors.of_spec(spec, rate, len(ideal.gyro))
        gnss = GnssModel(sigma_position=sigma, sigma_velocity=sigma, first_s=1.0)
        aids = true_gnss(self.vehicle, gnss, gate=None).without(self.outages)
        gyro_psd, accel_psd = (k**2 * x for x in self.imu.psd)
        return LaneScenario(
            ideal, errors, aids, layout, start, gyro_psd, accel_psd, FilterOptions(record_s=1.0), ("all", "navigation")
        )

    def yaw(self, t: FloatArray) -> FloatArray:
        """True heading of the vehicle. Shape (n,). [rad]"""
        heading: FloatArray = self.vehicle.state(t).rpy_nb[:, 2]
        return heading


@lru_cache(maxsize=3)
def _long_ideal(length_s: float, schedule: Schedule | None, rate_hz: float) -> IdealImu:
    """Perfect recording of the usual drive: most of the time of a short campaign, the same with and without outages."""
    return ideal_rotating_imu(RotatingMotion(long_drive(length_s), schedule or fixed()), rate_hz)


@lru_cache(maxsize=4)
def rotary_schedule(imu: FilterImu) -> Schedule:
    """Du's: continuous about Z (up) at the recommended rate, from the start."""
    return continuous(du_axis("Z"), imu.rate)
