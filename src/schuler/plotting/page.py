"""Style sheet and script of the HTML report. Both are put into the page; nothing is ever fetched."""

from __future__ import annotations

from collections.abc import Mapping

from schuler.plotting.interactive import css_name
from schuler.plotting.style import PAGE_DARK, PAGE_LIGHT, STYLES

#: The browser itself is told to load nothing from anywhere; pictures only from the page's own "save as PNG".
POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"

_SHEET = """
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body { margin: 0 auto; padding: 1rem; max-width: 64rem; background: var(--ground); color: var(--ink);
  font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Liberation Sans", sans-serif;
  overflow-wrap: break-word; }
h1 { font-size: 1.6rem; line-height: 1.2; margin: 0.5rem 0 0.2rem; }
h2 { font-size: 1.25rem; margin: 2.2rem 0 0.6rem; padding-top: 0.6rem; border-top: 1px solid var(--rule); }
h3 { font-size: 1rem; margin: 1.2rem 0 0.3rem; }
p { margin: 0.4rem 0; max-width: 46rem; }
a { color: var(--filtered); }
.sub, figcaption, .small { color: var(--muted); font-size: 0.9rem; }
.verdict { background: var(--raised); border-left: 4px solid var(--filtered); padding: 0.5rem 1rem; margin: 1rem 0; }
.verdict p { font-size: 1.05rem; max-width: none; }
nav { display: flex; flex-wrap: wrap; gap: 0.2rem 1rem; font-size: 0.95rem; margin: 0.8rem 0; }
table { border-collapse: collapse; margin: 0.6rem 0; max-width: 100%; font-variant-numeric: tabular-nums; }
caption { text-align: left; color: var(--muted); font-size: 0.9rem; padding-bottom: 0.3rem; }
th, td { text-align: left; vertical-align: top; padding: 0.25rem 0.8rem 0.25rem 0; border-bottom: 1px solid var(--rule);
  overflow-wrap: break-word; }
/* a table of numbers too wide for a phone scrolls by itself instead of widening the page */
table:not(.texts) { display: block; width: fit-content; overflow-x: auto; }
table.texts { table-layout: fixed; width: 100%; }
table.texts :is(th, td) { overflow-wrap: anywhere; }
table.texts thead th:first-child { width: 40%; }
th { font-weight: 600; }
tbody th { font-weight: 400; }
tr.told > * { border-bottom: 0; padding-bottom: 0; }
td.n, th.n { text-align: right; overflow-wrap: normal; padding-right: 0.4rem; padding-left: 0.4rem; }
figure { margin: 1.2rem 0; }
figure h3 { margin-bottom: 0.1rem; }
.keys { display: flex; flex-wrap: wrap; gap: 0 1rem; margin: 0.3rem 0; padding: 0; list-style: none;
  font-size: 0.9rem; }
.keys button, .keys span.key { font: inherit; color: inherit; background: none; border: 0; padding: 0.15rem 0;
  display: inline-flex; align-items: center; gap: 0.4rem; }
.keys button { cursor: pointer; }
.keys button[aria-pressed="false"] { opacity: 0.45; text-decoration: line-through; }
.keys i { display: inline-block; width: 1.4rem; font-style: normal; text-align: center; line-height: 1; }
.keys i.line { border-top: 2.5px solid; height: 0; }
.keys i.dash { border-top: 2.5px dashed; height: 0; }
.keys i.box { height: 0.8rem; }
.panels { display: grid; gap: 0.4rem 0.8rem; }
.panels > div { min-width: 0; }
.panels.c2 { grid-template-columns: repeat(auto-fit, minmax(min(100%, 22rem), 1fr)); }
.panels.c3 { grid-template-columns: repeat(auto-fit, minmax(min(100%, 18rem), 1fr)); }
.says { font-size: 0.85rem; color: var(--muted); margin: 0.2rem 0 0; }
.plot { width: 100%; height: 190px; overflow: hidden; }
.plot.tall { height: 260px; }
.plot.plan { height: min(90vw, 38rem); max-width: 46rem; }
pre { white-space: pre-wrap; overflow-wrap: anywhere; background: var(--raised); padding: 0.6rem; font-size: 0.85rem; }
ul.notes { padding-left: 1.2rem; }
ul.notes li { margin: 0.2rem 0; max-width: 46rem; }
@media (max-width: 30rem) {
  body { padding: 0.7rem; }
  table { font-size: 0.85rem; }
  th, td { padding-right: 0.35rem; }
}
@media print {
  body { max-width: none; padding: 0; font-size: 10pt; }
  nav { display: none; }
  .panels.c2, .panels.c3 { grid-template-columns: 310px 310px; }
  .plot, .plot.tall, .plot.plan { height: auto; }
  figure, tr, .verdict { break-inside: avoid; }
  h2, h3 { break-after: avoid; }
}
"""

