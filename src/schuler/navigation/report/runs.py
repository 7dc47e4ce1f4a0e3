"""HTML page on runs side by side: tracks over each other, errors over time, one table."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from schuler import frames
from schuler.files import write_text
from schuler.navigation.evaluation.runs import RunComparison, along_across
from schuler.plotting import parts
from schuler.plotting.figure import TIME, Figure, Item, Panel, line, path, view
from schuler.plotting.page import Section, plotly_script, whole_page
from schuler.plotting.table import shown

_CONVENTIONS = (
    "Conventions: errors are run minus reference, at the times of the reference that all runs cover, less the pauses "
    "of each run. Along is ahead and across is to the right of the reference's motion, where it moves; 2DRMS is twice "
    "the horizontal RMS; CEP is the radius that holds half (95 %) of the horizontal errors; relative is the change "
    "of the horizontal error over 100 m of the way, RMS."
)
_WORDS = {
    "rms_horizontal_m": "horizontal RMS [m]", "drms2_m": "2DRMS [m]", "cep50_m": "CEP 50 % [m]",
    "cep95_m": "CEP 95 % [m]", "max_horizontal_m": "largest horizontal [m]", "rms_along_m": "along track, RMS [m]",
    "rms_across_m": "across track, RMS [m]", "mean_along_m": "along track, mean [m]",
    "mean_across_m": "across track, mean [m]", "rms_vertical_m": "vertical RMS [m]",
    "max_vertical_m": "largest vertical [m]", "relative_per_100m_m": "relative per 100 m [m]",
    "rms_velocity_horizontal_m_s": "horizontal velocity RMS [m/s]",
    "rms_velocity_vertical_m_s": "vertical velocity RMS [m/s]", "rms_tilt_deg": "tilt RMS [deg]",
    "rms_heading_deg": "heading RMS [deg]", "coverage_percent": "covered [%]",
}  # fmt: skip


def runs_report(comparison: RunComparison, file: Path | str) -> Path:
    """Write the page on a comparison; the same bytes for the same arguments.

    Parameters
    ----------
    comparison : RunComparison
    file : Path or str
        The HTML file.
    """
    c = comparison
    sections = [
        Section("numbers", "Numbers", (_table(c),)),
        Section("errors", "Errors over time", (_errors(c),)),
    ]
    text = whole_page(
        ", ".join(c.names), "comparison of runs", f"{len(c.names)} runs against {c.reference}", c.sentences(),
        _CONVENTIONS, sections, plotly_script(), tone="" if c.passes else "failed", leading=_overlay(c),
    )  # fmt: skip
    return write_text(file, text)


def _role(k: int) -> str:
    return f"case_{k + 1}"


def _overlay(c: RunComparison) -> Figure:
    """Tracks over each other, north up."""
    origin = c.trajectories[0].llh[0]
    C, r0 = frames.C_en(origin), c.trajectories[0].r_eb_e[0]
    items: list[Item] = []
    named = [(c.reference, "reference"), *((name, _role(k)) for k, name in enumerate(c.names))]
    for (name, role), T in zip(named, c.trajectories, strict=True):
        k = np.flatnonzero((T.t >= c.span[0]) & (T.t <= c.span[1]))
        n = (T.r_eb_e[k] - r0) @ C
        along = ((TIME, partial(np.take, T.t[k] - c.span[0])),)
        items.append(path(n[:, 1], n[:, 0], role, name, along))
    panel = Panel("east [m]", "north [m]", (*items[1:], items[0]), equal=True)
    caption = f"All tracks in metres from the first epoch compared; dashed: {c.reference}."
    return Figure("overlay", "Tracks", caption, (panel,))


def _errors(c: RunComparison) -> Figure:
    panels: dict[str, list[Item]] = {}
    for k, (name, errors) in enumerate(zip(c.names, c.errors, strict=True)):
        t = errors.t - c.span[0]
        reference = c.trajectories[0].at(errors.t)
        along, across = along_across(errors, reference)
        for what, y in (
            ("horizontal error [m]", errors.horizontal), ("along track [m]", along), ("across track [m]", across),
            ("down [m]", errors.position_n[:, 2]),
        ):  # fmt: skip
            if np.isfinite(y).any():
                panels.setdefault(what, []).append(line(t, y, _role(k), name))
    drawn = tuple(
        Panel(TIME, what, tuple(items), y_limits=view([i.y for i in items if hasattr(i, "y")]))
        for what, items in panels.items()
    )
    return Figure("errors", "Errors", f"Run minus {c.reference}, from the first epoch compared.", drawn)


def _table(c: RunComparison) -> str:
    """Numbers down, runs across, with the bounds."""
    rows = []
    for key, words in _WORDS.items():
        values = [numbers[key] for numbers in c.numbers]
        if all(v is None for v in values):
            continue
        bound = f"\nup to {c.bounds[key]:g}" if key in c.bounds else ""
        broken = c.broken.get(key, ())
        cells = [
            shown(v) + ("\nbeyond the bound" if name in broken else "") for name, v in zip(c.names, values, strict=True)
        ]
        rows.append((words + bound.replace("\n", ", "), *cells))
    return parts.table(f"Against {c.reference}", ("", *c.names), rows)
