// Tables, and what tables and charts share. A click on a heading sorts a table; its buttons copy it as CSV or LaTeX. The
// selected trial is highlighted in every row and chart; a click on a row, or a space on its link, selects it. The
// fragment of the address holds the selection and the filter of the trials, such as `#trial=NAME&filter=WORDS`. Pages
// are complete without this script.
const fragment = new URLSearchParams(location.hash.includes("=") ? location.hash.slice(1) : "");
const remember = (key, value) => {
  if (value) fragment.set(key, value); else fragment.delete(key);
  history.replaceState(null, "", `#${fragment}`);
};
// The text of a cell, without the explanations that it can unfold.
const words = cell => [...(cell.querySelector("summary, button") ?? cell).childNodes]
  .map(node => node.textContent.trim().replace(/\s+/g, " ")).filter(text => text).join(" ");

// Rows and points of each trial, which are lit together.
const [rows, marks] = [new Map(), new Map()];
const file = (map, trial, value) => map.set(trial, [...(map.get(trial) ?? []), value]);
let selected = null;
let lit = null;
const light = trial => {
  lit = trial;
  document.querySelectorAll("circle.lit").forEach(circle => circle.remove());
  document.querySelectorAll("tr.lit").forEach(row => row.classList.remove("lit"));
  (rows.get(trial) ?? []).forEach(row => row.classList.add("lit"));
  (marks.get(trial) ?? []).forEach(mark => mark());
};
const select = trial => {
  selected = trial === selected ? null : trial;
  remember("trial", selected);
  light(selected);
};
for (const row of document.querySelectorAll("table.trials tbody tr")) {
  if (row.cells.length > 1) file(rows, words(row.cells[0]), row);
}
for (const row of document.querySelectorAll("tbody tr")) {
  const trial = words(row.cells[0]);
  if (!rows.has(trial)) continue;
  if (!rows.get(trial).includes(row)) file(rows, trial, row);
  row.addEventListener("click", event => { if (!event.target.closest("a, summary")) select(trial); });
  for (const kind of ["pointerenter", "focusin"]) row.addEventListener(kind, () => light(trial));
  for (const kind of ["pointerleave", "focusout"]) row.addEventListener(kind, () => light(selected));
  row.addEventListener("keydown", event => {
    if (event.key !== " " || event.target.tagName !== "A") return;
    event.preventDefault();
    select(trial);
  });
}