#: Draws a panel when it comes near the window, keeps the panels of a figure on one time axis, follows light and dark.
SCRIPT = """
(function () {
  "use strict";
  var figures = JSON.parse(document.getElementById("figures").textContent);
  var plots = Array.prototype.slice.call(document.querySelectorAll(".plot"));
  // where nothing hovers, dragging has to scroll the page and not zoom a plot
  var touch = !window.matchMedia("(hover: hover) and (pointer: fine)").matches;
  var printing = false;

  function coloured(value, css) {
    if (typeof value === "string") return value.slice(0, 2) === "--" ? css.getPropertyValue(value).trim() : value;
    if (Array.isArray(value)) {
      var nested = value.length && value[0] !== null && typeof value[0] === "object";
      return nested ? value.map(function (v) { return coloured(v, css); }) : value;
    }
    if (value && typeof value === "object") {
      var copy = {};
      Object.keys(value).forEach(function (key) { copy[key] = coloured(value[key], css); });
      return copy;
    }
    return value;
  }

  function spec(div) { return figures[div.dataset.figure][+div.dataset.panel]; }

  function dressed(div) {
    var css = getComputedStyle(document.documentElement);
    var own = spec(div), layout = coloured(own.layout, css);
    var ink = css.getPropertyValue("--ink").trim(), grid = css.getPropertyValue("--grid").trim();
    layout.font = { family: getComputedStyle(document.body).fontFamily, size: 12, color: ink };
    layout.paper_bgcolor = layout.plot_bgcolor = "rgba(0,0,0,0)";
    layout.margin = { l: 58, r: 8, t: 8, b: layout.xaxis.title.text ? 40 : 22 };
    layout.modebar = { bgcolor: "rgba(0,0,0,0)", color: css.getPropertyValue("--muted").trim(), activecolor: ink };
    layout.uirevision = "kept";
    layout.showlegend = false;
    layout.dragmode = touch ? false : "zoom";
    layout.hoverlabel = { bgcolor: css.getPropertyValue("--raised").trim(), font: { color: ink } };
    if (printing) {
      layout.width = div.closest(".c2, .c3") ? 310 : 640;
      layout.height = div.classList.contains("plan") ? 560 : div.classList.contains("tall") ? 220 : 150;
      if (div.dataset.height) layout.height = 150 * div.dataset.height;
    }
    [layout.xaxis, layout.yaxis].forEach(function (axis) {
      axis.gridcolor = grid;
      axis.linecolor = axis.zerolinecolor = css.getPropertyValue("--rule").trim();
      axis.title.standoff = 6;
      if (touch) axis.fixedrange = true;
    });
    layout.yaxis.zeroline = false;
    if (!layout.yaxis.tickvals) layout.yaxis.nticks = 6;
    return { data: coloured(own.data, css), layout: layout };
  }

  function draw(div) {
    if (typeof Plotly === "undefined") return;
    var d = dressed(div), first = !div.dataset.drawn;
    div.dataset.drawn = "yes";
    if (!first) { Plotly.react(div, d.data, d.layout); return; }
    Plotly.newPlot(div, d.data, d.layout, {
      responsive: true, displaylogo: false, displayModeBar: touch ? false : "hover", doubleClick: "reset+autosize",
      // plotly's own set of buttons has one that sends the data to a server
      showSendToCloud: false, plotlyServerURL: "",
      modeBarButtons: [["toImage"], ["zoom2d", "pan2d"], ["zoomIn2d", "zoomOut2d", "resetScale2d"]]
    });
    if (div.dataset.linked) div.on("plotly_relayout", function (change) { follow(div, change); });
  }

  function follow(leader, change) {
    var next = {};
    ["xaxis.range[0]", "xaxis.range[1]", "xaxis.range", "xaxis.autorange"].forEach(function (key) {
      if (key in change) next[key] = change[key];
    });
    if (!Object.keys(next).length || leader.dataset.follows) return;
    plots.forEach(function (div) {
      if (div === leader || div.dataset.figure !== leader.dataset.figure || !div.dataset.drawn) return;
      div.dataset.follows = "yes";
      Plotly.relayout(div, next).then(function () { delete div.dataset.follows; });
    });
  }

  document.querySelectorAll(".keys button").forEach(function (button) {
    button.addEventListener("click", function () {
      var shown = button.getAttribute("aria-pressed") !== "true", name = button.dataset.name;
      button.setAttribute("aria-pressed", String(shown));
      figures[button.dataset.figure].forEach(function (panel) {
        panel.data.forEach(function (trace) { if (trace.name === name) trace.visible = shown; });
      });
      plots.forEach(function (div) {
        if (div.dataset.figure === button.dataset.figure && div.dataset.drawn) draw(div);
      });
    });
  });

  function redraw() { plots.forEach(function (div) { if (div.dataset.drawn) draw(div); }); }

  if ("IntersectionObserver" in window) {
    var watch = new IntersectionObserver(function (entries) {
      entries.forEach(function (entry) {
        if (entry.isIntersecting) { watch.unobserve(entry.target); draw(entry.target); }
      });
    }, { rootMargin: "600px 0px" });
    plots.forEach(function (div) { watch.observe(div); });
  } else {
    plots.forEach(draw);
  }
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  window.addEventListener("beforeprint", function () {
    printing = true;
    document.documentElement.dataset.theme = "light";
    plots.forEach(draw);
  });
  window.addEventListener("afterprint", function () {
    printing = false;
    delete document.documentElement.dataset.theme;
    redraw();
    plots.forEach(function (div) { Plotly.Plots.resize(div); });
  });
})();
"""


def style_sheet() -> str:
    """The whole style sheet: colours for light and dark ground, then the rules."""
    dark = _variables(PAGE_DARK, "dark")
    return (
        f":root {{ color-scheme: light; {_variables(PAGE_LIGHT, 'light')} }}\n"
        f"@media (prefers-color-scheme: dark) {{ :root:not([data-theme=light]) {{ color-scheme: dark; {dark} }} }}\n"
        + _SHEET.strip()
    )


def _variables(ground: Mapping[str, str], which: str) -> str:
    pairs = [f"--{name}: {colour};" for name, colour in ground.items()]
    for role, look in STYLES.items():
        colour = look.light if which == "light" else look.dark
        r, g, b = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
        # bands are a little stronger on dark ground, where they would drown
        alpha = look.alpha if which == "light" or look.alpha == 1.0 else min(look.alpha * 1.3, 1.0)
        pairs.append(f"{css_name(role)}: {colour};")
        pairs.append(f"{css_name(role, area=True)}: rgba({r}, {g}, {b}, {alpha:.2f});")
    return " ".join(pairs)
