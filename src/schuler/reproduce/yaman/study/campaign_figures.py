"""Figures of a Monte Carlo of field calibrations: errors put in and left over, and convergence of one run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.report.field_panels import Truth, convergence, estimates
from schuler.exceptions import InputError
from schuler.plotting.drawing import draw
from schuler.plotting.figure import Band, Figure, Item, Line, Markers, Panel
from schuler.plotting.parts import number
from schuler.reproduce.yaman.study.tables import printed_unit, published

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MplFigure

    from schuler.calibration.field.calibration import FieldCalibration
    from schuler.reproduce.yaman.study.statistics import FieldCampaign


_CURVE = 161  # points of the distribution that is expected
_STEP = 0.22  # of a row: marks of one parameter stand above each other


def campaign_figure(
    campaign: FieldCampaign, which: str = "residual", *, names: Sequence[str] | None = None, bins: int | None = None
) -> MplFigure:
    """One figure of a campaign.

    Parameters
    ----------
    campaign : FieldCampaign
    which : {"residual", "modelled", "normalised", "left"}
        Histograms of estimate minus truth, of the errors put in, of residuals over their claimed sigma; or what is left
        of every parameter beside what is claimed and what the source had.
    names : sequence of str, optional
        Some of the parameters, in this order; all by default.
    bins : int, optional
        Number of a histogram; ``2 n^(1/3)`` by default (Rice's rule).

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If the figure or a parameter is not known, or ``bins`` is no positive number.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).

    References
    ----------
    Yaman (2017), Figs. 5.11 to 5.14, D.1 to D.47. The curves are ours: what a campaign would show in which every claim
    is true.
    """
    return draw(campaign_content(campaign, which, names=names, bins=bins))


def campaign_content(
    campaign: FieldCampaign, which: str = "residual", *, names: Sequence[str] | None = None, bins: int | None = None
) -> Figure:
    """Description of :func:`campaign_figure`."""
    chosen = campaign.names if names is None else tuple(names)
    for name in chosen:
        campaign.column(name)  # says which there are
    if not chosen:
        raise InputError("names: expected one parameter or more, got none")
    if bins is not None and not bins >= 1:
        raise InputError(f"bins: expected a positive number, got {bins!r}")
    if which == "left":
        return left(campaign, chosen)
    if which not in ("residual", "modelled", "normalised"):
        raise InputError(f"which: expected residual, modelled, normalised or left, got {which!r}")
    return histograms(campaign, which, chosen, bins)


def histograms(campaign: FieldCampaign, which: str, names: Sequence[str], bins: int | None = None) -> Figure:
    """One panel a parameter: its distribution over the runs, and the one that is claimed for it."""
    bins = bins or max(4, round(2.0 * len(campaign) ** (1.0 / 3.0)))
    if which == "modelled":
        caption = (
            "Errors put in, with mean and standard deviation, and the normal distribution of the specification they "
            "were drawn from."
        )
    elif which == "residual":
        caption = (
            "Estimate minus truth, with mean and standard deviation: the curve is what the runs' own covariances "
            "claim, so columns that are wider than it are errors nobody was told of."
        )
    else:
        caption = "Residuals over the 1-sigma that was claimed for each: standard normal if all claims are true."
    return Figure(
        f"campaign_{which}", f"{campaign.job.spec.name}, {len(campaign)} runs: {_TITLES[which]}", caption,
        tuple(_panel(campaign, which, name, bins) for name in names), columns=3, linked=False,
    )  # fmt: skip


_EXPECTED = {"modelled": "as specified", "residual": "as claimed", "normalised": "standard normal"}
_TITLES = {
    "modelled": "errors put in",
    "residual": "errors left",
    "normalised": "errors left over their claimed sigma",
}


def left(campaign: FieldCampaign, names: Sequence[str]) -> Figure:
    """Standard deviation of what is left over that of what was put in, by parameter; claimed, and the source's."""
    marks: dict[str, list[tuple[float, float]]] = {"claimed": [], "runs": [], "source": []}
    rows = list(names)[::-1]
    for y, name in enumerate(rows):
        i = campaign.column(name)
        put_in = float(campaign.modelled[:, i].std(ddof=1))
        marks["runs"].append((float(campaign.residual[:, i].std(ddof=1)) / put_in, float(y)))
        # what was known before is the specification; the sample of it that was drawn scatters too
        marks["claimed"].append((float(np.median(campaign.sigma[:, i]) / campaign.prior_sigma[i]), y + _STEP))
        source = published(campaign.job.spec.name, name)
        if source is not None:
            marks["source"].append((source[3] / source[1], y - _STEP))
    items: list[Item] = []
    for key, role, label in (
        ("claimed", "unused", "claimed"),
        ("runs", "filtered", f"{len(campaign)} runs"),
        ("source", "rejected", "Yaman (2017)"),
    ):
        if marks[key]:
            x, y_ = 100.0 * np.array([m[0] for m in marks[key]]), np.array([m[1] for m in marks[key]])
            items.append(Markers(x, y_, role, label))
    panel = Panel(
        "standard deviation left [%]", "", tuple(items), log_x=True, y_limits=(-0.6, len(rows) - 0.4),
        y_ticks=tuple((float(y), name) for y, name in enumerate(rows)), height=max(1.0, 0.12 * len(rows)),
    )  # fmt: skip
    return Figure(
        "campaign_left",
        f"{campaign.job.spec.name}: what is left of the errors",
        "Standard deviation over the runs after the calibration over that before; what the calibrations claim should "
        "lie on it.",
        (panel,),
    )


