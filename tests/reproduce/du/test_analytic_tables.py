"""Analytic tables: every cell against quadrature and against full mechanization, the residue, printed closed forms."""

import numpy as np
import pytest

from schuler import earth
from schuler.exceptions import InputError
from schuler.reproduce.du.study import analytic_tables as tables
from schuler.reproduce.du.study.analytic_tables import SCHEMES, SOURCES, DuErrors
from schuler.rotary import schemes
from schuler.rotary.du_axes import du_axis, swap_vector
from schuler.rotary.free_navigation import static_run
from schuler.rotary.modulated_errors import open_loop_errors
from schuler.rotary.rotating_imu import RotatingMotion
from schuler.rotary.schedule import Schedule
from schuler.simulation.motion import StaticMotion
from schuler.units import DEG, DEG_PER_HR

W, LAT = 10.0 * DEG, 40.0 * DEG
RNG = np.random.default_rng(8)
ERRORS = DuErrors(
    d=RNG.normal(size=3) * 30.0 * DEG_PER_HR, b=RNG.normal(size=3) * 0.1, K=RNG.normal(size=(3, 3)) * 2e-3,
    Ka=RNG.normal(size=(3, 3)) * 2e-3,
)  # fmt: skip
every_cell = pytest.mark.parametrize(("source", "scheme"), [(a, b) for a in SOURCES for b in SCHEMES])


def schedule_of(scheme: str) -> Schedule:
    return schemes.fixed() if scheme == "conventional" else schemes.continuous(du_axis(scheme), W)


def at_rest(scheme: str, duration: float = 400.0, schedule: Schedule | None = None) -> RotatingMotion:
    rest = StaticMotion(np.array([LAT, 0.0, 0.0]), np.zeros(3), duration)
    return RotatingMotion(rest, schedule or schedule_of(scheme))


@every_cell
def test_a_cell_is_the_mean_over_revolutions(source, scheme):
    """Linear quadrature over three revolutions; rounding, and 1e-9 g between the two forms of normal gravity."""
    run = open_loop_errors(at_rest(scheme), ERRORS.only(source).imu_errors(), np.array([0.0, 108.0]))
    cell = tables.cycle_rate(source, scheme, ERRORS, rate=W, lat=LAT)
    if source.startswith("gyro"):
        np.testing.assert_allclose(swap_vector(run.attitude[-1]) / 108.0, cell, atol=1e-16, rtol=1e-10)
    else:
        np.testing.assert_allclose(swap_vector(run.velocity[-1]) / 108.0, cell, atol=1e-10)


@every_cell
def test_a_cell_is_what_mechanization_does_to_the_stated_truncation(source, scheme):
    """One revolution (36 s) of the engine, nonlinear, on a turning round Earth.

    Truncated is, for an attitude error eps that has grown to at most e: second order e^2 (the oscillation within the
    revolution counts, K of a tilt), Earth rate on it W T e = 2.6e-3 e, velocity g e T^2 / (2 R) = 1e-3 e. For velocity
    v: Coriolis 2 W T v = 5e-3 v, its tilt v T / R by g = 2e-3 v, and free-air gravity 1e-3 v.
    """
    run = static_run(schedule_of(scheme), ERRORS.only(source).imu_errors(), duration=36.0, lat=LAT)
    cell = 36.0 * tables.cycle_rate(source, scheme, ERRORS, rate=W, lat=LAT)
    if source.startswith("gyro"):
        e = np.abs(run.attitude).max()
        truncation = 4e-3 * e + e**2 + 1e-12
        assert np.abs(run.attitude[-1] - cell).max() < truncation
        assert truncation < 0.2 * max(np.abs(cell).max(), e)
    else:
        v = np.abs(run.velocity).max()
        np.testing.assert_allclose(run.velocity[-1], cell, atol=8e-3 * v + 1e-9)


