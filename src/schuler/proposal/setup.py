"""Set-up of a run: clock, mount, lever arm and aids, each where the log shows it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np

from schuler.diagnosis.result import Diagnosis
from schuler.proposal.cures import SURE
from schuler.proposal.decision import Decision
from schuler.proposal.judgement import Judgement, judged
from schuler.recording.recording import Recording
from schuler.toml import merged

#: Entries, what speaks for them, and standard errors by which they must predict better.
Trial: TypeAlias = tuple[dict[str, Any], str, float]
_CLEARLY, _EVIDENT = 2.0, 1.0  # of what may well be so, and of what was measured at three standard errors and more
#: Of what the motion across shows by itself: it may not predict worse by more than chance.
_SHOWN, _MOST_EXPLAINED = -1.0, 0.8
_VEHICLE = 0.4  # share of accelerations along and across that the path explains, of a body that goes where it points
_DRIVES_M_S = 4.0  # speed that one walks not
_LEVEL = 0.25  # climb over speed that no road has
_LEAST_CLOCK_S, _LEAST_MOUNT_DEG = 0.03, 2.0


def certain(recording: Recording, diagnosis: Diagnosis) -> list[Decision]:
    """Decisions that need no trial.

    Parameters
    ----------
    recording : Recording
        As it is to be navigated.
    diagnosis : Diagnosis
        Of it.
    """
    out = []
    if recording.gnss is None and recording.ranges is None and recording.observations is not None:
        out.append(Decision("gnss.coupling", "tight", "there are satellite measurements and no fixes"))
    clock = next((f for f in diagnosis.findings if f.code == "time_offset"), None)
    if clock is not None and clock.confidence >= SURE:
        value = round(float(diagnosis.estimates["time_offset_s"]), 3)
        out.append(Decision("imu.clock_shift_s", value, clock.text))
    return out


def trials(recording: Recording, diagnosis: Diagnosis) -> Iterator[Trial]:
    """Entries worth trying, one after the other.

    Parameters
    ----------
    recording, diagnosis
        See :func:`certain`.
    """
    estimates, gnss = diagnosis.estimates, recording.gnss
    if gnss is None:
        return
    yield from _wheels(recording, diagnosis)
    if recording.odometer is not None:
        yield {"aiding.odometer": {}}, "the log has wheel speeds", _CLEARLY
    still = [b - a for a, b, what in diagnosis.segments if what == "static"]
    if still:
        at_rest = f"it rests {len(still)} times, {sum(still):.0f} s in all"
        yield {"aiding.zero_velocity": {}, "aiding.zero_rate": {}}, at_rest, _CLEARLY
    offset, sigma = estimates.get("time_offset_s"), estimates.get("time_offset_sigma_s")
    if offset is not None and sigma is not None and abs(offset) > max(3.0 * sigma, _LEAST_CLOCK_S):
        shown = f"turns and accelerations of IMU and fixes agree {offset:+.3f} s apart (1-sigma {sigma:.3f} s)"
        shift = round(float(offset), 3)
        yield {"imu.clock_shift_s": shift}, shown, _EVIDENT
    late = next((f for f in diagnosis.findings if f.code == "gnss_delay"), None)
    if late is not None:
        yield {"gnss.velocity_delay_s": round(-float(late.evidence["gap_s"]), 3)}, late.text, _EVIDENT
        yield {"gnss.velocity": False}, late.text, _CLEARLY


def _wheels(recording: Recording, diagnosis: Diagnosis) -> Iterator[Trial]:
    """Wheels that do not slip, at mount angles that were measured and without these."""
    if not drives(recording, diagnosis):
        return
    estimates = diagnosis.estimates
    along, across = (100.0 * x for x in estimates["explained_by_imu"][1:])
    wheels = (
        f"it goes where it points: the path explains {along:.0f} % of accelerations along and {across:.0f} % across"
    )
    mount, sigma = estimates.get("mount_deg"), estimates.get("mount_sigma_deg")
    # where the motion does not show which axis points forward, the fixes have to
    shown = mount is not None and estimates["explained_by_imu"][2] > _MOST_EXPLAINED
    least = _SHOWN if shown else _CLEARLY
    if mount is not None and sigma is not None:
        large = np.abs(mount) > np.maximum(2.0 * np.array(sigma), _LEAST_MOUNT_DEG)
        if large.any():
            angles = [round(float(x), 1) for x in np.where(large, mount, 0.0)]
            yield {"imu.mount_rpy_deg": angles, "aiding.non_holonomic": {}}, wheels, least
    yield {"aiding.non_holonomic": {}}, wheels, least


def drives(recording: Recording, diagnosis: Diagnosis) -> bool:
    """Whether what carries the IMU is a vehicle on wheels by all it shows.

    Parameters
    ----------
    recording, diagnosis
        See :func:`certain`.
    """
    explained, gnss = diagnosis.estimates.get("explained_by_imu"), recording.gnss
    if explained is None or gnss is None:
        return False
    if (
        explained[2] > _MOST_EXPLAINED
    ):  # what is felt across is speed times turn: only wheels hold a body so, fast or slow
        return True
    if min(explained[1:]) < _VEHICLE:
        return False
    if gnss.v_n is None:
        dt = np.maximum(np.diff(gnss.t), 1e-3)
        north, east = np.diff(gnss.llh[:, 0]) * 6.371e6, np.diff(gnss.llh[:, 1]) * 6.371e6 * np.cos(gnss.llh[1:, 0])
        return bool(np.quantile(np.hypot(north, east) / dt, 0.9) > _DRIVES_M_S)
    speed = np.hypot(gnss.v_n[:, 0], gnss.v_n[:, 1])
    fast = speed > _DRIVES_M_S
    return bool(np.mean(fast) > 0.1 and np.median(np.abs(gnss.v_n[fast, 2]) / speed[fast]) < _LEVEL)


def tried(recording: Recording, diagnosis: Diagnosis, data: dict[str, Any]) -> tuple[dict[str, Any], list[Decision]]:
    """Entries put in that predict withheld fixes better than without them, one trial after the other.

    Parameters
    ----------
    recording, diagnosis
        See :func:`certain`.
    data : dict
        Configuration so far; what stands in it is not tried otherwise.

    Returns
    -------
    data : dict
    decisions : list of Decision
        What was taken, and with the value None what was not.
    """
    decisions: list[Decision] = []
    base: Judgement | None = None
    for entries, evidence, least in trials(recording, diagnosis):
        if any(has(data, name) for name in entries):
            continue
        if base is None:
            base = judged(recording, data)
            if base is None:
                break
        other = merged(data, nested(entries))
        outcome = judged(recording, other)
        if outcome is None:
            continue
        names = list(entries)
        after = f"after {base.length_s:.0f} s without fixes"
        numbers = f"{outcome.median:.2g} m with it, {base.median:.2g} m without, {after}"
        if outcome.better_than(base, least):
            data, base = other, outcome
            decisions += [Decision(name, entries[name], f"{evidence}; {numbers}") for name in names]
        else:
            decisions.append(Decision(names[-1], None, f"{evidence}, but {numbers}"))
    taken = {d.entry for d in decisions if d.value is not None}
    return data, [d for d in decisions if d.value is not None or d.entry not in taken]


def nested(entries: dict[str, Any]) -> dict[str, Any]:
    """Entries named with dots as nested sections.

    Parameters
    ----------
    entries : dict
    """
    out: dict[str, Any] = {}
    for name, value in entries.items():
        *sections, last = name.split(".")
        at = out
        for section in sections:
            at = at.setdefault(section, {})
        at[last] = value
    return out


def has(data: dict[str, Any], name: str) -> bool:
    """Whether an entry named with dots is there.

    Parameters
    ----------
    data : dict
    name : str
    """
    at: Any = data
    for part in name.split("."):
        if not isinstance(at, dict) or part not in at:
            return False
        at = at[part]
    return True
