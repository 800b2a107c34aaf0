// A thin strip of the whole record with a lens on it: where one is, and a handle to go elsewhere.
var stemwatchOverview = (function () {
  "use strict";
  var HEIGHT = 62, PRINT_HEIGHT = 44, NARROWEST_LENS = 8;
  var KEYS = { ArrowLeft: -0.25, ArrowRight: 0.25, ArrowDown: -0.25, ArrowUp: 0.25, PageDown: -1, PageUp: 1 };

  function strip(chart, place, width, printing, onDraw) {
    var known = chart.start !== null;
    var traces = chart.panels[0].series.filter(function (series) { return series.role === "op" || series.role === "mv"; });
    return new uPlot({
      width: width, height: printing ? PRINT_HEIGHT : HEIGHT, padding: [4, 20, 0, 20],
      tzDate: stemwatchAxes.tzDate,
      scales: { x: { time: known, range: function () { return chart.ends; } } },
      cursor: { show: false },
      axes: [stemwatchAxes.time(known, false), { show: false }],
      series: [{}].concat(traces.map(function (series) {
        return { stroke: stemwatchAxes.colour("trace-" + series.role), width: 0.75, points: { show: false } };
      })),
      legend: { show: false },
      hooks: { drawClear: [onDraw] }
    }, [chart.times].concat(traces.map(function (series) { return series.values; })), place);
  }

  function handle(over, tag) {
    var lens = document.createElement("div");
    lens.className = "lens";
    lens.tabIndex = 0;
    lens.setAttribute("role", "slider");
    lens.setAttribute("aria-label", "Shown part of the record of " + tag);
    lens.setAttribute("aria-valuemin", "0");
    lens.setAttribute("aria-valuemax", "100");
    over.appendChild(lens);
    return lens;
  }

  // `moved(from, to)` is called while the lens is dragged or moved by a key.
  function draw(chart, place, width, printing, tag, shade, moved) {
    var plot = strip(chart, place, width, printing, shade);
    var lens = handle(plot.over, tag), view = chart.ends.slice(), grab = null;

    function move(from) {
      var span = view[1] - view[0];
      from = Math.min(Math.max(from, chart.ends[0]), chart.ends[1] - span);
      moved(from, from + span);
    }

    function under(event) {
      return plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x");
    }

    plot.over.addEventListener("pointerdown", function (event) {
      if (event.button !== 0) return;
      var at = under(event), held = event.target === lens;
      grab = held ? at - view[0] : (view[1] - view[0]) / 2;
      plot.over.setPointerCapture(event.pointerId);
      if (!held) move(at - grab);
    });
    plot.over.addEventListener("pointermove", function (event) { if (grab !== null) move(under(event) - grab); });
    ["pointerup", "pointercancel", "lostpointercapture"].forEach(function (name) {
      plot.over.addEventListener(name, function () { grab = null; });
    });
    lens.addEventListener("keydown", function (event) {
      var span = view[1] - view[0];
      if (event.key === "Home") move(chart.ends[0]);
      else if (event.key === "End") move(chart.ends[1] - span);
      else if (KEYS[event.key]) move(view[0] + KEYS[event.key] * span);
      else return;
      event.preventDefault();
    });

    function show(from, to, said) {
      view = [from, to];
      // The strip always spans the record, so that shares of it need no drawn scale.
      var whole = chart.ends[1] - chart.ends[0] || 1;
      lens.style.left = "min(" + 100 * (from - chart.ends[0]) / whole + "%, 100% - " + NARROWEST_LENS + "px)";
      lens.style.width = "max(" + 100 * (to - from) / whole + "%, " + NARROWEST_LENS + "px)";
      var free = chart.ends[1] - chart.ends[0] - (to - from);
      lens.setAttribute("aria-valuenow", free > 0 ? Math.round(100 * (from - chart.ends[0]) / free) : 0);
      lens.setAttribute("aria-valuetext", said);
    }

    return { show: show, destroy: function () { plot.destroy(); } };
  }

  return { draw: draw };
})();
