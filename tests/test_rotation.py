"""Laws of the rotation algebra, hand-written examples, and SciPy as an independent implementation.

Every law runs over stacks of several shapes and over samples that are uniform on the group, normal in the tangent
space, near the identity, and at and near half a turn, where formulas through the trace or through ``arccos`` fail.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from schuler import rotation

EPS = np.finfo(float).eps
PI = np.pi
LAW = settings(max_examples=150, deadline=None, derandomize=True, database=None)

BATCHES = [(), (1,), (5, 1, 4)]


def directions(rng, shape):
    v = rng.standard_normal((*shape, 3))
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def uniform(rng, shape):
    """Uniform on the rotation group, as rotation vectors of length up to pi."""
    q = rng.standard_normal((*shape, 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    q *= np.where(q[..., :1] < 0.0, -1.0, 1.0)
    angle = 2.0 * np.arctan2(np.linalg.norm(q[..., 1:], axis=-1), q[..., 0])[..., None]
    return angle * q[..., 1:] / np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)


def normal(rng, shape):
    """Normal in the tangent space; cut to lengths below half a turn so that the vector itself can come back."""
    v = rng.standard_normal((*shape, 3))
    return v * np.minimum(1.0, 3.0 / np.linalg.norm(v, axis=-1, keepdims=True))


SAMPLERS = {
    "uniform": uniform,
    "normal": normal,
    "near identity": lambda rng, shape: directions(rng, shape) * 10.0 ** rng.uniform(-12.0, -7.0, (*shape, 1)),
    "near half turn": lambda rng, shape: directions(rng, shape) * (PI - 1e-9),
    "half turn": lambda rng, shape: directions(rng, shape) * PI,
    "axes": lambda rng, shape: np.eye(3)[rng.integers(0, 3, shape)] * rng.choice([0.5, 1.0, -0.5], (*shape, 1)) * PI,
    "identity": lambda rng, shape: np.zeros((*shape, 3)),
}
CASES = [(kind, BATCHES[-1]) for kind in SAMPLERS] + [("uniform", shape) for shape in BATCHES[:-1]]


@pytest.fixture(params=CASES, ids=lambda c: f"{c[0]}-{c[1]}".replace(" ", "_"))
def sample(request):
    """Two independent stacks of rotation vectors of one kind, and a generator."""
    kind, shape = request.param
    rng = np.random.default_rng(1)
    return kind, SAMPLERS[kind](rng, shape), SAMPLERS[kind](rng, shape), rng


def transpose(C):
    return np.swapaxes(C, -1, -2)


def assert_same_quat(p, q, atol):
    """Equal up to the sign, element by element of the stack."""
    distance = np.minimum(np.linalg.norm(p - q, axis=-1), np.linalg.norm(p + q, axis=-1))
    assert np.all(distance <= atol), distance.max()


# ---------------------------------------------------------------------------------------------------- skew


@pytest.mark.parametrize("shape", BATCHES)
def test_skew_is_the_cross_product_and_unskew_its_inverse(shape, rng):
    a, b = rng.standard_normal((2, *shape, 3))
    S = rotation.skew(a)
    assert S.shape == (*shape, 3, 3)
    np.testing.assert_allclose((S @ b[..., None])[..., 0], np.cross(a, b), rtol=0, atol=8 * EPS)  # rounding
    np.testing.assert_array_equal(S, -transpose(S))
    np.testing.assert_array_equal(rotation.unskew(S), a)


def test_unskew_ignores_the_symmetric_part(rng):
    A, v = rng.standard_normal((3, 3)), rng.standard_normal(3)
    np.testing.assert_allclose(rotation.unskew(A + A.T + rotation.skew(v)), v, rtol=0, atol=8 * EPS)  # rounding


# --------------------------------------------------------------------------- group axioms, round trips


def test_dcm_of_a_rotation_vector_is_a_rotation(sample):
    _, v, _, _ = sample
    C = rotation.dcm_from_rotvec(v)
    assert C.shape == (*v.shape, 3)
    np.testing.assert_allclose(C @ transpose(C), np.broadcast_to(np.eye(3), C.shape), rtol=0, atol=16 * EPS)  # rounding
    np.testing.assert_allclose(np.linalg.det(C), 1.0, rtol=0, atol=16 * EPS)  # rounding
    np.testing.assert_allclose((C @ v[..., None])[..., 0], v, rtol=0, atol=32 * EPS)  # its own axis stays, rounding


def test_the_opposite_rotation_vector_is_the_inverse(sample):
    _, v, _, _ = sample
    np.testing.assert_allclose(
        rotation.dcm_from_rotvec(-v), transpose(rotation.dcm_from_rotvec(v)), rtol=0, atol=4 * EPS
    )  # rounding
    q = rotation.quat_from_rotvec(v)
    np.testing.assert_array_equal(rotation.quat_from_rotvec(-v), rotation.quat_conjugate(q))
    identity = np.broadcast_to([1.0, 0.0, 0.0, 0.0], q.shape)
    np.testing.assert_allclose(rotation.quat_multiply(q, rotation.quat_conjugate(q)), identity, rtol=0, atol=8 * EPS)


def test_rotations_about_one_axis_add(sample):
    _, v, _, _ = sample
    twice = rotation.dcm_from_rotvec(v) @ rotation.dcm_from_rotvec(0.5 * v)
    np.testing.assert_allclose(rotation.dcm_from_rotvec(1.5 * v), twice, rtol=0, atol=32 * EPS)  # rounding


def test_rotvec_survives_the_quaternion(sample):
    kind, v, _, _ = sample
    back = rotation.rotvec_from_quat(rotation.quat_from_rotvec(v))
    if kind in ("half turn", "axes"):  # v and -v are one rotation there
        back = back * np.where(np.sum(back * v, axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    size = np.linalg.norm(v, axis=-1)
    # rounding; relative to the vector's own length, however short it is
    assert np.all(np.linalg.norm(back - v, axis=-1) <= 16 * EPS * size)


def test_rotvec_survives_the_matrix(sample):
    kind, v, _, _ = sample
    back = rotation.rotvec_from_dcm(rotation.dcm_from_rotvec(v))
    size = np.linalg.norm(v, axis=-1)
    if kind == "near identity":  # rounding, relative: the antisymmetric part holds every digit
        assert np.all(np.linalg.norm(back - v, axis=-1) <= 16 * EPS * size)
        return
    assert_same_quat(rotation.quat_from_rotvec(back), rotation.quat_from_rotvec(v), 16 * EPS)  # rounding
    if kind in ("uniform", "normal", "near half turn"):
        assert np.all(np.linalg.norm(back - v, axis=-1) <= 64 * EPS * np.maximum(size, 1.0))  # rounding


def test_rotation_vectors_that_come_back_are_at_most_half_a_turn(sample):
    _, v, _, _ = sample
    for factor in (1.0, 2.0, 3.7, -5.2):
        q = rotation.quat_from_rotvec(factor * v)
        for back in (rotation.rotvec_from_quat(q), rotation.rotvec_from_quat(-q)):
            assert np.all(np.linalg.norm(back, axis=-1) <= PI * (1.0 + 4 * EPS))  # rounding of the norm
            assert_same_quat(rotation.quat_from_rotvec(back), q, 32 * EPS)  # rounding


def test_quaternion_and_matrix_describe_the_same_rotation(sample):
    _, v, _, _ = sample
    q, C = rotation.quat_from_rotvec(v), rotation.dcm_from_rotvec(v)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1.0, rtol=0, atol=4 * EPS)  # rounding
    np.testing.assert_allclose(rotation.dcm_from_quat(q), C, rtol=0, atol=16 * EPS)  # rounding
    back = rotation.quat_from_dcm(C)
    assert np.all(back[..., 0] >= 0.0)
    assert_same_quat(back, q, 16 * EPS)  # rounding
    np.testing.assert_array_equal(rotation.dcm_from_quat(-q), rotation.dcm_from_quat(q))


def test_products_of_quaternions_and_of_matrices_have_the_same_order(sample):
    """``C_ac = C_ab @ C_bc`` and ``q_ac = q_ab q_bc``."""
    _, v_ab, v_bc, _ = sample
    q_ab, q_bc = rotation.quat_from_rotvec(v_ab), rotation.quat_from_rotvec(v_bc)
    C_ac = rotation.dcm_from_rotvec(v_ab) @ rotation.dcm_from_rotvec(v_bc)
    q_ac = rotation.quat_multiply(q_ab, q_bc)
    assert q_ac.shape == q_ab.shape
    np.testing.assert_allclose(rotation.dcm_from_quat(q_ac), C_ac, rtol=0, atol=32 * EPS)  # rounding
    np.testing.assert_allclose(np.linalg.norm(q_ac, axis=-1), 1.0, rtol=0, atol=8 * EPS)  # rounding


def test_quaternion_product_is_associative_and_reverses_under_inversion(sample):
    _, u, v, rng = sample
    p, q = rotation.quat_from_rotvec(u), rotation.quat_from_rotvec(v)
    r = rotation.quat_from_rotvec(normal(rng, u.shape[:-1]))
    mul = rotation.quat_multiply
    np.testing.assert_allclose(mul(mul(p, q), r), mul(p, mul(q, r)), rtol=0, atol=8 * EPS)  # rounding
    conj = rotation.quat_conjugate
    np.testing.assert_allclose(conj(mul(p, q)), mul(conj(q), conj(p)), rtol=0, atol=4 * EPS)  # rounding


def test_rotate_is_multiplication_by_the_matrix(sample):
    _, v, _, rng = sample
    x_b = rng.standard_normal(v.shape)
    q = rotation.quat_from_rotvec(v)
    x_a = rotation.rotate(q, x_b)
    np.testing.assert_allclose(x_a, (rotation.dcm_from_rotvec(v) @ x_b[..., None])[..., 0], rtol=0, atol=64 * EPS)
    np.testing.assert_allclose(rotation.rotate(rotation.quat_conjugate(q), x_a), x_b, rtol=0, atol=64 * EPS)
    np.testing.assert_allclose(np.linalg.norm(x_a, axis=-1), np.linalg.norm(x_b, axis=-1), rtol=16 * EPS)  # rounding


def test_axes_change_with_the_frame(sample):
    """Frame invariance: a turn seen from other axes has the rotated rotation vector, ``C [v x] C' = [C v x]``."""
    _, u, v, _ = sample
    C = rotation.dcm_from_rotvec(u)
    seen = (C @ v[..., None])[..., 0]
    np.testing.assert_allclose(
        rotation.dcm_from_rotvec(seen), C @ rotation.dcm_from_rotvec(v) @ transpose(C), rtol=0, atol=64 * EPS
    )  # rounding


