"""Integers of an epoch from a predicted position: against truth, counted, forgotten, and the position they give."""

from __future__ import annotations

import numpy as np
import pytest

from schuler.gnss.ambiguities import decorrelate, success_rate
from schuler.gnss.integers import HeldIntegers, Measured, _covariance, _float, _largest_success, fix_epoch

CYCLE, CYCLE_2 = 0.1903, 0.2442
CODE, PHASE = 0.5, 0.003


def epoch(rng, directions, cycles, d=(0.0, 0.0, 0.0), *, arc=0, code=CODE, phase=PHASE, kinds=2) -> Measured:
    """Measurements of an antenna at ``d`` from the prediction; clocks of 30 m and more in each kind."""
    m = len(directions)
    kind = np.arange(m) % kinds
    true = -directions @ np.asarray(d) + 30.0 + 12.0 * kind
    return Measured(
        np.arange(m) + 101, np.full(m, arc), kind, true + CYCLE * cycles + phase * rng.standard_normal(m),
        true + code * rng.standard_normal(m), np.full(m, PHASE), np.full(m, CODE), np.full(m, CYCLE),
        np.arcsin(directions[:, 2]), -directions,
    )  # fmt: skip


def sky(rng, m=14):
    up = rng.standard_normal((m, 3))
    up[:, 2] = 0.3 + np.abs(up[:, 2])
    return up / np.linalg.norm(up, axis=1)[:, None]


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_integers_and_position_are_the_true_ones(rng, sign):
    """Prediction good to 0.2 m: after three epochs the position is that of the phases alone, 5 sigma statistical."""
    u, cycles = sky(rng), rng.integers(-500, 500, 14)
    held, P = HeldIntegers(), 0.2**2 * np.eye(3)
    d = sign * np.array([0.2, -0.1, 0.15])
    for k in range(3):
        fix = fix_epoch(epoch(rng, u, cycles, d), P, held)
        assert (fix is None) == (k < 2)
    number = np.array([held.number[s] for s in range(101, 115)])
    for kind in (0, 1):  # equal but for one number of the kind
        assert len(np.unique((number - cycles)[kind::2])) == 1
    assert fix.used.all()
    assert np.all(np.abs(fix.offset - d) < 5.0 * np.sqrt(np.diag(fix.cov)))
    assert np.sqrt(np.diag(fix.cov)).max() < 0.02


def test_the_position_is_least_squares_of_the_phases(rng):
    """Twin: unknown position and a clock of each kind, phases weighted each by its own noise. Rounding."""
    u, cycles = sky(rng), rng.integers(-500, 500, 14)
    held = HeldIntegers()
    for _ in range(3):
        e = epoch(rng, u, cycles, (0.1, 0.0, -0.1))
        fix = fix_epoch(e, 0.2**2 * np.eye(3), held)
    number = np.array([held.number[int(s)] for s in e.sat])
    A = np.column_stack((e.gradient, e.kind == 0, e.kind == 1)) / PHASE
    x, *_ = np.linalg.lstsq(A, (e.carrier - CYCLE * number) / PHASE, rcond=None)
    cov = np.linalg.inv(A.T @ A)[:3, :3]
    np.testing.assert_allclose(fix.offset, x[:3], atol=1e-7)
    np.testing.assert_allclose(fix.cov, cov, rtol=1e-4)


def test_one_difference_measures_one_direction(rng):
    """With two satellites of a kind left the fix is a line of sight's, and a kilometre across."""
    u, cycles = sky(rng), rng.integers(-500, 500, 14)
    held = HeldIntegers()
    for _ in range(3):
        fix_epoch(epoch(rng, u, cycles), 0.2**2 * np.eye(3), held)
    e = epoch(rng, u, cycles, (0.05, 0.0, 0.0))
    two = Measured(**{name: getattr(e, name)[[0, 2]] for name in e.__dataclass_fields__})
    fix = fix_epoch(two, 0.2**2 * np.eye(3), held)
    sigma = np.sqrt(np.linalg.eigvalsh(fix.cov))
    assert sigma[0] < 0.02
    assert np.all(sigma[1:] > 900.0)
    along = (u[0] - u[2]) / np.linalg.norm(u[0] - u[2])
    assert abs(along @ (fix.offset - (0.05, 0.0, 0.0))) < 5.0 * sigma[0]


def test_a_poor_prediction_fixes_nothing(rng):
    """Codes and a prediction of ten metres: the success rate of one frequency is not enough."""
    held = HeldIntegers()
    u = sky(rng, 7)
    for _ in range(5):
        assert fix_epoch(epoch(rng, u, np.zeros(7)), 10.0**2 * np.eye(3), held) is None
    assert not held.number


def test_a_new_arc_begins_anew_and_is_fixed_by_the_others(rng):
    u, cycles = sky(rng), rng.integers(-500, 500, 14)
    held, P = HeldIntegers(), 0.2**2 * np.eye(3)
    for _ in range(3):
        fix_epoch(epoch(rng, u, cycles), P, held)
    cycles[4] += 3
    for k in range(3):
        e = epoch(rng, u, cycles)
        e.arc[4] = 1
        fix = fix_epoch(e, P, held)
        assert bool(fix.used[4]) == (k == 2)
        assert np.delete(fix.used, 4).all()
    assert held.contradicted == 0


