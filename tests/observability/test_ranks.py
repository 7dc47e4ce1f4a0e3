"""Ranks in numbers: a table by scheme, three rules, the local matrix, and the engine's own transitions."""

import numpy as np
import pytest
import sympy as sp
from scipy.linalg import expm

from schuler.earth import radii_of_curvature
from schuler.exceptions import InputError
from schuler.observability import (
    LinearSystem,
    RotaryModel,
    derivatives,
    in_du_axes,
    local_matrix,
    local_spectrum,
    model_system,
    spectra,
    spectrum,
)
from schuler.observability import symbolic as sym
from schuler.observability.numeric_model import VELOCITY_ROWS
from schuler.units import DEG, DEG_PER_HR

#: Du's axes of the platform in forward, right, down.
AXES = {None: None, "X": (0.0, 1.0, 0.0), "Y": (1.0, 0.0, 0.0), "Z": (0.0, 0.0, -1.0)}
#: NAV440, Du chapter 5: attitude, velocity, accelerometer and gyroscope biases.
SIGMA = np.repeat([DEG, 0.01, 0.2, 400.0 * DEG_PER_HR], 3)

#: scheme, roll, pitch, azimuth; rank without and with Earth rate, how many of the latter are weak.
SCHEMES = [
    (None, 0, 0, 0, 8, 9, 0),
    ("X", 0, 0, 0, 10, 10, 0),
    ("X", 0, 30, 0, 10, 10, 0),
    ("X", 0, 0, 40, 10, 11, 0),
    ("X", 30, 0, 0, 11, 12, 1),  # "very weak at A=0"
    ("X", 30, 0, 40, 11, 12, 0),
    ("Y", 0, 0, 0, 10, 12, 1),  # "11 + one very weak"
    ("Y", 30, 0, 0, 10, 12, 1),
    ("Y", 0, 5, 0, 11, 12, 0),
    ("Y", 0, 30, 0, 11, 12, 0),
    ("Z", 0, 0, 0, 8, 10, 0),
    ("Z", 5, 0, 40, 11, 12, 0),
    ("Z", 0, 5, 0, 11, 12, 0),
    ("Z", 0, 30, 0, 11, 12, 0),
]


def scheme(axis, roll=0, pitch=0, azimuth=0, *, earth=True, **rest):
    rate = {} if earth else {"earth_rate": 0.0}
    rpy = (roll * DEG, pitch * DEG, azimuth * DEG)
    return RotaryModel(axis=AXES[axis], rate=10.0 * DEG, rpy_nb=rpy, lat=45.75 * DEG, **rate, **rest)


@pytest.mark.parametrize(("axis", "roll", "pitch", "azimuth", "without", "with_earth", "weak"), SCHEMES)
@pytest.mark.thinned(8)
def test_ranks_of_twelve_states_by_scheme(axis, roll, pitch, azimuth, without, with_earth, weak):
    """300 s, 10 deg/s, 12 states. Without Earth rate all three rules agree; with it the Gramian's rank is the printed
    one, and directions it calls very weak are those the prior knows better."""
    result = spectrum(model_system(scheme(axis, roll, pitch, azimuth, earth=False), duration=300.0, sigma=SIGMA))
    assert result.rank == result.formal == result.useful == without
    result = spectrum(model_system(scheme(axis, roll, pitch, azimuth), duration=300.0, sigma=SIGMA))
    assert result.rank == with_earth
    assert result.rank - result.useful == weak


@pytest.mark.campaign
def test_formal_ranks_with_earth_rate_are_the_symbolic_ones():
    """What the Gramian loses (second order in Earth rate over platform rate) the square root still has."""
    for axis, azimuth, expected in ((None, 0, 9), ("X", 0, 10), ("X", 40, 12), ("Y", 0, 12), ("Z", 0, 12)):
        result = spectrum(model_system(scheme(axis, azimuth=azimuth), duration=300.0, sigma=SIGMA))
        assert result.formal == expected