def test_scipy_agrees(sample):
    _, u, v, rng = sample
    q, C = rotation.quat_from_rotvec(u), rotation.dcm_from_rotvec(u)
    flat = Rotation.from_rotvec(u.reshape(-1, 3))
    np.testing.assert_allclose(C.reshape(-1, 3, 3), flat.as_matrix(), rtol=0, atol=16 * EPS)  # rounding
    assert_same_quat(q.reshape(-1, 4), flat.as_quat(scalar_first=True), 8 * EPS)  # rounding
    both = flat * Rotation.from_rotvec(v.reshape(-1, 3))
    product_q = rotation.quat_multiply(q, rotation.quat_from_rotvec(v))
    assert_same_quat(product_q.reshape(-1, 4), both.as_quat(scalar_first=True), 16 * EPS)  # rounding
    x = rng.standard_normal(u.shape)
    np.testing.assert_allclose(
        rotation.rotate(q, x).reshape(-1, 3), flat.apply(x.reshape(-1, 3)), rtol=0, atol=64 * EPS
    )  # rounding


def test_rodrigues_formula_is_the_matrix_exponential(rng):
    for v in rng.standard_normal((20, 3)):
        # rounding of the general exponential, which scales and squares
        np.testing.assert_allclose(rotation.dcm_from_rotvec(v), expm(rotation.skew(v)), rtol=0, atol=1e-13)


