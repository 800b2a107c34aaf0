// Signals over time: the panels of one valve, one above the other.
var stemwatchCharts = (function () {
  "use strict";
  var HEIGHTS = { travel: 240, process: 150, residual: 150 };
  var LOWEST_EXTRA = 38; // the date and the zone below the lowest plot
  var PRINT_HEIGHTS = { travel: 128, process: 86, residual: 86 };
  var STYLES = {
    op: { width: 1.25 }, mv: { width: 1.75 }, stiction: { width: 1.5, dash: [6, 3] },
    narx: { width: 1.25, dash: [2, 3] }, naive: { width: 1.5, dash: [7, 3] }, extended: { width: 1.75, dash: [3, 4] },
    pv: { width: 1.5 }, sp: { width: 1.25, dash: [6, 4] }
  };
  // Where the residual panel draws a model alone, a solid line reads better than a dashed one.
  function dash(panel, role) { return panel.id === "residual" ? undefined : STYLES[role].dash; }

  // The held-out part of the plot `u`, in device pixels; null where none of it is in sight.
  function heldOut(chart, u) {
    if (chart.heldout === null) return null;
    var from = u.valToPos((chart.start || 0) + chart.heldout, "x", true);
    var left = Math.max(from, u.bbox.left), width = u.bbox.left + u.bbox.width - left;
    return width > 0 ? { left: left, width: width } : null;
  }

  function shadeHeldOut(chart) {
    return function (u) {
      var part = heldOut(chart, u);
      if (!part) return;
      u.ctx.save();
      u.ctx.fillStyle = stemwatchAxes.colour("heldout");
      u.ctx.fillRect(part.left, u.bbox.top, part.width, u.bbox.height);
      u.ctx.restore();
    };
  }

  // Drawn after the grid, on a patch of the surface, so that no line goes through the words.
  function nameHeldOut(chart) {
    return function (u) {
      var part = heldOut(chart, u), ctx = u.ctx, ratio = uPlot.pxRatio;
      if (!part || part.width < 60 * ratio) return;
      ctx.save();
      ctx.font = 11 * ratio + "px " + getComputedStyle(document.body).fontFamily;
      ctx.textAlign = "left";
      ctx.textBaseline = "top";
      var patch = [part.left + 1, u.bbox.top + 1, ctx.measureText("held out").width + 8 * ratio, 17 * ratio];
      ["surface", "heldout"].forEach(function (name) {
        ctx.fillStyle = stemwatchAxes.colour(name);
        ctx.fillRect.apply(ctx, patch);
      });
      ctx.fillStyle = stemwatchAxes.colour("quiet");
      ctx.fillText("held out", part.left + 5 * ratio, u.bbox.top + 4 * ratio);
      ctx.restore();
    };
  }

  function shown(u, value) { return value == null ? "" : String(+value.toPrecision(4)); }

  function line(panel, series) {
    return {
      label: series.label, stroke: stemwatchAxes.colour("trace-" + series.role),
      width: STYLES[series.role].width, dash: dash(panel, series.role),
      points: { show: false }, value: shown, spanGaps: false
    };
  }

  function overTime(chart, panel, last, width, printing, onZoom) {
    var known = chart.start !== null;
    return {
      width: width, height: (printing ? PRINT_HEIGHTS : HEIGHTS)[panel.id] + (last ? LOWEST_EXTRA : 0), padding: [8, 20, 0, 0],
      tzDate: stemwatchAxes.tzDate,
      scales: { x: { time: known } },
      cursor: { sync: { key: "" }, drag: { x: true, y: false, uni: 20 }, points: { size: 6 } },
      axes: [stemwatchAxes.time(known, last), stemwatchAxes.axis({ size: 52 })],
      series: [{ value: stemwatchAxes.moment(known) }].concat(panel.series.map(line.bind(null, panel))),
      legend: { show: true, live: true },
      hooks: { drawClear: [shadeHeldOut(chart)], drawAxes: [nameHeldOut(chart)], setScale: [onZoom] }
    };
  }

  return { overTime: overTime, shadeHeldOut: shadeHeldOut };
})();
