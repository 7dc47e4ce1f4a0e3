"""The result of a diagnosis: findings with their codes and evidence, and the diagnosis they make up."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed
from schuler.recording.io.hint_texts import SAY_WHICH
from schuler.recording.io.hints import ReadHints

Severity: TypeAlias = Literal["error", "warning", "note"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")

#: Every code, in the order of a summary, and what it means. An error makes results garbage; a warning makes them worse
#: or needs an option; a note is worth knowing.
CODES = {
    "unreadable": "the file could not be read, even leniently",
    "refused": "the reader refuses the log as it stands; the rest was found with its checks lifted",
    "accel_unit": "specific force in another unit than stated, or counts",
    "accel_scale": "specific force at rest is off by a few per cent",
    "no_gravity": "the log holds linear acceleration, gravity was taken out",
    "gyro_unit": "angular rate in another unit than stated, or counts",
    "kind": "increments taken for rates, or rates for increments",
    "gravity_sign": "the accelerometer shows gravity, not specific force",
    "gyro_sign": "the gyroscope turns the other way",
    "handedness": "left-handed axes: two exchanged or one reversed",
    "accel_axes": "accelerometer axes other than those of the gyroscope",
    "gyro_axes": "gyroscope axes other than those of the accelerometer",
    "axes": "the sensor's axes are not forward, right, down",
    "clock_unknown": "nothing relates the clocks of the files",
    "no_overlap": "IMU and GNSS times have nothing in common",
    "leap_seconds": "IMU and GNSS are the leap seconds apart: UTC taken for GPS time or the reverse",
    "time_offset": "the IMU's clock is early or late",
    "time_unit": "time stamps in another unit than stated",
    "clock_drift": "the IMU's clock runs at another rate",
    "position_unit": "latitude and longitude in another unit than stated",
    "position_order": "latitude and longitude exchanged",
    "longitude_sign": "longitude or east velocity with the wrong sign",
    "latitude_sign": "latitude or north velocity with the wrong sign",
    "velocity_axes": "velocity east-north-up (or other axes) taken for north-east-down",
    "vertical_sign": "vertical velocity up taken for down",
    "velocity_unit": "velocity in another unit than stated",
    "velocity_wrong": "velocity does not belong to the positions",
    "height_level": "heights above sea level taken for ellipsoidal, or not stated",
    "height_unit": "heights in another unit than stated",
    "gaps": "samples are missing",
    "jitter": "time stamps jitter",
    "duplicates": "samples repeat the time of the one before",
    "backward_times": "time stamps go back",
    "missing": "values are not numbers",
    "resampled": "the log was interpolated to its rate",
    "repeated": "samples are held: the log is faster than the sensor",
    "saturated": "readings at the end of the range",
    "stuck": "readings that stopped changing",
    "quantised": "noise lost in rounding",
    "spikes": "single samples far off",
    "imu_noise": "more noise at rest than any IMU in use",
    "dead_axis": "an axis that shows nothing",
    "gnss_gaps": "GNSS outages",
    "gnss_repeated": "GNSS positions held while moving",
    "gnss_jumps": "GNSS positions that jump",
    "gnss_noise": "GNSS positions noisier than their accuracies: noise was added, or accuracies are too good",
    "gnss_smoothed": "GNSS solution that was filtered or smoothed",
    "gnss_fused": "GNSS solution that holds inertial data already",
    "gnss_delay": "GNSS velocity late against GNSS positions",
    "mount": "mount angles, estimated",
    "lever_arm": "lever arm to the antenna, estimated",
    "unchecked": "something that could not be checked with this log",
}
#: Likelihood from which on what makes results garbage is an error and stops; what is less likely warns.
SURE = 0.98
_ENTRY = re.compile(r"(?<![\w.])(?:hint )?([a-z_]+)=('[^']*'|[-+]?\d[\d.]*(?:e[-+]?\d+)?|\.\.\.)")
_HINT = re.compile(r"\bhint ([a-z_]+)\b(?!=)")  # named without a value
_PLAIN = re.compile(r"[\w./=,:-]+")
_PART = re.compile(r"(\w+)=\{([^{}]*)\}")  # an entry of a folder


def number_of(count: int, what: str) -> str:
    """``1 gap``, ``2 gaps``.

    Parameters
    ----------
    count : int
    what : str
        In the singular.
    """
    return f"{int(count)} {what}{'s' * (int(count) != 1)}"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing about a log, on what evidence, and what to do.

    Attributes
    ----------
    code : str
        One of :data:`CODES`.
    severity : {"error", "warning", "note"}
        With an error results are garbage, and it is all but certain. What would make them garbage and is merely likely
        is a warning of :class:`Diagnosis`.
    text : str
        One sentence: what was seen and what it means.
    confidence : float
        Likelihood that it is so, judged from the evidence: of findings with 0.9 about nine in ten are right. [0..1]
    fix : str
        The option of the reader that mends it, as in ``units='g,deg/s'``; empty if there is none.
    evidence : dict
        Numbers behind the sentence, units in their names.
    part : str
        Series it is about: imu, gnss, ...
    grave : bool
        Whether results are garbage if it is so.
    """

    code: str
    severity: Severity
    text: str
    confidence: float = 1.0
    fix: str = ""
    evidence: dict[str, Any] = field(default_factory=dict)
    part: str = "imu"
    grave: bool = False

    @property
    def consequence(self) -> str:
        """What it does to results if it is so: ``garbage``, ``worse``, or ``none`` of a note."""
        if self.severity == "error" or self.grave:
            return "garbage"
        return "worse" if self.severity == "warning" else "none"

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "code": self.code,
            "severity": self.severity,
            "part": self.part,
            "text": self.text,
            "confidence": round(self.confidence, 3),
            "if_so": self.consequence,
            "fix": self.fix,
            "evidence": self.evidence,
        }


