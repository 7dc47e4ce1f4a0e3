"""Positions and axes: exact cases, round trips from underground to orbit; PROJ, pymap3d and SOFA as authorities."""

import erfa
import numpy as np
import pymap3d
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pyproj import Transformer

from schuler import earth, frames, rotation
from schuler.earth import GRS80, WGS84

EPS = np.finfo(float).eps
PI = np.pi
A, B = 6378137.0, 6356752.314245179  # WGS 84 [m]
BATCHES = [(), (1,), (3, 1, 2)]
LAW = settings(max_examples=200, deadline=None, derandomize=True, database=None)


def random_llh(rng, shape=(), low=-100e3, high=1000e3):
    """Anywhere on the globe, uniform per area, heights in metres."""
    lat = np.arcsin(rng.uniform(-1.0, 1.0, shape))
    return np.stack((lat, rng.uniform(-PI, PI, shape), rng.uniform(low, high, shape)), axis=-1)


def transpose(C):
    return np.swapaxes(C, -1, -2)


def assert_same_place(llh, expected, metres=6e-9):
    """Compare in metres, longitude as an arc and modulo a turn. 6e-9: rounding of 7e6 m, there and back."""
    llh, expected = np.asarray(llh), np.asarray(expected)
    north = (llh[..., 0] - expected[..., 0]) * A
    turn = llh[..., 1] - expected[..., 1]
    east = np.arctan2(np.sin(turn), np.cos(turn)) * np.cos(expected[..., 0]) * A
    up = llh[..., 2] - expected[..., 2]
    worst = max(np.abs(x).max() for x in (north, east, up))
    assert worst <= metres, worst


# ----------------------------------------------------------------------------------------- exact cases

EXACT = [
    ("null island", (0.0, 0.0, 0.0), (A, 0.0, 0.0)),
    ("equator, 90 deg east", (0.0, PI / 2, 0.0), (0.0, A, 0.0)),
    ("equator, 90 deg west", (0.0, -PI / 2, 0.0), (0.0, -A, 0.0)),
    ("antimeridian", (0.0, PI, 0.0), (-A, 0.0, 0.0)),
    ("north pole", (PI / 2, 0.0, 0.0), (0.0, 0.0, B)),
    ("south pole", (-PI / 2, 0.0, 0.0), (0.0, 0.0, -B)),
    ("100 km above the equator", (0.0, 0.0, 100e3), (A + 100e3, 0.0, 0.0)),
    ("100 km below the equator", (0.0, PI / 2, -100e3), (0.0, A - 100e3, 0.0)),
    ("100 km above the antimeridian", (0.0, PI, 100e3), (-A - 100e3, 0.0, 0.0)),
    ("100 km above the north pole", (PI / 2, 0.0, 100e3), (0.0, 0.0, B + 100e3)),
    ("100 km below the north pole", (PI / 2, 0.0, -100e3), (0.0, 0.0, B - 100e3)),
    ("100 km above the south pole", (-PI / 2, 0.0, 100e3), (0.0, 0.0, -B - 100e3)),
    ("100 km below the south pole", (-PI / 2, 0.0, -100e3), (0.0, 0.0, -B + 100e3)),
]


@pytest.mark.parametrize(("llh", "r"), [case[1:] for case in EXACT], ids=[case[0] for case in EXACT])
def test_exact_positions(llh, r):
    np.testing.assert_allclose(frames.ecef_from_llh(llh), r, rtol=0, atol=2e-9)  # rounding; sin(pi) is 1.2e-16
    back = frames.llh_from_ecef(r)
    np.testing.assert_allclose(back[:2], llh[:2], rtol=0, atol=4 * EPS)  # rounding
    assert back[2] == pytest.approx(llh[2], abs=2e-9)  # rounding


