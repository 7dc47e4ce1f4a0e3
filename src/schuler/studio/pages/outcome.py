"""What came out of a run: verdict first, then the numbers, then where everything lies."""

from __future__ import annotations

from html import escape
from urllib.parse import quote

from nicegui import ui

from schuler.studio.pages.frame import hint, html, table
from schuler.studio.workspace import RunEntry

_NUMBERS = (
    "rms_horizontal_m", "max_horizontal_m", "rms_horizontal_aided_m", "mean_outage_max_horizontal_m", "rms_vertical_m",
    "rms_velocity_horizontal_m_s", "rms_heading_deg", "rms_tilt_deg", "nees_mean", "nis_mean",
)  # fmt: skip


def show_outcome(place: ui.element, entry: RunEntry | None) -> None:
    """Verdict first, then numbers, the report and where everything lies."""
    place.clear()
    with place:
        if entry is None:
            hint("the folder of this run was removed")
            return
        verdict = entry.metrics.get("verdict", {})
        reasons = [*verdict.get("reasons", []), *(f"likely: {c}" for c in verdict.get("causes", [])[:1])]
        sentences = "".join(f"<p>{escape(str(r))}</p>" for r in reasons) or "<p>Nothing contradicts the claims.</p>"
        html(
            f'<section class="verdict {escape(entry.status)}" aria-label="Verdict"><p><b>{escape(entry.name)}: '
            f"{escape(entry.status)}</b></p>{sentences}</section>"
        )
        smoothed = entry.metrics.get("smoothed") or {}
        rows = [
            (name, entry.metrics.get(name), smoothed.get(name))
            for name in _NUMBERS
            if entry.metrics.get(name) is not None or smoothed.get(name) is not None
        ]
        table(("", "filtered", "smoothed"), rows, f"against {entry.metrics.get('reference')}")
        after = {o.get("start_s"): o for o in smoothed.get("outages") or []}
        keys = ("start_s", "stop_s", "max_horizontal_m", "end_horizontal_m")
        outages = [
            (*(outage.get(key) for key in keys), after.get(outage.get("start_s"), {}).get("max_horizontal_m"))
            for outage in entry.metrics.get("outages") or []
        ]
        if outages:
            table((*keys, "smoothed: max_horizontal_m"), outages, "without GNSS")
        link = f"/studio/files/{quote(entry.name)}"
        names = [name for name in ("report.html", "metrics.json", "resolved.toml") if name in entry.files]
        links = " · ".join(f'<a href="{link}/{name}" target="_blank">{name}</a>' for name in names)
        notes = "".join(f'<p class="hint">{escape(str(note))}</p>' for note in entry.metrics.get("notes") or [])
        html(f"<p>{links}</p><details><summary>notes of the run</summary>{notes}</details>")
