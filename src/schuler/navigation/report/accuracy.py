"""Errors against a reference with the uncertainty the filter claimed, the claim alone where there is no reference."""

from __future__ import annotations

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.navigation.evaluation.outages import drift_curve, outage_errors
from schuler.navigation.report.subject import Subject, inside_share
from schuler.navigation.report.track import outages
from schuler.plotting.figure import TIME, Band, Bars, Figure, Item, Panel, band, level, line, view

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
    largest, usual = float(all_errors.max()), float(np.median(all_errors))
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
    values = {role: _of_block(e, block) for role, e in subject.errors.items()}
    if not values or any(v is None for v in values.values()):
        return None
    t_sigma = subject.seconds(subject.result.t)
    sigma = subject.position_sigma(subject.result) if block == "dr" else subject.sigma(subject.result, block)
    own = {role: subject.sigma(result, block) for role, result in subject.solutions}
    panels = []
    for i, axis in enumerate(AXES):
        items: list[Item] = [*outages(subject)]
        three = 3.0 * factor * sigma[:, i]
        items.append(band(t_sigma, -three, three, "sigma", f"{subject.solutions[0][0]} ±3 sigma"))
        items.append(level(subject.span, 0.0, "level"))
        shares, curves = [], []
        for role, result in subject.solutions:
            value = values[role]
            assert value is not None
            e = subject.errors[role]
            curves.append(line(subject.seconds(e.t), factor * value[:, i], role, role))
            if block == "dr":
                shares.append((role, float(subject.inside_three_sigma[role][i])))
            else:
                shares.append((role, inside_share(e.t, value[:, i], result.t, own[role][:, i])))
        items += curves
        panels.append(
            Panel(
                TIME, label.format(axis), tuple(items), x_limits=subject.span,
                title="inside ±3 sigma: " + ", ".join(f"{role} {_percent(s)}" for role, s in shares),
                y_limits=view([c.y for c in curves], [three, -three]),
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


def outage_figure(subject: Subject) -> Figure | None:
    """Largest horizontal error by outage and drift curve; None without outages or a reference."""
    found = {role: outage_errors(e, subject.result.outages) for role, e in subject.errors.items()}
    if not found or not next(iter(found.values())):
        return None
    bars: list[Item] = []
    drift: list[Item] = []
    n = len(next(iter(found.values())))
    several = n > 1
    for role, list_of in found.items():
        number = np.arange(1.0, len(list_of) + 1.0)
        bars.append(Bars(number, np.array([o.max_horizontal for o in list_of]), role, role))
        age, rms, largest = drift_curve(subject.errors[role], subject.result.outages)
        # a bin in which no reference epoch fell is bridged: the drift goes on meanwhile
        known = np.isfinite(rms)
        drift.append(line(age[known], rms[known], role, f"{role}, RMS of all outages" if several else role))
        if several:
            dashed = "largest" if role == "filtered" else "largest_smoothed"
            drift.append(line(age[known], largest[known], dashed, f"{role}, largest"))
    first = subject.result.outages[0]
    panels = (
        Panel("number of the outage [-]", "largest horizontal error [m]", tuple(bars), x_limits=(0.25, n + 0.75)),
        Panel("time since GNSS was lost [s]", "horizontal error [m]", tuple(drift)),
    )
    caption = (
        "First the largest horizontal error in each outage, in order of time (number 1 begins at "
        f"{first[0] - subject.start:.0f} s), then how the error grows from the moment GNSS is lost."
    )
    return Figure("outages", "Outages", caption, panels, columns=2, linked=False, paper_columns=2)


def _of_block(e: object, block: str) -> FloatArray | None:
    value: FloatArray | None = getattr(e, {"dr": "position_n", "dv": "velocity_n", "dpsi": "attitude_n"}[block])
    return value


def _percent(share: float) -> str:
    return "not known" if np.isnan(share) else f"{100.0 * share:.1f}\N{NO-BREAK SPACE}%"
