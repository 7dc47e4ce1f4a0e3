"""Growth of all errors of an IMU at rest: 1-sigma of heading, velocity and position by cause."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.growth.closed_forms import constant, gauss_markov, random_walk, white
from schuler.growth.integrals import Start
from schuler.plotting.notebook import Displayed
from schuler.plotting.table import ResultTable
from schuler.units import DEG, G0

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schuler.sensors.spec import ImuSpec, TriadSpec

#: How often an error of each sensor is integrated into each quantity; the gyroscope's into velocity turn gravity.
INTEGRALS = {
    ("gyro", "heading"): 1, ("accel", "velocity"): 1, ("accel", "position"): 2,
    ("gyro", "velocity"): 2, ("gyro", "position"): 3,
}  # fmt: skip
QUANTITIES = ("heading", "velocity", "position")


@dataclass(frozen=True, repr=False)
class Growth(Displayed):
    """1-sigma errors over time of an unaided IMU at rest.

    Attributes
    ----------
    t : ndarray, shape (k,)
        [s]
    causes : tuple of str
        Such as ``gyro noise``.
    contributions : dict of str to ndarray, shape (causes, k)
        1-sigma by quantity: heading [rad], velocity [m/s], position [m] of a horizontal channel.
    gravity : float
        That tilts turn into acceleration; zero for sensors in a plane, where they do not. [m/s^2]
    start : {"stationary", "zero"}
        State of the in-run biases at the start.
    """

    t: FloatArray
    causes: tuple[str, ...]
    contributions: dict[str, FloatArray]
    gravity: float
    start: Start

    def total(self, quantity: str) -> FloatArray:
        """1-sigma of all causes together: root of the sum of squares. Shape (k,)."""
        return np.asarray(np.sqrt(np.sum(np.square(self._of(quantity)), axis=0)))

    def share(self, quantity: str) -> FloatArray:
        """Share of each cause in the variance. Shape (causes, k)."""
        squares = np.square(self._of(quantity))
        total = squares.sum(axis=0)
        return np.asarray(np.divide(squares, total, out=np.zeros_like(squares), where=total > 0.0))

    def table(self) -> ResultTable:
        """Last epoch: contributions and their shares."""
        rows: list[tuple[Any, ...]] = []
        scale = {"heading": DEG, "velocity": 1.0, "position": 1.0}
        for i, cause in enumerate(self.causes):
            row: list[Any] = [cause]
            for q in QUANTITIES:
                row += [float(self.contributions[q][i, -1] / scale[q]), float(100.0 * self.share(q)[i, -1])]
            rows.append(tuple(row))
        rows.append(("total", *(x for q in QUANTITIES for x in (float(self.total(q)[-1] / scale[q]), 100.0))))
        return ResultTable(
            f"Unaided at rest, after {self.t[-1]:g} s, 1-sigma",
            ("cause", "heading_deg", "share_percent", "velocity_m_s", "share_percent", "position_m", "share_percent"),
            tuple(rows),
            (
                "tilts turn gravity into acceleration" if self.gravity else "without gravity",
                f"in-run biases from a {self.start} start; Earth not turning and flat: for minutes, not hours",
            ),
        )

    def summary(self) -> str:
        """The table as text."""
        return self.table().summary()

    def plot(self) -> Figure:
        """Contributions and total over time (matplotlib)."""
        from schuler.growth.figures import growth_figure
        from schuler.plotting.drawing import draw

        return draw(growth_figure(self))

    def _of(self, quantity: str) -> FloatArray:
        if quantity not in self.contributions:
            raise InputError(f"quantity: expected one of {', '.join(QUANTITIES)}, got {quantity!r}")
        return self.contributions[quantity]


def growth(spec: ImuSpec, t: ArrayLike, *, gravity: float = G0, start: Start = "stationary") -> Growth:
    """Closed-form growth of all errors a specification has, a channel at rest.

    Parameters
    ----------
    spec : ImuSpec
    t : array_like, shape (k,)
        Times since the start, increasing. [s]
    gravity : float
        Zero for a planar platform, whose tilts do not matter. [m/s^2]
    start : {"stationary", "zero"}
        Zero: in-run biases have just been calibrated out.

    Returns
    -------
    Growth
        Noise, in-run (Gauss-Markov) bias, turn-on bias, rate random walk of both triads. A bias instability has no
        closed form and is left out.

    Notes
    -----
    Flat Earth: up to some ten minutes (a sixth of the Schuler period) position is right to a few percent; beyond, see
    :mod:`schuler.growth.schuler_loop`.

    References
    ----------
    Flenniken (2005), chapter 3, completed and corrected as docs/error-growth.md says.
    """
    times = np.asarray(t, dtype=np.float64)
    if times.ndim != 1 or not len(times):
        raise InputError("t: expected a series of times, shape (k,)")
    causes: list[str] = []
    parts: dict[str, list[FloatArray]] = {q: [] for q in QUANTITIES}
    for name, triad in (("gyro", spec.gyro), ("accel", spec.accel)):
        for cause, sigma in _causes(triad, start).items():
            causes.append(f"{name} {cause}")
            for q in QUANTITIES:
                n = INTEGRALS.get((name, q))
                factor = gravity if name == "gyro" and q != "heading" else 1.0
                parts[q].append(np.zeros_like(times) if n is None else factor * sigma(n, times))
    if not causes:
        raise InputError(f"{spec.name}: the specification has no error that grows")
    return Growth(times, tuple(causes), {q: np.array(v) for q, v in parts.items()}, gravity, start)


def _causes(triad: TriadSpec, start: Start) -> dict[str, Any]:
    causes: dict[str, Any] = {}
    if triad.random_walk:
        causes["noise"] = lambda n, t: np.sqrt(white(n, t, triad.random_walk))
    if triad.in_run_bias:
        causes["in-run bias"] = lambda n, t: np.sqrt(
            gauss_markov(n, t, triad.in_run_bias, triad.in_run_time, start)
        )  # fmt: skip
    if triad.turn_on_bias:
        causes["turn-on bias"] = lambda n, t: constant(n, t, triad.turn_on_bias)
    if triad.rate_random_walk:
        causes["rate random walk"] = lambda n, t: np.sqrt(random_walk(n, t, triad.rate_random_walk))
    return causes
