"""The Earth model against printed constants, the exact field of a level ellipsoid, its own physics, and authorities.

Authorities: boule (normal gravity), pymap3d (radii), pyproj (arc lengths), and the numbers printed by
Yaman (2017), Stefanisko (2015), Hayal, Moritz (GRS 80) and NIMA TR 8350.2 (WGS 84).
"""

import boule
import numpy as np
import pymap3d.rcurve as rcurve
import pytest
from pyproj import Geod

from schuler import earth, frames, rotation
from schuler.earth import GRS80, WGS84

EPS = np.finfo(float).eps
MGAL = 1e-5  # boule's unit of gravity [m/s^2]
OMEGA_E = np.array([0.0, 0.0, 7.292115e-5])
BATCHES = [(), (1,), (3, 1, 2)]
BOTH = pytest.mark.parametrize("ellipsoid", [WGS84, GRS80], ids=lambda e: e.name)


def radians(*degrees):
    return np.asarray(degrees, dtype=float) * (np.pi / 180.0)


def random_positions(rng, shape=(), low=-5e3, high=1e6):
    """Anywhere on the globe, uniform per area, heights in metres."""
    lat = np.arcsin(rng.uniform(-1.0, 1.0, shape))
    return np.stack((lat, rng.uniform(-np.pi, np.pi, shape), rng.uniform(low, high, shape)), axis=-1)


# --------------------------------------------------------------------------------------------- constants


def test_wgs84_constants_to_their_printed_digits():
    """NIMA TR 8350.2, tables 3.1, 3.3 and 3.4."""
    assert WGS84.a == 6378137.0
    assert 1.0 / WGS84.f == pytest.approx(298.257223563, rel=4 * EPS)
    assert WGS84.GM == 3.986004418e14
    assert WGS84.omega_ie == 7.292115e-5
    assert f"{WGS84.b:.4f}" == "6356752.3142"
    assert f"{np.sqrt(WGS84.e2):.13f}" == "0.0818191908426"
    assert f"{WGS84.e2:.14f}" == "0.00669437999014"
    assert f"{WGS84.gamma_e:.10f}" == "9.7803253359"
    assert f"{WGS84.k:.14f}" == "0.00193185265241"
    # TR 8350.2 gives the second zonal as C20 = -J2 / sqrt(5) of the ellipsoid, -0.484166774985e-3
    assert f"{-WGS84.J2 / np.sqrt(5.0) * 1e3:.9f}" == "-0.484166775"


def test_grs80_constants_to_their_printed_digits():
    """Moritz, Geodetic Reference System 1980: defining and derived constants, printed digits."""
    assert GRS80.a == 6378137.0
    assert GRS80.GM == 3.986005e14
    assert GRS80.omega_ie == 7.292115e-5
    assert f"{GRS80.b:.4f}" == "6356752.3141"
    assert f"{GRS80.e2:.13f}" == "0.0066943800229"
    assert f"{GRS80.gamma_e:.10f}" == "9.7803267715"
    assert f"{GRS80.k:.12f}" == "0.001931851353"
    J2, J4, J6 = GRS80.zonals
    assert J2 == 108263e-8
    assert f"{J4 * 1e6:.8f}" == "-2.37091222"
    assert f"{J6 * 1e9:.5f}" == "6.08347"


@BOTH
def test_somigliana_constant_follows_from_gravity_at_pole_and_equator(ellipsoid):
    """``k = b gamma_p / (a gamma_e) - 1`` with both gravities of boule, which derives them from GM and omega."""
    theirs = {"WGS 84": boule.WGS84, "GRS 80": boule.GRS80}[ellipsoid.name]
    assert ellipsoid.gamma_e == pytest.approx(theirs.gravity_equator, abs=2e-10)  # printed digits of gamma_e
    k = ellipsoid.b * theirs.gravity_pole / (ellipsoid.a * theirs.gravity_equator) - 1.0
    assert ellipsoid.k == pytest.approx(k, abs=5e-12)  # printed digits of k