@dataclass(frozen=True, repr=False)
class Diagnosis(Displayed):
    """Findings about a log, with estimates, segments and uses.

    Attributes
    ----------
    name : str
        Name of the recording.
    findings : tuple of Finding
        Errors first.
    estimates : dict
        Numbers about the set-up with their 1-sigma: ``time_offset_s``, ``mount_deg``, ``lever_arm_m``, ...
    segments : tuple of (float, float, str)
        Start, stop [s] and "static" or "moving".
    supports : tuple of str
        What calibrations and analyses the log can carry, a sentence each.
    checked : tuple of str
        What was looked at.
    curves : dict of str to ndarray
        Series for the pictures of the report.
    """

    name: str
    findings: tuple[Finding, ...] = ()
    estimates: dict[str, Any] = field(default_factory=dict)
    segments: tuple[tuple[float, float, str], ...] = ()
    supports: tuple[str, ...] = ()
    checked: tuple[str, ...] = ()
    curves: dict[str, FloatArray] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        order = list(CODES)
        weighed = [_weighed(f) for f in self.findings]
        weighed.sort(key=lambda f: (SEVERITIES.index(f.severity), order.index(f.code)))
        object.__setattr__(self, "findings", tuple(weighed))

    @property
    def errors(self) -> tuple[Finding, ...]:
        """Findings that make results garbage, all but certain."""
        return tuple(f for f in self.findings if f.severity == "error")

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Findings that make results worse, and such that would make them garbage but are merely likely."""
        return tuple(f for f in self.findings if f.severity == "warning")

    @property
    def ok(self) -> bool:
        """Whether there is no error."""
        return not self.errors

    def sure_errors(self, least: float = SURE) -> tuple[Finding, ...]:
        """Findings that make results garbage and are as likely as that, errors or not."""
        return tuple(f for f in self.findings if f.consequence == "garbage" and f.confidence >= least)

    @staticmethod
    def describe(findings: tuple[Finding, ...]) -> str:
        """Findings with what to do, in one line."""
        return "; ".join(f"{f.code}: {f.text}" + (f" -> {f.fix}" if f.fix else "") for f in findings)

    def require(self, least: float = SURE, *, advice: str = "See schuler check") -> Diagnosis:
        """Itself, if nothing is surely wrong.

        Parameters
        ----------
        least : float
            Likelihood from which on what makes results garbage stops.
        advice : str
            What to do besides, for the message.

        Raises
        ------
        InputError
            If there is an error as sure as that: with each sentence and the option that mends it.
        """
        problems = self.describe(self.sure_errors(least))
        if problems:
            raise InputError(f"{self.name} is not what it is said to be. {problems}. {advice}")
        return self

    def has(self, code: str) -> bool:
        """Whether an error or a warning of this code was found."""
        return any(f.code == code for f in (*self.errors, *self.warnings))

    def codes(self, *severities: str) -> tuple[str, ...]:
        """Codes found, of these severities (errors and warnings if none is named), each once."""
        chosen = severities or ("error", "warning")
        return tuple(dict.fromkeys(f.code for f in self.findings if f.severity in chosen))

    def options(self) -> tuple[str, ...]:
        """The options that mend what was found, errors first, each once."""
        return tuple(dict.fromkeys(f.fix for f in self.findings if f.fix and f.severity != "note"))

    def summary(self, *, command: bool = False, folder: bool = False) -> str:
        """Findings with what to do, segments and uses, as text.

        Parameters
        ----------
        command : bool
            Spell options as those of the command line, not as keywords of Python.
        folder : bool
            Spell them as entries of a configuration, with the section of the part they are about.
        """
        errors, warnings = len(self.errors), len(self.warnings)
        head = f"{self.name}: {errors} error{'s' * (errors != 1)}, {warnings} warning{'s' * (warnings != 1)}"
        lines = [head]
        for severity in SEVERITIES:
            for f in (f for f in self.findings if f.severity == severity):
                sure = "" if severity == "note" else _likelihood(f)
                seen = f.text
                if f.code in ("unreadable", "refused"):  # the reader's words, which say what to do
                    seen = as_options(seen) if command else as_entries(seen) if folder else seen
                lines += textwrap.wrap(
                    f"{severity} {f.code}{sure}: {seen}", 110, initial_indent="  ", subsequent_indent="      "
                )
                if f.fix:
                    fix = as_options(f.fix) if command else as_entries(f.fix, f.part) if folder else f.fix
                    lines += textwrap.wrap(f"-> {fix}", 110, initial_indent="      ", subsequent_indent="         ")
        still = sum(b - a for a, b, what in self.segments if what == "static")
        moving = sum(b - a for a, b, what in self.segments if what == "moving")
        if self.segments:
            lines.append(f"  static {still:.0f} s, moving {moving:.0f} s, {len(self.segments)} segments")
        if self.checked:
            lines += textwrap.wrap(
                "checked: " + ", ".join(self.checked), 110, initial_indent="  ", subsequent_indent="      "
            )
        if self.supports:
            lines.append("  this log can carry:")
            lines += [f"    - {use}" for use in self.supports]
        return "\n".join(lines)

    def _facts(self) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
        rows = [(f.severity, f.code, f.text, f.fix or "-") for f in self.findings if f.severity != "note"]
        return ("severity", "finding", "what was seen", "option that mends it"), rows

    def as_dict(self) -> dict[str, Any]:
        """Everything but the curves as plain values."""
        plain: dict[str, Any] = _plain(
            {
                "format": "schuler/diagnosis/1",
                "name": self.name,
                "ok": self.ok,
                "findings": [f.as_dict() for f in self.findings],
                "options": self.options(),
                "estimates": self.estimates,
                "segments": [{"start_s": a, "stop_s": b, "what": what} for a, b, what in self.segments],
                "supports": self.supports,
                "checked": self.checked,
            }
        )
        return plain

    def to_json(self) -> str:
        """The same as JSON text; numbers that do not exist are null."""
        return json.dumps(self.as_dict(), indent=1, allow_nan=False)

    def report(self, path: Path | str) -> Path:
        """Write a self-contained HTML page with pictures; needs the extra ``report``."""
        from schuler.diagnosis.report.document import diagnosis_report

        return diagnosis_report(path, self)


def _weighed(finding: Finding) -> Finding:
    """The finding as a warning if it would make results garbage but is not sure enough to be an error."""
    if finding.severity != "error" or finding.confidence >= SURE:
        return finding
    return replace(finding, severity="warning", grave=True)


def as_options(fix: str) -> str:
    """What mends a log in the spelling of the command line: ``axes='BRU'`` is ``--axes BRU``.

    Parameters
    ----------
    fix : str
        Of a :class:`Finding`, or a sentence with hints in it.
    """

    def option(match: re.Match[str]) -> str:
        if match[1] not in ReadHints.__dataclass_fields__:
            return match[0]
        name = match[1].replace("_", "-")
        if match.re is _HINT:
            return f"--{name}"
        value = match[2]
        if value.startswith("'"):
            plain = value.strip("'")
            return f"--{name} {plain if _PLAIN.fullmatch(plain) else value}"
        return f"--{name}={value}"

    spelt = _PART.sub(_as_table, _HINT.sub(option, _ENTRY.sub(option, fix)))
    return spelt.replace(SAY_WHICH, "give a file by itself, or say which in [recording] of a --config: ")


def _as_table(match: re.Match[str]) -> str:
    """An entry of a folder as TOML has it: ``imu={'file': 'NAME'}`` is ``imu = {file = "NAME"}``."""
    fields = re.sub(r"'(\w+)': ", r"\1 = ", match[2]).replace("'", '"')
    return f"{match[1]} = {{{fields}}}"


def as_entries(fix: str, part: str = "") -> str:
    """What mends a log in the spelling of a configuration: ``axes='BRU'`` is ``axes = "BRU" in [recording.imu]``.

    Parameters
    ----------
    fix : str
        Of a :class:`Finding`.
    part : str
        Series it is about, if its section is to be named.
    """

    def entry(match: re.Match[str]) -> str:
        is_hint = match[1] in ReadHints.__dataclass_fields__
        return f"{match[1]} = {match[2].replace(chr(39), chr(34))}" if is_hint else match[0]

    def named(match: re.Match[str]) -> str:
        is_hint = match[1] in ReadHints.__dataclass_fields__
        return f"{match[1]} in [recording{part and '.'}{part}]" if is_hint else match[0]

    spelt = _HINT.sub(named, _PART.sub(_as_table, _ENTRY.sub(entry, fix)))
    return f"{spelt.removesuffix(' for the IMU')} in [recording.{part}]" if spelt != fix and part else spelt


def _likelihood(f: Finding) -> str:
    """Likelihood of a finding in brackets, and what it does if so where the severity does not tell; none of a fact."""
    if f.confidence >= 1.0:
        return ""
    garbage = "; garbage if so" if f.severity == "warning" and f.grave else ""
    return f" [{min(100.0 * f.confidence, 99.9):.3g} % likely{garbage}]"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(v) for v in value]
    if isinstance(value, (np.integer, np.bool_)):
        return value.item()
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value


def joined(name: str, parts: tuple[Diagnosis, ...], findings: tuple[Finding, ...]) -> Diagnosis:
    """One diagnosis of parts that were judged by themselves.

    Parameters
    ----------
    name : str
    parts : tuple of Diagnosis
    findings : tuple of Finding
        Besides theirs.
    """
    every = [*findings, *(f for part in parts for f in part.findings)]
    return Diagnosis(
        name,
        tuple(every),
        {k: v for part in parts for k, v in part.estimates.items()},
        tuple(s for part in parts for s in part.segments),
        tuple(dict.fromkeys(use for part in parts for use in part.supports)),
        tuple(dict.fromkeys(what for part in parts for what in part.checked)),
        {k: v for part in parts for k, v in part.curves.items()},
    )
