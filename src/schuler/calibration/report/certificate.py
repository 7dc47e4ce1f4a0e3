"""Certificate of a calibration: an HTML page made for print on A4, results with k = 2 in the units of data sheets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arguments import explains_arguments
from schuler.calibration.result.application import description
from schuler.calibration.result.halves import halves_words
from schuler.calibration.result.parameters import GAUGES
from schuler.calibration.result.result import CalibrationResult, Residuals
from schuler.calibration.result.session import Session, session_of
from schuler.calibration.result.sheet import sheet
from schuler.calibration.result.summary import unit_weight_probability, verdicts
from schuler.exceptions import InputError
from schuler.files import package_version, write_text
from schuler.plotting.style import PAGE_LIGHT, STYLES
from schuler.units import DEG

COVERAGE = 2.0  # factor k of the expanded uncertainties
#: What each method compares the sensors with.
_METHODS = {
    "sixposition": ("Six faces up in turn, at rest", "mean rates at rest, and the Earth's rate with headings"),
    "multiposition": (
        "Poses at rest of any direction; magnitudes of gravity and of the Earth's or a table's rate",
        "magnitude of the Earth's rate, or of the table's",
    ),
    "freepose": (
        "Poses put down by hand; accelerometers from the magnitude of gravity, gyroscopes from the turns between poses",
        "turns between poses, whose size follows from gravity before and after; biases from rests",
    ),
    "ratetable": ("Turned at known rates about the axes", "rates that the table was set to"),
    "ferraris": ("Six faces and one turn about each axis by hand", "whole turns by a stated angle"),
    "thermal": ("Heated and cooled", "rates at rest"),
    "field": (
        "Turned by hand between rests; error-state filter with rests as measurements",
        "Earth's rate at rest and turns between rests",
    ),
    "poses": ("Mean readings of stated poses", "rates at rest, or those of a reference in the table"),
}  # fmt: skip
#: What the accelerometers' scale factors inherit from gravity, by the first word of its source.
_OF_GRAVITY = {
    "standard": "gravity of the place, up to 2700 ppm off in scale factors; state latitude and height, or gravity",
    "normal": "gravity anomaly, typically 30 ppm of the scale factors of the accelerometers",
}
_SENSORS = {"a": "Accelerometers", "g": "Gyroscopes", "m": "Magnetometer", "r": "Places and delay"}
_INK, _BLUE, _LETTERS = PAGE_LIGHT["muted"], STYLES["filtered"].light, PAGE_LIGHT["ink"]


@explains_arguments
def calibration_certificate(result: CalibrationResult, path: Path | str) -> Path:
    """Write the certificate of a calibration.

    Parameters
    ----------
    result : CalibrationResult
        With its :class:`~schuler.calibration.result.session.Session`: serial number, operator, place, date.
    path : Path or str
        The HTML file; printed from a browser it takes one or two pages of A4.

    Returns
    -------
    Path
        The file; the same bytes for the same arguments.

    Raises
    ------
    InputError
        If the calibration was refused, or has no serial number: a certificate is of one unit.

    Examples
    --------
    >>> from schuler.calibration import Session, result_from, with_session
    >>> result = result_from("sixposition", {"b_a_x": (0.098, 0.001), "b_g_x": (1e-3, 1e-5)}, "full")
    >>> session = Session(serial="SN-0417", operator="A. Meyer", place="Lab 2", date="2025-03-03", gravity=9.807)
    >>> schuler.calibration_certificate(with_session(result, session), "certificate.html").name
    'certificate.html'
    """
    session = session_of(result)
    if result.status == "refused":
        raise InputError("certificate: expected a calibration that can be used, got one that was refused")
    if not session.serial:
        raise InputError(
            "certificate: expected the serial number of the unit, got none; state it when calibrating (--serial)"
        )
    return write_text(path, certificate_text(result, session))


def certificate_text(result: CalibrationResult, session: Session) -> str:
    """HTML of :func:`calibration_certificate`; it loads nothing from anywhere."""
    version = str(result.provenance.get("schuler", package_version()))
    style = (resources.files("schuler.plotting") / "assets" / "certificate.css").read_text(encoding="utf-8").strip()
    foot = f"{session.serial}, {session.date or 'undated'}; calibration {description(result)['sha256'][:12]}"
    quoted = foot.replace("\\", "").replace('"', "'").replace("<", "").replace("\n", " ")
    remarks = verdicts(result)
    body = [
        _head(result, session),
        _status(result, remarks),
        '<div class="two wide">',
        _facts("Unit and conditions", _conditions(result, session)),
        _facts("Method", _method(result)),
        "</div>",
        _results(result),
        _residuals(result),
        '<div class="two">',
        _facts("Traceability", _traceability(result, session)),
        _remarks(remarks),
        "</div>",
        _inputs(result, version),
        '<div class="sign">'
        + "".join(f"<p>{escape(t)}</p>" for t in (session.operator or "operator", "date", "signature"))
        + "</div>",
    ]
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; img-src data:">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="schuler {escape(version)}">
<title>Calibration certificate {escape(session.serial)}</title>
<link rel="icon" href="data:,">
<style>
:root {{ --foot: "{quoted}"; }}
{style}
</style>
</head>
<body>
<main>
{chr(10).join(part for part in body if part)}
</main>
</body>
</html>
"""


