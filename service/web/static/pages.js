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

  // A part of a page that changes while it is looked at is fetched again, and left alone while
  // somebody writes in it.
  function refresh(part) {
    setInterval(function () {
      if (document.hidden || part.contains(document.activeElement)) return;
      fetch(location.href, { headers: { accept: "text/html", "x-stemwatch-refresh": "1" } }).then(function (answer) {
        if (answer.status === 401) location.reload(); // signed out: the server leads to the login
        if (!answer.ok) throw new Error(answer.status);
        return answer.text();
      }).then(function (text) {
        var fresh = new DOMParser().parseFromString(text, "text/html").getElementById(part.id);
        if (fresh && fresh.innerHTML !== part.dataset.seen) {
          part.innerHTML = fresh.innerHTML;
          part.dataset.seen = fresh.innerHTML;
        }
      }).catch(function () { /* the service is away: the page stays as it is and asks again */ });
    }, REFRESH_MS);
  }

  document.addEventListener("DOMContentLoaded", function () {
    document.querySelectorAll(".live-filters").forEach(filter);
    document.querySelectorAll("[data-refresh]").forEach(refresh);
  });
  // Coming back by the browser's button finds the fields as they were.
  window.addEventListener("pageshow", function () {
    document.querySelectorAll(".live-filters :disabled").forEach(function (field) { field.disabled = false; });
  });
})();
