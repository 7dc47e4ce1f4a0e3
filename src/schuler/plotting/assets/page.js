(function () {
  "use strict";
  var figures = JSON.parse(document.getElementById("figures").textContent);
  var plots = Array.prototype.slice.call(document.querySelectorAll(".plot"));
  // where nothing hovers, dragging has to scroll the page and not zoom a plot
  var touch = !window.matchMedia("(hover: hover) and (pointer: fine)").matches;
  var printing = false;
  // what all time axes show, null for all of it
  var span = null;

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
    if (typeof Plotly === "undefined") return;
    var d = dressed(div), first = !div.dataset.drawn;
    div.dataset.drawn = "yes";
    if (!first) { Plotly.react(div, d.data, d.layout); return; }
    Plotly.newPlot(div, d.data, d.layout, {
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
  }

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
        if (span) { x = span; y = visible(spec(div), span) || y; }
      } else if (timed(spec(div)).length) {
        var seen = span && piece(spec(div), span);
        if (seen) { x = seen[0]; y = seen[1]; }
      } else return;
      var next = {};
      if (x) next["xaxis.range"] = x.slice(); else next["xaxis.autorange"] = true;
      if (y) next["yaxis.range"] = y.slice(); else next["yaxis.autorange"] = true;
      div.dataset.follows = "yes";
      Plotly.relayout(div, next).then(function () { delete div.dataset.follows; });
    });
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