def test_a_wrong_cell_would_be_seen():
    """The two axes of installation about Z interchanged: the check above would fail by far."""
    e = DuErrors(K=ERRORS.K.T)
    right, wrong = (tables.cycle_rate("gyro installation", "Z", x, rate=W, lat=LAT)[0] for x in (ERRORS, e))
    assert abs(right - wrong) > 1e-9


def test_the_printed_words_of_a_table():
    assert tables.table_text("gyro scale factor") == [
        ("conventional", "0", "Kyy Wc", "Kzz Ws"),
        ("X", "Kxx w", "1/2 Kyy Wc + 1/2 Kzz Wc", "1/2 Kyy Ws + 1/2 Kzz Ws"),
        ("Y", "0", "Kyy w + Kyy Wc", "1/2 Kxx Ws + 1/2 Kzz Ws"),
        ("Z", "0", "1/2 Kxx Wc + 1/2 Kyy Wc", "Kzz w + Kzz Ws"),
    ]
    assert tables.table_text("accel installation")[1] == ("X", "0", "1/2 Kayz g - 1/2 Kazy g", "0")


def test_the_killer():
    """3000 ppm at 10 deg/s: 108 deg/h, 1.08 deg per revolution about the axis (section 3.2, printed digits)."""
    e = DuErrors(K=np.diag([3e-3] * 3))
    rate = tables.cycle_rate("gyro scale factor", "Z", e, rate=W, lat=0.0)[2]
    assert rate / DEG_PER_HR == pytest.approx(108.0, abs=0.5)
    assert rate * 36.0 / DEG == pytest.approx(1.08, abs=5e-3)


def trig(angle):
    return np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)


def printed_forms(scheme: str, angle: np.ndarray) -> dict[str, np.ndarray]:
    """Closed forms of Du, chapter 3, corrected; rows east, north, up."""
    c, s, c2, s2 = trig(angle)
    (dx, dy, dz), K, Ka = ERRORS.d, ERRORS.K, ERRORS.Ka
    We = earth.WGS84.omega_ie
    Wc, Ws, g = We * np.cos(LAT), We * np.sin(LAT), float(earth.gravity_somigliana(LAT))
    (Kx, Kxy, Kxz), (Kyx, Ky, Kyz), (Kzx, Kzy, Kz) = K
    (_, Kaxy, Kaxz), (_, Kay, Kayz), (_, Kazy, Kaz) = Ka
    one, zero = np.ones_like(angle), np.zeros_like(angle)
    if scheme == "X":
        return {
            "gyro bias": [dx * one, dy * c - dz * s, dy * s + dz * c],
            "gyro scale factor": [
                Kx * W * one,
                Ky * (Wc * (1 + c2) / 2 + Ws * s2 / 2) - Kz * (-Wc * (1 - c2) / 2 + Ws * s2 / 2),
                Ky * (Wc * s2 / 2 + Ws * (1 - c2) / 2) + Kz * (-Wc * s2 / 2 + Ws * (1 + c2) / 2),
            ],
            "gyro installation": [None, W * (Kyx * c - Kzx * s), W * (Kyx * s + Kzx * c)],
            "accel scale factor": [zero, (Kay - Kaz) * g * s2 / 2, g * (Kay * (1 - c2) + Kaz * (1 + c2)) / 2],
            "accel installation": [
                g * (Kaxy * s + Kaxz * c), g * (Kayz * (1 + c2) - Kazy * (1 - c2)) / 2, g * (Kayz + Kazy) * s2 / 2,
            ],
        }  # fmt: skip
    if scheme == "Y":
        return {
            "gyro bias": [dx * c + dz * s, dy * one, -dx * s + dz * c],
            "gyro scale factor": [
                (Kz - Kx) * Ws * s2 / 2, Ky * (Wc + W) * one, Ws * (Kx * (1 - c2) + Kz * (1 + c2)) / 2,
            ],
            "gyro installation": [W * (Kxy * c + Kzy * s), None, W * (-Kxy * s + Kzy * c)],
        }  # fmt: skip
    return {
        "gyro bias": [dx * c - dy * s, dx * s + dy * c, dz * one],
        "gyro scale factor": [(Kx - Ky) * Wc * s * c, (Kx * s**2 + Ky * c**2) * Wc, Kz * (Ws + W) * one],
        "gyro installation": [W * (Kxz * c - Kyz * s), W * (Kxz * s + Kyz * c), None],
    }


