"""Plans of static poses: which way is up, in words for somebody who holds a box with its axes printed on it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import permutations, product

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats, readonly
from schuler.calibration.result.parameters import AXES
from schuler.exceptions import InputError
from schuler.plotting.notebook import Displayed
from schuler.units import DEG

#: Signs of up along x, y, z for the 6 faces, 12 edges and 8 corners, in this order; edges pair by pair of axes.
_STARTS = 24  # of the exchange search; from 6 on every number of poses gives the same plan
_LARGEST = 1e6  # stands for the variance of what a set of poses does not determine


def _attitudes() -> FloatArray:
    faces = [s * np.eye(3)[i] for i in range(3) for s in (1.0, -1.0)]
    edges = []
    for i, j in ((0, 1), (0, 2), (1, 2)):
        # opposite edges follow each other: an interrupted session still separates bias from scale
        for a, b in ((1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)):
            edges.append(a * np.eye(3)[i] + b * np.eye(3)[j])
    half = [np.array((1.0, b, c)) for b, c in product((1.0, -1.0), repeat=2)]
    corners = [v for k in half for v in (k, -k)]
    every = np.array(faces + edges + corners)
    return np.asarray(every / np.linalg.norm(every, axis=1, keepdims=True))


#: Directions of up of the 26 attitudes, unit vectors in body axes: 6 faces, 12 edges, 8 corners. Shape (26, 3).
ATTITUDES: FloatArray = readonly(_attitudes())

_SETS: dict[str, tuple[int, ...]] = {
    "faces": tuple(range(6)),
    "edges": tuple(range(6, 18)),
    "corners": tuple(range(18, 26)),
    "faces+corners": (*range(6), *range(18, 26)),
    "faces+edges": tuple(range(18)),
    "edges+corners": tuple(range(6, 26)),
    "faces+edges+corners": tuple(range(26)),
}
_NUMBERS = {
    6: "faces", 12: "edges", 14: "faces+corners", 18: "faces+edges", 20: "edges+corners", 26: "faces+edges+corners",
}  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Displayed):
    """Static poses to put a unit into.

    Attributes
    ----------
    name : str
        Such as ``"faces+edges"``.
    directions : ndarray, shape (n, 3)
        Up in body axes, unit vectors; at rest the specific force is gravity times this.
    words : tuple of str
        The same for people, see :func:`words_of`.
    """

    name: str
    directions: FloatArray
    words: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "directions", readonly(unit_vectors(self.directions).copy()))
        if len(self.words) != len(self.directions):
            raise InputError(f"words: expected one for each of {len(self.directions)} poses, got {len(self.words)}")

    def __len__(self) -> int:
        return len(self.directions)

    @cached_property
    def rank(self) -> int:
        """Number of the nine parameters, or combinations of them, that the poses determine without any scatter."""
        return int(np.linalg.matrix_rank(design_matrix(self.directions)))

    @property
    def condition(self) -> float:
        """Largest over smallest singular value of :func:`design_matrix`; infinite if the rank is below nine."""
        return float(np.linalg.cond(design_matrix(self.directions))) if self.rank == 9 else float("inf")

    def summary(self) -> str:
        """One line for each pose, numbered from 1, and what the set cannot do."""
        lines = [f"{self.name}: {len(self)} poses"]
        lines += [f"  {k:2d}  {text}" for k, text in enumerate(self.words, 1)]
        if self.rank < 9:
            lines.append(
                f"  determines {self.rank} of the 9 parameters from the magnitude of gravity alone; add "
                + ("edges or corners" if np.abs(np.abs(self.directions).max(axis=1) - 1.0).max() < 1e-9 else "faces")
            )
        return "\n".join(lines)


def unit_vectors(directions: ArrayLike, name: str = "directions") -> FloatArray:
    """Directions as unit vectors, shape (n, 3).

    Raises
    ------
    InputError
        If the shape is another or a vector has no length.
    """
    value = np.asarray(directions, dtype=np.float64)
    u = as_floats(value.reshape(-1, 3) if value.size == 0 else np.atleast_2d(value), name, (None, 3))
    length = np.linalg.norm(u, axis=1, keepdims=True)
    if (length == 0.0).any():
        raise InputError(f"{name}: expected directions of up, got a zero vector at index {int(np.argmin(length))}")
    return np.asarray(u / length)


def words_of(direction: ArrayLike) -> str:
    """Which way a box with printed axes has to lie so that ``direction`` points up.

    Parameters
    ----------
    direction : array_like, shape (3,)
        Up in body axes.

    Returns
    -------
    str
        ``"x down"``; ``"x up and y down at 45 deg, z level"``; ``"corner +x +y -z on top (x, y up and z down, each 35
        deg from level)"``; any other direction by the angle of each axis above or below level.
    """
    u = unit_vectors(direction, "direction")[0]
    k = int(np.argmax(ATTITUDES @ u))
    if ATTITUDES[k] @ u < 1.0 - 1e-6:  # more than 0.08 deg away
        angle = np.round(np.arcsin(np.clip(u, -1.0, 1.0)) / DEG).astype(int)
        text_parts = [
            f"{a} {abs(t)} deg {'above' if t > 0 else 'below'} level" for a, t in zip(AXES, angle, strict=True) if t
        ]
        text_parts += [f"{a} level" for a, t in zip(AXES, angle, strict=True) if not t]
        return ", ".join(text_parts)
    used = [(a, "up" if s > 0 else "down", "+" if s > 0 else "-") for a, s in zip(AXES, u, strict=True) if abs(s) > 0.1]
    if len(used) == 1:
        return f"{used[0][0]} {used[0][1]}"
    if len(used) == 2:
        level = next(a for a, s in zip(AXES, u, strict=True) if abs(s) < 0.1)
        (a, p, _), (b, q, _) = used
        tilt = f"{a} and {b} {p}" if p == q else f"{a} {p} and {b} {q}"
        return f"{tilt} at 45 deg, {level} level"
    parts = [
        f"{', '.join(a for a, p, _ in used if p == way)} {way}"
        for way in ("up", "down")
        if way in [p for _, p, _ in used]
    ]
    return f"corner {' '.join(sign + a for a, _, sign in used)} on top ({' and '.join(parts)}, each 35 deg from level)"


def plan_of(directions: ArrayLike, name: str = "own") -> Plan:
    """A plan of any directions of up, with words.

    Parameters
    ----------
    directions : array_like, shape (n, 3)
        Need not be normalised.
    name : str
    """
    u = unit_vectors(directions)
    return Plan(name, u, tuple(words_of(v) for v in u))


def attitude_plan(which: int | str) -> Plan:
    """One of the usual plans.

    Parameters
    ----------
    which : int or str
        6, 10, 12, 14, 18, 20 or 26, or ``"faces"``, ``"edges"``, ``"corners"`` and their sums such as
        ``"faces+edges"``. 10 is :func:`a_optimal_plan` (10): no set of ten in the source determines nine parameters.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        If there is no such plan.

    References
    ----------
    Hayal (2010), section 3.5 (26 attitudes, subsets of 18 and 10); Shin & El-Sheimy (2002).
    """
    if which == 10:
        return a_optimal_plan(10)
    name = _NUMBERS.get(which, "") if isinstance(which, int) else which.replace(" ", "")
    if name not in _SETS:
        raise InputError(
            f"plan: expected one of {', '.join(map(str, sorted((*_NUMBERS, 10))))} or {', '.join(_SETS)}, "
            f"got {which!r}; a_optimal_plan(n) chooses any other number"
        )
    return plan_of(ATTITUDES[list(_SETS[name])], name)


def design_matrix(directions: ArrayLike, parameters: int = 9) -> FloatArray:
    """Effect of the parameters on the measured magnitude of gravity, for a nearly perfect sensor.

    Parameters
    ----------
    directions : array_like, shape (n, 3)
        Up in body axes.
    parameters : {3, 6, 9}
        Biases; and scale factors; and non-orthogonality.

    Returns
    -------
    ndarray, shape (n, parameters)
        ``|f| - g`` per bias, per g times scale-factor error, per g times M_yx, M_zx, M_zy: products ``u_i``, ``u_i^2``,
        ``u_i u_j``. The condition is a quadric: squares give scale factors, products angles, linear terms biases.

    Raises
    ------
    InputError
        If the number of parameters is another.

    References
    ----------
    Hayal (2010), eqs. (3.63) to (3.71) at zero errors, divided by ``-2 g``.
    """
    if parameters not in (3, 6, 9):
        raise InputError(f"parameters: expected 3 (b), 6 (b, s) or 9 (b, s, non-orthogonality), got {parameters!r}")
    u = unit_vectors(directions)
    x, y, z = u.T
    return np.stack((x, y, z, x * x, y * y, z * z, x * y, x * z, y * z), axis=1)[:, :parameters]


@lru_cache(maxsize=32)
def _exchange(n: int) -> tuple[int, ...]:
    """Places in ATTITUDES of the best n found; the same every time."""
    rows = design_matrix(ATTITUDES)
    information = np.einsum("ki,kj->kij", rows, rows)
    groups = [_SETS[name] for name in ("faces", "edges", "corners")]
    starts = [sorted([k for group in order for k in group][:n]) for order in permutations(groups)]
    rng = np.random.default_rng(2010)
    starts += [sorted(rng.choice(26, n, replace=False).tolist()) for _ in range(_STARTS)]
    best: tuple[float, tuple[int, ...]] = (np.inf, ())
    for chosen in starts:
        value = _criterion(information[chosen].sum(axis=0)[None])[0]
        while True:
            outside = [k for k in range(26) if k not in chosen]
            if not outside:
                break
            total = information[chosen].sum(axis=0)
            trial = total - information[chosen][:, None] + information[outside][None, :]
            values = _criterion(trial.reshape(-1, 9, 9))
            k = int(np.argmin(np.round(values, 9)))
            if values[k] >= value - 1e-9:
                break
            value = values[k]
            chosen[k // len(outside)] = outside[k % len(outside)]
        key = (round(float(value), 9), tuple(sorted(chosen)))
        best = min(best, key)
    return best[1]


def _criterion(N: FloatArray) -> FloatArray:
    """Sum of the nine variances for each normal matrix, shape (k,); what is not determined counts as very large."""
    values = np.linalg.eigvalsh(N)
    return np.asarray(np.sum(1.0 / np.maximum(values, 1.0 / _LARGEST), axis=1))


def a_optimal_plan(n: int) -> Plan:
    """The n of the 26 attitudes with the least sum of the nine variances.

    Parameters
    ----------
    n : int
        9 to 26.

    Returns
    -------
    Plan
        The same for the same n. Biases count in gravity, scale factors and angles as numbers, all with one weight.

    Raises
    ------
    InputError
        If n is out of range: fewer than nine poses cannot determine nine parameters.

    Notes
    -----
    Exchange of one pose for another as long as that helps, from 24 starts (Fedorov's algorithm, here without weights
    and without repeated poses). A set that is best up to a turn or mirror of the box is as good as any of its images;
    one of them is returned.
    """
    if not (isinstance(n, int | np.integer) and 9 <= n <= 26):
        raise InputError(f"n: expected 9 to 26 poses for nine parameters, got {n!r}; repeat a plan for more")
    return plan_of(ATTITUDES[list(_exchange(int(n)))], f"A-optimal {n}")
