"""Fixed-lag smoothing of a live run: the batch smoother over the last seconds."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray
from schuler.filtering.engine import smoother_nodes, unpack_symmetric
from schuler.filtering.filter_arrays import NodeArrays, TrajectoryArrays, nothing_after
from schuler.live.replay import ReplayFilter, copied
from schuler.mechanization.strapdown import NavState


def smoothed(run: ReplayFilter, lag_s: float) -> tuple[NavState, FloatArray] | None:
    """State a lag before the newest sample, smoothed with everything up to that sample.

    Parameters
    ----------
    run : ReplayFilter
        It remembers the lag and two propagations of the covariance, and is not changed.
    lag_s : float
        [s]

    Returns
    -------
    NavState
        At the latest sample that is as old.
    ndarray, shape (n, n)
        Its covariance in Earth-fixed axes, at the propagation before.
    None
        While the run is younger than the lag.

    Notes
    -----
    The forward pass is run again from the stored state before the lag, this time with the smoother's memory, and ends
    as the run of a log ends; then the backward pass goes over it. The numbers are those of the batch smoother over
    the data so far, since what a backward pass has at a time depends on nothing before it.
    """
    from schuler.filtering.kernels import run as forward
    from schuler.filtering.kernels import smoother as backward

    state = run.state
    at = run.time - lag_s + 1e-9
    # a state between two propagations has the covariance of the one before: the next must not be later than the lag
    before = at - 2.0 * run.propagation_s
    stored = [s for s in run.snapshots if s.times[0] <= (at if s.acc[0] == 0.0 else before)]
    if not stored:
        return None
    arrays = copied(stored[-1])
    for count in (forward.CNT_NODE, forward.CNT_UPD, forward.CNT_OUT, forward.CNT_EPOCH, forward.CNT_FLUSH):
        arrays.counts[count] = 0
    t = run.samples["t"]
    first, n, n_sensor = int(np.searchsorted(t, arrays.times[0], side="right")), state.layout.size, state.model.n_sensor
    count, updates = len(t) - first, len(run.aiding.t)
    out = TrajectoryArrays.of_size(count)
    node = NodeArrays.of_size(count + (2 + state.model.free_axes) * updates + 2, updates, n, n_sensor)
    run.run_again(arrays, first, out, node)
    a, u = int(arrays.counts[forward.CNT_NODE]), int(arrays.counts[forward.CNT_UPD])
    nodes = smoother_nodes(node, a, u, state)
    row = int(np.searchsorted(out.t, at, side="right")) - 1
    k = int(np.searchsorted(nodes.t, out.t[row] + 1e-9, side="right")) - 1  # the last of a time, as in a batch run
    record = np.full(a, -1, dtype=np.int64)
    record[k] = 0
    minus, plus, dx, packed = np.empty((a, 9)), np.empty((a, 9)), np.empty((1, n)), np.empty((1, n * (n + 1) // 2))
    backward.prepare_smoother()
    backward.smooth(nodes, record, minus, plus, dx, packed, nothing_after(n), True)
    t_row, q, v, r = (x[row : row + 1].copy() for x in out)
    backward.apply_corrections(t_row, q, v, r, nodes.t.copy(), minus, plus)
    return NavState(float(t_row[0]), r[0], v[0], q[0]), unpack_symmetric(packed, n)[0]
