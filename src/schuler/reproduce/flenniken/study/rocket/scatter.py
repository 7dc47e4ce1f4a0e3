"""Monte Carlo of the computed impact point: all runs at once, no linearisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler import rotation
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.reproduce.flenniken.study.rocket.ellipse import ImpactEllipse
from schuler.reproduce.flenniken.study.rocket.errors import RocketErrors
from schuler.reproduce.flenniken.study.rocket.sensitivity import Variant, check_variant
from schuler.reproduce.flenniken.study.rocket.trajectory import RocketTrajectory
from schuler.sensors.triads import AccelerometerTriad, GyroTriad

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class ImpactScatter:
    """Computed minus true impact of many runs.

    Attributes
    ----------
    name : str
        Name of the model, for legends.
    variant : {"strapdown", "thesis"}
    position, velocity : ndarray, shape (runs, 3)
        Errors at the true time of impact, north, up, east. [m], [m/s]
    point : ndarray, shape (runs, 2)
        Errors of the point where the computed path meets the ground, downrange and crossrange. [m]
    """

    name: str
    variant: Variant
    position: FloatArray
    velocity: FloatArray
    point: FloatArray

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.point)

    @property
    def mean(self) -> FloatArray:
        """Mean error of the point, downrange and crossrange. [m]"""
        return np.asarray(self.point.mean(axis=0))

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation of the point, downrange and crossrange. [m]"""
        return np.asarray(self.point.std(axis=0, ddof=1))

    @property
    def standard_error(self) -> FloatArray:
        """Standard error of the mean. [m]"""
        return np.asarray(self.sigma / np.sqrt(self.runs))

    @property
    def uncertainty(self) -> float:
        """Relative standard error of a standard deviation."""
        return float(1.0 / np.sqrt(2.0 * (self.runs - 1)))

    @property
    def ellipse(self) -> ImpactEllipse:
        """Ellipse of the scatter about its mean."""
        return ImpactEllipse(self.mean, np.cov(self.point.T))

    @property
    def median_miss(self) -> float:
        """Half of the runs are nearer to the true impact, mean error included. [m]"""
        return float(np.median(np.linalg.norm(self.point, axis=1)))

    def summary(self) -> str:
        """Mean, scatter, ellipse and CEP."""
        e, s = self.standard_error, self.sigma
        return (
            f"{self.name}, {self.variant}, {self.runs} runs: scatter {s[0]:.1f} m downrange, {s[1]:.1f} m crossrange "
            f"(+-{100.0 * self.uncertainty:.1f} %); {self.ellipse.summary()} (its standard error {e[0]:.1f}, "
            f"{e[1]:.1f} m); half within {self.median_miss:.1f} m of the true impact"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        return {
            "name": self.name, "variant": self.variant, "runs": self.runs, "mean": self.mean.tolist(),
            "sigma": self.sigma.tolist(), "ellipse": self.ellipse.to_dict(), "median_miss": self.median_miss,
            "point": self.point.tolist(),
        }  # fmt: skip

    def plot(self) -> Figure:
        """Points, mean and ellipse (matplotlib)."""
        from schuler.plotting.drawing import draw
        from schuler.reproduce.flenniken.study.rocket.figures import scatter_figure

        return draw(scatter_figure(self))


def impact_scatter(
    trajectory: RocketTrajectory,
    errors: RocketErrors,
    *,
    runs: int = 200,
    seed: int = 0,
    variant: Variant = "strapdown",
    drawn: bool = False,
    name: str = "",
) -> ImpactScatter:
    """Fly with many realisations of the errors.

    Parameters
    ----------
    trajectory : RocketTrajectory
        20 Hz is enough for the scatter.
    errors : RocketErrors
    runs, seed
    variant : {"strapdown", "thesis"}
        See :mod:`schuler.reproduce.flenniken.study.rocket.sensitivity`.
    drawn : bool
        Draw the constant parameters too, with their values for 1-sigma. By default they are what they are in every
        run, as in the source: they move the mean and widen nothing.
    name : str
        Name of the model.

    Returns
    -------
    ImpactScatter

    References
    ----------
    Flenniken (2005), section 7.3, figure 7.3 (printed as 7.5).
    """
    if runs < 2:
        raise InputError(f"runs: expected two or more, got {runs}")
    rng = np.random.default_rng(seed)
    chosen = [errors.drawn(rng) for _ in range(runs)] if drawn else [errors]
    v, r = _fly(trajectory, chosen, runs, rng, variant)
    dv, dr = v - trajectory.v[-1], r - trajectory.r[-1]
    if not np.all(v[:, 1] < 0.0):
        raise InputError("errors: so large that a computed path does not come down; take smaller ones")
    # the rest of the computed path is straight: it lasts a tenth of a second, in which gravity bends it by centimetres
    ahead = r[:, 1] / -v[:, 1]
    point = dr[:, [0, 2]] + ahead[:, None] * v[:, [0, 2]]
    return ImpactScatter(name or "rocket", variant, dr, dv, point)


def _fly(
    T: RocketTrajectory, errors: list[RocketErrors], runs: int, rng: np.random.Generator, variant: Variant
) -> tuple[FloatArray, FloatArray]:
    """Computed velocity and position at impact, (runs, 3) each. Forces act with the attitude amid a step."""
    check_variant(variant)
    strapdown = variant == "strapdown"
    sensed = T.specific_force if strapdown else T.acceleration
    gravity = np.array([0.0, -T.profile.gravity, 0.0]) if strapdown else np.zeros(3)
    gyro, accel = _Sensors([e.gyro for e in errors], runs, rng), _Sensors([e.accel for e in errors], runs, rng)
    start = np.broadcast_to(np.stack([e.start_attitude for e in errors]), (runs, 3))
    angles = start + np.array([0.0, 0.0, T.pitch[0]])
    C = _yaw_pitch_roll(angles) if strapdown else _thesis_order(angles)
    v = np.tile(T.v[0], (runs, 1))
    r = T.r[0] + np.broadcast_to(np.stack([e.start_position for e in errors]), (runs, 3))
    dt, since = T.dt, np.diff(T.middle, prepend=0.0)
    for k in range(len(dt)):
        w, f = gyro.read(T.rate[k], dt[k], since[k]), accel.read(sensed[k], dt[k], since[k])
        if strapdown:
            half = rotation.dcm_from_rotvec(0.5 * dt[k] * w)
            middle = C @ half
            C = middle @ half
        else:
            middle = _thesis_order(angles + 0.5 * dt[k] * w)
            angles = angles + dt[k] * w
        a = np.einsum("rij,rj->ri", middle, f) + gravity
        r = r + dt[k] * v + 0.5 * dt[k] ** 2 * a
        v = v + dt[k] * a
    return v, r


class _Sensors:
    """Three sensors of every run, sampled one step after the other: a class because the bias moves on."""

    def __init__(self, triads: list[Any], runs: int, rng: np.random.Generator) -> None:
        self.rng, self.runs = rng, runs
        first: GyroTriad = triads[0]
        self.N, self.sigma_b, self.tau, self.b = first.N, first.sigma_b, first.tau, np.zeros((runs, 3))
        if first.start == "stationary":
            self.b = self.sigma_b * rng.standard_normal((runs, 3))
        self.bias = np.stack([t.bias for t in triads])
        self.M = np.stack([t.matrix() for t in triads])
        self.bent = isinstance(first, AccelerometerTriad)
        if self.bent:
            self.asymmetry = np.stack([t.asymmetry for t in triads])
            self.quadratic = np.stack([t.quadratic for t in triads])

    def read(self, u: FloatArray, dt: float, since: float) -> FloatArray:
        """Reading of a true value at the middle of a step of ``dt``, ``since`` after the last. Shape (runs, 3)."""
        keep = np.exp(-since / self.tau)
        z = self.rng.standard_normal((2, self.runs, 3))
        self.b = keep * self.b + self.sigma_b * np.sqrt(1.0 - keep**2) * z[0]
        y = u + self.M @ u + self.bias
        if self.bent:
            y = y + self.asymmetry * np.abs(u) + self.quadratic * u**2
        return np.asarray(y + self.b + self.N / np.sqrt(dt) * z[1])


def _about(axis: int, angle: FloatArray) -> FloatArray:
    """Turns about one axis by angles (n,), vectors turned with the body. Shape (n, 3, 3)."""
    C = np.zeros((*angle.shape, 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    C[..., axis, axis] = 1.0
    C[..., i, i] = C[..., j, j] = np.cos(angle)
    C[..., j, i] = np.sin(angle)
    C[..., i, j] = -C[..., j, i]
    return C


def _yaw_pitch_roll(angles: FloatArray) -> FloatArray:
    """Body to north-up-east of roll, yaw, pitch (n, 3), roll about the forward axis (E20)."""
    return np.asarray(_about(1, angles[:, 1]) @ _about(2, angles[:, 2]) @ _about(0, angles[:, 0]))


def _thesis_order(angles: FloatArray) -> FloatArray:
    """Body to north-up-east of roll, yaw, pitch (n, 3) in the order of (5.33), roll about north."""
    return np.asarray(_about(0, angles[:, 0]) @ _about(1, angles[:, 1]) @ _about(2, angles[:, 2]))
