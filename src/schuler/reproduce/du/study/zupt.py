"""Zero-velocity filters of an IMU on a turntable: what becomes observable by rotation, and by a tilt with it.

Du's twelve states are velocity, attitude and the biases; the engine carries position besides, which rest does not show
and which acts on nothing within minutes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import zero_velocity
from schuler.filtering.states import StateLayout
from schuler.mechanization.strapdown import NavState
from schuler.navigation.result import NavigationResult
from schuler.plotting.table import Cell, ResultTable
from schuler.recording.series import Increments
from schuler.reproduce.du.study.imus import FILTER_IMUS, FilterImu
from schuler.reproduce.du.study.tables import ANCHORS
from schuler.rotary.du_axes import du_axis, swap_vector
from schuler.rotary.rotating_imu import RotatingMotion, ideal_rotating_imu
from schuler.rotary.schedule import Schedule
from schuler.rotary.schemes import continuous, fixed
from schuler.simulation.imu import IdealImu
from schuler.simulation.motion import StaticMotion
from schuler.units import DEG, DEG_PER_HR

#: Latitude, longitude [rad] and height [m] of the anchors.
PLACE = np.array([45.75 * DEG, 0.0, 0.0])
#: Rotation on the table in chapter 5, both IMUs. [rad/s]
TABLE_RATE = 10.0 * DEG
SIGMA_ZUPT = 0.01  # [m/s]
_HALF_DIGIT = 5e-4  # of the anchors of accelerometer biases [m/s^2]


@dataclass(frozen=True)
class TableCase:
    """An IMU at rest on a turntable.

    Attributes
    ----------
    axis : {"X", "Y", "Z"} or None
        Du's rotation axis; None for the conventional IMU.
    tilt_deg : float
        Pitch of the frame that carries the rotation axis.
    duration_s : float
    """

    axis: Literal["X", "Y", "Z"] | None = None
    tilt_deg: float = 0.0
    duration_s: float = 300.0

    @property
    def name(self) -> str:
        """For tables."""
        if self.axis is None:
            return "conventional" + (f", tilt {self.tilt_deg:g}" if self.tilt_deg else "")
        return f"{self.axis}, {'pitch' if self.axis == 'Y' else 'tilt'} {self.tilt_deg:g}"

    @property
    def schedule(self) -> Schedule:
        """Schedule of the platform."""
        return fixed() if self.axis is None else continuous(du_axis(self.axis), TABLE_RATE)

    @property
    def motion(self) -> RotatingMotion:
        """Motion of the IMU; the vehicle points north."""
        return RotatingMotion(
            StaticMotion(PLACE, np.array([0.0, self.tilt_deg * DEG, 0.0]), self.duration_s), self.schedule
        )

    def ideal(self, rate_hz: float = 100.0) -> IdealImu:
        """Readings of a perfect IMU."""
        return ideal_rotating_imu(self.motion, rate_hz)


#: Conventional, Y and Z rotation, level and tilted by 30 deg.
CASES = (
    TableCase(),
    TableCase("Y"),
    TableCase("Y", 30.0),
    TableCase("Z"),
    TableCase("Z", 30.0),
)


def table_start(ideal: IdealImu, layout: StateLayout) -> InitialState:
    """True state with the anchors' uncertainties: 1 deg about every axis, 0.01 m/s, 1 m."""
    true = ideal.truth
    nav = NavState(float(ideal.t[0]), true.r_eb_e[0], true.v_eb_e[0], true.q_eb[0])
    return InitialState.from_sigmas(nav, layout, attitude=[DEG] * 3, velocity=[SIGMA_ZUPT] * 3, position=[1.0] * 3)


@dataclass(frozen=True)
class ZuptSigmas:
    """Standard deviations that a zero-velocity filter claims over time, Du's axes.

    Attributes
    ----------
    imu : str
    case : TableCase
    t : ndarray, shape (k,)
        [s]
    tilt : ndarray, shape (k, 2)
        About east and north. [rad]
    azimuth : ndarray, shape (k,)
        [rad]
    b_a, b_g : ndarray, shape (k, 3)
        Biases x, y, z of the IMU (right, forward, up). [m/s^2], [rad/s]
    """

    imu: str
    case: TableCase
    t: FloatArray
    tilt: FloatArray
    azimuth: FloatArray
    b_a: FloatArray
    b_g: FloatArray

    def values(self) -> dict[str, float]:
        """The last ones, in the units of the anchors."""
        return {
            "tilt_e_deg": float(self.tilt[-1, 0] / DEG),
            "tilt_n_deg": float(self.tilt[-1, 1] / DEG),
            "azimuth_deg": float(self.azimuth[-1] / DEG),
            "b_x_m_s2": float(self.b_a[-1, 0]),
            "b_y_m_s2": float(self.b_a[-1, 1]),
            "d_x_deg_hr": float(self.b_g[-1, 0] / DEG_PER_HR),
            "d_y_deg_hr": float(self.b_g[-1, 1] / DEG_PER_HR),
            "d_z_deg_hr": float(self.b_g[-1, 2] / DEG_PER_HR),
        }