def test_a_position_at_45_degrees_by_hand():
    """``N = a / sqrt(1 - e^2 / 2)``; x = (N + h) cos L, z = ((1 - e^2) N + h) sin L."""
    N = 6378137.0 / np.sqrt(1.0 - 0.5 * 0.00669437999014132)
    half = np.sqrt(0.5)
    x, y, z = frames.ecef_from_llh([PI / 4, PI / 2, 1000.0])
    assert x == pytest.approx(0.0, abs=1e-9)
    assert y == pytest.approx((N + 1000.0) * half, abs=2e-9)  # rounding
    assert z == pytest.approx(((1.0 - 0.00669437999014132) * N + 1000.0) * half, abs=2e-9)  # rounding


def test_longitude_next_to_the_antimeridian_keeps_its_side():
    """A metre east of Greenwich's opposite is -180 deg and a bit, a metre west of it +180 deg less a bit."""
    east_side = frames.llh_from_ecef([-A, -1.0, 0.0])
    west_side = frames.llh_from_ecef([-A, 1.0, 0.0])
    assert east_side[1] == pytest.approx(-PI + 1.0 / A, abs=4 * EPS)  # rounding
    assert west_side[1] == pytest.approx(PI - 1.0 / A, abs=4 * EPS)  # rounding
    for lon in (PI, -PI):
        np.testing.assert_allclose(frames.ecef_from_llh([0.3, lon, 0.0])[1], 0.0, atol=1e-9)
        assert abs(frames.llh_from_ecef(frames.ecef_from_llh([0.3, lon, 0.0]))[1]) == PI


def test_the_antimeridian_itself_is_plus_pi_even_for_a_minus_zero():
    """Longitudes are in (-pi, pi]: the point y = -0.0 is the same point as y = 0.0."""
    assert frames.llh_from_ecef([-A, 0.0, 0.0])[1] == PI
    assert frames.llh_from_ecef([-A, -0.0, 0.0])[1] == PI


@pytest.mark.parametrize("z", [B, -B, B + 1e5])
@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.0, -0.0), (-0.0, 0.0), (-0.0, -0.0)])
def test_longitude_of_a_pole_is_zero_whatever_the_sign_of_a_zero(x, y, z):
    """Documented: at the poles the longitude 0 is returned."""
    lat, lon, _ = frames.llh_from_ecef([x, y, z])
    assert lat == np.copysign(PI / 2, z)
    assert lon == 0.0


# ----------------------------------------------------------------------------------------- round trips


@pytest.mark.parametrize("ellipsoid", [WGS84, GRS80], ids=lambda e: e.name)
@pytest.mark.parametrize("shape", [*BATCHES, (20_000,)])
def test_positions_survive_the_round_trip(shape, ellipsoid, rng):
    """-100 km to +1000 km everywhere."""
    llh = random_llh(rng, shape)
    r = frames.ecef_from_llh(llh, ellipsoid)
    assert r.shape == (*shape, 3)
    back = frames.llh_from_ecef(r, ellipsoid)
    assert_same_place(back, llh)
    np.testing.assert_allclose(frames.ecef_from_llh(back, ellipsoid), r, rtol=0, atol=8e-9)  # rounding, twice
    # documented: 1e-15 rad
    np.testing.assert_allclose(back[..., 0], llh[..., 0], rtol=0, atol=1e-15)


@pytest.mark.parametrize("h", [2e6, 20.2e6, 35.8e6, 4e8])
def test_positions_in_orbit_survive_the_round_trip(h, rng):
    """Up to geostationary satellites and the Moon; two of Bowring's steps are enough there too."""
    llh = random_llh(rng, (2000,), h, h)
    back = frames.llh_from_ecef(frames.ecef_from_llh(llh))
    np.testing.assert_allclose(back[:, :2], llh[:, :2], rtol=0, atol=4e-15)  # rounding
    np.testing.assert_allclose(back[:, 2], llh[:, 2], rtol=0, atol=8 * EPS * (A + h))  # rounding


LATITUDES = st.floats(-PI / 2, PI / 2)
LONGITUDES = st.floats(-PI, PI)


