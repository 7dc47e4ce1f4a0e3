"""Time to dwell in each static pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, isfinite

import numpy as np

from schuler.arrays import ArrayLike
from schuler.calibration.design.pose_design import Sensor, predicted_sigma, sigma_of_mean
from schuler.exceptions import InputError
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.units import G0

_LONGEST = 1e5  # dwell times are searched up to here, about a day [s]
_ENOUGH = 1.1  # staying longer is not worth it once the mean is this near to its best


@dataclass(frozen=True)
class Dwell:
    """Time to stay in each pose.

    Attributes
    ----------
    seconds : float
        Shortest dwell that meets the target; infinity if none does. [s]
    best_s : float
        Dwell of the least uncertainty of a mean; infinity for white noise only. [s]
    enough_s : float
        From here on a mean is within 10 % of its best; infinity for white noise only. [s]
    sigma : float
        Uncertainty of a mean after ``seconds``, or the least there is. [x]
    repeats : int
        How often the whole plan has to be made, staying ``enough_s``, where one pass cannot meet the target; else 1.
    words : str
    """

    seconds: float
    best_s: float
    enough_s: float
    sigma: float
    repeats: int
    words: str


def dwell_time(
    spec: ImuSpec | TriadSpec,
    target: float | Mapping[str, float] | None = None,
    directions: ArrayLike | None = None,
    *,
    parameters: int = 9,
    sensor: Sensor = "accel",
    reference: float = G0,
) -> Dwell:
    """Time to stay in each pose.

    Parameters
    ----------
    spec : ImuSpec or TriadSpec
    target : float, or mapping of str to float, optional
        Uncertainty wanted of a mean [x], or of parameters by name (SI; then ``directions`` are needed). None: only the
        time from which staying longer does not pay.
    directions : array_like, shape (n, 3), optional
        The poses.
    parameters, sensor, reference
        As for :func:`predicted_sigma`.

    Returns
    -------
    Dwell

    Raises
    ------
    InputError
        If the target is not positive, names an unknown parameter or one that the poses do not determine.
    """
    triad = spec if isinstance(spec, TriadSpec) else getattr(spec, sensor)
    T = np.logspace(0.0, np.log10(_LONGEST), 2001)
    dev = sigma_of_mean(triad, T)
    if not (dev > 0.0).all():
        raise InputError("spec: expected some noise (N or B), got a perfect sensor")
    k = int(np.argmin(dev))
    ends = k == len(T) - 1 and dev[k] < 0.999 * dev[k - 40]  # still falling at the longest time
    best = float("inf") if k == len(T) - 1 else float(T[k])
    enough = float("inf") if ends else float(T[int(np.argmax(dev <= _ENOUGH * dev[k]))])
    stated = (
        "white noise only: the longer the better"
        if ends
        else f"longer than {enough:.0f} s hardly pays: bias instability limits a mean to {dev[k]:.2g}"
    )
    if target is None:
        return Dwell(enough, best, enough, float(dev[k] if ends else sigma_of_mean(triad, enough)), 1, stated)
    wanted, which = _wanted(target, directions, parameters, sensor, reference)
    good = np.flatnonzero(dev <= wanted)
    if len(good):
        j = int(good[0])
        t = float(T[0]) if j == 0 else _crossing(triad, wanted, float(T[j - 1]), float(T[j]))
        text = f"{t:.0f} s in each pose give {which}; {stated}"
        return Dwell(t, best, enough, float(sigma_of_mean(triad, t)), 1, text)
    stay = float(T[k]) if not isfinite(enough) else enough
    repeats = ceil((float(sigma_of_mean(triad, stay)) / wanted) ** 2)
    text = f"no dwell gives {which}: {stated}; make the whole plan {repeats} times, staying {stay:.0f} s"
    return Dwell(float("inf"), best, enough, float(dev[k]), repeats, text)


def _wanted(
    target: float | Mapping[str, float], directions: ArrayLike | None, parameters: int, sensor: Sensor, reference: float
) -> tuple[float, str]:
    """Uncertainty of a mean that meets the target [x], and the target in words."""
    if not isinstance(target, Mapping):
        if not target > 0.0:
            raise InputError(f"target: expected a positive uncertainty, got {target}")
        return float(target), f"means good to {target:.3g}"
    if directions is None:
        raise InputError("directions: expected the poses, since the target is of parameters; see attitude_plan")
    unit_noise = TriadSpec(random_walk=1.0)
    per_unit = predicted_sigma(directions, unit_noise, 1.0, parameters, sensor=sensor, reference=reference)
    identified: list[tuple[float, str]] = []
    for name, value in target.items():
        if name not in per_unit:
            raise InputError(f"target: expected some of {', '.join(per_unit)}, got {name!r}")
        if not value > 0.0:
            raise InputError(f"target: expected a positive uncertainty of {name}, got {value}")
        if not isfinite(per_unit[name]):
            raise InputError(f"target: these poses do not determine {name}, however long; add poses")
        identified.append((value / per_unit[name], f"{name} to {value:.3g}"))
    if not identified:
        raise InputError("target: expected at least one parameter, got none")
    wanted, hardest = min(identified)
    return wanted, hardest + (" and the others better than asked" if len(identified) > 1 else "")


def _crossing(triad: TriadSpec, wanted: float, low: float, high: float) -> float:
    """Where a mean becomes as good as wanted, between two times. [s]"""
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if sigma_of_mean(triad, middle) <= wanted else (middle, high)
    return high
