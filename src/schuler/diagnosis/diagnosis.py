"""The result of a diagnosis."""

from __future__ import annotations

import json
import textwrap
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.diagnosis.findings import SEVERITIES, Finding
from schuler.exceptions import InputError

#: Errors that are less sure than this stop nothing.
SURE = 0.8


@dataclass(frozen=True)
class Diagnosis:
    """What was found about a log.

    Attributes
    ----------
    name : str
        Of the recording.
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

    @property
    def errors(self) -> tuple[Finding, ...]:
        """Findings that make results garbage."""
        return tuple(f for f in self.findings if f.severity == "error")

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Findings that make results worse."""
        return tuple(f for f in self.findings if f.severity == "warning")

    @property
    def ok(self) -> bool:
        """Whether there is no error."""
        return not self.errors

    def sure_errors(self, least: float = SURE) -> tuple[Finding, ...]:
        """Errors of so much confidence; others stop nothing."""
        return tuple(f for f in self.errors if f.confidence >= least)

    @staticmethod
    def said_of(findings: tuple[Finding, ...]) -> str:
        """Findings with what to do, in one line."""
        return "; ".join(f"{f.code}: {f.text}" + (f" -> {f.fix}" if f.fix else "") for f in findings)

    def require(self, least: float = SURE, *, advice: str = "See schuler check") -> Diagnosis:
        """Itself, if nothing is surely wrong.

        Parameters
        ----------
        least : float
            Confidence of an error that stops.
        advice : str
            What to do besides, for the message.

        Raises
        ------
        InputError
            If there is an error as sure as that: with each sentence and the option that mends it.
        """
        said = self.said_of(self.sure_errors(least))
        if said:
            raise InputError(f"{self.name} is not what it is said to be. {said}. {advice}")
        return self

    def has(self, code: str) -> bool:
        """Whether an error or a warning of this code was found."""
        return any(f.code == code for f in (*self.errors, *self.warnings))

    def codes(self, *severities: str) -> tuple[str, ...]:
        """Codes found, of these severities (errors and warnings if none is named), each once."""
        wanted = severities or ("error", "warning")
        return tuple(dict.fromkeys(f.code for f in self.findings if f.severity in wanted))

    def options(self) -> tuple[str, ...]:
        """The options that mend what was found, errors first, each once."""
        return tuple(dict.fromkeys(f.fix for f in self.findings if f.fix and f.severity != "note"))

    def summary(self) -> str:
        """Findings with what to do, segments and uses, as text."""
        errors, warnings = len(self.errors), len(self.warnings)
        head = f"{self.name}: {errors} error{'s' * (errors != 1)}, {warnings} warning{'s' * (warnings != 1)}"
        lines = [head]
        for severity in SEVERITIES:
            for f in (f for f in self.findings if f.severity == severity):
                sure = f" [{100.0 * f.confidence:.0f} %]" if severity != "note" else ""
                lines += textwrap.wrap(
                    f"{severity} {f.code}{sure}: {f.text}", 110, initial_indent="  ", subsequent_indent="      "
                )
                if f.fix:
                    lines += textwrap.wrap(f"-> {f.fix}", 110, initial_indent="      ", subsequent_indent="         ")
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