@pytest.mark.parametrize("scheme", ["X", "Y", "Z"])
def test_instantaneous_errors_are_the_printed_closed_forms(scheme):
    """Rounding; installation of the gyros is printed without its Earth rate terms: |K| W = 4e-7 rad/s."""
    angle = np.linspace(0.0, 7.0, 60)
    for source, rows in printed_forms(scheme, angle).items():
        result = tables.instantaneous_errors(scheme, ERRORS.only(source), angle, rate=W, lat=LAT)
        result = result[0] if source.startswith("gyro") else result[1]
        for k, row in enumerate(rows):
            if row is not None:
                atol = 8e-7 if source == "gyro installation" else 1e-15
                np.testing.assert_allclose(result[:, k], row, atol=atol, err_msg=f"{source} {k}")


@every_cell
def test_cells_are_the_means_of_the_instantaneous_errors(source, scheme):
    """64 even angles integrate trigonometric polynomials exactly; rounding."""
    angle = np.arange(64) * (2.0 * np.pi / 64)
    if scheme == "conventional":
        angle = np.zeros(2)
    d_omega, d_f = tables.instantaneous_errors(scheme, ERRORS.only(source), angle, rate=W, lat=LAT)
    cell = tables.cycle_rate(source, scheme, ERRORS, rate=W, lat=LAT)
    mean = (d_omega if source.startswith("gyro") else d_f).mean(axis=0)
    np.testing.assert_allclose(mean, cell, atol=1e-16 if source.startswith("gyro") else 1e-15)


def along_only(scheme: str) -> DuErrors:
    """Errors the residue is stated for: biases, and the column of K along the axis."""
    k = "XYZ".index(scheme)
    K = np.zeros((3, 3))
    K[:, k] = ERRORS.K[:, k]
    return DuErrors(ERRORS.d, ERRORS.b, K)


@pytest.mark.parametrize("scheme", ["X", "Y", "Z"])
@pytest.mark.parametrize("start", [0.0, 1.3])
@pytest.mark.parametrize("reciprocating", [False, True])
def test_the_residue_is_the_integral_at_whole_revolutions(scheme, start, reciprocating):
    """Eight revolutions. Left out is K times Earth rate: |K| W t in attitude (1e-4 of it), g times its integrals."""
    t, errors = 288.0, along_only(scheme)
    make = schemes.reciprocating if reciprocating else schemes.continuous
    run = open_loop_errors(
        at_rest(scheme, schedule=make(du_axis(scheme), W, angle=start)), errors.imu_errors(), np.array([0.0, t])
    )
    result = tables.secular_errors(scheme, errors, t, rate=W, lat=LAT, start_angle=start, reciprocating=reciprocating)
    tilt = np.abs(errors.K).max() * earth.WGS84.omega_ie * t
    for one, two, atol in zip(
        result, (run.attitude, run.velocity, run.position), (tilt, 9.81 * tilt * t, 9.81 * tilt * t**2), strict=True
    ):
        np.testing.assert_allclose(one, swap_vector(two[-1]), atol=atol)


def test_without_matrix_errors_the_residue_is_exact():
    for scheme in ("X", "Y", "Z"):
        errors = DuErrors(ERRORS.d, ERRORS.b)
        run = open_loop_errors(at_rest(scheme), errors.imu_errors(), np.array([0.0, 360.0]))
        result = tables.secular_errors(scheme, errors, 360.0, rate=W, lat=LAT)
        np.testing.assert_allclose(result[0], swap_vector(run.attitude[-1]), atol=1e-13)
        np.testing.assert_allclose(result[1], swap_vector(run.velocity[-1]), atol=1e-8)
        np.testing.assert_allclose(result[2], swap_vector(run.position[-1]), atol=1e-6)


