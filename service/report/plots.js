// When plots are drawn: on coming near the screen, all of them before printing, again in a new theme.
(function () {
  "use strict";
  var PRINT_WIDTHS = { travel: 690, process: 410, residual: 410, loop: 266 };
  var boxes = Array.prototype.slice.call(document.querySelectorAll("[data-plots]"));
  var drawn = new Map();
  var printing = false;

  function unpack(packed) {
    var sum = 0;
    return packed.steps.map(function (step) { return step === null ? null : (sum += step) / packed.per; });
  }

  function data(box) {
    var chart = JSON.parse(document.getElementById(box.dataset.plots).textContent);
    chart.panels.forEach(function (panel) {
      panel.series.forEach(function (series) { series.values = unpack(series.values); });
    });
    if (chart.loop) {
      chart.loop.seconds = unpack(chart.loop.seconds);
      chart.loop.op = unpack(chart.loop.op);
      chart.loop.traces.forEach(function (trace) { trace.values = unpack(trace.values); });
    }
    return chart;
  }

  function draw(box) {
    var before = drawn.get(box);
    var set = before || { chart: data(box), times: null, plots: [], loop: null, range: null };
    set.times = set.times || stemwatchCharts.times(set.chart);
    erase(set);
    drawn.set(box, set);
    // Nothing may follow a zoom until all plots of the valve stand.
    set.settling = true;
    set.chart.panels.forEach(function (panel, k) { set.plots.push(overTime(box, set, panel, k)); });
    if (set.chart.loop) set.loop = overOp(box, set);
    set.settling = false;
    if (set.range) zoom(set, set.range[0], set.range[1]);
  }

  function erase(set) {
    set.plots.forEach(function (plot) { plot.destroy(); });
    if (set.loop) set.loop.destroy();
    set.plots = [];
    set.loop = null;
  }

  function overTime(box, set, panel, k) {
    var place = box.querySelector(".plot-" + panel.id);
    var width = printing ? PRINT_WIDTHS[panel.id] : place.clientWidth;
    var last = k === set.chart.panels.length - 1;
    var options = stemwatchCharts.overTime(set.chart, panel, last, width, printing, function (u, scale) {
      if (scale === "x" && !set.settling) follow(set, u.scales.x.min, u.scales.x.max);
    });
    options.cursor.sync.key = box.dataset.plots;
    var values = panel.series.map(function (series) { return series.values; });
    return new uPlot(options, [set.times].concat(values), place);
  }

  function overOp(box, set) {
    var place = box.querySelector(".plot-loop");
    var width = printing ? PRINT_WIDTHS.loop : place.clientWidth;
    return new uPlot(stemwatchCharts.overOp(set.chart, width, printing), stemwatchCharts.loopData(set.chart), place);
  }

  // One plot was zoomed: the others of the valve follow, and the loop shows the same samples.
  function follow(set, from, to) {
    if (set.settling || from == null) return;
    set.settling = true;
    set.range = [from, to];
    set.plots.forEach(function (plot) {
      if (plot.scales.x.min !== from || plot.scales.x.max !== to) plot.setScale("x", { min: from, max: to });
    });
    if (set.loop) set.loop.setData(stemwatchCharts.loopData(set.chart, from, to));
    // uPlot commits scales in a microtask, so that the echo of the others comes after this call.
    queueMicrotask(function () { queueMicrotask(function () { set.settling = false; }); });
  }

  function zoom(set, from, to) { set.settling = false; follow(set, from, to); }

  function step(set, how) {
    var first = set.times[0], last = set.times[set.times.length - 1];
    var from = set.range ? set.range[0] : first, to = set.range ? set.range[1] : last;
    var span = to - from, middle = (from + to) / 2;
    if (how === "in") span = Math.max(span / 2, 4 * set.chart.step);
    if (how === "out") span = Math.min(span * 2, last - first);
    if (how === "earlier") middle -= span / 2;
    if (how === "later") middle += span / 2;
    if (how === "all") { span = last - first; middle = (first + last) / 2; }
    middle = Math.min(Math.max(middle, first + span / 2), last - span / 2);
    zoom(set, middle - span / 2, middle + span / 2);
  }

  function redrawAll() { drawn.forEach(function (_, box) { draw(box); }); }

  var near = new IntersectionObserver(function (entries) {
    entries.forEach(function (entry) {
      if (!entry.isIntersecting) return;
      near.unobserve(entry.target);
      if (!drawn.has(entry.target)) draw(entry.target);
    });
  }, { rootMargin: "400px 0px" });

  boxes.forEach(function (box) {
    near.observe(box);
    box.querySelector(".toolbar").addEventListener("click", function (event) {
      var how = event.target.dataset.zoom;
      if (!how) return;
      if (!drawn.has(box)) draw(box);
      step(drawn.get(box), how);
    });
  });

  document.addEventListener("themechange", redrawAll);

  var pending = 0, lastWidth = window.innerWidth;
  window.addEventListener("resize", function () {
    // A phone fires resize when its address bar slides away; only the width matters.
    if (printing || window.innerWidth === lastWidth) return;
    lastWidth = window.innerWidth;
    clearTimeout(pending);
    pending = setTimeout(redrawAll, 150);
  });

  var theme;
  window.addEventListener("beforeprint", function () {
    printing = true;
    theme = document.documentElement.dataset.theme;
    document.documentElement.dataset.theme = "light";
    boxes.forEach(function (box) {
      if (!box.closest("[hidden]")) draw(box);
    });
  });
  window.addEventListener("afterprint", function () {
    printing = false;
    document.documentElement.dataset.theme = theme;
    redrawAll();
  });
})();
