// Runs before the first paint: the reader's theme, that scripts run at all, what is open.
(function () {
  "use strict";
  var root = document.documentElement;
  var dark = window.matchMedia("(prefers-color-scheme: dark)");
  var KEY = "stemwatch-theme";

  function chosen() {
    try { return localStorage.getItem(KEY); } catch (_) { return null; }
  }

  function keep(theme) {
    try { localStorage.setItem(KEY, theme); } catch (_) { /* a page on a stick may not store */ }
  }

  function show(theme) {
    root.dataset.theme = theme;
    var button = document.getElementById("theme-toggle");
    if (button) {
      button.textContent = theme === "dark" ? "Light" : "Dark";
      button.setAttribute("aria-label", "Switch to the " + button.textContent.toLowerCase() + " theme");
    }
    document.dispatchEvent(new CustomEvent("themechange"));
  }

  function system() { return dark.matches ? "dark" : "light"; }

  // What only a desk or a sheet of paper has room for is folded on a phone, and opens when asked.
  function fold(open) {
    document.querySelectorAll("details[data-wide]").forEach(function (part) { part.open = open; });
  }

  root.classList.add("js");
  root.dataset.theme = chosen() || system();
  dark.addEventListener("change", function () { if (!chosen()) show(system()); });
  window.addEventListener("beforeprint", function () { fold(true); });
  document.addEventListener("DOMContentLoaded", function () {
    show(root.dataset.theme);
    if (window.matchMedia("(max-width: 760px)").matches) fold(false);
    document.getElementById("theme-toggle").addEventListener("click", function () {
      var next = root.dataset.theme === "dark" ? "light" : "dark";
      keep(next);
      show(next);
    });
    document.getElementById("print-report").addEventListener("click", function () { window.print(); });
  });
})();
