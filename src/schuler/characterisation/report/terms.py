"""Noise terms for people: names, data-sheet units, and what each contributes to an Allan curve."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, TypeAlias

import numpy as np

from schuler import units as u
from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.characterisation.result import AXES, AxisNoise, Estimate, NoiseIdentification
from schuler.exceptions import InputError
from schuler.sensors.noise import GaussMarkov
from schuler.sensors.spec import allan_minimum

#: Title of each triad.
TRIADS = {"gyro": "gyroscope", "accel": "accelerometer"}

Unit: TypeAlias = Literal["datasheet", "si"]


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number of the noise model.

    Attributes
    ----------
    name : str
    si, sheet : str
        SI unit, and unit of data sheets.
    factor : float
        SI units in a data-sheet unit.
    """

    name: str
    si: str
    sheet: str
    factor: float


_GYRO = {
    "N": Quantity("angle random walk N", "(rad/s)/sqrt(Hz)", "deg/sqrt(h)", u.DEG_PER_RTHR),
    "B": Quantity("bias instability B", "rad/s", "deg/h", u.DEG_PER_HR),
    "K": Quantity("rate random walk K", "(rad/s)*sqrt(Hz)", "deg/h/sqrt(h)", u.DEG_PER_HR / math.sqrt(u.HR)),
    "R": Quantity("rate ramp R", "rad/s^2", "deg/h/h", u.DEG_PER_HR / u.HR),
    "Q": Quantity("quantisation Q", "rad", "arcsec", u.ARCSEC),
    "sigma": Quantity("Gauss-Markov, 1 sigma", "rad/s", "deg/h", u.DEG_PER_HR),
    "x": Quantity("angular rate", "rad/s", "deg/h", u.DEG_PER_HR),
    "sample": Quantity("angular rate", "rad/s", "deg/s", u.DEG),
}
_ACCEL = {
    "N": Quantity("velocity random walk N", "(m/s^2)/sqrt(Hz)", "m/s/sqrt(h)", u.MPS_PER_RTHR),
    "B": Quantity("bias instability B", "m/s^2", "ug", u.UG),
    "K": Quantity("acceleration random walk K", "(m/s^2)*sqrt(Hz)", "ug/sqrt(h)", u.UG / math.sqrt(u.HR)),
    "R": Quantity("acceleration ramp R", "m/s^3", "ug/h", u.UG / u.HR),
    "Q": Quantity("quantisation Q", "m/s", "m/s", 1.0),
    "sigma": Quantity("Gauss-Markov, 1 sigma", "m/s^2", "ug", u.UG),
    "x": Quantity("specific force", "m/s^2", "ug", u.UG),
    "sample": Quantity("specific force", "m/s^2", "mg", u.MG),
}

#: Which letter an entry of a :class:`~schuler.sensors.spec.TriadSpec` is the value of.
FIELDS = MappingProxyType(
    {
        "random_walk": "N",
        "bias_instability": "B",
        "rate_random_walk": "K",
        "rate_ramp": "R",
        "quantisation": "Q",
        "in_run_bias": "sigma",
        "turn_on_bias": "sample",
    }
)


def quantities(triad: str) -> dict[str, Quantity]:
    """The quantities of ``gyro`` or ``accel`` by letter; ``x`` is the signal, ``sample`` a single sample of it."""
    return _GYRO if triad == "gyro" else _ACCEL


def triad_of(axis: AxisNoise) -> str:
    """``gyro`` or ``accel``."""
    return axis.axis.partition("_")[0]


def quantity(axis: AxisNoise, letter: str) -> Quantity:
    """Name and units of one letter for this axis."""
    return quantities(triad_of(axis))[letter]


def signal_unit(axis: AxisNoise, unit: Unit) -> tuple[str, float]:
    """Unit in which the signal is shown and SI units in it."""
    q = quantity(axis, "x")
    return (q.si, 1.0) if unit == "si" else (q.sheet, q.factor)


