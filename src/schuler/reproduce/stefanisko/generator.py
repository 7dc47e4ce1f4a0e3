"""Sections 4.2 and 4.3: the trajectory generator and the navigation equations."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import FloatArray
from schuler.reproduce.cells import Cell, against, claimed, shown
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.reproduce.stefanisko.equations import TAU
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.reproduce.stefanisko.study.generator import FlatTrack

#: His matrices of Figs. 4.3 to 4.5.
_A = ((0.0, 0.0, 6.0), (5.0, 6.0, 4.0), (10.0, 0.0, 2.0))


_B = ((0.0, 0.0, 0.0), (0.0, 0.25 * np.pi, 0.0), (0.0, 0.5 * np.pi, 0.0))


#: Between knots; the thesis does not say. [s]
_STEP = 5.0


def _solved(interval: float, place: float = 0.5) -> tuple[FloatArray, FloatArray, FloatArray, FlatTrack]:
    """Times, true positions, true pitch and the solution from samples at a place of their intervals."""
    from schuler.reproduce.stefanisko.study.generator import flat_navigation, gendata
    from schuler.simulation.profiles import polynomial_motion

    motion = polynomial_motion(_A, _STEP, _B, _STEP, np.zeros(3))
    n = int(2.0 * _STEP / interval + 1e-9)
    t = interval * np.arange(n + 1.0)
    r, v, _ = motion.path(t)
    C, _ = motion.attitude(t[:1])
    samples = gendata(_A, _STEP, _B, _STEP, interval, np.arange(n) + place)
    solution = flat_navigation(samples, interval, r[0], v[0], C[0])
    return t, r, 0.25 * np.pi * t / _STEP, solution


def _clean(effort: Effort) -> Outcome:
    from schuler.reproduce.stefanisko.study.figures import track_figure

    t, r, pitch, solution = _solved(TAU)
    length = float(np.linalg.norm(np.diff(r, axis=0), axis=1).sum())
    worst = float(np.linalg.norm(solution.r_n - r, axis=1).max())
    steps = (0.012, 0.006, 0.003)
    off = []
    for place in (0.5, 0.0):
        ends = [_solved(h, place) for h in steps]
        off.append([float(np.linalg.norm(solution.r_n[-1] - r[-1])) for _, r, _, solution in ends])
    C = solution.C_nb[-1]
    cells: list[Cell] = [
        claimed("largest position error over the path", "input = output", worst / length, high=1e-3),
        *(
            claimed(
                f"samples at the middle: error at {1e3 * h:g} ms over {5e2 * h:g} ms",
                "falls with the step",
                a / b,
                low=3.8,
                high=4.2,
                reference="corrected",
                tolerance="discretisation",
            )
            for h, a, b in zip(steps, off[0], off[0][1:], strict=False)
        ),
        *(
            claimed(
                f"samples at the start: error at {1e3 * h:g} ms over {5e2 * h:g} ms",
                "falls with the step",
                a / b,
                low=1.9,
                high=2.1,
                reference="corrected",
                tolerance="discretisation",
            )
            for h, a, b in zip(steps, off[1], off[1][1:], strict=False)
        ),
        shown("samples at the start, 6 ms: error at the end", off[1][1], unit="m"),
        against(
            "pitch at the end",
            90.0 * t[-1] / (2.0 * _STEP),
            float(np.arctan2(-C[2, 0], C[0, 0])) / DEG,
            absolute=0.001,
            unit="deg",
            source="pi/2",
            tolerance="discretisation",
        ),
    ]
    u = t[-1] / _STEP  # 4 ms before the last knot: 10 s are no multiple of 6 ms
    for k, (axis, end) in enumerate(zip("xyz", (5.0 * u, 12.0 * u - 6.0 * u**2, 6.0 - 2.0 * u), strict=True)):
        cells.append(
            against(
                f"{axis} at the end",
                end,
                float(solution.r_n[-1, k]),
                absolute=1e-3 * length,
                unit="m",
                source=f"{_A[-1][k]:g}",
                tolerance="band",
            )
        )
    return Outcome(
        tuple(cells),
        "The thesis shows curves; it does not say where in their interval its samples lie. At the middle the error "
        "is of second order in the step, at the start of first order.",
        (partial(track_figure, t, r, pitch, solution),),
    )


def _with_rotation(effort: Effort) -> Outcome:
    """Fig. 4.5: where the path ends with and without rotation, read in three ways."""
    from schuler.reproduce.stefanisko.study.figures import paths_figure
    from schuler.reproduce.stefanisko.study.generator import AccelFrame, flat_navigation, gendata
    from schuler.simulation.profiles import polynomial_motion

    motion = polynomial_motion(_A, _STEP, _B, _STEP, np.zeros(3))
    k = np.arange(int(2.0 * _STEP / TAU)) + 0.5
    r0, v0, _ = motion.path(np.zeros(1))
    still = np.zeros((3, 3))
    about_x = np.array(_B)[:, [1, 0, 2]]

    def solved(angles: object, frame: AccelFrame) -> np.ndarray:
        samples = gendata(_A, _STEP, angles, _STEP, TAU, k, accel_frame=frame)  # type: ignore[arg-type]
        return flat_navigation(samples, TAU, r0[0], v0[0], np.eye(3)).r_n

    t = np.asarray(TAU * k, dtype=np.float64)
    # knots read as motion along the turned axes: velocities in the body
    v = motion.path(t)[1]
    along = r0[0] + np.cumsum(np.einsum("nij,nj->ni", motion.attitude(t)[0], v), axis=0) * TAU
    paths = {
        "without rotation": solved(still, "navigation"),
        "with rotation": solved(_B, "navigation"),
        "accelerations read in body axes": solved(_B, "body"),
        "velocities read in body axes": along,
    }
    first = paths["without rotation"][-1]
    moved = {name: float(np.linalg.norm(r[-1] - first)) for name, r in paths.items()}
    x_moved = float(np.linalg.norm(solved(about_x, "body")[-1] - solved(still, "body")[-1]))
    late = float(np.linalg.norm(_solved(TAU, 0.0)[3].r_n[-1] - first))
    cells = (
        claimed("end point moves with the rotation", "it changes", moved["with rotation"], low=0.5, unit="m"),
        claimed(
            "end point moves, correct generator",
            "it does not",
            moved["with rotation"],
            high=0.02,
            unit="m",
            tolerance="discretisation",
            reference="corrected",
        ),
        shown("end point moves, accelerations in body axes", moved["accelerations read in body axes"], unit="m"),
        shown("end point moves, samples at the start of 6 ms", late, unit="m"),
        shown("accelerations in body axes, his angles about x instead of y", x_moved, unit="m"),
        shown("end point moves, velocities in body axes", moved["velocities read in body axes"], unit="m"),
    )
    return Outcome(
        cells,
        "His figure shows an end point that changes when rotation is added: knots read along the turned axes. "
        "Position does not depend on attitude. Accelerations in body axes (one reading of the text) do not move the "
        "end for this example, whose only acceleration is along the axis of rotation; velocities in body axes do.",
        (partial(paths_figure, paths),),
    )


def _initial_velocity(effort: Effort) -> Outcome:
    from schuler.reproduce.stefanisko.study.generator import velocity_from_samples
    from schuler.simulation.profiles import polynomial_motion

    motion = polynomial_motion(_A, _STEP, _B, _STEP, np.zeros(3))
    r, v, a = motion.path(np.array((0.0, TAU)))
    velocity = velocity_from_samples(r, TAU)
    off = velocity - v[0]
    return Outcome(
        (
            claimed(
                "first difference against the derivative",
                "velocity from the first samples",
                float(np.abs(off).max()),
                high=0.01,
                unit="m/s",
                tolerance="discretisation",
            ),
            against(
                "its error along y: half a tau",
                0.5 * a[0, 1] * TAU,
                float(off[1]),
                relative=1e-6,
                unit="m/s",
                tolerance="rounding",
                reference="corrected",
            ),
            against(
                "x", 5.0 / _STEP, float(v[0, 0]), relative=1e-9, unit="m/s", tolerance="rounding", reference="corrected"
            ),
            against(
                "y",
                12.0 / _STEP,
                float(v[0, 1]),
                relative=1e-9,
                unit="m/s",
                tolerance="rounding",
                reference="corrected",
            ),
            against(
                "z",
                -2.0 / _STEP,
                float(v[0, 2]),
                relative=1e-9,
                unit="m/s",
                tolerance="rounding",
                reference="corrected",
            ),
        ),
        "The thesis gives no numbers; the difference is wrong by half the acceleration times the step.",
    )


ITEMS: tuple[Item, ...] = (
    Item("fig-4.3", "clean trajectory through the navigation equations", "exact", _clean, ("fig-4.4",)),
    Item("fig-4.5", "path with and without rotation", "exact", _with_rotation),
    Item("text-4.3", "velocity at the start", "exact", _initial_velocity),
)
