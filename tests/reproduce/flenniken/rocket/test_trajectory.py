"""Trajectory I: closed form against quadrature and an independent program's numbers; the same rocket on the rotating
Earth.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler.exceptions import InputError
from schuler.reproduce.flenniken.study.rocket import RocketProfile, rocket_motion, rocket_trajectory
from schuler.reproduce.flenniken.study.rocket.trajectory import attitude
from schuler.simulation.motion import ideal_increments, inertial_quantities
from schuler.units import DEG, G0


def test_burnout_and_impact_are_the_school_formulas():
    """Rounding."""
    T, a, c, s = rocket_trajectory(), 8.0 * G0, np.cos(55.0 * DEG), np.sin(55.0 * DEG)
    f = T.figures()
    v_up, h = 12.5 * (a * s - G0), 0.5 * 12.5**2 * (a * s - G0)
    assert_allclose(f["burnout_north"], 12.5 * a * c, rtol=1e-12)
    assert_allclose(f["burnout_up"], v_up, rtol=1e-12)
    assert_allclose(f["apex_height"], h + v_up**2 / (2.0 * G0), rtol=1e-9)
    assert_allclose(f["impact_time"], 12.5 + (v_up + np.sqrt(v_up**2 + 2.0 * G0 * h)) / G0, rtol=1e-12)
    assert_allclose(f["impact_up"], -np.sqrt(v_up**2 + 2.0 * G0 * h), rtol=1e-12)
    assert_allclose(T.r[-1, 1], 0.0, atol=1e-8)


def test_consistent_profile_has_the_figures_of_an_independent_program():
    """Three digits. Flenniken (2005), section 7.2, prints figures of which no single flight has all."""
    reference = {
        "burnout_north": 562.5, "burnout_up": 681.0, "apex_height": 27.9e3, "apex_time": 82.0, "apex_range": 42.6e3,
        "impact_time": 157.3, "impact_range": 84.97e3, "impact_up": -739.0, "impact_speed": 929.0,
    }  # fmt: skip
    figures = rocket_trajectory().figures()
    for name, value in reference.items():
        assert_allclose(figures[name], value, rtol=2e-3)


@pytest.mark.parametrize("turn_start", [4.0, 8.3, 12.5, 20.0])
def test_position_and_velocity_are_integrals_of_what_is_sensed(turn_start):
    """Also if the rocket turns while it burns; midpoint rule at 1 kHz (discretisation)."""
    T = rocket_trajectory(RocketProfile(turn_start=turn_start), rate_hz=1000.0)
    a = np.einsum("kij,kj->ki", attitude(T.pitch_middle), T.acceleration)
    v = np.cumsum(T.dt[:, None] * a, axis=0)
    assert_allclose(v, T.v[1:], atol=1e-5)
    r = np.cumsum(T.dt[:, None] * (T.v[:-1] + 0.5 * T.dt[:, None] * a), axis=0)
    assert_allclose(r, T.r[1:], atol=1e-3)
    assert_allclose(T.pitch[0] + np.cumsum(T.dt * T.rate[:, 2]), T.pitch[1:], atol=1e-9)
    assert_allclose(T.pitch[-1], -88.0 * DEG, rtol=1e-12)


def test_events_and_impact_are_on_the_grid():
    """At rates that do not divide them, and no step is longer than a sample; rounding."""
    for rate in (7.0, 100.0 / 3.0):
        T = rocket_trajectory(rate_hz=rate)
        for event in (12.5, 27.5, T.profile.impact_time):
            assert np.min(np.abs(T.t - event)) < 1e-9
        assert T.dt.min() > 0.0
        assert T.dt.max() < 1.0 / rate + 1e-9


def test_specific_force_is_zero_in_free_fall_and_the_source_senses_gravity():
    T = rocket_trajectory(rate_hz=10.0)
    falls = T.middle > 12.5
    assert not T.specific_force[falls].any()
    assert_allclose(np.linalg.norm(T.acceleration[falls], axis=1), G0, rtol=1e-12)
    assert T.acceleration[0, 0] < 8.0 * G0  # E24: a negative gravity component nose up ...
    assert T.acceleration[-1, 0] > 0.0  # ... positive on descent


@pytest.mark.parametrize(
    ("change", "message"),
    [({"thrust": 0.0}, "positive"), ({"thrust": 9.0}, "does not leave the ground"), ({"turn_start": -1.0}, "ignition"),
     ({"turn_start": 200.0}, "below ground")],
)  # fmt: skip
def test_impossible_flights_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        rocket_trajectory(RocketProfile(**change))


def test_refused_arguments():
    with pytest.raises(InputError, match="rate_hz"):
        rocket_trajectory(rate_hz=0.0)
    with pytest.raises(InputError, match="since ignition"):
        RocketProfile().at([-1.0])


@pytest.fixture(scope="module")
def motion():
    return rocket_motion()


def test_on_the_earth_only_thrust_is_sensed(motion):
    """Specific force 8 g along x while it burns, none after; interpolation between nodes (discretisation)."""
    t = np.linspace(0.0, motion.duration, 1001)
    _, f = inertial_quantities(motion.state(t))
    assert_allclose(f[:, 0], np.where(t < 12.5, 8.0 * G0, 0.0), atol=2e-6)
    assert_allclose(f[:, 1:], 0.0, atol=2e-6)
    dtheta, dv = ideal_increments(motion, np.arange(0.0, 30.0, 0.05))
    assert_allclose(dv.sum(axis=0), [8.0 * G0 * 12.5, 0.0, 0.0], atol=1e-4)
    assert_allclose(np.linalg.norm(dtheta.sum(axis=0)), 143.0 * DEG, rtol=2e-3)  # and the Earth's turn in 30 s


def test_velocity_and_acceleration_are_derivatives(motion):
    """Central differences over 2 ms (discretisation and rounding of 6e6 m)."""
    t, h = np.linspace(0.3, motion.duration - 0.3, 97), 1e-3
    later, now, before = motion.state(t + h), motion.state(t), motion.state(t - h)
    assert_allclose((later.r_eb_e - before.r_eb_e) / (2 * h), now.v_eb_e, atol=1e-5)
    assert_allclose((later.v_eb_e - before.v_eb_e) / (2 * h), now.a_eb_e, atol=1e-5)


def test_it_flies_about_as_on_the_flat_earth(motion):
    """Rotation, curvature and less gravity aloft lengthen it by about 1 %."""
    flat, end = rocket_trajectory(rate_hz=10.0), motion.state(np.array([motion.duration]))
    assert_allclose(motion.duration, flat.t[-1], rtol=0.02)
    start = motion.state(np.zeros(1))
    assert_allclose(np.linalg.norm(end.r_eb_e - start.r_eb_e), flat.r[-1, 0], rtol=0.02)
    assert_allclose(end.llh[0, 2], 0.0, atol=1e-6)
    assert_allclose(start.rpy_nb[0], [0.0, 55.0 * DEG, 0.0], atol=1e-9)


def test_heading_and_place_of_launch():
    """East from the equator: the impact lies east."""
    m = rocket_motion(origin_llh=(0.0, 1.0, 100.0), heading=0.5 * np.pi)
    end = m.state(np.array([m.duration])).llh[0]
    assert end[1] > 1.01
    assert abs(end[0]) < 1e-3
    assert_allclose(end[2], 100.0, atol=1e-6)


def test_a_rocket_that_stays_up_is_refused():
    with pytest.raises(InputError, match="hour"):
        rocket_motion(RocketProfile(thrust=40.0 * G0, burn_time=60.0, turn_start=60.0))