@pytest.mark.parametrize("cycles", [4, -9])
def test_held_integers_that_codes_contradict_are_given_up(rng, cycles):
    """All phases but one of a kind jump unsaid: neither codes nor prediction follow."""
    u, n = sky(rng), rng.integers(-500, 500, 14)
    held = HeldIntegers()
    for _ in range(3):
        fix_epoch(epoch(rng, u, n), 0.2**2 * np.eye(3), held)
    n[2::2] += cycles * np.arange(1, 7)
    assert fix_epoch(epoch(rng, u, n), 0.2**2 * np.eye(3), held) is None
    assert held.contradicted == 1
    assert not held.number


@pytest.mark.parametrize("skies", [20, pytest.param(1000, marks=pytest.mark.campaign)])
def test_wrong_fixes_are_as_rare_as_claimed(rng, skies):
    """Predictions drawn from their covariance: none of those accepted is wrong."""
    accepted = wrong = 0
    for _ in range(skies):
        u, cycles = sky(rng, 10), rng.integers(-500, 500, 10)
        held, sigma = HeldIntegers(), rng.uniform(0.05, 0.6)
        for _ in range(3):
            fix = fix_epoch(epoch(rng, u, cycles, sigma * rng.standard_normal(3)), sigma**2 * np.eye(3), held)
        if fix is not None:
            accepted += 1
            number = np.array([held.number.get(s, 10**6) for s in range(101, 111)])[fix.used]
            kind, off = (np.arange(10) % 2)[fix.used], number - cycles[fix.used]
            wrong += any(len(np.unique(off[kind == i])) > 1 for i in (0, 1))
    assert accepted > skies // 3
    assert wrong == 0


def two_bands(rng, directions, cycles, d) -> Measured:
    """Measurements as of :func:`epoch` on L1 and L2, one system."""
    bands = [epoch(rng, directions, c, d, kinds=1) for c in cycles]
    joined = {name: np.concatenate([getattr(e, name) for e in bands]) for name in bands[0].__dataclass_fields__}
    second = np.repeat([0, 1], len(directions))
    ratio = 1.0 + second * (CYCLE_2 / CYCLE - 1.0)
    true = np.concatenate([e.carrier for e in bands]) + CYCLE * (ratio - 1.0) * np.concatenate(cycles)
    joined |= {"sat": joined["sat"] + 1000 * second, "kind": second, "carrier": true, "wavelength": CYCLE * ratio}
    return Measured(**joined)


@pytest.mark.parametrize("skies", [15, pytest.param(1000, marks=pytest.mark.campaign)])
def test_two_bands_fix_few_satellites(skies):
    """Six satellites, a prediction of half a metre, ten epochs: two bands fix nearly all skies, one band a part."""
    rng, share, wrong = np.random.default_rng(3), [0, 0], 0
    for _ in range(skies):
        u, d = sky(rng, 6), 0.5 * rng.standard_normal(3)
        cycles = rng.integers(-500, 500, (2, 6))
        for bands in (1, 2):
            held = HeldIntegers()
            for _ in range(10):
                e = two_bands(rng, u, cycles, d) if bands == 2 else epoch(rng, u, cycles[0], d, kinds=1)
                fix = fix_epoch(e, 0.5**2 * np.eye(3), held)
            off = [
                held.number[int(s)] - n for s, n in zip(e.sat, cycles.ravel(), strict=False) if int(s) in held.number
            ]
            share[bands - 1] += fix is not None
            if fix is not None:
                wrong += len(set(off[:6])) > 1 or len(set(off[6:])) > 1
    assert share[1] > 0.9 * skies
    assert share[0] < 0.8 * share[1]
    assert wrong <= 1e-3 * sum(share) + 3.0 * np.sqrt(1e-3 * sum(share))  # three standard errors above the claim


def test_no_decorrelation_succeeds_more_often_than_the_determinant_allows(rng):
    """And one that makes all variances equal just as often."""
    for n in (1, 4, 9):
        for _ in range(20):
            A = rng.standard_normal((n, n)) * rng.uniform(0.02, 0.5)
            Q = A @ A.T + 1e-4 * np.eye(n)
            assert success_rate(decorrelate(Q)[2]) <= _largest_success(Q) * (1.0 + 1e-12)
        assert _largest_success(0.04 * np.eye(n)) == pytest.approx(success_rate(np.full(n, 0.04)), rel=1e-12)


def test_float_ambiguities_are_those_of_one_least_squares(rng):
    """Twin: offset with its prior and an unknown for each free difference, all carriers at once. Rounding."""
    u = sky(rng, 8)
    member, reference = np.array([1, 2, 3, 5, 6, 7]), np.array([0, 0, 0, 4, 4, 4])
    sigma, held = rng.uniform(0.002, 0.02, 8), np.array([True, False, True, False, True, False])
    G, R = u[member] - u[reference], _covariance(sigma, member, reference)
    P, d, y = np.diag([0.3, 0.2, 0.5]) ** 2, rng.standard_normal(3), rng.standard_normal(6)
    a, Q = _float(y, G, R, d, P, held)
    A = np.hstack((G, np.eye(6)[:, ~held]))
    prior = np.zeros((6, 6))
    prior[:3, :3] = np.linalg.inv(P)
    W = np.linalg.inv(R)
    cov = np.linalg.inv(A.T @ W @ A + prior)
    x = cov @ (A.T @ W @ y + prior @ np.concatenate((d, np.zeros(3))))
    np.testing.assert_allclose(a, x[3:], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(Q, cov[3:, 3:], rtol=1e-6)
