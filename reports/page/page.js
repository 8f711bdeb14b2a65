// What the page does beyond panning and zooming: steps through k, links map, profile and table,
// and sorts tables. `placementPage` is called by the figures' hover tools, too.
"use strict";
const placementPage = (() => {
  const FAINT = 0.1, CLEAR = 0.45;
  let steps = [], step = null, pointed = new Set();

  const model = (name) => {
    for (const doc of Bokeh.documents) {
      const found = doc.get_model_by_name(name);
      if (found) return found;
    }
    return null;
  };
  const column = (name, key, values) => {
    const source = model(name);
    source.data = { ...source.data, [key]: values };
  };

  function shade() {
    const n = model("cameras").data.x.length;
    const on = new Set(step.members);
    column("cameras", "alpha", Array.from({ length: n }, (_, i) => (on.has(i) ? 1 : 0)));
    column("ground", "alpha", Array.from({ length: n }, (_, i) =>
      !on.has(i) ? 0 : pointed.has(i) ? CLEAR : FAINT));
    document.querySelectorAll("tr[data-camera]").forEach((row) =>
      row.classList.toggle("off", !on.has(Number(row.dataset.camera))));
  }

  function show(n) {
    step = steps[n];
    const along = model("along");
    along.data = { ...along.data, error: step.error, lateral: step.lateral };
    const text = document.getElementById("step-text");
    if (text) text.textContent = step.text;
    shade();
  }

  function pointAt(indices) {
    const now = new Set(indices);
    if (now.size === pointed.size && [...now].every((i) => pointed.has(i))) return;
    pointed = now;
    shade();
  }

  function standAt(index) {
    const along = model("along").data, here = model("here"), cursor = model("cursor");
    here.data = { x: [along.x[index]], y: [along.y[index]] };
    cursor.location = along.s[index];
  }

  function sort(table, column, button) {
    const head = button.closest("th");
    const up = head.getAttribute("aria-sort") !== "ascending";
    table.querySelectorAll("th").forEach((th) => th.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const key = (row) => {
      const text = row.cells[column].textContent.trim(), number = Number(text);
      return text !== "" && !Number.isNaN(number) ? number : text;
    };
    const body = table.tBodies[0];
    const rows = [...body.rows].map((row, n) => [key(row), n, row]);
    rows.sort(([a, m], [b, n]) => {
      const same = typeof a === typeof b;
      const order = same ? (a < b ? -1 : a > b ? 1 : 0) : typeof a === "number" ? -1 : 1;
      return (up ? order : -order) || m - n;
    });
    rows.forEach(([, , row]) => body.append(row));
  }

  function prepare() {
    document.querySelectorAll("table.sortable").forEach((table) =>
      table.querySelectorAll("thead th").forEach((th, column) => {
        const button = th.querySelector("button");
        if (button) button.addEventListener("click", () => sort(table, column, button));
      }));
    const data = document.getElementById("steps");
    if (!data) return;
    steps = JSON.parse(data.textContent);
    const slider = document.getElementById("step");
    slider.addEventListener("input", () => show(Number(slider.value)));
    document.querySelectorAll("tr[data-camera]").forEach((row) => {
      const point = () => pointAt([Number(row.dataset.camera)]);
      row.addEventListener("mouseenter", point);
      row.addEventListener("focus", point);
      row.addEventListener("mouseleave", () => pointAt([]));
      row.addEventListener("blur", () => pointAt([]));
    });
    const ready = () => {
      if (!window.Bokeh || !Bokeh.documents.length || !model("cameras")) {
        return void setTimeout(ready, 30);
      }
      show(Number(slider.value));
      document.body.dataset.ready = "yes";
    };
    ready();
  }

  document.addEventListener("DOMContentLoaded", prepare);
  return { pointAt, standAt, show };
})();
