"""Turn-on biases typical of a class of sensors, where a data sheet states none."""

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
