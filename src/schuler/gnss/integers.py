"""Integers of double-differenced carriers, epoch by epoch, from a predicted position and its covariance."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.gnss.ambiguities import fix_ambiguities
from schuler.gnss.integrity import thresholds

_CONFIRMED = 3  # epochs in a row in which an integer must come out the same to be used
_CONTRADICTED = 1e-6  # probability of held carriers as far from codes and prediction, by which they are given up
_LEAST = 4  # double differences that are fixed together where no position is known from held ones
_FREE = 1e-6  # information about a direction that no carrier looks along: 1 km [1/m^2]


@dataclass(frozen=True)
class Measured:
    """Carrier and code of an epoch less their prediction at the predicted antenna; m satellites.

    Attributes
    ----------
    sat : ndarray of int, shape (m,)
        A number for each satellite and band.
    arc, kind : ndarray of int, shape (m,)
        As in :class:`schuler.gnss.relative.RelativeCarriers`.
    carrier, code : ndarray, shape (m,)
        Measured minus predicted, receiver clocks in them. [m]
    sigma_carrier, sigma_code, wavelength, elevation : ndarray, shape (m,)
        [m], [m], [m], [rad]
    gradient : ndarray, shape (m, 3)
        Derivative of the prediction by the antenna's Earth-fixed position.
    """

    sat: IntArray
    arc: IntArray
    kind: IntArray
    carrier: FloatArray
    code: FloatArray
    sigma_carrier: FloatArray
    sigma_code: FloatArray
    wavelength: FloatArray
    elevation: FloatArray
    gradient: FloatArray


@dataclass
class HeldIntegers:
    """Integers by satellite, less one that is common to their kind, and what happened so far.

    Attributes
    ----------
    arc, number, seen : dict of int to int
        By satellite: its arc, its integer [cycles], epochs in a row with the same.
    contradicted : int
        Times at which all were given up.
    """

    arc: dict[int, int] = field(default_factory=dict)
    number: dict[int, int] = field(default_factory=dict)
    seen: dict[int, int] = field(default_factory=dict)
    contradicted: int = 0

    def forget(self, sats: list[int] | None = None) -> None:
        """Forget the integers of some satellites, or of all."""
        for sat in list(self.number) if sats is None else sats:
            for entry in (self.arc, self.number, self.seen):
                entry.pop(sat, None)

    def sure(self, sats: IntArray) -> BoolArray:
        """Whether the integer of each satellite has come out the same often enough. Shape (m,)."""
        return np.array([self.seen.get(int(s), 0) >= _CONFIRMED for s in sats], dtype=bool)


@dataclass(frozen=True)
class CarrierFix:
    """Position by carriers whose integers are held.

    Attributes
    ----------
    offset : ndarray, shape (3,)
        From the predicted antenna, Earth-fixed. [m]
    cov : ndarray, shape (3, 3)
        A kilometre squared in directions that the carriers do not measure. [m^2]
    used : ndarray of bool, shape (m,)
        Satellites whose carriers are in it.
    """

    offset: FloatArray
    cov: FloatArray
    used: BoolArray


def fix_epoch(
    e: Measured, P: FloatArray, held: HeldIntegers, *, ratio: float = 3.0, least_success: float = 0.999
) -> CarrierFix | None:
    """Fix the integers of an epoch, and the position that held ones give by themselves.

    Parameters
    ----------
    e : Measured
    P : ndarray, shape (3, 3)
        Covariance of the predicted antenna, Earth-fixed, before any measurement of this epoch. [m^2]
    held : HeldIntegers
        Changed in place.
    ratio, least_success : float
        See :func:`schuler.gnss.ambiguities.fix_ambiguities`.

    Returns
    -------
    CarrierFix or None
        None where fewer than two satellites of a kind have a held integer. The prediction is not in it: it
        is a measurement of its own.

    Notes
    -----
    Float ambiguities are those of this epoch's carriers at the position that prediction, codes and held carriers give;
    nothing of them is carried on, so that what the prediction has learned is not counted twice. The noisiest
    satellites are left out until bootstrapping succeeds with ``least_success``. An integer is held once it came out the
    same in three epochs in a row, until its arc ends or the held carriers contradict codes and prediction.
    """
    held.forget([s for s, a in zip(e.sat.tolist(), e.arc.tolist(), strict=True) if held.arc.get(s, a) != a])
    member, reference = _pairs(e, held)
    if not len(member):
        return None
    sure = held.sure(e.sat)
    both = sure[member] & sure[reference]
    G = e.gradient[member] - e.gradient[reference]
    code, carrier = (x[member] - x[reference] for x in (e.code, e.carrier))
    R_code, R = _covariance(e.sigma_code, member, reference), _covariance(e.sigma_carrier, member, reference)
    d, P = _updated(np.zeros(3), P, G, code, R_code)

    number = np.array([held.number.get(s, 0) for s in e.sat.tolist()], dtype=np.float64)
    h, f = np.flatnonzero(both), np.flatnonzero(~both)
    y = carrier - both * e.wavelength[member] * (number[member] - number[reference])
    if len(h):
        v, S = y[h] - G[h] @ d, G[h] @ P @ G[h].T + R[np.ix_(h, h)]
        if v @ np.linalg.solve(S, v) > thresholds(_CONTRADICTED, np.array([len(h)]))[0]:
            held.forget()
            held.contradicted += 1
            return None
    if len(f):
        cycle = e.wavelength[member[f]]
        a, Q = _float(y, G, R, d, P, both)
        noise = np.diag(R)[f] / cycle**2
        chosen, integers = _fixed(a / cycle, Q / np.outer(cycle, cycle), noise, len(h), ratio, least_success)
        _remember(held, e, member[f], reference[f], chosen, integers)
    return _position(e, held)


def _pairs(e: Measured, held: HeldIntegers) -> tuple[IntArray, IntArray]:
    """Satellites and the reference of their kind: a held one if there is any, else one under trial, the highest."""
    trust = np.array([held.seen.get(s, 0) for s in e.sat.tolist()])
    rank = 2 * (trust >= _CONFIRMED) + (trust > 0) + e.elevation / np.pi
    members: list[IntArray] = []
    references: list[IntArray] = []
    for kind in np.unique(e.kind):
        mine = np.flatnonzero(e.kind == kind)
        if len(mine) > 1:
            reference = mine[np.argmax(rank[mine])]
            members.append(mine[mine != reference])
            references.append(np.full(len(mine) - 1, reference))
    if not members:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    return np.concatenate(members), np.concatenate(references)


def _covariance(sigma: FloatArray, member: IntArray, reference: IntArray) -> FloatArray:
    """Covariance of double differences, those of a kind sharing their reference. Shape (n, n)."""
    shared = reference[:, None] == reference[None, :]
    return np.asarray(np.diag(sigma[member] ** 2) + shared * sigma[reference][:, None] ** 2)


def _updated(
    d: FloatArray, P: FloatArray, G: FloatArray, y: FloatArray, R: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Least squares of an offset with a prior and its covariance (Joseph's form)."""
    K = np.linalg.solve(G @ P @ G.T + R, G @ P).T
    left = np.eye(3) - K @ G
    P = left @ P @ left.T + K @ R @ K.T
    return d + K @ (y - G @ d), 0.5 * (P + P.T)


