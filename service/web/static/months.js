// S or J over months: points with their intervals, limits, baselines and work.
var stemwatchMonths = (function () {
  "use strict";
  var HEIGHT = 180, DAY_S = 86400, DATE_PX = 92;
  var VERDICTS = { sticky: "sticky", defective: "defective", watch: "watch", healthy: "healthy", undetermined: "undetermined" };

  function seconds(text) { return Date.parse(text) / 1e3; }

  function vertical(u, at, colour, dash) {
    var x = u.valToPos(at, "x", true), ctx = u.ctx, ratio = uPlot.pxRatio;
    if (x < u.bbox.left || x > u.bbox.left + u.bbox.width) return;
    ctx.save();
    ctx.strokeStyle = stemwatchAxes.colour(colour);
    ctx.lineWidth = 1.5 * ratio;
    ctx.setLineDash(dash.map(function (part) { return part * ratio; }));
    ctx.beginPath();
    ctx.moveTo(x, u.bbox.top);
    ctx.lineTo(x, u.bbox.top + u.bbox.height);
    ctx.stroke();
    ctx.restore();
  }

  function horizontal(u, value, words) {
    var y = u.valToPos(value, "y", true), ctx = u.ctx, ratio = uPlot.pxRatio;
    if (y < u.bbox.top || y > u.bbox.top + u.bbox.height) return;
    ctx.save();
    ctx.strokeStyle = stemwatchAxes.colour("sticky");
    ctx.setLineDash([5 * ratio, 4 * ratio]);
    ctx.lineWidth = ratio;
    ctx.beginPath();
    ctx.moveTo(u.bbox.left, y);
    ctx.lineTo(u.bbox.left + u.bbox.width, y);
    ctx.stroke();
    ctx.fillStyle = stemwatchAxes.colour("quiet");
    ctx.font = 11 * ratio + "px " + getComputedStyle(document.body).fontFamily;
    ctx.textAlign = "left";
    ctx.textBaseline = "bottom";
    ctx.fillText(words, u.bbox.left + 4 * ratio, y - ratio);
    ctx.restore();
  }

  function marks(history, name) {
    return function (u) {
      history.marks.forEach(function (mark) {
        if (mark.kind === "baseline" || mark.kind === "former baseline") vertical(u, seconds(mark.at), "healthy", mark.kind === "baseline" ? [] : [2, 4]);
        if (mark.kind === "maintenance") vertical(u, seconds(mark.at), "accent", []);
      });
      if (name !== "S") return;
      horizontal(u, history.watch_S_percent, "watch");
      horizontal(u, history.sticky_S_percent, "sticky");
    };
  }

  // Each point in the colour of its verdict, with its interval as a bar.
  function points(history, name) {
    return function (u, index) {
      var ctx = u.ctx, ratio = uPlot.pxRatio;
      ctx.save();
      ctx.lineWidth = 1.25 * ratio;
      history.points.forEach(function (point) {
        var value = point[name], at = seconds(point.at);
        if (value === null || at < u.scales.x.min || at > u.scales.x.max) return;
        var x = u.valToPos(at, "x", true), y = u.valToPos(value, "y", true);
        ctx.fillStyle = ctx.strokeStyle = stemwatchAxes.colour(VERDICTS[point.verdict] || "quiet");
        if (point[name + "_low"] !== null && point[name + "_high"] !== null) {
          ctx.globalAlpha = 0.55;
          ctx.beginPath();
          ctx.moveTo(x, u.valToPos(point[name + "_low"], "y", true));
          ctx.lineTo(x, u.valToPos(point[name + "_high"], "y", true));
          ctx.stroke();
          ctx.globalAlpha = 1;
        }
        ctx.beginPath();
        ctx.arc(x, y, 3 * ratio, 0, 2 * Math.PI);
        ctx.fill();
      });
      ctx.restore();
      return null;
    };
  }

  function top(history, name) {
    var highest = name === "S" ? history.sticky_S_percent * 1.2 : 0.5;
    history.points.forEach(function (point) {
      highest = Math.max(highest, point[name + "_high"] || point[name] || 0);
    });
    return highest * 1.06;
  }

  function span(history, months, now) {
    var at = history.points.map(function (point) { return seconds(point.at); });
    if (!at.length) return [now - 30 * DAY_S, now];
    var last = at[at.length - 1], first = months ? Math.max(last - months * 30.5 * DAY_S, at[0]) : at[0];
    var room = (last - first) * 0.03 || 15 * DAY_S;
    return [first - room, last + room];
  }

  function draw(place, name, history, range, sync) {
    var at = history.points.map(function (point) { return seconds(point.at); });
    var value = function (part) { return history.points.map(function (point) { return point[part]; }); };
    var known = function (u, number) { return number == null ? "" : number.toFixed(2) + " %"; };
    var plain = function (label) { return { label: label, stroke: stemwatchAxes.colour("quiet"), show: true, width: 0, points: { show: false }, paths: function () { return null; }, value: known }; };
    return new uPlot({
      width: place.clientWidth, height: HEIGHT + (name === "J" ? 38 : 0), padding: [10, 36, 0, 0], tzDate: stemwatchAxes.tzDate,
      scales: { x: { time: true, range: function () { return range; } }, y: { range: function () { return [0, top(history, name)]; } } },
      cursor: { sync: { key: sync }, drag: { x: false, y: false } },
      axes: [Object.assign(stemwatchAxes.time(true, name === "J"), { space: DATE_PX }), stemwatchAxes.axis({ size: 52 })],
      series: [
        { value: stemwatchAxes.moment(true) },
        { label: name, stroke: stemwatchAxes.colour("trace-mv"), width: 1, points: { show: false }, paths: points(history, name), value: known },
        plain("95 % low"), plain("95 % high")
      ],
      legend: { show: true, live: true, markers: { show: false } },
      hooks: { drawAxes: [marks(history, name)] }
    }, [at, value(name), value(name + "_low"), value(name + "_high")], place);
  }

  return { draw: draw, span: span };
})();
