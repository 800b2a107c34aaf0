// The stem against the controller output: the picture in which a sticking valve is recognised.
var stemwatchLoop = (function () {
  "use strict";
  var HEIGHT = 420, PRINT_HEIGHT = 212;
  // Beyond three stretches the lines of a loop cover one another, and lines between thinned samples
  // of a record without a stretch follow no path of the stem; points say more.
  var MOST_STRETCHES_AS_LINES = 3, MOST_POINTS_AS_LINES = 1600, MOST_MARKED = 500;

  var ROOM_X = 62 + 8, ROOM_Y = 46 + 8;  // of the axes with their labels, and the padding

  var DASH = [7, 4];

  function outline(u, index, ratio, mark) {
    var xs = u.data[index][0], ys = u.data[index][1], open = false;
    for (var k = 0; k < xs.length; k++) {
      if (xs[k] === null || ys[k] === null) { open = false; continue; }
      mark(u.valToPos(xs[k], "x", true), u.valToPos(ys[k], "y", true), open);
      open = true;
    }
  }

  function dots(u, index, ratio, radius) {
    var ctx = u.ctx, r = radius * ratio;
    ctx.beginPath();
    outline(u, index, ratio, function (x, y) { ctx.rect(x - r, y - r, 2 * r, 2 * r); });
    ctx.fill();
  }

  function line(u, index, ratio, width, dash) {
    var ctx = u.ctx;
    ctx.beginPath();
    outline(u, index, ratio, function (x, y, open) { if (open) ctx.lineTo(x, y); else ctx.moveTo(x, y); });
    ctx.lineWidth = width * ratio;
    ctx.lineJoin = "round";
    ctx.setLineDash(dash.map(function (part) { return part * ratio; }));
    ctx.stroke();
  }

  // Close by: the recorded loop as a line with its samples, the fitted one dashed over it.
  // From afar: the thinned samples of both as points, since lines between them would cross the loop.
  function path(recorded, isNear) {
    return function (u, index) {
      var ctx = u.ctx, ratio = uPlot.pxRatio, near = isNear();
      var stroke = u.series[index].stroke;
      ctx.save();
      ctx.beginPath();
      ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
      ctx.clip();
      ctx.strokeStyle = ctx.fillStyle = typeof stroke === "function" ? stroke(u, index) : stroke;
      ctx.globalAlpha = near || recorded ? 0.9 : 0.6;
      if (near) line(u, index, ratio, recorded ? 1.25 : 2, recorded ? [] : DASH);
      if (!near || recorded && u.data[index][0].length <= MOST_MARKED) dots(u, index, ratio, near ? 1.9 : 1.3);
      ctx.restore();
      return null;
    };
  }

  // Behind the loop: the stick band as an area, the curve from OP to stroke as a line through it.
  var CURVE_DASH = [2, 3];
  function behind(shape) {
    return function (u, index) {
      var ctx = u.ctx, ratio = uPlot.pxRatio, stroke = u.series[index].stroke;
      ctx.save();
      ctx.beginPath();
      ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
      ctx.clip();
      ctx.strokeStyle = ctx.fillStyle = typeof stroke === "function" ? stroke(u, index) : stroke;
      if (shape.role === "band") {
        ctx.globalAlpha = 0.35;
        ctx.beginPath();
        outline(u, index, ratio, function (x, y, open) { if (open) ctx.lineTo(x, y); else ctx.moveTo(x, y); });
        ctx.closePath();
        ctx.fill();
      } else line(u, index, ratio, 1.75, CURVE_DASH);
      ctx.restore();
      return null;
    };
  }

  function ends(lists) {
    var low = Infinity, high = -Infinity;
    lists.forEach(function (values) {
      values.forEach(function (value) {
        if (value === null) return;
        if (value < low) low = value;
        if (value > high) high = value;
      });
    });
    var room = (high - low || 1) * 0.06;
    return low <= high ? [low - room, high + room] : [0, 100];
  }

  // What lies behind the loop reaches over the whole record and must not squeeze what is looked at.
  // With one unit on both axes a percent is as long on either, so that a slope of 1 looks like one.
  function facet(which, count, alike) {
    function of(u, axis) { return ends(u.data.slice(-count).map(function (pair) { return pair[axis]; })); }
    return function (u) {
      var own = of(u, which);
      if (!alike) return own;
      var other = of(u, 1 - which);
      var size = [u.width - ROOM_X, u.height - ROOM_Y];
      var needed = (other[1] - other[0]) * size[which] / size[1 - which];
      var missing = needed - (own[1] - own[0]);
      return missing > 0 ? [own[0] - missing / 2, own[1] + missing / 2] : own;
    };
  }

  function isRecorded(trace) { return trace.role === "recorded"; }

  function isClose(chart, from, to, count) {
    if (count > MOST_POINTS_AS_LINES || !chart.stretch && chart.thinned > 1) return false;
    var whole = chart.ends[1] - chart.ends[0];
    var stretch = chart.stretch ? chart.stretch.to - chart.stretch.from : whole;
    return to - from <= MOST_STRETCHES_AS_LINES * stretch;
  }

  function draw(chart, place, width, printing) {
    var close = false;
    var traces = chart.loop.traces, shapes = chart.loop.shapes || [];
    var alike = /^MV, %$/.test(chart.loop.y);

    function shown(from, to) {
      var loop = chart.loop;
      var inside = loop.seconds.map(function (at) { return at >= from && at <= to; });
      var keep = function (values) { return values.filter(function (_, k) { return inside[k]; }); };
      var op = keep(loop.op);
      close = isClose(chart, from, to, op.length);
      return [null].concat(shapes.map(function (shape) { return [shape.op, shape.values]; }), traces.map(function (trace) { return [op, keep(trace.values)]; }));
    }

    function mark(u, k) {
      if (k <= shapes.length) return shapes[k - 1].role === "band" ? "solid" : "dotted";
      return isRecorded(traces[k - 1 - shapes.length]) ? "solid" : "dashed";
    }

    var plot = new uPlot({
      mode: 2, width: width, height: printing ? PRINT_HEIGHT : Math.min(HEIGHT, width), padding: [8, 8, 0, 0],
      cursor: { show: false },
      scales: { x: { time: false, range: facet(0, traces.length, alike) }, y: { range: facet(1, traces.length, alike) } },
      axes: [
        stemwatchAxes.axis({ label: chart.loop.x, labelSize: 18, size: 28, space: 50 }),
        stemwatchAxes.axis({ label: chart.loop.y, labelSize: 18, size: 44, space: 34 })
      ],
      series: [{}].concat(shapes.map(function (shape) {
        return {
          label: shape.label, stroke: stemwatchAxes.colour("trace-" + shape.role), width: 2, dash: CURVE_DASH,
          paths: behind(shape), facets: [{ scale: "x", auto: false }, { scale: "y", auto: false }]
        };
      }), traces.map(function (trace) {
        return {
          label: trace.label, stroke: stemwatchAxes.colour("trace-" + trace.of), width: 2,
          dash: isRecorded(trace) ? undefined : DASH,
          paths: path(isRecorded(trace), function () { return close; }),
          facets: [{ scale: "x", auto: true }, { scale: "y", auto: true }]
        };
      })),
      legend: { show: true, live: false, markers: { dash: mark } }
    }, shown(chart.ends[0], chart.ends[1]), place);

    return {
      show: function (from, to) { plot.setData(shown(from, to)); },
      destroy: function () { plot.destroy(); }
    };
  }

  return { draw: draw };
})();
