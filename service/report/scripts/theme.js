// Runs before the first paint: the reader's theme, and that scripts run at all.
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

  root.classList.add("js");
  root.dataset.theme = chosen() || system();
  dark.addEventListener("change", function () { if (!chosen()) show(system()); });
  document.addEventListener("DOMContentLoaded", function () {
    show(root.dataset.theme);
    document.getElementById("theme-toggle").addEventListener("click", function () {
      var next = root.dataset.theme === "dark" ? "light" : "dark";
      keep(next);
      show(next);
    });
    document.getElementById("print-report").addEventListener("click", function () { window.print(); });
  });
})();
