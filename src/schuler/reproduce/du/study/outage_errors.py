"""NEES in an outage by what is called the error: tells second order of large tilts from a filter that is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from schuler import frames
from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.earth import gravity_ned
from schuler.exceptions import InputError
from schuler.filtering.engine import run as filtered
from schuler.montecarlo.lanes.replay import replay
from schuler.navigation.evaluation.consistency import state_errors
from schuler.navigation.result import NavigationResult
from schuler.plotting.table import Cell, ResultTable
from schuler.reproduce.du.study.imus import FilterImu
from schuler.reproduce.du.study.integrated import IntegratedDrive, rotary_schedule

Definition = Literal["states", "no vertical", "less sag", "extended pose"]
DEFINITIONS: tuple[Definition, ...] = ("states", "no vertical", "less sag", "extended pose")


def extended_pose_errors(error: ArrayLike) -> FloatArray:
    """Errors of velocity and position seen from half way between the estimated and the true attitude.

    The filter turns its covariance with the **estimated** specific force, which is off by the attitude error. With
    ``dv + dpsi x dv / 2 + ...`` instead of ``dv``, and position likewise, an error that only gravity carries on stays
    on the straight line that the transition draws, however large it is. Equal to the states to first order.

    Parameters
    ----------
    error : array_like, shape (..., n)
        dpsi, dv, dr, then parameters, estimate minus truth, all in the same axes, any but the body's.
        [rad], [m/s], [m]

    Returns
    -------
    ndarray, shape (..., n)
        For the covariance as it is.

    Raises
    ------
    InputError
        If there are fewer than nine states.

    References
    ----------
    Barrau and Bonnabel (2017), "The invariant extended Kalman filter as a stable observer", logarithm of the error in
    SE_2(3); Brossard et al. (2022), "Associating uncertainty to extended poses". Left and right errors differ by a
    linear map that the covariance undergoes as well, so that it does not matter which, nor where the origin is: with
    the covariance along the estimate what remains is ``J(-dpsi)^-1`` of the differences, J the left Jacobian of SO(3).
    """
    e = as_floats(error, "error").copy()
    if e.shape[-1] < 9:
        raise InputError(f"error: expected dpsi, dv, dr and parameters along the last axis, got shape {e.shape}")
    psi = e[..., 0:3]
    angle = np.linalg.norm(psi, axis=-1, keepdims=True)
    half = 0.5 * np.maximum(angle, 1e-3)
    c = np.where(angle < 1e-3, 1.0 / 12.0, (1.0 - half / np.tan(half)) / (4.0 * half**2))
    for o in (3, 6):
        once = np.cross(psi, e[..., o : o + 3])
        e[..., o : o + 3] += 0.5 * once + c * np.cross(psi, once)
    return e


@dataclass(frozen=True, eq=False)
class OutageErrors:
    """Errors of many runs in an outage, with their whole covariances.

    Attributes
    ----------
    drive : IntegratedDrive
    t : ndarray, shape (k,)
        [s]
    error : ndarray, shape (n, k, s)
        By run, record and state; estimate minus truth, north, east, down.
    P : ndarray, shape (n, k, s, s)
    sag : ndarray, shape (n, k, 2)
        Second order of tilt since the last fix in down velocity and position: what the filter's transition gets wrong,
        ``-g tilt**2 / 2`` integrated once and twice. [m/s], [m]
    """

    drive: IntegratedDrive
    t: FloatArray
    error: FloatArray
    P: FloatArray
    sag: FloatArray

    @classmethod
    def of(
        cls,
        drive: IntegratedDrive,
        runs: int | Sequence[int],
        *,
        outage: int = 0,
        seed: int = 0,
        every_s: float = 5.0,
    ) -> OutageErrors:
        """Run a drive through the engine, as runs in lanes do not keep covariances.

        Parameters
        ----------
        drive : IntegratedDrive
        runs : int or sequence of int
            Numbers as in :meth:`schuler.reproduce.du.study.outages.DriveRuns.of`: the same errors.
        outage : int
            Which of the drive's.
        seed : int
        every_s : float
            Spacing, whole seconds. [s]

        Raises
        ------
        InputError
            If there is no such outage or no run.
        """
        if not 0 <= outage < len(drive.outages):
            raise InputError(f"outage: the drive has {len(drive.outages)}, counted from 0; got {outage}")
        numbers = range(runs) if isinstance(runs, int | np.integer) else runs
        if len(numbers) == 0:
            raise InputError("runs: expected at least one")
        start, stop = drive.outages[outage]
        results = [_one(drive, int(k), seed, start, stop, max(1, round(every_s))) for k in numbers]
        error, P, sag = (np.array([x[i] for x in results]) for i in (1, 2, 3))
        return cls(drive, results[0][0], error, P, sag)

    def nees(self, definition: Definition = "states") -> FloatArray:
        """Normalised errors squared per degree of freedom, shape (n, k).

        Parameters
        ----------
        definition : {"states", "no vertical", "less sag", "extended pose"}
            All states as the filter has them, to which its covariance belongs to first order; without down velocity
            and position; with :attr:`sag` taken off, which needs the true tilt; or :func:`extended_pose_errors`.
        """
        e, P = self.error, self.P
        if definition == "no vertical":
            kept = [i for i in range(e.shape[-1]) if i not in (5, 8)]
            e, P = e[..., kept], P[..., kept, :][..., kept]
        elif definition == "less sag":
            e = e.copy()
            e[..., [5, 8]] -= self.sag
        elif definition == "extended pose":
            e = extended_pose_errors(e)
        elif definition != "states":
            raise InputError(f"definition: expected one of {', '.join(DEFINITIONS)}, got {definition!r}")
        z = np.linalg.solve(P, e[..., None])[..., 0]
        return np.asarray(np.einsum("nki,nki->nk", e, z) / e.shape[-1])


def second_order_table(
    imu: FilterImu,
    runs: int = 200,
    *,
    sizes: Sequence[float] = (1.0, 0.5, 0.25, 0.125),
    drive: IntegratedDrive | None = None,
    outage: int = 0,
    seed: int = 0,
) -> ResultTable:
    """NEES in an outage against the size of all errors, by definition; a row for each size and schedule.

    Parameters
    ----------
    imu : FilterImu
    runs : int
        The same luck at all sizes.
    sizes : sequence of float
        See :class:`~schuler.reproduce.du.study.integrated.IntegratedDrive`.
    drive : IntegratedDrive, optional
        Everything else; its IMU, schedule, truth and size are replaced.
    outage, seed : int
    """
    given = IntegratedDrive(imu, truth="filter") if drive is None else replace(drive, imu=imu, truth="filter")
    rows: list[tuple[Cell, ...]] = []
    for schedule in (None, rotary_schedule(imu)):
        for size in sizes:
            e = OutageErrors.of(replace(given, schedule=schedule, size=size), runs, outage=outage, seed=seed)
            values = [float(e.nees(definition).mean()) for definition in DEFINITIONS]
            rows.append((imu.name, e.drive.name, float(size), *values))
    return ResultTable(
        f"{imu.name}: NEES per degree of freedom in outage {outage + 1}, sensors of the filter's own models",
        ("imu", "imu_is", "size", "states", "no_vertical", "less_sag", "extended_pose"),
        tuple(rows),
        (f"mean over {runs} runs; errors and what the filter believes of them are `size` times the IMU's",),
    )


def _one(
    drive: IntegratedDrive, run: int, seed: int, start: float, stop: float, every: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Times, errors, covariances and sag of one run."""
    scenario, layout = drive.scenario, drive.scenario.layout
    data = replay(scenario, run, seed=seed)
    options = replace(scenario.options, record_s=1.0, output_rate_hz=1.0)
    forward = filtered(
        data.increments, data.schedule, data.initial, layout, scenario.gyro_psd, scenario.accel_psd, options
    )
    result = NavigationResult.from_run(forward, data.schedule.t, data.schedule.kind, layout, outages=drive.outages)
    samples = np.minimum(np.searchsorted(data.increments.t, result.t - 1e-6), len(data.increments.t) - 1)
    t, dx, P = state_errors(result, scenario.ideal.truth, data.parameters[samples])
    # from the last fix on, so that the sag is there from its beginning
    inside = (t > start - 1.0 - 1e-6) & (t < stop - 1e-6)
    t, dx, P = t[inside], dx[inside], P[inside]
    llh = frames.llh_from_ecef(scenario.ideal.truth.at(t).r_eb_e)
    T = np.zeros_like(P)
    for o in (0, 3, 6):
        T[:, o : o + 3, o : o + 3] = np.swapaxes(frames.C_en(llh), 1, 2)
    T[:, range(9, layout.size), range(9, layout.size)] = 1.0
    dx, P = np.einsum("kij,kj->ki", T, dx), T @ P @ np.swapaxes(T, 1, 2)
    g = gravity_ned(llh[:, 0], llh[:, 2])[:, 2]
    velocity = _integral(-0.5 * g * np.sum(dx[:, :2] ** 2, axis=1), t)
    sag = np.stack((velocity, _integral(velocity, t)), axis=1)
    kept = slice(every, None, every)
    return t[kept], dx[kept], P[kept], sag[kept]


def _integral(rate: FloatArray, t: FloatArray) -> FloatArray:
    """By the trapezoid rule, zero at first."""
    return np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))))