def test_residue_about_z_in_closed_form():
    """V = g (d_h / w + K_h) e^(i start) t; 30 deg/h: 2.45 m/s of east at 300 s less, 0.1 deg: 5.13 (printed digits)."""
    g = float(earth.gravity_somigliana(0.25 * np.pi))
    d = 30.0 * DEG_PER_HR
    _, v, _ = tables.secular_errors("Z", DuErrors(d=[d, 0.0, 0.0]), 300.0, rate=W, lat=0.25 * np.pi)
    assert v[0] == pytest.approx(g * d / W * 300.0, rel=1e-12)
    assert v[0] == pytest.approx(2.45, abs=5e-3)
    assert v[1] == pytest.approx(0.0, abs=1e-12)
    K = np.zeros((3, 3))
    K[1, 2] = 0.1 * DEG
    for rate in (W, 7.0 * W):  # rate-independent
        _, v, _ = tables.secular_errors("Z", DuErrors(K=K), 300.0, rate=rate, lat=0.25 * np.pi)
        np.testing.assert_allclose(v[:2], [0.0, g * 0.1 * DEG * 300.0], atol=1e-12)
        assert v[1] == pytest.approx(5.13, abs=0.01)
    _, v, _ = tables.secular_errors("Z", DuErrors(d=[d, 0, 0]), 36.0, rate=W, lat=0.0, start_angle=0.5 * np.pi)
    assert abs(v[0]) < 1e-12  # the start phase turns it to north
    assert v[1] > 0.0


def test_reciprocating_bounds_azimuth_and_removes_secular_velocity_of_biases():
    """Acceptance 13: azimuth of Kz bounded by 2 pi Kz, d_h without secular velocity, K_h unchanged."""
    K = np.zeros((3, 3))
    K[0, 2], K[2, 2] = 1e-3, 3e-3
    motion = at_rest("Z", schedule=schemes.reciprocating(du_axis("Z"), W))
    t = np.linspace(0.0, 360.0, 721)
    scale = open_loop_errors(motion, DuErrors(K=np.diag([0, 0, 3e-3])).imu_errors(), t)
    bound = 2.0 * np.pi * 3e-3
    assert np.abs(scale.attitude[:, 2]).max() == pytest.approx(bound, rel=5e-3)  # and Kz W sin(lat) t
    to_and_fro = {"rate": W, "lat": LAT, "reciprocating": True}
    _, v, _ = tables.secular_errors("Z", DuErrors(d=ERRORS.d), 360.0, **to_and_fro)
    np.testing.assert_allclose(v[:2], 0.0, atol=1e-12)
    one, two = (
        tables.secular_errors("Z", DuErrors(K=K), 360.0, rate=W, lat=LAT, reciprocating=r)[1] for r in (False, True)
    )
    np.testing.assert_allclose(one, two, atol=1e-12)


def test_names_and_numbers_that_are_none_are_refused():
    with pytest.raises(InputError, match="no cell"):
        tables.cycle_rate("gyro", "Z", ERRORS, rate=W, lat=LAT)
    with pytest.raises(InputError, match="scheme: expected"):
        tables.instantaneous_errors("W", ERRORS, [0.0], rate=W, lat=LAT)
    with pytest.raises(InputError, match="no revolution"):
        tables.secular_errors("conventional", ERRORS, 1.0, rate=W, lat=LAT)
    with pytest.raises(InputError, match="expected a rotation"):
        tables.secular_errors("Z", ERRORS, 1.0, rate=0.0, lat=LAT)
    with pytest.raises(InputError, match="source: expected"):
        ERRORS.only("noise")
