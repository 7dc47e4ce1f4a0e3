"""One self-contained HTML page on a calibration: verdicts, parameters, residuals, coverage, what changed."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from schuler.calibration.report.panels import all_figures, correlation_map
from schuler.calibration.report.thermal_figure import thermal_content
from schuler.calibration.result.parameters import GAUGES
from schuler.calibration.result.result import CalibrationResult, Residuals
from schuler.calibration.result.sheet import rounded, sheet
from schuler.calibration.result.summary import correlations, facts, headline, rows, verdicts
from schuler.files import write_text
from schuler.plotting import parts
from schuler.plotting.page import Block, Section, plotly_script, whole_page
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.calibration.field.calibration import FieldCalibration
    from schuler.calibration.report.field_panels import Truth


_CONVENTIONS = (
    "Conventions: axes are forward, right, down, g is 9.80665 m/s², uncertainties are 1 sigma. Errors are added to the "
    "truth: the accelerometers read b_a + (I + M_a) f, the gyroscopes b_g + (I + M_g) ω + G_g f; rows are sensors, "
    "columns body axes, scale-factor errors stand on the diagonal."
)
_OPEN = 12  # a longer table of poses is folded


def calibration_report(
    result: CalibrationResult,
    path: Path | str,
    *,
    title: str | None = None,
    previous: CalibrationResult | None = None,
    recording_summary: str | None = None,
    field: FieldCalibration | None = None,
    truth: Truth | None = None,
) -> Path:
    """Write the report of a calibration.

    Parameters
    ----------
    result : CalibrationResult
    path : Path or str
        The HTML file.
    title : str, optional
        Default: the method.
    previous : CalibrationResult, optional
        An earlier calibration of the same unit: a section says what changed since beyond its uncertainty.
    recording_summary : str, optional
        What was in the log, see :meth:`~schuler.recording.recording.Recording.summary`.
    field : FieldCalibration, optional
        Where the result comes from, if it is a field calibration: a section shows how it came about.
    truth : ImuErrors or mapping of str to float, optional
        True errors, for that section; see :func:`schuler.calibration.report.field_panels.field_panels`.

    Returns
    -------
    Path
        The file; the same bytes for the same arguments.

    Raises
    ------
    InputError
        If ``previous`` has no parameter in common with the result.
    """
    script = plotly_script()
    figures = {f.name: f for f in all_figures(result)}
    sections = [
        Section("parameters", "Parameters", (_gauge(result), _parameters(result), figures.get("parameters", ""))),
        Section("residuals", "Residuals", (_facts(result), figures.get("residuals", ""), *_poses(result))),
        Section("history", "How it came about", () if field is None else _history(field, truth)),
        Section("coverage", "Directions covered", (figures.get("coverage", ""),)),
        Section("before_after", "Before and after", (figures.get("before_after", ""),)),
        Section("temperature", "Over temperature", (thermal_content(result),) if "thermal" in result.extra else ()),
        Section("correlations", "Correlations", (_correlations(result), correlation_map(result) or "")),
        Section("change", "Change since the previous calibration", (_change(result, previous),)),
        Section("extra", "Further results", (_extra(result),)),
        Section("provenance", "Provenance", (_provenance(result, recording_summary),)),
    ]
    sentences = verdicts(result) or ["Nothing speaks against this calibration."]
    text = whole_page(
        title or f"{result.method} calibration", "calibration report", _sentence(headline(result)), sentences,
        _CONVENTIONS, sections, script,
    )  # fmt: skip
    return write_text(path, text)


def _history(field: FieldCalibration, truth: Truth | None) -> tuple[Block, ...]:
    from schuler.calibration.report.field_panels import field_panels

    return (*history_text(field), *field_panels(field, truth))


def _gauge(result: CalibrationResult) -> str:
    return f"<p>{escape(f'Body axes (gauge {result.gauge}): {GAUGES[result.gauge]}.')}</p>"


def _parameters(result: CalibrationResult) -> str:
    table = []
    with_prior = bool(result.observability)
    for name, value, spread, unit, si, si_sigma, left in rows(result):
        s = sheet(name)
        undetermined = spread == "not determined"
        in_sheet = (
            spread
            if undetermined
            else f"{value} {unit}\n{spread}"
            if spread == "held"
            else f"{value} {unit}\n± {spread}"
        )
        in_si = (
            ""
            if undetermined
            else f"{si} {s.si}".removesuffix(" -") + ("" if si_sigma == "held" else f"\n± {si_sigma}")
        )
        table.append((f"{name}: {s.meaning}", in_sheet, in_si, *([left] if with_prior else [])))
    if not table:
        return ""
    heads = ("parameter", "data sheet, 1 sigma", "SI, 1 sigma", *(["left of what was known"] if with_prior else []))
    return parts.table("Estimated parameters, then those that were held", heads, table)


def _facts(result: CalibrationResult) -> str:
    table = [(name, text) for name, text in facts(result) if name != "strongest correlation"]
    return parts.table("The fit as a whole", ("item", "value"), table, numbers=False) if table else ""


def _poses(result: CalibrationResult) -> list[str]:
    return [_pose_table(name, r) for name, r in result.residuals.items() if len(r.value)]


def _pose_table(name: str, r: Residuals) -> str:
    heads = ["pose or turn", f"residual [{r.unit}]", "1 sigma", "sigmas"]
    heads += [] if r.before is None else ["before"]
    table = []
    for k, label in enumerate(r.label):
        sigmas = f"{r.value[k] / r.sigma[k]:+.1f}" if r.sigma[k] > 0.0 and np.isfinite(r.sigma[k]) else "-"
        before = [] if r.before is None else [f"{r.before[k]:+.3g}"]
        table.append((label, f"{r.value[k]:+.3g}", f"{r.sigma[k]:.2g}", sigmas, *before))
    html = parts.table(f"Residuals {name}", heads, table)
    return html if len(table) <= _OPEN else parts.folded(f"{name}: {len(table)} residuals", html)


def _correlations(result: CalibrationResult) -> str:
    blocks = correlations(result, 10, above=0.5)
    if not blocks:
        return ""
    return (
        "<p>Pairs that the data tell apart badly: where one is wrong, the other is too. Further poses that differ in "
        "both help.</p>\n" + parts.bullets(blocks)
    )


def _change(result: CalibrationResult, previous: CalibrationResult | None) -> str:
    if previous is None:
        return ""
    difference = previous.compare(result)
    table = [(f"{n}: {sheet(n).meaning}", f"{v} {u}\n± {s}", z) for n, v, s, u, z in difference.rows()]
    html = parts.table("This calibration less the previous one", ("parameter", "difference, 1 sigma", "sigmas"), table)
    axes = f"Both in the body axes of the gauge {difference.gauge}."
    return "".join(f"<p>{escape(s)}</p>" for s in (*difference.sentences(), axes)) + "\n" + html


def _extra(result: CalibrationResult) -> str:
    if not result.extra:
        return ""
    table = [
        (k, v if len(v) < 400 else f"{v[:400]}...") for k, v in parts.provenance_rows({"schuler": "", **result.extra})
    ]
    return parts.table("What this method found besides", ("item", "value"), table[1:], numbers=False)


def _provenance(result: CalibrationResult, recording_summary: str | None) -> str:
    table = parts.provenance_rows(result.provenance)
    text = parts.table("What this result was made from", ("item", "value"), table, numbers=False)
    if recording_summary:
        text += "\n<h3>The recording</h3>\n<pre>" + escape(recording_summary) + "</pre>"
    return text


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def history_text(calibration: FieldCalibration) -> tuple[str, ...]:
    """Sentences on the passes, notes on the rests, and the time from which each parameter is calibrated, as HTML."""
    sentences = [calibration.rests.summary().splitlines()[0], passes_sentence(calibration)]
    if calibration.heading is not None:
        angle, sigma = (v / DEG for v in calibration.heading)
        sentences.append(f"heading of the first rest, found from the Earth's rate: {angle:.0f} ± {sigma:.0f} deg")
    text = "".join(f"<p>{escape(s[:1].upper() + s[1:])}.</p>" for s in sentences)
    notes = parts.bullets(calibration.rests.notes) if calibration.rests.notes else ""
    return text, notes, _convergence_table(calibration)


def passes_sentence(calibration: FieldCalibration) -> str:
    """Number of passes, and the largest change in the last one."""
    if len(calibration.passes) < 2:
        return "one pass, linearised at the estimates of its time: errors that are large leave a trace in others"
    change = f"the last moved no parameter by more than {calibration.last_move:.2g} sigma"
    return f"{len(calibration.passes)} passes over the log, {change}"


def _convergence_table(calibration: FieldCalibration) -> str:
    history = calibration.history
    reached = history.reached()
    first = float(calibration.rests.start[0])
    rows = []
    for i, name in enumerate(history.names):
        s = sheet(name)
        sigma = history.sigma[-1, i]
        after = reached[name] - first
        rows.append(
            (
                f"{name}: {s.meaning}",
                f"{history.prior_sigma[i] / s.factor:.3g} {s.unit}",
                f"{rounded(history.values[-1, i] / s.factor, sigma / s.factor)[1]} {s.unit}",
                f"{100.0 * sigma / history.prior_sigma[i]:.2g} %",
                f"{after:.0f} s" if np.isfinite(after) else "-",
            )
        )
    heads = ("parameter", "1 sigma before", "1 sigma after", "left", "below a tenth from")
    return parts.folded(f"when {len(rows)} parameters were found", parts.table("Uncertainty over the log", heads, rows))
