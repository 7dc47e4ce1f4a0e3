"""Way-points, manoeuvres and polynomials: consistent motions that do what was asked."""

import numpy as np
import pytest

from schuler import frames, rotation
from schuler.exceptions import InputError
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion, Ramps, blend, polynomial_motion
from schuler.simulation.waypoints import Waypoint, WaypointMotion

ORIGIN = np.array([np.radians(48.0), np.radians(11.0), 500.0])


def place(north, east, height=500.0):
    llh = frames.llh_from_ecef(frames.ecef_from_ned([north, east, 0.0], ORIGIN))
    return np.array([llh[0], llh[1], height])


def route(**options):
    points = [
        Waypoint(llh=place(0, 0), speed=10.0, stop=20.0),
        Waypoint(llh=place(200, 10), speed=12.0),
        Waypoint(llh=place(300, 120), speed=8.0),
        Waypoint(llh=place(250, 400, 505.0), speed=14.0, stop=5.0),
        Waypoint(llh=place(0, 500), speed=14.0),
        Waypoint(llh=place(-200, 300), speed=10.0, stop=3.0),
    ]
    return points, WaypointMotion.through(points, **options)


def manoeuvres():
    return ManoeuvreMotion.of(
        [
            Manoeuvre(duration=10.0),
            Manoeuvre(duration=20.0, speed=60.0),
            Manoeuvre(duration=20.0, climb=5.0),
            Manoeuvre(duration=30.0, turn=2.0),
            Manoeuvre(duration=30.0, turn=-1.5, speed=50.0, climb=0.0),
        ],
        ORIGIN,
        heading=0.3,
    )


@pytest.mark.parametrize("motion", [lambda: route()[1], lambda: route(bank=1.0)[1], manoeuvres])
def test_derivatives_belong_to_each_other(motion):
    """r' = v, v' = a, C' = C [omega x], by central differences anywhere in the motion."""
    m = motion()
    t, h = np.linspace(0.5, m.duration - 0.5, 1500), 1e-3
    s, p, q = m.state(t), m.state(t + h), m.state(t - h)
    # rounding of positions (1e-9 m) over 2 h, and h^2 of the difference
    np.testing.assert_allclose((p.r_eb_e - q.r_eb_e) / (2 * h), s.v_eb_e, atol=2e-5)
    np.testing.assert_allclose((p.v_eb_e - q.v_eb_e) / (2 * h), s.a_eb_e, atol=2e-4)
    np.testing.assert_allclose((p.C_eb - q.C_eb) / (2 * h), s.C_eb @ rotation.skew(s.omega_eb_b), atol=1e-5)


def test_a_vehicle_on_a_route_moves_along_its_nose():
    _, m = route()
    s = m.state(np.linspace(0.0, m.duration, 3000))
    v_b = np.einsum("nji,nj->ni", s.C_eb, s.v_eb_e)
    np.testing.assert_allclose(v_b[:, 1:], 0.0, atol=1e-12)  # rounding
    np.testing.assert_allclose(s.rpy_nb[:, 0], 0.0, atol=1e-12)


def test_a_route_passes_its_points_at_their_speeds_and_stops():
    points, m = route()
    t = np.linspace(0.0, m.duration, 40_001)
    s = m.state(t)
    speed = np.linalg.norm(s.v_eb_e, axis=1)
    for p in points:
        distance = np.linalg.norm(s.r_eb_e - frames.ecef_from_llh(p.llh), axis=1)
        assert distance.min() < 0.1
        near = int(np.argmin(distance))
        wanted = 0.0 if p.stop else p.speed
        assert speed[near] == pytest.approx(wanted, abs=0.05)
    at_rest = np.sum(speed < 1e-9) * (t[1] - t[0])
    assert at_rest == pytest.approx(28.0, abs=0.5)
    assert speed.max() < 14.01
    along = np.abs(np.gradient(speed, t))
    assert along.max() < 1.5 * 1.001


def test_banked_turns_are_coordinated():
    """bank = 1: no lateral specific force to first order in a level turn."""
    _, m = route(bank=1.0)
    from schuler.simulation.motion import inertial_quantities

    s = m.state(np.linspace(30.0, m.duration - 10.0, 2000))
    _, f = inertial_quantities(s)
    _, flat = inertial_quantities(route()[1].state(s.t))
    assert np.abs(f[:, 1]).max() < 0.15 * np.abs(flat[:, 1]).max()


def test_manoeuvres_end_where_commanded():
    m = manoeuvres()
    s = m.state(np.array([0.0, 30.0, 50.0, 110.0]))
    v = s.v_eb_n
    assert np.hypot(*v[1, :2]) == pytest.approx(60.0, abs=1e-5)
    assert v[2, 2] == pytest.approx(-5.0, abs=1e-6)
    assert np.arctan2(v[3, 1], v[3, 0]) == pytest.approx(0.8, abs=1e-6)
    assert np.hypot(*v[3, :2]) == pytest.approx(50.0, abs=1e-5)
    assert s.llh[2, 2] == pytest.approx(500.0 + 50.0, abs=1e-5)  # mean climb 2.5 m/s for 20 s


