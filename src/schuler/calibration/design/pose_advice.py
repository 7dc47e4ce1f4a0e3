"""Which pose to collect next for a triad whose reference is known by magnitude only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, as_floats
from schuler.calibration.design.plans import ATTITUDES, design_matrix
from schuler.calibration.result.parameters import AXES

#: Columns of :func:`schuler.calibration.design.plans.design_matrix` in the order of PARAMETERS.
_COLUMNS = [0, 1, 2, 3, 4, 5, 6, 8, 7]
_PAIRS = {"theta_yz": (0, 1), "theta_zx": (1, 2), "theta_zy": (0, 2)}


def next_directions(directions: ArrayLike, free: BoolArray, count: int = 1) -> FloatArray:
    """Faces, edges or corners that add most to what is known least.

    Parameters
    ----------
    directions : array_like, shape (n, 3)
        Collected so far.
    free : ndarray of bool, shape (9,)
        Which parameters are sought.
    count : int
        How many poses.

    Returns
    -------
    ndarray, shape (count, 3)
        Each the best one after those before it (D-optimal exchange over the 26 directions of a box).
    """
    rows, new = (design_matrix(u)[:, _COLUMNS][:, free] for u in (directions, ATTITUDES))
    # a little of everything is known, so that the determinant exists before the design has full rank
    N = rows.T @ rows + 1e-6 * np.eye(rows.shape[1])
    chosen = []
    for _ in range(count):
        gain = np.einsum("ij,jk,ik->i", new, np.linalg.inv(N), new)
        best = int(np.flatnonzero(gain > gain.max() * (1.0 - 1e-6))[0])  # the simplest one of equals
        chosen.append(ATTITUDES[best])
        N = N + np.outer(new[best], new[best])
    return np.array(chosen).reshape(-1, 3)


def reasons(undetermined: Sequence[str], directions: ArrayLike) -> list[str]:
    """Why parameters are not determined and what would help, in sentences.

    Parameters
    ----------
    undetermined : sequence of str
        Names out of :data:`schuler.calibration.bench.sensor_geometry.PARAMETERS`.
    directions : array_like, shape (n, 3)
        Of the reference in body axes.
    """
    u = as_floats(directions, "directions", (None, 3))
    sentences: list[str] = []
    mixed: list[str] = []
    for name in undetermined:
        if name in _PAIRS:
            i, j = _PAIRS[name]
            why = f"no pose with {AXES[i]} and {AXES[j]} both inclined" if np.abs(u[:, i] * u[:, j]).max() < 0.1 else ""
        else:
            i, way = AXES.index(name[-1]), f"{name[-1]} along the reference"
            if name[0] == "s":
                why = (
                    "" if np.abs(u[:, i]).max() > 0.9 else f"no pose with {way}, which tells its scale from the others'"
                )
            else:
                both = (u[:, i] > 0.3).any() and (u[:, i] < -0.3).any()
                why = "" if both else f"no poses with {way} and against it"
        if why:
            sentences.append(f"{name} not determined: {why}")
        else:
            mixed.append(name)
    if mixed:
        sentences.append(
            f"{', '.join(mixed)} not determined: these poses do not tell {'it' if len(mixed) == 1 else 'them'} apart"
        )
    return sentences