def test_gravity_at_equator_and_pole_to_printed_digits():
    """TR 8350.2, table 3.4: 9.7803253359 and 9.8321849378."""
    assert f"{earth.gravity_somigliana(0.0):.10f}" == "9.7803253359"
    for pole in radians(90, -90):
        # printed digits: the constants k and gamma_e carry ten
        assert earth.gravity_somigliana(pole) == pytest.approx(9.8321849378, abs=1.1e-10)
        # ... and 1.3e-9 of the eighth harmonic, which the field leaves out
        assert earth.gravity_ned(pole)[2] == pytest.approx(9.8321849378, abs=2e-9)
    assert earth.gravity_ned(0.0)[2] == pytest.approx(9.7803253359, abs=1e-9)


# -------------------------------------------------------------------------------------- radii of curvature


@BOTH
def test_radii_of_curvature_against_pymap3d(ellipsoid, rng):
    import pymap3d

    model = pymap3d.Ellipsoid.from_name({"WGS 84": "wgs84", "GRS 80": "grs80"}[ellipsoid.name])
    lat = np.concatenate((rng.uniform(-np.pi / 2, np.pi / 2, 100), radians(0, 90, -90)))
    R_N, R_E = earth.radii_of_curvature(lat, ellipsoid)
    # printed digits: pymap3d stores b or f with about twelve digits
    np.testing.assert_allclose(R_N, rcurve.meridian(lat, model, deg=False), rtol=1e-11)
    np.testing.assert_allclose(R_E, rcurve.transverse(lat, model, deg=False), rtol=1e-11)


def test_radii_of_curvature_turn_angles_into_arcs_of_pyproj():
    """A hundredth of a degree north is R_N times the angle, east R_E cos L times the angle."""
    geod, step = Geod(ellps="WGS84"), 0.01
    for lat_deg in (-80.0, -33.0, 0.0, 10.0, 45.0, 60.0, 85.0):
        lat, dlat = radians(lat_deg, step)
        R_N, R_E = earth.radii_of_curvature(lat)
        _, _, north = geod.inv(10.0, lat_deg - step / 2, 10.0, lat_deg + step / 2)
        assert north == pytest.approx(R_N * dlat, rel=1e-9)  # discretisation: second order in 2e-4
        _, _, east = geod.inv(10.0 - step / 2, lat_deg, 10.0 + step / 2, lat_deg)
        assert east == pytest.approx(R_E * np.cos(lat) * dlat, rel=2e-7)  # the geodesic cuts the parallel's corner


def test_radii_at_equator_and_pole():
    R_N, R_E = earth.radii_of_curvature(radians(0, 90))
    np.testing.assert_allclose(R_E, [WGS84.a, WGS84.a**2 / WGS84.b], rtol=4 * EPS)  # rounding
    np.testing.assert_allclose(R_N, [WGS84.b**2 / WGS84.a, WGS84.a**2 / WGS84.b], rtol=4 * EPS)  # rounding
    assert R_E[1] == pytest.approx(6399593.6258, abs=5e-5)  # printed digits (TR 8350.2: polar radius of curvature)


# ---------------------------------------------------------------------------------------------- gravity


def exact_gravity(r, ellipsoid):
    """Exact gravity of a level ellipsoid at one position, in ellipsoidal harmonics (Heiskanen & Moritz, section 2-7).

    Written from the potential, with nothing in common with the zonal series under test. Returns the components along
    increasing ``u`` (up) and reduced latitude ``beta`` (north), and the angle between the coordinate ellipsoid's normal
    and the equator.
    """
    a, b, omega = ellipsoid.a, ellipsoid.b, ellipsoid.omega_ie
    E2 = a * a - b * b
    E = np.sqrt(E2)
    p2, z = r[0] ** 2 + r[1] ** 2, r[2]
    s = p2 + z * z - E2
    u2 = 0.5 * (s + np.sqrt(s * s + 4.0 * E2 * z * z))
    u, v2 = np.sqrt(u2), u2 + E2
    sb, cb = z / u, np.sqrt(p2 / v2)

    def q(x):
        return 0.5 * ((1.0 + 3.0 * x * x / E2) * np.arctan2(E, x) - 3.0 * x / E)

    q_prime = 3.0 * (1.0 + u2 / E2) * (1.0 - u / E * np.arctan2(E, u)) - 1.0
    w = np.sqrt((u2 + E2 * sb * sb) / v2)
    along_u = -(ellipsoid.GM + omega**2 * a**2 * E * q_prime / q(b) * (0.5 * sb * sb - 1.0 / 6.0)) / v2
    along_u += omega**2 * u * cb * cb
    along_b = (omega**2 * a**2 / np.sqrt(v2) * q(u) / q(b) - omega**2 * np.sqrt(v2)) * sb * cb
    return along_u / w, along_b / w, np.arctan2(sb * np.sqrt(v2), cb * u)