@pytest.mark.thinned(3)
@pytest.mark.parametrize("sigma_gyro", [20.0, 400.0, 3600.0])
def test_ranks_without_earth_rate_do_not_depend_on_the_prior(sigma_gyro):
    sigma = np.repeat([DEG, 0.01, 0.05, sigma_gyro * DEG_PER_HR], 3)
    for axis, pitch, expected in ((None, 0, 8), ("X", 0, 10), ("Y", 30, 11), ("Z", 0, 8), ("Z", 30, 11)):
        system = model_system(scheme(axis, pitch=pitch, earth=False), duration=120.0, rate_hz=1.0, sigma=sigma)
        result = spectrum(system)
        assert result.formal == result.rank == expected


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    ("axis", "pitch", "states"),
    [
        (None, 0, {"b_a_z", "b_g_x", "b_g_y"}),
        ("X", 0, {"eps_E", "b_a_x", "b_a_z", "b_g_x", "b_g_y", "b_g_z"}),
        ("Y", 0, {"eps_N", "b_a_y", "b_a_z", "b_g_x", "b_g_y", "b_g_z"}),
        ("Z", 0, {"b_a_z"}),
        ("Z", 5, {"eps_N", "eps_E", "b_a_x", "b_a_y", "b_a_z", "b_g_x", "b_g_y", "b_g_z"}),
    ],
)
def test_states_seen_one_by_one(axis, pitch, states):
    """Du, section 5.3, in our names: its x is our y, its y our x."""
    result = spectrum(model_system(scheme(axis, pitch=pitch, earth=False), duration=300.0, sigma=SIGMA))
    seen = {name for name, yes in zip(result.names, result.observable(), strict=True) if yes}
    assert seen == {"dv_N", "dv_E", "dv_D"} | states


@pytest.mark.parametrize(("axis", "pitch"), [(None, 0), ("X", 0), ("Y", 30), ("Z", 0), ("Z", 30)])
@pytest.mark.parametrize("t", [0.0, 17.3])
def test_local_matrix_has_the_rank_of_the_gramian(axis, pitch, t):
    """The recursion at one instant, derivatives of F by interpolation."""
    model = scheme(axis, pitch=pitch, earth=False)
    local = local_spectrum(model.matrices, VELOCITY_ROWS, t, SIGMA, model.names, width=5.0)
    whole = spectrum(model_system(model, duration=60.0, sigma=SIGMA))
    assert local.formal == whole.formal
    assert np.array_equal(local.observable(), whole.observable())


def test_local_matrix_against_formulas():
    """Numeric recursion, numeric derivatives, against SymPy's at the same numbers, in Du's axes."""
    model = scheme("Z", pitch=np.arctan(0.75) / DEG)
    jets = derivatives(model.matrices, 0.0, 5, 5.0)
    result = local_matrix(jets, VELOCITY_ROWS, 6)
    symbolic = sym.rotary_model("z", axes="enu", pitch=sp.atan(sp.Rational(3, 4)), order=6)
    R_N, R_E = radii_of_curvature(model.lat)
    values = {
        "g": model.gravity, "W": model.earth_rate, "c": np.cos(model.lat), "s": np.sin(model.lat), "w": model.rate,
        "M": float(R_N), "N": float(R_E),
    }  # fmt: skip
    numbers = {symbolic.constants[k]: v for k, v in values.items()}
    expected = np.array(sym.observability_matrix(symbolic).subs(numbers).evalf(), dtype=float).reshape(6, 3, 12)
    swap = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1.0]])
    # states of Du from ours: velocity, attitude, gyroscope and accelerometer biases
    Q = np.zeros((12, 12))
    Q[0:3, 3:6], Q[3:6, 0:3], Q[6:9, 9:12], Q[9:12, 6:9] = swap, swap, -swap, -swap
    turned = swap @ result @ np.linalg.inv(Q)
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    assert np.abs(turned - expected).max() / scale.max() < 1e-9
    assert np.all(np.abs(turned - expected) / scale < 1e-6)  # rounding, amplified by the fifth derivative


