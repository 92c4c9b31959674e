"use strict";
// Figures: legends switch series on and off; pointer, and in a panel that has the focus the arrow
// keys, find values; a click or Enter on a measured point goes to its trial or run. Nothing here is
// needed to read a page.
(() => {
  const tip = document.createElement("div");
  tip.className = "tip";
  tip.setAttribute("role", "status");
  tip.hidden = true;
  document.body.append(tip);
  const pages = new Map([...document.querySelectorAll('a[href^="trials/"], a[href^="#run-"]')]
    .map(link => [link.textContent, link.href]));

  const button = (element, label, act) => {
    element.setAttribute("role", "button");
    element.setAttribute("tabindex", "0");
    element.setAttribute("aria-label", label);
    element.addEventListener("click", act);
    element.addEventListener("keydown", event => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      act();
    });
  };
  const series = (sheet, name) => [...sheet.querySelectorAll(".panel g[data-name]:not(.key)")]
    .filter(group => group.dataset.name === name);

  for (const sheet of document.querySelectorAll(".sheet")) {
    for (const key of sheet.querySelectorAll(".key")) {
      const { name } = key.dataset;
      if (!series(sheet, name).length) continue;
      key.setAttribute("aria-pressed", "true");
      button(key, name, () => {
        const shown = key.getAttribute("aria-pressed") !== "true";
        key.setAttribute("aria-pressed", shown);
        for (const group of series(sheet, name)) group.style.display = shown ? "" : "none";
      });
    }
    sheet.querySelectorAll(".panel[data-x]").forEach(explore);
  }

  // An axis: between values and the drawing's units.
  function axis(text) {
    const [from, to, low, high, logarithmic, ...label] = text.split(" ");
    const scale = (to - from) / (high - low);
    return {
      label: label.join(" "),
      place: value => +from + scale * ((+logarithmic ? Math.log10(value) : value) - low),
      value: place => {
        const value = (place - from) / scale + +low;
        return +logarithmic ? 10 ** value : value;
      },
    };
  }

  function explore(panel) {
    const [x, y] = [axis(panel.dataset.x), axis(panel.dataset.y)];
    const short = value => +Number(value).toPrecision(4);
    const points = [];
    for (const group of panel.querySelectorAll("g[data-name]:not(.key)")) {
      const { name } = group.dataset;
      const say = (trial, across, up, error) => {
        const bar = Number.isFinite(error) && error > 0 ? ` ± ${short(error)}` : "";
        const of = [name, trial].filter(part => part).join(", ");
        return `${of}: ${x.label} ${short(across)}, ${y.label} ${short(up)}${bar}`;
      };
      if (group.dataset.points !== undefined) {
        for (const line of group.dataset.points.split("\n").filter(line => line)) {
          const [across, up, error, ...trial] = line.split(" ");
          points.push({ group, trial: trial.join(" "), x: x.place(across), y: y.place(up),
            text: say(trial.join(" "), across, up, +error) });
        }
        continue;
      }
      for (const path of group.querySelectorAll("path[stroke-width='16']")) {
        let place = [0, 0];
        for (const [, across, up] of path.getAttribute("d").matchAll(/(-?\d+) ?(-?\d+)/g)) {
          place = [place[0] + +across, place[1] + +up];
          points.push({ group, curve: true, x: place[0], y: place[1],
            text: say("", x.value(place[0]), y.value(place[1])) });
        }
      }
    }
    if (!points.length) return;
    const shown = point => point.group.style.display !== "none";
    let near = null;
    const show = point => {
      near = point;
      tip.hidden = !point;
      panel.style.cursor = point && pages.has(point.trial) ? "pointer" : "";
      if (!point) return;
      tip.textContent = point.text;
      const at = new DOMPoint(point.x, point.y).matrixTransform(panel.getScreenCTM());
      tip.style.left = `${Math.max(4, Math.min(at.x + 12, innerWidth - tip.offsetWidth - 4))}px`;
      tip.style.top = `${Math.max(4, at.y - tip.offsetHeight - 8)}px`;
    };
    const open = () => { if (near && pages.has(near.trial)) location.href = pages.get(near.trial); };
    panel.addEventListener("pointermove", event => {
      const at = new DOMPoint(event.clientX, event.clientY)
        .matrixTransform(panel.getScreenCTM().inverse());
      // Measured points first, and only what is within 15 px.
      const far = point => Math.hypot(point.x - at.x, point.y - at.y) + (point.curve ? 50 : 0);
      const best = points.filter(shown).reduce((a, b) => (far(b) < far(a) ? b : a), points[0]);
      show(shown(best) && far(best) < 150 ? best : null);
    });
    panel.addEventListener("pointerleave", () => show(null));
    panel.addEventListener("click", open);
    const stops = () => points.filter(point => shown(point) && !point.curve).sort((a, b) => a.x - b.x);
    if (!stops().length) return;
    panel.setAttribute("tabindex", "0");
    panel.setAttribute("role", "group");
    panel.setAttribute("aria-label", `${y.label} against ${x.label}; arrow keys go from point to point`);
    panel.addEventListener("blur", () => show(null));
    panel.addEventListener("keydown", event => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (event.key === "Enter") open();
      if (!step) return;
      event.preventDefault();
      const all = stops();
      show(all[(all.indexOf(near) + step + all.length) % all.length]);
    });
  }
})();
