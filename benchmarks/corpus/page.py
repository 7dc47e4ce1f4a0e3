"""The table of a run, before and after, and the page of the documentation with its picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .cases import HALVES

Rows = list[dict[str, Any]]
_HEAD = (
    "case", "half", "error", "smoothed", "outage", "out.smo", "aided", "claimed", "NEES", "band", "out of", "NIS",
    "1/2/3 sigma %", "rej %", "verdict", "exit", "peer", "ratio", "warnings",
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
    text += [" ".join(f"{c:<{w}}" for c, w in zip(cells, widths, strict=False)).rstrip() for cells in lines]
    return "\n".join([*text, "", *summary(rows)])


def summary(rows: Rows) -> list[str]:
    """What the rows of navigation say together, by half."""
    half = HALVES
    lines = []
    asked = [r for r in rows if r["kind"] == "navigation" and "skipped" not in r]
    for which in ("choosing", "reporting"):
        some = [r for r in asked if half.get(r["name"]) == which]
        ran = [r for r in some if r.get("error") is not None]
        judged = [r["nees"] for r in ran if r.get("nees") is not None]
        if not some:
            continue
        good = sum(0.3 <= value <= 3.0 for value in judged)
        stated = sum(0.3 <= r.get("nees_stated", r["nees"]) <= 3.0 for r in ran if r.get("nees") is not None)
        wild = [r["name"] for r in ran if (r.get("nees") or 0.0) > 10.0 and r["verdict"] not in ("doubtful", "failed")]
        harsh = [r["name"] for r in ran if r["verdict"] == "failed" and consistent(r) == "in"]
        ratios = sorted(r["ratio"] for r in ran if r.get("ratio") is not None)
        lines.append(
            f"{which} half of navigation: {len(ran)} of {len(some)} ran, "
            f"NEES 0.3 to 3 in {good} of {len(judged)} ({stated} with the sigmas that the fixes held back state); "
            f"above 10 and not called doubtful or failed: {', '.join(wild) or 'none'}; called failed inside the band: "
            f"{', '.join(harsh) or 'none'}"
            + (f"; ratio to python-ins {ratios[len(ratios) // 2]:.2f} (median of {len(ratios)})" if ratios else "")
        )
    return lines


TITLES = {
    "navigation": "Navigation",
    "foot": "On a shoe",
    "calibration": "Calibration: halves of the poses",
    "noise": "Noise: halves of a rest",
    "points": "Single points",
}
_COLUMNS = {
    "error": "error", "smoothed": "smoothed", "outage": "outage", "outage_smoothed": "smoothed", "aided": "aided",
    "claimed": "claimed", "nees": "NEES", "band": "band", "nis": "NIS", "inside": "1, 2, 3 sigma [%]",
    "rejected": "rejected [%]", "verdict": "verdict", "exit": "exit", "peer_error": "peer", "ratio": "ratio",
    "warnings": "warnings",
}  # fmt: skip
_TEXT = Path(__file__).with_name("page.md")


def page_of(path: Path, rows: Rows, elapsed: float, jobs: int) -> None:
    """Write the page, and its picture beside the others of the documentation."""
    ran = [row for row in rows if "skipped" not in row]
    text = [
        _TEXT.read_text(encoding="utf-8").format(
            elapsed=elapsed, ran=len(ran), processes="one process" if jobs == 1 else f"{jobs} processes"
        ),
        *(f"- {line}" for line in summary(rows)),
        "",
    ]
    for kind, title in TITLES.items():
        some = [row for row in rows if row["kind"] == kind]
        if some:
            text += [f"## {title}", "", *markdown(some), ""]
    path.write_text("\n".join(text).rstrip() + "\n", encoding="utf-8")
    picture(path.parent / "images" / "corpus.png", ran)


def markdown(rows: Rows) -> list[str]:
    """Lines of a table in Markdown: columns that say something, refusals in full below."""
    shown = [{**row, "band": row.get("nees_band")} for row in rows]
    used = [c for c in _COLUMNS if any(row.get(c) not in (None, []) for row in shown)]
    unit = rows[0]["unit"]
    head = [f"case [{unit}]", "", *(_COLUMNS[c] for c in used)]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    refused: dict[str, list[str]] = {}
    for row in shown:
        cells = [row["name"], HALVES.get(row["name"], "?")[0]]
        if "skipped" in row or "sentence" in row:
            reason = row.get("sentence", "skipped: " + row.get("skipped", ""))
            refused.setdefault(reason, []).append(f"`{row['name']}`")
            cells += ["refused" if "sentence" in row else "skipped", *[""] * (len(used) - 1)]
        else:
            cells += [_cell(c, row.get(c)) for c in used]
        lines.append("| " + " | ".join(cells) + " |")
    reasons = [f"- {', '.join(names)}: {reason}" for reason, names in refused.items()]
    return [*lines, "", *reasons] if reasons else lines


def _cell(column: str, value: Any) -> str:
    if value is None:
        return ""
    if column == "band":
        return "{:.2f} to {:.2f}".format(*value)
    if column == "inside":
        return ", ".join(f"{100 * x:.0f}" for x in value)
    if column == "warnings":
        return " ".join(f"`{code}`" for code in value)
    if column == "rejected":
        return f"{100 * value:.1f}"
    return value if isinstance(value, str) else str(value) if isinstance(value, int) else number(value)


def picture(path: Path, rows: Rows) -> None:
    """Error beside claim of all cases, by kind; hollow: the half that defaults are chosen on."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 5.2), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    colours = dict(zip(TITLES, ("#1f5f99", "#b5541c", "#3a7d34", "#7d5ba6", "#8a8a2b"), strict=True))
    low, high = 1e-4, 1e5
    axes.fill_between([low, high], [low, high], [3.0 * low, 3.0 * high], color="#dce8dc", lw=0, zorder=0)
    axes.plot([low, high], [low, high], color="0.4", lw=0.8, zorder=1)
    axes.annotate("error = claim; shaded up to 3", (0.98, 0.02), xycoords="axes fraction", ha="right", fontsize=8)
    for kind, title in TITLES.items():
        for half, face in (("choosing", "none"), ("reporting", colours[kind])):
            some = [r for r in rows if r["kind"] == kind and HALVES.get(r["name"]) == half and r.get("claimed")]
            label = f"{title.partition(':')[0]} [{some[0]['unit']}]" if some and half == "reporting" else None
            axes.scatter(
                [r["claimed"] for r in some], [r["error"] for r in some], s=22, facecolors=face,
                edgecolors=colours[kind], linewidths=1.0, label=label, zorder=2,
            )  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="claimed 1-sigma", ylabel="error, RMS")
    some = [x for r in rows if r.get("claimed") for x in (r["claimed"], r["error"])]
    axes.set(xlim=(min(some) / 2, max(some) * 2), ylim=(min(some) / 2, max(some) * 2))
    if any(HALVES.get(r["name"]) == "reporting" and r.get("claimed") for r in rows):
        axes.legend(fontsize=8, frameon=False, title="filled: reporting half", title_fontsize=8)
    axes.grid(alpha=0.25, lw=0.5)
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, metadata={"Software": None})
