"""Stanford diagram: errors of positions against their protection levels and an alert limit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from schuler import frames
from schuler.arrays import ArrayLike, BoolArray, FloatArray
from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schuler.gnss.point_result import PointSolution
    from schuler.plotting import figure as content

Direction = Literal["horizontal", "vertical"]


@dataclass(frozen=True, repr=False)
class Stanford(Displayed):
    """Errors against protection levels, one for each epoch with a position and a truth.

    Attributes
    ----------
    t : ndarray, shape (k,)
        [s]
    error, level : ndarray, shape (k,)
        Size of the error; protection level, infinite where a fault could not be seen. [m]
    alert_limit : float
        Level above which a position is not to be used. [m]
    direction : str
    """

    t: FloatArray
    error: FloatArray
    level: FloatArray
    alert_limit: float
    direction: Direction

    @property
    def available(self) -> BoolArray:
        """Epochs whose level is within the alert limit. Shape (k,)."""
        return np.asarray(self.level <= self.alert_limit)

    @property
    def misleading(self) -> BoolArray:
        """Epochs whose error is beyond their level. Shape (k,)."""
        return np.asarray(self.error > self.level)

    @property
    def hazardous(self) -> BoolArray:
        """Epochs that are available although their error is beyond the alert limit. Shape (k,)."""
        return np.asarray(self.available & (self.error > self.alert_limit))

    def summary(self) -> str:
        """One sentence: how many epochs are within their levels, available, misleading, hazardous."""
        n, level = len(self.t), self.level[np.isfinite(self.level)]
        median = f"{np.median(level):.1f} m" if len(level) else "infinite"
        return (
            f"{self.direction}: error within its level at {100.0 * np.mean(~self.misleading):.2f} % of {n} epochs "
            f"({int(self.misleading.sum())} beyond), available with {self.alert_limit:g} m at "
            f"{100.0 * np.mean(self.available):.1f} %, hazardous {int(self.hazardous.sum())}; median error "
            f"{np.median(self.error):.1f} m, level {median}"
        )

    def figure(self) -> content.Figure:
        """Levels over errors, with the line on which both are equal and the alert limit on both axes.

        What lies above the diagonal is within its level. Axes reach to the largest level or error, at most to twice the
        alert limit; what is beyond is drawn on their edges.
        """
        from schuler.plotting.figure import Figure, Line, Markers, Panel, Text

        sizes = np.concatenate((self.error, self.level[np.isfinite(self.level)]))
        top = min(2.0 * self.alert_limit, 1.25 * float(sizes.max(initial=0.0)) or np.inf)
        if not np.isfinite(self.level).all():
            top = 2.0 * self.alert_limit
        error, level = np.minimum(self.error, top), np.minimum(self.level, top)
        inside = ~self.misleading
        kinds = (
            ("within the level", inside & self.available, "filtered"),
            ("not available", inside & ~self.available, "unused"),
            ("beyond the level", self.misleading, "rejected"),
        )
        limit, edge = np.full(2, self.alert_limit), np.array([0.0, top])
        items: list[content.Item] = [
            Markers(error[k], level[k], role, f"{label}: {int(k.sum())}") for label, k, role in kinds if k.any()
        ]
        items.append(Line(edge, edge, "reference", "error = level"))
        if top > self.alert_limit:
            items += [
                Line(edge, limit, "level", f"alert limit, {self.alert_limit:g} m"),
                Line(limit, edge, "level"),
                Text(0.5 * self.alert_limit, 0.95 * top, "not available"),
            ]
        panel = Panel(
            f"{self.direction} error [m]", f"{self.direction} protection level [m]", tuple(items),
            x_limits=(0.0, top), y_limits=(0.0, top), equal=True,
        )  # fmt: skip
        title = f"Stanford diagram, {self.direction}"
        return Figure(
            f"stanford_{self.direction}", title, self.summary()[0].upper() + self.summary()[1:] + ".", (panel,)
        )

    def plot(self) -> Figure:
        """The diagram (matplotlib)."""
        from schuler.plotting.drawing import draw

        return draw(self.figure())


def stanford(
    points: PointSolution, r_e: ArrayLike, *, alert_limit: float, direction: Direction = "horizontal"
) -> Stanford:
    """Errors of single points against their protection levels.

    Parameters
    ----------
    points : PointSolution
        Solved with the integrity risk to be judged (:attr:`schuler.gnss.Integrity.missed_detection`).
    r_e : array_like, shape (k, 3)
        True antenna, Earth-fixed, at each epoch; NaN where it is not known. [m]
    alert_limit : float
        [m]
    direction : {"horizontal", "vertical"}

    Returns
    -------
    Stanford

    Raises
    ------
    InputError
        If the shapes do not agree, the limit is not positive, or no epoch has both a position and a truth.

    References
    ----------
    Tossaint et al. (2007), The Stanford-ESA integrity diagram, Navigation 54, 71-81; Walter & Enge (1995).
    """
    true = np.asarray(r_e, dtype=np.float64)
    if true.shape != points.r_e.shape:
        raise InputError(
            f"r_e: expected the true place at each of {len(points)} epochs, shape ({len(points)}, 3), got {true.shape}"
        )
    if direction not in ("horizontal", "vertical"):
        raise InputError(f"direction: expected horizontal or vertical, got {direction!r}")
    if not 0.0 < alert_limit < np.inf:
        raise InputError(f"alert_limit: expected a positive number of metres, got {alert_limit}")
    k = np.flatnonzero(points.ok & np.isfinite(true).all(axis=1))
    if len(k) == 0:
        raise InputError("no epoch has both a position and a truth: check the times of both")
    ned = np.einsum("kji,kj->ki", frames.C_en(frames.llh_from_ecef(true[k])), points.r_e[k] - true[k])
    if direction == "horizontal":
        return Stanford(points.t[k], np.hypot(ned[:, 0], ned[:, 1]), points.hpl[k], float(alert_limit), direction)
    return Stanford(points.t[k], np.abs(ned[:, 2]), points.vpl[k], float(alert_limit), direction)
