"""Errors against a reference with the uncertainty the filter claimed, the claim alone where there is no reference."""

from __future__ import annotations

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.navigation.evaluation.consistency import Separation, chi_square_band
from schuler.navigation.report.subject import Subject, inside_shares
from schuler.navigation.report.track import outages
from schuler.plotting.figure import TIME, Band, Figure, Item, Line, Panel, band, level, line, view
from schuler.units import DEG

AXES = ("north", "east", "down")
#: Block of the filter: name of the figure, title, what is in the axis label, factor to the unit shown.
_QUANTITIES = {
    "dr": ("position", "Position error", "{} [m]", 1.0),
    "dv": ("velocity", "Velocity error", "{} [m/s]", 1.0),
    "dpsi": ("attitude", "Attitude error", "about {} [deg]", 1.0 / units.DEG),
}
_LOG_FROM = 50.0  # largest over median horizontal error from which the axis is logarithmic


def horizontal(subject: Subject) -> Figure | None:
    """Horizontal distance to the reference over time; None without a reference."""
    if not subject.errors:
        return None
    curves = [line(subject.seconds(e.t), e.horizontal, role, role) for role, e in subject.errors.items()]
    all_errors = np.concatenate([e.horizontal for e in subject.errors.values()])
    largest, usual = float(all_errors.max()), float(np.median(all_errors, overwrite_input=True))
    del all_errors
    # centimetres with GNSS and tens of metres without it are both seen on a logarithmic axis only
    log = usual > 0.0 and largest > _LOG_FROM * usual
    limits = (0.2 * usual, 1.5 * largest) if log else (0.0, 1.06 * largest or 1.0)
    sigma = subject.position_sigma(subject.result)
    claimed = np.maximum(np.hypot(sigma[:, 0], sigma[:, 1]), limits[0])
    area = band(
        subject.seconds(subject.result.t), np.full_like(claimed, limits[0]), claimed, "sigma",
        f"{subject.solutions[0][0]}, RMS as claimed",
    )  # fmt: skip
    panel = Panel(
        TIME, "horizontal error [m]", (*outages(subject), area, *curves), x_limits=subject.span, y_limits=limits,
        log=log,
    )  # fmt: skip
    caption = f"Horizontal distance to {subject.reference_name}; " + (
        "it grows where GNSS is withheld and falls back with the first fix."
        if subject.result.outages
        else "a step or a slope in it deserves a look at the innovations."
    )
    return Figure("horizontal_error", "Horizontal error", caption, (panel,))


def errors(subject: Subject, block: str) -> Figure | None:
    """Errors north, east, down of one navigation block with the filter's 3-sigma band.

    Parameters
    ----------
    subject : Subject
    block : {"dr", "dv", "dpsi"}

    Returns
    -------
    Figure or None
        None where the reference does not have the quantity.
    """
    name, title, label, factor = _QUANTITIES[block]
    t_sigma = subject.seconds(subject.result.t)
    sigma = subject.position_sigma(subject.result) if block == "dr" else subject.sigma(subject.result, block)
    curves: list[list[Line]] = [[] for _ in AXES]
    shares: list[list[str]] = [[] for _ in AXES]
    for role, result in subject.solutions if subject.errors else ():  # one after the other: each is long
        e = subject.errors[role]
        within = subject.inside_three_sigma[role] if block == "dr" else None
        value = _of_block(e, block)
        if value is None:
            return None
        if within is None:
            within = inside_shares(e.t, value, result.t, subject.sigma(result, block))
        t = subject.seconds(e.t)
        for i in range(len(AXES)):
            curves[i].append(line(t, factor * value[:, i], role, role))
            shares[i].append(f"{role} {_percent(float(within[i]))}")
        del value, t  # before that of the next is made
    if not curves[0]:
        return None
    panels = []
    for i, axis in enumerate(AXES):
        three = 3.0 * factor * sigma[:, i]
        items: list[Item] = [
            *outages(subject),
            band(t_sigma, -three, three, "sigma", f"{subject.solutions[0][0]} ±3 sigma"),
            level(subject.span, 0.0, "level"),
            *curves[i],
        ]
        panels.append(
            Panel(
                TIME, label.format(axis), tuple(items), x_limits=subject.span,
                title="inside ±3 sigma: " + ", ".join(shares[i]),
                y_limits=view([c.y for c in curves[i]], [three, -three]),
            )
        )  # fmt: skip
    rest = "; the errors of the reference come on top." if subject.at_antenna else "."
    if subject.reference_is_fixes:
        rest = ", to which here the uncertainty of a fix is added."
    caption = (
        f"Estimate minus {subject.reference_name}: an honest filter keeps 99.7 % of its errors inside the band of "
        f"three of its own standard deviations{rest}"
    )
    return Figure(f"{name}_error", title, caption, tuple(panels))


