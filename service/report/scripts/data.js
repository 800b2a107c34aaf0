// A valve's data as the plots draw it: the whole record thinned, the stretch sample by sample.
var stemwatchData = (function () {
  "use strict";

  var LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/", GAP = "~";

  // Steps in base64 VLQ, a run of gaps as `GAP` and its length: step_text in charts/traces.py says how.
  function unpack(packed) {
    var values = [], sum = 0, gap = false, number = 0, place = 1;
    for (var k = 0; k < packed.steps.length; k++) {
      var letter = packed.steps[k];
      if (letter === GAP) { gap = true; continue; }
      var digit = LETTERS.indexOf(letter);
      number += (digit % 32) * place;
      place *= 32;
      if (digit >= 32) continue;
      var step = number % 2 ? -(number + 1) / 2 : number / 2;
      if (!gap) values.push((sum += step) / packed.per);
      else while (step-- > 0) values.push(null);
      gap = false;
      number = 0;
      place = 1;
    }
    return values;
  }

  // What of `at` lies before, and what after, the times from `from` to `to`.
  function outside(at, from, to) {
    var before = 0, after = at.length;
    while (before < at.length && at[before] < from) before++;
    while (after > before && at[after - 1] > to) after--;
    return { before: before, after: after };
  }

  function spliced(values, cut, detail) {
    return values.slice(0, cut.before).concat(detail, values.slice(cut.after));
  }

  function each(chart, act) {
    chart.panels.forEach(function (panel) { panel.series.forEach(act); });
  }

  function traceOf(chart, role) {
    var found = null;
    each(chart, function (series) { if (series.role === role && !found) found = series; });
    return found;
  }

  function evenTimes(chart) {
    var from = (chart.start || 0) + chart.first;
    return chart.panels[0].series[0].values.map(function (_, k) { return from + k * chart.step; });
  }

  function unpackAll(chart) {
    each(chart, function (series) {
      series.values = unpack(series.values);
      if (series.detail) series.detail = unpack(series.detail);
    });
    if (!chart.loop) return;
    chart.loop.seconds = unpack(chart.loop.seconds).map(function (at) { return (chart.start || 0) + at; });
    chart.loop.op = unpack(chart.loop.op);
    chart.loop.traces.forEach(function (trace) { trace.values = unpack(trace.values); });
  }

  function spliceLoop(chart, times) {
    var loop = chart.loop;
    var cut = outside(loop.seconds, times[0], times[times.length - 1]);
    loop.seconds = spliced(loop.seconds, cut, times);
    loop.op = spliced(loop.op, cut, traceOf(chart, "op").detail);
    loop.traces.forEach(function (trace) {
      trace.values = spliced(trace.values, cut, traceOf(chart, trace.of).detail);
    });
  }

  // The samples of the stretch take the place of the thinned points that stood for them.
  function splice(chart) {
    var times = unpack(chart.detail).map(function (k) { return (chart.start || 0) + k * chart.interval; });
    var cut = outside(chart.times, times[0], times[times.length - 1]);
    chart.times = spliced(chart.times, cut, times);
    if (chart.loop) spliceLoop(chart, times);
    each(chart, function (series) { series.values = spliced(series.values, cut, series.detail); });
  }

  function read(id) {
    var chart = JSON.parse(document.getElementById(id).textContent);
    unpackAll(chart);
    chart.times = evenTimes(chart);
    chart.ends = [chart.start || 0, (chart.start || 0) + chart.duration];
    if (chart.detail) splice(chart);
    return chart;
  }

  // What the plots open on, in the times of the x axes; null is the whole record.
  function opening(chart) {
    var start = chart.start || 0;
    return chart.stretch ? [start + chart.stretch.from, start + chart.stretch.to] : null;
  }

  return { read: read, opening: opening };
})();
