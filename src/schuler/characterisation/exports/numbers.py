"""Noise models as other programs take them: one white density and one bias random walk for each triad."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite, sqrt
from typing import Literal, TypeAlias

import numpy as np

from schuler.characterisation.result import AxisNoise, NoiseIdentification
from schuler.exceptions import InputError
from schuler.sensors.noise import GaussMarkov, NoiseModel, noise_model
from schuler.sensors.spec import ImuSpec, TriadSpec

#: Averaging time at which the wander of the bias is matched where nothing else is asked for. [s]
HORIZON_S = 100.0

Axes: TypeAlias = Literal["worst", "rms"]
_COMBINE: dict[str, Callable[[list[float]], float]] = {
    "worst": max,
    "rms": lambda values: float(np.sqrt(np.mean(np.square(values)))),
}


@dataclass(frozen=True, slots=True)
class Common:
    """Arguments that all exports share.

    Attributes
    ----------
    axes : {"worst", "rms"}
        How three axes become one number.
    white, walk : float
        Factors on white densities and on bias random walks.
    horizon : float or None
        Averaging time at which K is matched; None takes K itself where it was identified. [s]
    rate : float or None
        Sampling rate. [Hz]
    """

    axes: Axes = "worst"
    white: float = 1.0
    walk: float = 1.0
    horizon: float | None = None
    rate: float | None = None


@dataclass(frozen=True, slots=True)
class Sensor:
    """One triad reduced to what the programs take; nothing here is inflated.

    Attributes
    ----------
    N : float
        White noise, two-sided root density. [x/sqrt(Hz)]
    K : float
        Random walk of the bias. [x*sqrt(Hz)]
    wander : float
        Allan deviation of everything but the white noise at the horizon. [x]
    gauss_markov : tuple of float or None
        Standard deviation [x] and correlation time [s] of the strongest Gauss-Markov term.
    turn_on, scale : float
        Turn-on bias [x] and scale-factor error [-], 1 sigma; zero if unknown.
    notes : tuple of str
        Where the numbers come from.
    """

    N: float
    K: float
    wander: float
    gauss_markov: tuple[float, float] | None
    turn_on: float
    scale: float
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Numbers:
    """Both triads and what they belong to.

    Attributes
    ----------
    name : str
    gyro, accel : Sensor
    rate : float or None
        [Hz]
    horizon : float
        [s]
    common : Common
    """

    name: str
    gyro: Sensor
    accel: Sensor
    rate: float | None
    horizon: float
    common: Common

    def need_rate(self) -> float:
        """Sampling rate, which the program needs. [Hz]"""
        if self.rate is None:
            raise InputError(f"{self.name}: this program needs the sampling rate; give rate_hz")
        return self.rate


def common(
    axes: str = "worst",
    inflation: float | tuple[float, float] = 1.0,
    horizon_s: float | None = None,
    rate_hz: float | None = None,
) -> Common:
    """Check the arguments that all exports share.

    Raises
    ------
    InputError
        If ``axes`` is neither ``worst`` nor ``rms`` or a number is not positive.
    """
    if axes not in _COMBINE:
        raise InputError(f"axes: expected 'worst' or 'rms', got {axes!r}")
    pair = inflation if isinstance(inflation, tuple | list) else (inflation, inflation)
    if len(pair) != 2:
        raise InputError(f"inflation: expected one factor, or two for white noise and bias walk, got {inflation!r}")
    for name, value in (("inflation", pair[0]), ("inflation", pair[1]), ("horizon_s", horizon_s), ("rate_hz", rate_hz)):
        if value is not None and not (isinstance(value, int | float) and isfinite(value) and value > 0.0):
            raise InputError(f"{name}: expected a positive number, got {value!r}")
    return Common("worst" if axes == "worst" else "rms", float(pair[0]), float(pair[1]), horizon_s, rate_hz)


def numbers(result: NoiseIdentification | ImuSpec, options: Common) -> Numbers:
    """Reduce an identification or a budget to what other programs take.

    Parameters
    ----------
    result : NoiseIdentification or ImuSpec
    options : Common

    Returns
    -------
    Numbers

    Raises
    ------
    InputError
        If a triad has no axis with white noise.

    Notes
    -----
    Programs with a random-walk bias want its density K. Where K was identified it is taken. Otherwise, or if a horizon
    is asked for, K is that of the random walk whose Allan deviation at the horizon T equals that of all terms but white
    noise and quantisation: ``K = sigma_A(T) sqrt(3 / T)``. For a Gauss-Markov bias and T far below its correlation time
    that is ``sigma sqrt(2 / tau)``, for bias instability ``0.664 B sqrt(3 / T)``, which depends on T: 1/f noise is no
    random walk.
    """
    horizon = HORIZON_S if options.horizon is None else options.horizon
    if isinstance(result, ImuSpec):
        gyro, accel = (_of_triad(t, options, horizon) for t in (result.gyro, result.accel))
        return Numbers(result.name, gyro, accel, options.rate or result.rate_hz, horizon, options)
    if not isinstance(result, NoiseIdentification):
        raise InputError(f"expected a NoiseIdentification or an ImuSpec, got {type(result).__name__}")
    gyro, accel = (_of_axes(result, sensor, options, horizon) for sensor in ("gyro", "accel"))
    rates = [axis.rate_hz for axis in result.axes.values()]
    return Numbers(result.name, gyro, accel, options.rate or (rates[0] if rates else None), horizon, options)


def matched_sigma(wander: float, tau: float, horizon: float) -> float:
    """Standard deviation of the Gauss-Markov process of correlation time tau that has a given Allan deviation.

    Parameters
    ----------
    wander : float
        Allan deviation at the horizon. [x]
    tau, horizon : float
        Correlation time and averaging time. [s]
    """
    unit: float = float(GaussMarkov(1.0, tau).allan_variance(horizon))
    return wander / sqrt(unit)


def _of_triad(triad: TriadSpec, options: Common, horizon: float) -> Sensor:
    in_run = noise_model(triad).in_run
    gm = (triad.in_run_bias, triad.in_run_time) if triad.in_run_bias else None
    wander = sqrt(float(in_run.allan_variance(horizon)))
    terms = _listed(triad.bias_instability, gm, triad.rate_random_walk, triad.rate_ramp)
    K, origin = _walk(triad.rate_random_walk, wander, terms, options, horizon)
    notes = ("budget of the triad, the same for its three axes", origin)
    return Sensor(triad.random_walk, K, wander, gm, triad.turn_on_bias, triad.scale_factor, notes)


def _of_axes(result: NoiseIdentification, sensor: str, options: Common, horizon: float) -> Sensor:
    axes = {name: axis for name, axis in result.axes.items() if name.startswith(sensor)}
    with_white = {name: axis for name, axis in axes.items() if "N" in axis.terms}
    if not with_white:
        raise InputError(
            f"{result.name}: no axis of the {sensor} has an identified white noise ({_refusals(result, sensor)}); "
            "no configuration can be made of it"
        )
    combine = _COMBINE[options.axes]
    N = combine([axis.terms["N"].value for axis in with_white.values()])
    models = [_in_run(axis) for axis in axes.values()]
    wander = combine([sqrt(float(m.allan_variance(horizon))) for m in models])
    walks = [axis.terms["K"].value for axis in axes.values() if "K" in axis.terms]
    # an axis without K has a K of zero in the rms, and is not the worst one
    K_identified = combine(walks + [0.0] * (len(axes) - len(walks))) if walks else 0.0
    gms = [(s.value, t.value) for axis in axes.values() for s, t in axis.gauss_markov]
    letters = {letter for axis in axes.values() for letter in axis.terms}
    K, origin = _walk(K_identified, wander, _listed("B" in letters, gms, walks, "R" in letters), options, horizon)
    relative = max(axis.terms["N"].sigma / axis.terms["N"].value for axis in with_white.values())
    notes = [
        f"{options.axes} of {', '.join(with_white)}; N is known to {100.0 * relative:.2g} % (1 sigma)",
        origin,
    ]
    missing = [f"{sensor}_{letter}" for letter in "xyz" if f"{sensor}_{letter}" not in with_white]
    if missing:
        notes.append(f"without {', '.join(missing)}: {_refusals(result, sensor)}")
    triad = None if result.spec is None else getattr(result.spec, sensor)
    turn_on, scale = (0.0, 0.0) if triad is None else (triad.turn_on_bias, triad.scale_factor)
    return Sensor(N, K, wander, max(gms, default=None), turn_on, scale, tuple(notes))


def _in_run(axis: AxisNoise) -> NoiseModel:
    """The terms of an axis that make its bias wander: all but white noise and quantisation."""
    B, K, R = (axis.terms[letter].value if letter in axis.terms else 0.0 for letter in "BKR")
    budget = TriadSpec(random_walk=0.0, bias_instability=B, rate_random_walk=K, rate_ramp=R)
    markov = (GaussMarkov(sigma.value, tau.value) for sigma, tau in axis.gauss_markov)
    return NoiseModel((noise_model(budget).in_run, *markov))


def _walk(K: float, wander: float, names: str, options: Common, horizon: float) -> tuple[float, str]:
    """Random-walk density to write, and the sentence that says where it comes from."""
    matched = wander * sqrt(3.0 / horizon)
    if K > 0.0 and options.horizon is None:
        return K, f"K as identified; all terms but white noise together match {matched:.3e} at {horizon:g} s"
    if matched == 0.0:
        return 0.0, "no rate random walk or other wander of the bias was identified: zero, a bias held constant"
    why = "at the horizon asked for" if K > 0.0 else "K was not identified"
    return matched, (
        f"K: {why}; it is that of the random walk with the Allan deviation of {names} at {horizon:g} s, "
        f"sigma_A sqrt(3/T) with sigma_A = {wander:.3e}"
    )


def _listed(B: object, gm: object, K: object, R: object) -> str:
    """The terms that wander, in words."""
    words = {"the bias instability": B, "the Gauss-Markov bias": gm, "the random walk": K, "the ramp": R}
    return " and ".join(word for word, present in words.items() if present)


def _refusals(result: NoiseIdentification, sensor: str) -> str:
    texts = {f.text for name, axes in result.refused.items() if name.startswith(sensor) for f in axes}
    return "; ".join(sorted(texts)) or "no white noise in their models"


def comments(n: Numbers, program: str, extra: Mapping[str, str] | None = None) -> str:
    """Head of an exported file: what it is for, where the numbers come from, what was done to them."""
    factor = n.common
    inflated = (
        "not inflated" if factor.white == factor.walk == 1.0 else
        f"white noise inflated by {factor.white:g}, bias random walk by {factor.walk:g}"
    )  # fmt: skip
    lines = [f"Noise of {n.name or 'an IMU'} for {program}, written by schuler; {inflated}."]
    for title, sensor in (("gyroscope", n.gyro), ("accelerometer", n.accel)):
        lines += [f"{title}: {note}" for note in sensor.notes]
    lines += [f"{key}: {text}" for key, text in (extra or {}).items()]
    return "".join(f"# {' '.join(line.split())}\n" for line in lines)


def held_to(value: float, low: float, high: float) -> str:
    """A sentence if a value is outside of what a program documents as its range, else nothing."""
    if low <= value <= high:
        return ""
    return f"outside the documented range {low:g} to {high:g}; "
