"""GLONASS states: closed forms, order of the rule, reversibility, conserved quantities, neighbouring messages."""

import itertools

import numpy as np
import pytest

from schuler.gnss import orbits
from schuler.gnss.ephemerides import GlonassRecords
from schuler.gnss.orbits import GM, J2, OMEGA, RADIUS, glonass_states, runge_kutta

A = 25_508e3


def records(r_e, v_e, a_e=None, toe=0.0):
    r_e = np.atleast_2d(r_e)
    n = len(r_e)
    zero = np.zeros(n)
    return GlonassRecords(
        sat=100 + np.arange(1, n + 1), toe=zero + toe, sent=zero + np.nan, r_e=r_e, v_e=np.atleast_2d(v_e),
        a_e=np.zeros((n, 3)) if a_e is None else np.atleast_2d(a_e), clock=zero, rate=zero, channel=zero, health=zero,
    )  # fmt: skip


def typical():
    """An orbit at 64.8 deg inclination, Earth-fixed."""
    i, u = 1.131, 0.7
    n = np.sqrt(GM / A**3)
    r = A * np.array([np.cos(u), np.sin(u) * np.cos(i), np.sin(u) * np.sin(i)])
    v = A * n * np.array([-np.sin(u), np.cos(u) * np.cos(i), np.cos(u) * np.sin(i)])
    return r, v - np.cross([0.0, 0.0, OMEGA], r)


def test_a_circular_orbit_in_the_equator():
    """With J2 the rate is ``sqrt(GM/a^3 (1 + 1.5 J2 (R/a)^2))``, and the orbit stays a circle."""
    n = np.sqrt(GM / A**3 * (1.0 + 1.5 * J2 * (RADIUS / A) ** 2))
    g = records([A, 0.0, 0.0], [0.0, A * (n - OMEGA), 0.0])
    t = np.array([-1800.0, -900.0, -17.0, 0.0, 400.0, 1800.0])
    r, v = glonass_states(g, np.zeros(6, dtype=int), t)
    angle = (n - OMEGA) * t
    expected = A * np.stack((np.cos(angle), np.sin(angle), 0.0 * t), axis=-1)
    # discretisation: 30 steps of (n h)^5 / 120 A = 3 mm, partly cancelling
    assert np.allclose(r, expected, rtol=0.0, atol=1e-3)
    assert np.allclose(np.linalg.norm(v, axis=1), A * (n - OMEGA), rtol=0.0, atol=1e-7)


def test_the_energy_in_turning_axes_is_kept():
    """Jacobi's integral ``v^2/2 - omega^2 (x^2+y^2)/2 - U`` with U of the flattened Earth."""
    r0, v0 = typical()
    r, v = glonass_states(records(r0, v0), np.zeros(2, dtype=int), np.array([0.0, 1800.0]))
    d = np.linalg.norm(r, axis=1)
    U = GM / d * (1.0 - J2 * (RADIUS / d) ** 2 * (1.5 * (r[:, 2] / d) ** 2 - 0.5))
    energy = 0.5 * np.sum(v * v, axis=1) - 0.5 * OMEGA**2 * (r[:, 0] ** 2 + r[:, 1] ** 2) - U
    assert abs(energy[1] / energy[0] - 1.0) < 1e-10  # discretisation


def test_the_rule_is_of_fourth_order():
    r0, v0 = (x[None] for x in typical())
    a = np.zeros((1, 3))

    def after(steps):
        r, v = r0, v0
        for _ in range(steps):
            r, v = runge_kutta(r, v, a, np.array([1800.0 / steps]))
        return r

    exact = after(960)
    errors = [np.linalg.norm(after(n) - exact) for n in (6, 12, 24)]
    assert np.allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 4.0, atol=0.3)
    assert np.linalg.norm(after(30) - exact) < 2e-3  # the step used, over the longest time


