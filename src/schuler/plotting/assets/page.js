(function () {
  "use strict";
  var figures;
  var plots = Array.prototype.slice.call(document.querySelectorAll(".plot"));
  // where nothing hovers, dragging has to scroll the page and not zoom a plot
  var touch = !window.matchMedia("(hover: hover) and (pointer: fine)").matches;
  var printing = false;
  // what all time axes show, null for all of it
  var span = null;

  // Text that was packed with gzip and base64, as bytes.
  function bytes(text) {
    var letters = atob(text), raw = new Uint8Array(letters.length);
    for (var k = 0; k < raw.length; k++) raw[k] = letters.charCodeAt(k);
    var stream = new Blob([raw]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).arrayBuffer().then(function (buffer) { return new Uint8Array(buffer); });
  }

  function unpacked(id) {
    var element = document.getElementById(id);
    if (!element) return Promise.resolve("");
    return bytes(element.textContent).then(function (raw) { return new TextDecoder().decode(raw); });
  }

  // Numbers from differences with their sign in the last bit, lowest bytes of all first.
  function numbers(packed) {
    return bytes(packed.data).then(function (raw) {
      var n = raw.length / 4, values = new Float64Array(n), sum = 0;
      for (var k = 0; k < n; k++) {
        var folded = (raw[k] | raw[n + k] << 8 | raw[2 * n + k] << 16 | raw[3 * n + k] << 24) >>> 0;
        sum += folded % 2 ? -(folded + 1) / 2 : folded / 2;
        values[k] = packed.zero + packed.step * sum;
      }
      return values;
    });
  }

  // A property of a curve that is not for the drawing library.
  function hide(trace, name, value) { Object.defineProperty(trace, name, { value: value, configurable: true }); }

  // All samples of a curve, unpacked when they are first asked for.
  function samplesOf(trace) {
    if (!trace.all) {
      hide(trace, "all", Promise.all([numbers(trace.samples.t), numbers(trace.samples.y)]));
    }
    return trace.all;
  }

  // Samples of a curve between two times: all of them, or the extremes of a thousand stretches.
  function finer(trace, between) {
    return samplesOf(trace).then(function (both) {
      var t = both[0], y = both[1], each = y.length / t.length, x = [], v = [];
      var first = Math.max(place(t, between[0]) - 1, 0), last = Math.min(place(t, between[1]) + 1, t.length);
      var stretch = Math.max(1, Math.ceil((last - first) / 1000)), pause = 5 * trace.samples.interval;
      for (var a = first; a < last; a += stretch) {
        var b = Math.min(a + stretch, last), low = a * each, high = a * each;
        if (a > first && t[a] - t[a - 1] > pause) { x.push(t[a]); v.push(null); }
        for (var k = a * each; k < b * each; k++) {
          if (y[k] < y[low]) low = k;
          if (y[k] > y[high]) high = k;
        }
        [Math.min(low, high), Math.max(low, high)].forEach(function (k, i) {
          if (i && low === high) return;
          // of a stretch that is itself one of extremes, the second one stands at its middle
          x.push(t[Math.floor(k / each)] + (k % each) * 0.5 * trace.samples.interval);
          v.push(y[k]);
        });
      }
      return { x: x, y: v };
    });
  }

  // First of increasing times that is not before t.
  function place(times, t) {
    var low = 0, high = times.length;
    while (low < high) {
      var middle = (low + high) >> 1;
      if (times[middle] < t) low = middle + 1; else high = middle;
    }
    return low;
  }

  // Puts the curves of a panel that have all their samples in the page as finely as what is shown needs.
  function refine(div) {
    var between = span, curves = spec(div).data.filter(function (trace) { return trace.samples; });
    return Promise.all(curves.map(function (trace) {
      if (!trace.thinned) hide(trace, "thinned", { x: trace.x, y: trace.y });
      return between ? finer(trace, between) : trace.thinned;
    })).then(function (drawn) {
      if (between !== span) return;  // zoomed again meanwhile
      curves.forEach(function (trace, k) { trace.x = drawn[k].x; trace.y = drawn[k].y; });
      return draw(div);
    });
  }

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
    // the buttons stand above a plan, whose meridians and north arrow are labelled at its upper edge
    layout.margin = { l: 58, r: 8, t: div.classList.contains("plan") && !printing ? 38 : 8, b: layout.xaxis.title.text ? 40 : 22 };
    if (layout.yaxis.ticktext && !div.dataset.time) {  // names in full; panels over time stay below each other
      var longest = Math.max.apply(null, layout.yaxis.ticktext.map(function (word) { return word.length; }));
      layout.margin.l = Math.max(58, Math.min(7 * longest + 12, 0.5 * div.clientWidth));
    }
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
    });
    if (span && div.dataset.time) {
      layout.xaxis.range = span.slice();
      layout.yaxis.range = visible(own, span) || layout.yaxis.range;
    }
    layout.yaxis.zeroline = false;
    if (!layout.yaxis.tickvals) layout.yaxis.nticks = 6;
    return { data: coloured(own.data, css), layout: layout };
  }

  function draw(div) {
    if (typeof Plotly === "undefined" || !figures) return;
    var d = dressed(div), first = !div.dataset.drawn;
    div.dataset.drawn = "yes";
    if (!first) return Plotly.react(div, d.data, d.layout);
    var done = Plotly.newPlot(div, d.data, d.layout, {
      responsive: true, displaylogo: false, displayModeBar: touch ? true : "hover", doubleClick: "reset+autosize",
      // plotly's own set of buttons has one that sends the data to a server
      showSendToCloud: false, plotlyServerURL: "",
      modeBarButtons: [["toImage"], ["zoom2d", "pan2d"], ["zoomIn2d", "zoomOut2d", "resetScale2d"]]
    });
    if (div.dataset.time) {
      div.on("plotly_relayout", function (change) { zoomTime(div, change); });
      div.on("plotly_hover", function (event) { mark(event.xvals ? event.xvals[0] : event.points[0].x); });
      div.on("plotly_unhover", function () { mark(null); });
    } else if (div.dataset.linked) {
      div.on("plotly_relayout", function (change) { follow(div, change); });
    } else if (timed(spec(div)).length) {
      div.on("plotly_hover", function (event) {
        mark(timeAt(spec(div), event.points[0]));
      });
      div.on("plotly_unhover", function () { mark(null); });
    }
    if (span && div.dataset.time && sampled(div)) refine(div);
    return done;
  }

  function sampled(div) { return spec(div).data.some(function (trace) { return trace.samples; }); }

  // curves of a panel that know the time of their points: tracks
  function timed(panel) { return panel.data.filter(function (trace) { return trace.customdata; }); }

  function empty() { return [Number.MAX_VALUE, -Number.MAX_VALUE]; }

  // Range of the other axis for what is seen between two times: all of the curves, and bands up to once more on each side.
  function visible(panel, between) {
    var log = panel.layout.yaxis.type === "log", curves = empty(), bands = empty();
    panel.data.forEach(function (trace) {
      if (trace.visible === false || !trace.x) return;
      var range = trace.fill ? bands : curves;
      for (var k = 0; k < trace.x.length; k++) {
        var x = trace.x[k], y = trace.y[k];
        if (x === null || y === null || x < between[0] || x > between[1] || (log && y <= 0)) continue;
        if (log) y = Math.log10(y);
        if (y < range[0]) range[0] = y;
        if (y > range[1]) range[1] = y;
      }
    });
    if (curves[0] > curves[1]) curves = bands;
    if (curves[0] > curves[1]) return null;
    var size = curves[1] - curves[0];
    var low = Math.max(Math.min(curves[0], bands[0]), curves[0] - size - 1e-9);
    var high = Math.min(Math.max(curves[1], bands[1]), curves[1] + size + 1e-9);
    var margin = 0.06 * (high - low) || 0.05 * Math.abs(high) || 1e-12;
    return [low - margin, high + margin];
  }

  // Where a track is between two times: ranges of both axes.
  function piece(panel, between) {
    var box = [empty(), empty()];
    timed(panel).forEach(function (trace) {
      trace.customdata.forEach(function (at, k) {
        if (at[0] < between[0] || at[0] > between[1] || trace.x[k] === null) return;
        [trace.x[k], trace.y[k]].forEach(function (v, i) {
          box[i] = [Math.min(box[i][0], v), Math.max(box[i][1], v)];
        });
      });
    });
    if (box[0][0] > box[0][1]) return null;
    var half = 0.56 * Math.max(box[0][1] - box[0][0], box[1][1] - box[1][0], 1);
    return box.map(function (ends) {
      var middle = 0.5 * (ends[0] + ends[1]);
      return [middle - half, middle + half];
    });
  }

  function zoomTime(leader, change) {
    if (leader.dataset.follows) return;
    var range = change["xaxis.range"] || [change["xaxis.range[0]"], change["xaxis.range[1]"]];
    if (change["xaxis.autorange"]) range = null;
    else if (typeof range[0] !== "number" || typeof range[1] !== "number") return;
    var whole = spec(leader).layout.xaxis.range;
    span = !range || (whole && range[0] <= whole[0] && range[1] >= whole[1]) ? null : range.slice();
    plots.forEach(function (div) {
      if (!div.dataset.drawn) return;
      var own = spec(div).layout, x = own.xaxis.range, y = own.yaxis.range;
      if (div.dataset.time) {
        if (sampled(div)) { refine(div).then(function () { fit(div); }); return; }
        if (span) { x = span; y = visible(spec(div), span) || y; }
      } else if (timed(spec(div)).length) {
        var seen = span && piece(spec(div), span);
        if (seen) { x = seen[0]; y = seen[1]; }
      } else return;
      show(div, x, y);
    });
  }

  // Ranges of both axes, null for all there is.
  function show(div, x, y) {
    var next = {};
    if (x) next["xaxis.range"] = x.slice(); else next["xaxis.autorange"] = true;
    if (y) next["yaxis.range"] = y.slice(); else next["yaxis.autorange"] = true;
    div.dataset.follows = "yes";
    Plotly.relayout(div, next).then(function () { delete div.dataset.follows; });
  }

  // A figure over time shows what all of them show.
  function fit(div) {
    var own = spec(div);
    show(div, span || own.layout.xaxis.range, (span && visible(own, span)) || own.layout.yaxis.range);
  }

  function cursor(div, kind) {
    var mine = div.querySelector(".cursor");
    if (!mine) {
      mine = document.createElement("div");
      mine.className = "cursor " + kind;
      div.appendChild(mine);
    }
    return mine;
  }

  // Time t in all figures over time, and the place on the track; null for none.
  function mark(t) {
    plots.forEach(function (div) {
      if (!div.dataset.drawn || !div._fullLayout) return;
      var x = div._fullLayout.xaxis, y = div._fullLayout.yaxis, style;
      if (div.dataset.time) {
        style = cursor(div, "now").style;
        var px = t === null ? -1 : x.l2p(t);
        style.display = px >= 0 && px <= x._length ? "block" : "none";
        style.left = x._offset + px + "px";
        style.top = y._offset + "px";
        style.height = y._length + "px";
      } else {
        var track = timed(spec(div)).pop();
        if (!track) return;
        style = cursor(div, "here").style;
        if (t === null) { style.display = "none"; return; }
        var at = nearest(track, t), left = x.l2p(track.x[at]), top = y.l2p(track.y[at]);
        style.display = left >= 0 && left <= x._length && top >= 0 && top <= y._length ? "block" : "none";
        style.left = x._offset + left + "px";
        style.top = y._offset + top + "px";
      }
    });
  }

  // Time of a point on a track, or of the track's point nearest to it.
  function timeAt(panel, point) {
    if (point.customdata) return point.customdata[0];
    var track = timed(panel).pop(), best = Number.MAX_VALUE, t = null;
    track.customdata.forEach(function (at, k) {
      var d = Math.hypot(track.x[k] - point.x, track.y[k] - point.y);
      if (d < best) { best = d; t = at[0]; }
    });
    return t;
  }

  function nearest(track, t) {
    var low = 0, high = track.customdata.length - 1;
    while (high - low > 1) {
      var middle = (low + high) >> 1;
      if (track.customdata[middle][0] > t) high = middle; else low = middle;
    }
    return t - track.customdata[low][0] < track.customdata[high][0] - t ? low : high;
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

  // from little to much, and for words
  var RAMP = ["#0d084b", "#1a4687", "#1c8091", "#56b682", "#e0b020"];
  var WORDS = ["#0072b2", "#d55e00", "#009e73", "#c79000", "#8a5fb5", "#5c4630", "#6d6d6d", "#b0307a"];

  document.querySelectorAll(".menu select").forEach(function (menu) {
    menu.addEventListener("change", function () {
      var column = menu.value === "" ? -1 : +menu.value, panels = figures[menu.dataset.figure];
      var curves = [].concat.apply([], panels.map(timed));
      var values = [].concat.apply([], curves.map(function (trace) {
        return trace.customdata.map(function (at) { return at[column]; });
      })).filter(function (v) { return v !== null && v !== undefined; });
      var words = typeof values[0] === "string" ? Array.from(new Set(values)).sort() : null;
      // a few values far off, as at the start of a run, would leave one colour to all the rest
      var sorted = words ? [] : values.slice().sort(function (a, b) { return a - b; });
      var low = sorted[0], high = sorted[Math.floor(0.98 * (sorted.length - 1))];
      curves.forEach(function (trace) {
        trace.mode = column < 0 ? "lines" : "lines+markers";
        if (column < 0) { delete trace.marker; return; }
        var own = trace.customdata.map(function (at) { return at[column]; });
        trace.marker = words
          ? { size: 6, color: own.map(function (v) { return WORDS[words.indexOf(v) % WORDS.length]; }) }
          : { size: 6, color: own, cmin: low, cmax: high, showscale: false,
              colorscale: RAMP.map(function (c, k) { return [k / (RAMP.length - 1), c]; }) };
      });
      var scale = menu.closest(".menu").querySelector(".scale");
      scale.textContent = "";
      function swatch(colour, kind) {
        var i = document.createElement("i");
        i.style.background = colour;
        i.className = kind;
        scale.appendChild(i);
      }
      function say(text) { scale.appendChild(document.createTextNode(text)); }
      if (words) words.forEach(function (word, k) { swatch(WORDS[k % WORDS.length], ""); say(word); });
      else if (column >= 0) {
        say(low.toPrecision(3));
        swatch("linear-gradient(to right, " + RAMP.join(", ") + ")", "ramp");
        say(high.toPrecision(3) + " and more");
      }
      plots.forEach(function (div) {
        if (div.dataset.figure === menu.dataset.figure && div.dataset.drawn) draw(div);
      });
    });
  });

  function redraw() { plots.forEach(function (div) { if (div.dataset.drawn) draw(div); }); }

  function begin() {
    if ("IntersectionObserver" in window && !printing) {
      var watch = new IntersectionObserver(function (entries) {
        entries.forEach(function (entry) {
          if (entry.isIntersecting) { watch.unobserve(entry.target); draw(entry.target); }
        });
      }, { rootMargin: "600px 0px" });
      plots.forEach(function (div) { watch.observe(div); });
    } else {
      plots.forEach(draw);
    }
  }

  if (plots.length && typeof DecompressionStream === "undefined") {
    plots[0].textContent = "The figures need a browser of 2023 or later; the tables are complete.";
  } else if (plots.length) {
    Promise.all([unpacked("library"), unpacked("figures")]).then(function (both) {
      var library = document.createElement("script");
      library.textContent = both[0];
      document.head.appendChild(library);
      figures = JSON.parse(both[1]);
      Object.keys(figures).forEach(function (name) {
        figures[name].forEach(function (panel) {
          Object.keys(panel.samples || {}).forEach(function (k) { hide(panel.data[k], "samples", panel.samples[k]); });
        });
      });
      begin();
    });
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
    plots.forEach(function (div) { if (div.dataset.drawn) Plotly.Plots.resize(div); });
  });
})();
