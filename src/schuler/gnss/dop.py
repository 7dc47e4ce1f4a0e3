"""Dilution of precision: what the geometry of the satellites does to the error of their ranges."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged

_DEGENERATE = 1e-10  # smallest eigenvalue of normal equations with a unit diagonal that counts as a solution


@dataclass(frozen=True, repr=False)
class Dilution(Abridged):
    """Standard deviations of a position from ranges with independent errors of 1 m; infinite where there is none.

    Attributes
    ----------
    gdop, pdop, hdop, vdop, tdop : ndarray, shape (k,)
        DOP of everything (all clocks too), position, horizontal position, height, and the first clock seen.
    """

    gdop: FloatArray
    pdop: FloatArray
    hdop: FloatArray
    vdop: FloatArray
    tdop: FloatArray

    def where(self, keep: ArrayLike) -> Dilution:
        """The epochs selected by a boolean or index array."""
        k = np.asarray(keep)
        return Dilution(*(getattr(self, f.name)[k] for f in fields(self)))


def dilution(u_n: ArrayLike, used: ArrayLike | None = None, group: ArrayLike | None = None) -> Dilution:
    """Dilution of precision of one or many epochs.

    Parameters
    ----------
    u_n : array_like, shape (m, 3) or (k, m, 3)
        Unit vectors from the receiver to the satellites, north, east, down.
    used : array_like of bool, shape (m,) or (k, m), optional
        Satellites in use; all by default.
    group : array_like of int, shape (m,) or (k, m), optional
        Receiver clock of each range; one clock by default.

    Returns
    -------
    Dilution
        Arrays of shape (k,), with k = 1 for a single epoch.

    Raises
    ------
    InputError
        If the shapes do not agree.

    Notes
    -----
    ``G = (H' H)^-1`` with rows ``[-u, 1 for the range's clock]``, unweighted, so it depends on geometry alone.
    One unknown clock a group: a second system with a single satellite adds nothing but that clock.

    References
    ----------
    Groves (2013), section 9.4.3; several clocks as additional columns.
    """
    u = np.atleast_2d(np.asarray(u_n, dtype=np.float64))
    u = u[None] if u.ndim == 2 else u
    u = as_floats(u, "u_n", (None, None, 3))
    shape = u.shape[:2]
    mask = np.ones(shape, dtype=bool) if used is None else np.atleast_2d(np.asarray(used, dtype=bool))
    clock = np.zeros(shape, dtype=np.int64) if group is None else np.atleast_2d(np.asarray(group, dtype=np.int64))
    if mask.shape != shape or clock.shape != shape:
        raise InputError(f"expected used and group of shape {shape}, got {mask.shape} and {clock.shape}")
    n_groups = int(clock[mask].max(initial=0)) + 1
    H = design(-u, clock, n_groups, mask)
    cofactor, solvable, seen = inverse_normal(H, mask, clock, n_groups)
    return dilution_of(cofactor, solvable, seen)


def design(position: FloatArray, group: IntArray, n_groups: int, used: BoolArray) -> FloatArray:
    """Rows ``[position, 1 in the column of the range's clock]``, zero where not used. Shape (k, m, 3 + n_groups)."""
    H = np.zeros((*group.shape, 3 + n_groups))
    H[..., :3] = position
    H[..., 3:] = group[..., None] == np.arange(n_groups)
    H[~used] = 0.0
    return H


def inverse_normal(
    H: FloatArray, used: BoolArray, group: IntArray, n_groups: int
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Inverse of ``H' H`` for many epochs, of which some may have no solution.

    Parameters
    ----------
    H : ndarray, shape (k, m, 3 + n_groups)
        Rows as of :func:`design`, weighted or not, zero where not used.
    used : ndarray of bool, shape (k, m)
    group : ndarray of int, shape (k, m)
    n_groups : int

    Returns
    -------
    inverse : ndarray, shape (k, 3 + n_groups, 3 + n_groups)
        Zero in the rows and columns of clocks that no satellite shows, and all zero where there is no solution.
    solvable : ndarray of bool, shape (k,)
    seen : ndarray of bool, shape (k, n_groups)
        Clocks that occur.
    """
    seen = np.any((group[..., None] == np.arange(n_groups)) & used[..., None], axis=1)
    present = np.concatenate((np.ones((len(H), 3), dtype=bool), seen), axis=1)
    N = np.matmul(np.swapaxes(H, 1, 2), H)
    diagonal = np.einsum("kii->ki", N)  # a view
    diagonal += ~present  # a clock nobody shows is given a number, so that the others can be found
    scale = np.sqrt(np.maximum(diagonal, np.finfo(float).tiny))
    unit = N / (scale[:, :, None] * scale[:, None, :])
    solvable = np.sum(used, axis=1) >= present.sum(axis=1)
    solvable &= np.linalg.eigvalsh(unit)[:, 0] > _DEGENERATE
    unit[~solvable] = np.eye(N.shape[1])
    inverse = np.linalg.inv(unit) / (scale[:, :, None] * scale[:, None, :])
    keep = present & solvable[:, None]
    return inverse * (keep[:, :, None] & keep[:, None, :]), solvable, seen


def dilution_of(cofactor_n: FloatArray, solvable: BoolArray, seen: BoolArray) -> Dilution:
    """Dilutions of cofactors in axes north, east, down. Shapes (k, 3 + n_groups, 3 + n_groups), (k,), (k, n_groups)."""
    d = np.einsum("kii->ki", cofactor_n)
    first = 3 + np.argmax(seen, axis=1)
    squares = (
        d.sum(axis=1), d[:, :3].sum(axis=1), d[:, 0] + d[:, 1], d[:, 2], d[np.arange(len(d)), first],
    )  # fmt: skip
    return Dilution(*(np.where(solvable, np.sqrt(np.maximum(s, 0.0)), np.inf) for s in squares))
