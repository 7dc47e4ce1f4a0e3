"""Figures of error growth: contributions and total, bounds of a Monte Carlo."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from schuler.plotting import figure as content
from schuler.plotting.figure import Figure, Panel
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.arrays import FloatArray
    from schuler.growth.dead_reckoning import Bounds
    from schuler.growth.totals import Growth

_SHOWN = {"heading": ("heading [deg]", DEG), "velocity": ("velocity [m/s]", 1.0), "position": ("position [m]", 1.0)}
_BANDS = ("sigma", "sigma_smoothed", "expected", "reference_band")
_FORMS = ("filtered", "smoothed", "case_3", "reference")
_ROLES = ("case_1", "case_2", "case_3", "case_4", "case_5", "case_6", "case_7", "largest")


def growth_figure(growth: Growth) -> Figure:
    """1-sigma by cause and in all, a panel for each quantity."""
    panels = []
    for quantity, (label, unit) in _SHOWN.items():
        items: list[content.Item] = [content.line(growth.t, growth.total(quantity) / unit, "mean", "total")]
        for i, cause in enumerate(growth.causes):
            part = growth.contributions[quantity][i]
            if part.any():
                items.append(content.line(growth.t, part / unit, _ROLES[i % len(_ROLES)], cause))
        panels.append(Panel("time [s]", label, tuple(items)))
    return Figure("growth", "Growth of errors, 1-sigma", "", tuple(panels), columns=3)


def bounds_figure(bounds: Bounds) -> Figure:
    """1-sigma bounds of a Monte Carlo, a panel for each quantity."""
    panels = []
    for name, sigma in bounds.sigma.items():
        unit, label = _unit(name)
        items = (
            content.band(bounds.t, -sigma / unit, sigma / unit, "sigma", "1-sigma over runs"),
            content.line(bounds.t, bounds.mean[name] / unit, "filtered", "mean"),
        )
        panels.append(Panel("time [s]", f"{name.replace('_', ' ')} [{label}]", items))
    return Figure("bounds", f"Dead reckoning at rest, {bounds.runs} runs", "", tuple(panels), columns=3)


def beside_figure(
    campaigns: Mapping[str, Bounds], names: Sequence[str], closed: Mapping[str, Mapping[str, FloatArray]], title: str
) -> Figure:
    """1-sigma of several Monte Carlo campaigns, two standard errors wide, with closed forms: a panel for each quantity.

    Parameters
    ----------
    campaigns : mapping of str to Bounds
        By label, all with the same times.
    names : sequence of str
        Quantities of the bounds to show.
    closed : mapping of str to mapping of str to ndarray, shape (k,)
        1-sigma in SI at the times of the bounds, by label and quantity.
    title : str
    """
    panels = []
    for name in names:
        unit, label = _unit(name)
        items: list[content.Item] = []
        for i, (who, b) in enumerate(campaigns.items()):
            s, u = b.sigma[name] / unit, 2.0 * b.uncertainty
            items.append(content.band(b.t, s * (1.0 - u), s * (1.0 + u), _BANDS[i % len(_BANDS)], f"{who}, runs"))
        t = next(iter(campaigns.values())).t
        for i, (who, forms) in enumerate(closed.items()):
            if name in forms:
                items.append(content.line(t, forms[name] / unit, _FORMS[i % len(_FORMS)], who))
        panels.append(Panel("time [s]", f"{name.replace('_', ' ')} [{label}]", tuple(items)))
    caption = "Bands: 1-sigma over runs, two standard errors up and down. Lines: closed forms."
    return Figure("bounds_beside", title, caption, tuple(panels), columns=min(3, len(panels)))


def difference_figure(t: FloatArray, difference: Mapping[str, FloatArray], error: Mapping[str, FloatArray]) -> Figure:
    """What in-run biases add to the bounds that white noise makes: difference of 1-sigmas with two standard errors."""
    panels = []
    for name, d in difference.items():
        unit, label = _unit(name)
        e = 2.0 * error[name]
        items = (
            content.band(t, (d - e) / unit, (d + e) / unit, "sigma", "two standard errors"),
            content.line(t, d / unit, "filtered", "all errors less white noise"),
        )
        panels.append(Panel("time [s]", f"{name.replace('_', ' ')} [{label}]", items))
    return Figure("bias_contribution", "What biases add", "", tuple(panels), columns=min(2, len(panels)))


def _unit(name: str) -> tuple[float, str]:
    if name in ("heading", "roll", "pitch"):
        return DEG, "deg"
    return 1.0, "m/s" if name.startswith("velocity") else "m"
