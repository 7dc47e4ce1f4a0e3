"""One recording through several architectures and several sets of outages: one table."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arguments import explains_arguments
from schuler.exceptions import InputError
from schuler.navigation.config import NavigationConfig, OutageSection
from schuler.navigation.evaluation.errors import TrajectoryErrors, evaluate
from schuler.navigation.evaluation.modes import Mode, available_modes, parse_mode
from schuler.navigation.result import NavigationResult
from schuler.navigation.run import navigate
from schuler.plotting.table import ResultTable, TabularResult
from schuler.recording.recording import Recording
from schuler.recording.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Windows = tuple[tuple[float, float], ...]
Progress = Callable[[float], None]

#: Columns of the table, and what they are called in :func:`schuler.navigation.evaluation.errors.evaluate`.
_COLUMNS = (
    "rms_horizontal_m", "max_horizontal_m", "rms_vertical_m", "rms_outage_horizontal_m", "mean_outage_max_horizontal_m",
    "smoothed_rms_horizontal_m", "smoothed_mean_outage_max_horizontal_m", "nees_mean", "nis_mean", "rejected",
)  # fmt: skip


@dataclass(frozen=True)
class ComparisonRow:
    """One architecture with one set of outages.

    Attributes
    ----------
    mode : Mode
    outages : str
        Name of the set.
    numbers : dict
        Numbers of :func:`schuler.navigation.evaluation.errors.evaluate`, ``smoothed`` with the same of the smoothed
        solution; empty if the run failed.
    failed : str
        Why there is no solution, empty if there is one.
    errors : TrajectoryErrors, optional
        Errors of the filtered solution.
    """

    mode: Mode
    outages: str
    numbers: dict[str, Any]
    failed: str = ""
    errors: TrajectoryErrors | None = field(default=None, repr=False, compare=False)

    def entry(self, name: str) -> Any:
        """One number of the table, None where there is none."""
        if name.startswith("smoothed_"):
            return self.numbers.get("smoothed", {}).get(name.removeprefix("smoothed_"))
        if name == "rejected":
            return sum(self.numbers["rejected"].values()) if self.numbers else None
        return self.numbers.get(name)


@dataclass(frozen=True, repr=False)
class Comparison(TabularResult):
    """Architectures by outages on one recording.

    Attributes
    ----------
    recording : str
        Name of the recording.
    reference : str
        Description of the trajectory that errors are measured against.
    rows : tuple of ComparisonRow
    windows : dict of str to tuple of (start, stop)
        Sets of outages by name, seconds from the start of the recording.
    complete : bool
        False if it was interrupted: the rows are those that were finished.
    start : float
        Start of the recording. [s]
    """

    recording: str
    reference: str
    rows: tuple[ComparisonRow, ...]
    windows: dict[str, Windows]
    complete: bool = True
    start: float = 0.0

    def row(self, mode: str, outages: str | None = None) -> ComparisonRow:
        """The row of a mode by name, of the first set of outages if none is named."""
        for r in self.rows:
            if r.mode.name == parse_mode(mode).name and (outages is None or r.outages == outages):
                return r
        raise InputError(
            f"no row {mode!r} with outages {outages!r}; there are {', '.join(r.mode.name for r in self.rows)}"
        )

    def table(self) -> ResultTable:
        """One row a run: errors, consistency, rejections."""
        columns = [c for c in _COLUMNS if any(r.entry(c) is not None for r in self.rows)]
        rows = tuple((r.mode.name, r.outages, *(r.entry(c) for c in columns)) for r in self.rows)
        failed = tuple(f"{r.mode.name}, {r.outages}: {r.failed}" for r in self.rows if r.failed)
        sets = tuple(
            f"outages {name}: {len(w)}, {sum(b - a for a, b in w):.1f} s in all"
            for name, w in self.windows.items()
            if w
        )
        against = (f"errors against {self.reference}; NEES and NIS per degree of freedom, 1 for an honest filter",)
        return ResultTable(
            f"{self.recording}: architectures and outages", ("mode", "outages", *columns), rows,
            against + sets + failed,
            self.complete,
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: the table, and all numbers of every run under ``runs``."""
        runs = [{"mode": r.mode.name, "outages": r.outages, "failed": r.failed or None, **r.numbers} for r in self.rows]
        return {**self.table().to_dict(), "reference": self.reference, "windows_s": self.windows, "runs": runs}

    def plot(self, outages: str | None = None) -> Figure:
        """Horizontal error over time of every architecture, see :mod:`schuler.navigation.evaluation.figures`."""
        from schuler.navigation.evaluation.figures import plot_comparison

        return plot_comparison(self, outages)