def test_there_and_back_and_on_from_a_node():
    """The answer does not depend on which other times are asked for, and a new message made of it leads back."""
    r0, v0 = typical()
    g = records(r0, v0, [1e-6, -2e-6, 1e-6])
    t = np.array([1000.0, -1700.0, 29.0, 31.0])
    together = glonass_states(g, np.zeros(4, dtype=int), t)
    for i in range(4):
        alone = glonass_states(g, np.zeros(1, dtype=int), t[i : i + 1])
        assert np.array_equal(alone[0][0], together[0][i])
    back = glonass_states(records(together[0], together[1], [[1e-6, -2e-6, 1e-6]] * 4), np.arange(4), -t)
    assert np.allclose(back[0], r0, rtol=0.0, atol=4e-3)  # discretisation
    assert np.allclose(together[0][2] + 2.0 * together[1][2], together[0][3], rtol=0.0, atol=3.0)


def test_velocity_is_the_derivative_across_nodes():
    r0, v0 = typical()
    g = records(r0, v0, [1e-6, -2e-6, 1e-6], toe=1e9)
    h = 0.5
    for middle in (29.9, 5.0, -645.0):
        t = middle + h * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
        r, v = glonass_states(g, np.zeros(5, dtype=int), t, epoch_gps_s=1e9)
        weights = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / (12.0 * h)
        # discretisation: where the node changes, two paths meet 0.02 mm apart
        assert np.allclose(weights @ r, v[2], rtol=0.0, atol=5e-5 if abs(middle) < 60.0 else 1e-7)


def test_the_moon_and_sun_pull_as_broadcast():
    r0, v0 = typical()
    a = np.array([2e-6, 1e-6, -3e-6])
    with_, without = (
        glonass_states(records(r0, v0, a_e), np.zeros(1, dtype=int), np.array([60.0]))[0][0] for a_e in (a, 0.0 * a)
    )
    assert np.allclose(with_ - without, 0.5 * a * 60.0**2, rtol=0.0, atol=1e-4)  # the Earth turns meanwhile: 1 %


def test_no_state_at_no_time():
    """Precise clocks of a file without GLONASS leave its times of transmission open."""
    r, v = glonass_states(records(*typical()), np.zeros(2, dtype=int), np.array([np.nan, 60.0]))
    assert np.isnan(r[0]).all()
    assert np.isnan(v[0]).all()
    assert np.isfinite(r[1]).all()


def test_nothing_asked_nothing_answered():
    r, v = glonass_states(records(*typical()), np.zeros(0, dtype=int), np.zeros(0))
    assert r.shape == v.shape == (0, 3)


@pytest.mark.realdata
def test_neighbouring_messages_agree(shared_data):
    """Broadcast states are good to some metres; 15 minutes from either side they meet within two."""
    from schuler.recording.formats.rinex_navigation import read_rinex_navigation

    g = read_rinex_navigation(shared_data / "gnss_nav_files" / "BRDC00WRD_S_20230730000_01D_MN.rnx").glonass
    compared = 0
    for one in np.unique(g.sat):
        rows = np.flatnonzero(g.sat == one)
        rows = rows[np.argsort(g.toe[rows])]
        for a, b in itertools.pairwise(rows):
            middle = 0.5 * (g.toe[a] + g.toe[b])
            r, v = glonass_states(g, np.array([a, b]), np.array([middle, middle]))
            assert np.linalg.norm(r[0] - r[1]) < 2.0  # seen 0.5 to 1.1
            assert np.linalg.norm(v[0] - v[1]) < 3e-3
            across = glonass_states(g, np.array([a]), g.toe[b : b + 1])[0][0]
            assert np.linalg.norm(across - g.r_e[b]) < 3.0  # seen 1.5
            compared += 1
    assert compared == 4


def test_the_stated_constants():
    assert (orbits.STEP_S, orbits.RADIUS) == (60.0, 6_378_136.0)
