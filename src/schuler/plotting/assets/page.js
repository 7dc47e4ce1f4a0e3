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
