"""Grades: every grade of the tables is its own, and a sensor is as good as its worst attribute."""

from dataclasses import replace
from math import log10, sqrt

import pytest

from schuler.exceptions import InputError
from schuler.sensors import ImuSpec, TriadSpec, catalogue, grade
from schuler.sensors.grades import GRADES, PRINTED


@pytest.mark.parametrize("name", ["consumer", "automotive", "tactical"])
def test_every_grade_is_of_its_own_grade(name):
    verdict = grade(catalogue.spec(name))
    assert (verdict.grade, verdict.gyro.grade, verdict.accel.grade) == (name, name, name)
    for attribute in (*verdict.gyro.attributes, *verdict.accel.attributes):
        assert name in attribute.grades
        assert attribute.decades == pytest.approx(0.0, abs=1e-12)  # rounding


def test_the_numbers_are_those_of_the_thesis():
    """Tables 2.2 and 2.4, with the tactical accelerometer of Table 2.1 (printed digits)."""
    verdict = grade(catalogue.spec("consumer"))
    deg, g = 3.141592653589793 / 180.0, 9.80665
    tables = {
        (s.sensor, a.attribute): [n for _, n in a.table] for s in (verdict.gyro, verdict.accel) for a in s.attributes
    }
    assert tables["gyro", "N"] == pytest.approx([0.05 * deg, 0.05 * deg, 0.0017 * deg])
    assert tables["gyro", "sigma_b"] == pytest.approx([360 * deg / 3600, 180 * deg / 3600, 0.35 * deg / 3600])
    assert tables["gyro", "tau"] == [300.0, 300.0, 100.0]
    assert tables["accel", "N"] == pytest.approx([0.003 * g, 0.001 * g, 50e-6 * g])
    assert tables["accel", "sigma_b"] == pytest.approx([2.4e-3 * g, 1.2e-3 * g, 50e-6 * g])
    assert tables["accel", "tau"] == [100.0, 100.0, 60.0]


def test_the_printed_table():
    assert grade(catalogue.spec("tactical-printed")).grade == "automotive"  # ten times the corrected one
    assert grade(catalogue.spec("tactical-printed"), PRINTED).grade == "tactical"


def test_the_worst_attribute_decides():
    tactical = catalogue.spec("tactical")
    spoilt = replace(tactical, accel=replace(tactical.accel, in_run_bias=2.4e-3 * 9.80665))
    verdict = grade(spoilt)
    assert (verdict.grade, verdict.gyro.grade, verdict.accel.grade) == ("consumer", "tactical", "consumer")
    assert verdict.accel.decided_by == ("sigma_b",)
    assert [a.grades for a in verdict.accel.attributes] == [("tactical",), ("consumer",), ("tactical",)]


def test_nearest_is_meant_in_logarithms():
    """The border lies at the geometric mean of two grades."""
    tactical = catalogue.spec("tactical")
    border = sqrt(tactical.accel.random_walk * catalogue.spec("automotive").accel.random_walk)
    for factor, expected in ((0.99, "tactical"), (1.01, "automotive")):
        accel = replace(tactical.accel, random_walk=factor * border)
        judged = grade(replace(tactical, accel=accel)).accel.attributes[0]
        assert judged.grades == (expected,)
        assert abs(judged.decades) == pytest.approx(0.5 * log10(20.0), abs=0.005)


def test_equal_numbers_name_both_grades_and_count_as_the_better():
    judged = grade(catalogue.spec("consumer")).gyro.attributes[0]
    assert judged.grades == ("consumer", "automotive")
    only_noise = ImuSpec("x", TriadSpec(random_walk=judged.value), catalogue.triad("tactical", "accel"))
    assert grade(only_noise).gyro.grade == "automotive"


def test_what_is_missing_is_said():
    verdict = grade(catalogue.spec("MPU-6000"))
    assert verdict.gyro.missing == ("sigma_b", "tau")
    assert verdict.gyro.decided_by == ("N",)
    perfect = ImuSpec("x", TriadSpec(random_walk=0.0), catalogue.triad("tactical", "accel"))
    assert grade(perfect).gyro.grade is None
    assert grade(perfect).grade == "tactical"


def test_summary():
    text = grade(catalogue.spec("MPU-6000")).summary()
    assert text.startswith("MPU-6000: automotive grade")
    assert "gyro: tactical, by N" in text
    assert "sigma_b not stated" in text
    tactical = catalogue.spec("tactical")
    worse = replace(tactical, accel=replace(tactical.accel, random_walk=1.5 * tactical.accel.random_walk))
    assert "tactical, 1.5 times" in grade(worse).summary()
    perfect = ImuSpec("x", TriadSpec(random_walk=0.0), catalogue.triad("tactical", "accel"))
    assert "gyro: no verdict" in grade(perfect).summary()


def test_refusals():
    nothing = ImuSpec("x", TriadSpec(random_walk=0.0), TriadSpec(random_walk=0.0))
    with pytest.raises(InputError, match="x: expected white noise or an in-run bias"):
        grade(nothing)
    with pytest.raises(InputError, match="names: expected at least two"):
        grade(nothing, GRADES[:1])
    assert grade(catalogue.spec("consumer"), GRADES[:2]).grade == "consumer"