def test_ramps_integrate_themselves():
    r = Ramps.through([2.0, 3.0, 1.0], [0.0, 4.0, 4.0, -1.0])
    t = np.linspace(0.0, 6.0, 60_001)
    integral, value, first, second = r.at(t)
    np.testing.assert_allclose(np.gradient(integral, t)[1:-1], value[1:-1], atol=1e-6)
    np.testing.assert_allclose(np.gradient(value, t)[1:-1], first[1:-1], atol=1e-4)
    np.testing.assert_allclose(np.gradient(first, t)[1:-1], second[1:-1], atol=2e-2)
    np.testing.assert_allclose(value[[0, 20_000, 50_000, 60_000]], [0.0, 4.0, 4.0, -1.0], atol=1e-12)


def test_blend_is_a_smooth_step():
    i, b, d, dd = blend(np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(b, [0.0, 0.5, 1.0])
    np.testing.assert_allclose(i[[0, 2]], [0.0, 0.5])
    np.testing.assert_allclose(d, [0.0, 1.875, 0.0])
    np.testing.assert_allclose(dd, 0.0, atol=1e-15)


def test_gendata_follows_its_closed_form():
    """Stefanisko's example: x = 5 u, y = 12 u - 6 u^2, z = 6 - 2 u, theta = pi/4 u, with u = t / step."""
    A, B, step = [[0, 0, 6], [5, 6, 4], [10, 0, 2]], [[0, 0, 0], [0, np.pi / 4, 0], [0, np.pi / 2, 0]], 5.0
    m = polynomial_motion(A, step, B, step, ORIGIN)
    t = np.linspace(0.0, 9.9, 50)
    u = t / step
    r, v, a = m.path(t)
    np.testing.assert_allclose(r, np.stack((5 * u, 12 * u - 6 * u**2, 6 - 2 * u), -1), atol=1e-12)
    np.testing.assert_allclose(v, np.stack((5 + 0 * u, 12 - 12 * u, -2 + 0 * u), -1) / step, atol=1e-12)
    np.testing.assert_allclose(a, np.tile([0.0, -12.0 / step**2, 0.0], (50, 1)), atol=1e-12)
    C, omega = m.attitude(t)
    np.testing.assert_allclose(rotation.rpy_from_dcm(C)[:, 1], np.pi / 4 * u, atol=1e-9)
    np.testing.assert_allclose(omega, np.tile([0.0, np.pi / 4 / step, 0.0], (50, 1)), atol=1e-12)


def test_rotation_does_not_move_the_end_point():
    """The source's figure 4.5 shows otherwise; accelerations are not body components here."""
    from schuler.mechanization.strapdown import NavState, mechanize
    from schuler.recording.series import Increments
    from schuler.simulation.motion import ideal_increments

    A = [[0, 0, 6], [5, 6, 4], [10, 0, 2]]
    ends = []
    for B in ([[0, 0, 0], [0, 0, 0]], [[0, 0, 0], [0.5, np.pi / 4, 1.0]]):
        m = polynomial_motion(A, 5.0, B, 10.0, ORIGIN)
        t = np.arange(2001) * 0.005
        s = m.state(np.zeros(1))
        inc = Increments(t[1:], np.diff(t), *ideal_increments(m, t, earth_rotation=False))
        path = mechanize(inc, NavState(0.0, s.r_eb_e[0], s.v_eb_e[0], s.q_eb[0]), earth_rotation=False)
        ends.append(frames.ned_from_ecef(path.r_eb_e[-1], ORIGIN))
    np.testing.assert_allclose(ends[0], [10.0, 0.0, 2.0], atol=1e-6)
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Waypoint(llh=place(0, 0), speed=0.0), "positive speed"),
        (lambda: WaypointMotion.through([Waypoint(llh=place(0, 0), speed=1.0)]), "at least two way-points, got 1"),
        (
            lambda: WaypointMotion.through(
                [Waypoint(llh=place(0, 0), speed=1.0), Waypoint(llh=place(0, 0.01), speed=1.0)]
            ),
            "way-points 0 and 1 are 0.010 m apart; to pause, use stop",
        ),
        (
            lambda: WaypointMotion.through(
                [Waypoint(llh=place(0, 0), speed=30.0), Waypoint(llh=place(20, 0), speed=1.0, stop=2.0)]
            ),
            r"leg from way-point 0 to 1 is 20\.0 m long, too short to change from 30\.0 to 0\.0 m/s",
        ),
        (lambda: Manoeuvre(duration=0.0), "positive duration"),
        (lambda: ManoeuvreMotion.of([], ORIGIN), "at least one manoeuvre"),
        (lambda: polynomial_motion([[0, 0, 0]], 1.0, [[0, 0, 0]], 1.0, ORIGIN), "at least two knots"),
    ],
)
def test_impossible_motions_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