def test_long_rotation_vectors_wind_around(rng):
    """A vector longer than a turn is the same rotation as the remainder."""
    axis = directions(rng, (20,))
    for turns in (1, 2, 5):
        np.testing.assert_allclose(
            rotation.dcm_from_rotvec(axis * (0.7 + 2.0 * PI * turns)), rotation.dcm_from_rotvec(0.7 * axis), atol=1e-14
        )  # rounding: 2 pi n is only known to eps of itself


@pytest.mark.parametrize("length", [1e-16, 1e-100, 1e-160, 1e-300, 5e-324])
def test_tiny_rotation_vectors_are_not_lost(length):
    """No threshold below which a turn becomes none, and no division by zero."""
    v = np.array([0.6, 0.0, -0.8]) * length
    back = rotation.rotvec_from_quat(rotation.quat_from_rotvec(v))
    np.testing.assert_allclose(back, v, rtol=8 * EPS, atol=1e-323)  # rounding; subnormal numbers have no more digits
    np.testing.assert_allclose(rotation.unskew(rotation.dcm_from_rotvec(v)), v, rtol=8 * EPS, atol=1e-323)


UNIT_QUATERNIONS = (
    arrays(np.float64, 4, elements=st.floats(-1.0, 1.0, allow_subnormal=False))
    .filter(lambda q: np.linalg.norm(q) > 1e-3)
    .map(lambda q: q / np.linalg.norm(q))
)


@LAW
@given(UNIT_QUATERNIONS)
def test_any_unit_quaternion_survives_matrix_and_rotation_vector(q):
    C = rotation.dcm_from_quat(q)
    np.testing.assert_allclose(C @ C.T, np.eye(3), rtol=0, atol=16 * EPS)  # rounding
    assert_same_quat(rotation.quat_from_dcm(C), q, 16 * EPS)  # rounding
    assert_same_quat(rotation.quat_from_rotvec(rotation.rotvec_from_quat(q)), q, 16 * EPS)  # rounding


