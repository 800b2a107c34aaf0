// The recorded command and position, and the free runs of the models over them.
(function () {
  "use strict";
  var data = JSON.parse(document.getElementById("data").textContent);
  var place = document.getElementById("plot");
  var dark = window.matchMedia("(prefers-color-scheme: dark)");
  var COLOURS = ["#e5484d", "#2f83d6", "#30a46c", "#f76b15", "#8e4ec6", "#12a594", "#d6409f", "#ad7f58"];
  var times = data.traces[0].values.map(function (_, k) { return data.first + k * data.step; });
  var shown = data.traces.map(function (trace) { return trace.shown; });
  var plot = null;

  function style(name) { return getComputedStyle(document.documentElement).getPropertyValue(name).trim(); }

  function colour(k) { return k === 0 ? style("--quiet") : k === 1 ? style("--ink") : COLOURS[(k - 2) % COLOURS.length]; }

  function series(trace, k) {
    return {
      label: trace.label, show: shown[k], stroke: colour(k), width: k === 1 ? 1.75 : 1.25,
      dash: k < 10 ? undefined : [5, 3], points: { show: false },
      value: function (u, at) { return at == null ? "" : String(+at.toPrecision(4)); }
    };
  }

  function shade(u) {
    var from = Math.max(u.valToPos(data.heldout, "x", true), u.bbox.left);
    var right = u.bbox.left + u.bbox.width;
    if (from >= right) return;
    u.ctx.save();
    u.ctx.fillStyle = style("--held");
    u.ctx.fillRect(from, u.bbox.top, right - from, u.bbox.height);
    u.ctx.restore();
  }

  function draw() {
    if (plot) plot.destroy();
    var axis = { stroke: style("--quiet"), grid: { stroke: style("--line"), width: 1 }, ticks: { stroke: style("--line") } };
    plot = new uPlot({
      width: place.clientWidth, height: 380, scales: { x: { time: false } },
      axes: [Object.assign({ label: "Time since the first sample, s" }, axis), Object.assign({ label: "%" }, axis)],
      series: [{ label: "s" }].concat(data.traces.map(series)),
      hooks: {
        drawClear: [shade],
        setSeries: [function (u, index, options) { if (index && options.show != null) shown[index - 1] = options.show; }]
      }
    }, [times].concat(data.traces.map(function (trace) { return trace.values; })), place);
  }

  draw();
  dark.addEventListener("change", draw);
  window.addEventListener("resize", function () { plot.setSize({ width: place.clientWidth, height: 380 }); });
})();
