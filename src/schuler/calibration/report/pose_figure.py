"""Picture of a plan of poses: the sphere of directions seen from both sides, and the box as it has to lie."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.calibration.design.plans import Plan, plan_of, unit_vectors, words_of
from schuler.calibration.result.parameters import AXES
from schuler.exceptions import InputError
from schuler.plotting.drawing import draw
from schuler.plotting.figure import Figure, Item, Line, Markers, Panel, Text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MplFigure

_HEAD = 0.12  # of the arrow that points up


def plan_figure(
    plan: Plan | ArrayLike,
    done: int | Sequence[int] | None = None,
    following: ArrayLike | None = None,
) -> MplFigure:
    """Which poses are done, which are not, and how the box lies in the next one.

    Parameters
    ----------
    plan : Plan, or array_like, shape (n, 3)
        Directions of up in body axes.
    done : int or sequence of int, optional
        How many of the first poses are done, or which (from 0).
    following : array_like, shape (3,), optional
        Up in the next pose, for the picture of the box; None: the first of the plan that is not done.

    Returns
    -------
    matplotlib.figure.Figure
        Both half spheres of directions, poses numbered from 1 (filled: done; ring: to do; triangle: next), and the box.

    Raises
    ------
    InputError
        If ``done`` names a pose that the plan does not have.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).
    """
    return draw(plan_content(plan, done, following))


def plan_content(
    plan: Plan | ArrayLike, done: int | Sequence[int] | None = None, following: ArrayLike | None = None
) -> Figure:
    """Description of :func:`plan_figure`."""
    plan = plan if isinstance(plan, Plan) else plan_of(plan)
    ready = set(range(done) if isinstance(done, int) else done or ())
    if not ready <= set(range(len(plan))):
        raise InputError(f"done: expected poses 0 to {len(plan) - 1}, got {sorted(ready - set(range(len(plan))))}")
    left = [k for k in range(len(plan)) if k not in ready]
    next_up = plan.directions[left[0]] if following is None and left else following
    panels = []
    for side in (1.0, -1.0):
        items = _half_sphere(side)
        for role, label, which in (("filtered", "done", sorted(ready)), ("unused", "to do", left)):
            items += _poses(plan.directions, which, side, role, label)
        if next_up is not None:
            items += _poses(unit_vectors(next_up), [0], side, "start", "next", named=False)
        title = f"up, with z {'up or level' if side > 0 else 'down'}"
        panels.append(_bare(items, title, 1.4))
    if next_up is None:
        panels.append(_bare([], f"all {len(plan)} poses are done", 1.4))
    else:
        panels.append(box_panel(next_up))
    caption = "Which body axis is up in every pose, on the two halves of the sphere, and how the box lies in the next."
    return Figure("next_pose", "Poses", caption, tuple(panels), columns=3, linked=False)


def draw_box(ax: Axes, up: ArrayLike) -> None:
    """Draw :func:`box_panel` into axes of your own."""
    draw(Figure("box", "Next pose", "How the box lies.", (box_panel(up),)), ax)


def box_panel(up: ArrayLike) -> Panel:
    """A box with printed axes as it lies when ``up`` (body axes, shape (3,)) points up, seen from the front.

    What turns about the vertical is free; the picture shows the largest horizontal part of an axis to the right.
    """
    u = unit_vectors(up)[0]
    C = _standing(u)
    # half width along x, y, z: a flat box, so that the faces can be told apart
    half = np.array((1.0, 0.75, 0.45))
    corners = np.array([(a, b, c) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]) * half
    seen = _seen(corners @ C.T)
    items: list[Item] = [
        Line(seen[[i, j], 0], seen[[i, j], 1], "unused")
        for i in range(8)
        for j in range(i + 1, 8)
        if np.count_nonzero(corners[i] != corners[j]) == 1
    ]
    for axis, name, role in zip(np.eye(3), AXES, ("axis_x", "axis_y", "axis_z"), strict=True):
        x, y = (float(t) for t in _seen((1.55 * half.max() * axis) @ C.T))
        items += [Line(np.array([0.0, x]), np.array([0.0, y]), role), Text(1.08 * x, 1.08 * y - 0.1, f"+{name}")]
    items += [
        Line(np.array([-2.1, -2.1]), np.array([-0.2, 1.2]), "arrow"),
        Markers(np.array([-2.1]), np.array([1.2]), "arrow"),
        Text(-2.1, 1.2 + _HEAD, "up"),
    ]
    words = words_of(u)
    title = "next: " + words.replace(" on top (", " on top\n(").replace(", each", ",\neach").replace(
        "level, ", "level,\n"
    )
    return _bare(items, title, 2.5)


def _bare(items: Sequence[Item], title: str, reach: float) -> Panel:
    limits = (-reach, reach)
    return Panel("[-]", "[-]", tuple(items), title, x_limits=limits, y_limits=limits, equal=True, bare=True, grid=False)


def _standing(u: FloatArray) -> FloatArray:
    """Rotation from body axes to right, away, up, with ``u`` up."""
    horizontal = np.eye(3) - np.outer(u, u)
    k = int(np.argmax(np.diag(horizontal)))
    right = horizontal[k] / np.linalg.norm(horizontal[k])
    return np.array((right, np.cross(u, right), u))


def _seen(v: FloatArray) -> FloatArray:
    """Oblique parallel projection from the front, a little from the right and above. Shape (..., 2)."""
    right, away, up = np.moveaxis(v, -1, 0)
    return np.stack((0.94 * right + 0.34 * away, up * 0.92 + 0.13 * away * 2.0 - 0.12 * right), axis=-1)


def _half_sphere(side: float) -> list[Item]:
    """Horizon, circle of 45 degrees, and body axes."""
    t = np.linspace(0.0, 2.0 * np.pi, 181)
    inner = np.sqrt(1.0 - np.sqrt(0.5))
    across, middle = np.array([-1.0, 1.0]), np.zeros(2)
    items: list[Item] = [
        Line(np.cos(t), np.sin(t), "term"), Line(inner * np.cos(t), inner * np.sin(t), "graticule"),
        Line(across, middle, "graticule"), Line(middle, across, "graticule"),
    ]  # fmt: skip
    for name, v in (("+x", (1, 0)), ("-x", (-1, 0)), ("+y", (0, 1)), ("-y", (0, -1))):
        items.append(Text(1.18 * side * v[0], 1.18 * v[1] - 0.07, name))
    return items


def _poses(
    directions: FloatArray, which: Sequence[int], side: float, role: str, label: str, *, named: bool = True
) -> list[Item]:
    """Poses of one half sphere, with their numbers from 1."""
    here = [k for k in which if (directions[k, 2] >= 0.0) == (side > 0.0)]
    if not here:
        return []
    # equal areas (Lambert): poses spread evenly over the sphere look evenly spread
    u = directions[here]
    factor = 1.0 / np.sqrt(1.0 + side * u[:, 2])
    x, y = side * u[:, 0] * factor, u[:, 1] * factor
    items: list[Item] = [Markers(x, y, role, label)]
    if named:
        items += [Text(float(a), float(b), str(k + 1), "right") for a, b, k in zip(x, y, here, strict=True)]
    return items
