// How the axes read: times in the plant's zone, 24 hours, the date where it changes.
var stemwatchAxes = (function () {
  "use strict";
  var zone = document.body.dataset.zone;

  function inZone(seconds) { return uPlot.tzDate(new Date(seconds * 1e3), zone); }

  var day = uPlot.fmtDate("{YYYY}-{MM}-{DD}");
  var minute = uPlot.fmtDate("{HH}:{mm}");
  var second = uPlot.fmtDate("{HH}:{mm}:{ss}");
  var fraction = uPlot.fmtDate("{ss}.{fff}");

  function clock(step) {
    if (step >= 86400) return null;
    return step >= 60 ? minute : step >= 1 ? second : fraction;
  }

  function dated(u, splits, axis, space, step) {
    var shown = "";
    var form = clock(step);
    return splits.map(function (at) {
      var date = inZone(at);
      var today = day(date);
      if (!form) return today;
      var text = form(date) + (today === shown ? "" : "\n" + today);
      shown = today;
      return text;
    });
  }

  function undated(u, splits, axis, space, step) {
    var form = clock(step) || day;
    return splits.map(function (at) { return form(inZone(at)); });
  }

  function elapsed(u, splits, axis, space, step) {
    return splits.map(function (at) {
      var whole = Math.abs(at);
      var h = Math.floor(whole / 3600), m = Math.floor(whole % 3600 / 60), s = whole % 60;
      var pad = function (part) { return (part < 10 ? "0" : "") + part; };
      var tail = step < 1 ? s.toFixed(2) : pad(Math.round(s));
      return (at < 0 ? "−" : "") + h + ":" + pad(m) + (step < 60 ? ":" + tail : "");
    });
  }

  // Steps that are round on a clock, from a hundredth of a second to thirty days.
  var STEPS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30].concat(
    [1, 2, 5, 10, 15, 30].map(function (m) { return 60 * m; }),
    [1, 2, 3, 6, 12, 24, 48, 120, 240, 720].map(function (h) { return 3600 * h; })
  );

  function label(known) { return known ? "Time (" + zone + ")" : "Time since the first sample, h:mm"; }

  function colour(name) {
    return getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
  }

  function axis(extra) {
    var font = "12px " + getComputedStyle(document.body).fontFamily;
    return Object.assign({
      stroke: colour("quiet"), font: font, labelFont: font, labelGap: 2,
      grid: { stroke: colour("grid"), width: 1 }, ticks: { stroke: colour("line"), width: 1, size: 5 }
    }, extra);
  }

  // Only the lowest of a stack of plots says the date and the zone.
  // Room for "08:15" and, where the ticks are closer than a minute, for "08:15:30".
  function room(u, index, from, to, width) {
    return (to - from) / width * 56 < 60 ? 74 : 56;
  }

  function time(known, lowest) {
    return axis({
      incrs: known ? undefined : STEPS, values: known ? (lowest ? dated : undated) : elapsed, space: room, size: known && lowest ? 42 : 22,
      label: lowest ? label(known) : undefined, labelSize: 18
    });
  }

  function moment(known) {
    return function (u, at) {
      if (at == null) return "";
      return known ? second(inZone(at)) : elapsed(u, [at], 0, 0, 1)[0];
    };
  }

  // A span in words, with dates where the record runs over midnight.
  function between(known, ends, from, to) {
    var said = moment(known);
    var dates = known && day(inZone(ends[0])) !== day(inZone(ends[1]));
    var one = function (at) { return (dates ? day(inZone(at)) + " " : "") + said(null, at); };
    return one(from) + " to " + one(to);
  }

  return { axis: axis, time: time, moment: moment, between: between, colour: colour, tzDate: function (at) { return inZone(at); } };
})();