def expanded(value: float, sigma: float) -> tuple[str, str]:
    """Value and expanded uncertainty (k = 2) as text: two significant digits of U, the value to the same place.

    Parameters
    ----------
    value, sigma : float
        In one unit; sigma is the standard uncertainty.

    Returns
    -------
    (str, str)
        ``("+12.35", "0.84")``; ``("+12300", "1200")`` where the second digit stands before the point.

    References
    ----------
    JCGM 100:2008 (GUM), 7.2.6.
    """
    U = COVERAGE * sigma
    if not math.isfinite(U):
        return "-", "not determined"
    if U <= 0.0:
        return f"{value:+.6g}", "held"
    # the exponent after rounding: 0.0996 is 0.10, not 0.100
    exponent = int(f"{U:.1e}".partition("e")[2])
    places = 1 - exponent
    if places > 9:
        return f"{value:+.6e}", f"{U:.1e}"
    if places >= 0:
        return f"{value:+.{places}f}", f"{U:.{places}f}"
    step = 10**-places
    return f"{round(value / step) * step:+d}", f"{round(U / step) * step:d}"


def _head(result: CalibrationResult, session: Session) -> str:
    where = ", ".join(t for t in (session.place, session.date) if t)
    return (
        '<div class="head"><div><h1>Calibration certificate</h1>'
        f"<p>inertial measurement unit{': ' if where else ''}{escape(where)}</p></div>"
        f'<div class="serial">{escape(session.serial)}</div></div>'
    )


def _status(result: CalibrationResult, remarks: Sequence[str]) -> str:
    words = "The calibration can be used" + (" with care: see the remarks." if result.status == "warning" else ".")
    uncertainty = (
        "Stated is the expanded uncertainty U, the standard uncertainty times the coverage factor k = 2, which for a "
        "normal distribution holds 95 % (JCGM 100, GUM). What it does not contain stands under traceability."
    )
    return f'<div class="status {result.status}"><p><b>{words}</b> {escape(uncertainty)}</p></div>'


def _facts(title: str, rows: Sequence[tuple[str, str]]) -> str:
    lines = "".join(f'<tr><th scope="row">{escape(a)}</th><td>{escape(b)}</td></tr>\n' for a, b in rows if b)
    return f'<section class="whole"><h2>{escape(title)}</h2>\n<table class="facts">{lines}</table></section>'


def _conditions(result: CalibrationResult, session: Session) -> list[tuple[str, str]]:
    warm = session.temperature_range
    if "thermal" in result.extra:
        low, high = result.extra["thermal"]["range"]
        temperature = f"{low:.1f} to {high:.1f} °C; values at {result.extra['thermal']['reference_temperature']:.1f} °C"
    elif warm is not None:
        temperature = f"{warm[0]:.1f} to {warm[1]:.1f} °C, as the sensor says"
    elif result.temperature is not None:
        temperature = f"{result.temperature:.1f} °C, as the sensor says"
    else:
        temperature = "not measured"
    latitude = "" if session.latitude is None else f"{session.latitude / DEG:.4f}°"
    return [
        ("serial number", session.serial), ("date", session.date or "not stated"), ("place", session.place),
        ("latitude", latitude), ("operator", session.operator), ("temperature", temperature),
    ]  # fmt: skip