@explains_arguments
def compare_architectures(
    recording: Recording,
    config: NavigationConfig | dict[str, Any] | Path | str,
    *,
    modes: Sequence[Mode | str] | None = None,
    outages: Mapping[str, Windows] | None = None,
    smooth: bool | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """Navigate a recording with every architecture and every set of outages.

    Parameters
    ----------
    recording : Recording
        Errors are measured against its reference; where there is none, against all its GNSS fixes at the antenna.
    config : NavigationConfig, dict, or path of a TOML file
        Everything that the modes do not change: coupling and aids. It is the same for all of them.
    modes : sequence of Mode or str, optional
        Default :func:`~schuler.navigation.evaluation.modes.available_modes`.
    outages : mapping of str to tuple of (start, stop), optional
        Sets of windows without GNSS, seconds from the start of the recording. Default: ``none``, and ``configured``
        if the configuration has some.
    smooth : bool, optional
        Also smooth; as configured if left out. Resets cannot be smoothed.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    Comparison
        On Ctrl-C the rows that were finished. A mode that cannot run is a row with the reason.

    Raises
    ------
    InputError, ConfigError
        If the configuration or a mode is wrong, or there is nothing to compare with.
    """
    config = NavigationConfig.checked(config)
    chosen = available_modes(recording, config) if modes is None else tuple(
        m if isinstance(m, Mode) else parse_mode(m) for m in modes
    )  # fmt: skip
    if not chosen:
        raise InputError("expected at least one mode, got none")
    sets = _window_sets(recording, config, outages)
    reference, at_antenna, what = reference_of(recording)
    smooth = config.filter.smooth if smooth is None else smooth
    cases = [(mode, name) for name in sets for mode in chosen]
    rows: list[ComparisonRow] = []
    complete = True
    try:
        for k, (mode, name) in enumerate(cases):
            row = _run(recording, config, mode, name, sets[name], reference, at_antenna, smooth)
            if row is None:
                complete = False
                break
            rows.append(row)
            if progress is not None:
                progress((k + 1) / len(cases))
    except KeyboardInterrupt:
        complete = False
    return Comparison(recording.metadata.name, what, tuple(rows), sets, complete, recording.start)


def reference_of(recording: Recording) -> tuple[Trajectory, bool, str]:
    """Reference for errors: the trajectory, whether it is the antenna's, and its name.

    Raises
    ------
    InputError
        If the recording has neither a reference nor GNSS.
    """
    if recording.reference is not None:
        return recording.reference, False, "the reference trajectory"
    g = recording.need_gnss()
    return Trajectory.from_geodetic(g.t, g.llh, g.v_n), True, "GNSS fixes at the antenna"


def _window_sets(
    recording: Recording, config: NavigationConfig, outages: Mapping[str, Windows] | None
) -> dict[str, Windows]:
    if outages is not None:
        if not outages:
            raise InputError("outages: expected at least one set, such as {'none': ()}; got none")
        for name, windows in outages.items():
            for start, stop in windows:
                if not stop > start:
                    raise InputError(f"outages {name!r}: an outage stops after it starts, got {start}..{stop} s")
        return {name: tuple((float(a), float(b)) for a, b in windows) for name, windows in outages.items()}
    stop = recording.stop if recording.gnss is None else float(recording.gnss.t[-1])
    configured = config.outages.resolve(0.0, stop - recording.start)
    return {"none": (), **({"configured": configured} if configured else {})}


def _run(
    recording: Recording, config: NavigationConfig, mode: Mode, name: str, windows: Windows, reference: Trajectory,
    at_antenna: bool, smooth: bool,
) -> ComparisonRow | None:  # fmt: skip
    """One row; None if the run was interrupted."""
    began = time.perf_counter()
    smooth = smooth and mode.coupling != "reset"
    try:
        changed = mode.configure(config).model_copy(
            update={
                "outages": OutageSection(windows_s=windows),
                "filter": config.filter.model_copy(update={"smooth": smooth, "tune": False}),
            }
        )
        result = navigate(recording, changed)
        if mode.coupling == "ins" and {"zupt", "zaru"} & set(mode.aids) and recording.gnss is not None:
            # GNSS is there for the alignment only: it must not help to find rest later
            without_gnss = (
                float(result.trajectory.t[0]) - recording.start + 1e-6,
                recording.stop - recording.start + 1.0,
            )
            result = replace(
                navigate(recording, changed.model_copy(update={"outages": OutageSection(windows_s=(without_gnss,))})),
                outages=result.outages,
            )
    except InputError as error:  # a mode that cannot run is a finding, not the end of the campaign
        return ComparisonRow(mode, name, {}, str(error))
    if not result.complete:
        return None
    numbers = _numbers(result, reference, at_antenna, recording.start, windows)
    if smooth:
        numbers["smoothed"] = _numbers(result.smooth(), reference, at_antenna, recording.start, windows)
    numbers["elapsed_s"] = time.perf_counter() - began
    return ComparisonRow(mode, name, numbers, errors=result.errors(reference, at_antenna=at_antenna))


def _numbers(
    result: NavigationResult, reference: Trajectory, at_antenna: bool, origin: float, windows: Windows
) -> dict[str, Any]:
    numbers = evaluate(result, reference, at_antenna=at_antenna, origin=origin)
    errors = result.errors(reference, at_antenna=at_antenna)
    inside = np.zeros(len(errors.t), dtype=bool)
    for start, stop in windows:
        inside |= (errors.t >= origin + start) & (errors.t <= origin + stop)
    squared = errors.horizontal[inside] ** 2
    return {
        **numbers,
        "rms_outage_horizontal_m": float(np.sqrt(np.mean(squared))) if inside.any() else None,
        "nis_mean": result.innovations.mean_nis(),
        "measurements": result.innovations.counts(),
        "rejected": result.innovations.rejected(),
        "states": result.layout.size,
        "notes": result.notes,
    }
