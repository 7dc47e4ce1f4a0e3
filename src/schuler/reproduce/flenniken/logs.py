"""Chapter 2: three sensors at rest. The logs are not public; ours are simulated from the numbers found in them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import FloatArray
from schuler.units import DEG, G0, HR

if TYPE_CHECKING:
    from schuler.characterisation.allan import AllanCurve
    from schuler.characterisation.correlation import Correlation
    from schuler.characterisation.manual import ManualNoise
    from schuler.reproduce.flenniken.study.grade_comparison import Overlay
    from schuler.reproduce.items import Effort
    from schuler.sensors.noise import NoiseModel

#: No rate is stated: 100 Hz in the appendices. Nothing of interest is faster than 2 Hz.
QUICK_HZ, FULL_HZ = 2, 100
#: Averaging times at which the slope after the minimum is taken, and before it. [s]
RISING, FALLING = (60.0, 120.0, 240.0), (1.0, 2.0, 4.0)


@dataclass(frozen=True)
class Sensor:
    """A sensor of the chapter.

    Attributes
    ----------
    entry : str
        Entry of the catalogue.
    triad : {"gyro", "accel"}
    hours : float
        Length of the log.
    unit : str
    scale : float
        One ``unit`` in SI.
    """

    entry: str
    triad: str
    hours: float
    unit: str
    scale: float


KVH = Sensor("KVH-5000-measured", "gyro", 14.0, "deg/s", DEG)
AQRS = Sensor("AQRS-104-measured", "gyro", 3.0, "deg/s", DEG)
#: Length not stated: as long as the AQRS's.
HUMPHREY = Sensor("Humphrey", "accel", 3.0, "g", G0)


@dataclass(frozen=True, eq=False)
class Log:
    """One log and the numbers found in it by hand.

    Attributes
    ----------
    x : ndarray, shape (n,)
        SI
    rate_hz : float
    by_hand : ManualNoise
    """

    x: FloatArray
    rate_hz: float
    by_hand: ManualNoise


@dataclass(frozen=True, eq=False)
class Campaign:
    """Characteristics of many logs of one sensor, an array element each.

    Attributes
    ----------
    N, sigma, tau : ndarray, shape (n,)
        By hand. SI, [s]
    falling, rising : ndarray, shape (n,)
        Slopes of the Allan chart before and after its minimum.
    """

    N: FloatArray
    sigma: FloatArray
    tau: FloatArray
    falling: FloatArray
    rising: FloatArray


def model_of(sensor: Sensor) -> NoiseModel:
    """White noise and moving bias; the 1 deg/h of the KVH's sheet is not in its chart and left out."""
    from schuler.sensors import catalogue
    from schuler.sensors.noise import noise_model

    triad = catalogue.triad(sensor.entry, "gyro" if sensor.triad == "gyro" else "accel")
    return noise_model(replace(triad, bias_instability=0.0))


@cache
def log_of(sensor: Sensor, effort: Effort) -> Log:
    """One log as long as the thesis's."""
    from schuler.characterisation.manual import identify_manually

    rate = effort.runs(QUICK_HZ, FULL_HZ)
    rng = np.random.default_rng([effort.seed, len(sensor.entry)])
    x = model_of(sensor).sample(round(sensor.hours * HR * rate), 1.0 / rate, rng)
    return Log(x, float(rate), identify_manually(x, float(rate), unit=sensor.unit))


@cache
def campaign_of(sensor: Sensor, effort: Effort) -> Campaign:
    """Many logs at 2 Hz: one log's sigma and tau are a draw of a wide distribution."""
    from schuler.characterisation import allan_deviation
    from schuler.characterisation.manual import identify_manually

    model, n = model_of(sensor), round(sensor.hours * HR * QUICK_HZ)
    rows = []
    for child in np.random.default_rng([effort.seed, len(sensor.entry), 1]).spawn(effort.runs(100, 400)):
        x = model.sample(n, 1.0 / QUICK_HZ, child)
        by_hand = identify_manually(x, QUICK_HZ)
        curve = allan_deviation(x, QUICK_HZ, taus=[*FALLING, *RISING], noise=0.0)
        slopes = [
            np.polyfit(np.log(curve.tau[part]), np.log(curve.deviation[part]), 1)[0]
            for part in (slice(0, 3), slice(3, 6))
        ]
        rows.append((by_hand.N.value, by_hand.sigma_b.value, by_hand.tau.value, *slopes))
    return Campaign(*(np.array(column) for column in zip(*rows, strict=True)))


@cache
def overlay_of(sensor: Sensor, other: str, effort: Effort, k: int = 0) -> Overlay:
    """A log among simulations of a catalogue entry; ``k`` counts further logs."""
    from schuler.reproduce.flenniken.study.grade_comparison import overlay

    own, other_sensor = log_of(sensor, replace(effort, seed=effort.seed + 1000 * k)), replace(sensor, entry=other)
    return overlay(model_of(other_sensor), own.x, own.rate_hz, np.random.default_rng([effort.seed, k, 7]))


def accepted(sensor: Sensor, other: str, effort: Effort, n: int = 12) -> float:
    """Share of n logs of a sensor that an entry of the catalogue could have made; always at 2 Hz."""
    quick = replace(effort, quick=True)
    return float(np.mean([overlay_of(sensor, other, quick, k).agrees for k in range(n)]))


def chart_of(sensor: Sensor, effort: Effort) -> AllanCurve:
    """Allan chart of the log."""
    from schuler.characterisation import allan_deviation

    log = log_of(sensor, effort)
    return allan_deviation(log.x, log.rate_hz, taus="decade")


def correlation_of(sensor: Sensor, effort: Effort) -> Correlation:
    """Autocorrelation of the log below 0.01 Hz, as the thesis takes its filtered data."""
    from schuler.characterisation import autocorrelation

    log = log_of(sensor, effort)
    stride = round(10.0 * log.rate_hz)
    return autocorrelation(filtered(sensor, effort)[::stride], log.rate_hz / stride, longest_s=4000.0)


def filtered(sensor: Sensor, effort: Effort) -> FloatArray:
    """The log below 0.01 Hz."""
    from schuler.characterisation.manual import low_passed

    log = log_of(sensor, effort)
    return low_passed(log.x, log.rate_hz, 0.01)