def _panel(campaign: FieldCampaign, which: str, name: str, bins: int) -> Panel:
    i = campaign.column(name)
    unit, factor = printed_unit(name)
    if which == "normalised":
        unit, x, sigma = "sigma", campaign.normalised[:, i], np.ones(1)
        counts, edges = np.histogram(x, bins)
    else:
        h = campaign.histogram(name, bins)
        if which == "modelled":
            x, sigma = campaign.modelled[:, i] / factor, campaign.prior_sigma[i : i + 1] / factor
            counts, edges = h.modelled_count, h.modelled_edges
        else:
            x, sigma = campaign.residual[:, i] / factor, campaign.sigma[:, i] / factor
            counts, edges = h.residual_count, h.residual_edges
    at, columns = np.repeat(edges, 2), np.concatenate(([0.0], np.repeat(counts.astype(np.float64), 2), [0.0]))
    reach = max(float(np.abs(x).max()), 3.0 * float(np.median(sigma)))
    grid = np.linspace(-reach, reach, _CURVE)
    items: tuple[Item, ...] = (
        Band(at, np.zeros_like(at), columns, "sigma"),
        Line(at, columns, "filtered", "runs"),
        Line(grid, len(x) * float(edges[1] - edges[0]) * _density(grid, sigma), "model", _EXPECTED[which]),
    )
    title = f"{name}: {number(float(x.mean()))} ± {number(float(x.std(ddof=1)), unit)}"
    return Panel(f"[{unit}]", "runs [-]", items, title=title)


def _density(x: FloatArray, sigma: FloatArray) -> FloatArray:
    """Mean over the runs of normal densities about zero, each as wide as its run claims."""
    z = x[:, None] / sigma
    return np.asarray(np.mean(np.exp(-0.5 * z**2) / (np.sqrt(2.0 * np.pi) * sigma), axis=1))


def family_figure(
    calibration: FieldCalibration, names: Sequence[str], truth: Truth | None = None, title: str = ""
) -> Figure:
    """Estimates with three sigma beside the square root of the variance over that before the log.

    Parameters
    ----------
    calibration : FieldCalibration
    names : sequence of str
        Parameters; panels that hold one of them are taken.
    truth : ImuErrors or mapping of str to float, optional
    title : str

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        If the calibration has no history, or none of the parameters.

    References
    ----------
    Yaman (2017), Figs. 5.3 to 5.9: one figure a group.
    """
    values, left = estimates(calibration, truth), convergence(calibration)
    if values is None or left is None:
        raise InputError("names: expected a calibration with its history, this one was refused")
    panels = [
        panel
        for pair in zip(values.panels, left.panels, strict=True)
        for panel in pair
        if set(pair[0].title.split(", ")) & set(names)
    ]
    if not panels:
        raise InputError(f"names: expected some of {', '.join(calibration.history.names)}, got {', '.join(names)}")
    return replace(
        values,
        name=f"field_family_{names[0]}",
        title=title or ", ".join(names),
        caption="Left the estimates with three standard deviations and the true values, right one sigma over what was "
        "known before the log.",
        panels=tuple(panels),
        columns=2,
    )
