"""What the smoother needs of a long run, a part at a time: the filter runs again over a part that is asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from schuler.arrays import FloatArray
from schuler.filtering.filter_arrays import SmootherNodes, nothing_after


class Part(NamedTuple):
    """Epochs of a part, the filter's arrays as they were before them, and how many nodes and updates they have."""

    first: int
    stop: int
    start: tuple[np.ndarray, ...]
    nodes: int  # from the second part on with one more: the last node of the part before, whose updates may be here
    updates: int


class NodeParts:
    """Nodes of a run in parts, of which the memory holds one.

    Parameters
    ----------
    parts : list of Part
    states : int
        Number of states.
    arrays : tuple of ndarray
        On which ``again`` works: state and workspace, for the rates of an interval may be those of the one before.
    again : callable
        Filters the epochs of a part with the state as it is and keeps its nodes.
    nodes : callable
        Nodes kept, by the numbers of nodes and updates.
    """

    def __init__(
        self,
        parts: list[Part],
        states: int,
        arrays: tuple[np.ndarray, ...],
        again: Callable[[int, int], None],
        nodes: Callable[[int, int], SmootherNodes],
    ) -> None:
        self.states, self._parts, self._arrays, self._again, self._nodes = states, parts, arrays, again, nodes
        self._held = len(parts) - 1  # the last is there when the run has ended

    def __len__(self) -> int:
        return sum(part.nodes for part in self._parts) - len(self._parts) + 1

    def backwards(self) -> Iterator[tuple[int, bool, SmootherNodes]]:
        """Parts from the last to the first: number of the first node in the run, whether it begins the run, nodes.

        One that does not begin the run is the last node of the part before; of it only updates are there.
        """
        first = len(self)
        for k in range(len(self._parts) - 1, -1, -1):
            part = self._parts[k]
            if k != self._held:
                for x, then in zip(self._arrays, part.start, strict=True):
                    x[...] = then
                self._again(part.first, part.stop)
                self._held = k
            first -= part.nodes - (k > 0)
            yield first - (k > 0), k == 0, self._nodes(part.nodes, part.updates)

    def whole(self) -> SmootherNodes:
        """All of them at once."""
        kept: list[tuple[int, dict[str, Any]]] = []
        for first, begins, part in self.backwards():
            own = slice(0 if begins else 1, None)
            arrays = {x: getattr(part, x)[own].copy() for x in ("t", "P", "phi", "B")}
            kept.append((first, arrays | {x: getattr(part, x).copy() for x in ("W", "G", "e", "upd")}))
        kept.reverse()
        upd, done = np.empty(len(self), dtype=np.int64), 0
        for first, arrays in kept:  # the last node of the part before is counted up once more
            here = arrays.pop("upd")
            upd[first : first + len(here)] = done + here
            done += len(arrays["W"])
        joined: dict[str, Any] = {x: np.concatenate([arrays[x] for _, arrays in kept]) for x in kept[0][1]}
        return part._replace(**joined, upd=upd)


def whole_nodes(nodes: SmootherNodes | NodeParts) -> SmootherNodes:
    """Nodes of a run that may be in parts."""
    return nodes.whole() if isinstance(nodes, NodeParts) else nodes


def smooth_nodes(
    nodes: SmootherNodes | NodeParts, t: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Backward pass of the smoother over all nodes of a run.

    Parameters
    ----------
    nodes : SmootherNodes or NodeParts
    n : int
    t : ndarray, shape (r,)
        Times of nodes at which all states are wanted, ascending. [s]

    Returns
    -------
    t_nodes : ndarray, shape (k,)
        [s]
    minus, plus : ndarray, shape (k, 9)
        What to add to attitude, velocity and position before and after the updates of each node, Earth-fixed axes.
    dx : ndarray, shape (r, n)
        What to add to all states at ``t``, after the updates; of several nodes of a time at the last.
    packed : ndarray, shape (r, n (n + 1) / 2)
        Smoothed covariances there.
    """
    from schuler.filtering.kernels import smoother as k

    k.prepare_smoother()
    if isinstance(nodes, NodeParts):
        n, count, parts = nodes.states, len(nodes), nodes.backwards()
    else:
        n, count, parts = nodes.W.shape[2], len(nodes.t), iter([(0, True, nodes)])
    t_nodes, minus, plus = np.empty(count), np.empty((count, 9)), np.empty((count, 9))
    dx, packed = np.full((len(t), n), np.nan), np.full((len(t), n * (n + 1) // 2), np.nan)
    carry = nothing_after(n)
    left = len(t)
    for first, begins, part in parts:
        own = slice(0 if begins else 1, None)
        # as the filter takes a measurement for one at a sample: not later than 1e-9 s after it, which is included; and
        # a covariance enlarged at a time makes two nodes of it
        at = np.searchsorted(part.t[own], t[:left] + 1e-9, side="right") - 1
        here = int(np.searchsorted(at, 0))
        record = np.full(len(part.t), -1, dtype=np.int64)
        record[own][at[here:]] = np.arange(here, left)
        left = here
        rows = slice(first, first + len(part.t))
        t_nodes[rows][own] = part.t[own]
        k.smooth(part, record, minus[rows], plus[rows], dx, packed, carry, begins)
    return t_nodes, minus, plus, dx, packed
