"""Ways over ground as a page draws them: fixes of a log, solutions of a run, in metres about one origin."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from schuler import frames
from schuler.arrays import FloatArray
from schuler.navigation.evaluation.runs import read_run
from schuler.recording.recording import Recording

_MOST = 4000  # points of a curve
_SOLUTIONS = (("solution.parquet", "filtered"), ("smoothed.parquet", "smoothed"))


def plan(recording: Recording | None, run: Path | None = None, other: Path | None = None) -> dict[str, Any]:
    """Curves of a log's fixes and of the solutions of a run, or of two.

    Parameters
    ----------
    recording : Recording, optional
        Its first fix is the origin; without fixes it is the first point of the run.
    run, other : Path, optional
        Folders of runs; they need pyarrow (extra ``data``) and tables of the solution.

    Returns
    -------
    dict
        ``curves`` of ``t`` from the start of the recording [s], ``north`` and ``east`` [m]; ``note``: what is missing;
        ``origin``: latitude, longitude [rad], height [m], None without a curve.
    """
    curves: list[dict[str, Any]] = []
    origin: FloatArray | None = None
    zero = None if recording is None else recording.start
    if recording is not None and recording.gnss is not None and len(recording.gnss.t):
        g = recording.gnss
        origin = g.llh[0]
        curves.append(_curve("GNSS", "measured", g.t - recording.start, frames.ecef_from_llh(g.llh), origin))
    files = [] if run is None else [(run / name, role, role) for name, role in _SOLUTIONS if (run / name).is_file()]
    if other is not None:  # the best of what it has
        best = [(other / name, "case_2", f"{other.name}: {label}") for name, label in _SOLUTIONS]
        files += [entry for entry in best if entry[0].is_file()][-1:]
    for path, role, name in files:
        T = read_run(path).trajectory
        origin = frames.llh_from_ecef(T.r_eb_e[0]) if origin is None else origin
        zero = float(T.t[0]) if zero is None else zero
        curves.append(_curve(name, role, T.t - zero, T.r_eb_e, origin))
    missing = run is not None and not files
    note = "this run has no table of its solution (extra data)" if missing else ""
    return {"curves": curves, "note": note, "origin": None if origin is None else origin.tolist()}


def _curve(name: str, role: str, t: FloatArray, r_eb_e: FloatArray, origin: FloatArray) -> dict[str, Any]:
    """Some of the points; coordinates to the millimetre."""
    k = np.arange(0, len(t), max(-(-len(t) // _MOST), 1))
    ned = np.round(frames.ned_from_ecef(r_eb_e[k], origin), 3)
    return {
        "name": name, "role": role, "t": np.round(t[k], 3).tolist(), "north": ned[:, 0].tolist(),
        "east": ned[:, 1].tolist(),
    }  # fmt: skip
