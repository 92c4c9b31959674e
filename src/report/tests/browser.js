"use strict";
// Runs in the page under test: watches what goes wrong, then uses the page as a reader would,
// and leaves what it saw as JSON in an element of its own.
const problems = [];
addEventListener("error", event => {
  const source = event.target.src || event.target.href;
  problems.push(source ? `not loaded: ${source.slice(0, 80)}` : String(event.message));
}, true);
addEventListener("unhandledrejection", event => problems.push(String(event.reason)));
window.alert = text => problems.push(`an alert: ${text}`);

const use = () => {
  const table = document.getElementById("trials-table");
  const visible = () => [...table.tBodies]
    .filter(body => !body.hidden)
    .flatMap(body => [...body.rows].slice(1).filter(row => !row.hidden));
  const number = row => Number.parseFloat(row.cells[4].textContent.replace("\u2212", "-"));
  const sorted = direction => [...table.tBodies].every(body => {
    const values = [...body.rows].slice(1).map(number).filter(value => !Number.isNaN(value));
    return values.every((value, i) => i === 0 || direction * (value - values[i - 1]) >= 0);
  });
  const heading = table.tHead.rows[0].cells[4];
  const button = heading.querySelector("button");
  const before = sorted(1);
  button.focus();
  const focused = document.activeElement === button;
  button.click();
  const rising = sorted(1) && heading.getAttribute("aria-sort") === "ascending";
  button.click();
  const falling = sorted(-1) && heading.getAttribute("aria-sort") === "descending";

  const filter = document.getElementById("trials-filter");
  const all = visible().length;
  const type = text => {
    filter.value = text;
    filter.dispatchEvent(new Event("input"));
    return visible().map(row => row.cells[0].textContent);
  };
  const sheets = [...document.querySelectorAll(".sheet")];
  const curves = sheet => [...sheet.querySelectorAll(".panel path")]
    .filter(path => path.getBBox().width > 0 && path.getBoundingClientRect().width > 0);
  // Figures: a point under the pointer, one by the keyboard, a series that goes and comes back.
  const panel = [...document.querySelectorAll(".panel")].find(panel =>
    panel.querySelector('g[data-name="measured"][data-points]') && panel.getAttribute("tabindex"));
  const tip = document.querySelector(".tip");
  panel.focus();
  panel.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight" }));
  const told = tip.hidden ? "" : tip.textContent;
  const dots = [...panel.querySelectorAll('g[data-name="measured"] path')].pop();
  const [, x, y] = /m(\d+) ?(\d+)/.exec(dots.getAttribute("d"));
  const at = new DOMPoint(x, y).matrixTransform(panel.getScreenCTM());
  panel.dispatchEvent(new PointerEvent("pointermove", { clientX: at.x + 2, clientY: at.y + 2 }));
  const pointed = { text: tip.hidden ? "" : tip.textContent, opens: panel.style.cursor === "pointer" };
  panel.dispatchEvent(new PointerEvent("pointerleave"));
  const key = panel.closest(".sheet").querySelector('.key[data-name="measured"]');
  const group = panel.querySelector('g[data-name="measured"]');
  key.dispatchEvent(new MouseEvent("click"));
  const gone = getComputedStyle(group).display === "none" && key.getAttribute("aria-pressed") === "false";
  key.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter" }));
  const back = getComputedStyle(group).display !== "none";
  const rows = [...document.querySelectorAll(".answers tr")];

  return {
    told,
    pointed,
    left: tip.hidden,
    legend: gone && back,
    coefficients: rows.length,
    answered: Math.max(...rows.map(row => row.getBoundingClientRect().bottom + scrollY)),
    all,
    before,
    focused,
    rising,
    falling,
    filtered: type("skewed 3.90"),
    nothing: type("no such trial"),
    hostile: type("<img"),
    cleared: type("").length,
    sheets: sheets.length,
    drawn: sheets.filter(sheet => curves(sheet).length > 2).length,
    described: sheets.filter(sheet => sheet.ariaLabel.length > 20).length,
    family: getComputedStyle(document.querySelector(".panel text")).fontFamily,
    requests: performance.getEntriesByType("resource")
      .map(entry => entry.name)
      .filter(name => !name.startsWith("data:")),
    // Anchors within the page lead somewhere.
    lost: [...document.querySelectorAll('a[href^="#"]')]
      .map(link => link.getAttribute("href").slice(1))
      .filter(id => !document.getElementById(id)),
    overflow: document.documentElement.scrollWidth - document.documentElement.clientWidth,
  };
};
addEventListener("load", () => {
  let seen = {};
  try { seen = use(); } catch (error) { problems.push(String(error)); }
  const report = document.createElement("pre");
  report.id = "seen";
  report.textContent = JSON.stringify({ ...seen, problems });
  document.body.append(report);
});
