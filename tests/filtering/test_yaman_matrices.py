"""Yaman's 39 states: the engine's layout and matrices against those printed in the thesis, corrections applied.

The thesis: position (latitude, longitude, height), velocity, attitude, then b_a, b_g, S_a, M_a, S_g, M_g, G_g. Errors
of navigation are indicated minus true, those of sensors are what is in the readings: estimate minus truth is the same
for navigation and minus that for sensors.
"""

from __future__ import annotations

import numpy as np
import pytest

from schuler import earth, rotation
from schuler.filtering.error_model import noise_density, system_matrix_ned
from schuler.filtering.states import BLOCKS, StateLayout, StateModel

SENSORS = ("b_a", "b_g", "S_a", "M_a", "S_g", "M_g", "G_g")
WALKS = {"b_a": 1e-4, "b_g": 2e-6, "S_a": 3e-6, "S_g": 4e-6}  # the rest are constants
LAYOUT = StateLayout(
    {name: StateModel.random_walk(1.0, WALKS[name]) if name in WALKS else StateModel.constant(1.0) for name in SENSORS}
)
#: Ours are dpsi, dv, dr.
ORDER = np.array([6, 7, 8, 3, 4, 5, 0, 1, 2, *range(9, 39)])
SIGN = np.concatenate((np.ones(9), -np.ones(30)))


def state(seed):
    rng = np.random.default_rng(seed)
    llh = np.array([rng.uniform(-1.2, 1.2), rng.uniform(-3, 3), rng.uniform(-300, 9000)])
    v = rng.uniform(-120, 120, 3) * [1, 1, 0.1]
    C = rotation.dcm_from_rpy(rng.uniform(-1, 1, 3) * [3.0, 1.4, 3.0])
    return llh, v, C, rng.normal(size=3), rng.normal(size=3) * 5 + [0, 0, -9.8]


