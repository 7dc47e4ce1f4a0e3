"""What a log leaves open: axes and units are judged by withheld fixes, and what lies on its back is turned over."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from schuler.diagnosis.result import Diagnosis
from schuler.exceptions import SchulerError
from schuler.proposal import cures
from schuler.proposal.decision import Decision
from schuler.proposal.files import Files
from schuler.proposal.imu_model import imu_entries
from schuler.proposal.judgement import Judgement, judged
from schuler.proposal.reading import heads, read_files, read_with, takes
from schuler.recording.series import ImuSeries

_AXES = ("axes", "handedness")  # findings that withheld fixes judge
_BORNE_OUT = 3.0  # standard errors of the mean logarithm of a ratio of errors
_ON_ITS_BACK = 0.7  # cosine of specific force with the axis that should point down; the verdict's limit
_TURNED_OVER = "FLU"  # forward, right, down turned over about the first axis


def likely_axes_by_trial(files: Files, diagnosis: Diagnosis, given: Mapping[str, Any]) -> bool:
    """Axes that are likely, but not sure, are taken where fixes bear them out; whether the hints were changed.

    The log is navigated with the axes and without, and withheld fixes judge. Where they are not predicted better beyond
    doubt, it stays as it was read, with a note: positions do not care what a turned body calls its axes. Where the log
    cannot be navigated, the question stays.
    """
    for f in diagnosis.findings:
        entry = files.entry(f.part)
        if f.code not in _AXES or f.severity == "note" or f.confidence >= cures.SURE or entry is None:
            continue
        new = cures.proposed(f, entry)
        stated = given.get(f.part, {}) if files.by_part else given
        words = {at: value for name, value in (new or {}).items() for at in files.names_of(f.part, name)}
        tried_before = any(d.entry in words for d in files.decisions)
        if not new or any(name in stated for name in new) or tried_before or not takes(files, words):
            continue
        as_read, other = read_files(files), read_with(files, words)
        imu = {"imu": imu_entries(None, as_read.need_imu(), None, heads(files))[0]}
        without, with_them = judged(as_read, imu), judged(other, imu)
        if without is None or with_them is None:
            continue
        numbers = (
            f"{with_them.median:.2g} m with it, {without.median:.2g} m without, after {without.length_s:.2g} s "
            "without fixes"
        )
        likely = f"{f.text} ({100.0 * f.confidence:.0f} % likely)"
        if with_them.better_than(without, _BORNE_OUT):
            files.put(f.part, new)
            files.decisions += [Decision(at, value, f"{likely}; {numbers}") for at, value in words.items()]
            return True
        files.decisions += [Decision(at, None, f"{likely}, but {numbers}") for at in words]
    return False


def borne_out(files: Files, answers: Mapping[str, Mapping[str, Any]]) -> tuple[str, str] | None:
    """The answer to a question on the IMU with which withheld fixes are predicted better than with each other one.

    Parameters
    ----------
    files : Files
    answers : mapping of str to mapping
        Entries of each by its words.

    Returns
    -------
    (str, str) or None
        Its words and the numbers; None where none is better beyond doubt, or an answer cannot be navigated.
    """
    outcomes: dict[str, Judgement] = {}
    for words, entries in answers.items():
        try:
            recording = read_with(files, entries)
            outcome = judged(recording, {"imu": imu_entries(None, recording.need_imu(), None, heads(files))[0]})
        except SchulerError:
            return None
        if outcome is None:
            return None
        outcomes[words] = outcome
    best = min(outcomes, key=lambda words: outcomes[words].median)
    others = {words: outcome for words, outcome in outcomes.items() if words != best}
    if not all(outcomes[best].better_than(other, _BORNE_OUT) for other in others.values()):
        return None
    medians = ", ".join(f"{outcome.median:.2g} m as {words}" for words, outcome in others.items())
    stretch = f"after {outcomes[best].length_s:.2g} s without fixes"
    return best, f"{outcomes[best].median:.2g} m so and {medians}, {stretch}"


def upright_axes(files: Files, diagnosis: Diagnosis, given: Mapping[str, Any]) -> bool:
    """Axes of an IMU whose third one points up are put so that it does; whether the hints were changed.

    Gravity tells up, and the motion whether the log holds specific force. Which axis points forward stays open where
    nothing else told it: positions do not care, and roll and pitch are those of a body on its feet.

    Parameters
    ----------
    files, diagnosis, given
        See :func:`likely_axes_by_trial`.
    """
    entry = files.entry("imu")
    stated = given.get("imu", {}) if files.by_part else given
    if entry is None or "axes" in entry or "axes" in stated:
        return False
    try:
        imu = read_files(files).need_imu()
    except SchulerError:
        return False  # reading says what is missing
    likely = [str((cures.proposed(f, entry) or {}).get("axes", "")) for f in diagnosis.findings if f.code == "axes"]
    axes = next((a for a in likely if a.endswith("U")), _TURNED_OVER)
    words = dict.fromkeys(files.names_of("imu", "axes"), axes)
    if not points_up(imu) or not takes(files, words):
        return False
    if "sign of gravity" not in diagnosis.checked and not _is_specific_force(files, words):
        return False
    files.put("imu", {"axes": axes})
    files.decisions = [d for d in files.decisions if d.entry not in words]
    why = "z points up by gravity; which axis points forward the motion does not tell surely, nor do positions need it"
    files.decisions += [Decision(at, axes, why) for at in words]
    return True


def _is_specific_force(files: Files, upright: Mapping[str, Any]) -> bool:
    """Whether withheld fixes tell axes whose third one points up from a log that holds gravity for specific force."""
    turned = dict.fromkeys(files.names_of("imu", "scale"), "accel=-1")
    if "scale" in (files.entry("imu") or {}) or not takes(files, turned):
        return False
    likely = borne_out(files, {"specific force": upright, "gravity": turned})
    return likely is not None and likely[0] == "specific force"


def points_up(imu: ImuSeries) -> bool:
    """Whether the third axis, which should point down, points up for most of a log.

    Parameters
    ----------
    imu : ImuSeries
        In any unit.
    """
    accel = imu.mean_rates("accel")
    size = np.linalg.norm(accel, axis=1)
    return bool(np.median(accel[:, 2]) > _ON_ITS_BACK * np.median(size))
