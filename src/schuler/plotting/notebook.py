"""How results and data show themselves: one line as text; in a notebook a heading, a table and a picture."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import fields
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.exceptions import InputError, MissingExtraError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LINE = 160  # letters of a representation
_ROWS = 14  # of a table, the others are counted
_DPI = 96
_SHOWN = 12  # numbers of an array, of a larger one its shape
_VALUE = 80  # letters of a value among others


class Abridged:
    """What ``repr`` shows of a dataclass of arrays: one line of names and values, of a large array its shape."""

    __slots__ = ()

    def __repr__(self) -> str:
        values = ((f.name, getattr(self, f.name)) for f in fields(self) if f.repr)  # type: ignore[arg-type]
        text = ", ".join(f"{name}={_abridged(value)}" for name, value in values)
        return f"{type(self).__name__}({_cut(text, 2 * _LINE)})"


class Displayed:
    """What ``repr`` and Jupyter show of a result: :meth:`_headline`, :meth:`_facts`, and what ``plot`` draws."""

    __slots__ = ()

    def _headline(self) -> str:
        """One line; by default the first one of the summary."""
        return str(self.summary()).partition("\n")[0].strip()  # type: ignore[attr-defined]

    def _facts(self) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
        """Heads and rows of a table; by default of the result's own table, if it has one."""
        from schuler.plotting.table import shown

        if not hasattr(self, "table"):
            return (), ()
        table = self.table()
        return table.columns, [[shown(v) for v in row] for row in table.rows]

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {_cut(self._headline(), _LINE)}>"

    def _repr_html_(self) -> str:
        heads, rows = self._facts()
        return card(self._headline(), heads, rows, self._picture())

    def _picture(self) -> Figure | None:
        """The figure below the table; None where there is nothing to draw, or nothing to draw it with."""
        plot: Any = getattr(self, "plot", None)
        try:
            return None if plot is None else plot()
        except (InputError, MissingExtraError):
            return None


def _abridged(value: object) -> str:
    if isinstance(value, np.ndarray) and value.ndim:
        if value.size > _SHOWN:
            return f"<{value.dtype}, shape {value.shape}>"
        return np.array2string(value, separator=", ", max_line_width=1 << 20).replace("\n", "")
    return _cut(" ".join(repr(value).split()), _VALUE)


def _cut(text: str, letters: int) -> str:
    return text if len(text) <= letters else text[: letters - 3] + "..."


def card(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]], picture: Figure | None = None) -> str:
    """A heading, a table and a picture as HTML that needs no style sheet.

    Parameters
    ----------
    title : str
    heads : sequence of str
        Of the columns.
    rows : sequence of sequence of str
        The first fourteen are shown, the others counted.
    picture : matplotlib.figure.Figure, optional
        Put in as PNG.
    """
    lines = [f"<p><b>{escape(title)}</b></p>"]
    if rows:
        body = "".join(f"<tr>{''.join(f'<td>{escape(c)}</td>' for c in row)}</tr>" for row in rows[:_ROWS])
        more = f'<tr><td colspan="{len(heads)}">and {len(rows) - _ROWS} more</td></tr>' if len(rows) > _ROWS else ""
        head = "".join(f"<th>{escape(h)}</th>" for h in heads)
        lines.append(f"<table><thead><tr>{head}</tr></thead><tbody>{body}{more}</tbody></table>")
    if picture is not None:
        data = base64.b64encode(png(picture)).decode("ascii")
        lines.append(f'<img alt="{escape(title)}" style="max-width: 100%" src="data:image/png;base64,{data}">')
    return "<div>\n" + "\n".join(lines) + "\n</div>"


def png(figure: Figure) -> bytes:
    """A matplotlib figure as PNG, as large as a notebook shows it."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=_DPI, metadata={"Software": None})
    return stream.getvalue()
