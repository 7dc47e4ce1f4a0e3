"""Slow errors of GNSS: recognised where fixes held back are likelier with them, or innovations of satellites stay."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import ACCEPTED, POSITION, PSEUDORANGE
from schuler.filtering.states import StateLayout, StateModel
from schuler.navigation.evaluation.consistency import matched_satellites
from schuler.navigation.evaluation.evidence import slow_nis
from schuler.navigation.prepared import PreparedRun

_TAUS = (60.0, 15.0, 240.0)  # correlation times that are tried, the first wherever no other is clearly likelier [s]
_SIZES = (1.5, 5.0)  # and 1-sigma, in those of the fixes
CLEARLY = 5.0  # difference of log likelihoods for that: a log of minutes tells sigma^2 / tau, and hardly tau
_LENGTHS = (10, 30, 100)  # innovations of a satellite in a sum
_ROUNDS = 4  # larger sigmas change what the filter follows, and so what stays in its innovations
_SETTLED = 1.1  # mean square of sums that is left


@dataclass(frozen=True)
class SlowError:
    """A Gauss-Markov error of GNSS positions.

    Attributes
    ----------
    sigma : float
        [m]
    tau : float
        [s]
    """

    sigma: float
    tau: float


def with_slow_error(prepared: PreparedRun, slow: SlowError) -> PreparedRun:
    """The run with states for a slow error of positions, which its start from a fix has in it.

    Parameters
    ----------
    prepared : PreparedRun
        Aligned, without the block ``b_r``.
    slow : SlowError
    """
    layout = prepared.layout
    wider = StateLayout({**layout.models, "b_r": StateModel.gauss_markov(slow.sigma, slow.tau)})
    part, n = wider["b_r"], layout.size
    J = np.zeros((n + 3, n))
    J[:n, :n] = np.eye(n)
    A = np.zeros((n + 3, 3))
    A[6:9] = -np.eye(3)  # the start is the fix's position: its slow error, with the sign turned
    A[part] = np.eye(3)
    P = J @ prepared.initial.P @ J.T + slow.sigma**2 * A @ A.T
    parameters = np.concatenate((prepared.initial.parameters, np.zeros(3)))
    return replace(prepared, layout=wider, initial=InitialState(prepared.initial.nav, P, parameters))


def candidates(prepared: PreparedRun) -> list[SlowError]:
    """Slow errors of positions to be tried, the usual first: larger than the fixes' 1-sigma, and much larger."""
    sigma = typical_sigma(prepared)
    return [SlowError(k * sigma, tau) for tau in _TAUS for k in _SIZES]


def scaled_start(initial: InitialState, layout: StateLayout, factor: float) -> InitialState:
    """Initial state of :func:`with_slow_error` with the error's sigma multiplied; ``layout`` has it before."""
    A = np.zeros((layout.size, 3))
    A[6:9] = -np.eye(3)
    A[layout["b_r"]] = np.eye(3)
    P = initial.P + (factor**2 - 1.0) * layout.models["b_r"].sigma ** 2 * A @ A.T
    return InitialState(initial.nav, P, initial.parameters)


def typical_sigma(prepared: PreparedRun) -> float:
    """Median horizontal 1-sigma of positions. [m]"""
    R = prepared.schedule.R[prepared.schedule.kind == POSITION]
    return float(np.sqrt(np.median(0.5 * (R[:, 0, 0] + R[:, 1, 1]))))


def range_factor(prepared: PreparedRun) -> tuple[float, float]:
    """Factor on sigmas of pseudoranges with which their slow errors weigh as much as they should; 1 if there are none.

    Parameters
    ----------
    prepared : PreparedRun
        Tightly coupled.

    Returns
    -------
    factor : float
    spread : float
        1-sigma of its logarithm: of a variance from as many sums as there are.

    Notes
    -----
    Reflections and what is left of the atmosphere stay on a satellite for a minute, and a filter that takes them for
    white averages them away in its claim only. Innovations of one satellite then keep their sign: the mean square of
    sums of n of them, over n, is not 1 but ``1 + 2 sum (1 - k/n) rho_k``, by which white noise must be enlarged to
    weigh as much in an average as long (as :func:`~schuler.navigation.inputs.satellites.inflated` does for an error
    whose size is stated). Repeated, since the filter then follows the slow errors less.
    """
    variance, spread = 1.0, 0.0
    if prepared.ranges is None:
        return variance, spread
    for _ in range(_ROUNDS):
        series = _by_satellite(_scaled(prepared, variance))
        sizes = [slow_nis(series, length) for length in _LENGTHS]
        clear = [size for size, limit in sizes if size > limit]
        if variance == 1.0 and not clear:
            break
        k = int(np.argmax([size for size, _ in sizes]))
        largest = sizes[k][0]
        spread = max(spread, float(0.5 * np.sqrt(2.0 / max(sum(len(z) // _LENGTHS[k] for z in series), 1))))
        if largest < _SETTLED:
            break
        variance *= largest
    return float(np.sqrt(variance)), spread


def _scaled(prepared: PreparedRun, variance: float) -> PreparedRun:
    """The run with variances of pseudoranges multiplied."""
    schedule = prepared.schedule
    factor = np.where(schedule.kind == PSEUDORANGE, variance, 1.0)
    return replace(prepared, schedule=replace(schedule, R=schedule.R * factor[:, None, None]))


def _by_satellite(prepared: PreparedRun) -> list[FloatArray]:
    """Accepted normalised innovations of pseudoranges, satellite by satellite. Each of shape (n, 1)."""
    assert prepared.ranges is not None
    schedule = prepared.schedule
    options = replace(prepared.options, record_s=1e9, output_rate_hz=0.01, adaptive=False, smoother=False)
    forward = replace(prepared, options=options).run()
    rows = np.flatnonzero(schedule.kind == PSEUDORANGE)
    sat = matched_satellites(schedule.t[rows], prepared.ranges, prepared.ranges.pseudorange)
    used: BoolArray = (forward.status[rows] == ACCEPTED) & (forward.variance[rows, 0] > 0.0)
    z = forward.innovation[rows, :1] / np.sqrt(np.where(used, forward.variance[rows, 0], 1.0))[:, None]
    return [z[used & (sat == s)] for s in np.unique(sat[sat > 0])]