@LAW
@given(LATITUDES, LONGITUDES, st.floats(-100e3, 1000e3))
@example(PI / 2, 1.0, 0.0)
@example(-PI / 2, -3.0, 1e5)
@example(np.nextafter(PI / 2, 0), 2.0, 0.0)
@example(1e-300, PI, -1e5)
@example(-5e-324, -PI, 0.0)
@example(PI / 2 - 1e-9, 0.0, 0.0)
def test_any_position_survives_the_round_trip(lat, lon, h):
    back = frames.llh_from_ecef(frames.ecef_from_llh([lat, lon, h]))
    assert_same_place(back, [lat, lon, h])
    assert abs(back[0]) <= PI / 2
    assert abs(back[1]) <= PI


def test_height_is_measured_along_the_normal(rng):
    """Going up by a metre moves a metre against the down axis and changes neither latitude nor longitude."""
    llh = random_llh(rng, (200,))
    step = np.array([0.0, 0.0, 1000.0])
    moved = frames.ecef_from_llh(llh + step) - frames.ecef_from_llh(llh)
    np.testing.assert_allclose(moved, -1000.0 * frames.C_en(llh)[:, :, 2], rtol=0, atol=4e-9)  # rounding


# ----------------------------------------------------------------------------------------- authorities


def near_the_ground(rng):
    """Where the closed inverses of the other programs are still good: they lose digits with height, ours does not."""
    return random_llh(rng, (2000,), -5e3, 20e3)


def test_proj_agrees(rng):
    llh = random_llh(rng, (2000,))
    to_ecef = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    r = np.stack(to_ecef.transform(llh[:, 1], llh[:, 0], llh[:, 2], radians=True), axis=-1)
    np.testing.assert_allclose(frames.ecef_from_llh(llh), r, rtol=0, atol=4e-9)  # rounding
    r = frames.ecef_from_llh(near_the_ground(rng))
    lon, lat, h = to_ecef.transform(*r.T, radians=True, direction="INVERSE")
    # PROJ takes one of Bowring's steps: 4e-6 m at 20 km, 8 mm at 1000 km
    assert_same_place(frames.llh_from_ecef(r), np.stack((lat, lon, h), axis=-1), metres=1e-5)


def test_pymap3d_agrees(rng):
    llh = random_llh(rng, (2000,))
    theirs = np.stack(pymap3d.geodetic2ecef(*llh.T, deg=False), axis=-1)
    np.testing.assert_allclose(frames.ecef_from_llh(llh), theirs, rtol=0, atol=4e-9)  # rounding
    r = frames.ecef_from_llh(near_the_ground(rng))
    theirs = np.stack(pymap3d.ecef2geodetic(*r.T, deg=False), axis=-1)
    assert_same_place(frames.llh_from_ecef(r), theirs, metres=1e-8)  # rounding


@pytest.mark.parametrize(("number", "ellipsoid"), [(1, WGS84), (2, GRS80)], ids=["WGS 84", "GRS 80"])
def test_sofa_agrees(number, ellipsoid, rng):
    """gd2gc and gc2gd, which is good to some nanometres near the ground."""
    llh = random_llh(rng, (2000,))
    theirs = erfa.gd2gc(number, llh[:, 1], llh[:, 0], llh[:, 2])
    np.testing.assert_allclose(frames.ecef_from_llh(llh, ellipsoid), theirs, rtol=0, atol=4e-9)  # rounding
    r = frames.ecef_from_llh(near_the_ground(rng), ellipsoid)
    lon, lat, h = erfa.gc2gd(number, r)
    assert_same_place(frames.llh_from_ecef(r, ellipsoid), np.stack((lat, lon, h), axis=-1), metres=1e-8)  # rounding


def test_pymap3d_agrees_on_local_coordinates(rng):
    r, origins = frames.ecef_from_llh(random_llh(rng, (200,))), random_llh(rng, (200,))
    for r_e, origin in zip(r, origins, strict=True):
        theirs = pymap3d.ecef2ned(*r_e, *origin, deg=False)
        np.testing.assert_allclose(frames.ned_from_ecef(r_e, origin), theirs, rtol=0, atol=2e-8)  # rounding of 1.3e7 m
        theirs = pymap3d.ned2ecef(100.0, -200.0, 30.0, *origin, deg=False)
        np.testing.assert_allclose(frames.ecef_from_ned([100.0, -200.0, 30.0], origin), theirs, rtol=0, atol=1e-8)


