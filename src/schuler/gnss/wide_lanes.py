"""Wide lanes: differences of two carriers whose integers codes tell, and ranges without ionosphere that they make."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.gnss.differences import SingleDifferences
from schuler.gnss.linked import lasting_factor
from schuler.gnss.signal_choice import PAIRS
from schuler.gnss.signals import SPEED_OF_LIGHT, SYSTEM_NAMES, SYSTEMS

_NEIGHBOURS = np.arange(-3.0, 4.0)  # integers about the nearest that a wide lane may be instead
_ENOUGH = 30  # degrees of freedom from which on residuals tell the noise


def without_ionosphere(
    d: SingleDifferences, begins: BoolArray, slipped: BoolArray, *, least_success: float = 0.999
) -> tuple[SingleDifferences, BoolArray, BoolArray]:
    """Differences free of the ionosphere, whose ambiguities are integers of the narrow lane.

    Parameters
    ----------
    d : SingleDifferences
        On two bands of a system at least.
    begins, slipped : ndarray of bool, shape (k, s)
        See :func:`schuler.gnss.differences.cycle_slips`.
    least_success : float
        Least probability of a wide lane's integer.

    Returns
    -------
    d : SingleDifferences
        One slot a satellite that has two bands: code, and carrier less the part of its wide lane, whose wavelength is
        ``c / (f1 + f2)``, 11 cm. NaN in arcs whose wide lane is not certain.
    begins, slipped : ndarray of bool, shape (k, s)
        Of either band.

    Raises
    ------
    InputError
        If no satellite has two bands in both receivers, or ``least_success`` is no probability.

    References
    ----------
    Melbourne, W. G. (1985), Wübbena, G. (1985), Proc. First Int. Symp. on Precise Positioning with GPS, 373-386 and
    403-412; Springer Handbook of GNSS (2017), section 20.2.3.
    """
    if not 0.0 < least_success < 1.0:
        raise InputError(f"least_success: expected a probability between 0 and 1, got {least_success}")
    first, second = _slot_pairs(d)
    f1, f2 = SPEED_OF_LIGHT / d.wavelength[first], SPEED_OF_LIGHT / d.wavelength[second]
    both = np.isfinite(d.carrier[:, first] + d.carrier[:, second] + d.code[:, first] + d.code[:, second])
    new = both & (begins[:, first] | begins[:, second])
    new[1:] |= both[1:] & ~both[:-1]
    new[0] = both[0]
    arc = np.where(both, np.cumsum(new, axis=0), 0)

    phase = (f1 * d.carrier[:, first] - f2 * d.carrier[:, second]) / (f1 - f2)
    code = (f1 * d.code[:, first] + f2 * d.code[:, second]) / (f1 + f2)
    sigma = np.hypot(f1 * d.sigma_code[:, first], f2 * d.sigma_code[:, second]) / (f1 + f2)
    cycles, noise = (phase - code) * (f1 - f2) / SPEED_OF_LIGHT, sigma * (f1 - f2) / SPEED_OF_LIGHT
    wide = np.full(both.shape, np.nan)
    system = d.sat[first] // 100
    for one in np.unique(system):
        mine = np.flatnonzero(system == one)
        wide[:, mine] = wide_lane_integers(cycles[:, mine], noise[:, mine], arc[:, mine], least_success=least_success)

    share = f1**2 / (f1**2 - f2**2)
    keep = np.isfinite(wide)
    mixed = {
        name: np.where(keep, share * getattr(d, name)[:, first] - (share - 1.0) * getattr(d, name)[:, second], np.nan)
        for name in ("code", "carrier")
    }
    sigmas = {
        name: np.where(keep, np.hypot(share * x[:, first], (share - 1.0) * x[:, second]), np.nan)
        for name, x in (("sigma_code", d.sigma_code), ("sigma_carrier", d.sigma_carrier))
    }
    arcs, certain = int(new.sum()), int((new & keep).sum())
    free = replace(
        d,
        sat=d.sat[first],
        band=tuple(d.band[i] + d.band[j] for i, j in zip(first.tolist(), second.tolist(), strict=True)),
        group=system,
        wavelength=SPEED_OF_LIGHT / (f1 + f2),
        code=mixed["code"],
        carrier=mixed["carrier"] - SPEED_OF_LIGHT * f2 / (f1**2 - f2**2) * wide,
        **sigmas,
        gradient=d.gradient[:, first],
        elevation=d.elevation[:, first],
        arc=d.arc[:, first] + d.arc[:, second],
        notes=(*d.notes, f"wide lanes of {certain} of {arcs} arcs are certain; the others are left out"),
    )
    return free, new, slipped[:, first] | slipped[:, second]


def wide_lane_integers(
    cycles: FloatArray, sigma: FloatArray, arc: IntArray, *, least_success: float = 0.999
) -> FloatArray:
    """Integers of Melbourne's and Wübbena's combination, one for each arc, between satellites of one system.

    Parameters
    ----------
    cycles, sigma : ndarray, shape (k, s)
        Combination between receivers and its 1-sigma. [cycles]
    arc : ndarray of int, shape (k, s)
        Number of each satellite's arc, 0 where there is none.
    least_success : float
        An integer is taken if rounding succeeds with this probability, and if it is as probable among its neighbours.

    Returns
    -------
    ndarray, shape (k, s)
        Less that of one arc, which is common to all satellites of an epoch; NaN where it is not certain. [cycles]

    Notes
    -----
    Least squares of one number an arc and one an epoch (what the receivers' channels and clocks leave). Variances are
    multiplied by what residuals say: their variance factor, and how long code errors last.
    """
    from scipy.special import erf

    present = arc > 0
    keys = np.unique(np.stack((np.nonzero(present)[1], arc[present]), axis=1), axis=0, return_inverse=True)
    column = np.full(arc.shape, -1)
    column[present] = keys[1].ravel()
    n = len(keys[0])
    p = np.where(present, 1.0 / np.where(present, sigma, 1.0) ** 2, 0.0)
    by_epoch = np.zeros((len(arc), n))
    k, s = np.nonzero(present)
    by_epoch[k, column[k, s]] = p[k, s]
    total = np.maximum(by_epoch.sum(axis=1), 1e-300)
    y = np.where(present, cycles, 0.0)
    N = np.diag(by_epoch.sum(axis=0)) - by_epoch.T @ (by_epoch / total[:, None])
    weighted = np.bincount(column[present], (p * y)[present], minlength=n)
    right = weighted - by_epoch.T @ (np.sum(p * y, axis=1) / total)

    solution, variance = np.zeros(n), np.zeros(n)
    for members in _connected(by_epoch > 0.0):
        others = members[members != members[np.argmax(np.diag(N)[members])]]
        if len(others):
            Q = np.linalg.inv(N[np.ix_(others, others)])
            solution[others], variance[others] = Q @ right[others], np.diag(Q)
    v = np.where(present, y - solution[column], 0.0)
    v = np.where(present, v - (np.sum(p * v, axis=1) / total)[:, None], 0.0)
    freedom = int(present.sum()) - n - int(present.any(axis=1).sum())
    if freedom >= _ENOUGH:
        scatter = max(1.0, float(np.sum(p * v**2)) / freedom)
        variance *= scatter * lasting_factor(np.broadcast_to(np.arange(arc.shape[1]), arc.shape), v * np.sqrt(p), p)
    whole = np.round(solution)
    left = np.abs(solution - whole)[:, None]
    spread = np.maximum(variance, 1e-12)[:, None]
    probable = 1.0 / np.sum(np.exp(np.clip((left**2 - (left - _NEIGHBOURS) ** 2) / (2.0 * spread), None, 0.0)), axis=1)
    certain = (erf(1.0 / np.sqrt(8.0 * spread[:, 0])) >= least_success) & (probable >= least_success)
    return np.where(present, np.where(certain, whole, np.nan)[column], np.nan)


def _connected(shared: BoolArray) -> list[IntArray]:
    """Arcs that epochs tie to each other; shared: whether an arc is at an epoch, shape (k, n)."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    counts = csr_matrix(shared.astype(np.int64))
    labels = connected_components(counts.T @ counts, directed=False)[1]
    return [np.flatnonzero(labels == one) for one in np.unique(labels)]


def _slot_pairs(d: SingleDifferences) -> tuple[IntArray, IntArray]:
    """Slots of both bands of each satellite, of the pair that most epochs of its system have."""
    first: list[int] = []
    second: list[int] = []
    slot = {(int(sat), band): k for k, (sat, band) in enumerate(zip(d.sat, d.band, strict=True))}
    for system in np.unique(d.sat // 100).tolist():
        sats = np.unique(d.sat[d.sat // 100 == system]).tolist()
        best, most = [], 0
        for a, b in PAIRS.get(SYSTEMS[system], ()):
            pairs = [(slot[(s, a)], slot[(s, b)]) for s in sats if (s, a) in slot and (s, b) in slot]
            count = sum(int(np.isfinite(d.carrier[:, i] + d.carrier[:, j]).sum()) for i, j in pairs)
            if count > most:
                best, most = pairs, count
        first += [i for i, _ in best]
        second += [j for _, j in best]
    if not first:
        bands = sorted({f"{SYSTEM_NAMES[SYSTEMS[s // 100]]} {b}" for s, b in slot})
        raise InputError(
            f"ionosphere: free needs carriers on two bands of a system in both receivers, got {', '.join(bands)}; "
            'take "same", for a base within 10 km'
        )
    return np.array(first), np.array(second)