@BOTH
@pytest.mark.parametrize("h", [0.0, 1e3, 1e4, 1e5, 1e6])
def test_gravity_is_the_exact_field_of_the_level_ellipsoid(ellipsoid, h):
    """Both components, from the surface to orbit; the first harmonic left out (J8) is worth 1.3e-9 m/s^2."""
    for lat in radians(-90, -61, -45, -10, 0, 10, 30, 45, 60, 75, 89.9, 90):
        up, north, normal = exact_gravity(frames.ecef_from_llh([lat, 0.7, h], ellipsoid), ellipsoid)
        tilt = lat - normal  # from the coordinate ellipsoid's normal to the geodetic one
        expected = [north * np.cos(tilt) - up * np.sin(tilt), 0.0, -(up * np.cos(tilt) + north * np.sin(tilt))]
        gravity = earth.gravity_ned(lat, h, ellipsoid)
        np.testing.assert_allclose(gravity, expected, rtol=0, atol=2e-9)  # the model's own truncation, as documented


@BOTH
@pytest.mark.parametrize("h", [0.0, 1e3, 1e4])
def test_boule_agrees_on_normal_gravity(ellipsoid, h):
    """boule's value above the ellipsoid is the component along the geodetic normal."""
    theirs = {"WGS 84": boule.WGS84, "GRS 80": boule.GRS80}[ellipsoid.name]
    lat_deg = np.linspace(-90.0, 90.0, 37)
    expected = theirs.normal_gravity((0.0, lat_deg, h)) * MGAL
    # truncation of the zonals, 1.3e-9 m/s^2
    np.testing.assert_allclose(earth.gravity_ned(radians(*lat_deg), h, ellipsoid)[:, 2], expected, rtol=0, atol=2e-9)
    surface = theirs.normal_gravity((0.0, lat_deg, 0.0)) * MGAL
    np.testing.assert_allclose(
        earth.gravity_somigliana(radians(*lat_deg), 0.0, ellipsoid), surface, rtol=0, atol=2e-10
    )  # printed digits of gamma_e and k


@pytest.mark.parametrize(("h", "low", "high"), [(0.0, 0.0, 2e-9), (1e4, 6e-7, 8e-7), (1e5, 1.4e-4, 1.6e-4)])
def test_somigliana_height_series_is_off_by_what_its_docstring_says(h, low, high):
    """Documented: 7e-7 m/s^2 at 10 km and 1.5e-4 m/s^2 at 100 km; the statement is checked from both sides."""
    lat = np.linspace(-np.pi / 2, np.pi / 2, 181)
    worst = np.abs(earth.gravity_somigliana(lat, h) - earth.gravity_ned(lat, h)[:, 2]).max()
    assert low <= worst <= high


def test_north_component_at_height():
    """Documented: 8e-9 m/s^2 per metre at 45 deg, towards the equator in both hemispheres; none on the ellipsoid."""
    for h in (1e3, 1e4):
        north = earth.gravity_ned(radians(45, -45, 0, 90), h)[:, 0]
        np.testing.assert_allclose(north / h, [-8.1e-9, 8.1e-9, 0.0, 0.0], rtol=0, atol=1e-10)  # printed digits
    on_ellipsoid = earth.gravity_ned(np.linspace(-1.5, 1.5, 31), 0.0)
    np.testing.assert_allclose(on_ellipsoid[:, 0], 0.0, rtol=0, atol=1e-9)  # truncation of the zonals
    np.testing.assert_array_equal(on_ellipsoid[:, 1], 0.0)


