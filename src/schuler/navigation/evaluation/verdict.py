"""Verdict on a navigation run from the run alone: whether its solution and its claims can be believed, and why not."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from schuler.filtering.measurements import (
    ACCEPTED,
    FIX,
    FORCED,
    GATED,
    KINDS,
    POSITION,
    PSEUDORANGE,
    REJECTED,
    RESET_POSITION,
    UNUSED,
)
from schuler.navigation.evaluation.causes import causes
from schuler.navigation.evaluation.evidence import evidence
from schuler.navigation.inputs.antenna import ANTENNA_POINT
from schuler.navigation.inputs.imu_axes import AXES_UNCERTAIN
from schuler.verdict import Status, Verdict

if TYPE_CHECKING:
    from schuler.navigation.result import NavigationResult


def verdict(result: NavigationResult) -> Verdict:
    """Judge a run by its rejections, innovations, parameters and covariance.

    Parameters
    ----------
    result : NavigationResult
        Filtered; of a smoothed one the parameters are not compared between parts of the run.

    Returns
    -------
    Verdict

    Notes
    -----
    Evidence, each against what a filter with right models shows: the share of rejected GNSS measurements; acceptances
    after lock-out; the mean normalised innovation squared (NIS) of each kind; the same of means over ten, which
    stays 1 for white innovations and grows with slow errors; the NIS of the first fix after each pause of GNSS; biases
    beyond the budget; two estimates of a parameter, whose difference has the covariance ``P_1 - P_2`` (plus what the
    model lets it move in between), so that a covariance that shrinks although innovations contradict it is seen;
    attitude never determined; a log noisier than the budget; numbers that are none.

    References
    ----------
    Bar-Shalom, Li, Kirubarajan (2001), section 5.4.2, for tests of innovations.
    """
    findings = evidence(result)
    remarks = tuple(_remarks(result))
    if not findings or findings[0].grave < 0:
        return Verdict("ok", remarks=(*(f.sentence for f in findings), *remarks))
    status: Status = "failed" if findings[0].grave else "doubtful"
    return Verdict(status, tuple(f.sentence for f in findings), tuple(causes(result, findings)), remarks)


#: Measurements that each configured aid should have made.
_AIDS = {
    "zero_velocity": "zero_velocity", "zero_rate": "zero_rate", "gravity": "gravity", "earth_rate": "earth_rate",
    "non_holonomic": "lateral", "odometer": "speed", "heading": "heading", "barometer": "height", "fixes": "fix",
}  # fmt: skip


def _remarks(result: NavigationResult) -> Iterator[str]:
    """Antenna without a lever arm, axes without a calibration, aids that never acted, longest time without position."""
    yield from (note for note in result.notes if note.startswith((ANTENNA_POINT, AXES_UNCERTAIN)))
    inn = result.innovations
    acted = {KINDS[int(k)] for k in np.unique(inn.kind[np.isin(inn.status, (ACCEPTED, FORCED))])}
    for aid in result.provenance.get("config", {}).get("aiding", {}):
        kinds = {_AIDS.get(aid, aid), *(("gravity_vector",) if aid == "gravity" else ())}
        kinds |= {"gnss_heading"} if aid == "heading" else set()
        if aid in _AIDS and not acted & kinds:
            own = inn.where(np.isin(inn.kind, [c for c, name in KINDS.items() if name in kinds]))
            why = (
                "it made no measurement"
                if not len(own)
                else ", ".join(
                    f"{int(np.sum(own.status == s))} {word}"
                    for s, word in (
                        (REJECTED, "rejected"),
                        (GATED, "without their condition"),
                        (UNUSED, "outside the run"),
                    )
                    if np.any(own.status == s)
                )
            )
            yield f"aiding.{aid} never acted: {why}"
    placing = np.isin(inn.kind, (POSITION, PSEUDORANGE, RESET_POSITION, FIX)) & np.isin(inn.status, (ACCEPTED, FORCED))
    T = result.trajectory.t
    if not len(T):
        return
    t = inn.t[placing]
    edges = np.concatenate(([T[0]], t, [T[-1]]))
    k = int(np.argmax(np.diff(edges)))
    longest = float(edges[k + 1] - edges[k])
    usual = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    if longest > max(5.0, 5.0 * usual):
        spread = result.sigma("dr")[:, :2].max(axis=1)
        inside = (result.t >= edges[k]) & (result.t <= edges[k + 1])
        if inside.any():
            yield (
                f"free inertial for up to {longest:.0f} s (from {edges[k]:.1f} s, no position used), where the claimed "
                f"1-sigma position grows to {spread[inside].max():.3g} m"
            )
