// When plots are drawn: on coming near the screen, all of them before printing, again in a new theme.
(function () {
  "use strict";
  var PRINT_WIDTHS = { overview: 690, travel: 690, process: 410, residual: 410, loop: 266 };
  var boxes = Array.prototype.slice.call(document.querySelectorAll("[data-plots]"));
  var drawn = new Map();
  var printing = false;

  function read(box) {
    var chart = stemwatchData.read(box.dataset.plots);
    var range = stemwatchData.opening(chart) || chart.ends;
    return { box: box, chart: chart, plots: [], loop: null, overview: null, range: range };
  }

  function draw(box) {
    var set = drawn.get(box) || read(box);
    erase(set);
    drawn.set(box, set);
    // Nothing may follow a zoom until all plots of the valve stand.
    set.settling = true;
    set.overview = overview(set);
    set.chart.panels.forEach(function (panel, k) { set.plots.push(overTime(set, panel, k)); });
    if (set.chart.loop) set.loop = stemwatchLoop.draw(set.chart, place(set, "loop"), width(set, "loop"), printing);
    zoom(set, set.range[0], set.range[1]);
  }

  function erase(set) {
    set.plots.concat(set.loop || [], set.overview || []).forEach(function (plot) { plot.destroy(); });
    set.plots = [];
    set.loop = set.overview = null;
  }

  function place(set, name) { return set.box.querySelector(".plot-" + name); }

  // Beside a loop the lower plots are narrow on paper; an overlay has none.
  function printWidth(set, name) { return set.chart.loop ? PRINT_WIDTHS[name] : PRINT_WIDTHS.travel; }

  function width(set, name) { return printing ? printWidth(set, name) : place(set, name).clientWidth; }

  function overview(set) {
    var shade = stemwatchCharts.shadeHeldOut(set.chart);
    var moved = function (from, to) { zoom(set, from, to); };
    return stemwatchOverview.draw(set.chart, place(set, "overview"), width(set, "overview"), printing, set.box.dataset.tag, shade, moved);
  }

  function overTime(set, panel, k) {
    var last = k === set.chart.panels.length - 1;
    var options = stemwatchCharts.overTime(set.chart, panel, last, width(set, panel.id), printing, function (u, scale) {
      if (scale === "x" && !set.settling) follow(set, u.scales.x.min, u.scales.x.max);
    });
    options.cursor.sync.key = set.box.dataset.plots;
    var values = panel.series.map(function (series) { return series.values; });
    return new uPlot(options, [set.chart.times].concat(values), place(set, panel.id));
  }

  // One plot was zoomed: the others of the valve follow, and the loop shows the same samples.
  function follow(set, from, to) {
    if (set.settling || from == null) return;
    set.settling = true;
    set.range = [from, to];
    set.plots.forEach(function (plot) {
      if (plot.scales.x.min !== from || plot.scales.x.max !== to) plot.setScale("x", { min: from, max: to });
    });
    if (set.loop) set.loop.show(from, to);
    var said = stemwatchAxes.between(set.chart.start !== null, set.chart.ends, from, to);
    set.overview.show(from, to, said);
    tell(set, said);
    // uPlot commits scales in a microtask, so that the echo of the others comes after this call.
    queueMicrotask(function () { queueMicrotask(function () { set.settling = false; }); });
  }

  function tell(set, said) {
    var opening = stemwatchData.opening(set.chart), range = set.range, ends = set.chart.ends;
    var typical = opening && range[0] === opening[0] && range[1] === opening[1];
    var whole = range[0] <= ends[0] && range[1] >= ends[1];
    var name = typical ? set.chart.stretch.name + ": " : whole ? "The whole record: " : "Shown: ";
    set.box.querySelector(".view b").textContent = name + said + (whole ? "" : " of " + set.box.dataset.duration.replace(/ /g, "\u00a0"));
    var why = set.box.querySelector(".view span");
    if (why) why.hidden = !typical;
    set.box.querySelectorAll("[data-zoom=typical], [data-zoom=all]").forEach(function (button) {
      button.setAttribute("aria-pressed", button.dataset.zoom === "all" ? whole : Boolean(typical));
    });
  }

  function zoom(set, from, to) { set.settling = false; follow(set, from, to); }

  function step(set, how) {
    var first = set.chart.ends[0], last = set.chart.ends[1];
    var opening = stemwatchData.opening(set.chart);
    if (how === "all") return zoom(set, first, last);
    if (how === "typical") return zoom(set, opening[0], opening[1]);
    var span = set.range[1] - set.range[0], middle = (set.range[0] + set.range[1]) / 2;
    if (how === "in") span = Math.max(span / 2, 4 * set.chart.interval);
    if (how === "out") span = Math.min(span * 2, last - first);
    if (how === "earlier") middle -= span / 2;
    if (how === "later") middle += span / 2;
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