def _float(
    y: FloatArray, G: FloatArray, R: FloatArray, d: FloatArray, P: FloatArray, held: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Ambiguities of the double differences that are not held, given those that are, and their covariance. [m], [m^2]

    Differences of a kind share the noise of their reference, which is taken out of the free ones as far as the held
    ones tell it.
    """
    h, f = np.flatnonzero(held), np.flatnonzero(~held)
    y_f, G_f, R_f = y[f], G[f], R[np.ix_(f, f)]
    if len(h):
        d, P = _updated(d, P, G[h], y[h], R[np.ix_(h, h)])
        across = np.linalg.solve(R[np.ix_(h, h)], R[np.ix_(h, f)]).T
        y_f, G_f, R_f = y_f - across @ y[h], G_f - across @ G[h], R_f - across @ R[np.ix_(h, f)]
    Q = G_f @ P @ G_f.T + R_f
    return y_f - G_f @ d, 0.5 * (Q + Q.T)


def _fixed(
    a: FloatArray, Q: FloatArray, noise: FloatArray, given: int, ratio: float, least_success: float
) -> tuple[IntArray, IntArray]:
    """Ambiguities fixed and their integers: all of them, or all but the noisiest."""
    order = np.argsort(noise, kind="stable")
    least = 1 if given >= _LEAST - 1 else min(_LEAST, len(a) + 1)
    for count in range(len(a), least - 1, -1):
        chosen = np.sort(order[:count])
        if _largest_success(Q[np.ix_(chosen, chosen)]) < least_success:
            continue
        fix = fix_ambiguities(
            a[chosen], Q[np.ix_(chosen, chosen)], ratio=ratio, least_success=least_success, partial=False
        )
        if len(fix.integers):
            if not fix.accepted:
                break
            z = np.rint(np.linalg.solve(fix.Z.T.astype(np.float64), fix.integers.astype(np.float64)))
            return chosen, z.astype(np.int64)
    return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)


def _largest_success(Q: FloatArray) -> float:
    """Bound on the success rate of bootstrapping whatever the decorrelation, by the determinant; saves the latter.

    Teunissen, P. J. G. (2003), Artificial Satellites 38, 129-138: ``(2 Phi(1 / (2 ADOP)) - 1)^n``.
    """
    from scipy.special import erf

    n = len(Q)
    adop = np.exp(np.linalg.slogdet(Q)[1] / (2 * n))
    return float(erf(1.0 / (np.sqrt(8.0) * adop)) ** n)


def _remember(
    held: HeldIntegers, e: Measured, member: IntArray, reference: IntArray, chosen: IntArray, integers: IntArray
) -> None:
    """Count in which epochs integers came out the same; what was not fixed begins anew."""
    references = np.unique(reference[chosen])
    for i in references:
        sat = int(e.sat[i])
        if held.seen.get(sat, 0) < _CONFIRMED:
            _count(held, sat, int(e.arc[i]), held.number.get(sat, 0))
    for k, z in zip(chosen.tolist(), integers.tolist(), strict=True):
        sat = int(e.sat[member[k]])
        _count(held, sat, int(e.arc[member[k]]), held.number[int(e.sat[reference[k]])] + z)
    left = np.setdiff1d(np.concatenate((member, reference)), np.concatenate((member[chosen], references)))
    held.forget([int(e.sat[i]) for i in left if held.seen.get(int(e.sat[i]), 0) < _CONFIRMED])


def _count(held: HeldIntegers, sat: int, arc: int, number: int) -> None:
    held.seen[sat] = held.seen.get(sat, 0) + 1 if held.number.get(sat) == number else 1
    held.arc[sat], held.number[sat] = arc, number


def _position(e: Measured, held: HeldIntegers) -> CarrierFix | None:
    """Position by the carriers with held integers, and nothing else."""
    sure = held.sure(e.sat)
    subset = np.flatnonzero(sure)
    of = Measured(
        e.sat[subset], e.arc[subset], e.kind[subset], e.carrier[subset], e.code[subset], e.sigma_carrier[subset],
        e.sigma_code[subset], e.wavelength[subset], e.elevation[subset], e.gradient[subset],
    )  # fmt: skip
    member, reference = _pairs(of, held)
    if not len(member):
        return None
    number = np.array([held.number[s] for s in of.sat.tolist()], dtype=np.float64)
    cycles = of.carrier - of.wavelength * number
    G = of.gradient[member] - of.gradient[reference]
    W = np.linalg.solve(_covariance(of.sigma_carrier, member, reference), G).T
    cov = np.linalg.inv(W @ G + _FREE * np.eye(3))
    used = np.zeros(len(e.sat), dtype=bool)
    used[subset[np.unique(np.concatenate((member, reference)))]] = True
    return CarrierFix(cov @ (W @ (cycles[member] - cycles[reference])), 0.5 * (cov + cov.T), used)
