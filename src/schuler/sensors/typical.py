"""Turn-on biases, scale factors and misalignments typical of a class of sensors, where a data sheet states none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from schuler.sensors.sheets import ACCEL_UNITS, GYRO_UNITS
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.units import DEG, DEG_PER_HR, DEG_PER_RTHR, MG, UG

#: White noise N up to which a sensor is of a class, its name, and the turn-on bias typical of it.
_GYRO_CLASSES = (
    (0.005 * DEG_PER_RTHR, "navigation", 0.01 * DEG_PER_HR),
    (0.15 * DEG_PER_RTHR, "tactical", 10.0 * DEG_PER_HR),
    (1.0 * DEG_PER_RTHR, "industrial", 0.2 * DEG),
    (float("inf"), "consumer", 3.0 * DEG),
)
_ACCEL_CLASSES = (
    (10.0 * UG, "navigation", 50.0 * UG),
    (60.0 * UG, "tactical", 1.0 * MG),
    (300.0 * UG, "industrial", 5.0 * MG),
    (float("inf"), "consumer", 50.0 * MG),
)
#: Scale factor and misalignment typical of a class, 1-sigma: 1e-4 to 1e-3 of most sensors (Groves 2013, section 4.4);
#: 0.1 to 0.5 % in sheets of factory-calibrated MEMS; 3 and 2 % in those of raw parts such as the MPU-6000.
_SCALES = {"navigation": (1e-4, 1e-4), "tactical": (5e-4, 5e-4), "industrial": (3e-3, 2e-3), "consumer": (0.03, 0.02)}
_SCALED = ("scale_factor", "misalignment")


def typical_turn_on_bias(triad: TriadSpec, which: Literal["gyro", "accel"]) -> tuple[float, str]:
    """Turn-on bias typical of sensors with the same white noise, and the name of their class.

    Parameters
    ----------
    triad : TriadSpec
    which : {"gyro", "accel"}

    Returns
    -------
    bias : float
        1-sigma. [rad/s] or [m/s^2]
    name : str

    References
    ----------
    Groves (2013), Table 4.1 for navigation and tactical grade (1 to 100 deg/h, 1 to 10 mg); the sheets of MTi-G-710
    (0.2 deg/s, 3 mg) for factory-calibrated MEMS, of MPU-6000 (50 to 80 mg) for raw ones.
    """
    classes = _GYRO_CLASSES if which == "gyro" else _ACCEL_CLASSES
    _, name, bias = next(row for row in classes if triad.random_walk <= row[0])
    # what wanders by so much within a run does not come back better from one switch-on to the next
    return max(bias, triad.bias_instability, triad.in_run_bias), name


def with_typical_biases(spec: ImuSpec, unstated: Sequence[str]) -> tuple[ImuSpec, list[str]]:
    """Budget with turn-on biases that its source leaves out, and a sentence on each.

    Parameters
    ----------
    spec : ImuSpec
    unstated : sequence of str
        ``gyro.turn_on_bias``, ``accel.turn_on_bias``; others are left as they are.
    """
    sentences = []
    for which in ("gyro", "accel"):
        if f"{which}.turn_on_bias" not in unstated:
            continue
        triad: TriadSpec = getattr(spec, which)
        bias, name = typical_turn_on_bias(triad, which)
        spec = replace(spec, **{which: replace(triad, turn_on_bias=bias)})  # type: ignore[arg-type]
        _, _, unit, factor = (GYRO_UNITS if which == "gyro" else ACCEL_UNITS)["turn_on_bias"]
        sensors = "gyroscopes" if which == "gyro" else "accelerometers"
        sentences.append(
            f"IMU {spec.name}: no turn-on bias of the {sensors} is stated; {bias / factor:.3g} {unit} is taken, "
            f"typical of {name} grade: give bias_... in imu.{which} to say better, 0 if it is calibrated out"
        )
    return spec, sentences


def with_typical_scales(spec: ImuSpec, unstated: Sequence[str]) -> tuple[ImuSpec, list[str]]:
    """Budget with scale factors and misalignments that its source leaves out, and a sentence on each.

    A filter that estimates them has to begin somewhere: zero would say that they are known.

    Parameters
    ----------
    spec : ImuSpec
    unstated : sequence of str
        ``gyro.scale_factor``, ``accel.misalignment`` and the like.
    """
    sentences = []
    for field in unstated:
        which, _, name = field.partition(".")
        triad: TriadSpec = getattr(spec, which)
        classes = _GYRO_CLASSES if which == "gyro" else _ACCEL_CLASSES
        grade = next(row[1] for row in classes if triad.random_walk <= row[0])
        value = _SCALES[grade][_SCALED.index(name)]
        spec = replace(spec, **{which: replace(triad, **{name: value})})  # type: ignore[arg-type]
        sensors = "gyroscopes" if which == "gyro" else "accelerometers"
        sentences.append(
            f"IMU {spec.name}: no {name.replace('_', ' ')} of the {sensors} is stated; {100.0 * value:.3g} % is taken, "
            f"typical of {grade} grade: give {name.partition('_')[0]}_percent in imu.{which} to say better"
        )
    return spec, sentences
