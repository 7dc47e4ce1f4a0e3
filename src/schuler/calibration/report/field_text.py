"""How a field calibration came about, in sentences and a table for its page."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from schuler.calibration.result.sheet import rounded, sheet
from schuler.plotting import parts
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.calibration.field.calibration import FieldCalibration


def history_text(found: FieldCalibration) -> tuple[str, ...]:
    """Sentences, what was noted on the rests, and when each parameter was found: HTML."""
    said = [found.rests.summary().splitlines()[0], passes_sentence(found)]
    if found.heading is not None:
        angle, sigma = (v / DEG for v in found.heading)
        said.append(f"heading of the first rest, found from the Earth's rate: {angle:.0f} ± {sigma:.0f} deg")
    text = "".join(f"<p>{escape(s[:1].upper() + s[1:])}.</p>" for s in said)
    notes = parts.bullets(found.rests.notes) if found.rests.notes else ""
    return text, notes, _table(found)


def passes_sentence(found: FieldCalibration) -> str:
    """How many passes there were, and how little the last one changed."""
    if len(found.passes) < 2:
        return "one pass, linearised at the estimates of its time: errors that are large leave a trace in others"
    return (
        f"{len(found.passes)} passes over the log, the last moved no parameter by more than {found.last_move:.2g} sigma"
    )


def _table(found: FieldCalibration) -> str:
    history = found.history
    reached = history.reached()
    first = float(found.rests.start[0])
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