@LAW
@given(UNIT_QUATERNIONS, UNIT_QUATERNIONS)
def test_any_two_unit_quaternions_multiply_like_their_matrices(p, q):
    np.testing.assert_allclose(
        rotation.dcm_from_quat(rotation.quat_multiply(p, q)),
        rotation.dcm_from_quat(p) @ rotation.dcm_from_quat(q),
        rtol=0,
        atol=32 * EPS,
    )  # rounding


@pytest.mark.parametrize("w_sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0.6, 0, 0.8), (-0.6, -0.8, 0)])
def test_exact_half_turns(axis, w_sign):
    """``C = 2 a a' - 1``; the quaternion has no scalar part and the rotation vector length pi either way round."""
    a = np.array(axis, dtype=float)
    C = 2.0 * np.outer(a, a) - np.eye(3)
    np.testing.assert_allclose(rotation.dcm_from_quat([w_sign * 0.0, *a]), C, rtol=0, atol=4 * EPS)  # rounding
    assert_same_quat(rotation.quat_from_dcm(C), np.array([0.0, *a]), 4 * EPS)  # rounding
    v = rotation.rotvec_from_dcm(C)
    np.testing.assert_allclose(abs(v @ a), PI, rtol=4 * EPS)  # rounding
    np.testing.assert_allclose(rotation.rotvec_from_quat([w_sign * 0.0, *a]) @ a, PI, rtol=4 * EPS)  # rounding


# ------------------------------------------------------------------------------------- examples by hand


def test_hamilton_rules():
    """ij = k, jk = i, ki = j, ii = jj = kk = -1: the product is Hamilton's, not the reversed one."""
    one, i, j, k = np.eye(4)
    mul = rotation.quat_multiply
    for a, b, ab in (
        (i, j, k),
        (j, k, i),
        (k, i, j),
        (j, i, -k),
        (i, i, -one),
        (j, j, -one),
        (k, k, -one),
        (one, j, j),
    ):
        np.testing.assert_array_equal(mul(a, b), ab)


def test_quarter_turn_about_down_by_hand():
    """Yaw of 90 deg: the nose (body x) points east, the right wing (body y) south."""
    yaw = np.array([0.0, 0.0, 0.5 * PI])
    expected = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    for C_nb in (
        rotation.dcm_from_rpy(yaw),
        rotation.dcm_from_rotvec(yaw),
        rotation.dcm_from_quat(rotation.quat_from_rpy(yaw)),
    ):
        np.testing.assert_allclose(C_nb, expected, rtol=0, atol=2 * EPS)  # rounding
        np.testing.assert_allclose(C_nb @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], rtol=0, atol=2 * EPS)
        np.testing.assert_allclose(C_nb @ [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], rtol=0, atol=2 * EPS)
    np.testing.assert_allclose(
        rotation.rotate(rotation.quat_from_rpy(yaw), [1.0, 0.0, 0.0]), [0.0, 1.0, 0.0], rtol=0, atol=2 * EPS
    )
    half = np.sqrt(0.5)
    np.testing.assert_allclose(rotation.quat_from_rpy(yaw), [half, 0.0, 0.0, half], rtol=0, atol=2 * EPS)


@pytest.mark.parametrize(
    ("rpy", "body", "nav"),
    [
        ((0.0, 0.5 * PI, 0.0), (1, 0, 0), (0, 0, -1)),  # pitch 90 deg: the nose points up
        ((0.0, 0.5 * PI, 0.0), (0, 0, 1), (1, 0, 0)),  # ... and the belly north
        ((0.5 * PI, 0.0, 0.0), (0, 1, 0), (0, 0, 1)),  # roll 90 deg: the right wing points down
        ((0.5 * PI, 0.0, 0.0), (0, 0, 1), (0, -1, 0)),  # ... and the belly west
        ((PI, 0.0, 0.0), (0, 0, 1), (0, 0, -1)),  # inverted
        ((0.0, PI / 6.0, 0.0), (1, 0, 0), (np.sqrt(0.75), 0, -0.5)),
        ((0.0, 0.0, PI / 6.0), (1, 0, 0), (np.sqrt(0.75), 0.5, 0)),
        ((0.5 * PI, 0.0, 0.5 * PI), (0, 1, 0), (0, 0, 1)),  # yaw first: the wing that points south comes down
        ((0.0, 0.5 * PI, 0.5 * PI), (0, 0, 1), (0, 1, 0)),
    ],
)
def test_euler_angles_turn_the_body_the_way_pilots_mean(rpy, body, nav):
    np.testing.assert_allclose(rotation.dcm_from_rpy(rpy) @ np.array(body), nav, rtol=0, atol=4 * EPS)  # rounding
    np.testing.assert_allclose(
        rotation.rotate(rotation.quat_from_rpy(rpy), body), nav, rtol=0, atol=8 * EPS
    )  # rounding