def yaman_gravity(lat, h):
    """Yaman (2017), appendix A: gravitation of the surface falls with the inverse square; FIX 3 applied."""
    g_0 = np.array([0.0, 0.0, earth.gravity_somigliana(lat)])
    C_ne, Omega = frames.C_en([lat, 0.0]).T, rotation.skew(earth.earth_rate_ned(lat))
    r_s, r_b = (C_ne @ frames.ecef_from_llh([lat, 0.0, height]) for height in (0.0, h))
    size = np.linalg.norm(r_s)
    return (size / (size + h)) ** 2 * (g_0 + Omega @ Omega @ r_s) - Omega @ Omega @ r_b


def test_values_printed_by_yaman():
    """9.801626 and 9.798539 m/s^2 at 39.92 deg, 0 and 1000 m."""
    (lat,) = radians(39.92)
    assert f"{earth.gravity_ned(lat, 0.0)[2]:.6f}" == "9.801626"
    assert f"{earth.gravity_somigliana(lat, 0.0):.6f}" == "9.801626"
    # his height law is that of a sphere: it gives his digits, and is 1.2e-6 m/s^2 below the exact field
    assert f"{yaman_gravity(lat, 1000.0)[2]:.6f}" == "9.798539"
    np.testing.assert_allclose(earth.gravity_ned(lat, 1000.0), yaman_gravity(lat, 1000.0), rtol=0, atol=2e-6)
    # "-7.9e-9 m/s^2 per metre" of his model at this latitude
    assert earth.gravity_ned(lat, 1000.0)[0] / 1000.0 == pytest.approx(-8.0e-9, abs=0.1e-9)


def test_value_printed_by_hayal():
    """9.80170 m/s^2 at 40 deg on GRS 80, five printed decimals."""
    (lat,) = radians(40)
    assert f"{earth.gravity_ned(lat, 0.0, GRS80)[2]:.5f}" == "9.80170"
    assert f"{earth.gravity_somigliana(lat, 0.0, GRS80):.5f}" == "9.80170"


def test_gravity_formula_of_1980_printed_by_stefanisko():
    """9.780327 (1 + 0.0053024 sin^2 L - 0.0000058 sin^2 2L), eq. (1.24): is GRS 80; WGS 84 differs by 2.1e-6."""
    lat = np.linspace(0.0, np.pi / 2, 181)
    printed = 9.780327 * (1.0 + 0.0053024 * np.sin(lat) ** 2 - 0.0000058 * np.sin(2.0 * lat) ** 2)
    assert np.abs(printed - earth.gravity_somigliana(lat, 0.0, GRS80)).max() < 1.0e-6  # printed digits
    assert np.abs(printed - earth.gravity_somigliana(lat)).max() == pytest.approx(2.1e-6, abs=0.1e-6)  # printed digits


def test_j2_gravitation_as_stefanisko_writes_it():
    """``-mu / r^3 (r + 3/2 J2 a^2 / r^2 (...))``, and within 4e-5 m/s^2 of WGS 84 gravity at 48.84 deg north."""
    (lat,) = radians(48.84)
    r = frames.ecef_from_llh([lat, 0.3, 0.0])
    x, y, z = r
    r2 = r @ r
    ratio = 5.0 * z * z / r2
    bracket = r + 1.5 * 1.082629821313e-3 * 6378137.0**2 / r2 * np.array(
        [(1 - ratio) * x, (1 - ratio) * y, (3 - ratio) * z]
    )
    gravitation = earth.gravitation_j2(r)
    np.testing.assert_allclose(gravitation, -3.986004418e14 / r2**1.5 * bracket, rtol=16 * EPS)  # rounding
    gravity = gravitation + OMEGA_E[2] ** 2 * np.array([x, y, 0.0])
    assert f"{abs(np.linalg.norm(gravity) - earth.gravity_somigliana(lat)):.0e}" == "4e-05"  # printed digits


