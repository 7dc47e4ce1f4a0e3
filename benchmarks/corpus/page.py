"""The table of a run, before and after, and the page of the documentation with its picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .cases import HALVES

Rows = list[dict[str, Any]]
_HEAD = (
    "case", "half", "error", "smoothed", "outage", "out.smo", "aided", "claimed", "NEES", "band", "out of", "NIS", "1/2/3 sigma %",
    "rej %", "verdict", "exit", "peer", "ratio", "warnings",
)  # fmt: skip


def number(value: Any, digits: int = 3) -> str:
    """Three significant digits, nothing for what is not there."""
    if value is None:
        return ""
    return f"{value:.{digits}g}" if abs(value) < 1e4 else f"{value:.2e}"


def consistent(row: dict[str, Any]) -> str:
    """How the NEES lies to its band."""
    if row.get("nees") is None or row.get("nees_band") is None:
        return ""
    low, high = row["nees_band"]
    return "in" if low <= row["nees"] <= high else ("low" if row["nees"] < low else "HIGH")


def cells_of(row: dict[str, Any], half: str) -> list[str]:
    """One line of the table."""
    if "skipped" in row:
        return [row["name"], half, "skipped: " + row["skipped"]]
    band = "" if row.get("nees_band") is None else "{:.2f}-{:.2f}".format(*row["nees_band"])
    inside = "" if row.get("inside") is None else "/".join(f"{100 * x:.0f}" for x in row["inside"])
    rejected = "" if row.get("rejected") is None else f"{100 * row['rejected']:.1f}"
    if "sentence" in row:
        return [row["name"], half, "raised " + row["sentence"]]
    return [
        row["name"], half, number(row["error"]), number(row["smoothed"]), number(row["outage"]),
        number(row["outage_smoothed"]), number(row["aided"]), number(row["claimed"]), number(row["nees"]), band,
        consistent(row), number(row["nis"]), inside, rejected, row["verdict"] or "", str(row["exit"]),
        number(row["peer_error"]), number(row["ratio"], 2), " ".join(row["warnings"] or []),
    ]  # fmt: skip


def table_of(rows: Rows, before: Rows | None = None) -> str:
    """The table as text; with an earlier run, its line above each one that differs."""
    half = HALVES
    earlier = {} if before is None else {row["name"]: row for row in before}
    lines = []
    for row in rows:
        after = cells_of(row, half.get(row["name"], "?")[0])
        if row["name"] in earlier:
            old = cells_of(earlier[row["name"]], half.get(row["name"], "?")[0])
            if old != after:
                lines.append([old[0], "was", *old[2:]])
        lines.append(after)
    widths = [max([len(_HEAD[k]), *(len(c[k]) for c in lines if len(c) == len(_HEAD))]) for k in range(len(_HEAD))]
    text = [" ".join(f"{name:<{w}}" for name, w in zip(_HEAD, widths, strict=True)).rstrip()]
    for cells in lines:
        text.append(" ".join(f"{c:<{w}}" for c, w in zip(cells, widths, strict=False)).rstrip())
    return "\n".join([*text, "", *summary(rows)])


def summary(rows: Rows) -> list[str]:
    """What the rows of navigation say together, by half."""
    half = HALVES
    lines = []
    for which in ("choosing", "reporting"):
        some = [r for r in rows if r["kind"] == "navigation" and "skipped" not in r and half.get(r["name"]) == which]
        ran = [r for r in some if r.get("nees") is not None]
        if not some:
            continue
        good = sum(0.3 <= r["nees"] <= 3.0 for r in ran)
        wild = [r["name"] for r in ran if r["nees"] > 10.0 and r["verdict"] not in ("doubtful", "failed")]
        lines.append(
            f"{which} half of navigation: {len(ran)} of {len(some)} ran, NEES 0.3 to 3 in {good}; above 10 and not "
            f"called doubtful or failed: {', '.join(wild) or 'none'}"
        )
    return lines


def page_of(path: Path, rows: Rows, before: Rows | None, elapsed: float) -> None:
    """Write the page; nothing yet."""
