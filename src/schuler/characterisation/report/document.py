"""One self-contained HTML page on identified noise: verdict, findings, numbers with their meaning, curves, budget."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from pathlib import Path

from schuler.characterisation.report import figures as noise_figures
from schuler.characterisation.report.spectra import Curve
from schuler.characterisation.report.terms import FIELDS, Quantity, Unit, chosen, numbers, quantities, quantity
from schuler.characterisation.report.text import (
    findings,
    headline,
    meaning,
    read_off_rows,
    rounded,
    span,
    turn_on_rows,
    verdict,
)
from schuler.characterisation.result import AxisNoise, Estimate, NoiseIdentification
from schuler.files import write_text
from schuler.plotting import parts
from schuler.plotting.page import Section, plotly_script, whole_page
from schuler.recording.series import ImuSeries
from schuler.sensors.spec import TriadSpec

_CONVENTIONS = (
    "Conventions: body axes are forward, right, down. Curves are overlapping Allan deviations of rates. N² is "
    "the two-sided power spectral density, so a sample at rate f has the standard deviation N √f, and a one-sided "
    "density is √2 N. B is the coefficient of 1/f noise of IEEE Std 952, the flat part of a curve lies at 0.664 B. "
    "Brackets are 95 % intervals. g is 9.80665 m/s²."
)


def noise_report(
    identification: NoiseIdentification,
    path: Path | str,
    *,
    title: str | None = None,
    imu: ImuSeries | None = None,
    spectra: Mapping[str, Curve] | None = None,
    correlations: Mapping[str, Curve] | None = None,
    recording_summary: str | None = None,
    unit: Unit = "datasheet",
) -> Path:
    """Write the report of a noise identification.

    Parameters
    ----------
    identification : NoiseIdentification
    path : Path or str
        The HTML file.
    title : str, optional
        Default: the name of the identification.
    imu : ImuSeries, optional
        The recording, to show the log itself.
    spectra : mapping of str to (ndarray, ndarray), optional
        Axis to frequencies [Hz] and two-sided densities [x^2/Hz].
    correlations : mapping of str to (ndarray, ndarray), optional
        Axis to lags [s] and autocovariances [x^2].
    recording_summary : str, optional
        What was in the log, see :meth:`~schuler.recording.recording.Recording.summary`.
    unit : {"datasheet", "si"}
        Units of the figures; tables have both.

    Returns
    -------
    Path
        The file; the same bytes for the same arguments.
    """
    script = plotly_script()
    name = title or identification.name
    figures = noise_figures.all_figures(
        identification, imu=imu, spectra=spectra, correlations=correlations, unit=unit
    )  # fmt: skip
    axes = chosen(identification, None) if identification.axes else []
    sections = [
        Section("findings", "Findings", (_findings(identification),)),
        Section("numbers", "Numbers", tuple(_numbers(axis) for axis in axes)),
        Section("curves", "Allan curves", tuple(f for f in figures if f.name.startswith("allan"))),
        Section("signal", "Spectrum and log", tuple(f for f in figures if not f.name.startswith("allan"))),
        Section("reading", "Read off and fitted", (_read_off(axes),)),
        Section("models", "Models tried", (_candidates(axes),)),
        Section("turn-on", "Switch-ons", (_turn_on(identification),)),
        Section("budget", "Budget", (_budget(identification),)),
        Section("notes", "Notes", (parts.notes(identification.notes),)),
        Section("provenance", "Provenance", (_provenance(identification, recording_summary),)),
    ]
    text = whole_page(
        name, "noise report", f"Noise report. {headline(identification)}", verdict(identification), _CONVENTIONS,
        sections, script,
    )  # fmt: skip
    return write_text(path, text)


def _findings(identification: NoiseIdentification) -> str:
    rows = []
    for where, f in findings(identification):
        place = "all of it"
        if f.start_s is not None:
            place = f"{f.start_s:.6g} s" if f.stop_s is None else f"{f.start_s:.6g} to {f.stop_s:.6g} s"
        rows.append((f"{f.severity}: {where}, {place}", f.text))
    if not rows:
        return ""
    caption = "What a reader should know before believing a number; refused means that none is given"
    return parts.table(caption, ("where", "what was seen, what it does, what to do"), rows, numbers=False)


def _numbers(axis: AxisNoise) -> str:
    rows, explained = [], []
    for label, q, e in numbers(axis):
        rows.append((_name(axis, label, q), *_both(e, q)))
        explained.append(meaning(axis, label))
    rows.append(("mean of the log", *_both(axis.mean, quantity(axis, "sample"))))
    explained.append("Bias plus what the sensor really felt: Earth rate or gravity. Not noise.")
    heads = ("number, 95 % interval", "data sheet", "SI")
    return f"<h3>{escape(axis.axis)}</h3>\n" + parts.table(
        f"{span(axis.duration_s)} at {axis.rate_hz:g} Hz, method {axis.method or 'not stated'}",
        heads, rows, explained=explained,
    )  # fmt: skip


def _name(axis: AxisNoise, label: str, q: Quantity) -> str:
    several = label.startswith("GM") and len(axis.gauss_markov) > 1
    return f"{q.name} ({label.split()[0]})" if several else q.name


def _both(e: Estimate, q: Quantity) -> tuple[str, str]:
    """Value and interval in data-sheet units and, where that is something else, in SI."""
    value, low, high = rounded(e, q.factor)
    sheet = f"{value} {q.sheet}\n{low} to {high}"
    if q.si == q.sheet:
        return sheet, ""
    value, low, high = rounded(e)
    return sheet, f"{value} {q.si}\n{low} to {high}"


def _read_off(axes: list[AxisNoise]) -> str:
    tables = []
    for axis in axes:
        rows = read_off_rows(axis)
        if rows:
            heads = ("", "read off", "fitted")
            tables.append(
                parts.table(axis.axis, heads, [row[:3] for row in rows], explained=[_sentence(row[3]) for row in rows])
            )
    if not tables:
        return ""
    return (
        "<p>Many programs read N at 1 s, B at the minimum and K at 3 s off the curve. Each of these points holds the "
        "noise of all terms, so a reading is too large wherever another term is not small there. The fit takes the "
        "terms apart; simulators and filters should use the fitted values.</p>\n" + "\n".join(tables)
    )


def _candidates(axes: list[AxisNoise]) -> str:
    tables = []
    for axis in axes:
        if axis.candidates:
            best = axis.candidates[0].criterion
            rows = [(c.terms, f"{c.misfit:.4g}", str(c.freedom), f"{c.criterion - best:.4g}") for c in axis.candidates]
            text = parts.table(axis.axis, ("terms", "misfit", "freedom", "criterion less the best"), rows)
            tables.append(text if len(rows) <= 6 else parts.folded(f"{axis.axis}: {len(rows)} models", text))
    if not tables:
        return ""
    return (
        "<p>The chosen model stands first. A misfit near the freedom (averaging times less parameters) means that the "
        "model explains the curve. The last column is what speaks against the others: a superfluous parameter alone "
        "makes about 4.</p>\n" + "\n".join(tables)
    )


def _turn_on(identification: NoiseIdentification) -> str:
    rows = turn_on_rows(identification)
    if not rows:
        return ""
    return (
        "<p>The mean is what a calibration takes off, with Earth rate or gravity in it; the spread is what is left at "
        "the next switch-on, the turn-on bias of gyroscopes in the budget.</p>\n"
        + parts.table("", ("axis, records", "mean, 95 % interval", "spread, 95 % interval"), rows)
    )


def _budget(identification: NoiseIdentification) -> str:
    spec = identification.spec
    if spec is None:
        return (
            "<p>There is no budget: a triad has no axis left. The numbers of the axes above hold nevertheless.</p>"
            if identification.axes
            else ""
        )
    tables = []
    for triad, title in (("gyro", "Gyroscope"), ("accel", "Accelerometer")):
        budget, sigma = getattr(spec, triad), identification.spec_sigma.get(triad, {})
        rows = [_budget_row(triad, field, value, sigma.get(field)) for field, value in _entries(budget)]
        tables.append(parts.table(f"{title}, one value for the three axes", _BUDGET_HEADS, rows))
    return (
        "<p>One set of numbers for each triad, for simulator and filter; written to the budget file as they stand "
        "here.</p>\n" + "\n".join(tables)
    )


_BUDGET_HEADS = ("entry", "data sheet", "SI", "1-sigma uncertainty")


def _entries(budget: TriadSpec) -> list[tuple[str, float]]:
    return [(field, value) for field, value in budget.to_dict().items() if value]


def _budget_row(triad: str, field: str, value: float, sigma: float | None) -> tuple[str, str, str, str]:
    uncertain = "not stated" if sigma is None else f"{100.0 * sigma:.2g} %"
    if field in FIELDS:
        q = quantities(triad)[FIELDS[field]]
        name = {"sigma": "in-run bias (Gauss-Markov)", "sample": "turn-on bias"}.get(FIELDS[field], q.name)
        return name, f"{value / q.factor:.4g} {q.sheet}", f"{value:.4g} {q.si}", uncertain
    name, unit = ("its correlation time", " s") if field == "in_run_time" else (field.replace("_", " "), "")
    return name, f"{value:.4g}{unit}" if unit else "", f"{value:.4g}{unit}", uncertain


def _provenance(identification: NoiseIdentification, recording_summary: str | None) -> str:
    rows = parts.provenance_rows(identification.provenance)
    text = parts.table("What this result was made from", ("item", "value"), rows, numbers=False)
    if recording_summary:
        stated = {f"- {note}" for note in identification.notes}
        lines = [line for line in recording_summary.splitlines() if line.strip() not in stated]
        text += "\n<h3>The recording</h3>\n<pre>" + escape("\n".join(lines)) + "</pre>"
    return text


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."
