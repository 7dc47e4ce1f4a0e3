"""Static test of a field calibration: how far an IMU at rest drifts in a minute, raw and calibrated.

A unit is drawn and turned by the routine, then lies still. Levelled by its accelerometers it navigates without any aid,
as in the source with raw data, with calibrated gyroscopes only, and fully calibrated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from schuler import frames
from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.calibration.field.options import FieldOptions
from schuler.exceptions import InputError
from schuler.mechanization.strapdown import mechanize
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.plotting.table import ResultTable
from schuler.reproduce.yaman.study.runs import PLACE, FieldJob, RestSource, processes, run_all
from schuler.reproduce.yaman.study.static_unit import VARIANTS, StaticJob, levelled, static_unit
from schuler.reproduce.yaman.study.tables import static_spec
from schuler.sensors.errors import ImuErrors
from schuler.sensors.spec import ImuSpec
from schuler.simulation.imu import ideal_imu, simulate_imu
from schuler.simulation.routine import RoutineMotion
from schuler.simulation.steps import Rest, Routine

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Progress = Callable[[float], None]
Part: TypeAlias = Literal["horizontal", "vertical", "all"]

_LEVEL_S = 10.0  # levelling before free navigation
_PARTS: dict[Part, slice] = {"horizontal": slice(0, 2), "vertical": slice(2, 3), "all": slice(0, 3)}


@dataclass(frozen=True, eq=False)
class StaticDrift:
    """Drift of many units at rest.

    Attributes
    ----------
    job : StaticJob
    unit : ndarray of int, shape (n,)
        Numbers of the units: unit k is child k of the seed.
    t : ndarray, shape (k,)
        Time since the last aid. [s]
    error : ndarray, shape (n, 3, k, 3)
        Position estimate minus truth by unit, variant (:data:`VARIANTS`), time; north, east, down. [m]
    covariance : ndarray, shape (n, k, 3, 3)
        Covariance of the fully calibrated one, predicted from the covariance of the calibration, levelling and noise.
        [m^2]
    failed : tuple of (int, str)
        Units without a calibration, and why.
    seconds : float
        What it took. [s]
    complete : bool
        False if it was interrupted.
    """

    job: StaticJob
    unit: IntArray
    t: FloatArray
    error: FloatArray
    covariance: FloatArray
    failed: tuple[tuple[int, str], ...] = ()
    seconds: float = 0.0
    complete: bool = True

    def __len__(self) -> int:
        return len(self.unit)

    @property
    def sigma(self) -> FloatArray:
        """Predicted 1-sigma north, east, down of the fully calibrated one. Shape (n, k, 3). [m]"""
        return np.asarray(np.sqrt(np.einsum("nkii->nki", self.covariance)))

    @property
    def nees(self) -> FloatArray:
        """Normalised squared position error at the end, fully calibrated, per degree of freedom. Shape (n,)."""
        e = self.error[:, 2, -1]
        return np.asarray(np.einsum("ni,ni->n", e, np.linalg.solve(self.covariance[:, -1], e[:, :, None])[:, :, 0]) / 3)

    def within(self, sigmas: float = 3.0) -> BoolArray:
        """Components that end within so many predicted sigma. Shape (n, 3)."""
        return np.asarray(np.abs(self.error[:, 2, -1]) <= sigmas * self.sigma[:, -1])

    def drift(self, variant: str, part: Part = "all") -> FloatArray:
        """Size of the position error over time. Shape (n, k). [m]"""
        if variant not in VARIANTS or part not in _PARTS:
            raise InputError(
                f"expected a variant of {VARIANTS} and a part of {tuple(_PARTS)}, got {variant!r}, {part!r}"
            )
        return np.asarray(np.linalg.norm(self.error[:, VARIANTS.index(variant), :, _PARTS[part]], axis=2))

    def improvement(self, part: Part = "all", variant: str = "full") -> FloatArray:
        """Drift of the raw unit over that of a calibrated one at the end. Shape (n,)."""
        return np.asarray(self.drift("raw", part)[:, -1] / self.drift(variant, part)[:, -1])

    def table(self) -> ResultTable:
        """Median and quartiles over the units at the end, and the gain over raw."""
        rows = []
        for part in _PARTS:
            for variant in VARIANTS:
                low, middle, high = np.percentile(self.drift(variant, part)[:, -1], [25, 50, 75])
                gain = np.percentile(self.improvement(part, variant), [25, 50, 75])
                variance = np.einsum("nii->ni", self.covariance[:, -1])[:, _PARTS[part]].sum(axis=1)
                claimed = float(np.sqrt(np.median(variance))) if variant == "full" else None
                rows.append(
                    (
                        part,
                        variant,
                        float(middle),
                        float(low),
                        float(high),
                        claimed,
                        *(float(g) for g in gain[[1, 0, 2]]),
                    )
                )
        low, high = chi_square_band(3, len(self))
        notes = [
            f"NEES of the calibrated position per degree of freedom {float(self.nees.mean()):.3f}, 95 % band {low:.3f} "
            f"to {high:.3f}; {int(self.within().sum())} of {self.within().size} components within 3 sigma",
        ]
        if self.failed:
            notes.append(f"{len(self.failed)} units failed; unit {self.failed[0][0]}: {self.failed[0][1]}")
        return ResultTable(
            f"At rest for {self.t[-1]:.0f} s, {self.job.field.spec.name}, {len(self)} units",
            (
                "part", "variant", "median_m", "quarter_m", "three_quarters_m", "claimed_m", "gain_median",
                "gain_quarter", "gain_three_quarters",
            ),
            tuple(rows), tuple(notes), self.complete,
        )  # fmt: skip

    def curves(self, part: Part = "all") -> ResultTable:
        """Median and quartiles of the drift over time, by variant, and the median predicted sigma: for a figure."""
        quartiles = [np.percentile(self.drift(v, part), [25, 50, 75], axis=0).T for v in VARIANTS]
        sigma = np.sqrt(np.median(np.sum(self.sigma[:, :, _PARTS[part]] ** 2, axis=2), axis=0))
        columns = [f"{v}_{q}_m" for v in VARIANTS for q in ("quarter", "median", "three_quarters")]
        values = np.column_stack((self.t, *quartiles, sigma))
        return ResultTable(
            f"Drift at rest, {part}, {self.job.field.spec.name}", ("t_s", *columns, "full_claimed_m"),
            tuple(tuple(row) for row in values.tolist()), (), self.complete,
        )  # fmt: skip

    def plot(self, **options: Any) -> Figure:
        """Drift over time, raw and calibrated (matplotlib), see
        :mod:`schuler.reproduce.yaman.study.figures`.
        """
        from schuler.reproduce.yaman.study.figures import static_figure

        return static_figure(self, **options)

    def summary(self) -> str:
        """The table as text."""
        return self.table().summary()

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return self.table().to_dict()

    def to_csv(self, path: Path | str) -> Path:
        """Write one row for each unit, variant and time: error north, east, down, and what was predicted. [m]"""
        rows = [
            (
                int(unit), variant, float(t), *self.error[i, j, k].tolist(),
                *(self.sigma[i, k].tolist() if variant == "full" else (None, None, None)),
            )
            for i, unit in enumerate(self.unit) for j, variant in enumerate(VARIANTS) for k, t in enumerate(self.t)
        ]  # fmt: skip
        columns = (
            "unit",
            "variant",
            "t_s",
            "north_m",
            "east_m",
            "down_m",
            "sigma_north_m",
            "sigma_east_m",
            "sigma_down_m",
        )
        return ResultTable("static test", columns, tuple(rows)).to_csv(path)


def static_drift(
    imu: str | ImuSpec,
    units: int,
    *,
    seed: int = 1,
    seconds: float = 60.0,
    level_s: float = 10.0,
    routine: Routine | None = None,
    options: FieldOptions | None = None,
    rests: RestSource = "found",
    rate_hz: float = 100.0,
    workers: int | None = None,
    progress: Progress | None = None,
) -> StaticDrift:
    """Draw units, calibrate each in the field, let each navigate at rest without aid.

    Parameters
    ----------
    imu : str or ImuSpec
        ``MPU-6000``, ``VN-200``, ``MTi-G-710`` as the source had them (:func:`.field_tables.static_spec`), any other
        entry of the catalogue, or a specification.
    units : int
    seed : int
    seconds, level_s : float
        Free navigation; levelling before it. [s]
    routine, options, rests, rate_hz, workers, progress
        As for :func:`.field_campaign.field_campaign`.

    Returns
    -------
    StaticDrift
        On Ctrl-C the units that were finished, at least one.

    Raises
    ------
    InputError
        If an argument is out of range or no unit could be calibrated.

    Notes
    -----
    The unit stays switched on: biases are those of the routine, wandering as specified. It rests as the routine leaves
    it. Roll and pitch come from the mean specific force, raw for "raw" and "gyro", calibrated for "full": a horizontal
    bias hides in the tilt, so that it is the vertical one and the gyroscopes that show. Heading is told, wrong by the
    same draw as in the calibration. The predicted covariance is that of the filter without measurements, started from
    the calibration's covariance and the levelling that follows from it.

    References
    ----------
    Yaman (2017), section 6.2.1, figures 6.8, 6.11, 6.12; levelling section 6.2.1.1.
    """
    if units < 1 or not (seconds >= 1.0 and level_s > 0.0):
        raise InputError(f"expected a unit or more, seconds >= 1, level_s > 0; got {units}, {seconds!r}, {level_s!r}")
    spec = static_spec(imu) if isinstance(imu, str) else imu
    given: dict[str, Any] = {} if routine is None else {"routine": routine}
    field = FieldJob(spec, options=options or FieldOptions(), rests=rests, rate_hz=rate_hz, **given)
    job = StaticJob(field, level_s, seconds)
    begin = perf_counter()
    done, failed, complete = run_all(partial(static_unit, job), seed, units, processes(workers, units), 1, progress)
    if not done:
        raise InputError(f"{spec.name}: no unit could be calibrated; unit {failed[0][0]}: {failed[0][1]}")
    order = sorted(done)
    return StaticDrift(
        job, np.array(order), done[order[0]].t, np.array([done[k].error for k in order]),
        np.array([done[k].covariance for k in order]), tuple(sorted(failed)), perf_counter() - begin, complete,
    )  # fmt: skip


def rest_drift(
    errors: ImuErrors,
    seconds: float = 60.0,
) -> FloatArray:
    """Position error of free navigation at rest and level.

    Parameters
    ----------
    errors : ImuErrors
        Constant; noise, if there is any, is drawn from a fixed seed.
    seconds : float
        Free navigation; levelling by the mean specific force over ten seconds before it. [s]

    Returns
    -------
    ndarray, shape (3,)
        Estimate minus truth at the end: north, east, down. [m]

    Raises
    ------
    InputError
        If the time is not positive.

    Notes
    -----
    A vertical acceleration error b sinks by ``b t^2 / 2``, a horizontal rate b moves by ``g b t^3 / 6``, a horizontal
    acceleration error hides in the tilt.

    References
    ----------
    Yaman (2017), section 6.2.1: roll and pitch by levelling, heading as told (here north).
    """
    if not seconds > 0.0:
        raise InputError(f"rest_drift: expected a positive time, got {seconds!r} s")
    llh = np.array(PLACE)
    ideal = ideal_imu(RoutineMotion(Routine((Rest(_LEVEL_S + seconds),)), llh), 100.0)
    imu = simulate_imu(ideal, errors, np.random.default_rng(0)).imu
    nav = levelled(imu, llh, 0.0, _LEVEL_S)
    track = mechanize(imu.increments().between(nav.t, np.inf), nav)
    return np.asarray((track.r_eb_e[-1] - frames.ecef_from_llh(llh)) @ frames.C_en(llh))