def test_far_away_gravitation_is_that_of_a_point():
    r = np.array([3e9, -4e9, 1e9])
    point = -WGS84.GM * r / np.linalg.norm(r) ** 3
    # J2 (a / r)^2 = 1e-9
    np.testing.assert_allclose(earth.gravitation_ecef(r), point, rtol=1e-8)
    np.testing.assert_allclose(earth.gravitation_j2(r), point, rtol=1e-8)


@BOTH
@pytest.mark.parametrize("shape", BATCHES)
def test_both_axes_give_one_gravity(ellipsoid, shape, rng):
    llh = random_positions(rng, shape)
    r = frames.ecef_from_llh(llh, ellipsoid)
    g_n = earth.gravity_ned(llh[..., 0], llh[..., 2], ellipsoid)
    assert g_n.shape == (*shape, 3)
    g_e = np.einsum("...ij,...j->...i", frames.C_en(llh), g_n)
    np.testing.assert_allclose(g_e, earth.gravity_ecef(r, ellipsoid), rtol=0, atol=100 * EPS)  # rounding
    centrifugal = -np.cross(OMEGA_E, np.cross(OMEGA_E, r))
    np.testing.assert_allclose(
        earth.gravity_ecef(r, ellipsoid), earth.gravitation_ecef(r, ellipsoid) + centrifugal, rtol=0, atol=100 * EPS
    )


def test_gravity_is_symmetric_about_the_axis_and_the_equator(rng):
    r = frames.ecef_from_llh(random_positions(rng, (50,)))
    for angle in rng.uniform(-np.pi, np.pi, 5):
        C = rotation.dcm_from_rotvec([0.0, 0.0, angle])
        for field in (earth.gravity_ecef, earth.gravitation_ecef, earth.gravitation_j2):
            np.testing.assert_allclose(field(r @ C.T), field(r) @ C.T, rtol=0, atol=100 * EPS)  # rounding
    mirror = np.array([1.0, 1.0, -1.0])
    np.testing.assert_array_equal(earth.gravity_ecef(r * mirror), earth.gravity_ecef(r) * mirror)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_gravity_is_continuous_across_the_poles(sign):
    pole = np.array([0.0, 0.0, sign * (WGS84.b + 100.0)])
    g = earth.gravity_ecef(pole)
    assert g[0] == g[1] == 0.0
    for x in (1e-9, 1e-3, 1.0):
        for side in ([x, 0, 0], [-x, 0, 0], [0, x, 0], [0, -x, 0]):
            # gravity turns by one radian per Earth radius: 1.5e-6 m/s^2 per metre
            np.testing.assert_allclose(earth.gravity_ecef(pole + side), g, rtol=0, atol=1.6e-6 * x + 4e-15)
    lat = sign * (np.pi / 2 - np.array([0.0, 1e-15, 1e-9, 1e-6]))
    np.testing.assert_allclose(
        earth.gravity_ned(lat, 100.0), np.tile([0.0, 0.0, abs(g[2])], (4, 1)), rtol=0, atol=1e-10
    )  # the north component fades like the sine of the distance


def jacobian(field, r, step):
    columns = [(field(r + step * e) - field(r - step * e)) / (2.0 * step) for e in np.eye(3)]
    return np.stack(columns, axis=-1)


def test_gravity_is_the_gradient_of_a_potential(rng):
    """Energy: no curl. Laplace and Poisson: gravitation has no divergence outside the Earth, gravity 2 omega^2."""
    scale = WGS84.GM / WGS84.a**3  # 1.5e-6 1/s^2
    for llh in random_positions(rng, (50,)):
        r = frames.ecef_from_llh(llh)
        # discretisation of the difference: 4 (step / r)^2 = 1e-7; a wrong factor at J2 alone would be 1e-3
        J = jacobian(earth.gravity_ecef, r, 1000.0)
        np.testing.assert_allclose(J, J.T, rtol=0, atol=1e-6 * scale)
        assert np.trace(J) == pytest.approx(2.0 * OMEGA_E[2] ** 2, abs=1e-6 * scale)
        for field in (earth.gravitation_ecef, earth.gravitation_j2):
            J = jacobian(field, r, 1000.0)
            np.testing.assert_allclose(J, J.T, rtol=0, atol=1e-6 * scale)
            assert np.trace(J) == pytest.approx(0.0, abs=1e-6 * scale)


