"""What is said of an axis beside its numbers: lines in its spectrum, and how well the model fits."""

from __future__ import annotations

import numpy as np

from schuler.characterisation.findings import Finding
from schuler.characterisation.lines import Line
from schuler.characterisation.selection import Selection


def line_findings(axis: str, lines: tuple[Line, ...], unit: str) -> list[Finding]:
    """What narrow lines in the spectrum mean, the strongest by frequency; nothing without any."""
    if not lines:
        return []
    strongest = ", ".join(f"{line.frequency:.4g} Hz ({line.amplitude:.2g} {unit})" for line in lines[:3])
    text = (
        f"{axis}: {len(lines)} narrow lines in the spectrum, the strongest at {strongest}: vibration or interference; "
        "they are in the model as sines and not in its noise terms"
    )
    return [Finding("lines", text, severity="note")]


def fit_findings(axis: str, chosen: Selection, dt: float, duration: float, stands: str) -> list[Finding]:
    """What the fit itself says; ``stands`` is what the model for simulation is where terms do not do."""
    told = []
    if not chosen.fits:
        text = (
            f"{axis}: no model fits: the curve departs from all of them by more than {100 * chosen.departure:.0f} % in "
            "variance; look at the figure for vibration or disturbances and do not use the numbers before"
        )
        told.append(Finding("no_model", text))
    elif chosen.departure > 0.0:
        text = (
            f"{axis}: the curve departs from every sum of terms by about {100 * chosen.departure:.2g} % in variance, "
            "more than chance does (vibration, temperature, disturbances); the uncertainties allow for it, "
            f"and the model for simulation is {stands}"
        )
        told.append(Finding("departure", text, severity="note" if chosen.departure < 0.1 else "warning"))
    if chosen.shortest > 1:
        text = (
            f"{axis}: below {chosen.shortest * dt:.3g} s the noise is no sum of terms (sensor filter, vibration); "
            f"the numbers hold from there on, and the model is {stands} at shorter times"
        )
        told.append(Finding("shape", text, severity="note"))
    for name, value, sigma in zip(chosen.fit.names, chosen.fit.values, chosen.fit.sigma, strict=True):
        if name.startswith("tau") and name != "tau_N" and (value > duration / 10.0 or sigma > 0.7):
            text = (
                f"{axis}: a correlation time of {value:.3g} s from a log of {duration:.3g} s is good to a factor of "
                f"{np.exp(1.96 * min(sigma, 3.0)):.2g}; a longer log would tell it from a random walk"
            )
            told.append(Finding("short_for_tau", text, severity="note"))
    return told