def sigmas(subject: Subject) -> Figure:
    """The uncertainty the filter claims, over time: all that can be shown without a reference."""
    panels = []
    for block, (name, _, _, factor) in _QUANTITIES.items():
        unit = {"dr": "m", "dv": "m/s", "dpsi": "deg"}[block]
        items: list[Item] = [*outages(subject)]
        tops = []
        for role, result in subject.solutions:
            s = factor * subject.sigma(result, block)
            t = subject.seconds(result.t)
            first = np.hypot(s[:, 0], s[:, 1])
            what = ("tilt", "heading") if block == "dpsi" else ("horizontal", "vertical")
            items.append(line(t, first, role, f"{role}, {what[0]}"))
            items.append(
                line(t, s[:, 2], "largest" if role == "filtered" else "largest_smoothed", f"{role}, {what[1]}")
            )
            tops += [first, s[:, 2]]
        limits = view([], tops)
        panels.append(
            Panel(
                TIME, f"{name} 1-sigma [{unit}]", tuple(items), x_limits=subject.span,
                y_limits=None if limits is None else (0.0, limits[1]),
            )
        )  # fmt: skip
    caption = (
        "One standard deviation as the filter states it; there is no reference to check it against, so judge it by the "
        "innovations."
    )
    return Figure("uncertainty", "Uncertainty", caption, tuple(panels))


def normalised_errors(subject: Subject) -> Figure | None:
    """Normalised estimation error squared over time with its 95 % band; None where the truth does not have it all."""
    if subject.nees is None:
        return None
    t, values, degrees = subject.nees
    low, high = chi_square_band(degrees)
    x = np.array(subject.span)
    mean = float(np.mean(values))
    within = float(np.mean((values >= low) & (values <= high)))
    log = bool(values.max() > 8.0)
    items: list[Item] = [
        *outages(subject),
        Band(x, np.full(2, low), np.full(2, high), "expected", "95 % band"),
        level(subject.span, 1.0, "level"),
        line(subject.seconds(t), values, subject.solutions[0][0], f"NEES, {subject.solutions[0][0]}"),
    ]
    title = f"mean {mean:.2f}, {_percent(within)} inside the 95 % band, {degrees} states"
    panel = Panel(TIME, "NEES per state [-]", tuple(items), title=title, x_limits=subject.span, log=log)
    caption = (
        "Normalised estimation error squared (NEES), divided by the number of states: about 1 for an honest filter, "
        "above the band it is too sure of itself, below too cautious; neighbouring values hang together, so one run "
        "wanders in the band."
    )
    return Figure("nees", "Is the claimed uncertainty true?", caption, (panel,))


def _of_block(e: object, block: str) -> FloatArray | None:
    value: FloatArray | None = getattr(e, {"dr": "position_n", "dv": "velocity_n", "dpsi": "attitude_n"}[block])
    return value


def _percent(share: float) -> str:
    return "not known" if np.isnan(share) else f"{100.0 * share:.1f}\N{NO-BREAK SPACE}%"


#: Least relative reduction of a variance by smoothing: below it rounding decides.
LEAST_GAIN = 1e-3
#: Name, unit and its factor, first column of a Separation.
_SEPARATION_BLOCKS = {
    "dr": ("position", "m", 1.0, 6),
    "dv": ("velocity", "m/s", 1.0, 3),
    "dpsi": ("attitude", "deg", DEG, 0),
}


def separation_with_sigma(subject: Subject, apart: Separation, block: str) -> tuple[FloatArray, FloatArray]:
    """Difference of a block and its 1-sigma, NaN where smoothing gained next to nothing. Shapes (k, 3), (k, 3)."""
    first = _SEPARATION_BLOCKS[block][3]
    part = slice(first, first + 3)
    gain = np.einsum("kii->ki", apart.covariance)[:, part]
    before = Subject.sigma(subject.result, block) ** 2
    with np.errstate(invalid="ignore"):
        return apart.difference[:, part], np.sqrt(np.where(gain > LEAST_GAIN * before, gain, np.nan))


def separation_share(subject: Subject, apart: Separation, block: str, times: float = 3.0) -> float:
    """Share of a block's components inside so many sigmas; NaN if none can be told."""
    d, sigma = separation_with_sigma(subject, apart, block)
    finite = np.isfinite(sigma)
    return float(np.mean(np.abs(d[finite]) <= times * sigma[finite])) if finite.any() else float("nan")


def separation(subject: Subject) -> Figure | None:
    """Filtered minus smoothed position, velocity and attitude with the sigma of that difference; None without both."""
    apart = subject.apart
    if apart is None:
        return None
    t = subject.seconds(apart.t)
    panels = []
    for block, (name, unit, factor, _) in _SEPARATION_BLOCKS.items():
        difference, sigma = separation_with_sigma(subject, apart, block)
        for i, axis in enumerate(AXES):
            d, three = difference[:, i] / factor, 3.0 * sigma[:, i] / factor
            finite = np.isfinite(three)
            items: tuple[Item, ...] = (
                *outages(subject),
                band(t, -three, three, "expected", "±3 sigma of the difference"),
                level(subject.span, 0.0, "level"),
                line(t, d, "filtered", "filtered minus smoothed"),
            )
            within = f"{100.0 * np.mean(np.abs(d[finite]) <= three[finite]):.1f} %" if finite.any() else "not known"
            label = f"{'about ' if block == 'dpsi' else ''}{axis} [{unit}]"
            panels.append(
                Panel(
                    TIME, label, items, title=f"{name}, inside: {within}", x_limits=subject.span,
                    y_limits=view([d], [three, -three]),
                )
            )  # fmt: skip
    caption = (
        "What later measurements changed: the difference of the two solutions should stay inside three times the sigma "
        "that their covariances give it (root of filtered less smoothed variance; 99.7 % are right), and no reference "
        "is needed. It leaves the band where models are wrong; errors that both solutions share are not seen."
    )
    return Figure("separation", "Filtered minus smoothed", caption, tuple(panels), columns=3)