def test_du_axes_are_another_way_to_write_the_same():
    system = model_system(scheme("Z", pitch=30), duration=20.0, sigma=SIGMA, rate_hz=1.0)
    other = in_du_axes(system)
    assert other.names[:6] == ("dv_E", "dv_N", "dv_U", "eps_E", "eps_N", "eps_U")
    a, b = spectrum(system), spectrum(other)
    assert a.values == pytest.approx(b.values, rel=1e-9, abs=1e-9)
    assert sorted(a.observable()) == sorted(b.observable())
    with pytest.raises(InputError, match="north-east-down"):
        in_du_axes(other)


def two_states(**changes):
    """A position measured, its rate not: everything by hand."""
    t = np.arange(5.0)
    step = np.broadcast_to(np.array([[1.0, 1.0], [0.0, 1.0]]), (5, 2, 2)).copy()
    step[0] = np.eye(2)
    H = np.zeros((5, 3, 2))
    H[:, 0, 0] = 1.0
    entries = {"sigma": np.array([2.0, 3.0]), "psd": np.zeros(2)} | changes
    return LinearSystem(("r", "v"), t, step, H, np.arange(5), to_imu=np.eye(3), **entries)


def test_gramian_by_hand():
    """Singular values are the roots of the eigenvalues of ``S sum(Phi' H' H Phi) S``."""
    system = two_states()
    G = sum(np.outer([1.0, k], [1.0, k]) for k in range(5))
    S = np.diag(system.sigma)
    expected = np.sqrt(np.linalg.eigvalsh(S @ G @ S))[::-1]
    assert spectrum(system).values == pytest.approx(expected, rel=1e-13)
    assert spectrum(system, until=0.0).rank == 1
    many = spectra(system, [0.0, 2.0, 4.0])
    assert [s.rank for s in many] == [1, 2, 2]
    assert many[-1].values == pytest.approx(expected, rel=1e-13)


def test_a_state_left_out_counts_as_known():
    assert spectrum(two_states().without(("v",))).values == pytest.approx([2.0 * np.sqrt(5.0)])
    with pytest.raises(InputError, match="no state 'w'"):
        two_states().without(("w",))


def test_other_states_of_the_same_system():
    """Singular values do not change under an orthogonal change of scaled states."""
    system = two_states(sigma=np.array([2.0, 2.0]))
    c, s = np.cos(0.3), np.sin(0.3)
    turned = system.transformed([[c, s], [-s, c]], ("a", "b"))
    assert turned.sigma == pytest.approx([2.0, 2.0])
    assert spectrum(turned).values == pytest.approx(spectrum(system).values, rel=1e-12)


def test_doubt_is_a_bound():
    """Weyl: an error of the transitions moves no singular value by more than the doubt that it causes."""
    rng = np.random.default_rng(3)
    system = model_system(scheme("Z", pitch=30), duration=30.0, sigma=SIGMA, rate_hz=1.0)
    E = 1e-6 * rng.standard_normal(system.phi.shape)
    wrong = two_phi(system, system.phi + E)
    result, other = spectrum(two_phi(system, system.phi, doubt=np.abs(E))), spectrum(wrong)
    assert np.max(np.abs(result.values - other.values)) < result.doubt


def two_phi(system, phi, doubt=None):
    """The system with other transitions from its start."""
    step = phi.copy()
    for k in range(1, len(phi)):
        step[k] = phi[k] @ np.linalg.inv(phi[k - 1])
    return LinearSystem(
        system.names, system.t, step, system.H, system.at, system.sigma, system.psd, system.to_imu, doubt
    )


def test_constant_system_against_the_exponential():
    """A conventional IMU: transitions are powers of one exponential."""
    model = scheme(None)
    system = model_system(model, duration=10.0, sigma=SIGMA, rate_hz=1.0)
    F = model.matrices(np.zeros(1))[0]
    for k, t in enumerate(system.t):
        assert system.phi[k] == pytest.approx(expm(F * t), rel=1e-11, abs=1e-11)


def test_missing_priors_and_bad_shapes():
    with pytest.raises(InputError, match="there is none for v"):
        two_states(sigma=np.array([1.0, 0.0]))
    with pytest.raises(InputError, match="psd: expected shape"):
        two_states(psd=np.zeros(3))
    with pytest.raises(InputError, match="formal"):
        spectrum(two_states()).chosen("best")
