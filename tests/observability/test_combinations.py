"""Combinations in words: factors recognised, sparse bases found, nothing invented."""

import numpy as np
import pytest

from schuler.observability import (
    RotaryModel,
    Spectrum,
    in_du_axes,
    in_navigation_axes,
    model_system,
    recognised,
    seen,
    spectrum,
    unseen,
)
from schuler.units import DEG, DEG_PER_HR

W, LAT, G = 7.292115e-5, 45.75 * DEG, 9.806
CONSTANTS = {"g": G, "w": 10.0 * DEG, "W cos(lat)": W * np.cos(LAT), "W sin(lat)": W * np.sin(LAT)}
SIGMA = np.repeat([DEG, 0.01, 0.2, 400.0 * DEG_PER_HR], 3)


def study(axis=None, *, earth=True, pitch=0.0, axes="enu"):
    rate = {} if earth else {"earth_rate": 0.0}
    model = RotaryModel(axis=axis, rate=10.0 * DEG, rpy_nb=(0.0, pitch, 0.0), lat=LAT, gravity=G, **rate)
    system = model_system(model, duration=300.0, sigma=SIGMA, rate_hz=2.0)
    return spectrum(in_navigation_axes(in_du_axes(system) if axes == "enu" else system))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (G, "g"),
        (-2.0 * G, "-2 g"),
        (0.5, "1/2"),
        (-1.0, "-1"),
        (G / (10.0 * DEG), "g / w"),
        (1.0 / G, "1 / g"),
        ((10.0 * DEG) ** 2, "w^2"),
        (W * np.sin(LAT), "W sin(lat)"),
        (1.5 * G, "3/2 g"),
        (0.123456789, "0.1235"),
        (0.0, "0"),
    ],
)
def test_factors_are_recognised(value, text):
    assert recognised(value, CONSTANTS) == text


def test_a_factor_that_is_nearly_one_is_not_taken_for_it():
    """Gravity differs from place to place: 1e-4 of it is another number."""
    assert recognised(G * 1.0001, CONSTANTS) == "9.807"


def test_conventional_system_in_du_names():
    """Table 5.1, in words: the ones of the issue."""
    result = study()
    assert {c.text for c in seen(result, CONSTANTS)} == {
        "dv_E", "dv_N", "dv_U", "b_U", "b_E + g eps_N", "b_N - g eps_E", "d_N - W sin(lat) eps_E",
        "d_U + W cos(lat) eps_E", "d_E + W sin(lat) eps_N - W cos(lat) eps_U",
    }  # fmt: skip
    assert {c.text for c in unseen(result, CONSTANTS)} == {
        "eps_E with d_N = W sin(lat) eps_E, d_U = -W cos(lat) eps_E, b_N = g eps_E",
        "eps_N with d_E = -W sin(lat) eps_N, b_E = -g eps_N",
        "eps_U with d_E = W cos(lat) eps_U",
    }


def test_level_rotation_about_z_in_words():
    """What oscillates: a tilt that turns with the IMU hides both horizontal biases."""
    result = study((0.0, 0.0, -1.0), earth=False)
    assert {c.text for c in seen(result, CONSTANTS)} == {
        "dv_E", "dv_N", "dv_U", "b_U", "b_E + g eps_N", "b_N - g eps_E", "d_E + w eps_N", "d_N - w eps_E",
    }  # fmt: skip
    assert {c.text for c in unseen(result, CONSTANTS)} == {
        "eps_U", "d_U", "eps_E with d_N = w eps_E, b_N = g eps_E", "eps_N with d_E = -w eps_N, b_E = -g eps_N",
    }  # fmt: skip


def test_our_own_names_have_the_signs_of_estimates():
    result = study(earth=False, axes="ned")
    texts = {c.text for c in seen(result, CONSTANTS)}
    assert {"b_a_E - g eps_N", "b_a_N + g eps_E", "b_g_N", "b_g_E", "b_a_D"} < texts


def test_weak_directions_can_be_left_out():
    """With Earth rate level rotation about Z is formally complete; what it is good for is gyrocompassing."""
    result = study((0.0, 0.0, -1.0))
    assert result.formal == 12
    assert [c.text for c in unseen(result, CONSTANTS)] == []
    useful = {c.text for c in seen(result, CONSTANTS, which="useful")}
    assert {"eps_U", "d_U", "b_E + g eps_N", "b_N - g eps_E"} < useful
    assert len(useful) == result.useful == 10


def test_bases_are_orthogonal_complements_in_si():
    """Every seen combination of every unseen error is zero; factors are those of the printed names."""
    result = study((0.0, 1.0, 0.0), earth=False)
    A = np.array([c.coefficients for c in seen(result, CONSTANTS)])
    B = np.array([c.coefficients for c in unseen(result, CONSTANTS)])
    assert A.shape == (10, 12)
    assert B.shape == (2, 12)
    scaled = (A * SIGMA[0]) @ (B.T / SIGMA[0])
    assert np.abs(scaled).max() < 1e-6


def test_a_known_sparse_space_is_found_again():
    """Three sparse rows mixed at random come back, scaled by their leading state."""
    rng = np.random.default_rng(5)
    names = ("dv_N", "b_a_N", "b_g_N", "eps_N", "eps_E")
    rows = np.array([[1.0, 0, 0, 0, 0], [0, 1.0, 0, 9.806, 0], [0, 0, 1.0, 0, -2.0]])
    sigma = np.array([0.01, 0.2, 0.002, 0.02, 0.02])
    q, _ = np.linalg.qr((rng.standard_normal((3, 3)) @ rows * sigma).T, mode="complete")
    result = Spectrum(names, np.array([9.0, 5.0, 2.0, 0.0, 0.0]), q.T, sigma, 1e-12)
    assert [c.text for c in seen(result, {"g": 9.806})] == ["dv_N", "b_a_N + g eps_N", "b_g_N - 2 eps_E"]
    assert {c.text for c in unseen(result, {"g": 9.806})} == {
        "eps_E with b_g_N = 2 eps_E",
        "eps_N with b_a_N = -g eps_N",
    }