def test_no_work_is_done_around_a_closed_loop(rng):
    """The integral of gravity along any closed path of a thousand kilometres vanishes."""
    corners = frames.ecef_from_llh(random_positions(rng, (5,), 0.0, 2e5))
    corners = corners[0] + 0.05 * (corners - corners[0])
    corners[1:] *= 1.02  # straight legs stay outside the Earth
    x, w = np.polynomial.legendre.leggauss(20)
    work, size = 0.0, 0.0
    for start, stop in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = earth.gravity_ecef(start + 0.5 * (1.0 + x)[:, None] * (stop - start)) @ (stop - start) * 0.5
        work, size = work + w @ along, size + abs(w @ along)
    assert size > 1e6
    assert abs(work) < 1e-12 * size  # rounding


def test_gravity_gradient_is_the_jacobian_to_a_percent(rng):
    for llh in random_positions(rng, (50,)):
        r = frames.ecef_from_llh(llh)
        G = earth.gravity_gradient_ecef(r)
        J = jacobian(earth.gravity_ecef, r, 1000.0)
        # the model's own: flattening, documented as half a percent
        assert np.linalg.norm(G - J) < 0.01 * np.linalg.norm(J)
        np.testing.assert_array_equal(G, G.T)


def test_gravity_gradient_has_the_trace_of_free_space_and_no_rotation_along_the_axis(rng):
    """Gravitation is free of sources, so the trace is that of the centrifugal part, 2 omega^2, none of it along z."""
    for r in frames.ecef_from_llh(random_positions(rng, (20,))):
        trace = np.trace(earth.gravity_gradient_ecef(r))
        assert trace == pytest.approx(2.0 * WGS84.omega_ie**2, rel=1e-6)  # rounding of 1e-6 1/s^2
    G = earth.gravity_gradient_ecef([0.0, 0.0, 6.4e6])
    np.testing.assert_allclose(np.diag(G), WGS84.GM / 6.4e6**3 * np.array([-1.0, -1.0, 2.0])
                               + WGS84.omega_ie**2 * np.array([1.0, 1.0, 0.0]), rtol=1e-12)  # fmt: skip


def test_vertical_gravity_gradient():
    """-3.086e-6 1/s^2 at 40 deg: the free-air gradient, 0.3086 mGal per metre."""
    (lat,) = radians(40)
    slope = (earth.gravity_ned(lat, 1.0)[2] - earth.gravity_ned(lat, -1.0)[2]) / 2.0
    assert slope == pytest.approx(-3.086e-6, abs=1e-9)  # printed digits
    up = -frames.C_en([lat, 0.0])[:, 2]
    G = earth.gravity_gradient_ecef(frames.ecef_from_llh([lat, 0.0, 0.0]))
    assert -up @ G @ up == pytest.approx(slope, rel=0.01)  # the model's own, documented


@pytest.mark.parametrize("shape", BATCHES)
def test_stacks_are_loops(shape, rng):
    llh, v = random_positions(rng, shape), rng.standard_normal((*shape, 3))
    r, lat, h = frames.ecef_from_llh(llh), llh[..., 0], llh[..., 2]
    cases = [
        (earth.gravity_somigliana, (lat, h)),
        (earth.gravity_ned, (lat, h)),
        (earth.gravity_ecef, (r,)),
        (earth.gravitation_ecef, (r,)),
        (earth.gravitation_j2, (r,)),
        (earth.gravity_gradient_ecef, (r,)),
        (earth.earth_rate_ned, (lat,)),
        (earth.transport_rate_ned, (lat, h, v)),
    ]
    for function, arguments in cases:
        stacked = function(*arguments)
        for index in np.ndindex(shape):
            one = function(*(a[index] for a in arguments))
            np.testing.assert_allclose(stacked[index], one, rtol=8 * EPS, atol=1e-18)  # rounding: SIMD and scalar sines