def cross(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def printed_matrix(llh, v, C, w, f):
    """F of Yaman (2017), (2-105) to (2-110), (4-7), corrections 4 to 8 of the register. Shape (39, 39)."""
    L, _, h = llh
    s, c, t = np.sin(L), np.cos(L), np.tan(L)
    e2, Om = 0.08181919084262**2, 7.292115e-5
    RN = 6378137.0 * (1 - e2) / (1 - e2 * s * s) ** 1.5
    RE = 6378137.0 / np.sqrt(1 - e2 * s * s)
    rS = RE * np.sqrt(c * c + (1 - e2) ** 2 * s * s)
    g0 = 9.7803253359 * (1 + 0.001931853 * s * s) / np.sqrt(1 - e2 * s * s)
    rn, re = RN + h, RE + h
    vN, vE, vD = v
    wni = Om * np.array([c, 0, -s]) + np.array([vE / re, -vN / rn, -vE * t / re])
    F = np.zeros((39, 39))
    F[0:3, 0:3] = [[0, 0, -vN / rn**2], [vE * s / (re * c * c), 0, -vE / (re * re * c)], [0, 0, 0]]
    F[0:3, 3:6] = np.diag([1 / rn, 1 / (re * c), -1])
    F[3:6, 0:3] = [
        [-(vE**2) / (re * c * c) - 2 * vE * Om * c, 0, vE**2 * t / re**2 - vN * vD / rn**2],
        [vN * vE / (re * c * c) + 2 * vN * Om * c - 2 * vD * Om * s, 0, -(vN * vE * t + vE * vD) / re**2],
        [2 * vE * Om * s, 0, vE**2 / re**2 + vN**2 / rn**2 - 2 * g0 / rS],
    ]
    F[3:6, 3:6] = [
        [vD / rn, -2 * vE * t / re - 2 * Om * s, vN / rn],
        [vE * t / re + 2 * Om * s, (vN * t + vD) / re, vE / re + 2 * Om * c],
        [-2 * vN / rn, -2 * vE / re - 2 * Om * c, 0],
    ]
    F[3:6, 6:9] = -cross(C @ f)
    F[6:9, 0:3] = [[Om * s, 0, vE / re**2], [0, 0, -vN / rn**2], [Om * c + vE / (re * c * c), 0, -vE * t / re**2]]
    F[6:9, 3:6] = [[0, -1 / re, 0], [1 / rn, 0, 0], [0, t / re, 0]]
    F[6:9, 6:9] = -cross(wni)
    A2 = np.array([[f[1], f[2], 0], [0, 0, f[2]], [0, 0, 0]])
    G2 = np.array([[w[1], w[2], 0, 0, 0, 0], [0, 0, w[0], w[2], 0, 0], [0, 0, 0, 0, w[0], w[1]]])
    G3 = np.kron(np.eye(3), f)
    F[3:6, 9:12], F[3:6, 15:18], F[3:6, 18:21] = C, C @ np.diag(f), C @ A2
    F[6:9, 12:15], F[6:9, 21:24], F[6:9, 24:30], F[6:9, 30:39] = C, C @ np.diag(w), C @ G2, C @ G3
    return F


def ours(llh, v, C, w, f):
    """The engine's matrix in the order, units and signs of the thesis."""
    F = system_matrix_ned(LAYOUT, C, v, llh, w, f, position="radians")
    return SIGN[:, None] * F[np.ix_(ORDER, ORDER)] * SIGN


def test_there_are_39_states_in_the_order_of_the_thesis():
    assert LAYOUT.size == 39
    assert LAYOUT.blocks[3:] == list(SENSORS)
    start = {"b_a": 9, "b_g": 12, "S_a": 15, "M_a": 18, "S_g": 21, "M_g": 24, "G_g": 30}
    assert {name: LAYOUT[name].start for name in SENSORS} == start  # counted from 1: 10, 13, 16, 19, 22, 25, 31
    assert [(r[1], r[2] - 1) for r in BLOCKS["M_a"]] == [(0, 1), (0, 2), (1, 2)]
    assert [(r[1], r[2] - 4) for r in BLOCKS["M_g"]] == [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)]
    assert [(r[1], r[2] - 1) for r in BLOCKS["G_g"]] == [(i, j) for i in range(3) for j in range(3)]


@pytest.mark.parametrize("seed", range(6))
def test_sensor_columns_are_the_printed_ones(seed):
    """b_a: C, S_a: C A*, M_a: C A**; b_g: C, S_g: C G*, M_g: C G**, G_g: C G***. Tolerance: rounding."""
    at = state(seed)
    np.testing.assert_allclose(ours(*at)[:, 9:], printed_matrix(*at)[:, 9:], rtol=0, atol=1e-13)


def gravity_columns(llh):
    """Derivatives of gravity (north, east, down) with latitude and height, as the engine takes them. Shapes (3,)."""
    L, _, h = llh
    g = earth.gravity_ned
    return (g(L + 1e-4, h) - g(L - 1e-4, h)) / 2e-4, (g(L, h + 10.0) - g(L, h - 10.0)) / 20.0


def apart_from_gravity(at):
    """Ours and the printed one without the change of gravity, for which the thesis has another formula."""
    F, printed = ours(*at), printed_matrix(*at)
    L, _, _ = at[0]
    with_latitude, with_height = gravity_columns(at[0])
    F[3:6, 0] -= with_latitude  # dropped in the thesis
    F[3:6, 2] -= with_height
    s2, e2 = np.sin(L) ** 2, earth.WGS84.e2
    r_S = earth.radii_of_curvature(L)[1] * np.sqrt(1 - s2 + (1 - e2) ** 2 * s2)
    printed[5, 2] += 2.0 * 9.7803253359 * (1 + 0.001931853 * s2) / np.sqrt(1 - e2 * s2) / r_S
    return F, printed


