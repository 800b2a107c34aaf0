// Signals over time: what is in sight is fetched thinned, and fetched again when the sight changes.
var stemwatchSignals = (function () {
  "use strict";
  var HEIGHTS = { travel: 240, process: 170 };
  var PANELS = { travel: ["op", "mv"], process: ["pv", "sp"] };
  var STYLES = { op: { width: 1.25 }, mv: { width: 1.75 }, pv: { width: 1.5 }, sp: { width: 1.25, dash: [6, 4] } };
  var DRAG_PX = 8;
  var RETAIN = 1; // uPlot.join: a null stays one, and what joining leaves open is undefined

  function shown(u, value) { return value == null ? "" : String(+value.toPrecision(5)); }

  function line(trace) {
    var style = STYLES[trace.role];
    return {
      label: trace.label + (trace.unit ? ", " + trace.unit : ""), stroke: stemwatchAxes.colour("trace-" + trace.role),
      width: style.width, dash: style.dash, points: { show: false }, value: shown, spanGaps: false
    };
  }

  // Tags need not be sampled at the same instants: their times are joined, and only a null of the
  // answer itself breaks a line.
  function joined(traces) {
    var tables = traces.map(function (trace) { return [trace.at_s, trace.values]; });
    return tables.length === 1 ? tables[0] : uPlot.join(tables, tables.map(function () { return [0, RETAIN]; }));
  }

  function draw(place, name, answer, last, sync, zoomed) {
    var traces = answer.traces.filter(function (trace) { return PANELS[name].indexOf(trace.role) >= 0; });
    place.closest("figure").hidden = !traces.length;
    if (!traces.length) return null;
    var options = {
      width: place.clientWidth, height: HEIGHTS[name], padding: [8, 30, 0, 0], tzDate: stemwatchAxes.tzDate,
      scales: { x: { time: true, range: function () { return [answer.start_s, answer.stop_s]; } } },
      cursor: { sync: { key: sync }, drag: { x: true, y: false, setScale: false }, points: { size: 6 } },
      axes: [stemwatchAxes.time(true, last), stemwatchAxes.axis({ size: 52 })],
      series: [{ value: stemwatchAxes.moment(true) }].concat(traces.map(line)),
      legend: { show: true, live: true },
      hooks: { setSelect: [function (u) {
        if (u.select.width < DRAG_PX) return;
        var from = u.posToVal(u.select.left, "x"), to = u.posToVal(u.select.left + u.select.width, "x");
        u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
        zoomed(from, to);
      }] }
    };
    if (last) options.height += 38;
    return new uPlot(options, joined(traces), place);
  }

  return { draw: draw };
})();
