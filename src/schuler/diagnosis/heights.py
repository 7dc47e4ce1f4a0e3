"""Whether heights are above the ellipsoid or above sea level."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.diagnosis.result import Finding
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries

_GEOID = (-110.0, 90.0)  # [m]
_LEAST = 3.0  # a difference of level that is worth a word [m]


def check_heights(recording: Recording) -> list[Finding]:
    """Findings on the level heights count from.

    Parameters
    ----------
    recording : Recording

    Notes
    -----
    GNSS heights are compared with those of another source that is ellipsoidal: single points of the same recording's
    satellite measurements, or a reference. A constant difference like a geoid's gives the level away. Without such a
    source only what the file said of itself is known; its absence is a warning, since both kinds are common and differ
    by up to 107 m.
    """
    gnss = recording.gnss
    if gnss is None or len(gnss) < 5:
        return []
    for what, other in _others(recording):
        t, h, sigma = other
        inside = (gnss.t >= t[0]) & (gnss.t <= t[-1])
        if inside.sum() < 5:
            continue
        d = gnss.llh[inside, 2] - np.interp(gnss.t[inside], t, h)
        level = float(np.median(d))
        scatter = 1.4826 * float(np.median(np.abs(d - level)))
        limit = _LEAST + 3.0 * sigma + 3.0 * scatter / np.sqrt(min(len(d), 20))
        evidence: dict[str, Any] = {"difference_m": level, "scatter_m": scatter, "compared_with": what}
        if abs(level) > limit and scatter < max(3.0, 0.3 * abs(level)) and -_GEOID[1] - 5 <= level <= -_GEOID[0] + 5:
            text = (
                f"heights are {level:+.1f} m (scatter {scatter:.1f} m) from those of {what}, which are "
                f"ellipsoidal: they "
                "are above mean sea level"
            )
            fix = f"height='msl', geoid_separation={-level:.1f}"
            if abs(level) > 20.0:
                return [Finding("height_level", "error", text, 0.98, fix, evidence, "gnss")]
            return [Finding("height_level", "warning", text, 0.9, fix, evidence, "gnss")]
        if abs(level) <= limit:
            return []
    if _stated(recording) or not _assumed(recording):
        return []
    text = (
        "the file does not say whether its heights are ellipsoidal or above mean sea level (some programs "
        "write the one, "
        "some the other); they were taken as ellipsoidal, and the two differ by up to 107 m, typically 20 to 50 m"
    )
    fix = "height='msl', geoid_separation=... (or height='ellipsoidal')"
    return [
        Finding(
            "height_level", "warning", text, 0.5, fix, {"median_height_m": float(np.median(gnss.llh[:, 2]))}, "gnss"
        )
    ]


def _others(recording: Recording) -> list[tuple[str, tuple[FloatArray, FloatArray, float]]]:
    out = []
    if recording.reference is not None and len(recording.reference) > 1:
        llh = recording.reference.llh
        out.append(("the reference", (recording.reference.t, llh[:, 2], 1.0)))
    points = _points(recording)
    if points is not None:
        out.append(points)
    return out


def _points(recording: Recording) -> tuple[str, tuple[FloatArray, FloatArray, float]] | None:
    """Single points of the satellite measurements, if the recording holds what they need."""
    points = single_points(recording)
    if points is None:
        return None
    return "single points of the satellite measurements", (points.t, points.llh[:, 2], 4.0)


def single_points(recording: Recording, most: int = 300) -> GnssSeries | None:
    """Solutions epoch by epoch of a recording's satellite measurements; None if it has none or they give nothing.

    Parameters
    ----------
    recording : Recording
    most : int
        Measurements are thinned out to about as many epochs.
    """
    from schuler.exceptions import SchulerError
    from schuler.gnss.point import solve_points
    from schuler.gnss.preparation import prepare_ranges
    from schuler.recording.satellite_positions import gnss_series

    try:
        ranges = recording.ranges
        if ranges is None:
            if recording.observations is None or recording.ephemerides is None:
                return None
            ranges = prepare_ranges(recording.observations, recording.ephemerides)
        epochs = np.unique(ranges.t)
        if len(epochs) > most:
            span = (epochs[0], epochs[-1])
            if recording.imu is not None:
                span = (max(span[0], recording.imu.t[0] - 30.0), min(span[1], recording.imu.t[-1] + 30.0))
            inside = epochs[(epochs >= span[0]) & (epochs <= span[1])]
            epochs = inside[:: max(1, len(inside) // most)] if len(inside) else epochs[:most]
            ranges = ranges.where(np.isin(ranges.t, epochs))
        return gnss_series(solve_points(ranges))
    except SchulerError:
        return None


def _assumed(recording: Recording) -> bool:
    return any("taken as ellipsoidal" in note for note in recording.metadata.notes)


def _stated(recording: Recording) -> bool:
    notes = " ".join(recording.metadata.notes)
    return "were made ellipsoidal" in notes
