"""Figures of Hayal's study: uncertainties beside printed ones, sweeps of rate and noise, outages, the cart's walk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.bench.sensor_geometry import PARAMETERS
from schuler.earth import earth_rate_ned
from schuler.frames import ned_from_ecef
from schuler.plotting.figure import Band, Figure, Item, Line, Markers, Panel, line, path
from schuler.reproduce.hayal.study.multiposition import StudyResult
from schuler.reproduce.hayal.study.outages import OutageGrid
from schuler.reproduce.hayal.study.tables import LENGTHS, PUBLISHED, SEEDINGS
from schuler.reproduce.hayal.study.walk import CartWalk
from schuler.units import DEG

#: Parameters of a panel: places, words, size of the unit.
_GROUPS = ((0, "bias", 1.0), (3, "scale factor [ppm]", 1e-6), (6, "non-orthogonality [urad]", 1e-6))
_ROLES = ("axis_x", "axis_y", "axis_z", "case_5")


def sigma_figure(title: str, printed: Mapping[str, FloatArray], ours: Mapping[str, FloatArray]) -> Figure:
    """Printed uncertainties over the median of ours, on the range of ours.

    Parameters
    ----------
    title : str
    printed : mapping of str to ndarray, shape (3,), (6,) or (9,)
        By case; SI.
    ours : mapping of str to ndarray, shape (3, n)
        5, 50 and 95 % of the simulated runs, by the same cases.

    Returns
    -------
    Figure
        A panel for each case.
    """
    panels = []
    ratios = [sigma / ours[case][1] for case, sigma in printed.items()]
    ends = np.concatenate([*ratios, *((ours[case] / ours[case][1]).ravel() for case in printed)])
    limits = (min(0.5, 0.8 * float(ends.min())), max(2.0, 1.25 * float(ends.max())))
    for (case, sigma), ratio in zip(printed.items(), ratios, strict=True):
        low, median, high = ours[case]
        n = len(sigma)
        rows = np.arange(n - 1.0, -1.0, -1.0)
        items: list[Item] = [Line(np.array([1.0, 1.0]), np.array([-0.5, n - 0.5]), "level")]
        for k, row in enumerate(rows):
            bar = np.array([low[k], high[k]]) / median[k]
            items.append(Line(bar, np.array([row, row]), "filtered", "ours, 5 to 95 % of the runs"))
        items.append(Markers(ratio, rows, "read_off", "printed"))
        panels.append(
            Panel(
                "sigma over our median [-]",
                "parameter [-]",
                tuple(items),
                title=case,
                log_x=True,
                x_limits=limits,
                y_ticks=tuple(zip(rows.tolist(), PARAMETERS[:n], strict=True)),
                y_limits=(-0.5, n - 0.5),
                height=0.6 + 0.12 * n,
            )
        )
    caption = "Rings are the uncertainties of the thesis's single draw, bars those of our runs with noise of their own."
    return Figure("sigmas", title, caption, tuple(panels), columns=3)


def sweep_figure(results: Sequence[StudyResult], name: str) -> Figure:
    """Root mean square errors of bias, scale factors and angles over reference rate or noise.

    Parameters
    ----------
    results : sequence of StudyResult
    name : {"rate_factor", "noise_factor"}
    """
    x = np.array([getattr(r.case, name) for r in results])
    words = "reference rate [Earth rates]" if name == "rate_factor" else "noise [times that of the HG1700]"
    panels = []
    for g, (_, label, size) in enumerate(_GROUPS):
        y = np.array([r.groups()[g] for r in results]) / size
        two = 2.0 / np.sqrt(6.0 * np.array([max(int(r.converged.sum()), 1) for r in results]))
        unit = label if g else "bias [rad/s]"
        items = (
            Band(x, y * (1.0 - two), y * (1.0 + two), "sigma", "two standard errors"),
            Line(x, y, "filtered", "root mean square error"),
            Markers(x, y, "filtered"),
        )
        panels.append(Panel(words, f"error of {unit}", items, log=True, log_x=True))
    caption = (
        "Scale factors and angles improve with the rate, the bias does not. Over noise everything grows in "
        "proportion until the adjustment breaks down."
    )
    return Figure("sweep", "Errors of the calibration", caption, tuple(panels), columns=3)


def outage_figure(grid: OutageGrid, imu: str, draws: int) -> Figure:
    """Total sigma of the position error over the length of the outage, ours and printed, by seeding.

    Parameters
    ----------
    grid : OutageGrid
    imu : str
    draws : int
        Independent draws behind it: outages of one draw share its errors.
    """
    x = np.array(LENGTHS)
    items: list[Item] = []
    for k, (seeding, role) in enumerate(zip(SEEDINGS, _ROLES, strict=True)):
        ours = np.array([grid.total(imu, seeding, length) for length in LENGTHS])
        half = min(2.0 / np.sqrt(2.0 * draws), 0.9)
        if seeding == "Original":
            items.append(Band(x, ours * (1.0 - half), ours * (1.0 + half), "sigma", "two standard errors of Original"))
        items.append(Line(x, ours, role, f"ours, {seeding}"))
        printed = np.array([PUBLISHED[imu, length][k][1] for length in LENGTHS])
        items.append(Markers(x, printed, "read_off", "printed, all four" if k == 0 else ""))
    panel = Panel(
        "length of the outage [s]", "total sigma of the position [m]", tuple(items), log=True, log_x=True, title=imu
    )
    caption = "The thesis's errors are many times what its data sheets explain; nothing is tuned to them."
    return Figure("outages", f"{imu}: position after outages", caption, (panel,), paper_columns=2)


def short_outage_figure(
    imu: str, printed: Mapping[tuple[int, int, float], float], ours: Mapping[tuple[int, int, float], float],
    original: tuple[float, float], standard_error: float,
) -> Figure:  # fmt: skip
    """Sigma after 2 s relative to no calibration, by attitude subset, gyroscope parameters and minutes.

    Parameters
    ----------
    imu : str
    printed, ours : mapping of (subset, parameters, minutes) to float
        [m]
    original : tuple of float
        Printed and ours without calibration. [m]
    standard_error : float
        Standard error of one of our ratios. [-]
    """
    panels = []
    for order in (3, 9):
        cases = [k for k in printed if k[1] == order]
        x = np.arange(1.0, len(cases) + 1.0)
        theirs = np.array([printed[k] / original[0] for k in cases])
        mine = np.array([ours.get(k, np.nan) / original[1] for k in cases])
        mine[~np.isfinite(mine)] = np.nan  # a filter diverged: no point
        half = 2.0 * standard_error
        items = (
            Band(x, mine * (1.0 - half), mine * (1.0 + half), "sigma", "two standard errors"),
            Line(x, mine, "filtered", "ours"),
            Markers(x, theirs, "read_off", "printed"),
            Line(x[[0, -1]], np.ones(2), "level"),
        )
        panels.append(
            Panel(
                "subset 1 to 4, each with 1, 3, 5 minutes [-]",
                "sigma over uncalibrated [-]",
                items,
                title=f"{imu}, {order} gyroscope parameters",
                log=True,
            )
        )
    caption = "Below 1 the calibration improves the position after two seconds without GPS."
    return Figure("short_outages", f"{imu}: outages of two seconds", caption, tuple(panels), columns=2, linked=False)


def walk_figure(walk: CartWalk) -> Figure:
    """The cart's track in plan."""
    reference = walk.ideal.truth
    r = ned_from_ecef(reference.r_eb_e, reference.llh[0])
    items = (path(r[:, 1], r[:, 0], "filtered", "cart"), Markers(r[:1, 1], r[:1, 0], "start", "start"))
    panel = Panel("east [m]", "north [m]", items, equal=True)
    return Figure("walk", "The cart's walk", "Straight sections and short curves, simulated; no errors.", (panel,))


def earth_rate_figure(latitude: float) -> Figure:
    """North and down components of Earth rate over latitude.

    Parameters
    ----------
    latitude : float
        Where a marker stands. [rad]
    """
    lat = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181)
    rate, here = np.array([earth_rate_ned(v) for v in lat]), earth_rate_ned(latitude)
    at = np.array([latitude / DEG])
    items = (
        line(lat / DEG, rate[:, 0], "axis_x", "north"),
        line(lat / DEG, rate[:, 2], "axis_y", "down"),
        Markers(at, here[:1], "read_off", "the thesis's latitude"),
        Markers(at, here[2:], "read_off"),
    )
    panel = Panel("latitude [deg]", "rate [rad/s]", items)
    caption = "Earth rate in north-east-down; it has no east component and does not depend on longitude. Exact."
    return Figure("earth_rate", "Earth rate", caption, (panel,))
