// Sorting and filtering of the ranking; a valve filtered out is hidden below and in print as well.
(function () {
  "use strict";
  var table = document.getElementById("ranking-table");
  if (!table) return;
  var body = table.tBodies[0];
  var rows = Array.prototype.slice.call(body.rows);
  var heads = Array.prototype.slice.call(table.tHead.rows[0].cells);
  var find = document.getElementById("find");
  var levels = Array.prototype.slice.call(document.querySelectorAll("select.level"));
  var ticks = Array.prototype.slice.call(document.querySelectorAll('input[name="verdict"]'));
  var words = new Map(rows.map(function (row) {
    return [row, ["c-valve", "c-area"].map(function (name) {
      return row.getElementsByClassName(name)[0].textContent;
    }).join(" ").toLowerCase()];
  }));

  // Rank, names and trend read best from their small end, measures from their large one.
  var LARGEST_FIRST = ["c-S", "c-J", "c-confidence"];

  function key(row, column, kind) {
    var text = row.cells[column].dataset.sort;
    if (kind === "text" || text === "") return text;
    return parseFloat(text);
  }

  function compare(a, b, sign) {
    if (a === "" || b === "") return (a === "") - (b === "");
    if (typeof a === "number") return sign * (a - b);
    return sign * a.localeCompare(b, undefined, { numeric: true });
  }

  function sort(head) {
    var column = heads.indexOf(head);
    var now = head.getAttribute("aria-sort");
    var first = LARGEST_FIRST.indexOf(head.className) >= 0 ? "descending" : "ascending";
    var other = first === "ascending" ? "descending" : "ascending";
    var next = now === first ? other : first;
    var sign = next === "ascending" ? 1 : -1;
    heads.forEach(function (one) { one.removeAttribute("aria-sort"); });
    head.setAttribute("aria-sort", next);
    rows.sort(function (a, b) {
      return compare(key(a, column, head.dataset.kind), key(b, column, head.dataset.kind), sign) ||
        key(a, 0, "number") - key(b, 0, "number");
    });
    rows.forEach(function (row) { body.appendChild(row); });
  }

  function wanted(row) {
    var text = find.value.trim().toLowerCase();
    var verdicts = ticks.filter(function (one) { return one.checked; });
    return words.get(row).indexOf(text) >= 0 &&
      levels.every(function (one) { return !one.value || row.dataset[one.id] === one.value; }) &&
      verdicts.some(function (one) { return one.value === row.dataset.verdict; });
  }

  function filter() {
    var shown = 0;
    rows.forEach(function (row) {
      var keep = wanted(row);
      row.hidden = !keep;
      var section = document.getElementById(row.dataset.anchor);
      if (section) section.hidden = !keep; // of a large plant the last valves have a row alone
      shown += keep ? 1 : 0;
    });
    var counted = document.getElementById("shown");
    var all = rows.length + " " + (rows.length === 1 ? counted.dataset.one : counted.dataset.many);
    counted.textContent = shown === rows.length ? all : shown + " of " + all;
    document.getElementById("none-shown").hidden = shown > 0;
  }

  function clear() {
    find.value = "";
    levels.forEach(function (one) { one.value = ""; });
    ticks.forEach(function (one) { one.checked = true; });
    filter();
  }

  // A link from outside must reach its valve whatever is filtered.
  function reach() {
    var target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (target && target.hidden) {
      clear();
      target.scrollIntoView();
    }
  }

  heads.forEach(function (head) {
    head.firstElementChild.addEventListener("click", function () { sort(head); });
  });
  var form = document.getElementById("filters");
  form.addEventListener("input", filter);
  form.addEventListener("submit", function (event) { event.preventDefault(); });
  window.addEventListener("hashchange", reach);
  // A browser that restores a form after "back" says nothing of it.
  window.addEventListener("pageshow", function () { filter(); reach(); });
})();
