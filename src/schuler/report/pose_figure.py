"""Picture of a plan of poses: the sphere of directions seen from both sides, and the box as it has to lie."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.calibration.parameters import AXES
from schuler.calibration.plans import Plan, plan_of, unit_vectors, words_of
from schuler.exceptions import InputError, MissingExtraError
from schuler.report.style import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FONT = 7.0  # [pt]


def plan_figure(
    plan: Plan | ArrayLike,
    done: int | Sequence[int] | None = None,
    following: ArrayLike | None = None,
) -> Figure:
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
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure as MplFigure
    except ImportError:
        raise MissingExtraError("matplotlib", "plot", "drawing figures") from None
    plan = plan if isinstance(plan, Plan) else plan_of(plan)
    ready = set(range(done) if isinstance(done, int) else done or ())
    if not ready <= set(range(len(plan))):
        raise InputError(f"done: expected poses 0 to {len(plan) - 1}, got {sorted(ready - set(range(len(plan))))}")
    left = [k for k in range(len(plan)) if k not in ready]
    next_up = plan.directions[left[0]] if following is None and left else following
    canvas = MplFigure(figsize=(6.8, 2.9), layout="constrained")
    FigureCanvasAgg(canvas)
    axes = canvas.subplots(1, 3)
    for ax, side in zip(axes, (1.0, -1.0), strict=False):
        _half_sphere(ax, side)
        for k, u in enumerate(plan.directions):
            if side * u[2] >= 0.0 if side > 0 else u[2] < 0.0:
                _pose(ax, u, side, str(k + 1), "filtered" if k in ready else "unused")
        if next_up is not None:
            u = unit_vectors(next_up)[0]
            if side * u[2] >= 0.0 if side > 0 else u[2] < 0.0:
                _pose(ax, u, side, "", "smoothed", marker="^", size=8.0)
    if next_up is None:
        axes[2].set_axis_off()
        axes[2].set_title(f"all {len(plan)} poses are done", fontsize=_FONT)
    else:
        draw_box(axes[2], next_up)
    for role, label, marker in (("filtered", "done", "o"), ("unused", "to do", "o"), ("smoothed", "next", "^")):
        look = style(role)
        filled = look.light if role != "unused" else "white"
        axes[0].plot([], [], ls="none", marker=marker, color=look.light, mfc=filled, ms=5.0, label=label)
    canvas.legend(loc="outside lower center", ncols=3, fontsize=_FONT, frameon=False)
    return canvas


def draw_box(ax: Axes, up: ArrayLike) -> None:
    """Draw a box with printed axes as it lies when ``up`` (body axes, shape (3,)) points up, seen from the front.

    What turns about the vertical is free; the picture shows the largest horizontal part of an axis to the right.
    """
    u = unit_vectors(up)[0]
    C = _standing(u)
    # half width along x, y, z: a flat box, so that the faces can be told apart
    half = np.array((1.0, 0.75, 0.45))
    corners = np.array([(a, b, c) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]) * half
    seen = _seen(corners @ C.T)
    for i in range(8):
        for j in range(i + 1, 8):
            if np.count_nonzero(corners[i] != corners[j]) == 1:
                ax.plot(*seen[[i, j]].T, color="0.55", lw=1.0, zorder=1)
    for axis, name, role in zip(np.eye(3), AXES, ("axis_x", "axis_y", "axis_z"), strict=True):
        x, y = (float(t) for t in _seen((1.55 * half.max() * axis) @ C.T))
        look: dict[str, Any] = {"color": style(role).light, "zorder": 3}
        ax.annotate("", (x, y), (0.0, 0.0), arrowprops={"arrowstyle": "-|>", "lw": 1.6, **look})
        ax.annotate(f"+{name}", (1.13 * x, 1.13 * y), ha="center", va="center", fontsize=_FONT + 1.0, **look)
    ax.annotate("", (-2.1, 1.2), (-2.1, -0.2), arrowprops={"arrowstyle": "-|>", "lw": 1.0, "color": "0.2"})
    ax.annotate("up", (-2.1, 1.35), ha="center", fontsize=_FONT)
    ax.set_xlim(-2.4, 2.2)
    ax.set_ylim(-2.2, 2.2)
    ax.set_aspect("equal")
    ax.set_axis_off()
    words = words_of(u)
    ax.set_title(
        "next: " + words.replace(" on top (", " on top\n(").replace(", each", ",\neach").replace("level, ", "level,\n"),
        fontsize=_FONT,
    )


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


def _half_sphere(ax: Axes, side: float) -> None:
    t = np.linspace(0.0, 2.0 * np.pi, 181)
    ax.plot(np.cos(t), np.sin(t), color="0.4", lw=0.8)
    ax.plot(np.sqrt(1.0 - np.sqrt(0.5)) * np.cos(t), np.sqrt(1.0 - np.sqrt(0.5)) * np.sin(t), color="0.85", lw=0.6)
    for name, v in (("+x", (1, 0)), ("-x", (-1, 0)), ("+y", (0, 1)), ("-y", (0, -1))):
        ax.annotate(name, (1.18 * side * v[0], 1.18 * v[1]), ha="center", va="center", fontsize=_FONT, color="0.3")
    ax.plot([-1.0, 1.0], [0.0, 0.0], color="0.9", lw=0.6, zorder=0)
    ax.plot([0.0, 0.0], [-1.0, 1.0], color="0.9", lw=0.6, zorder=0)
    ax.set_xlim(-1.35, 1.35)
    ax.set_ylim(-1.35, 1.35)
    ax.set_aspect("equal")
    ax.set_axis_off()
    ax.set_title(f"up, with z {'up or level' if side > 0 else 'down'}", fontsize=_FONT)


def _pose(ax: Axes, u: FloatArray, side: float, label: str, role: str, *, marker: str = "o", size: float = 5.0) -> None:
    # equal areas (Lambert): poses spread evenly over the sphere look evenly spread
    factor = 1.0 / np.sqrt(1.0 + side * u[2])
    x, y = side * u[0] * factor, u[1] * factor
    look = style(role)
    fill = "white" if role == "unused" else look.light
    ax.plot([x], [y], ls="none", marker=marker, ms=size, color=look.light, mfc=fill, mew=1.0, zorder=3)
    if label:
        ax.annotate(label, (x, y), (4, 3), textcoords="offset points", fontsize=_FONT - 1.0, color="0.2")
