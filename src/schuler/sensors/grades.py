"""Which grade an IMU is of: attribute by attribute against the tables of Flenniken's thesis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log10
from typing import Literal, TypeAlias

from schuler.exceptions import InputError
from schuler.sensors import catalogue
from schuler.sensors.spec import ImuSpec, TriadSpec

Sensor: TypeAlias = Literal["gyro", "accel"]

#: Entries of the catalogue that are compared with, worst first.
GRADES = ("flenniken-consumer", "flenniken-automotive", "flenniken-tactical")
#: The same with the accelerometer figures as printed, ten times larger.
PRINTED = ("flenniken-consumer", "flenniken-automotive", "flenniken-tactical-printed")

# field of TriadSpec, its symbol, unit
_ATTRIBUTES = (("random_walk", "N"), ("in_run_bias", "sigma_b"), ("in_run_time", "tau"))


@dataclass(frozen=True, slots=True)
class AttributeGrade:
    """One attribute of one sensor beside the grades.

    Attributes
    ----------
    sensor : {"gyro", "accel"}
    attribute : {"N", "sigma_b", "tau"}
    value : float
        [x/sqrt(Hz)], [x], [s]
    grades : tuple of str
        The nearest; several where the table has the same number for them, worst first.
    decades : float
        How far off they are, ``log10(value / grade)``; positive is larger.
    table : tuple of (str, float)
        Every grade and its number, worst first.
    """

    sensor: Sensor
    attribute: str
    value: float
    grades: tuple[str, ...]
    decades: float
    table: tuple[tuple[str, float], ...]


@dataclass(frozen=True, slots=True)
class SensorGrade:
    """Verdict on one triad.

    Attributes
    ----------
    sensor : {"gyro", "accel"}
    grade : str or None
        The worst of its attributes; an attribute between grades of the same number counts as the better one. None if
        there is no attribute to judge by.
    decided_by : tuple of str
        The attributes that made the verdict.
    attributes : tuple of AttributeGrade
    missing : tuple of str
        Attributes the budget does not state.
    """

    sensor: Sensor
    grade: str | None
    decided_by: tuple[str, ...]
    attributes: tuple[AttributeGrade, ...]
    missing: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class GradeVerdict:
    """Verdict on an IMU.

    Attributes
    ----------
    name : str
    grade : str
        The worse of the two sensors'.
    gyro, accel : SensorGrade
    """

    name: str
    grade: str
    gyro: SensorGrade
    accel: SensorGrade

    def summary(self) -> str:
        """The verdict, then every attribute with what it was compared with, in SI."""
        lines = [f"{self.name}: {self.grade} grade (worst attribute; the tables end at tactical and consumer)"]
        for sensor, unit in ((self.gyro, "rad/s"), (self.accel, "m/s^2")):
            by = f", by {', '.join(sensor.decided_by)}" if sensor.grade else ""
            lines.append(f"  {sensor.sensor}: {sensor.grade or 'no verdict'}{by}")
            units = {"N": f"{unit}/sqrt(Hz)", "sigma_b": unit, "tau": "s"}
            for a in sensor.attributes:
                verdict = f"{' or '.join(a.grades)}, {10.0**a.decades:.3g} times"
                beside = ", ".join(f"{grade} {number:.3g}" for grade, number in a.table)
                lines.append(f"    {a.attribute:<8}{a.value:<11.4g}{units[a.attribute]:<20}{verdict:<40}({beside})")
            lines += [f"    {name:<8}not stated" for name in sensor.missing]
        return "\n".join(lines)


def grade(spec: ImuSpec, names: Sequence[str] = GRADES) -> GradeVerdict:
    """Nearest grade of every noise attribute of an IMU, and the worst of them.

    Parameters
    ----------
    spec : ImuSpec
        White noise, in-run bias and its correlation time are compared; the thesis has no other figures for grades.
    names : sequence of str
        Catalogue entries to compare with, worst first; see :data:`GRADES`, :data:`PRINTED`.

    Returns
    -------
    GradeVerdict

    Raises
    ------
    InputError
        If nothing can be compared, or fewer than two grades are given.

    Notes
    -----
    The thesis gives tables but no rule. Nearest is meant in logarithms, so that a factor of two counts the same on both
    sides. Automotive and consumer share N and tau of the gyroscope and tau of the accelerometer; such an attribute
    names both and counts as the better. A longer correlation time is not a worse one, yet the grades differ in it: see
    in ``decided_by`` whether tau alone made the verdict. Bias instability and turn-on bias are no substitute for the
    in-run bias and are not compared. Navigation grade has no numbers in the thesis: what is better than tactical is
    called tactical, with the factor.

    References
    ----------
    Flenniken (2005), section 2.8, Tables 2.2 and 2.4.
    """
    if len(names) < 2:
        raise InputError(f"names: expected at least two grades to choose from, worst first, got {tuple(names)}")
    labels = tuple(name.removeprefix("flenniken-").removesuffix("-printed") for name in names)
    gyro = _sensor("gyro", spec.gyro, names, labels)
    accel = _sensor("accel", spec.accel, names, labels)
    verdicts = [s.grade for s in (gyro, accel) if s.grade is not None]
    if not verdicts:
        raise InputError(
            f"{spec.name}: expected white noise or an in-run bias with its correlation time to compare, got none"
        )
    return GradeVerdict(spec.name, min(verdicts, key=labels.index), gyro, accel)


def _sensor(sensor: Sensor, triad: TriadSpec, names: Sequence[str], labels: tuple[str, ...]) -> SensorGrade:
    tables = [catalogue.triad(name, sensor) for name in names]
    attributes, missing = [], []
    for attribute, symbol in _ATTRIBUTES:
        value = getattr(triad, attribute)
        if not value:
            missing.append(symbol)
            continue
        table = tuple((label, getattr(t, attribute)) for label, t in zip(labels, tables, strict=True))
        distance = [abs(log10(value / number)) for _, number in table]
        nearest = distance.index(min(distance))
        # equal numbers, but for their rounding on the way to SI
        ties = tuple(label for (label, _), d in zip(table, distance, strict=True) if d <= distance[nearest] + 1e-9)
        attributes.append(AttributeGrade(sensor, symbol, value, ties, log10(value / table[nearest][1]), table))
    worst = min((a.grades[-1] for a in attributes), key=labels.index, default=None)
    decided_by = tuple(a.attribute for a in attributes if a.grades[-1] == worst)
    return SensorGrade(sensor, worst, decided_by, tuple(attributes), tuple(missing))
