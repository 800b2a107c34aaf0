// The two kinds of chart: signals over time, and the stem against the controller output.
var stemwatchCharts = (function () {
  "use strict";
  var HEIGHTS = { travel: 240, process: 150, residual: 150 };
  var LOWEST_EXTRA = 38; // the date and the zone below the lowest plot
  var PRINT_HEIGHTS = { travel: 200, process: 118, residual: 118 };
  var STYLES = {
    op: { width: 1.25 }, mv: { width: 1.75 }, stiction: { width: 1.5, dash: [6, 3] },
    narx: { width: 1.25, dash: [2, 3] }, pv: { width: 1.5 }, sp: { width: 1.25, dash: [6, 4] }
  };
  // Where the residual panel draws a model alone, a solid line reads better than a dashed one.
  function dash(panel, role) { return panel.id === "residual" ? undefined : STYLES[role].dash; }

  function times(chart) {
    var count = chart.panels[0].series[0].values.length;
    var from = (chart.start || 0) + chart.first;
    return Array.from({ length: count }, function (_, k) { return from + k * chart.step; });
  }

  function shadeHeldOut(chart) {
    return function (u) {
      if (chart.heldout === null) return;
      var from = u.valToPos((chart.start || 0) + chart.heldout, "x", true);
      var left = Math.max(from, u.bbox.left), right = u.bbox.left + u.bbox.width;
      if (left >= right) return;
      var ctx = u.ctx, ratio = uPlot.pxRatio;
      ctx.save();
      ctx.fillStyle = stemwatchAxes.colour("heldout");
      ctx.fillRect(left, u.bbox.top, right - left, u.bbox.height);
      ctx.fillStyle = stemwatchAxes.colour("quiet");
      ctx.font = 11 * ratio + "px " + getComputedStyle(document.body).fontFamily;
      ctx.textAlign = "left";
      ctx.textBaseline = "top";
      if (right - left > 60 * ratio) ctx.fillText("held out", left + 5 * ratio, u.bbox.top + 4 * ratio);
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
      width: width, height: (printing ? PRINT_HEIGHTS : HEIGHTS)[panel.id] + (last ? LOWEST_EXTRA : 0), padding: [8, 8, 0, 0],
      tzDate: stemwatchAxes.tzDate,
      scales: { x: { time: known } },
      cursor: { sync: { key: "" }, drag: { x: true, y: false, uni: 20 }, points: { size: 6 } },
      axes: [stemwatchAxes.time(known, last), stemwatchAxes.axis({ size: 52 })],
      series: [{ value: stemwatchAxes.moment(known) }].concat(panel.series.map(line.bind(null, panel))),
      legend: { show: true, live: true },
      hooks: { drawClear: [shadeHeldOut(chart)], setScale: [onZoom] }
    };
  }

  // Paths of a mode 2 series: dots for what was recorded, a line for what was simulated.
  function path(dots) {
    return function (u, index) {
      var xs = u.data[index][0], ys = u.data[index][1];
      var ctx = u.ctx, ratio = uPlot.pxRatio, half = 1.3 * ratio, open = false;
      ctx.save();
      ctx.beginPath();
      ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
      ctx.clip();
      ctx.beginPath();
      for (var k = 0; k < xs.length; k++) {
        if (xs[k] === null || ys[k] === null) { open = false; continue; }
        var x = u.valToPos(xs[k], "x", true), y = u.valToPos(ys[k], "y", true);
        if (dots) ctx.rect(x - half, y - half, 2 * half, 2 * half);
        else if (open) ctx.lineTo(x, y);
        else ctx.moveTo(x, y);
        open = true;
      }
      var stroke = u.series[index].stroke;
      ctx.globalAlpha = dots ? 0.8 : 1;
      ctx[dots ? "fillStyle" : "strokeStyle"] = typeof stroke === "function" ? stroke(u, index) : stroke;
      ctx.lineWidth = 1.25 * ratio;
      ctx.lineJoin = "round";
      if (dots) ctx.fill(); else ctx.stroke();
      ctx.restore();
      return null;
    };
  }

  function reach(values) {
    var known = values.filter(function (value) { return value !== null; });
    var low = Math.min.apply(null, known), high = Math.max.apply(null, known);
    var room = (high - low || 1) * 0.05;
    return known.length ? [low - room, high + room] : [0, 100];
  }

  // Recorded points last, so that they lie on the fitted loop and not under it.
  function inOrder(loop) { return loop.traces.slice().reverse(); }

  // The loop of the samples between two times; the whole record without them.
  function loopData(chart, from, to) {
    var loop = chart.loop, start = chart.start || 0;
    var inside = loop.seconds.map(function (at) {
      return from === undefined || (start + at >= from && start + at <= to);
    });
    var keep = function (values) { return values.filter(function (_, k) { return inside[k]; }); };
    var op = keep(loop.op);
    return [null].concat(inOrder(loop).map(function (trace) { return [op, keep(trace.values)]; }));
  }

  function overOp(chart, width, printing) {
    var loop = chart.loop;
    var all = loop.traces.reduce(function (sum, trace) { return sum.concat(trace.values); }, []);
    var fixed = function (values) { var ends = reach(values); return function () { return ends; }; };
    return {
      mode: 2, width: width, height: printing ? 264 : 360, padding: [8, 8, 0, 0],
      cursor: { show: false },
      scales: { x: { time: false, range: fixed(loop.op) }, y: { range: fixed(all) } },
      axes: [
        stemwatchAxes.axis({ label: loop.x, labelSize: 18, size: 28, space: 50 }),
        stemwatchAxes.axis({ label: loop.y, labelSize: 18, size: 44, space: 34 })
      ],
      series: [{}].concat(inOrder(loop).map(function (trace) {
        var recorded = trace.role === "recorded";
        return {
          label: trace.label, stroke: stemwatchAxes.colour(recorded ? "trace-mv" : "trace-stiction"),
          paths: path(recorded), facets: [{ scale: "x", auto: true }, { scale: "y", auto: true }]
        };
      })),
      legend: { show: true, live: false }
    };
  }

  return { times: times, overTime: overTime, overOp: overOp, loopData: loopData };
})();