def test_numbers_of_one_matrix_by_hand():
    """Roll 30, pitch 0, yaw 90 deg, every element written out."""
    s, c = 0.5, np.sqrt(0.75)
    expected = np.array([[0.0, -c, s], [1.0, 0.0, 0.0], [0.0, s, c]])
    np.testing.assert_allclose(rotation.dcm_from_rpy([PI / 6, 0.0, PI / 2]), expected, rtol=0, atol=2 * EPS)  # rounding


# ---------------------------------------------------------------------------------------- Euler angles


def elementary(rpy):
    """Stefanisko (2015), eq. (1.5) with the signs corrected: ``C_bn`` as a product of three plane rotations."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    R1 = np.array([[1, 0, 0], [0, cr, sr], [0, -sr, cr]])
    R2 = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
    R3 = np.array([[cy, sy, 0], [-sy, cy, 0], [0, 0, 1]])
    return R1 @ R2 @ R3


def random_rpy(rng, shape, pitch_limit=0.499 * PI):
    return np.stack(
        (rng.uniform(-PI, PI, shape), rng.uniform(-pitch_limit, pitch_limit, shape), rng.uniform(-PI, PI, shape)),
        axis=-1,
    )


@pytest.mark.parametrize("shape", BATCHES)
def test_rpy_survive_matrix_and_quaternion(shape, rng):
    rpy = random_rpy(rng, shape)
    # rounding, amplified by 1 / cos(pitch) < 320
    np.testing.assert_allclose(rotation.rpy_from_dcm(rotation.dcm_from_rpy(rpy)), rpy, rtol=0, atol=1000 * EPS)
    np.testing.assert_allclose(rotation.rpy_from_quat(rotation.quat_from_rpy(rpy)), rpy, rtol=0, atol=4000 * EPS)
    np.testing.assert_allclose(
        rotation.dcm_from_quat(rotation.quat_from_rpy(rpy)), rotation.dcm_from_rpy(rpy), rtol=0, atol=8 * EPS
    )  # rounding


def test_rpy_matrix_is_the_product_of_three_plane_rotations(rng):
    for rpy in random_rpy(rng, (50,)):
        np.testing.assert_allclose(rotation.dcm_from_rpy(rpy), elementary(rpy).T, rtol=0, atol=4 * EPS)  # rounding
        roll, pitch, yaw = (rotation.dcm_from_rotvec(a * e) for a, e in zip(rpy, np.eye(3), strict=True))
        np.testing.assert_allclose(rotation.dcm_from_rpy(rpy), yaw @ pitch @ roll, rtol=0, atol=8 * EPS)  # rounding


def test_scipy_agrees_on_euler_angles(rng):
    """Intrinsic z-y-x is SciPy's upper-case ``ZYX``."""
    rpy = random_rpy(rng, (200,), 0.49 * PI)
    theirs = Rotation.from_euler("ZYX", rpy[:, ::-1])
    np.testing.assert_allclose(rotation.dcm_from_rpy(rpy), theirs.as_matrix(), rtol=0, atol=8 * EPS)  # rounding
    assert_same_quat(rotation.quat_from_rpy(rpy), theirs.as_quat(scalar_first=True), 8 * EPS)  # rounding
    # rounding, amplified by 1 / cos(pitch) < 32
    np.testing.assert_allclose(
        rotation.rpy_from_dcm(theirs.as_matrix()), theirs.as_euler("ZYX")[:, ::-1], rtol=0, atol=200 * EPS
    )


def test_dual_euler_solution(rng):
    """(roll + pi, pi - pitch, yaw + pi) is the same attitude (Stefanisko, after eq. (1.5))."""
    rpy = random_rpy(rng, (50,))
    dual = rpy * [1.0, -1.0, 1.0] + PI
    np.testing.assert_allclose(
        rotation.dcm_from_rpy(dual), rotation.dcm_from_rpy(rpy), rtol=0, atol=16 * EPS
    )  # rounding
    assert_same_quat(rotation.quat_from_rpy(dual), rotation.quat_from_rpy(rpy), 8 * EPS)  # rounding
    # rounding, amplified by 1 / cos(pitch) < 320
    np.testing.assert_allclose(rotation.rpy_from_dcm(rotation.dcm_from_rpy(dual)), rpy, rtol=0, atol=1000 * EPS)


