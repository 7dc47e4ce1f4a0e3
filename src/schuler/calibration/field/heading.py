"""Passes one after the other, and the search for an unknown heading by the Earth's horizontal rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import frames
from schuler.arrays import FloatArray
from schuler.calibration.field.blocks import Blocks
from schuler.calibration.field.filter_pass import NEAR, Pass, filter_pass
from schuler.calibration.field.noise_inflation import inflate_noise, inflated_sigma, noise_inflation
from schuler.calibration.field.problem import Problem
from schuler.filtering.engine import unpack_symmetric
from schuler.filtering.error_model import sensor_matrices
from schuler.filtering.filter_arrays import nothing_after
from schuler.filtering.node_parts import whole_nodes
from schuler.frames import wrap_angle
from schuler.rotation import dcm_from_quat, dcm_from_rpy

_STARTS = 8  # headings tried
_NEAR = 0.3  # 1-sigma of the heading about each of them [rad]
_PASSES = 6  # at most, before the search


def level_attitude(blocks: Blocks, problem: Problem, parameters: FloatArray) -> FloatArray:
    """Roll and pitch of the first rest from its mean specific force, compensated; heading zero."""
    f = blocks.f[blocks.rest == 0].mean(axis=0)
    _, b_a, _, M_a, _ = sensor_matrices(problem.layout, parameters)
    f = np.linalg.solve(np.eye(3) + M_a, f - b_a)
    return np.array([np.arctan2(-f[1], -f[2]), np.arctan2(f[0], np.hypot(f[1], f[2])), 0.0])


def next_pass(problem: Problem, blocks: Blocks, before: Pass, heading_given: bool) -> Pass:
    """Run a pass linearised at the result of the one before, at its smoothed heading unless one is given."""
    rpy = level_attitude(blocks, problem, before.values)
    rpy[2] = before.rpy[2] if heading_given else smoothed_heading(problem, before)[0]
    tilt = _tilt_sigma(problem, blocks, before)
    sigma = inflated_sigma(problem, before)
    within = np.minimum(NEAR * sigma, np.sqrt(problem.layout.initial_variances()))
    factor = 1.0 if problem.near else noise_inflation(problem, within)
    inflated = replace(inflate_noise(problem, factor), tilt_sigma=tilt)
    return replace(
        filter_pass(inflated, rpy, before.values, sigma, smoothable=not heading_given), noise_inflation=factor
    )


def first_pass(problem: Problem, blocks: Blocks, rpy: FloatArray) -> Pass:
    """Run a pass linearised at the prior, gyroscope biases at the mean rates of the rests.

    With a bias that is off by degrees per second the attitude would be lost before the first correction.
    """
    start = problem.prior.copy()
    if "b_g" in problem.layout:
        at = problem.layout["b_g"]
        start[at.start - 9 : at.stop - 9] = np.median(blocks.omega[blocks.rest >= 0], axis=0)
    factor = noise_inflation(problem, np.sqrt(problem.layout.initial_variances()))
    return replace(filter_pass(inflate_noise(problem, factor), rpy, start), noise_inflation=factor)


def _tilt_sigma(problem: Problem, blocks: Blocks, before: Pass) -> float:
    """Ten times the 1-sigma of levelling with the parameters of a pass. [rad]

    The filter uses the same readings, so the start must carry little information; a wider one lets tilts wander at
    first and biases the scale factors (by 100 ppm at automotive grade).
    """
    first = blocks.rest == 0
    f = blocks.f[first].mean(axis=0)
    J = np.zeros((3, len(before.values)))
    for k, (sensor, axis, source) in enumerate(problem.layout.table()[: problem.layout.n_sensor]):
        if sensor == 1:
            J[axis, k] = 1.0 if source == 0 else f[source - 1]
    variance = np.diag(J @ before.covariance @ J.T) + problem.noise.f**2 / blocks.length[first].sum()
    return float(min(problem.tilt_sigma, 10.0 * np.sqrt(variance.max()) / np.linalg.norm(f)))


def search_heading(
    problem: Problem,
    blocks: Blocks,
    rpy: FloatArray,
    sigma: float = np.inf,
    start: tuple[FloatArray, FloatArray] | None = None,
) -> Pass:
    """Run passes from eight headings and continue with the one of least cost.

    A roughly given heading, that of ``rpy`` with 1-sigma ``sigma`` [rad], decides between several that fit. The
    search comes after the sensors are calibrated so well that linearisation errors do not hide the heading; headings
    are held near their start, since a filter that turns by radians in the middle of a log is not linear any more.
    ``start``: parameters and their 1-sigma to linearise the first pass at, instead of the prior.
    """
    near = replace(problem, heading_sigma=_NEAR)
    best = first_pass(near, blocks, rpy) if start is None else filter_pass(near, rpy, *start)
    for k in range(_PASSES):
        best = next_pass(near, blocks, best, True)
        if k > 0 and best.noise_inflation == 1.0:
            break
    angles = rpy[2] + 2.0 * np.pi * np.arange(_STARTS) / _STARTS
    passes = [next_pass(near, blocks, replace(best, rpy=np.array([*rpy[:2], angle])), True) for angle in angles]
    off = wrap_angle(angles - rpy[2]) / sigma
    best = passes[int(np.argmin([p.cost for p in passes] + off**2))]
    assert best.variance is not None
    best = filter_pass(near, best.rpy, best.start, np.sqrt(best.variance) / NEAR, smoothable=True)
    for _ in range(2):
        best = next_pass(near, blocks, best, False)
    return best


def heading_at(problem: Problem, last: Pass, time: float) -> tuple[float, float, float]:
    """Heading that goes with the levelled roll and pitch at a time, its 1-sigma, and the pitch. [rad]

    Roll and pitch are those of :func:`level_attitude`, with which the heading of an upright x axis is nearly arbitrary.
    """
    k = int(np.clip(np.searchsorted(last.run.rec_t, time), 0, len(last.run.rec_t) - 1))
    C_en = frames.C_en(problem.llh)
    C_nb = C_en.T @ dcm_from_quat(last.run.rec_nav[k, :4])
    f = -C_nb[2]
    level = np.array([np.arctan2(-f[1], -f[2]), np.arctan2(f[0], np.hypot(f[1], f[2])), 0.0])
    turn = C_nb @ dcm_from_rpy(level).T
    P = unpack_symmetric(last.run.rec_P[k : k + 1], problem.layout.size)[0, :3, :3]
    variance = max(float(C_en[:, 2] @ P @ C_en[:, 2]), 0.0)
    return float(np.arctan2(turn[1, 0], turn[0, 0])), float(np.sqrt(variance)), float(level[1])


def smoothed_heading(problem: Problem, last: Pass) -> tuple[float, float]:
    """Heading at the start, smoothed over the complete log, and its 1-sigma. [rad]"""
    from schuler.filtering.kernels import smoother as k

    assert last.run.nodes is not None
    nodes = whole_nodes(last.run.nodes)
    k.prepare_smoother()
    n = problem.layout.size
    record = np.full(len(nodes.t), -1, dtype=np.int64)
    record[0] = 0
    minus, plus = np.empty((len(nodes.t), 9)), np.empty((len(nodes.t), 9))
    dx, packed = np.empty((1, n)), np.empty((1, n * (n + 1) // 2))
    k.smooth(nodes, record, minus, plus, dx, packed, nothing_after(n), True)
    down = frames.C_en(problem.llh)[:, 2]
    turn = float(down @ dx[0, :3])
    P = unpack_symmetric(packed, n)[0, :3, :3]
    variance = max(float(down @ P @ down), 0.0)
    return float(wrap_angle(last.rpy[2] + turn)), float(np.sqrt(variance))