const button = (text, label, act) => {
  const made = document.createElement("button");
  made.type = "button";
  made.append(...text);
  if (label) made.setAttribute("aria-label", label);
  made.addEventListener("click", act);
  return made;
};
const copy = text => {
  const put = event => { event.clipboardData.setData("text/plain", text); event.preventDefault(); };
  document.addEventListener("copy", put);
  document.execCommand("copy");
  document.removeEventListener("copy", put);
};
const csv = cells => {
  // A value and its standard error get columns of their own.
  const error = / ± |^[\d.-]+\(\d+\)$/;
  const plain = cells.map(row => row.map(text => text.replaceAll("\u2212", "-")));
  const split = plain[0].map((_, i) => plain.some(row => error.test(row[i])));
  const field = text => (/[",]/.test(text) ? `"${text.replaceAll("\"", "\"\"")}"` : text);
  const parts = (text, i, nth) => {
    if (!split[i]) return [text];
    if (!nth) return [text, `${text}, standard error`];
    // In 104.31(22), the error is 0.22.
    const [, value, decimals, last] = /^([\d-]+\.?(\d*))\((\d+)\)$/.exec(text) ?? [];
    return value ? [value, (last / 10 ** decimals.length).toFixed(decimals.length)]
      : [...text.split(" ± "), ""].slice(0, 2);
  };
  return plain.map((row, nth) => row.flatMap((text, i) => parts(text, i, nth)).map(field).join(",") + "\n").join("");
};
const latex = (cells, columns) => {
  const signs = { "±": "$\\pm$", "\u2212": "$-$", "∞": "$\\infty$", "†": "$\\dagger$", "·": "$\\cdot$", "×": "$\\times$",
    "≤": "$\\le$", "≥": "$\\ge$", "°": "$^\\circ$", "–": "--", "\\": "\\textbackslash{}", "~": "\\textasciitilde{}",
    "^": "\\textasciicircum{}", "&": "\\&", "%": "\\%", "#": "\\#", "_": "\\_", "$": "\\$", "{": "\\{", "}": "\\}" };
  const greek = { α: "alpha", β: "beta", γ: "gamma", δ: "delta", ε: "varepsilon", θ: "theta", κ: "kappa", λ: "lambda",
    μ: "mu", ν: "nu", ρ: "rho", σ: "sigma", τ: "tau", φ: "phi", χ: "chi", ψ: "psi", ω: "omega", Δ: "Delta", Σ: "Sigma",
    Ω: "Omega" };
  Object.entries(greek).forEach(([sign, name]) => { signs[sign] = `$\\${name}$`; });
  [..."₀₁₂₃"].forEach((sign, digit) => { signs[sign] = `$_${digit}$`; });
  [..."⁰¹²³"].forEach((sign, digit) => { signs[sign] = `$^${digit}$`; });
  const tex = text => [...text].map(sign => signs[sign] ?? sign).join("");
  const [head, ...body] = cells.map(row => `${row.map(tex).join(" & ")} \\\\\n`);
  return `\\begin{tabular}{${columns}}\n\\toprule\n${head}\\midrule\n${body.join("")}\\bottomrule\n\\end{tabular}\n`;
};

for (const table of document.querySelectorAll(".scroll > table")) {
  const headings = [...(table.tHead?.rows[0].cells ?? [])];
  const key = (row, column) => {
    const text = words(row.cells[column]);
    if (!headings[column].classList.contains("n")) return text;
    const number = Number.parseFloat(text.replace("\u2212", "-"));
    return Number.isNaN(number) ? null : number;
  };
  // Missing values come last in both directions.
  const compare = (a, b, direction) => {
    if (a === null || b === null) return (a === null) - (b === null);
    return direction * (typeof a === "string" ? a.localeCompare(b, "en", { numeric: true }) : a - b);
  };
  const sort = (column, direction) => {
    headings.forEach(heading => heading.removeAttribute("aria-sort"));
    headings[column].setAttribute("aria-sort", direction > 0 ? "ascending" : "descending");
    for (const body of table.tBodies) {
      // A row with one cell is the heading of the group or belongs to the row before it.
      const groups = [];
      for (const row of body.rows) {
        if (row.cells.length > 1) groups.push([row]); else groups.at(-1)?.push(row);
      }
      groups.sort(([a], [b]) => compare(key(a, column), key(b, column), direction));
      body.append(...groups.flat());
    }
  };
  headings.forEach((heading, column) => heading.append(button([...heading.childNodes], "", () =>
    sort(column, heading.getAttribute("aria-sort") === "ascending" ? -1 : 1))));
  if (!headings.length) continue;
  const cells = () => [...table.rows].filter(row => row.cells.length > 1 && !row.hidden)
    .map(row => [...row.cells].map(words));
  const columns = headings.map(heading => (heading.classList.contains("n") ? "r" : "l")).join("");
  const tools = document.createElement("div");
  tools.className = "tools";
  const name = table.parentElement.getAttribute("aria-label");
  tools.append(button(["CSV"], `Copy as CSV: ${name}`, () => copy(csv(cells()))),
    button(["LaTeX"], `Copy as LaTeX: ${name}`, () => copy(latex(cells(), columns))));
  table.parentElement.after(tools);
}

const filter = document.getElementById("trials-filter");
if (filter) {
  const shown = document.getElementById("trials-shown");
  const update = () => {
    const wanted = filter.value.toLowerCase().split(/\s+/).filter(word => word);
    let [count, total] = [0, 0];
    for (const table of document.querySelectorAll("table.trials")) {
      let found = 0;
      for (const { rows: [group, ...own] } of table.tBodies) {
        const hide = row => {
          const text = [group, ...[...row.cells].slice(0, 3)].map(words).join(" ").toLowerCase();
          row.hidden = !wanted.every(word => text.includes(word));
          return row.hidden;
        };
        const visible = own.filter(row => !hide(row)).length;
        group.parentElement.hidden = visible === 0;
        [found, total] = [found + visible, total + own.length];
      }
      count += found;
      const folded = table.closest("details.trials");
      if (folded) folded.open = wanted.length > 0 && found > 0;
    }
    shown.textContent = wanted.length ? `${count} of ${total} trials` : "";
  };
  filter.addEventListener("input", () => { update(); remember("filter", filter.value.trim()); });
  filter.value = fragment.get("filter") ?? "";
  update();
  filter.closest("p").hidden = false;
}

// Opens the folded sections around the target of the address and scrolls to it.
const reveal = () => {
  const named = document.getElementById(location.hash.slice(1));
  for (let of = named?.closest("details"); of; of = of.parentElement.closest("details")) of.open = true;
  named?.scrollIntoView();
};
addEventListener("hashchange", reveal);
reveal();