def chosen(identification: NoiseIdentification, axes: str | tuple[str, ...] | list[str] | None) -> list[AxisNoise]:
    """The axes asked for, all of them if None; in the usual order.

    Raises
    ------
    InputError
        If one was not identified.
    """
    identified = [name for name in AXES if name in identification.axes]
    identified += [name for name in identification.axes if name not in identified]
    names = identified if axes is None else [axes] if isinstance(axes, str) else list(axes)
    for name in names:
        if name not in identification.axes:
            why = identification.refused.get(name)
            reason = f"; it was refused: {why[0].text}" if why else ""
            raise InputError(f"axes: expected some of {', '.join(identified) or 'none'}, got {name!r}{reason}")
    if not names:
        raise InputError(f"{identification.name}: no axis was identified, so there is no curve to draw")
    return [identification.axes[name] for name in names]


def numbers(axis: AxisNoise) -> Iterator[tuple[str, Quantity, Estimate]]:
    """Label, quantity and estimate of every parameter: terms first, then each Gauss-Markov pair."""
    for letter in ("Q", "N", "B", "K", "R"):
        if letter in axis.terms:
            yield letter, quantity(axis, letter), axis.terms[letter]
    for k, (sigma, tau) in enumerate(axis.gauss_markov):
        label = gauss_markov_label(axis, k)
        yield label, quantity(axis, "sigma"), sigma
        yield f"{label} time", Quantity("Gauss-Markov, correlation time", "s", "s", 1.0), tau


def gauss_markov_label(axis: AxisNoise, k: int) -> str:
    """``GM``, or with a number if there are several."""
    return "GM" if len(axis.gauss_markov) == 1 else f"GM{k + 1}"


def term_variances(axis: AxisNoise, tau: ArrayLike) -> dict[str, FloatArray]:
    """Allan variance of each fitted term by label.

    Parameters
    ----------
    axis : AxisNoise
    tau : array_like, shape (k,)
        Averaging times. [s]

    Returns
    -------
    dict of str to ndarray, shape (k,)
        [x^2]. B is the level ``(0.664 B)^2`` of true 1/f noise; the model that is simulated leaves it by a few per cent
        inside its band.

    References
    ----------
    IEEE Std 952, annex C; Gauss-Markov: :class:`~schuler.sensors.noise.GaussMarkov`.
    """
    tau = np.atleast_1d(as_floats(tau, "tau"))
    shapes: dict[str, Callable[[float], FloatArray]] = {
        "Q": lambda Q: 3.0 * (Q / tau) ** 2,
        "N": lambda N: N**2 / tau,
        "B": lambda B: np.full_like(tau, allan_minimum(B) ** 2),
        "K": lambda K: K**2 * tau / 3.0,
        "R": lambda R: 0.5 * (R * tau) ** 2,
    }
    curves = {letter: shape(axis.terms[letter].value) for letter, shape in shapes.items() if letter in axis.terms}
    for k, (sigma, time) in enumerate(axis.gauss_markov):
        if sigma.value > 0.0:
            curves[gauss_markov_label(axis, k)] = GaussMarkov(sigma.value, time.value).allan_variance(tau)
    return curves


def shares(axis: AxisNoise, tau: float) -> dict[str, float]:
    """Share of each term in the model's Allan variance at ``tau`` [s], largest first; they sum to one."""
    parts = {label: float(curve[0]) for label, curve in term_variances(axis, [tau]).items()}
    total = sum(parts.values())
    if total <= 0.0:
        return {}
    return {label: v / total for label, v in sorted(parts.items(), key=lambda item: -item[1])}


def agreement(axis: AxisNoise) -> float:
    """Share of the averaging times at which the model lies inside the bounds of the curve; NaN without any."""
    c = axis.curve
    bounded = np.isfinite(c.low) & np.isfinite(c.high)
    if not bounded.any():
        return float("nan")
    model = axis.fitted(c.tau[bounded])
    return float(np.mean((model >= c.low[bounded]) & (model <= c.high[bounded])))