# ------------------------------------------------------------------------------------------------ axes


@pytest.mark.parametrize("shape", BATCHES)
def test_navigation_axes_are_a_rotation(shape, rng):
    llh = random_llh(rng, shape)
    C = frames.C_en(llh)
    assert C.shape == (*shape, 3, 3)
    np.testing.assert_allclose(C @ transpose(C), np.broadcast_to(np.eye(3), C.shape), rtol=0, atol=4 * EPS)  # rounding
    np.testing.assert_allclose(np.linalg.det(C), 1.0, rtol=0, atol=4 * EPS)  # rounding
    np.testing.assert_array_equal(frames.C_en(llh[..., :2]), C)  # a height changes nothing


def test_navigation_axes_are_the_directions_of_growing_latitude_longitude_and_depth(rng):
    """Columns of ``C_en`` are the partial derivatives of position, divided by the radii."""
    for llh in random_llh(rng, (50,), 0.0, 1e5):
        R_N, R_E = earth.radii_of_curvature(llh[0])
        lengths = np.array([R_N + llh[2], (R_E + llh[2]) * np.cos(llh[0]), -1.0])
        for axis, step in zip(range(3), (1e-3, 1e-3, 100.0), strict=True):
            d = step * np.eye(3)[axis]
            f = frames.ecef_from_llh
            slope = (8.0 * (f(llh + d) - f(llh - d)) - (f(llh + 2 * d) - f(llh - 2 * d))) / (12.0 * step)
            # rounding of the position, 1e-9 m, over the step; discretisation: R step^4 / 30 = 2e-7
            np.testing.assert_allclose(
                frames.C_en(llh)[:, axis] * lengths[axis], slope, rtol=0, atol=5e-6 if axis < 2 else 2e-10
            )


