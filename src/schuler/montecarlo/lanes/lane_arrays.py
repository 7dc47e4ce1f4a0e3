"""Arrays that runs in lock-step work on, by what they are: tuples with names, for Python and for the kernel.

All arrays are C-contiguous float64 but where it is said. A last axis LANES is one run each; times, true motion,
schedule and filter model are shared by all runs. This module does not import numba.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from schuler.arrays import FloatArray, IntArray


class LaneLog(NamedTuple):
    """Increments of an ideal IMU over the whole log, body axes, and what is done at the end of each interval."""

    dtheta: FloatArray  # (k, 3) [rad]
    dv: FloatArray  # (k, 3) [m/s]
    t: FloatArray  # (k,) ends of the intervals [s]
    h: float  # interval [s]
    plan: IntArray  # (k,) int64: 1 propagate the covariance, 2 also record


class LaneFixes(NamedTuple):
    """Positions and velocities of an antenna, true values and the noise to draw."""

    t: FloatArray  # (m,) [s]
    kind: IntArray  # (m,) int64
    z: FloatArray  # (m, N_VALUES) true values
    noise: FloatArray  # (m, 3) 1-sigma
    axes: FloatArray  # (m, 9) axes of that noise
    R: FloatArray  # (m, 9)
    lever: FloatArray  # (m, 3) [m]
    gate: FloatArray  # (m,) below 0: not used


class LaneSky(NamedTuple):
    """Errors of satellites' ranges and the receiver's clock, drawn by each run; empty without single satellites."""

    error: FloatArray  # (m, LANES) measured minus true, clock included, by measurement [m], [m/s]
    clock: FloatArray  # (r, c, LANES) true clock states at the records
    clock_at: IntArray  # (c,) int64: their places among the parameters


class LaneErrors(NamedTuple):
    """Errors of the sensors of each run."""

    constants: FloatArray  # (33, LANES) b_g, b_a, M_g, M_a, G_g row by row
    white: FloatArray  # (6,) 1-sigma of the white noise of an increment
    # (p, 5) in-run processes ``x <- e x + q n + s`` by sample: sensor (0 gyroscope, 1 accelerometer), e, q, first
    # parameter they count to (-1 for none), and whether s is not zero
    process: FloatArray
    wander: FloatArray  # (6 p, LANES) their values at the first sample (3 p), and s (3 p)
    # (m, LANES) true values of the parameters without in-run processes; of a receiver's clock zero
    true: FloatArray
    streams: npt.NDArray[np.uint64]  # (12, LANES) uint64: of white noise, processes and measurements, four each
    response: bool  # there are scale factors, misalignments or g-sensitivities


class LaneState(NamedTuple):
    """State of the filters: the start, which becomes the end."""

    nav: FloatArray  # (10, LANES) q_eb, v_eb_e, r_eb_e
    est: FloatArray  # (m, LANES) parameter estimates
    P: FloatArray  # (n, n, LANES)


class LaneModel(NamedTuple):
    """What the filters believe and how they run, see :class:`~schuler.filtering.filter_arrays.Model`."""

    table: IntArray  # (m, 3) int64
    n_sensor: int  # parameters that are errors of the IMU, which come first
    places: IntArray  # (15,) int64: first state of each block in filtering.limits.PLACES, or -1
    dynamics: FloatArray  # (m, 2)
    psd: FloatArray  # (6,)
    omega: float  # Earth rate [rad/s]
    every: int  # samples between two propagations of the covariance
    lockout: int
    matrix: bool  # scale factors, misalignments or g-sensitivities are estimated
    cross: bool  # g-sensitivities are: accelerometer errors act on the attitude
    free_axes: bool  # cross-couplings of both triads are, see filtering.kernels.axes


class LaneTruth(NamedTuple):
    """True motion at the records."""

    nav: FloatArray  # (r, 10) q_eb, v_eb_e, r_eb_e
    C_en: FloatArray  # (r, 9)
    blocks: IntArray  # (b, 2) int64: states of which a NEES is kept, from and to before


class LaneRecordArrays(NamedTuple):
    """What is kept of the runs."""

    error: FloatArray  # (r, n, LANES) navigation in north, east, down; states behind the first n are not recorded
    sigma: FloatArray  # (r, n, LANES)
    nees: FloatArray  # (r, b, LANES)
    # (N_COUNTS, LANES) sum of normalised innovations, accepted and rejected, of positions, then of velocities; largest
    # squared rotation of an interval; 1 if the engine would have readmitted fixes or adapted its noise (two rejections
    # in a row, or innovations that stay too large); forgotten mean of the normalised innovations of both kinds, less 1;
    # sum of normalised innovations, accepted and rejected, of pseudoranges, range rates and carrier phases
    counts: FloatArray


class LaneWorkspace(NamedTuple):
    """Memory that the kernel writes before it reads it, as arrays of lanes."""

    poly: FloatArray  # (3, 18) raw, compensated, part of an interval
    increments: FloatArray  # (3, 6) now, before, earlier
    bias: FloatArray  # (6,)
    z: FloatArray  # (6,) normals
    driving: FloatArray  # normals of the in-run processes
    reg: FloatArray  # (7,) integrals of the regressors
    acc: FloatArray  # (8,) transition accumulated since the last propagation
    moment: FloatArray  # (3,) velocity increments times mid time
    before: FloatArray  # (4 + m,) attitude and parameters before the updates of a time
    past: FloatArray  # (every + 2, N_PAST) intervals since the last propagation
    fix: FloatArray  # (3,) a measurement with its noise
    y: FloatArray  # (3,)
    e: FloatArray  # (3,)
    locks: FloatArray  # (2,) rejections in a row, of positions and velocities
    sens: FloatArray  # (33,) estimated sensor errors
    N: FloatArray  # (9,)
    M: FloatArray  # (2, 3, 3)
    U: FloatArray  # (3, 3)
    H: FloatArray  # (3, 6)
    Hp: FloatArray  # (m, 3)
    A: FloatArray  # (9, 9)
    sums: FloatArray  # (4, 7, 9)
    B: FloatArray  # (m, 9) parameter columns of the transition
    W: FloatArray  # (n, 3)
    turned: FloatArray  # (n, 9)
    dx: FloatArray  # (n,)
    zn: FloatArray  # (n,)
    L: FloatArray  # (n (n + 1) / 2,)
    row: FloatArray  # (1, n) row of H of a satellite
    w: FloatArray  # (n,)
    range_locks: FloatArray  # (3,) rejections less acceptances, of codes, range rates and phases
