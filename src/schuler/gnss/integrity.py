"""Fault detection and exclusion among ranges (RAIM): test, identification, power, protection levels.

Everything here is linear algebra on normalised rows: ``A`` is the design matrix with each row divided by its standard
deviation, ``y`` the differences (measured minus predicted) divided likewise, so that without a fault the errors of
``y`` are independent with variance one. What ``M = I - A (A'A)^-1 A'`` leaves of ``y`` are the residuals; the sum of
their squares is the statistic.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from itertools import combinations
from math import comb, log

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged

_UNCHECKED = 1e-11  # share of its own variance left in a residual below which no other satellite checks this one
_MOST_SUBSETS = 20_000


@dataclass(frozen=True)
class Integrity:
    """Settings of the search for faults.

    Attributes
    ----------
    false_alarm : float
        Probability per epoch that the test fails without a fault.
    missed_detection : float
        Integrity risk: probability per epoch, given a fault of one satellite, that the test passes and the error is
        beyond the protection level.
    max_faults : int
        Most satellites excluded from an epoch; 0 detects only.
    wrong_exclusion : float
        An exclusion is believed if every other exclusion of as many satellites that would also explain the epoch is
        less likely by this factor; else the epoch is given up as ambiguous. 1 believes the likeliest.
    neighbours : bool
        Solve epochs that were given up along a track through their neighbours, tied by range rates
        (:func:`schuler.gnss.neighbours.solve_with_neighbours`).
    """

    false_alarm: float = 1e-3
    missed_detection: float = 1e-3
    max_faults: int = 3
    wrong_exclusion: float = 0.1
    neighbours: bool = True

    def __post_init__(self) -> None:
        for name in ("false_alarm", "missed_detection"):
            value = getattr(self, name)
            if not 0.0 < value < 1.0:
                raise InputError(f"{name}: expected a probability between 0 and 1, got {value}")
        if not 0.0 < self.wrong_exclusion <= 1.0:
            raise InputError(f"wrong_exclusion: expected a number in (0, 1], got {self.wrong_exclusion}")
        if self.max_faults < 0:
            raise InputError(f"max_faults: expected 0 or more satellites, got {self.max_faults}")


@functools.cache
def threshold(false_alarm: float, redundancy: int) -> float:
    """Value the statistic exceeds with probability ``false_alarm`` if nothing is wrong; infinite without redundancy.

    References
    ----------
    Groves (2013), chapter 17: chi-square of weighted least-squares residuals.
    """
    if redundancy <= 0:
        return float("inf")
    from scipy.stats import chi2

    return float(chi2.isf(false_alarm, redundancy))


def thresholds(false_alarm: float, redundancy: ArrayLike) -> FloatArray:
    """:func:`threshold` for an array of redundancies. Shape as given."""
    r = np.asarray(redundancy, dtype=np.int64)
    table = {int(k): threshold(false_alarm, int(k)) for k in np.unique(r)}
    return np.array([table[int(k)] for k in r.ravel()]).reshape(r.shape)


def power(false_alarm: float, redundancy: int, noncentrality: float) -> float:
    """Probability that the test fails when a fault gives the statistic this non-centrality.

    For one satellite with bias b and standard deviation sigma it is ``(b / sigma)^2 M_ii``.
    """
    if redundancy <= 0:
        return 0.0
    from scipy.stats import chi2, ncx2

    limit = threshold(false_alarm, redundancy)
    return float(ncx2.sf(limit, redundancy, noncentrality) if noncentrality > 0.0 else chi2.sf(limit, redundancy))


@functools.cache
def smallest_noncentrality(false_alarm: float, missed_detection: float, redundancy: int) -> float:
    """Non-centrality at which a fault is missed with probability ``missed_detection``; infinite without redundancy.

    References
    ----------
    Baarda (1968), A testing procedure for use in geodetic networks: the minimal detectable bias.
    """
    if redundancy <= 0:
        return float("inf")
    if 1.0 - false_alarm <= missed_detection:
        return 0.0
    from scipy.optimize import brentq

    def excess(value: float) -> float:
        return 1.0 - power(false_alarm, redundancy, value) - missed_detection

    top = 10.0
    while excess(top) > 0.0:
        top *= 2.0
    return float(brentq(excess, 0.0, top, xtol=1e-10))


DEFAULT_INTEGRITY = Integrity()


@dataclass(frozen=True, repr=False)
class Identification(Abridged):
    """Rows that disagree with the others.

    Attributes
    ----------
    rows : tuple of int
        Rows to leave out; empty if none explains the epoch.
    statistic : float
        Statistic of what is left.
    rivals : int
        Other sets of as many rows that would pass the test too and are not less likely by the factor asked for.
    """

    rows: tuple[int, ...]
    statistic: float
    rivals: int


def residual_projector(A: FloatArray) -> FloatArray:
    """``I - A (A'A)^+ A'`` of normalised rows, none included. Shape (m, n) to (m, m)."""
    left, singular, _ = np.linalg.svd(A, full_matrices=False)
    basis = left[:, singular > 1e-13 * max(singular.max(initial=0.0), np.finfo(float).tiny)]  # no rows: no basis
    projector: FloatArray = np.eye(len(A)) - basis @ basis.T
    return projector


def identify(A: ArrayLike, y: ArrayLike, integrity: Integrity) -> Identification:
    """The smallest, and among these the likeliest, set of rows without which the others agree.

    Parameters
    ----------
    A : array_like, shape (m, n)
        Normalised design; columns of clocks nobody shows may be zero.
    y : array_like, shape (m,)
        Normalised differences, linearised near the truth.
    integrity : Integrity

    Notes
    -----
    A set S lowers the statistic by ``v_S' (M_SS)^-1 v_S``, the generalised likelihood ratio of biases on just these
    rows; for one row this is the square of Baarda's normalised residual, and it is what a solution without S would
    show (subset separation), found without solving again. All sets of one row are tried, then of two, and so on: a
    greedy search one by one is misled when two faults mask each other. At least one redundant range stays, so that
    what is left is itself tested.

    References
    ----------
    Baarda (1968); Teunissen (2000), Testing theory, section 4; Brown (1992) for the equivalence of the RAIM schemes.
    """
    A = as_floats(A, "A", (None, None))
    y = as_floats(y, "y", (len(A),))
    M = residual_projector(A)
    v = M @ y
    total = float(v @ v)
    redundancy = round(float(np.trace(M)))
    margin = -2.0 * log(integrity.wrong_exclusion)
    for size in range(1, min(integrity.max_faults, redundancy - 1) + 1):
        if comb(len(A), size) > _MOST_SUBSETS:
            break
        limit = threshold(integrity.false_alarm, redundancy - size)
        sets = np.array(list(combinations(range(len(A)), size)))
        drop = _explained(M, v, sets)
        left = total - drop
        best = int(np.argmin(left))
        if left[best] >= limit:
            continue
        rivals = int(np.sum((left < limit) & (left < left[best] + margin))) - 1
        return Identification(tuple(int(i) for i in sets[best]), max(float(left[best]), 0.0), rivals)
    return Identification((), total, 0)


def _explained(M: FloatArray, v: FloatArray, sets: FloatArray) -> FloatArray:
    """By how much leaving out each set of rows lowers the statistic; nothing where others do not check the set."""
    block = M[sets[:, :, None], sets[:, None, :]]
    if sets.shape[1] == 1:
        d = block[:, 0, 0]
        return np.where(d > _UNCHECKED, v[sets[:, 0]] ** 2 / np.maximum(d, _UNCHECKED), -np.inf)
    d = np.sqrt(np.maximum(np.einsum("kii->ki", block), _UNCHECKED))
    scaled = block / (d[:, :, None] * d[:, None, :])  # rows of very different weight stay comparable
    checked = np.linalg.eigvalsh(scaled)[:, 0] > 1e-6
    scaled[~checked] = np.eye(sets.shape[1])
    w = v[sets] / d
    solved = np.linalg.solve(scaled, w[:, :, None])[:, :, 0]
    return np.where(checked, np.einsum("ki,ki->k", w, solved), -np.inf)


def noise_quantiles(risk: float) -> tuple[float, float]:
    """Horizontal error in larger semi-axes, and vertical one in sigmas, that noise exceeds with a probability."""
    from scipy.stats import chi2, norm

    return float(np.sqrt(chi2.isf(risk, 2))), float(norm.isf(0.5 * risk))


def protection_levels(
    A: FloatArray, cofactor: FloatArray, C_en: FloatArray, used: BoolArray, redundancy: ArrayLike, integrity: Integrity
) -> tuple[FloatArray, FloatArray]:
    """Horizontal and vertical protection levels of many epochs.

    Parameters
    ----------
    A : ndarray, shape (k, m, n)
        Normalised design in Earth-fixed axes, position first, zero where not used.
    cofactor : ndarray, shape (k, n, n)
        ``(A'A)^-1``.
    C_en : ndarray, shape (k, 3, 3)
        North, east, down to Earth-fixed axes.
    used : ndarray of bool, shape (k, m)
    redundancy : array_like of int, shape (k,)
    integrity : Integrity

    Returns
    -------
    hpl, vpl : ndarray, shape (k,)
        Infinite where a fault cannot be seen: no redundancy, or a satellite no other one checks that moves the
        position. [m]

    Notes
    -----
    Slope method with a margin for noise: ``PL = max_i(slope_i) sqrt(lambda) + k sigma``. ``slope_i`` is the position
    error a fault of satellite i causes per unit root non-centrality, ``lambda`` the non-centrality missed with
    probability P = ``missed_detection``. A larger fault is missed less often than P; a smaller one moves the mean less
    than the first term, and noise adds more than the second (two-sided normal, in the horizontal chi-square with two
    degrees of freedom and the larger semi-axis) with probability P. So for one fault of any size, "test passes and
    error beyond the level" has at most probability P. Brown and Chin's level is the first term alone and does not
    hold this for every size. Assumes independent errors of the stated standard deviations and one faulty satellite.

    References
    ----------
    Brown & Chin (1998), GPS RAIM: calculation of thresholds and protection radius; Walter & Enge (1995), Weighted RAIM
    for precision approach; Groves (2013), chapter 17.
    """
    r = np.asarray(redundancy, dtype=np.int64)
    gain = np.matmul(cofactor, np.swapaxes(A, 1, 2))  # unknowns per normalised range: (k, n, m)
    checked = 1.0 - np.einsum("kmi,kim->km", A, gain)
    gain_n = np.matmul(np.swapaxes(C_en, 1, 2), gain[:, :3])
    slope_h = _slopes(np.hypot(gain_n[:, 0], gain_n[:, 1]), checked, used)
    slope_v = _slopes(np.abs(gain_n[:, 2]), checked, used)
    table = {
        int(k): smallest_noncentrality(integrity.false_alarm, integrity.missed_detection, int(k)) for k in np.unique(r)
    }
    root = np.sqrt(np.array([table[int(k)] for k in r.ravel()]).reshape(r.shape))
    cov_n = np.matmul(np.swapaxes(C_en, 1, 2), np.matmul(cofactor[:, :3, :3], C_en))
    half = 0.5 * (cov_n[:, 0, 0] + cov_n[:, 1, 1])
    larger = half + np.sqrt((0.5 * (cov_n[:, 0, 0] - cov_n[:, 1, 1])) ** 2 + cov_n[:, 0, 1] ** 2)
    k_h, k_v = noise_quantiles(integrity.missed_detection)
    detectable = np.isfinite(root)
    root = np.where(detectable, root, 0.0)
    slope_h, slope_v = (np.where(detectable, s, np.inf) for s in (slope_h, slope_v))
    with np.errstate(invalid="ignore"):  # inf * 0 is put right in the next line
        hpl, vpl = (
            slope_h * root + k_h * np.sqrt(larger),
            slope_v * root + k_v * np.sqrt(np.maximum(cov_n[:, 2, 2], 0.0)),
        )
    return np.where(np.isfinite(slope_h), hpl, np.inf), np.where(np.isfinite(slope_v), vpl, np.inf)


def _slopes(moved: FloatArray, checked: FloatArray, used: BoolArray) -> FloatArray:
    """Largest position error per root non-centrality over the satellites of each epoch. Shape (k,)."""
    seen = checked > _UNCHECKED
    harmless = moved < 1e-9 * np.max(moved, axis=1, keepdims=True, initial=np.finfo(float).tiny)
    slope = np.where(seen, moved / np.sqrt(np.maximum(checked, _UNCHECKED)), np.where(harmless, 0.0, np.inf))
    return np.asarray(np.max(np.where(used, slope, 0.0), axis=1, initial=0.0))
