"""Passes one after the other, and the heading that none of the sensors is told: the Earth's rate points somewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler import frames
from schuler.arrays import FloatArray
from schuler.calibration.field.blocks import Blocks
from schuler.calibration.field.filter_pass import NEAR, Pass, Problem, filter_pass
from schuler.calibration.field.softening import believable_sigma, softened, softness
from schuler.filtering.engine import unpack_symmetric
from schuler.filtering.error_model import sensor_matrices
from schuler.frames import wrap_angle

#: 1-sigma of a heading that is not known, once the best of the starts is found. [rad]
FREE = 1.0
#: A heading told to this or better is believed. A worse one is looked for near and far, see :func:`search_heading`:
#: linearised where it was told, horizontal Earth rate would be wrong by an eighth and more. [rad]
TOLD = 0.5
# starts tried, and how near to them headings are held meanwhile [rad]
_STARTS, _NEAR = 8, 0.3
_MOST = 6  # passes before


def level(blocks: Blocks, problem: Problem, parameters: FloatArray) -> FloatArray:
    """Roll and pitch of the first rest from its mean specific force, compensated; heading zero."""
    f = blocks.f[blocks.rest == 0].mean(axis=0)
    _, b_a, _, M_a, _ = sensor_matrices(problem.layout, parameters)
    f = np.linalg.solve(np.eye(3) + M_a, f - b_a)
    return np.array([np.arctan2(-f[1], -f[2]), np.arctan2(f[0], np.hypot(f[1], f[2])), 0.0])


def next_pass(problem: Problem, blocks: Blocks, before: Pass, known: bool) -> Pass:
    """A pass linearised at the result of the one before, its heading too where that is estimated."""
    rpy = level(blocks, problem, before.values)
    rpy[2] = before.rpy[2] if known else smoothed_heading(problem, before)[0]
    tilt = _tilt_sigma(problem, blocks, before)
    sigma = believable_sigma(problem, before)
    factor = softness(problem, np.minimum(NEAR * sigma, np.sqrt(problem.layout.initial_variances())))
    soft = replace(softened(problem, factor), tilt_sigma=tilt)
    return replace(filter_pass(soft, rpy, before.values, sigma, smoothable=not known), softness=factor)


def first_pass(problem: Problem, blocks: Blocks, rpy: FloatArray) -> Pass:
    """A pass linearised at the prior, gyroscope biases at the mean rates of the rests.

    From a bias that is off by degrees per second the attitude would be lost before the first correction.
    """
    start = problem.prior.copy()
    if "b_g" in problem.layout:
        at = problem.layout["b_g"]
        start[at.start - 9 : at.stop - 9] = np.median(blocks.omega[blocks.rest >= 0], axis=0)
    factor = softness(problem, np.sqrt(problem.layout.initial_variances()))
    return replace(filter_pass(softened(problem, factor), rpy, start), softness=factor)


def _tilt_sigma(problem: Problem, blocks: Blocks, before: Pass) -> float:
    """Ten times what levelling with the parameters of a pass is uncertain by. [rad]

    Its readings count in the filter too, so it must not say much itself; wider, and tilts that wander while little is
    known would bend the scale factors (by 100 ppm at automotive grade).
    """
    first = blocks.rest == 0
    f = blocks.f[first].mean(axis=0)
    J = np.zeros((3, len(before.values)))
    for k, (sensor, axis, source) in enumerate(problem.layout.table()[: problem.layout.n_sensor]):
        if sensor == 1:
            J[axis, k] = 1.0 if source == 0 else f[source - 1]
    variance = np.diag(J @ before.covariance @ J.T) + problem.noise.f**2 / blocks.length[first].sum()
    return float(min(problem.tilt_sigma, 10.0 * np.sqrt(variance.max()) / np.linalg.norm(f)))


def search_heading(problem: Problem, blocks: Blocks, rpy: FloatArray, told: float = np.inf) -> Pass:
    """A pass at the heading that explains the log best: the Earth's horizontal rate points somewhere.

    A heading that was told, that of ``rpy`` with the 1-sigma ``told`` [rad], says which of several that do is meant.
    Tried only when the sensors are known so well that linearisation errors do not hide it; headings are held near
    their start, since a filter that turns by radians in the middle of a log is not linear any more.
    """
    near = replace(problem, heading_sigma=_NEAR)
    best = first_pass(near, blocks, rpy)
    for k in range(_MOST):
        best = next_pass(near, blocks, best, True)
        if k > 0 and best.softness == 1.0:
            break
    angles = rpy[2] + 2.0 * np.pi * np.arange(_STARTS) / _STARTS
    tried = [next_pass(near, blocks, replace(best, rpy=np.array([*rpy[:2], angle])), True) for angle in angles]
    off = wrap_angle(angles - rpy[2]) / told
    best = tried[int(np.argmin([p.cost for p in tried] + off**2))]
    assert best.variance is not None
    best = filter_pass(near, best.rpy, best.start, np.sqrt(best.variance) / NEAR, smoothable=True)
    for _ in range(2):
        best = next_pass(near, blocks, best, False)
    return best


def smoothed_heading(problem: Problem, last: Pass) -> tuple[float, float]:
    """Heading at the start as the whole log sees it, and its 1-sigma. [rad]"""
    from schuler.filtering.kernels import smoother as k

    nodes = last.run.nodes
    assert nodes is not None
    k.prepare_smoother()
    n = problem.layout.size
    record = np.full(len(nodes.t), -1, dtype=np.int64)
    record[0] = 0
    minus, plus = np.empty((len(nodes.t), n)), np.empty((len(nodes.t), n))
    packed = np.empty((1, n * (n + 1) // 2))
    k.smooth(
        nodes.P, nodes.phi, nodes.B, nodes.upd, nodes.W, nodes.G, nodes.e, nodes.pmod, nodes.n_sensor, nodes.i_clock,
        nodes.omega, record, minus, plus, packed,
    )  # fmt: skip
    down = frames.C_en(problem.llh)[:, 2]
    turn = float(down @ plus[0, :3])
    P = unpack_symmetric(packed, n)[0, :3, :3]
    variance = max(float(down @ P @ down), 0.0)
    return float(wrap_angle(last.rpy[2] + turn)), float(np.sqrt(variance))