@pytest.mark.parametrize(
    ("llh", "expected"),
    [
        ((0.0, 0.0, 0.0), [[0, 0, -1], [0, 1, 0], [1, 0, 0]]),
        ((0.0, PI / 2, 0.0), [[0, -1, 0], [0, 0, -1], [1, 0, 0]]),
        ((0.0, PI, 0.0), [[0, 0, 1], [0, -1, 0], [1, 0, 0]]),
        ((PI / 2, 0.0, 0.0), [[-1, 0, 0], [0, 1, 0], [0, 0, -1]]),
        ((-PI / 2, 0.0, 0.0), [[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    ],
)
def test_navigation_axes_by_hand(llh, expected):
    np.testing.assert_allclose(frames.C_en(llh), expected, rtol=0, atol=2 * EPS)  # rounding


def test_navigation_axes_as_printed_by_yaman(rng):
    """``C_n^e = R3(lam) R2(-(pi / 2 + L))`` with his active plane rotations, eq. (2-8)."""
    for lat, lon, _ in random_llh(rng, (50,)):
        R3 = rotation.dcm_from_rotvec([0.0, 0.0, lon])
        R2 = rotation.dcm_from_rotvec([0.0, -(0.5 * PI + lat), 0.0])
        np.testing.assert_allclose(frames.C_en([lat, lon]), R3 @ R2, rtol=0, atol=4 * EPS)  # rounding


@pytest.mark.parametrize("shape", [*BATCHES, (500,)])
def test_quaternion_of_the_navigation_axes(shape, rng):
    llh = random_llh(rng, shape)
    q = frames.q_en(llh)
    assert q.shape == (*shape, 4)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1.0, rtol=0, atol=4 * EPS)  # rounding
    np.testing.assert_allclose(rotation.dcm_from_quat(q), frames.C_en(llh), rtol=0, atol=8 * EPS)  # rounding
    np.testing.assert_array_equal(frames.q_en(llh[..., :2]), q)


@pytest.mark.parametrize("llh", [case[1] for case in EXACT], ids=[case[0] for case in EXACT])
def test_quaternion_of_the_navigation_axes_at_exact_positions(llh):
    np.testing.assert_allclose(rotation.dcm_from_quat(frames.q_en(llh)), frames.C_en(llh), rtol=0, atol=8 * EPS)


def test_the_axes_at_a_pole_point_where_the_given_longitude_says():
    """At the north pole "north" points away from the given meridian's side, "down" to the centre."""
    C = frames.C_en([PI / 2, 0.4])
    np.testing.assert_allclose(C[:, 0], [-np.cos(0.4), -np.sin(0.4), 0.0], rtol=0, atol=2 * EPS)
    np.testing.assert_allclose(C[:, 2], [0.0, 0.0, -1.0], rtol=0, atol=2 * EPS)


@pytest.mark.parametrize("shape", BATCHES)
def test_inertial_axes(shape, rng):
    t = rng.uniform(-1e5, 1e5, shape)
    C = frames.C_ie(t)
    assert C.shape == (*shape, 3, 3)
    np.testing.assert_allclose(C, rotation.dcm_from_rotvec(t[..., None] * [0, 0, 7.292115e-5]), rtol=0, atol=4 * EPS)


def test_inertial_axes_turn_with_the_earth():
    """Coincident at zero, x of the Earth on inertial y after a quarter of a day, ``dC_ie/dt = C_ie [omega_ie x]``."""
    np.testing.assert_array_equal(frames.C_ie(0.0), np.eye(3))
    day = 2.0 * PI / 7.292115e-5
    assert day == pytest.approx(86164.1, abs=0.05)
    np.testing.assert_allclose(
        frames.C_ie(day / 4) @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], rtol=0, atol=2 * EPS
    )  # rounding
    np.testing.assert_allclose(frames.C_ie(day), np.eye(3), rtol=0, atol=4 * EPS)  # rounding
    slope = (frames.C_ie(1001.0) - frames.C_ie(999.0)) / 2.0
    expected = frames.C_ie(1000.0) @ rotation.skew([0.0, 0.0, 7.292115e-5])
    np.testing.assert_allclose(slope, expected, rtol=0, atol=2e-13)  # discretisation, omega^3 / 6, and rounding


# ---------------------------------------------------------------------------------- local coordinates


@pytest.mark.parametrize("shape", BATCHES)
@pytest.mark.parametrize("many_origins", [False, True])
def test_local_coordinates_survive_the_round_trip(shape, many_origins, rng):
    origin = random_llh(rng, shape if many_origins else (), -1e3, 1e4)
    r_n = 1e4 * rng.standard_normal((*shape, 3))
    r_e = frames.ecef_from_ned(r_n, origin)
    assert r_e.shape == (*shape, 3)
    np.testing.assert_allclose(frames.ned_from_ecef(r_e, origin), r_n, rtol=0, atol=4e-9)  # rounding of 6.4e6 m
    np.testing.assert_allclose(
        np.linalg.norm(r_e - frames.ecef_from_llh(origin), axis=-1), np.linalg.norm(r_n, axis=-1)
    )


def test_local_coordinates_by_hand(rng):
    origin = np.array([0.8, 0.2, 100.0])
    np.testing.assert_array_equal(frames.ned_from_ecef(frames.ecef_from_llh(origin), origin), [0.0, 0.0, 0.0])
    # a metre of depth, and 1e-6 rad of latitude and longitude
    np.testing.assert_allclose(
        frames.ned_from_ecef(frames.ecef_from_llh(origin - [0, 0, 1.0]), origin), [0, 0, 1.0], rtol=0, atol=4e-9
    )  # rounding
    R_N, R_E = earth.radii_of_curvature(origin[0])
    north = frames.ned_from_ecef(frames.ecef_from_llh(origin + np.array([1e-6, 0, 0])), origin)
    np.testing.assert_allclose(north, [1e-6 * (R_N + 100.0), 0.0, 0.0], rtol=0, atol=1e-5)  # curvature, (6.4 m)^2 / 2R
    east = frames.ned_from_ecef(frames.ecef_from_llh(origin + np.array([0, 1e-6, 0])), origin)
    np.testing.assert_allclose(east, [0.0, 1e-6 * (R_E + 100.0) * np.cos(0.8), 0.0], rtol=0, atol=1e-5)


# -------------------------------------------------------------------------------------------- wrapping


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(0.0, 0.0), (PI, PI), (-PI, PI), (3 * PI, PI), (-3 * PI, PI), (2 * PI, 0.0), (-2 * PI, 0.0), (1.0, 1.0),
     (-1.0, -1.0), (PI + 0.25, -PI + 0.25), (-PI - 0.25, PI - 0.25), (5.0, 5.0 - 2 * PI),
     (-5.0, 2 * PI - 5.0), (4 * PI + 0.5, 0.5)],
)  # fmt: skip
def test_wrapped_angles_by_hand(angle, expected):
    assert frames.wrap_angle(angle) == pytest.approx(expected, abs=8 * EPS)  # rounding


