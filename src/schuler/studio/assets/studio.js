// Charts, uploads and keys of the workbench. An element with data-chart draws itself when it appears on the page, and
// again when data-source or data-outages change; what is selected goes back as an event.
"use strict";
(() => {
  const colour = (role, area) =>
    getComputedStyle(document.documentElement).getPropertyValue("--" + role.replaceAll("_", "-") + (area ? "-area" : "")).trim();
  const charts = new Map(); // element: {draw, load}
  const CONFIG = { displayModeBar: false, responsive: true, doubleClick: false };

  const axis = (title) => ({
    title: { text: title, font: { size: 12 }, standoff: 6 }, gridcolor: colour("grid"), zerolinecolor: colour("rule"),
    linecolor: colour("rule"), tickfont: { size: 11 }, automargin: true,
  });
  const base = () => ({
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: colour("ink"), family: "inherit", size: 12 },
    margin: { l: 56, r: 12, t: 26, b: 40 }, legend: { orientation: "h", y: 1, yanchor: "bottom", x: 1, xanchor: "right" },
    hoverlabel: { font: { size: 12 } },
  });

  async function json(address) {
    const answer = await fetch(address);
    if (!answer.ok) throw new Error((await answer.text()).slice(0, 300));
    return answer.json();
  }
  function empty(element, text) {
    if (element.data) Plotly.purge(element);
    element.dataset.empty = text;
    element.classList.toggle("empty", Boolean(text));
  }
  const outages = (element) => JSON.parse(element.dataset.outages || "[]");

  function panelLayout(shown, element) {
    const many = shown.panels.length, gap = many > 1 ? 0.05 : 0;
    const layout = { ...base(), hovermode: "x", height: 40 + Math.max(130 * many, 190), xaxis: { ...axis(shown.time), range: [shown.start, shown.stop], anchor: "y" + (many > 1 ? many : "") },
      dragmode: element.dataset.chart === "timeline" ? "select" : "zoom", selectdirection: "h" };
    const data = [], legend = new Set();
    shown.panels.forEach((panel, k) => {
      const high = 1 - k * (1 / many) - (k ? gap / 2 : 0), low = 1 - (k + 1) * (1 / many) + (k < many - 1 ? gap / 2 : 0);
      const name = "yaxis" + (k ? k + 1 : "");
      layout[name] = { ...axis(panel.label), domain: [Math.max(low, 0), high], fixedrange: true };
      for (const curve of panel.curves) {
        data.push({ type: "scatter", mode: "lines", name: curve.name, legendgroup: curve.name, showlegend: !legend.has(curve.name),
          x: curve.x, y: curve.y, yaxis: "y" + (k ? k + 1 : ""), line: { color: colour(curve.role), width: 1.1, simplify: false },
          hovertemplate: `%{y:.5~g}<extra>${curve.name}</extra>` });
        legend.add(curve.name);
      }
    });
    layout.shapes = outages(element).map(([a, b]) => ({ type: "rect", xref: "x", yref: "paper", x0: a, x1: b, y0: 0, y1: 1,
      fillcolor: colour("outage", true), line: { width: 0 }, layer: "below" }));
    return [data, layout];
  }

  function signals(element) {
    const state = { start: null, stop: null, span: null, shown: null, turn: 0 };
    const draw = () => {
      if (!state.shown) return;
      const [data, layout] = panelLayout(state.shown, element);
      Plotly.react(element, data, layout, CONFIG);
    };
    const load = async (start, stop) => {
      if (!element.dataset.source) return empty(element, element.dataset.without || "");
      const turn = ++state.turn, began = performance.now();
      const place = new URL(element.dataset.source, location.href);
      place.searchParams.set("columns", Math.min(Math.max(element.clientWidth - 60, 100), 3000));
      if (start !== undefined) { place.searchParams.set("start", start); place.searchParams.set("stop", stop); }
      try {
        const shown = await json(place);
        if (turn !== state.turn) return; // a later one is on its way
        empty(element, shown.panels.length ? "" : "nothing to draw");
        Object.assign(state, { shown, start: shown.start, stop: shown.stop, span: shown.span });
        draw();
        listen();
        element.dataset.latency = Math.round(performance.now() - began);
        element.dataset.window = [shown.start, shown.stop].join(",");
        element.dispatchEvent(new CustomEvent("window", { detail: [shown.start, shown.stop] }));
      } catch (error) { if (turn === state.turn) empty(element, error.message); }
    };
    const go = (start, stop) => {
      const [first, last] = state.span, length = Math.min(stop - start, last - first);
      const begin = Math.min(Math.max(start, first), last - length);
      load(begin, begin + length);
    };
    let listening = false;
    const listen = () => {
      if (listening) return;
      listening = true;
      element.on("plotly_relayout", (change) => {
        if ("xaxis.range[0]" in change) go(change["xaxis.range[0]"], change["xaxis.range[1]"]);
      });
      element.on("plotly_doubleclick", () => load(...state.span));
      element.on("plotly_selected", (selected) => {
        if (!selected || !selected.range) return;
        const range = selected.range.x || Object.entries(selected.range).find(([name]) => name[0] === "x")[1];
        Plotly.relayout(element, { selections: [] });
        element.dispatchEvent(new CustomEvent("span", { detail: [Math.min(...range), Math.max(...range)] }));
      });
    };
    element.tabIndex = 0;
    element.setAttribute("role", "img");
    element.addEventListener("keydown", (event) => {
      if (!state.span) return;
      const length = state.stop - state.start, middle = (state.start + state.stop) / 2;
      const moves = {
        ArrowLeft: () => go(state.start - 0.25 * length, state.stop - 0.25 * length),
        ArrowRight: () => go(state.start + 0.25 * length, state.stop + 0.25 * length),
        "+": () => go(middle - 0.25 * length, middle + 0.25 * length), "-": () => go(middle - length, middle + length),
        0: () => load(...state.span),
      };
      if (moves[event.key]) { event.preventDefault(); moves[event.key](); }
    });
    return { draw, load: () => load() };
  }

  function plan(element) {
    let shown = null;
    const draw = () => {
      if (!shown) return;
      const data = shown.curves.map((c) => ({ type: "scatter", mode: c.role === "measured" ? "markers" : "lines", name: c.name,
        x: c.east, y: c.north, customdata: c.t, line: { color: colour(c.role), width: c.role === "smoothed" ? 1.2 : 2 },
        marker: { color: colour(c.role), size: 4 }, hovertemplate: `%{customdata:.1f} s<br>%{y:.1f} m north, %{x:.1f} m east<extra>${c.name}</extra>` }));
      for (const [start, stop] of outages(element)) {
        const c = shown.curves.find((one) => one.role === "filtered") || shown.curves[0];
        if (!c) continue;
        const k = c.t.map((t, i) => i).filter((i) => c.t[i] >= start && c.t[i] <= stop);
        data.unshift({ type: "scatter", mode: "lines", x: k.map((i) => c.east[i]), y: k.map((i) => c.north[i]), hoverinfo: "skip",
          showlegend: false, line: { color: colour("outage", true), width: 12 } });
      }
      Plotly.react(element, data, { ...base(), dragmode: "pan", hovermode: "closest", xaxis: { ...axis("east [m]"), zeroline: false },
        yaxis: { ...axis("north [m]"), scaleanchor: "x", scaleratio: 1, zeroline: false } }, { ...CONFIG, scrollZoom: true, doubleClick: "reset" });
    };
    const load = async () => {
      if (!element.dataset.source) return empty(element, element.dataset.without || "");
      try {
        shown = await json(element.dataset.source);
        empty(element, shown.curves.length ? "" : shown.note || "no positions to draw");
        if (shown.curves.length) draw();
        element.dataset.curves = shown.curves.map((c) => c.name).join(",");
      } catch (error) { shown = null; empty(element, error.message); }
    };
    element.setAttribute("role", "img");
    return { draw, load };
  }

  function appear(element) {
    if (charts.has(element)) return;
    const chart = element.dataset.chart === "plan" ? plan(element) : signals(element);
    charts.set(element, chart);
    chart.load();
  }
  new MutationObserver((changes) => {
    for (const change of changes) {
      if (change.type === "attributes" && charts.has(change.target)) {
        if (change.attributeName === "data-source") charts.get(change.target).load();
        else charts.get(change.target).draw();
      }
      for (const node of change.addedNodes)
        if (node.nodeType === 1) [node, ...node.querySelectorAll("*")].filter((e) => e.dataset && e.dataset.chart).forEach(appear);
    }
    for (const element of charts.keys()) if (!element.isConnected) charts.delete(element);
  }).observe(document.documentElement, { subtree: true, childList: true, attributes: true, attributeFilter: ["data-source", "data-outages"] });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => charts.forEach((chart) => chart.draw()));

  // files are sent as they are, one request each; the page hears of each that has arrived
  async function send(drop, files) {
    for (const file of files) {
      drop.dispatchEvent(new CustomEvent("sending", { detail: file.name }));
      let problem = "";
      try {
        const answer = await fetch("/studio/uploads/" + encodeURIComponent(file.name), { method: "PUT", body: file });
        if (!answer.ok) problem = await answer.text();
      } catch (error) { problem = `${file.name}: the connection ended: ${error.message}`; }
      drop.dispatchEvent(new CustomEvent("sent", { detail: [file.name, problem] }));
    }
  }
  const dropOf = (event) => event.target.closest && event.target.closest(".drop");
  for (const kind of ["dragover", "dragleave", "drop"])
    document.addEventListener(kind, (event) => {
      event.preventDefault(); // a file dropped beside it must not replace the page
      const drop = dropOf(event);
      if (!drop) return;
      drop.classList.toggle("over", kind === "dragover");
      if (kind === "drop") send(drop, [...event.dataTransfer.files]);
    });
  document.addEventListener("change", (event) => {
    if (event.target.matches && event.target.matches(".drop input")) { send(dropOf(event), [...event.target.files]); event.target.value = ""; }
  });
})();
