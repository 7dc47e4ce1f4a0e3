"""Draw the rooms of the package as layers: ``python docs/project/draw_house.py`` writes ``house.png`` beside it.

Layers and their order are those that import-linter enforces (``pyproject.toml``); what a room is for is the first
line of its docstring; its lines are counted. Imports point down only, so no arrow is drawn.
"""

from __future__ import annotations

import ast
import textwrap
import tomllib
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
SOURCE = ROOT / "src" / "schuler"
COLOURS = ("#f2e6d8", "#e3ecf4", "#e6f0e4", "#f0e6f0")


def layers() -> list[list[str]]:
    """Rooms from the top layer down, those of one layer together."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contract = settings["tool"]["importlinter"]["contracts"][0]
    return [[name.strip() for name in layer.split("|")] for layer in contract["layers"]]


def room(name: str) -> tuple[int, str]:
    """Lines of a room, and the first sentence of its docstring."""
    place = SOURCE / name
    files = sorted(place.rglob("*.py")) if place.is_dir() else [SOURCE / f"{name}.py"]
    head = ast.get_docstring(ast.parse((place / "__init__.py" if place.is_dir() else files[0]).read_text("utf-8")))
    return sum(len(p.read_text("utf-8").splitlines()) for p in files), (head or "").split("\n\n")[0].replace("\n", " ")


def draw(path: Path) -> None:
    """Write the picture."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import FancyBboxPatch

    rows = layers()
    figure = Figure((10.0, 0.62 * len(rows) + 0.2), dpi=140)
    FigureCanvasAgg(figure)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set(xlim=(0.0, 10.0), ylim=(0.0, float(len(rows))))
    ax.axis("off")
    for k, names in enumerate(rows):
        y, width = len(rows) - 1 - k, 9.8 / len(names)
        for j, name in enumerate(names):
            lines, text = room(name)
            x = 0.1 + j * width
            box = FancyBboxPatch(
                (x + 0.04, y + 0.1), width - 0.08, 0.8, boxstyle="round,pad=0,rounding_size=0.06",
                facecolor=COLOURS[k % len(COLOURS)], edgecolor="#555555", linewidth=0.7,
            )  # fmt: skip
            ax.add_patch(box)
            size = f"{lines / 1000:.1f}k" if lines > 950 else str(lines)
            ax.text(x + 0.12, y + 0.66, name, fontsize=9, fontweight="bold", va="center")
            ax.text(x + width - 0.12, y + 0.66, size, fontsize=7, ha="right", va="center", color="#555555")
            words = textwrap.shorten(
                text.split(":")[0] if len(names) > 2 else text, int(17.5 * width), placeholder=" ..."
            )
            ax.text(x + 0.12, y + 0.32, words, fontsize=6.5, va="center", color="#333333")
    figure.savefig(path)


if __name__ == "__main__":
    draw(HERE / "house.png")