def test_rpy_of_any_rotation_return_its_matrix_within_their_ranges(sample):
    _, v, _, _ = sample
    C = rotation.dcm_from_rotvec(v)
    rpy = rotation.rpy_from_dcm(C)
    assert np.all(np.abs(rpy[..., 1]) <= 0.5 * PI)
    assert np.all(np.abs(rpy[..., [0, 2]]) <= PI)
    np.testing.assert_allclose(rotation.dcm_from_rpy(rpy), C, rtol=0, atol=32 * EPS)  # rounding


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-9, 9e-7])
def test_vertical_pitch_puts_all_motion_into_yaw(sign, off, rng):
    """Gimbal lock as documented: no roll, and the matrix comes back to 1e-6."""
    roll, yaw = rng.uniform(-PI, PI, (2, 100))
    rpy = np.stack((roll, np.full(100, sign * (0.5 * PI - off)), yaw), axis=-1)
    C = rotation.dcm_from_rpy(rpy)
    back = rotation.rpy_from_dcm(C)
    np.testing.assert_array_equal(back[:, 0], 0.0)
    # rounding: the cosine decides here, the sine at its top would lose half the digits
    np.testing.assert_allclose(back[:, 1], rpy[:, 1], rtol=0, atol=4 * EPS)
    turned = back[:, 2] - (yaw - sign * roll)
    np.testing.assert_allclose(np.sin(0.5 * turned), 0.0, rtol=0, atol=0.51 * off + 8 * EPS)  # the documented 1e-6
    np.testing.assert_allclose(rotation.dcm_from_rpy(back), C, rtol=0, atol=2.0 * off + 8 * EPS)  # the documented 1e-6
    through_quat = rotation.rpy_from_quat(rotation.quat_from_rpy(rpy))
    np.testing.assert_array_equal(through_quat[:, 0], 0.0)
    np.testing.assert_allclose(rotation.dcm_from_rpy(through_quat), C, rtol=0, atol=2.0 * off + 16 * EPS)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_just_outside_gimbal_lock_the_angles_are_still_told_apart(sign, rng):
    roll, yaw = rng.uniform(-3.0, 3.0, (2, 100))
    rpy = np.stack((roll, np.full(100, sign * (0.5 * PI - 1.2e-6)), yaw), axis=-1)
    # rounding, amplified by 1 / cos(pitch) = 8e5
    np.testing.assert_allclose(rotation.rpy_from_dcm(rotation.dcm_from_rpy(rpy)), rpy, rtol=0, atol=4e6 * EPS)


@pytest.mark.parametrize("zero", [0.0, -0.0])
@pytest.mark.parametrize("diagonal", [(-1.0, -1.0, 1.0), (1.0, -1.0, -1.0)])
def test_half_turns_of_roll_and_yaw_are_plus_pi_whatever_the_sign_of_a_zero(diagonal, zero):
    """Roll and yaw lie in (-pi, pi]; a matrix element of minus zero must not make them -pi."""
    C = np.full((3, 3), zero)
    np.fill_diagonal(C, diagonal)
    rpy = rotation.rpy_from_dcm(C)
    assert rpy[2 if diagonal[2] > 0 else 0] == PI


# ---------------------------------------------------------------------------------------- derivatives


def derivative(function, t, step):
    """Five-point central difference, error of order step^4."""
    return (8.0 * (function(t + step) - function(t - step)) - (function(t + 2 * step) - function(t - 2 * step))) / (
        12.0 * step
    )


def test_body_rate_of_euler_angles_is_the_derivative_of_the_matrix(rng):
    """``dC_nb/dt = C_nb [omega_nb_b x]`` and ``dq/dt = q [0, omega] / 2`` (Stefanisko, eq. (1.7))."""
    for rpy, rate in zip(random_rpy(rng, (50,), 1.5), rng.standard_normal((50, 3)), strict=True):
        omega = rotation.body_rate_from_rpy(rpy, rate)

        def C(t, rpy=rpy, rate=rate):
            return rotation.dcm_from_rpy(rpy + t * rate)

        def q(t, rpy=rpy, rate=rate):
            return rotation.quat_from_rpy(rpy + t * rate)

        # discretisation of the difference: |rate|^5 step^4 / 30
        np.testing.assert_allclose(derivative(C, 0.0, 1e-3), C(0.0) @ rotation.skew(omega), rtol=0, atol=2e-9)
        expected = 0.5 * rotation.quat_multiply(q(0.0), np.array([0.0, *omega]))
        np.testing.assert_allclose(derivative(q, 0.0, 1e-3), expected, rtol=0, atol=2e-9)


def test_body_rate_by_hand():
    """Level flight: yaw rate is the z rate. Wings vertical (roll 90 deg): the same yaw rate is a pitch rate."""
    np.testing.assert_allclose(rotation.body_rate_from_rpy([0, 0, 1.0], [0, 0, 0.3]), [0, 0, 0.3], atol=EPS)
    np.testing.assert_allclose(rotation.body_rate_from_rpy([PI / 2, 0, 1.0], [0, 0, 0.3]), [0, 0.3, 0], atol=EPS)
    np.testing.assert_allclose(rotation.body_rate_from_rpy([0, PI / 2, 1.0], [0, 0, 0.3]), [-0.3, 0, 0], atol=EPS)
    np.testing.assert_allclose(rotation.body_rate_from_rpy([0.4, 0.2, 1.0], [0.3, 0, 0]), [0.3, 0, 0], atol=EPS)


