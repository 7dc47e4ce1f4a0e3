"""Dilution of precision: closed forms of regular geometries, laws, epochs without a solution."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.gnss.dop import dilution

ROUNDING = 1e-12


def ring(n: int, elevation: float, turned: float = 0.0) -> np.ndarray:
    """n satellites evenly around the horizon at one elevation, north-east-down."""
    azimuth = turned + 2.0 * np.pi * np.arange(n) / n
    c, s = np.cos(elevation), np.sin(elevation)
    return np.stack((c * np.cos(azimuth), c * np.sin(azimuth), np.full(n, -s)), axis=-1)


ZENITH = np.array([[0.0, 0.0, -1.0]])


def values(d):
    return [float(getattr(d, name)[0]) for name in ("gdop", "pdop", "hdop", "vdop", "tdop")]


def test_of_a_regular_tetrahedron():
    """Sum u = 0 and sum u u' = 4/3 I: the normal equations are diagonal."""
    u = np.concatenate((ZENITH, ring(3, -np.arcsin(1.0 / 3.0))))
    expected = [np.sqrt(2.5), 1.5, np.sqrt(1.5), np.sqrt(0.75), 0.5]
    assert values(dilution(u)) == pytest.approx(expected, rel=ROUNDING)


@pytest.mark.parametrize("n", [3, 4, 7, 12])
def test_of_a_ring_and_a_satellite_overhead(n):
    """Horizontal parts decouple: HDOP = 2 / (sqrt(n) cos el); vertical and clock are a line through two points."""
    elevation = 0.3
    d = dilution(np.concatenate((ring(n, elevation, 0.1), ZENITH)))
    assert d.hdop[0] == pytest.approx(2.0 / (np.sqrt(n) * np.cos(elevation)), rel=ROUNDING)
    gap = 1.0 - np.sin(elevation)
    assert d.vdop[0] == pytest.approx(np.sqrt(1.0 / n + 1.0) / gap, rel=1e-10)


def test_turning_about_the_vertical_changes_nothing():
    u = np.concatenate((ring(5, 0.2), ring(3, 0.9), ZENITH))
    c, s = np.cos(1.1), np.sin(1.1)
    turned = u @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    assert values(dilution(turned)) == pytest.approx(values(dilution(u)), rel=1e-11)


def test_pythagoras():
    d = dilution(np.concatenate((ring(5, 0.2), ring(3, 0.9, 0.4))))
    assert d.pdop**2 == pytest.approx(d.hdop**2 + d.vdop**2, rel=ROUNDING)
    assert d.gdop**2 == pytest.approx(d.pdop**2 + d.tdop**2, rel=ROUNDING)


def test_one_satellite_of_a_second_system_adds_its_clock_and_nothing_else():
    u = np.concatenate((ring(5, 0.2), ZENITH))
    both = dilution(np.concatenate((u, ring(1, 0.5, 0.7))), group=[0] * 6 + [1])
    assert both.pdop == pytest.approx(dilution(u).pdop, rel=ROUNDING)
    assert both.tdop == pytest.approx(dilution(u).tdop, rel=ROUNDING)
    assert both.gdop > dilution(u).gdop


def test_a_common_clock_is_better_than_two():
    u = np.concatenate((ring(4, 0.2), ring(4, 0.9, 0.4)))
    assert dilution(u).pdop < dilution(u, group=[0, 1] * 4).pdop


def test_masked_satellites_count_as_absent():
    u = np.concatenate((ring(5, 0.2), ring(3, 0.9), ZENITH))
    keep = np.array([True, False, True, True, True, False, True, True, True])
    assert values(dilution(u, keep)) == pytest.approx(values(dilution(u[keep])), rel=ROUNDING)


def test_many_epochs_are_each_alone():
    u = np.stack([np.concatenate((ring(5, 0.2, a), ZENITH)) for a in (0.0, 0.3)] + [ring(6, 0.4)])
    d = dilution(u)
    assert values(d.where([1])) == pytest.approx(values(dilution(u[1])), rel=ROUNDING)
    assert np.isinf(d.pdop[2])


@pytest.mark.parametrize(
    "u", [ring(3, 0.4), ring(8, 0.4), np.array([[np.cos(a), 0.0, -np.sin(a)] for a in (0.2, 0.7, 1.3, 2.0, 2.8)])],
    ids=["three", "all at one elevation", "all in one plane"],
)  # fmt: skip
def test_no_solution_is_infinite(u):
    assert np.isinf(values(dilution(u))).all()


def test_the_first_clock_seen_is_the_one_of_tdop():
    u = np.concatenate((ring(5, 0.2), ZENITH))
    assert dilution(u, group=[2] * 6).tdop == pytest.approx(dilution(u).tdop, rel=ROUNDING)


def test_shapes_are_checked():
    with pytest.raises(InputError, match="shape"):
        dilution(ring(5, 0.2), used=[True, False])
