"""Orders of half turns about two axes: what all of them leave, by blocks of one half turn and one dwell each."""

from itertools import product

import numpy as np
import pytest

from schuler import rotation
from schuler.rotary.schemes import _ORDERS
from schuler.units import DEG

RATE, DWELL = 30.0 * DEG, 3.0
MOVE = np.pi / RATE
AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
LETTERS = {"o": (0, 1), "O": (0, -1), "i": (1, 1), "I": (1, -1)}


def block(parity: tuple[int, int], axis: int, sign: int) -> tuple[np.ndarray, np.ndarray]:
    """Integral of (C, C x omega) over a half turn and a dwell, and the integral of that integral. 9 + 27 numbers."""
    x, w = np.polynomial.legendre.leggauss(24)
    x, w = 0.5 * (x + 1.0), 0.5 * w
    angles = np.tile(np.pi * np.array(parity), (24, 1))
    angles[:, axis] += sign * np.pi * x
    outer, inner = (rotation.dcm_from_rotvec(angles[:, k, None] * AXES[k]) for k in (0, 1))
    C = outer @ inner
    omega = sign * RATE * (AXES[0] @ inner if axis == 0 else np.tile(AXES[1], (24, 1)))
    v = np.concatenate((C.reshape(24, 9), np.einsum("nij,nk->nijk", C, omega).reshape(24, 27)), axis=1)
    first, second = MOVE * (w @ v), MOVE**2 * ((w * (1.0 - x)) @ v)
    after = np.pi * (np.array(parity) + np.eye(2)[axis])
    held = rotation.dcm_from_rotvec(after[0] * AXES[0]) @ rotation.dcm_from_rotvec(after[1] * AXES[1])
    rest = np.concatenate((held.ravel(), np.zeros(27)))
    return first + DWELL * rest, second + DWELL * first + 0.5 * DWELL**2 * rest


BLOCKS = {(p, m): block(p, *m) for p in product((0, 1), repeat=2) for m in LETTERS.values()}


def moments(moves) -> tuple[np.ndarray, np.ndarray]:
    """Integral over a cycle, and its mean over the cycle that begins in the middle of a dwell."""
    parity, once, twice = (0, 0), np.zeros(36), np.zeros(36)
    for axis, sign in moves:
        first, second = BLOCKS[parity, (axis, sign)]
        twice += once * (MOVE + DWELL) + second
        once += first
        parity = (parity[0] ^ (axis == 0), parity[1] ^ (axis == 1))
    start = np.concatenate((np.eye(3).ravel(), np.zeros(27))) * 0.5 * DWELL
    return once, twice / (len(moves) * (MOVE + DWELL)) + start


def leaves(moves) -> tuple[float, float]:
    """Largest integral over a cycle of biases [s] and of installation errors [rad]."""
    once, _ = moments(moves)
    return float(np.abs(once[:9]).max()), float(np.abs(once[9:]).max())


@pytest.mark.campaign
def test_no_closed_eight_leaves_neither_and_ours_leaves_less_than_any_other():
    """All closed sequences of eight half turns within a turn of zero, 30 deg/h and 2e-3; exact but for rounding."""
    weights = np.concatenate((np.full(9, 30.0 * DEG / 3600.0), np.full(27, 2e-3)))
    best, ours = np.inf, [LETTERS[m] for m in _ORDERS[8]]
    for moves in product(LETTERS.values(), repeat=8):
        at = np.cumsum([[s * (a == 0), s * (a == 1)] for a, s in moves], axis=0)
        if at[-1].any() or np.abs(at).max() > 2:
            continue
        once, _ = moments(moves)
        assert not np.abs(once).max() < 1e-6
        best = min(best, float(np.linalg.norm(weights * once)))
    assert np.linalg.norm(weights * moments(ours)[0]) < best * (1.0 + 1e-9)


def test_what_our_orders_leave():
    for n, bias, installation in ((4, False, False), (8, False, True), (16, True, True)):
        result = leaves([LETTERS[m] for m in _ORDERS[n]])
        assert (result[0] < 1e-9) is bias, n
        assert (result[1] < 1e-9) is installation, n


def test_sixteen_leave_a_mean_tilt_of_one_installation_error_and_of_four_radians_of_bias_over_the_rate():
    """About a single axis it is one K and 1 / rate of bias: a second axis lowers neither."""
    _, mean = moments([LETTERS[m] for m in _ORDERS[16]])
    assert np.abs(mean[9:]).max() == pytest.approx(1.0)
    assert np.abs(mean[:9]).max() == pytest.approx(4.0 / RATE)
