"""What cannot be improved in one respect without losing in another."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, IntArray
from schuler.exceptions import InputError


def pareto_front(costs: ArrayLike) -> IntArray:
    """Rows that no other row beats: none is as small in every column and smaller in one.

    Parameters
    ----------
    costs : array_like, shape (n, k)
        To be made small; a row with an infinite cost is never on the front.

    Returns
    -------
    ndarray of int, shape (f,)
        In the order of the first column. Of equal rows the first one.

    Raises
    ------
    InputError
        If the costs are no table.
    """
    costs = np.asarray(costs, dtype=np.float64)
    if costs.ndim != 2:
        raise InputError(f"costs: expected one row for each candidate, got shape {costs.shape}")
    order = np.lexsort(costs.T[::-1])
    front: list[int] = []
    for k in order:
        row = costs[k]
        if not np.isfinite(row).all():
            continue
        # whatever beats a row stands before it in this order
        if not any(np.all(costs[j] <= row) for j in front):
            front.append(int(k))
    return np.array(front, dtype=np.int64)
