// One valve's page: which window is shown, and what is fetched for it.
(function () {
  "use strict";
  var base = document.body.dataset.base || "";
  var LONGEST_S = 31 * 86400, SHORTEST_S = 10, SHEET_PX = 690, LOOP_PX = 300;

  function ask(what, fields, signal) {
    var query = new URLSearchParams(fields);
    return fetch(base + "/api/v1/valve/" + what + "?" + query, { signal: signal, headers: { accept: "application/json" } })
      .then(function (answer) {
        return answer.json().then(function (body) {
          if (!answer.ok) throw new Error(body.detail || "the service answered " + answer.status);
          return body;
        });
      });
  }

  // With the dates, whatever day it is.
  function between(from, to) { return stemwatchAxes.between(true, [0, to], from, to); }

  function iso(seconds) { return new Date(seconds * 1e3).toISOString(); }

  function away(error) {
    return error instanceof TypeError ? "The service does not answer; what is shown may be old." : error.message;
  }

  function length(seconds) {
    if (seconds < 120) return Math.round(seconds) + " s";
    if (seconds < 7200) return Math.round(seconds / 60) + " min";
    return seconds < 172800 ? +(seconds / 3600).toFixed(1) + " h" : +(seconds / 86400).toFixed(1) + " d";
  }

  function live(box) {
    var opening = [+box.dataset.opens, +box.dataset.ends];
    var set = { range: fromAddress() || opening, plots: [], loop: null, answer: null, asking: null, last: null };

    function fromAddress() {
      var fields = new URLSearchParams(location.search);
      var from = parseFloat(fields.get("from")), to = parseFloat(fields.get("to"));
      return to - from >= SHORTEST_S && to - from <= LONGEST_S && from >= 0 ? [from, to] : null;
    }

    // The window stands in the address, so that it can be sent to a colleague.
    function toAddress() {
      var fields = new URLSearchParams(location.search);
      fields.delete("done");
      fields.set("from", set.range[0]);
      fields.set("to", set.range[1]);
      history.replaceState(null, "", "?" + fields + location.hash);
    }

    function place(name) { return box.querySelector(".plot-" + name); }

    function say(strong, quiet) {
      box.querySelector(".view b").textContent = strong;
      box.querySelector(".view span").textContent = quiet;
    }

    function erase() {
      set.plots.forEach(function (plot) { plot.destroy(); });
      set.plots = [];
    }

    function drawSignals() {
      erase();
      var answer = set.answer;
      var process = answer.traces.some(function (trace) { return trace.role === "pv" || trace.role === "sp"; });
      ["travel", "process"].forEach(function (name) {
        var plot = stemwatchSignals.draw(place(name), name, answer, name === "process" || !process, "live", show);
        if (plot) set.plots.push(plot);
      });
      var how = answer.bucket_s ? "each point pair stands for " + length(answer.bucket_s) + ", its lowest and highest value" : "";
      say(between(answer.start_s, answer.stop_s), answer.says || how);
    }

    function eraseLoop() {
      if (set.loop) set.loop.destroy();
      set.loop = null;
    }

    function drawLoop(answer) {
      eraseLoop();
      set.loopAnswer = answer;
      place("loop").closest("figure").hidden = !answer.traces.length;
      box.querySelector(".loop-says").textContent =
        (answer.y === "PV" ? "No stem position (MV) is recorded; PV stands in for it here and includes the process. " : "") +
        (answer.traces.length ? "Drawn: " + between(answer.start_s, answer.stop_s) + ". " : "") + (answer.curve_says ? answer.curve_says + " " : "") + answer.says;
      if (!answer.traces.length) return;
      var chart = {
        ends: [answer.start_s, answer.stop_s], stretch: null, thinned: answer.thinned,
        loop: {
          shapes: answer.shapes, x: "OP, %", y: answer.y + ", " + answer.y_unit, seconds: answer.at_s, op: answer.op,
          traces: answer.traces.map(function (trace) {
            return { role: trace.role, of: trace.role === "recorded" ? answer.y.toLowerCase() : trace.role, label: trace.label, values: trace.values };
          })
        }
      };
      set.loop = stemwatchLoop.draw(chart, place("loop"), place("loop").clientWidth, false);
      set.loop.show(answer.start_s, answer.stop_s);
    }

    function load() {
      if (set.asking) set.asking.abort();
      var asking = set.asking = new AbortController();
      var fields = { id: box.dataset.valve, start: iso(set.range[0]), stop: iso(set.range[1]) };
      box.classList.add("loading");
      ask("signals", fields, asking.signal).then(function (answer) {
        set.answer = answer;
        set.last = answer.last_s;
        drawSignals();
      }).catch(function (error) {
        if (error.name !== "AbortError") say("", away(error));
      }).finally(function () { if (set.asking === asking) box.classList.remove("loading"); });
      ask("loop", fields, asking.signal).then(drawLoop).catch(function (error) {
        if (error.name === "AbortError") return;
        eraseLoop();
        box.querySelector(".loop-says").textContent = away(error);
      });
    }

    function show(from, to) {
      var span = Math.min(Math.max(to - from, SHORTEST_S), LONGEST_S), middle = (from + to) / 2;
      // Whole seconds, as they stand in the address.
      set.range = [Math.floor(middle - span / 2), Math.ceil(middle + span / 2)];
      box.querySelectorAll("[data-span]").forEach(function (button) {
        button.setAttribute("aria-pressed", Math.abs(+button.dataset.span - span) < 1);
      });
      toAddress();
      load();
    }

    function move(how) {
      var from = set.range[0], to = set.range[1], span = to - from;
      if (how === "earlier") show(from - span / 2, to - span / 2);
      if (how === "later") show(from + span / 2, to + span / 2);
      if (how === "in") show(from + span / 4, to - span / 4);
      if (how === "out") show(from - span / 2, to + span / 2);
      if (how === "opening") show(opening[0], opening[1]);
      if (how === "newest") {
        var last = set.last === null ? Date.now() / 1e3 : set.last;
        show(last - span, last);
      }
    }

    box.querySelector(".toolbar").addEventListener("click", function (event) {
      var button = event.target.closest("button");
      if (!button) return;
      if (button.dataset.move) move(button.dataset.move);
      else show(set.range[1] - button.dataset.span, set.range[1]);
    });
    box.querySelector(".over-time").addEventListener("keydown", function (event) {
      var how = { ArrowLeft: "earlier", ArrowRight: "later", "+": "in", "=": "in", "-": "out" }[event.key];
      if (!how) return;
      event.preventDefault();
      move(how);
    });
    load();
    // After a run the page opens on the newest window; who looks at another one stays there.
    document.addEventListener("renewed", function (event) {
      var fresh = event.detail.page.querySelector(".live-plots");
      if (!fresh) return;
      var newest = [+fresh.dataset.opens, +fresh.dataset.ends];
      if (set.range[0] === opening[0] && set.range[1] === opening[1]) set.range = newest;
      opening = newest;
      load();
    });
    return function () {
      if (set.answer) drawSignals();
      if (set.loopAnswer) drawLoop(set.loopAnswer);
    };
  }

  function months(box) {
    var history = null, plots = [], back = 6;

    function draw() {
      plots.forEach(function (plot) { plot.destroy(); });
      plots = [];
      if (!history) return;
      var range = stemwatchMonths.span(history, back, Date.now() / 1e3);
      ["S", "J"].forEach(function (name) {
        plots.push(stemwatchMonths.draw(box.querySelector(".plot-" + name), name, history, range, "months"));
      });
      box.querySelectorAll("[data-months]").forEach(function (button) {
        button.setAttribute("aria-pressed", +button.dataset.months === back);
      });
    }

    function load() {
      ask("history", { id: box.dataset.valve }).then(function (answer) { history = answer; draw(); })
        .catch(function (error) { box.querySelector(".key").textContent = away(error); });
    }

    load();
    document.addEventListener("renewed", load);
    box.querySelector(".toolbar").addEventListener("click", function (event) {
      var button = event.target.closest("button");
      if (!button) return;
      back = +button.dataset.months;
      draw();
    });
    return draw;
  }

  document.addEventListener("DOMContentLoaded", function () {
    var redraws = [];
    document.querySelectorAll(".live-plots").forEach(function (box) { redraws.push(live(box)); });
    document.querySelectorAll(".months").forEach(function (box) { redraws.push(months(box)); });
    var redraw = function () { redraws.forEach(function (one) { one(); }); };
    document.addEventListener("themechange", redraw);
    // For paper the plots are drawn as wide as the sheet, in ink: shrunk from a wide window their
    // numbers could not be read.
    var places = document.querySelectorAll(".live-plots .plot, .months .plot"), root = document.documentElement, theme = null;
    window.addEventListener("beforeprint", function () {
      theme = root.dataset.theme;
      root.dataset.theme = "light";
      places.forEach(function (place) { place.style.width = (place.classList.contains("plot-loop") ? LOOP_PX : SHEET_PX) + "px"; });
      redraw();
    });
    window.addEventListener("afterprint", function () {
      if (theme === null) return;
      root.dataset.theme = theme;
      theme = null;
      places.forEach(function (place) { place.style.width = ""; });
      redraw();
    });
    // The first result of a valve brings plots with it.
    document.addEventListener("renewed", function (event) {
      var first = event.detail.page.querySelector(".months") && !document.querySelector(".months");
      if (first && event.detail.all) location.reload();
    });
    var pending = 0, width = window.innerWidth;
    window.addEventListener("resize", function () {
      // A phone fires resize when its address bar slides away; only the width matters.
      if (theme !== null || window.innerWidth === width) return;
      width = window.innerWidth;
      clearTimeout(pending);
      pending = setTimeout(redraw, 150);
    });
  });
})();
