// Charts, uploads and keys of the workbench. An element with data-chart draws itself when it appears on the page, and
// again when data-source or data-windows change; what is selected goes back as an event.
"use strict";
(() => {
  const colour = (role, area) =>
    getComputedStyle(document.documentElement).getPropertyValue("--" + role.replaceAll("_", "-") + (area ? "-area" : "")).trim();
  const charts = new Map(); // element: {draw, load}
  const CONFIG = { displayModeBar: false, responsive: true, doubleClick: false };

  const plain = (text) => String(text).replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll("%{", "%&#123;"); // no markup to plotly
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
  const windows = (element) => JSON.parse(element.dataset.windows || "[]"); // [start, stop, role]
  const say = (element, name, detail) => element.dispatchEvent(new CustomEvent(name, { detail }));
  // one time under the cursor on all charts of the page, null for none
  const mark = (t) => charts.forEach((chart) => chart.mark && chart.mark(t));
  function overlay(element, name) {
    let mine = element.querySelector("." + name);
    if (!mine) { mine = document.createElement("div"); mine.className = name; element.append(mine); }
    return mine.style;
  }

  function panelLayout(shown, element) {
    const many = shown.panels.length, gap = many > 1 ? 0.05 : 0;
    const layout = { ...base(), hovermode: "x", height: 40 + Math.max(145 * many, 190), xaxis: { ...axis(shown.time), range: [shown.start, shown.stop], anchor: "y" + (many > 1 ? many : "") },
      dragmode: element.dataset.chart === "timeline" ? "select" : "zoom", selectdirection: "h" };
    const data = [], legend = new Set();
    shown.panels.forEach((panel, k) => {
      const high = 1 - k * (1 / many) - (k ? gap / 2 : 0), low = 1 - (k + 1) * (1 / many) + (k < many - 1 ? gap / 2 : 0);
      const name = "yaxis" + (k ? k + 1 : "");
      layout[name] = { ...axis(plain(panel.label)), domain: [Math.max(low, 0), high], fixedrange: true };
      for (const curve of panel.curves) {
        data.push({ type: "scatter", mode: "lines", name: plain(curve.name), legendgroup: curve.name, showlegend: !legend.has(curve.name),
          x: curve.x, y: curve.y, yaxis: "y" + (k ? k + 1 : ""), line: { color: colour(curve.role), width: 1.1, simplify: false },
          hovertemplate: `%{y:.5~g}<extra>${plain(curve.name)}</extra>` });
        legend.add(curve.name);
      }
    });
    layout.shapes = windows(element).map(([a, b, role]) => ({ type: "rect", xref: "x", yref: "paper", x0: a, x1: b, y0: 0, y1: 1,
      fillcolor: colour(role, true), line: { width: 0 }, layer: "below" }));
    return [data, layout];
  }

  // A window is dragged as a whole or by an edge; pressed without moving, it is pointed at.
  function movable(element, state) {
    const time = (event) => {
      const x = element._fullLayout.xaxis;
      return x.p2l(event.clientX - element.getBoundingClientRect().left - x._offset);
    };
    const grip = (event) => {
      if (!element._fullLayout || !event.target.classList.contains("nsewdrag")) return null;
      const t = time(event), near = Math.abs(element._fullLayout.xaxis.p2l(6) - element._fullLayout.xaxis.p2l(0));
      const all = windows(element).map(([a, b], index) => ({ index, a, b, t }));
      for (const w of all) {
        const edge = Math.abs(t - w.a) < Math.abs(t - w.b) ? "a" : "b";
        if (Math.abs(t - w[edge]) < Math.min(near, 0.3 * (w.b - w.a))) return { ...w, edge };
      }
      return all.find((w) => w.a <= t && t <= w.b) || null;
    };
    element.addEventListener("mousemove", (event) => {
      const held = event.buttons ? null : grip(event);
      element.classList.toggle("on-edge", Boolean(held && held.edge));
      element.classList.toggle("on-window", Boolean(held && !held.edge));
    });
    element.addEventListener("mousedown", (event) => {
      const held = event.button === 0 && grip(event);
      if (!held) return;
      event.stopPropagation(); // else a new selection begins
      event.preventDefault();
      let { a, b } = held, far = false;
      const [first, last] = state.span;
      const move = (now) => {
        far = far || Math.abs(now.clientX - event.clientX) > 3;
        if (!far) return;
        const by = time(now) - held.t, least = 0.02 * (held.b - held.a);
        if (held.edge === "a") a = Math.max(Math.min(held.a + by, b - least), first);
        else if (held.edge === "b") b = Math.min(Math.max(held.b + by, a + least), last);
        else { const stay = Math.min(Math.max(by, first - held.a), last - held.b); a = held.a + stay; b = held.b + stay; }
        Plotly.relayout(element, { [`shapes[${held.index}].x0`]: a, [`shapes[${held.index}].x1`]: b });
      };
      const up = () => {
        removeEventListener("mousemove", move, true);
        removeEventListener("mouseup", up, true);
        if (far) say(element, "moved", [held.index, a, b]); else say(element, "point", held.t);
      };
      addEventListener("mousemove", move, true);
      addEventListener("mouseup", up, true);
    }, true);
  }

  function signals(element) {
    const state = { start: null, stop: null, span: null, shown: null, turn: 0 };
    const draw = () => {
      if (!state.shown) return;
      const [data, layout] = panelLayout(state.shown, element);
      Plotly.react(element, data, layout, CONFIG);
    };
    const load = async (start, stop) => {
      delete element.dataset.latency; // until it is drawn
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
        say(element, "window", [shown.start, shown.stop]);
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
        say(element, "span", [Math.min(...range), Math.max(...range)]);
      });
      element.on("plotly_hover", (event) => mark(event.xvals ? event.xvals[0] : event.points[0].x));
      element.on("plotly_unhover", () => mark(null));
      if (element.dataset.chart === "timeline") movable(element, state);
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
    const markTime = (t) => {
      if (!element._fullLayout) return;
      const x = element._fullLayout.xaxis, px = t === null ? -1 : x.l2p(t), look = overlay(element, "cursor-line");
      look.display = px >= 0 && px <= x._length ? "block" : "none";
      look.left = x._offset + px + "px";
    };
    return { draw, load: () => load(), mark: markTime };
  }

  function plan(element) {
    let shown = null, listening = false, map = null, turn = 0;
    const extent = () => ["east", "north"].map((name) => {
      let low = Infinity, high = -Infinity;
      for (const c of shown.curves) for (const v of c[name]) { low = Math.min(low, v); high = Math.max(high, v); }
      const spare = 0.06 * (high - low) + 5;
      return [low - spare, high + spare];
    });
    const vehicle = () => shown.curves.find((one) => one.role === "filtered") || shown.curves[0];
    const draw = () => {
      if (!shown) return;
      const data = shown.curves.map((c) => ({ type: "scatter", mode: c.role === "measured" ? "markers" : "lines", name: plain(c.name),
        x: c.east, y: c.north, customdata: c.t, line: { color: colour(c.role), width: c.role === "smoothed" ? 1.2 : 2 },
        marker: { color: colour(c.role), size: 4 }, hovertemplate: `%{customdata:.1f} s<br>%{y:.1f} m north, %{x:.1f} m east<extra>${plain(c.name)}</extra>` }));
      for (const [start, stop] of windows(element)) {
        const c = vehicle();
        if (!c) continue;
        const k = c.t.map((t, i) => i).filter((i) => c.t[i] >= start && c.t[i] <= stop);
        data.unshift({ type: "scatter", mode: "lines", x: k.map((i) => c.east[i]), y: k.map((i) => c.north[i]), hoverinfo: "skip",
          showlegend: false, line: { color: colour("outage", true), width: 12 } });
      }
      const extra = {}, ranges = extent(); // of the track: a map goes beyond it
      if (map) {
        data.unshift(...map.lines.map((one) => ({ type: "scatter", mode: "lines", x: one.x, y: one.y, hoverinfo: "skip", showlegend: false,
          line: { color: colour(one.role), width: one.role === "road_major" ? 3 : 1.4 } })));
        const p = map.picture;
        if (p) extra.images = [{ source: p.address, xref: "x", yref: "y", x: p.left, y: p.top, sizex: p.right - p.left, sizey: p.top - p.bottom,
          sizing: "stretch", layer: "below", opacity: 0.75 }];
        if (map.credit) extra.annotations = [{ text: plain(map.credit), xref: "paper", yref: "paper", x: 1, y: 0, xanchor: "right",
          yanchor: "bottom", showarrow: false, font: { size: 10 }, bgcolor: colour("ground"), opacity: 0.85 }];
      }
      Plotly.react(element, data, { ...base(), ...extra, dragmode: "pan", hovermode: "closest", xaxis: { ...axis("east [m]"), zeroline: false, range: ranges[0] },
        yaxis: { ...axis("north [m]"), scaleanchor: "x", scaleratio: 1, zeroline: false, range: ranges[1] } }, { ...CONFIG, scrollZoom: true, doubleClick: "reset" });
      if (listening) return;
      listening = true;
      element.on("plotly_hover", (event) => mark(event.points[0].customdata));
      element.on("plotly_unhover", () => mark(null));
    };
    // the vehicle at a time, pointing along its course on the page
    const markPlace = (t) => {
      if (!shown || !element._fullLayout || !shown.curves.length) return;
      const look = overlay(element, "vehicle"), c = vehicle();
      delete element.dataset.marked;
      look.display = "none";
      if (t === null || t === undefined) return;
      let k = c.t.findIndex((one) => one >= t);
      k = k < 0 ? c.t.length - 1 : k > 0 && t - c.t[k - 1] < c.t[k] - t ? k - 1 : k;
      const { xaxis: x, yaxis: y } = element._fullLayout, at = (i) => [x.l2p(c.east[i]), y.l2p(c.north[i])];
      const [left, top] = at(k), [x0, y0] = at(Math.max(k - 2, 0)), [x1, y1] = at(Math.min(k + 2, c.t.length - 1));
      if (left < 0 || left > x._length || top < 0 || top > y._length) return;
      Object.assign(look, { display: "block", left: x._offset + left + "px", top: y._offset + top + "px" });
      look.transform = `translate(-50%, -50%) rotate(${Math.atan2(x1 - x0, y0 - y1)}rad)`;
      element.dataset.marked = c.t[k];
    };
    const load = async () => {
      if (!element.dataset.source) return empty(element, element.dataset.without || "");
      try {
        shown = await json(element.dataset.source);
        empty(element, shown.curves.length ? "" : shown.note || "no positions to draw");
        if (shown.curves.length) draw();
        element.dataset.curves = shown.curves.map((c) => c.name).join(",");
        loadMap();
      } catch (error) { shown = null; empty(element, error.message); }
    };
    const loadMap = async () => {
      const name = element.dataset.map, mine = ++turn;
      let problem = "", drawn = null;
      if (name && shown && shown.curves.length) {
        element.classList.add("busy");
        try {
          const place = new URL(element.dataset.source.replace("/studio/track", "/studio/map"), location.href);
          place.searchParams.set("name", name);
          drawn = await json(place);
        } catch (error) { problem = error.message; }
        if (mine !== turn) return;
        element.classList.remove("busy");
      }
      if (map || drawn) { map = drawn; draw(); }
      element.dataset.mapped = drawn ? name : "";
      if (problem) say(element, "refused", problem);
    };
    element.setAttribute("role", "img");
    return { draw, load, loadMap, mark: markPlace };
  }

  // A figure of the reports: its panels below each other, colours by name.
  const coloured = (value) => {
    if (typeof value === "string") return value.startsWith("--") ? getComputedStyle(document.documentElement).getPropertyValue(value).trim() : value;
    if (Array.isArray(value)) return typeof value[0] === "object" ? value.map(coloured) : value;
    if (value && typeof value === "object") return Object.fromEntries(Object.entries(value).map(([k, v]) => [k, coloured(v)]));
    return value;
  };
  function figure(element) {
    const fold = element.closest("details");
    let shown = null;
    const draw = () => {
      if (!shown) return;
      element.replaceChildren(...shown.panels.flatMap((panel) => {
        const head = document.createElement("p"), body = document.createElement("div");
        head.className = "hint";
        head.textContent = panel.title;
        return panel.title ? [head, body] : [body];
      }));
      const places = [...element.children].filter((child) => child.tagName === "DIV");
      shown.panels.forEach((panel, k) => {
        const layout = coloured(panel.layout), own = base();
        const words = (layout.yaxis.ticktext || []).map((word) => word.length);
        const both = Object.fromEntries(["xaxis", "yaxis"].map((name) => [name, { ...axis(""), ...layout[name],
          title: { ...axis("").title, ...layout[name].title }, zeroline: false, nticks: layout[name].tickvals ? undefined : 6 }]));
        const height = layout.yaxis.scaleanchor ? 0.52 * element.clientWidth + 50 : 56 + 175 * panel.height;
        const names = new Set();
        const data = coloured(panel.data).map((trace) => {
          const first = trace.name && !names.has(trace.name);
          names.add(trace.name);
          return { ...trace, name: plain(trace.name || ""), showlegend: Boolean(first) };
        });
        Plotly.react(places[k], data, { ...layout, ...own, ...both, hovermode: layout.hovermode, height,
          margin: { ...own.margin, t: 6, l: Math.max(own.margin.l, 7 * Math.max(0, ...words) + 12) },
          showlegend: names.size > 1 || names.has("x"), dragmode: false }, CONFIG);
      });
    };
    const load = async () => {
      if (!element.dataset.source) { shown = null; element.replaceChildren(); return empty(element, element.dataset.without || ""); }
      if (fold && !fold.open) return; // loaded when it is opened
      const source = element.dataset.source;
      element.classList.add("busy");
      try {
        const answer = await json(source);
        if (source !== element.dataset.source) return;
        shown = answer;
        empty(element, shown.panels.length ? "" : "nothing to show");
        if (shown.panels.length) draw(); else element.replaceChildren();
        element.dataset.drawn = source;
      } catch (error) { shown = null; element.replaceChildren(); empty(element, error.message); }
      element.classList.remove("busy");
    };
    if (fold) fold.addEventListener("toggle", () => { if (fold.open && element.dataset.drawn !== element.dataset.source) load(); });
    element.setAttribute("role", "img");
    return { draw, load };
  }

  // An Allan curve: terms of the model are switched, lines of a slope are dragged or typed, at any place of the line.
  function allan(element) {
    let shown = null, body = null;
    const off = new Set(), lines = new Set(), levels = new Map();
    const box = (text, on, change) => {
      const label = document.createElement("label"), input = document.createElement("input");
      Object.assign(input, { type: "checkbox", checked: on });
      input.addEventListener("change", () => { change(input.checked); draw(); });
      label.append(input, " " + text);
      return label;
    };
    const value = (slope) => +(levels.get(slope.letter) * slope.scale).toPrecision(4);
    const controls = () => {
      const terms = document.createElement("div"), slopes = document.createElement("div");
      terms.className = slopes.className = "line switches";
      terms.append("model:", ...Object.keys(shown.terms).map((name) => box(name, !off.has(name), (on) => (on ? off.delete(name) : off.add(name)))));
      slopes.append("lines:", ...shown.slopes.map((slope) => {
        const both = document.createElement("span"), field = document.createElement("input");
        field.className = "level";
        field.dataset.letter = slope.letter;
        field.value = value(slope);
        field.setAttribute("aria-label", `${slope.name} [${slope.unit}]`);
        field.title = `${slope.name} [${slope.unit}]`;
        field.addEventListener("change", () => {
          const typed = parseFloat(field.value) / slope.scale;
          if (typed > 0) { levels.set(slope.letter, typed); lines.add(slope.letter); both.querySelector("input").checked = true; }
          draw();
        });
        both.append(box(slope.letter, lines.has(slope.letter), (on) => (on ? lines.add(slope.letter) : lines.delete(slope.letter))), field,
          " " + slope.unit);
        return both;
      }));
      body = document.createElement("div");
      element.replaceChildren(terms, slopes, body);
    };
    const curve = (x, y, name, look, more) => ({ type: "scatter", mode: "lines", x, y, name: plain(name), line: look, hovertemplate: "%{y:.4~g}<extra>" + plain(name) + "</extra>", ...more });
    const draw = () => {
      if (!shown) return;
      const kept = Object.entries(shown.terms).filter(([name]) => !off.has(name));
      const data = [curve(shown.tau, shown.high, "", { width: 0 }, { showlegend: false, hoverinfo: "skip" }),
        curve(shown.tau, shown.low, "95 % band", { width: 0 }, { fill: "tonexty", fillcolor: colour("allan_band", true) || colour("filtered", true), hoverinfo: "skip" }),
        ...kept.map(([name, v]) => curve(shown.grid, v.map(Math.sqrt), name, { color: colour("term"), width: 1 }, { showlegend: false })),
        curve(shown.tau, shown.adev, "measured", { color: colour("allan"), width: 2 }),
        curve(shown.grid, shown.grid.map((_, k) => Math.sqrt(kept.reduce((sum, [, v]) => sum + v[k], 0)) || null), "model", { color: colour("model"), width: 1.6, dash: "dash" })];
      if (shown.sheet) data.push(curve(shown.grid, shown.sheet, shown.sheet_name + ", data sheet", { color: colour("case_2"), width: 1.6 }));
      for (const slope of shown.slopes) if (lines.has(slope.letter))
        data.push(curve(shown.grid, shown.grid.map((t) => levels.get(slope.letter) * t ** slope.exponent), `${slope.letter} ${value(slope)} ${slope.unit}`,
          { color: colour("ink"), width: 1.6, dash: "dot" }, { meta: slope.letter }));
      const positive = [...shown.adev, ...shown.low, ...shown.high].filter((v) => v > 0).map(Math.log10);
      const layout = { ...base(), height: 420, dragmode: false, hovermode: "closest",
        xaxis: { ...axis("averaging time [s]"), type: "log", zeroline: false }, yaxis: { ...axis(`Allan deviation [${shown.unit}]`), type: "log", zeroline: false,
          range: [Math.min(...positive) - 0.25, Math.max(...positive) + 0.25] } };
      Plotly.react(body, data, layout, CONFIG);
      element.dataset.drawn = [...kept.map(([name]) => name), ...lines, shown.sheet ? "sheet" : ""].join(",");
    };
    // a line follows the pointer, its slope stays
    const held = (event) => {
      const plot = body && body._fullLayout;
      if (!plot || !event.target.classList.contains("nsewdrag")) return null;
      const box = body.getBoundingClientRect(), t = 10 ** plot.xaxis.p2l(event.clientX - box.left - plot.xaxis._offset);
      const level = (y) => 10 ** plot.yaxis.p2l(y - box.top - plot.yaxis._offset);
      const near = shown.slopes.filter((s) => lines.has(s.letter)).map((s) => [Math.abs(plot.yaxis.l2p(Math.log10(levels.get(s.letter) * t ** s.exponent)) -
        (event.clientY - box.top - plot.yaxis._offset)), s]).sort((a, b) => a[0] - b[0])[0];
      return near && near[0] < 12 ? { slope: near[1], t, level } : null;
    };
    element.addEventListener("mousemove", (event) => element.classList.toggle("on-line", Boolean(!event.buttons && held(event))));
    element.addEventListener("mousedown", (event) => {
      const grip = event.button === 0 && held(event);
      if (!grip) return;
      event.stopPropagation();
      event.preventDefault();
      const move = (now) => {
        levels.set(grip.slope.letter, grip.level(now.clientY) / grip.t ** grip.slope.exponent);
        element.querySelector(`[data-letter=${grip.slope.letter}]`).value = value(grip.slope);
        draw();
      };
      const up = () => { removeEventListener("mousemove", move, true); removeEventListener("mouseup", up, true); };
      addEventListener("mousemove", move, true);
      addEventListener("mouseup", up, true);
    }, true);
    const load = async () => {
      if (!element.dataset.source) { shown = null; element.replaceChildren(); return; }
      try {
        const before = shown && shown.axis;
        shown = await json(element.dataset.source);
        if (before !== shown.axis) { off.clear(); shown.slopes.forEach((s) => levels.set(s.letter, s.level)); }
        controls();
        empty(element, "");
        draw();
      } catch (error) { shown = null; element.replaceChildren(); empty(element, error.message); }
    };
    return { draw, load };
  }

  // The IMU as a box on its platform, turning; the button stops it, and it stands still for who wants no motion.
  function platform(element) {
    const size = 300, svg = (name, more) => {
      const made = document.createElementNS("http://www.w3.org/2000/svg", name);
      for (const [key, value] of Object.entries(more)) made.setAttribute(key, value);
      return made;
    };
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [k & 1 ? 0.5 : -0.5, k & 2 ? 0.32 : -0.32, k & 4 ? 0.2 : -0.2]);
    const sides = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let shown = null, picture = null, turning = !matchMedia("(prefers-reduced-motion: reduce)").matches, at = 0, last = null;
    const seen = (v) => [0, 1, 2].map((k) => v[0] * shown.view[0][k] + v[1] * shown.view[1][k] + v[2] * shown.view[2][k]);
    const page = (v) => { const p = seen(v); return [size / 2 + 95 * p[0], size / 2 - 95 * p[1], p[2]]; };
    const line = (a, b, role, width, more) => svg("line", { x1: a[0], y1: a[1], x2: b[0], y2: b[1], stroke: colour(role), "stroke-width": width, ...more });
    const word = (p, text, role) => { const made = svg("text", { x: p[0], y: p[1], fill: colour(role), "font-size": 12, "text-anchor": "middle" }); made.textContent = text; return made; };
    const draw = () => {
      if (!shown || !picture) return;
      const k = Math.min(Math.floor(at * shown.t.length), shown.t.length - 1), C = shown.C[k];
      const turned = (v) => [0, 1, 2].map((i) => C[3 * i] * v[0] + C[3 * i + 1] * v[1] + C[3 * i + 2] * v[2]);
      const centre = page([0, 0, 0]), parts = [];
      ["forward", "right", "down"].forEach((name, i) => {
        const end = page([0, 1, 2].map((j) => (i === j ? 1.15 : 0)));
        parts.push(line(centre, end, "rule", 1), word(page([0, 1, 2].map((j) => (i === j ? 1.3 : 0))), name, "muted"));
      });
      shown.axes[k].forEach((u, i) => parts.push(line(page(u.map((x) => -1.2 * x)), page(u.map((x) => 1.2 * x)), "reference", 2, { "stroke-dasharray": "7 4" }),
        word(page(u.map((x) => 1.32 * x)), "axis " + i, "reference")));
      const points = corners.map((c) => page(turned(c)));
      const faces = sides.map((side) => [side.reduce((sum, c) => sum + points[c][2], 0), side]).sort((a, b) => a[0] - b[0]);
      for (const [, side] of faces)
        parts.push(svg("polygon", { points: side.map((c) => points[c].slice(0, 2).join(",")).join(" "), fill: colour("raised"), stroke: colour("ink"), "fill-opacity": 0.9 }));
      ["x", "y", "z"].forEach((name, i) => {
        const tip = turned([0, 1, 2].map((j) => (i === j ? 0.95 : 0)));
        const look = seen(tip)[2] < 0 ? { "stroke-opacity": 0.45 } : {};
        parts.push(line(centre, page(tip), "axis-" + name, 3, look), word(page(tip.map((x) => 1.12 * x)), name, "axis-" + name));
      });
      picture.replaceChildren(...parts);
      element.dataset.t = shown.t[k];
      element.querySelector("output").value = `${shown.t[k].toFixed(1)} s of ${shown.t.at(-1).toFixed(1)} s`;
    };
    const step = (now) => {
      if (!element.isConnected) return;
      if (turning && shown && last !== null) { at = (at + (now - last) / 12000) % 1; draw(); }
      last = now;
      requestAnimationFrame(step);
    };
    const load = async () => {
      element.replaceChildren();
      if (!element.dataset.source) { shown = null; return; }
      try {
        shown = await json(element.dataset.source);
        empty(element, "");
        picture = svg("svg", { viewBox: `0 0 ${size} ${size}`, role: "img", "aria-label": "the IMU on its platform" });
        const row = document.createElement("div"), button = document.createElement("button");
        row.className = "line";
        button.className = "q-btn";
        button.type = "button";
        const named = () => { button.textContent = turning ? "stop" : "turn"; };
        button.addEventListener("click", () => { turning = !turning; named(); });
        named();
        row.append(button, document.createElement("output"));
        element.append(picture, row);
        draw();
        if (last === null) requestAnimationFrame(step);
      } catch (error) { shown = null; empty(element, error.message); }
    };
    return { draw, load };
  }

  // Directions on a sphere that is dragged or turned by arrow keys; what is behind is pale, what is pointed at is said.
  function sphere(element) {
    const size = 320, radius = 130, LINES = 24;
    let shown = null, yaw = 0.6, pitch = 0.35, picture = null, said = null;
    const seen = ([x, y, z]) => { // right, up, towards the viewer
      const right = -x * Math.sin(yaw) + y * Math.cos(yaw), ahead = x * Math.cos(yaw) + y * Math.sin(yaw);
      return [right, z * Math.cos(pitch) - ahead * Math.sin(pitch), ahead * Math.cos(pitch) + z * Math.sin(pitch)];
    };
    const place = (v) => { const p = seen(v); return [size / 2 + radius * p[0], size / 2 - radius * p[1], p[2]]; };
    const svg = (name, more, text) => {
      const made = document.createElementNS("http://www.w3.org/2000/svg", name);
      for (const [key, value] of Object.entries(more)) made.setAttribute(key, value);
      if (text) made.textContent = text;
      return made;
    };
    const ball = (latitude, longitude) => [Math.cos(latitude) * Math.cos(longitude), Math.cos(latitude) * Math.sin(longitude), Math.sin(latitude)];
    const turn = (k) => (2 * Math.PI * k) / LINES;
    const circles = [-60, -30, 0, 30, 60].map((d) => [...Array(LINES + 1).keys()].map((k) => ball((d * Math.PI) / 180, turn(k))))
      .concat([0, 60, 120].map((d) => [...Array(LINES + 1).keys()].map((k) => ball(turn(k), (d * Math.PI) / 180))));
    const draw = () => {
      if (!shown || !picture) return;
      const parts = [svg("circle", { cx: size / 2, cy: size / 2, r: radius, fill: colour("raised"), stroke: colour("rule") })];
      for (const points of circles)
        for (let k = 1; k < points.length; k++) {
          const [a, b] = [place(points[k - 1]), place(points[k])];
          parts.push(svg("line", { x1: a[0], y1: a[1], x2: b[0], y2: b[1], stroke: colour("rule"), "stroke-opacity": a[2] + b[2] < 0 ? 0.3 : 0.9 }));
        }
      ["x", "y", "z"].forEach((name, i) => [1, -1].forEach((sign) => {
        const p = place([0, 1, 2].map((j) => (i === j ? 1.13 * sign : 0)));
        parts.push(svg("text", { x: p[0], y: p[1] + 4, fill: colour("axis-" + name), "fill-opacity": p[2] < 0 ? 0.45 : 1, "font-size": 13, "text-anchor": "middle" }, (sign > 0 ? "+" : "-") + name));
      }));
      const marks = [...shown.poses, shown.gap].map((one) => ({ one, p: place(one.v) })).sort((a, b) => a.p[2] - b.p[2]);
      for (const { one, p } of marks) {
        const gap = one === shown.gap, stroke = colour(gap ? "ink" : one.role);
        const look = gap ? { fill: "none", stroke, "stroke-dasharray": "3 2" } : one.ring ? { fill: "none", stroke, "stroke-width": 2 } : { fill: stroke };
        const made = svg("circle", { cx: p[0], cy: p[1], r: gap ? 11 : one.ring ? 7 : 4, "fill-opacity": p[2] < 0 ? 0.3 : 1, "stroke-opacity": p[2] < 0 ? 0.3 : 1, "pointer-events": one.ring ? "stroke" : "all", ...look });
        made.addEventListener("pointerenter", () => { said.value = one.text; });
        parts.push(made);
      }
      picture.replaceChildren(...parts);
      element.dataset.view = [yaw, pitch].map((angle) => angle.toFixed(4)).join(",");
    };
    const turned = (right, up) => { yaw -= right; pitch = Math.min(Math.max(pitch + up, -Math.PI / 2), Math.PI / 2); draw(); };
    const grip = (event) => {
      let last = [event.clientX, event.clientY];
      const scale = picture.getBoundingClientRect().width * (radius / size);
      const move = (now) => { turned((now.clientX - last[0]) / scale, (now.clientY - last[1]) / scale); last = [now.clientX, now.clientY]; };
      const up = () => { removeEventListener("pointermove", move); removeEventListener("pointerup", up); removeEventListener("pointercancel", up); };
      addEventListener("pointermove", move);
      addEventListener("pointerup", up);
      addEventListener("pointercancel", up);
    };
    const load = async () => {
      element.replaceChildren();
      if (!element.dataset.source) { shown = null; return; }
      try {
        shown = await json(element.dataset.source);
        empty(element, shown.poses.length ? "" : element.dataset.without || "");
        if (!shown.poses.length) { shown = null; return; }
        picture = svg("svg", { viewBox: `0 0 ${size} ${size}`, role: "img", tabindex: 0, "aria-label": element.getAttribute("aria-label") });
        picture.addEventListener("pointerdown", grip);
        picture.addEventListener("keydown", (event) => {
          const by = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
          if (by) { event.preventDefault(); turned(...by); }
        });
        said = document.createElement("output");
        said.value = shown.gap.text;
        element.append(picture, said);
        draw();
      } catch (error) { shown = null; empty(element, error.message); }
    };
    return { draw, load };
  }

  function appear(element) {
    if (charts.has(element)) return;
    const chart = ({ plan, figure, allan, platform, sphere }[element.dataset.chart] || signals)(element);
    charts.set(element, chart);
    chart.load();
  }
  new MutationObserver((changes) => {
    for (const change of changes) {
      if (change.type === "attributes" && charts.has(change.target)) {
        if (change.attributeName === "data-source") charts.get(change.target).load();
        else if (change.attributeName === "data-map") charts.get(change.target).loadMap();
        else charts.get(change.target).draw();
      }
      for (const node of change.addedNodes)
        if (node.nodeType === 1) [node, ...node.querySelectorAll("*")].filter((e) => e.dataset && e.dataset.chart).forEach(appear);
    }
    for (const element of charts.keys()) if (!element.isConnected) charts.delete(element);
  }).observe(document.documentElement, { subtree: true, childList: true, attributes: true, attributeFilter: ["data-source", "data-windows", "data-map"] });
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