def test_derivative_of_the_matrix_of_a_steady_turn(rng):
    """``C(t) = C_0 exp([w t x])``: ``dC/dt = C [w x]``, the law every mechanization integrates."""
    for v, w in rng.standard_normal((50, 2, 3)):
        C_0 = rotation.dcm_from_rotvec(v)

        def C(t, C_0=C_0, w=w):
            return C_0 @ rotation.dcm_from_rotvec(w * t)

        # discretisation of the difference, |w|^5 step^4 / 30
        np.testing.assert_allclose(derivative(C, 0.3, 1e-3), C(0.3) @ rotation.skew(w), rtol=0, atol=2e-9)


def test_a_small_turn_in_the_navigation_axes_multiplies_from_the_left(rng):
    """The attitude error of the package: ``C_hat = exp([dpsi_n x]) C_nb`` differs by ``[dpsi x] C`` at first order."""
    dpsi = 1e-6 * rng.standard_normal(3)
    C = rotation.dcm_from_rpy([0.3, -0.2, 2.0])
    np.testing.assert_allclose(
        rotation.dcm_from_rotvec(dpsi) @ C - C, rotation.skew(dpsi) @ C, rtol=0, atol=1e-11
    )  # second order


# ------------------------------------------------------------------------------- orthonormalisation


def test_orthonormalise_leaves_rotations_alone(sample):
    _, v, _, _ = sample
    C = rotation.dcm_from_rotvec(v)
    np.testing.assert_allclose(rotation.orthonormalise(C), C, rtol=0, atol=32 * EPS)  # rounding


def test_orthonormalise_is_the_polar_factor(sample):
    """``C P`` with P symmetric and positive definite gives back ``C``."""
    _, v, _, rng = sample
    C = rotation.dcm_from_rotvec(v)
    A = 0.2 * rng.standard_normal(C.shape)
    P = np.eye(3) + A @ transpose(A)
    np.testing.assert_allclose(rotation.orthonormalise(C @ P), C, rtol=0, atol=64 * EPS)  # rounding


def test_orthonormalise_finds_no_nearer_rotation(rng):
    M = rotation.dcm_from_rotvec(rng.standard_normal(3)) + 0.1 * rng.standard_normal((3, 3))
    best = rotation.orthonormalise(M)
    here = np.linalg.norm(best - M)
    for v in np.concatenate((1e-3 * directions(rng, (200,)), normal(rng, (200,)))):
        assert np.linalg.norm(best @ rotation.dcm_from_rotvec(v) - M) > here


def test_orthonormalise_never_returns_a_reflection():
    C = rotation.orthonormalise(
        np.stack((np.diag([1.0, 1.0, -0.2]), np.diag([-1.0, -1.0, -1.0]), np.diag([2.0, 3, 4])))
    )
    np.testing.assert_allclose(np.linalg.det(C), 1.0, rtol=0, atol=16 * EPS)  # rounding
    np.testing.assert_allclose(C @ transpose(C), np.broadcast_to(np.eye(3), C.shape), rtol=0, atol=16 * EPS)
    np.testing.assert_allclose(C[0], np.eye(3), rtol=0, atol=16 * EPS)  # the weakest axis turns round
    np.testing.assert_allclose(C[2], np.eye(3), rtol=0, atol=16 * EPS)


# ------------------------------------------------------------------------------------- interpolation


def test_interpolation_of_a_steady_turn_is_exact(rng):
    """At a constant body rate every attitude between unevenly spaced nodes is known in closed form."""
    q_0, w = rotation.quat_from_rotvec(rng.standard_normal(3)), np.array([0.8, -1.1, 0.5])
    nodes = np.cumsum(rng.uniform(0.05, 1.5, 20))  # up to 2.2 rad from one to the next

    def truth(t):
        return rotation.quat_multiply(q_0, rotation.quat_from_rotvec(t[:, None] * w))

    q_nodes = truth(nodes) * rng.choice([-1.0, 1.0], 20)[:, None]  # a node and its negative are the same
    t = rng.uniform(nodes[0], nodes[-1], 500)
    q = rotation.interpolate_quat(t, nodes, q_nodes)
    assert_same_quat(q, truth(t), 64 * EPS)  # rounding; angles of up to 20 rad
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1.0, rtol=0, atol=16 * EPS)  # rounding


