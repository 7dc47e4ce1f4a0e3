"""Several files of a run that could be the same series: which of them is meant."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler.exceptions import SchulerError
from schuler.proposal.decision import Decision, UndecidedError
from schuler.proposal.hints import feels_gravity
from schuler.recording.io import dispatch, packed
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.over_ground import NO_HEIGHT
from schuler.recording.series import GnssSeries

_RECEIVER = re.compile(r"gps|gnss", re.IGNORECASE)  # others may be a filter's positions
_NUMBERED = re.compile(r"\d*(?=\.csv$)")  # at the end of a table's name
_AS_MANY = 1.1  # ratio of two rates of fixes that are the same
_COMMON_S, _SLACK_M, _RADIUS_M = 10.0, 0.3, 6.371e6


def chosen(
    log: Path, part: str, rivals: list[tuple[bool, str, dict[str, Any], list[Decision]]], ignored: list[str]
) -> tuple[dict[str, Any], list[Decision]]:
    """Entry of one part of a run, and the decision where several files could be it.

    Parameters
    ----------
    log : Path
        Folder of the files.
    part : str
        ``imu``, ``gnss``, ``ephemerides``, ...
    rivals : list of (named, file, entry, decisions)
        Files that hold such a series: whether a header names columns and units, and how each is read.
    ignored : list of str
        Takes the names of those that are not read.

    Raises
    ------
    UndecidedError
        If nothing tells which is meant.
    """
    if part == "ephemerides":
        names = [name for _, name, _, _ in rivals]
        return {"file": names[0] if len(names) == 1 else names}, []
    if len(rivals) == 1:
        return dict(rivals[0][2]), list(rivals[0][3])
    named = [f for f in rivals if f[0]]
    why = ""
    if len(named) == 1:
        best, why = named[0], "its header names columns and units"
    elif part == "imu" and len(felt := [f for f in rivals if feels_gravity(packed.resolved(log / f[1]))]) == 1:
        best, why = felt[0], "the others feel no gravity: motion that a filter has made of it"
    elif part == "imu" and _are_units_of_one_file(log, [name for _, name, _, _ in rivals]):
        best, why = min(rivals, key=lambda f: f[1]), "it is the first of several units in one file"
    elif part == "gnss":
        fixes = {f[1]: _fixes(packed.resolved(log / f[1]), f[2]) for f in rivals}
        claims = {name: np.inf if g is None else _claim(g) for name, g in fixes.items()}
        best, second = sorted(rivals, key=lambda f: claims[f[1]])[:2]
        receivers = [f for f in rivals if _RECEIVER.search(f[1].rpartition("/")[2])]
        high = [f for f in rivals if (g := fixes[f[1]]) is not None and g.cov_r_n[:, 2, 2].max() < NO_HEIGHT**2]
        if (faster := _with_velocities(fixes)) and _agree(fixes[best[1]], fixes[second[1]], max(claims.values())):
            best = next(f for f in rivals if f[1] == faster)
            why = "its fixes agree with those of the other, are as many a second and have velocities"
        elif len(receivers) == 1:
            best, why = receivers[0], "it is a receiver's by its name"
        elif len(high) == 1:
            best, why = high[0], "it alone has heights"
        elif claims[best[1]] < 0.5 * claims[second[1]]:
            why = f"its fixes claim {claims[best[1]]:.2g} m, those of the others {claims[second[1]]:.2g} m and more"
        elif len(rivals) == 2 and _agree(fixes[best[1]], fixes[second[1]], claims[second[1]]):
            why = f"its fixes agree with those of {second[1]} and claim less"
    if not why:
        what = {"imu": "an IMU", "gnss": "fixes"}.get(part, part)
        raise UndecidedError(
            f"{log}: {len(rivals)} files hold {what}, which is meant",
            [(name, {f"recording.{part}.file": name}) for _, name, _, _ in rivals],
        )
    others = [f[1] for f in rivals if f is not best]
    ignored += others
    decision = Decision(f"recording.{part}.file", best[1], f"{why}; not read: {', '.join(others)}")
    return dict(best[2]), [decision, *best[3]]


def _are_units_of_one_file(log: Path, names: list[str]) -> bool:
    """Whether tables of a file that holds several are told apart by a number only."""
    return len({_NUMBERED.sub("", name) for name in names}) == 1 and not any((log / name).exists() for name in names)


def _fixes(path: Path, entry: Mapping[str, Any]) -> GnssSeries | None:
    """Fixes of a file on GPS time since 1980; None if it cannot be read."""
    hints = {name: value for name, value in entry.items() if name != "file"}
    try:
        recording = dispatch.read_one(path, ReadHints.of(series="gnss", **hints))
        gnss = recording.need_gnss()
        return replace(gnss, t=gnss.t + recording.metadata.time.epoch_gps_s)
    except SchulerError:
        return None


def _claim(gnss: GnssSeries) -> float:
    """Median 1-sigma of fixes, north and east. [m]"""
    return float(np.sqrt(np.median(np.trace(gnss.cov_r_n[:, :2, :2], axis1=1, axis2=2) / 2.0)))


def _with_velocities(fixes: Mapping[str, GnssSeries | None]) -> str | None:
    """The file with velocities, of two with as many fixes a second, which a filter's beside a receiver's are not."""
    if len(fixes) != 2 or any(g is None or len(g) < 2 for g in fixes.values()):
        return None
    moving = [name for name, g in fixes.items() if g is not None and g.v_n is not None]
    steps = [float(np.median(np.diff(g.t))) for g in fixes.values() if g is not None]
    return moving[0] if len(moving) == 1 and max(steps) < _AS_MANY * min(steps) else None


def _agree(a: GnssSeries | None, b: GnssSeries | None, sigma: float) -> bool:
    """Whether fixes of two files are the same places but for their errors, so that either may be taken."""
    if a is None or b is None or min(a.t[-1], b.t[-1]) - max(a.t[0], b.t[0]) < _COMMON_S:
        return False
    inside = (a.t >= b.t[0]) & (a.t <= b.t[-1])
    there = np.stack([np.interp(a.t[inside], b.t, b.llh[:, k]) for k in range(2)], axis=1)
    apart = (a.llh[inside, :2] - there) * _RADIUS_M * np.stack((np.ones(inside.sum()), np.cos(there[:, 0])), axis=1)
    return bool(np.median(np.hypot(apart[:, 0], apart[:, 1])) < 3.0 * sigma + _SLACK_M)
