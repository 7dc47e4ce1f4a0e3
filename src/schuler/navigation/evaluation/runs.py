"""Runs side by side, of ours or of other programs: errors along and across the track, bounds, overlay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import FileFormatError, InputError, SchulerError
from schuler.files import check_log
from schuler.navigation.evaluation.errors import TrajectoryErrors, trajectory_errors
from schuler.plotting.notebook import Displayed
from schuler.plotting.table import ResultTable, TabularResult
from schuler.recording.io.own import time_from
from schuler.recording.trajectory import Trajectory
from schuler.timebase import TimeBase

#: Below this a course is noise, and there is no along and across. [m/s]
MOVING = 0.5
#: Length of the pieces whose relative error is given. [m]
PIECE = 100.0
MOST = 7  # runs that can be told apart in one figure

_COLUMNS = (
    "rms_horizontal_m", "drms2_m", "cep50_m", "cep95_m", "max_horizontal_m", "rms_along_m", "rms_across_m",
    "mean_along_m", "mean_across_m", "rms_vertical_m", "max_vertical_m", "relative_per_100m_m",
    "rms_velocity_horizontal_m_s", "rms_velocity_vertical_m_s", "rms_tilt_deg", "rms_heading_deg", "coverage_percent",
)  # fmt: skip
#: Numbers that a bound may be set on.
BOUNDED = _COLUMNS[:-1]
_SHOWN = (
    "rms_horizontal_m", "drms2_m", "cep50_m", "cep95_m", "max_horizontal_m", "rms_along_m", "rms_across_m",
    "rms_vertical_m", "relative_per_100m_m", "coverage_percent",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Run:
    """A trajectory from a file.

    Attributes
    ----------
    name : str
    trajectory : Trajectory
    time : TimeBase
    point : {"imu", "antenna", ""}
        Point of the vehicle; empty where the file does not say.
    lever_arm_b : ndarray, shape (3,), or None
        From IMU to antenna, of a run of ours. [m]
    file : str
    """

    name: str
    trajectory: Trajectory
    time: TimeBase
    point: str = ""
    lever_arm_b: FloatArray | None = None
    file: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class RunComparison(TabularResult, Displayed):
    """Runs against a reference, over the time that all of them cover.

    Attributes
    ----------
    reference : str
        Name of the reference.
    against_run : bool
        The reference is the first run: the numbers are differences, not errors.
    names, files : tuple of str
    errors : tuple of TrajectoryErrors
        Of each run, at the reference's times; without those in its gaps.
    numbers : tuple of dict
        Of each run, by the names of :data:`BOUNDED`, and ``coverage_percent``; None where there is nothing to say.
    trajectories : tuple of Trajectory
        Reference first, on its clock, for figures.
    span : (float, float)
        Compared, on the reference's clock. [s]
    bounds : dict of str to float
    notes : tuple of str
    """

    reference: str
    against_run: bool
    names: tuple[str, ...]
    files: tuple[str, ...]
    errors: tuple[TrajectoryErrors, ...]
    numbers: tuple[dict[str, float | None], ...]
    trajectories: tuple[Trajectory, ...]
    span: tuple[float, float]
    bounds: dict[str, float]
    notes: tuple[str, ...] = ()

    @property
    def broken(self) -> dict[str, tuple[str, ...]]:
        """Runs beyond a bound or without that number, by bound."""
        over = {}
        for key, bound in self.bounds.items():
            runs = zip(self.names, (numbers[key] for numbers in self.numbers), strict=True)
            over[key] = tuple(name for name, value in runs if value is None or not value <= bound)
        return {key: names for key, names in over.items() if names}

    @property
    def passes(self) -> bool:
        """Whether every run keeps every bound."""
        return not self.broken

    def sentences(self) -> list[str]:
        """The best run, and each bound."""
        what = "difference" if self.against_run else "error"
        best = min(range(len(self.names)), key=lambda k: self.numbers[k]["rms_horizontal_m"] or 0.0)
        lines = [
            f"Against {self.reference}, {self.span[1] - self.span[0]:.0f} s that all cover: {self.names[best]} has the "
            f"smallest horizontal {what}, {self.numbers[best]['rms_horizontal_m']:.3g} m RMS."
        ]
        for key, bound in self.bounds.items():
            over = self.broken.get(key, ())
            kept = f"broken by {', '.join(over)}" if over else "kept by all"
            lines.append(f"{key} up to {bound:g}: {kept}.")
        return [*lines, *self.notes]

    def table(self) -> ResultTable:
        """One row a run, with all numbers."""
        rows = [(name, *(n[c] for c in _COLUMNS)) for name, n in zip(self.names, self.numbers, strict=True)]
        return ResultTable(f"Runs against {self.reference}", ("run", *_COLUMNS), tuple(rows), tuple(self.sentences()))

    def summary(self) -> str:
        """The numbers that people ask for first, then the sentences."""
        rows = [(name, *(n[c] for c in _SHOWN)) for name, n in zip(self.names, self.numbers, strict=True)]
        notes = tuple(self.sentences())
        return ResultTable(f"Runs against {self.reference}", ("run", *_SHOWN), tuple(rows), notes).summary()

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        entries = zip(self.names, self.files, self.numbers, strict=True)
        return {
            "reference": self.reference, "against_run": self.against_run, "span_s": list(self.span),
            "runs": [{"name": name, "file": file, **numbers} for name, file, numbers in entries],
            "bounds": self.bounds, "broken": {k: list(v) for k, v in self.broken.items()}, "passes": self.passes,
            "notes": list(self.notes),
        }  # fmt: skip

    def report(self, path: Path | str) -> Path:
        """Write the overlay page, see :func:`schuler.navigation.report.runs.runs_report`."""
        from schuler.navigation.report.runs import runs_report

        return runs_report(self, path)


def read_run(path: Path | str, **hints: Any) -> Run:
    """A run from its file, or from the folder that ``schuler navigate`` wrote.

    Parameters
    ----------
    path : Path or str
        Solution of ours (of a folder the smoothed one, where there is one), or any file that :func:`schuler.read`
        reads: its reference, else its fixes, which need no accuracies.
    **hints
        As of :func:`schuler.read`, such as ``origin`` for local coordinates.

    Raises
    ------
    InputError
        If the file holds no trajectory.
    """
    path = Path(path)
    check_log(path)
    name = path.stem if path.is_file() else path.resolve().name
    solutions = [path / n for n in ("smoothed.parquet", "solution.parquet") if (path / n).is_file()]
    if solutions:
        run = _own_run(solutions[0], name)
    elif path.suffix == ".parquet" and path.is_file():
        try:
            run = _own_run(
                path, name if name not in ("smoothed", "solution") else f"{path.resolve().parent.name}/{name}"
            )
        except (FileFormatError, KeyError):
            run = _foreign_run(path, name, hints)
    else:
        run = _foreign_run(path, name, hints)
    return run


def _own_run(path: Path, name: str) -> Run:
    from schuler.navigation.solution_tables import read_solution

    trajectory, meta = read_solution(path)
    entry = meta.get("provenance", {}).get("time")
    time = TimeBase() if entry is None else time_from(entry)
    arm = np.array(meta.get("lever_arm_b_m", [0.0, 0.0, 0.0]), dtype=np.float64)
    return Run(name, trajectory, time, meta.get("provenance", {}).get("point", "imu"), arm, str(path))


def _foreign_run(path: Path, name: str, hints: Mapping[str, Any]) -> Run:
    from schuler.recording.io import read

    try:
        recording = read(path, **hints)
    except FileFormatError as error:
        try:  # a table of fixes without accuracies, which a track needs not
            recording = read(path, **{"series": "reference", **hints})
        except SchulerError:
            raise error from None
    time = recording.metadata.time
    if recording.reference is not None:
        return Run(name, recording.reference, time, "", None, str(path))
    if recording.gnss is not None:
        g = recording.gnss
        return Run(name, Trajectory.from_geodetic(g.t, g.llh, g.v_n), time, "antenna", None, str(path))
    raise InputError(f"{path}: expected a run (positions over time), got a log without any; navigate it first")


@explains_arguments
def compare_runs(
    runs: Sequence[Run | Path | str],
    reference: Run | Path | str | None = None,
    *,
    bounds: Mapping[str, float] | None = None,
    **hints: Any,
) -> RunComparison:
    """Compare runs with a reference, or with the first of them.

    Parameters
    ----------
    runs : sequence of Run, Path or str
        As :func:`read_run` takes them.
    reference : Run, Path or str, optional
        Truth or a better solution. Default: the first run, of which the others' differences are given.
    bounds : mapping of str to float, optional
        Largest values, by the names of :data:`BOUNDED`; the words of a name may stand in any order.
    **hints
        On files of other programs, see :func:`schuler.read`.

    Returns
    -------
    RunComparison

    Raises
    ------
    InputError
        If there are too few or too many runs, a bound has no such name, or the times do not overlap.

    Notes
    -----
    All are compared at the reference's times within the span that all cover. Clocks are brought together where both
    are dated; a local one is taken as the reference's. A run of ours is moved to the antenna where the reference is
    one of fixes. Along is the direction of the reference's motion where it moves faster than :data:`MOVING`, across is
    to the right of it. The relative error is the change of the horizontal error over every piece of
    :data:`PIECE` of the reference's way, RMS; the run is not turned or moved onto the reference first.

    Examples
    --------
    >>> comparison = schuler.compare_runs(["town-solution"], "town.parquet", bounds={"horizontal_rms_m": 5.0})
    >>> comparison.passes
    True
    """
    limits = {_bound_name(key): float(value) for key, value in (bounds or {}).items()}
    several = [r if isinstance(r, Run) else read_run(r, **hints) for r in runs]
    against_run = reference is None
    if reference is None:
        if len(several) < 2:
            raise InputError(f"runs: expected two or more, or a reference, got {len(several)} and none")
        truth, several = several[0], several[1:]
    else:
        truth = reference if isinstance(reference, Run) else read_run(reference, **hints)
    if not 0 < len(several) <= MOST:
        raise InputError(f"runs: expected 1 to {MOST} beside the reference, got {len(several)}")
    names = _distinct([run.name for run in several])
    notes: list[str] = []
    on_one_clock = [aligned(run, name, truth, notes) for run, name in zip(several, names, strict=True)]
    R = truth.trajectory
    start = max(float(T.t[0]) for T in (R, *on_one_clock))
    stop = min(float(T.t[-1]) for T in (R, *on_one_clock))
    inside = (R.t >= start) & (R.t <= stop)
    if not inside.any():
        spans = ", ".join(
            f"{n} {T.t[0]:.3f}..{T.t[-1]:.3f} s" for n, T in zip((truth.name, *names), (R, *on_one_clock), strict=True)
        )
        raise InputError(f"runs: expected times that overlap, got {spans}; are they on one clock?")
    common = R.samples(np.flatnonzero(inside))
    if inside.mean() < 0.9:
        notes.append(f"{100.0 * inside.mean():.0f} % of the reference's epochs are compared: not all runs cover more.")
    errors, numbers = [], []
    for name, T in zip(names, on_one_clock, strict=True):
        covered = ~in_gaps(T.t, common.t)
        if not covered.any():
            raise InputError(f"{name}: expected samples at the reference's times, got gaps only")
        kept = common.samples(np.flatnonzero(covered))
        difference = trajectory_errors(T, kept)
        errors.append(difference)
        row: dict[str, float | None] = dict.fromkeys(_COLUMNS)
        row |= {**difference.statistics(), **track_numbers(difference, kept)}
        numbers.append({**{key: row[key] for key in _COLUMNS}, "coverage_percent": 100.0 * float(covered.mean())})
    unbounded = [key for key in limits if all(row[key] is None for row in numbers)]
    if unbounded:
        raise InputError(f"{', '.join(unbounded)}: expected runs and a reference that have it, got none")
    return RunComparison(
        truth.name, against_run, tuple(names), tuple(run.file for run in several), tuple(errors), tuple(numbers),
        (common, *on_one_clock), (start, stop), limits, tuple(notes),
    )  # fmt: skip


def track_numbers(errors: TrajectoryErrors, reference: Trajectory) -> dict[str, float | None]:
    """Errors along and across the track, 2DRMS, and the relative error per 100 m.

    Parameters
    ----------
    errors : TrajectoryErrors
        At the times of ...
    reference : Trajectory

    Returns
    -------
    dict
        ``drms2_m``; ``rms_along_m``, ``mean_along_m`` (positive ahead), ``rms_across_m``, ``mean_across_m`` (positive
        to the right), None of a reference that does not move; ``relative_per_100m_m``, None of a shorter way.
    """
    along, across = along_across(errors, reference)
    moving = np.isfinite(along)
    numbers: dict[str, float | None] = {"drms2_m": 2.0 * errors.rms_horizontal}
    for name, e in (("along", along[moving]), ("across", across[moving])):
        numbers[f"rms_{name}_m"] = float(np.sqrt(np.mean(e**2))) if len(e) else None
        numbers[f"mean_{name}_m"] = float(np.mean(e)) if len(e) else None
    changes = relative_errors(errors, reference)
    numbers["relative_per_100m_m"] = float(np.sqrt(np.mean(changes**2))) if len(changes) else None
    return numbers


def along_across(errors: TrajectoryErrors, reference: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Horizontal errors ahead and to the right of the reference's motion; NaN where it is slower than :data:`MOVING`.

    Parameters
    ----------
    errors : TrajectoryErrors
    reference : Trajectory
        At the same times.

    Returns
    -------
    along, across : ndarray, shape (n,)
        [m]
    """
    if reference.v_eb_e is not None:
        v = reference.v_eb_n[:, :2]
    elif len(reference) > 1:
        v = np.gradient(_north_east(reference), reference.t, axis=0)
    else:
        v = np.zeros((len(reference), 2))
    speed = np.hypot(v[:, 0], v[:, 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        u = np.where((speed > MOVING)[:, None], v / speed[:, None], np.nan)
    e = errors.position_n
    return e[:, 0] * u[:, 0] + e[:, 1] * u[:, 1], e[:, 1] * u[:, 0] - e[:, 0] * u[:, 1]


def relative_errors(errors: TrajectoryErrors, reference: Trajectory) -> FloatArray:
    """Change of the horizontal error over pieces of the reference's way, :data:`PIECE` long, one from every epoch.

    Parameters
    ----------
    errors : TrajectoryErrors
    reference : Trajectory
        At the same times.

    Returns
    -------
    ndarray, shape (k,)
        [m]
    """
    steps = np.linalg.norm(np.diff(_north_east(reference), axis=0), axis=1)
    way = np.concatenate(([0.0], np.cumsum(steps)))
    begin = np.flatnonzero(way + PIECE <= way[-1])
    e = errors.position_n[:, :2]
    after = np.column_stack([np.interp(way[begin] + PIECE, way, e[:, i]) for i in range(2)])
    return np.asarray(np.linalg.norm(after - e[begin], axis=1))


def in_gaps(t: FloatArray, at: FloatArray) -> BoolArray:
    """Whether times lie in pauses of a run of more than five of its usual steps and two seconds. Shape of ``at``."""
    if len(t) < 3:
        return np.zeros(len(at), dtype=bool)
    step = np.diff(t)
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(step) - 1)
    # the samples at both ends of a pause are there
    inside = (at > t[k] + 1e-6) & (at < t[k + 1] - 1e-6)
    return np.asarray(inside & (step[k] > max(5.0 * float(np.median(step)), 2.0)))


def _north_east(trajectory: Trajectory) -> FloatArray:
    """North and east of the first sample, in its plane. Shape (n, 2). [m]"""
    from schuler import frames

    r = trajectory.r_eb_e - trajectory.r_eb_e[0]
    return np.asarray((r @ frames.C_en(trajectory.llh[0]))[:, :2])


def aligned(run: Run, name: str, truth: Run, notes: list[str]) -> Trajectory:
    """A run on another's clock, and at its point where that is known.

    Parameters
    ----------
    run : Run
    name : str
        For the notes.
    truth : Run
        The other one.
    notes : list of str
        Sentences are added on what could not be brought together.
    """
    T = run.trajectory
    if "local" not in (run.time.scale, truth.time.scale):
        shift = run.time.epoch_gps_s - truth.time.epoch_gps_s
        if shift:
            T = replace(T, t=T.t + shift)
    elif run.time.scale != truth.time.scale:
        notes.append(f"{name}: its clock is not dated as that of {truth.name} is; their seconds are taken as the same.")
    if truth.point == "antenna" and run.point == "imu" and run.lever_arm_b is not None:
        if run.lever_arm_b.any():
            T = T.moved_by(run.lever_arm_b)
    elif {run.point, truth.point} == {"imu", "antenna"}:
        notes.append(f"{name} is the antenna's and {truth.name} the IMU's: the lever arm is in the differences.")
    return T


def _distinct(names: Sequence[str]) -> list[str]:
    """Names with numbers where they repeat."""
    return [n if names.count(n) == 1 else f"{n} ({names[: k + 1].count(n)})" for k, n in enumerate(names)]


def _bound_name(text: str) -> str:
    """The number that a bound is on, its words in any order: ``horizontal_rms_m`` is ``rms_horizontal_m``."""
    for name in BOUNDED:
        if sorted(name.split("_")) == sorted(text.strip().split("_")):
            return name
    raise InputError(f"bounds: expected one of {', '.join(BOUNDED)}, got {text!r}")
