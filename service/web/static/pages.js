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

  // The parts of the page as they are now; one in which somebody writes is left alone. True where
  // none was.
  function renew(parts) {
    return ask(location.href, "text/html").then(function (text) {
      var page = new DOMParser().parseFromString(text, "text/html");
      return parts.map(function (part) {
        var fresh = page.getElementById(part.id);
        if (part.contains(document.activeElement)) return false;
        if (fresh && fresh.innerHTML !== part.dataset.seen) {
          part.innerHTML = fresh.innerHTML;
          part.dataset.seen = fresh.innerHTML;
        }
        return true;
      }).every(Boolean);
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