def _method(result: CalibrationResult) -> list[tuple[str, str]]:
    words, _ = _METHODS.get(result.method, (result.method, ""))
    accel, gyro = result.nominal
    counts = "" if result.nominal == (1.0, 1.0) else f"{accel:.8g} m/s² and {gyro:.8g} rad/s in a unit of the log"
    p = unit_weight_probability(result)
    fit = (
        ""
        if p is None
        else f"variance of unit weight {result.variance_of_unit_weight:.2f}, {result.freedom} degrees of freedom"
    )
    return [
        ("procedure", f"{words} ({result.method})"), ("body axes", GAUGES[result.gauge]),
        ("model", "f_meas = b_a + (I + M_a) f, ω_meas = b_g + (I + M_g) ω + G_g f; forward, right, down"),
        ("nominal factors", counts), ("fit", fit), ("halves of the data", halves_words(result) or ""),
    ]  # fmt: skip


def _results(result: CalibrationResult) -> str:
    columns = []
    for letter in "agmr":
        names = [n for n in (*result.names, *result.fixed) if (n[2] if n[0] in "bMGQ" else "r") == letter]
        if table := _table(result, names):
            columns.append(f'<div><table><thead><tr><th scope="col">{_SENSORS[letter]}</th><th scope="col" class="n">'
                           f'value</th><th scope="col" class="n">U (k = 2)</th></tr></thead>\n<tbody>{table}</tbody>'
                           "</table></div>")  # fmt: skip
    held = [n for n in result.fixed if result.fixed[n] == 0.0]
    note = f'<p class="small">Held at zero: {escape(", ".join(held))}.</p>' if held else ""
    return f'<section><h2>Results</h2>\n<div class="two">{"".join(columns)}</div>{note}</section>'


def _table(result: CalibrationResult, names: Sequence[str]) -> str:
    """Rows of one triad, with a head for each family of parameters; what is held at zero is left out."""
    lines, family = [], ""
    families = list(dict.fromkeys(sheet(n).family for n in names))
    for name in sorted(names, key=lambda n: families.index(sheet(n).family)):
        value, sigma = result[name]
        if name in result.fixed and value == 0.0:
            continue
        s = sheet(name)
        if s.family != family:
            family = s.family
            text = f"{family[:1].upper()}{family[1:]} [{s.unit}]"
            lines.append(f'<tr class="family"><th scope="colgroup" colspan="3">{escape(text)}</th></tr>')
        number, U = expanded(value / s.factor, sigma / s.factor)
        lines.append(
            f'<tr><th scope="row">{escape(name)}</th><td class="n">{escape(number)}</td>'
            f'<td class="n">{escape(U)}</td></tr>'
        )
    return "\n".join(lines)


def _residuals(result: CalibrationResult) -> str:
    plots = [_plot(name, r) for name, r in result.residuals.items() if len(r.value)]
    if not plots:
        return ""
    caption = "Residual of each pose or turn; dark and light: one and two standard uncertainties expected of it."
    return (
        f'<section class="whole"><h2>Residuals</h2>\n<div class="two">{"".join(plots)}</div>'
        f'<p class="small">{caption}</p></section>'
    )


