"""Chapter 3: geometry of a triad, coefficient matrices, attitudes and what they determine."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.reproduce.cells import against, claimed, digits
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.plotting.figure import Figure


def _geometry(effort: Effort) -> Outcome:
    from schuler.calibration.bench.sensor_geometry import triad_matrix, triad_parameters, triad_reading, triad_truth

    rng = np.random.default_rng(effort.seed)
    b, s, theta = 0.1 * rng.standard_normal((3, 3))
    v = rng.standard_normal((50, 3))
    loss = float(np.abs(triad_truth(triad_reading(v, b, s, theta), b, s, theta) - v).max())
    back = triad_parameters(triad_matrix(s, theta))
    small = triad_matrix(np.zeros(3), np.full(3, 1e-4), small_angle=True)
    exact = triad_matrix(np.zeros(3), np.full(3, 1e-4))
    cells = (
        against("(3.9) as printed", -np.sin(1e-4), exact[2, 0], absolute=1e-12, tolerance="rounding"),
        against("(3.15) as printed", 1e-4, small[2, 1], absolute=1e-12, tolerance="rounding"),
        claimed("(3.13), (3.14): there and back", "inverse of each other", loss, high=1e-13, tolerance="rounding"),
        claimed(
            "(3.13): s and theta from the matrix",
            "the same",
            float(np.abs(np.array(back) - (s, theta)).max()),
            high=1e-13,
            tolerance="rounding",
        ),
        claimed(
            "(3.15) and (3.13) at 100 urad",
            "first order",
            float(np.abs(small - exact).max()),
            high=2e-8,
            tolerance="band",
        ),
        against(
            "(3.9), (3.10): first component of z1 at 100 urad",
            np.sin(1e-4),
            exact[2, 0],
            absolute=1e-12,
            tolerance="rounding",
            reference="corrected",
            source="-sin theta_zy",
        ),
        against(
            "(3.15): theta_zx in row 3 at 100 urad",
            -1e-4,
            small[2, 1],
            absolute=1e-12,
            tolerance="rounding",
            reference="corrected",
            source="+theta_zx",
        ),
    )
    return Outcome(
        cells,
        "Signs in (3.7), (3.9), (3.10) and (3.15) are slips: the rotation (3.8) and the equations (3.11) to (3.14) "
        "have the others. (3.18) has cosines where (3.14) has tangents.",
    )


def _jacobians(effort: Effort) -> Outcome:
    from schuler.calibration.bench.magnitude import condition

    rng = np.random.default_rng(effort.seed)
    worst = np.zeros(2)
    h = 1e-6
    for order in (9, 6, 3):
        x = np.where(np.arange(9) < order, 0.05 * rng.standard_normal(9), 0.0)
        Y = rng.standard_normal((20, 3))
        Y /= np.linalg.norm(Y, axis=1)[:, None]
        _, A, B = condition(Y, 1.0, x)
        parts = [(condition(Y, 1.0, x + h * e)[0] - condition(Y, 1.0, x - h * e)[0]) / (2.0 * h) for e in np.eye(9)]
        worst[0] = max(worst[0], float(np.abs(A - np.stack(parts, axis=1))[:, :order].max()))
        parts = [(condition(Y + h * e, 1.0, x)[0] - condition(Y - h * e, 1.0, x)[0]) / (2.0 * h) for e in np.eye(3)]
        worst[1] = max(worst[1], float(np.abs(B - np.stack(parts, axis=1)).max()))
    words = "analytic = numerical"
    return Outcome(
        (
            claimed("A, (3.63) to (3.71), (3.80), (3.88)", words, worst[0], high=5e-10, tolerance="discretisation"),
            claimed("B, (3.72) to (3.74), (3.82), (3.89)", words, worst[1], high=5e-10, tolerance="discretisation"),
        )
    )


#: Poses, rank, condition, sigma of b / sigma, s g / sigma, theta g / sigma (computed for exact faces,
#: edges and corners).
_SETS = (
    ("faces", "6", "6"), ("corners", "8", "7"), ("edges", "12", "9", "2.0", "0.500", "0.866", "1.000"),
    ("faces+corners", "14", "9", "2.3", "0.463", "0.636", "1.061"),
    ("faces+edges", "18", "9", "2.4", "0.408", "0.527", "1.000"),
    ("edges+corners", "20", "9", "2.6", "0.387", "0.847", "0.728"),
    ("faces+edges+corners", "26", "9", "2.1", "0.340", "0.511", "0.728"),
    ("10", "10", "9", "", "0.606", "0.865", "1.292"),
)  # fmt: skip


def _attitudes(effort: Effort) -> Outcome:
    from schuler.calibration.design.plans import attitude_plan, design_matrix
    from schuler.reproduce.hayal.study.attitudes import ordered_attitudes, scenario

    all_of = ordered_attitudes()
    ones = np.sum(np.abs(all_of) > 1e-9, axis=1)
    cells = [
        digits("attitudes", "26", len(all_of)),
        digits("faces down", "6", int(np.sum(ones == 1))),
        digits("edges down", "12", int(np.sum(ones == 2))),
        digits("corners down", "8", int(np.sum(ones == 3))),
    ]
    for name, n, rank, *rest in _SETS:
        plan = attitude_plan(int(name) if name.isdigit() else name)
        words = "best ten" if name == "10" else name
        cells += [
            digits(f"{words}: attitudes", n, len(plan), reference="corrected"),
            digits(f"{words}: rank of A", rank, plan.rank, reference="corrected"),
        ]
        if rest:
            A = design_matrix(plan.directions)
            sd = np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
            if rest[0]:
                cells.append(digits(f"{words}: condition", rest[0], plan.condition, reference="corrected"))
            for k, (text, what) in enumerate(zip(rest[1:], ("b", "s", "theta"), strict=True)):
                worst = float(sd[3 * k : 3 * k + 3].max())
                cells.append(digits(f"{words}: sigma of {what}", text, worst, reference="corrected"))
    for number, rank in ((1, "9"), (2, "9"), (3, "8"), (4, "8")):
        computed = int(np.linalg.matrix_rank(design_matrix(scenario(number))))
        cells.append(digits(f"scenario {number}: rank of A", rank, computed, reference="corrected"))
        if number > 2:
            cells.append(
                claimed(f"scenario {number}: rank for nine parameters", "ten attitudes suffice", computed, low=9)
            )
    return Outcome(
        tuple(cells),
        "The thesis asks for nine different attitudes or more and finds ten enough. Different is not enough: corners "
        "leave the scale factors open, and its scenarios 3 and 4 (in the order of attitudes that reproduces its "
        "uncertainties; it states none) determine eight of nine parameters.",
        (_sphere,),
    )


def _sphere() -> Figure:
    from schuler.calibration.bench.multiposition import calibrate_multiposition
    from schuler.calibration.bench.poses import Poses
    from schuler.calibration.report.panels import coverage
    from schuler.reproduce.hayal.study.attitudes import ordered_attitudes, study_attitudes
    from schuler.reproduce.hayal.study.multiposition import GRAVITY, NOISE

    f = study_attitudes(ordered_attitudes(), 20.0 * DEG, 0.0) @ (0.0, 0.0, -GRAVITY)
    n, t = len(f), np.linspace(0.0, 200.0 * (len(f) - 1), len(f))
    sigma = np.full((n, 3), NOISE["accel"] / np.sqrt(180.0))
    poses = Poses(f, np.zeros((n, 3)), sigma, np.full((n, 3), 1e-6), t, t + 180.0)
    figure = coverage(calibrate_multiposition(poses, gravity=GRAVITY, gyro_order=0))
    assert figure is not None  # there are residuals with directions
    return figure


ITEMS: tuple[Item, ...] = (
    Item("text-3.2", "geometry of a triad and its inverse", "exact", _geometry),
    Item("text-3.4.3", "coefficient matrices A and B", "exact", _jacobians),
    Item("fig-3.3", "26 attitudes, and what sets of them determine", "exact", _attitudes),
)