@LAW
@given(st.floats(-1e6, 1e6))
@example(PI)
@example(-PI)
@example(np.nextafter(PI, 4.0))
@example(np.nextafter(-PI, -4.0))
@example(np.nextafter(PI, 0.0))
@example(-1e-300)
def test_wrapping_keeps_the_angle_and_brings_it_within_half_a_turn(angle):
    wrapped = frames.wrap_angle(angle)
    assert -PI <= wrapped <= PI  # the double -pi is the one nearest to -pi + 3e-16, which is inside (-pi, pi]
    # rounding: the double 2 pi is known to 2.4e-16, times the turns taken off
    assert np.hypot(np.sin(wrapped) - np.sin(angle), np.cos(wrapped) - np.cos(angle)) <= 8 * EPS + abs(angle) * EPS
    assert abs(frames.wrap_angle(wrapped)) == pytest.approx(abs(wrapped), abs=4 * EPS)  # nothing left to do


def test_differences_of_headings_across_north_are_small():
    a, b = np.array([3.1, -3.1, 0.1]), np.array([-3.1, 3.1, -0.1])
    np.testing.assert_allclose(frames.wrap_angle(a - b), [6.2 - 2 * PI, 2 * PI - 6.2, 0.2], rtol=0, atol=8 * EPS)


def test_small_angles_are_wrapped_to_rounding():
    """Heading errors of nanoradians come through with 4e-16 rad, the rounding of pi."""
    small = np.array([1e-9, -1e-9, 1e-7])
    np.testing.assert_allclose(frames.wrap_angle(small), small, rtol=0, atol=4 * EPS)


# --------------------------------------------------------------------------------------------- stacks


@pytest.mark.parametrize("shape", [(2, 3), (4,)])
def test_stacks_are_loops(shape, rng):
    llh, origin, t = random_llh(rng, shape), random_llh(rng, shape), rng.uniform(-1e4, 1e4, shape)
    r = frames.ecef_from_llh(llh)
    cases = [
        (frames.ecef_from_llh, (llh,)),
        (frames.llh_from_ecef, (r,)),
        (frames.C_en, (llh,)),
        (frames.q_en, (llh,)),
        (frames.C_ie, (t,)),
        (frames.ned_from_ecef, (r, origin)),
        (frames.ecef_from_ned, (llh, origin)),
        (frames.wrap_angle, (t,)),
    ]
    for function, arguments in cases:
        kept = [a.copy() for a in arguments]
        stacked = function(*arguments)
        assert stacked.dtype == np.float64
        for index in np.ndindex(shape):
            one = function(*(a[index] for a in arguments))
            # rounding: SIMD and scalar sines of NumPy may differ in the last place
            np.testing.assert_allclose(
                stacked[index], one, rtol=8 * EPS, atol=8e-9 if np.max(np.abs(one)) > 10 else 4 * EPS
            )
        for a, b in zip(arguments, kept, strict=True):
            np.testing.assert_array_equal(a, b)


def test_empty_stacks():
    assert frames.llh_from_ecef(np.empty((0, 3))).shape == (0, 3)
    assert frames.ecef_from_llh(np.empty((0, 3))).shape == (0, 3)
    assert frames.C_en(np.empty((0, 3))).shape == (0, 3, 3)
