"use strict";
// Interactive figures: legend entries show and hide series. The pointer, or the arrow keys in a focused panel, show
// values (left and right along a series, up and down between series). A click or Enter on a measured point opens
// the page of its trial or run; on a touch screen, the first tap shows the value and the second opens the page.
// Pages are complete without this script.
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

  // Converts between the values of an axis and the coordinates of the drawing.
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
      const say = (trial, across, up, interval = "") => {
        const of = [name, trial].filter(part => part).join(", ");
        return `${of}: ${x.label} ${short(across)}, ${y.label} ${short(up)}${interval}`;
      };
      const lines = text => text.split("\n").filter(line => line).map(line => line.split(" "));
      if (group.dataset.points !== undefined) {
        for (const [across, up, error, ...trial] of lines(group.dataset.points)) {
          const bar = error > 0 ? ` ± ${short(error)}` : "";
          points.push({ group, trial: trial.join(" "), x: x.place(across), y: y.place(up),
            text: say(trial.join(" "), across, up, bar) });
        }
        continue;
      }
      // A curve with an interval.
      if (group.dataset.band !== undefined) {
        for (const [across, up, low, high] of lines(group.dataset.band)) {
          const limits = +low <= +high ? ` (95 %: ${short(low)} to ${short(high)})` : "";
          points.push({ group, curve: true, x: x.place(across), y: y.place(up),
            text: say("", across, up, limits) });
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
    // The name of a trial may contain a line break, which leaves fragments without coordinates.
    points.splice(0, points.length, ...points.filter(point => Number.isFinite(point.x + point.y)));
    if (!points.length) return;
    const shown = point => point.group.style.display !== "none";
    let near = null;
    const show = point => {
      near = point;
      tip.hidden = !point;
      panel.style.cursor = point && pages.has(point.trial) ? "pointer" : "";
      if (!point) return;
      tip.textContent = point.text;
      place();
    };
    const place = () => {
      if (!near) return;
      const at = new DOMPoint(near.x, near.y).matrixTransform(panel.getScreenCTM());
      tip.style.left = `${Math.max(4, Math.min(at.x + 12, innerWidth - tip.offsetWidth - 4))}px`;
      tip.style.top = `${Math.max(4, at.y - tip.offsetHeight - 8)}px`;
    };
    const open = () => { if (near && pages.has(near.trial)) location.href = pages.get(near.trial); };
    // Returns the closest point within reach; measured points take precedence over curves.
    const find = (event, reach) => {
      const at = new DOMPoint(event.clientX, event.clientY)
        .matrixTransform(panel.getScreenCTM().inverse());
      const far = point => Math.hypot(point.x - at.x, point.y - at.y) + (point.curve ? 50 : 0);
      const best = points.filter(shown).reduce((a, b) => (far(b) < far(a) ? b : a), points[0]);
      return shown(best) && far(best) < reach ? best : null;
    };
    // Touch does not hover, and a finger covers several points.
    let finger = false;
    const is_finger = event => event.pointerType === "touch";
    panel.addEventListener("pointerdown", event => { finger = is_finger(event); });
    panel.addEventListener("pointermove", event => {
      if (!is_finger(event)) show(find(event, 150));
    });
    panel.addEventListener("pointerleave", event => { if (!is_finger(event)) show(null); });
    panel.addEventListener("click", event => {
      if (!finger) return open();
      const [before, point] = [near, find(event, 300)];
      if (point && point === before) return open();
      show(point);
      if (point && pages.has(point.trial)) tip.textContent += "; tap again to open the page of this trial";
      place();
    });
    document.addEventListener("pointerdown", event => {
      if (is_finger(event) && near && !panel.contains(event.target)) show(null);
    });
    addEventListener("scroll", () => { if (finger && near) place(); }, { passive: true });
    panel.setAttribute("tabindex", "0");
    panel.setAttribute("role", "group");
    panel.setAttribute("aria-label", `${y.label} against ${x.label}; the arrow keys move from point to point and from series to series`);
    panel.addEventListener("blur", () => show(null));
    panel.addEventListener("keydown", event => {
      const along = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      const across = { ArrowDown: 1, ArrowUp: -1 }[event.key];
      if (event.key === "Enter") open();
      if (!along && !across) return;
      event.preventDefault();
      // Trials come first, then single predictions, then curves, of which about forty points are visited.
      const rank = point => (point.curve ? 2 : point.trial ? 0 : 1);
      const all = points.filter(shown).sort((a, b) => rank(a) - rank(b));
      const groups = [...new Set(all.map(point => point.group))];
      if (!groups.length) return;
      const next = (list, from, step) => list[(from + step + list.length) % list.length];
      const group = next(groups, Math.max(groups.indexOf(near?.group), 0), across && near ? across : 0);
      const own = all.filter(point => point.group === group).sort((a, b) => a.x - b.x);
      const at = near ? own.reduce((best, point, i) =>
        Math.abs(point.x - near.x) < Math.abs(own[best].x - near.x) ? i : best, 0) : -1;
      const from = near?.group === group ? own.indexOf(near) : at;
      show(next(own, from, along && near ? along * Math.ceil(own.length / 40) : near ? 0 : 1));
    });
  }
  // Height of the navigation bar, by which sections are offset when scrolled to.
  const bar = document.querySelector("nav.bar");
  if (bar) {
    const measure = () =>
      document.documentElement.style.setProperty("--bar", `${bar.offsetHeight}px`);
    new ResizeObserver(measure).observe(bar);
    measure();
  }
  for (const menu of document.querySelectorAll("nav details")) {
    const close = event => { if (event.type === "click" || event.key === "Escape") menu.open = false; };
    menu.querySelectorAll("a").forEach(link => link.addEventListener("click", close));
    menu.addEventListener("keydown", close);
  }
})();
