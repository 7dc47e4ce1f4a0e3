"""Noise terms for people: names, data-sheet units, and what each contributes to an Allan curve."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, TypeAlias

import numpy as np

from schuler import units as u
from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.characterisation.result import AXES, AxisNoise, Estimate, NoiseIdentification
from schuler.exceptions import InputError
from schuler.sensors.noise import GaussMarkov
from schuler.sensors.spec import TriadSpec, allan_minimum

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


#: Of each term of a log-log Allan plot: slope, and Allan deviation at 1 s of a coefficient of one.
SLOPES = MappingProxyType(
    {
        "Q": (-1.0, math.sqrt(3.0)),
        "N": (-0.5, 1.0),
        "B": (0.0, allan_minimum(1.0)),
        "K": (0.5, 1.0 / math.sqrt(3.0)),
        "R": (1.0, 1.0 / math.sqrt(2.0)),
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
    """Allan variance of each fitted term by label, see :func:`allan_variances`."""
    values = {letter: estimate.value for letter, estimate in axis.terms.items()}
    return allan_variances(values, [(sigma.value, time.value) for sigma, time in axis.gauss_markov], tau)


def sheet_variances(spec: TriadSpec, tau: ArrayLike) -> dict[str, FloatArray]:
    """Allan variance of each noise of a specification by label, see :func:`allan_variances`."""
    letters = {letter: float(getattr(spec, name)) for name, letter in FIELDS.items() if letter in SLOPES}
    in_run = [(spec.in_run_bias, spec.in_run_time)] if spec.in_run_bias > 0.0 else []
    return allan_variances({letter: value for letter, value in letters.items() if value > 0.0}, in_run, tau)


def allan_variances(
    terms: Mapping[str, float], gauss_markov: Sequence[tuple[float, float]], tau: ArrayLike
) -> dict[str, FloatArray]:
    """Allan variance of each term of a noise model by label.

    Parameters
    ----------
    terms : mapping of str to float
        Coefficients Q, N, B, K, R; those left out are none. SI
    gauss_markov : sequence of (sigma, time)
        [x], [s]
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
    curves = {
        letter: (terms[letter] * factor) ** 2 * tau ** (2.0 * slope)
        for letter, (slope, factor) in SLOPES.items()
        if letter in terms
    }
    for k, (sigma, time) in enumerate(gauss_markov):
        if sigma > 0.0:
            curves["GM" if len(gauss_markov) == 1 else f"GM{k + 1}"] = GaussMarkov(sigma, time).allan_variance(tau)
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
