// What every page does with scripts; without them all of it works by buttons and reloads.
(function () {
  "use strict";
  var REFRESH_MS = 5000;

  // Filters act when they are changed, not only by the button; empty ones stay out of the address.
  function filter(form) {
    form.addEventListener("change", function (event) { if (event.target.type !== "search") form.requestSubmit(); });
    form.addEventListener("submit", function () {
      form.querySelectorAll("input, select").forEach(function (field) { if (field.value === "") field.disabled = true; });
    });
  }

  function ask(address, type) {
    return fetch(address, { headers: { accept: type, "x-stemwatch-refresh": "1" } }).then(function (answer) {
      if (answer.status === 401) location.reload(); // signed out: the server leads to the login
      if (!answer.ok) throw new Error(answer.status);
      return answer.text();
    });
  }

  // Somebody writes or chooses in it.
  function inUse(part) {
    var active = document.activeElement;
    if (part.contains(active) && active.closest("form, input, select, textarea")) return true;
    return Array.from(part.querySelectorAll("input:not([type=hidden]), textarea")).some(function (field) {
      return field.value !== field.defaultValue || field.checked !== field.defaultChecked;
    });
  }

  // What was folded stays so, and the keyboard stays where it was.
  function put(part, fresh) {
    var stops = "a, button, summary, [tabindex]", folded = {};
    var at = Array.from(part.querySelectorAll(stops)).indexOf(document.activeElement);
    // A summary may count what is in it, and one more is the same summary.
    function named(one) { return one.firstElementChild.textContent.replace(/\d+/g, ""); }
    part.querySelectorAll("details").forEach(function (one) { folded[named(one)] = one.open; });
    part.innerHTML = fresh.innerHTML;
    part.querySelectorAll("details").forEach(function (one) {
      var name = named(one);
      if (name in folded) one.open = folded[name];
      else if (one.dataset.wide !== undefined && window.matchMedia("(max-width: 760px)").matches) one.open = false;
    });
    var stop = at < 0 ? null : part.querySelectorAll(stops)[at];
    if (stop) stop.focus({ preventScroll: true });
  }

  // The parts of the page as they are now; one in which somebody writes is left alone. True where
  // none was.
  function renew(parts) {
    return ask(location.href, "text/html").then(function (text) {
      var page = new DOMParser().parseFromString(text, "text/html");
      var changed = false, all = parts.map(function (part) {
        var fresh = page.getElementById(part.id);
        if (inUse(part)) return false;
        if (fresh && fresh.innerHTML !== part.dataset.seen) {
          put(part, fresh);
          changed = true;
          part.dataset.seen = fresh.innerHTML;
        }
        return true;
      }).every(Boolean);
      // Asked again until nobody writes any more: what draws itself need not draw again each time.
      if (changed || all) document.dispatchEvent(new CustomEvent("renewed", { detail: { page: page, all: all } }));
      return all;
    });
  }

  // What goes on while it is looked at is fetched again and again.
  function refresh(parts) {
    setInterval(function () {
      if (document.hidden) return;
      renew(parts).catch(function () { /* the service is away: the page stays as it is and asks again */ });
    }, REFRESH_MS);
  }

  // What changes with a run that is over, or an alert, is fetched again when there was one.
  function follow(parts) {
    var base = document.body.dataset.base, seen = null, busy = false;
    function look() {
      if (document.hidden || busy) return;
      busy = true;
      ask(base + "/api/v1/changes", "application/json").then(function (text) {
        if (seen === null || text === seen) { seen = text; return null; }
        return renew(parts).then(function (all) { if (all) seen = text; });
      }).catch(function () { /* as above */ }).then(function () { busy = false; });
    }
    look();
    setInterval(look, REFRESH_MS);
  }

  document.addEventListener("DOMContentLoaded", function () {
    document.querySelectorAll(".live-filters").forEach(filter);
    var going = Array.from(document.querySelectorAll("[data-refresh]"));
    var followed = Array.from(document.querySelectorAll("[data-follow]"));
    if (going.length) refresh(going);
    if (followed.length) follow(followed);
  });
  // Coming back by the browser's button finds the fields as they were.
  window.addEventListener("pageshow", function () {
    document.querySelectorAll(".live-filters :disabled").forEach(function (field) { field.disabled = false; });
  });
})();
