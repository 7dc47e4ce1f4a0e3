"""HTML page on a log before and after its calibration: rests against gravity, rates at rest, what was taken out."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.report.output_figures import outputs
from schuler.calibration.result.application import APPLIED, AppliedCalibration, RestComparison
from schuler.calibration.result.parameters import AXES
from schuler.exceptions import InputError
from schuler.files import write_text
from schuler.plotting import parts
from schuler.plotting.figure import Band, Figure, Markers, Panel, level
from schuler.plotting.page import Block, Section, plotly_script, whole_page
from schuler.units import DEG_PER_HR, MG

_CONVENTIONS = (
    "Conventions: axes are forward, right, down, those of the calibration; bands are two sigma of what the calibration "
    "claims, with the noise of the means. The norm of the specific force at rest is gravity whatever the attitude; the "
    "rate at rest is the Earth's, 15 deg/h in all."
)


def applied_report(applied: AppliedCalibration, path: Path | str) -> Path:
    """Write the page on a log before and after its calibration.

    Parameters
    ----------
    applied : AppliedCalibration
    path : Path or str
        The HTML file.

    Returns
    -------
    Path
        The file; the same bytes for the same arguments.
    """
    rests, imu = applied.rests, applied.recording.need_imu()
    tables = () if rests is None else (_norms(rests), _rates(rests), _every_rest(rests))
    figures: list[Block] = []
    for triad in ("accel", "gyro"):
        try:
            figures.append(outputs(applied.before, imu, triad))
        except InputError:  # shorter than two means
            continue
    entry = applied.recording.metadata.options[APPLIED][-1]
    rows = parts.provenance_rows({"calibration": entry, "log": applied.recording.metadata.sources})
    sections = [
        Section("rests", "At rest, axis by axis", tables),
        Section("outputs", "Along the log", tuple(figures)),
        Section("notes", "Notes", (parts.bullets(applied.recording.metadata.notes),)),
        Section("provenance", "What was applied", (parts.table("", ("entry", "value"), rows, numbers=False),), True),
    ]
    name = applied.recording.metadata.name
    text = whole_page(
        name, "calibrated log", f"{applied.calibration.method} calibration applied to {name}", _verdict(applied),
        _CONVENTIONS, sections, plotly_script(), leading=None if rests is None else rests_figure(rests),
    )  # fmt: skip
    return write_text(path, text)


def rests_figure(rests: RestComparison) -> Figure:
    """Norm of the specific force at each rest less gravity: before and after, then after alone on its claim."""
    before, after = (e / MG for e in rests.norm_errors)
    x = np.arange(1.0, len(before) + 1.0)
    ends = (0.5, len(x) + 0.5)
    claimed = 2.0 * rests.sigma_norm / MG
    edges = np.repeat(x, 2) + np.tile([-0.5, 0.5], len(x))
    band = Band(edges, -np.repeat(claimed, 2), np.repeat(claimed, 2), "sigma", "claimed, 2 sigma")
    zero = level(ends, 0.0, "level")
    panels = (
        Panel("rest [number]", "norm less gravity [mg]", (zero, Markers(x, before, "smoothed", "before"),
              Markers(x, after, "filtered", "after")), title=f"{_rms(before):.3g} mg RMS before", x_limits=ends),
        Panel("rest [number]", "norm less gravity [mg]", (band, zero, Markers(x, after, "filtered", "after")),
              title=f"{_rms(after):.3g} mg RMS after", x_limits=ends),
    )  # fmt: skip
    caption = f"Gravity is {rests.gravity:.5f} m/s², {rests.gravity_source}; each point is the mean of a rest."
    return Figure("rests_norm", "Specific force at rest against gravity", caption, panels)


def _verdict(applied: AppliedCalibration) -> list[str]:
    rests = applied.rests
    if rests is None:
        return ["The log has no rest, so nothing in it says whether the calibration mends it.", *_notes(applied)]
    before, after = (_rms(e) for e in rests.norm_errors)
    beyond = int((np.abs(rests.norm_errors[1]) > 3.0 * rests.sigma_norm).sum())
    sentence = f"At {len(rests.start)} rests the norm of the specific force is off gravity by {after / MG:.3g} mg RMS"
    sentence += f", {before / MG:.3g} mg before."
    claim = f"The calibration claims {_rms(rests.sigma_norm) / MG:.2g} mg: "
    claim += f"{beyond} rests are beyond three sigma of it." if beyond else "every rest is within three sigma of it."
    if after > before:
        sentence += (
            " The log fits gravity worse than before: is it of the calibrated unit, in the axes it was read in then?"
        )
    return [sentence, claim, *_notes(applied)]


def _notes(applied: AppliedCalibration) -> list[str]:
    return [f"{n[:1].upper()}{n[1:]}." for n in applied.notes]


def _norms(rests: RestComparison) -> str:
    """Norm error by the axis that is nearest to the vertical."""
    up = np.argmax(np.abs(rests.f_after), axis=1)
    rows = []
    for i, axis in enumerate(AXES):
        for sign, word in ((-1.0, "up"), (1.0, "down")):  # f points up: along -axis when the axis looks down
            k = (up == i) & (np.sign(rests.f_after[:, i]) == -sign)
            if not k.any():
                continue
            before, after = (e[k] / MG for e in rests.norm_errors)
            claim = _rms(rests.sigma_norm[k]) / MG
            rows.append(
                (f"{axis} {word}", str(int(k.sum())), f"{before.mean():+.3f}", f"{after.mean():+.3f}", f"{claim:.3f}")
            )
    heads = ("axis nearest to the vertical", "rests", "before [mg]", "after [mg]", "claimed, 1 sigma [mg]")
    return parts.table("Norm of the specific force less gravity, means", heads, rows)


def _rates(rests: RestComparison) -> str:
    rows = []
    for i, axis in enumerate(AXES):
        before, after = (w[:, i] / DEG_PER_HR for w in (rests.omega_before, rests.omega_after))
        claim = _rms(rests.sigma_omega[:, i]) / DEG_PER_HR
        rows.append((axis, f"{before.mean():+.4g}", f"{after.mean():+.4g}", f"{after.std():.3g}", f"{claim:.3g}"))
    heads = ("axis", "before [deg/h]", "after [deg/h]", "scatter after [deg/h]", "claimed, 1 sigma [deg/h]")
    return parts.table("Rates at rest, means over the rests; the Earth's is in them", heads, rows)


def _every_rest(rests: RestComparison) -> str:
    begin = float(rests.start[0])
    rows = [
        (
            str(k + 1), f"{rests.start[k] - begin:.1f}", f"{rests.norm_errors[0][k] / MG:+.3f}",
            f"{rests.norm_errors[1][k] / MG:+.3f}", f"{rests.sigma_norm[k] / MG:.3f}",
        )
        for k in range(len(rests.start))
    ]  # fmt: skip
    heads = ("rest", "after the first [s]", "before [mg]", "after [mg]", "claimed, 1 sigma [mg]")
    return parts.folded(f"{len(rows)} rests", parts.table("Norm of the specific force less gravity", heads, rows))


def _rms(x: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))
