"""Linear time-varying systems: what a filter knows of its errors, from its transitions and its measurement rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.filtering.states import BLOCK_TEXT
from schuler.plotting.notebook import Abridged


@dataclass(frozen=True, repr=False)
class LinearSystem(Abridged):
    """An error state along a trajectory, sampled at nodes.

    Attributes
    ----------
    names : tuple of str, length n
        Names of the states: ``eps_N``, ``dv_E``, ``b_a_x``, ...
    t : ndarray, shape (k,)
        Nodes; the first is the start. [s]
    step : ndarray, shape (k, n, n)
        Transition into each node from the one before; the identity for the first.
    H : ndarray, shape (u, 3, n)
        Rows of every update, whitened: their noise has unit covariance. Unused rows are zero.
    at : ndarray of int, shape (u,)
        Node of every update, non-decreasing.
    sigma : ndarray, shape (n,)
        1-sigma before the first measurement, which is the unit every state is measured in. SI
    psd : ndarray, shape (n,)
        Power spectral densities of the noise that drives each state. [unit^2/s]
    prior : ndarray, shape (n, n), optional
        Covariance before the first measurement where it is not diagonal, for covariances over time: an attitude is
        correlated with the biases that spoiled it.
    doubt : ndarray, shape (k, n, n), optional
        How wrong the transitions from the start to each node may be; zero if they are exact.
    to_imu : ndarray, shape (3, 3)
        Attitude of the IMU at the start, ``C_ns``: from its axes to the axes of the names.
    axes : {"ned", "enu"}
    sign : {-1, 1}
        Sign of biases: -1 where they are errors of estimates, +1 where they are errors of the sensor.
    name : str
    notes : tuple of str

    Notes
    -----
    Errors are estimate minus truth, north-east-down, unless :func:`.axes.in_du_axes` made something else of them.
    """

    names: tuple[str, ...]
    t: FloatArray
    step: FloatArray
    H: FloatArray
    at: IntArray
    sigma: FloatArray
    psd: FloatArray
    to_imu: FloatArray
    doubt: FloatArray | None = None
    prior: FloatArray | None = None
    axes: str = "ned"
    sign: int = -1
    name: str = "system"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n, k, u = len(self.names), len(self.t), len(self.at)
        shapes = {"step": (k, n, n), "H": (u, 3, n), "sigma": (n,), "psd": (n,)}
        for what, shape in shapes.items():
            if np.shape(getattr(self, what)) != shape:
                raise InputError(f"{what}: expected shape {shape}, got {np.shape(getattr(self, what))}")
        if np.any(~np.isfinite(self.sigma)) or np.any(self.sigma <= 0.0):
            bad = [m for m, s in zip(self.names, self.sigma, strict=True) if not s > 0.0]
            raise InputError(
                f"prior 1-sigma: expected a positive number for every state, which is the unit its observability is "
                f"measured in; there is none for {', '.join(bad)}"
            )
        if u and (self.at.min() < 0 or self.at.max() >= k or np.any(np.diff(self.at) < 0)):
            raise InputError("at: expected nodes of the updates in the order of time")

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.names)

    @cached_property
    def phi(self) -> FloatArray:
        """Transition from the start to each node. Shape (k, n, n)."""
        out = np.empty_like(self.step)
        out[0] = self.step[0]
        for k in range(1, len(out)):
            out[k] = self.step[k] @ out[k - 1]
        return out

    def without(self, left_out: Sequence[str]) -> LinearSystem:
        """The system with some states known perfectly: their rows and columns are taken out.

        Parameters
        ----------
        left_out : sequence of str
            Names of states, or the beginning of several: ``dr`` stands for ``dr_N``, ``dr_E``, ``dr_D``.
        """
        gone: BoolArray = np.zeros(self.n, dtype=bool)
        for name in left_out:
            hit = np.array([m == name or m.startswith(f"{name}_") for m in self.names])
            if not hit.any():
                raise InputError(f"without: no state {name!r}; there are {', '.join(self.names)}")
            gone |= hit
        keep = np.flatnonzero(~gone)
        cut = np.ix_(np.arange(len(self.t)), keep, keep)
        return replace(
            self, names=tuple(self.names[i] for i in keep), step=self.step[cut], H=self.H[:, :, keep],
            sigma=self.sigma[keep], psd=self.psd[keep], doubt=None if self.doubt is None else self.doubt[cut],
            prior=None if self.prior is None else self.prior[np.ix_(keep, keep)],
        )  # fmt: skip

    def transformed(self, Q: ArrayLike, names: Sequence[str]) -> LinearSystem:
        """The same system in other states, ``x_new = Q x``.

        Parameters
        ----------
        Q : array_like, shape (n, n)
            Regular, constant.
        names : sequence of str, length n
        """
        Q = np.asarray(Q, dtype=np.float64)
        inverse = np.linalg.inv(Q)
        P = np.diag(np.square(self.sigma)) if self.prior is None else self.prior
        P = Q @ P @ Q.T
        return replace(
            self, names=tuple(names), step=Q @ self.step @ inverse, H=self.H @ inverse,
            sigma=np.sqrt(np.diag(P)), psd=np.square(Q) @ self.psd, prior=P,
            doubt=None if self.doubt is None else np.abs(Q @ self.doubt @ inverse),
        )  # fmt: skip

    def until(self, time: float) -> LinearSystem:
        """The part up to a time. [s]"""
        k = int(np.searchsorted(self.t, time + 1e-9, side="right"))
        if k < 1:
            raise InputError(f"time: expected at least {self.t[0]:g} s, got {time:g}")
        used = self.at < k
        return replace(
            self, t=self.t[:k], step=self.step[:k], H=self.H[used], at=self.at[used],
            doubt=None if self.doubt is None else self.doubt[:k],
        )  # fmt: skip


_AXES = {"dpsi": "eps", "dv": "dv", "dr": "dr"}
_ROWS = {3: ("x", "y", "z")}
_OFF_DIAGONAL = ("xy", "xz", "yx", "yz", "zx", "zy")
_MATRIX = {
    "M_a": ("xy", "xz", "yz"), "M_a6": _OFF_DIAGONAL, "M_g": _OFF_DIAGONAL,
    "G_g": tuple(a + b for a in "xyz" for b in "xyz"), "mount": ("pitch", "yaw"), "b_r": ("N", "E", "D"),
    "b_v": ("N", "E", "D"),
}  # fmt: skip


def state_names(blocks: dict[str, int]) -> tuple[str, ...]:
    """Names of states for people.

    Parameters
    ----------
    blocks : dict of str to int
        Block names of a :class:`~schuler.filtering.states.StateLayout` with their sizes, in order.

    Examples
    --------
    >>> state_names({"dpsi": 3, "b_g": 3})
    ('eps_N', 'eps_E', 'eps_D', 'b_g_x', 'b_g_y', 'b_g_z')
    """
    names: list[str] = []
    for block, size in blocks.items():
        if block not in BLOCK_TEXT:
            raise InputError(f"unknown state block {block!r}; known are {', '.join(BLOCK_TEXT)}")
        if block in _AXES:
            names += [f"{_AXES[block]}_{axis}" for axis in "NED"]
        elif size == 1:
            names.append(block)
        else:
            names += [f"{block}_{part}" for part in _MATRIX.get(block) or _ROWS.get(size) or map(str, range(size))]
    return tuple(names)