def _plot(name: str, r: Residuals) -> str:
    """Residuals on their one- and two-sigma bars, as an SVG of 86 mm."""
    width, height, left, bottom, top = 340.0, 130.0, 44.0, 20.0, 6.0
    finite = np.where(np.isfinite(r.sigma), r.sigma, 0.0)
    reach = 1.1 * max(float(np.abs(r.value).max()), float(2.0 * finite.max()), 1e-300)
    n = len(r.value)
    step = (width - left - 4.0) / n

    def y(v: float) -> float:
        return top + (height - bottom - top) * (0.5 - 0.5 * v / reach)

    items = []
    for k in range(n):
        x0, x = left + k * step, left + (k + 0.5) * step
        for times, alpha in ((2.0, 0.16), (1.0, 0.24)):
            high, low = y(times * float(finite[k])), y(-times * float(finite[k]))
            items.append(
                f'<rect x="{x0:.1f}" y="{high:.1f}" width="{0.94 * step:.2f}" height="{low - high:.1f}" '
                f'fill="{_BLUE}" fill-opacity="{alpha}"/>'
            )
        items.append(f'<circle cx="{x:.1f}" cy="{y(float(r.value[k])):.1f}" r="{min(2.0, 0.6 + 0.3 * step):.1f}"/>')
    scale = 10.0 ** math.floor(math.log10(reach))
    tick = next(m for m in (5.0, 2.0, 1.0) if m * scale <= 0.95 * reach or m == 1.0) * scale
    ticks = "".join(
        f'<text x="{left - 4:.0f}" y="{y(v) + 3:.1f}" text-anchor="end">{"0" if v == 0.0 else f"{v:g}"}</text>'
        f'<line x1="{left - 2:.0f}" x2="{left:.0f}" y1="{y(v):.1f}" y2="{y(v):.1f}" stroke="{_INK}"/>'
        for v in (-tick, 0.0, tick)
    )
    ends = f'<text x="{left + 0.5 * step:.1f}" y="{height - 8:.0f}" text-anchor="middle">1</text>'
    if n > 1:
        ends += f'<text x="{left + (n - 0.5) * step:.1f}" y="{height - 8:.0f}" text-anchor="middle">{n}</text>'
    ends += f'<text x="{0.5 * (left + width):.0f}" y="{height - 8:.0f}" text-anchor="middle">pose or turn</text>'
    unit = escape(r.unit)
    return (
        f"<figure><figcaption>{escape(name)} [{unit}]: {r.rms:.2g} {unit} RMS</figcaption>"
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" role="img" aria-label="Residuals {escape(name)}" '
        f'font-family="sans-serif" font-size="8.5" fill="{_LETTERS}">'
        f'<line x1="{left}" x2="{width - 4}" y1="{y(0.0):.1f}" y2="{y(0.0):.1f}" stroke="{_INK}" stroke-width="0.6"/>'
        f"{''.join(items)}{ticks}{ends}</svg></figure>"
    )


def _traceability(result: CalibrationResult, session: Session) -> list[tuple[str, str]]:
    rows = []
    if any(n[2] == "a" for n in result.names if n[0] in "bM"):
        if session.gravity is None:
            rows.append(("gravity", "not stated"))
        else:
            rows.append(("gravity", f"{session.gravity:.5f} m/s², {session.gravity_source}"))
        first = session.gravity_source.partition(" ")[0]
        rows.append(("not in U", _OF_GRAVITY.get(first, "uncertainty of that gravity, ppm by ppm in scale factors")))
    if any(n[2] == "g" for n in result.names if n[0] in "bM"):
        rates = session.rate_source or _METHODS.get(result.method, ("", "not stated"))[1]
        rows.append(("rates", rates))
        if result.method in ("ratetable", "ferraris"):
            rows.append(("not in U", "error of the table's rate or the turned angle beyond what was stated"))
    rows.append(("time", "clock of the log; rates carry its relative error"))
    return rows


def _remarks(remarks: Sequence[str]) -> str:
    text = "".join(f"<p>{escape(r)}</p>" for r in remarks) or "<p>None.</p>"
    return f"<section><h2>Remarks</h2>\n{text}</section>"


def _inputs(result: CalibrationResult, version: str) -> str:
    sources: Mapping[str, Any] = result.provenance.get("sources", {})
    rows = [("schuler", version), ("calibration, SHA-256", description(result)["sha256"])]
    rows += [(f"{name}, SHA-256", str(checksum)) for name, checksum in sources.items()]
    lines = "".join(f'<tr><th scope="row">{escape(a)}</th><td class="hash">{escape(b)}</td></tr>\n' for a, b in rows)
    return (
        f'<section class="whole"><h2>Software and inputs</h2>\n<table>{lines}</table>'
        '<p class="small">The certificate speaks of this unit in the state and under the conditions stated; '
        "it was issued without accreditation.</p></section>"
    )