@pytest.mark.parametrize("seed", range(6))
def test_navigation_columns_are_the_printed_ones(seed):
    """To rounding, but where the thesis drops the change of the radii with latitude, which is kept here."""
    at = state(seed)
    llh, v = at[:2]
    F, printed = apart_from_gravity(at)
    np.testing.assert_allclose(F[:, 3:9], printed[:, 3:9], rtol=1e-12, atol=1e-18)  # velocity and attitude
    np.testing.assert_array_equal(F[:, 1], 0.0)
    # height column: gravity of two formulas differed by 3e-6 1/s^2, what is left are its 16 digits
    np.testing.assert_allclose(F[:, 2], printed[:, 2], rtol=1e-9, atol=1e-18)
    # latitude column: (dR/dL)/R, 3 e2 s c of 1 at most, of each rate
    rest, turning = np.abs(F[:, 0] - printed[:, 0]), 0.011 * np.linalg.norm(v) / 6.3e6 / np.cos(llh[0])
    assert rest[:3].max() < turning
    assert rest[3:6].max() < turning * np.linalg.norm(v)
    assert rest[6:9].max() < turning
    assert not rest[9:].any()


@pytest.mark.parametrize("seed", range(6))
def test_gravity_is_more_accurate_than_in_the_source(seed):
    """3.086e-6 1/s^2 a metre in place of 2 g0/rS = 3.078e-6; the thesis drops 0.051 m/s^2 a radian and 7.9e-9 1/s^2."""
    llh = state(seed)[0]
    with_latitude, with_height = gravity_columns(llh)
    assert with_height[2] == pytest.approx(-3.086e-6, abs=1.6e-8)  # less at 9 km, and with latitude
    assert abs(with_latitude[2]) < 0.053
    assert abs(with_height[0]) < 8.2e-9
    F, printed = ours(*state(seed)), printed_matrix(*state(seed))
    assert abs(F[5, 2] - printed[5, 2]) < 2e-8


@pytest.mark.parametrize("place", [(3, 2), (5, 0), (4, 5), (6, 2)])
def test_the_elements_as_printed_would_be_seen(place):
    """FIX 4: vN vD over (RE + h)^2; 5: -2 vE Om sin L; 6: -vE/(RE + h) - 2 Om cos L; 7: RN for RE."""
    at = state(2)
    (L, _, h), v = at[:2]
    R_N, R_E = earth.radii_of_curvature(L)
    rn, re, Om = R_N + h, R_E + h, earth.WGS84.omega_ie
    uncorrected = {
        (3, 2): v[1] ** 2 * np.tan(L) / re**2 - v[0] * v[2] / re**2,
        (5, 0): -2.0 * v[1] * Om * np.sin(L),
        (4, 5): -v[1] / re - 2.0 * Om * np.cos(L),
        (6, 2): v[1] / rn**2,
    }[place]
    F, printed = apart_from_gravity(at)
    assert abs(uncorrected - F[place]) > 10.0 * abs(printed[place] - F[place])
    assert abs(uncorrected / F[place] - 1.0) > 1e-4


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_the_printed_one(seed):
    """G Qc G' with G of the table in 3.7: C for both triads, 1 for the walks, nothing for constants."""
    *_, C, _, _ = state(seed)
    G = np.zeros((39, 18))
    G[3:6, 0:3], G[6:9, 3:6] = C, C
    for i, block in enumerate(("b_a", "b_g", "S_a", "S_g")):
        G[LAYOUT[block], 6 + 3 * i : 9 + 3 * i] = np.eye(3)
    vrw, arw = 0.0083, 1.4544e-4
    Qc = np.diag(np.repeat([vrw**2, arw**2, *(WALKS[b] ** 2 for b in ("b_a", "b_g", "S_a", "S_g"))], 3))
    Q = noise_density(LAYOUT, C, np.full(3, arw**2), np.full(3, vrw**2))[np.ix_(ORDER, ORDER)]
    np.testing.assert_allclose(Q, G @ Qc @ G.T, atol=1e-18)