def test_latitudes_and_heights_broadcast():
    lat, h = radians(10, 20, 30), np.array([[0.0], [1e3]])
    assert earth.gravity_ned(lat, h).shape == (2, 3, 3)
    assert earth.gravity_somigliana(lat, h).shape == (2, 3)
    np.testing.assert_array_equal(earth.gravity_ned(lat, h)[1, 2], earth.gravity_ned(lat[2], 1e3))


# ------------------------------------------------------------------------------- Earth rate, transport rate


def test_earth_rate_in_navigation_axes(rng):
    """One vector of 7.292115e-5 rad/s along the Earth's axis, seen from everywhere."""
    llh = random_positions(rng, (100,))
    omega = earth.earth_rate_ned(llh[:, 0])
    np.testing.assert_allclose(np.linalg.norm(omega, axis=-1), 7.292115e-5, rtol=4 * EPS)  # rounding
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", frames.C_en(llh), omega), np.tile(OMEGA_E, (100, 1)), rtol=0, atol=1e-19
    )  # rounding
    np.testing.assert_allclose(earth.earth_rate_ned(0.0), [7.292115e-5, 0.0, 0.0], rtol=0, atol=1e-20)
    np.testing.assert_allclose(earth.earth_rate_ned(np.pi / 2), [0.0, 0.0, -7.292115e-5], rtol=0, atol=1e-20)
    np.testing.assert_allclose(earth.earth_rate_ned(-np.pi / 2), [0.0, 0.0, 7.292115e-5], rtol=0, atol=1e-20)
    # 15.04 deg an hour
    assert 7.292115e-5 * 3600.0 * 180.0 / np.pi == pytest.approx(15.041067, abs=5e-7)


def derivative(function, step):
    """Five-point central difference at zero, error of order step^4."""
    return (8.0 * (function(step) - function(-step)) - (function(2 * step) - function(-2 * step))) / (12.0 * step)


def test_transport_rate_is_the_turning_of_the_axes(rng):
    """``[omega_en_n x] = C_en' dC_en/dt`` along a path with the given velocity, within 7 deg of the poles too."""
    for llh in random_positions(rng, (60,), 0.0, 2e4):
        if abs(llh[0]) > 1.5:  # meridians converge too fast for a difference over seconds
            continue
        v = 200.0 * rng.standard_normal(3)
        R_N, R_E = earth.radii_of_curvature(llh[0])
        rate = np.array([v[0] / (R_N + llh[2]), v[1] / ((R_E + llh[2]) * np.cos(llh[0])), -v[2]])
        C_ne = frames.C_en(llh).T
        turning = C_ne @ derivative(lambda t, llh=llh, rate=rate: frames.C_en(llh + t * rate), 1.0)
        omega = earth.transport_rate_ned(llh[0], llh[2], v)
        # rounding: eps / step; discretisation: longitude rate^5 step^4 / 30
        np.testing.assert_allclose(rotation.skew(omega), turning, rtol=0, atol=2e-15)
        # ... and the rate belongs to that velocity: r' = C_en v
        moving = C_ne @ derivative(lambda t, llh=llh, rate=rate: frames.ecef_from_llh(llh + t * rate), 1.0)
        np.testing.assert_allclose(moving, v, rtol=0, atol=1e-8)  # rounding of the position, 1e-9 m, over the step


def test_transport_rate_by_hand():
    """East at the equator turns about north, north turns about west, and east at 45 deg also about up."""
    h = 1000.0
    east = earth.transport_rate_ned(0.0, h, [0.0, 100.0, 0.0])
    np.testing.assert_allclose(east, [100.0 / (WGS84.a + h), 0.0, 0.0], rtol=4 * EPS, atol=1e-30)
    north = earth.transport_rate_ned(0.0, h, [100.0, 0.0, 5.0])
    np.testing.assert_allclose(north, [0.0, -100.0 / (WGS84.b**2 / WGS84.a + h), 0.0], rtol=4 * EPS, atol=1e-30)
    at45 = earth.transport_rate_ned(np.pi / 4, h, [0.0, 100.0, 0.0])
    np.testing.assert_allclose(at45[2], -at45[0], rtol=8 * EPS)
    np.testing.assert_array_equal(earth.transport_rate_ned(0.7, h, [0.0, 0.0, -3.0]), [0.0, 0.0, 0.0])