def zupt_sigmas(imu: FilterImu, case: TableCase) -> ZuptSigmas:
    """Covariance of a zero-velocity filter along the true motion: once a second, 0.01 m/s.

    Parameters
    ----------
    imu : FilterImu
        Its :attr:`~schuler.reproduce.du.study.imus.FilterImu.layout` is what the filter believes.
    case : TableCase

    References
    ----------
    Du (2015), section 5.4; uncertainties are ours: the thesis does not state them.
    """
    ideal, layout = case.ideal(), imu.layout
    increments = Increments(ideal.t[1:], np.diff(ideal.t), ideal.gyro, ideal.accel)
    rests = zero_velocity(np.arange(1.0, case.duration_s + 0.5), SIGMA_ZUPT)
    forward = run(increments, rests, table_start(ideal, layout), layout, *imu.psd, FilterOptions(record_s=1.0))
    result = NavigationResult.from_run(forward, rests.t, rests.kind, layout)
    psi = result.sigma("dpsi")
    return ZuptSigmas(
        imu.name, case, result.t, psi[:, [1, 0]], psi[:, 2],
        np.abs(swap_vector(result.sigma("b_a"))), np.abs(swap_vector(result.sigma("b_g"))),
    )  # fmt: skip


@dataclass(frozen=True)
class ZuptStudy:
    """Zero-velocity filters of several cases.

    Attributes
    ----------
    sigmas : tuple of ZuptSigmas
    """

    sigmas: tuple[ZuptSigmas, ...]

    def of(self, imu: str, axis: str | None, tilt_deg: float = 0.0) -> ZuptSigmas:
        """One of them."""
        for s in self.sigmas:
            if (s.imu, s.case.axis, s.case.tilt_deg) == (imu, axis, tilt_deg):
                return s
        raise InputError(f"no case {imu}, {axis}, {tilt_deg:g} deg here; there are "
                         + "; ".join(f"{s.imu}, {s.case.name}" for s in self.sigmas))  # fmt: skip

    def cells(self) -> list[tuple[str, str, str, float, float | None]]:
        """IMU, case, quantity, our value, the check's: every number that has an anchor, or None beside it.

        An anchor that is an upper bound is negative.
        """
        cells: list[tuple[str, str, str, float, float | None]] = []
        for s in self.sigmas:
            anchor = ANCHORS.get((s.imu, s.case.axis, s.case.tilt_deg))
            given: Sequence[float | None] = [None] * 8
            if anchor is not None:
                given = [*anchor.tilt_deg, anchor.azimuth_deg, *anchor.b_m_s2, *anchor.d_deg_hr]
            for (name, ours), theirs in zip(s.values().items(), given, strict=True):
                cells.append((s.imu, s.case.name, name, ours, theirs))
        return cells

    def table(self) -> ResultTable:
        """One row a case."""
        rows: list[tuple[Cell, ...]] = [(s.imu, s.case.name, *s.values().values()) for s in self.sigmas]
        names = tuple(self.sigmas[0].values()) if self.sigmas else ()
        return ResultTable(
            "Zero-velocity filter on a turntable: 1-sigma at the end", ("imu", "case", *names), tuple(rows),
            ("axes of Du: x right, y forward, z up; tilt about east and north",),
        )  # fmt: skip

    def comparison(self) -> ResultTable:
        """Every cell beside the check's anchor; it agrees within 20 % or half of the last digit printed."""
        rows: list[tuple[Cell, ...]] = []
        for imu, case, quantity, ours, theirs in self.cells():
            if theirs is not None:
                bound = theirs < 0.0
                text = f"< {-theirs:g}" if bound else f"{theirs:g}"
                half = _HALF_DIGIT if quantity.startswith("b_") else 0.0
                agrees = ours < -theirs + half if bound else abs(ours - theirs) <= max(0.2 * theirs, half)
                rows.append((imu, case, quantity, text, ours, None if bound else ours / theirs, agrees))
        return ResultTable(
            "Anchors of the zero-velocity filter",
            ("imu", "case", "quantity", "check", "ours", "ratio", "agrees"),
            tuple(rows),
            ("the check has accelerometer biases to 0.001 m/s^2",),
        )

    def summary(self) -> str:
        """The table as text."""
        return self.table().summary()

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return self.table().to_dict()


def zupt_study(imus: Sequence[str] = ("MTi-G", "NAV440"), cases: Sequence[TableCase] = CASES) -> ZuptStudy:
    """Covariances of all cases.

    Parameters
    ----------
    imus : sequence of str
        Names in :data:`~schuler.reproduce.du.study.imus.FILTER_IMUS`.
    cases : sequence of TableCase
    """
    unknown = [name for name in imus if name not in FILTER_IMUS]
    if unknown:
        raise InputError(f"imu: expected one of {', '.join(FILTER_IMUS)}, got {unknown[0]!r}")
    return ZuptStudy(tuple(zupt_sigmas(FILTER_IMUS[name], case) for name in imus for case in cases))