def test_interpolation_passes_the_nodes_and_holds_the_ends(rng):
    nodes = np.array([1.0, 1.5, 4.0])
    q_nodes = rotation.quat_from_rotvec(rng.standard_normal((3, 3)))
    assert_same_quat(rotation.interpolate_quat(nodes, nodes, q_nodes), q_nodes, 8 * EPS)  # rounding
    held = rotation.interpolate_quat([-5.0, 0.999, 4.001, 1e9], nodes, q_nodes)
    assert_same_quat(held, q_nodes[[0, 0, 2, 2]], 8 * EPS)  # rounding


def test_interpolation_goes_the_short_way_round():
    q = rotation.quat_from_rpy([[0.0, 0.0, 0.9 * PI], [0.0, 0.0, -0.9 * PI]])
    middle = rotation.interpolate_quat([0.5], [0.0, 1.0], q)
    assert_same_quat(middle, rotation.quat_from_rpy([[0.0, 0.0, PI]]), 8 * EPS)  # rounding


def test_interpolation_of_one_node_holds_it():
    q = np.array([[0.5, 0.5, -0.5, 0.5]])
    out = rotation.interpolate_quat([0.0, 1.0, 2.0], [1.0], q)
    np.testing.assert_array_equal(out, np.repeat(q, 3, axis=0))
    out[0] = 0.0  # a copy of its own, not a view of the argument
    assert q[0, 0] == 0.5


# --------------------------------------------------------------------------------------------- stacks


STACKED = [
    (rotation.skew, "v"),
    (rotation.dcm_from_rotvec, "v"),
    (rotation.quat_from_rotvec, "v"),
    (rotation.dcm_from_rpy, "v"),
    (rotation.quat_from_rpy, "v"),
    (rotation.body_rate_from_rpy, "vv"),
    (rotation.unskew, "C"),
    (rotation.rotvec_from_dcm, "C"),
    (rotation.quat_from_dcm, "C"),
    (rotation.rpy_from_dcm, "C"),
    (rotation.orthonormalise, "C"),
    (rotation.rotvec_from_quat, "q"),
    (rotation.dcm_from_quat, "q"),
    (rotation.quat_conjugate, "q"),
    (rotation.rpy_from_quat, "q"),
    (rotation.quat_multiply, "qq"),
    (rotation.rotate, "qv"),
]


@pytest.mark.parametrize(("function", "signature"), STACKED, ids=lambda x: getattr(x, "__name__", x))
def test_a_stack_is_a_loop(function, signature, rng):
    shape = (2, 3)
    for sampler in SAMPLERS.values():
        vectors = [sampler(rng, shape) for _ in signature]
        ways = {"v": np.copy, "q": rotation.quat_from_rotvec, "C": rotation.dcm_from_rotvec}
        arguments = [ways[letter](v) for letter, v in zip(signature, vectors, strict=True)]
        kept = [a.copy() for a in arguments]
        stacked = function(*arguments)
        assert stacked.dtype == np.float64
        for index in np.ndindex(shape):
            # rounding: SIMD and scalar code of NumPy may differ in the last place
            np.testing.assert_allclose(
                stacked[index], function(*(a[index] for a in arguments)), rtol=8 * EPS, atol=4 * EPS
            )
        for a, b in zip(arguments, kept, strict=True):
            np.testing.assert_array_equal(a, b)  # arguments are left alone


def test_an_empty_stack_gives_an_empty_stack():
    for function, signature in STACKED:
        tail = {"v": (3,), "q": (4,), "C": (3, 3)}
        assert function(*(np.empty((0, *tail[letter])) for letter in signature)).shape[0] == 0


def test_one_attitude_broadcasts_over_many_vectors(rng):
    q, v = rotation.quat_from_rotvec(rng.standard_normal(3)), rng.standard_normal((5, 3))
    np.testing.assert_allclose(
        rotation.rotate(q, v), v @ rotation.dcm_from_quat(q).T, rtol=0, atol=32 * EPS
    )  # rounding


def test_lists_of_integers_are_taken():
    np.testing.assert_array_equal(rotation.rotate([1, 0, 0, 0], [1, 2, 3]), [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(rotation.dcm_from_rpy([0, 0, 0]), np.eye(3))
    assert rotation.quat_multiply([1, 0, 0, 0], [0, 1, 0, 0]).dtype == np.float64


@pytest.mark.parametrize("length", [1e-300, 1e-200, 1e-155, 1e-140])
def test_rotation_vectors_too_small_to_square_survive_the_quaternion(length):
    """Twice the vector part at the smallest turns: sine and angle are both rounded to nothing there."""
    vector = length * np.array([0.6, -0.48, 0.64])
    back = rotation.rotvec_from_quat(np.concatenate(([1.0], 0.5 * vector)))
    np.testing.assert_allclose(back, vector, rtol=1e-12)
