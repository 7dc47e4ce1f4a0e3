"""One self-contained HTML page on what is wrong with a log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from schuler.diagnosis.report.figures import figures
from schuler.files import write_text
from schuler.plotting import parts
from schuler.plotting.page import Section, plotly_script, whole_page

if TYPE_CHECKING:
    from schuler.diagnosis.result import Diagnosis, Finding

_CONVENTIONS = (
    "Conventions: times are those of the log; body axes are forward, right, down, an accelerometer at rest and "
    "level shows "
    "-g on z. An error makes results garbage, a warning worse. Percentages are how sure the diagnosis is of the cause."
)


def diagnosis_report(path: Path | str, diagnosis: Diagnosis) -> Path:
    """Write the page of a diagnosis.

    Parameters
    ----------
    path : Path or str
        The HTML file.
    diagnosis : Diagnosis

    Returns
    -------
    Path
        The file; the same bytes for the same diagnosis.
    """
    shown = figures(diagnosis)
    kinds = (("errors", "Errors"), ("warnings", "Warnings"), ("notes", "Notes"))
    sections = []
    for name, title in kinds:
        chosen = [f for f in diagnosis.findings if f"{f.severity}s" == name]
        sections.append(Section(name, title, (_findings(chosen, title),) if chosen else ()))
    sections.append(Section("evidence", "Evidence", tuple(shown)))
    uses = parts.bullets(diagnosis.supports) if diagnosis.supports else ""
    sections.append(Section("uses", "What this log can carry", (uses,)))
    numbers = [
        (k, v) for f in diagnosis.findings for k, v in parts.provenance_rows({f.code: f.evidence}) if k != "schuler"
    ]
    rows = [*parts.provenance_rows({"estimates": diagnosis.estimates}), *numbers]
    table = parts.table("Numbers behind the findings", ("number", "value"), rows, numbers=False)
    checked = parts.bullets([f"checked: {what}" for what in diagnosis.checked])
    sections.append(Section("numbers", "Numbers", (checked, parts.folded("All numbers", table))))
    text = whole_page(
        diagnosis.name, "Diagnosis", "What is wrong with this log, by physics", _verdict(diagnosis), _CONVENTIONS,
        sections, plotly_script() if shown else "",
    )  # fmt: skip
    return write_text(path, text)


def _verdict(diagnosis: Diagnosis) -> list[str]:
    errors, warnings = len(diagnosis.errors), len(diagnosis.warnings)
    if not errors and not warnings:
        return ["Nothing wrong was found."]
    counts = f"{errors} error{'s' * (errors != 1)}, {warnings} warning{'s' * (warnings != 1)}."
    worst = [f.text[0].upper() + f.text[1:] + "." for f in diagnosis.errors[:2]]
    options = diagnosis.options()
    return [counts, *worst, *([f"To mend it: {'; '.join(options)}"] if options else [])]


def _findings(findings: list[Finding], title: str) -> str:
    rows = [(f"{f.code}\n{f.part}", f.fix or "-", f"{100.0 * f.confidence:.3g} %", f.consequence) for f in findings]
    head = ("finding", "option that mends it", "likely", "if so, results are")
    return parts.table(title, head, rows, numbers=False, explained=[f.text for f in findings])
