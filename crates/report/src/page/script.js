// Interactive figures: legend entries show and hide series. The pointer, or the arrow keys in a focused panel, show
// values (left and right along a series, up and down between series). A click or a tap on a measured point selects its
// trial and shows the link to its page, which a second click, or Enter, opens. A dragged rectangle, or +, magnifies a
// part of a panel, and a double click, or 0, shows the whole panel again. Pages are complete without this script.
(() => {
  const tip = document.createElement("div");
  tip.className = "tip";
  tip.setAttribute("role", "status");
  tip.hidden = true;
  document.body.append(tip);
  const pages = new Map([...document.querySelectorAll('a[href^="trials/"], a[href^="#run-"]')]
    .map(link => [link.textContent, link.href]));
  const change = (element, attributes) => {
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  };
  const make = (name, attributes, panel) => {
    const element = document.createElementNS(panel.namespaceURI, name);
    change(element, attributes);
    panel.append(element);
    return element;
  };

  const press = (element, label, act) => {
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
      press(key, name, () => {
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
      from: +from,
      to: +to,
      label: label.join(" "),
      place: value => +from + scale * ((+logarithmic ? Math.log10(value) : value) - low),
      value: place => {
        const value = (place - from) / scale + +low;
        return +logarithmic ? 10 ** value : value;
      },
    };
  }

  // Round numbers between two numbers, of which there are about four.
  function ticks(low, high) {
    const power = 10 ** Math.floor(Math.log10((high - low) / 4));
    const step = power * [1, 2, 5, 10].find(factor => (high - low) / (factor * power) <= 5);
    const first = Math.ceil(low / step);
    return Array.from({ length: Math.floor(high / step) - first + 1 }, (_, i) =>
      +((first + i) * step).toPrecision(12));
  }

  function explore(panel) {
    const [x, y] = [axis(panel.dataset.x), axis(panel.dataset.y)];
    const short = value => +Number(value).toPrecision(4);
    const points = [];
    for (const group of panel.querySelectorAll("g[data-name]:not(.key)")) {
      const { name, points: measured, band } = group.dataset;
      const add = (across, up, [low, high], trial, at) => {
        const of = [name, trial].filter(part => part).join(", ");
        const limits = low < high ? ` (95 %: ${short(low)} to ${short(high)})` : "";
        points.push({ group, trial, curve: measured === undefined, x: at[0], y: at[1],
          text: `${of}: ${x.label} ${short(across)}, ${y.label} ${short(up)}${limits}` });
      };
      // Repeats are drawn beside each other.
      const shifts = (group.dataset.shifts ?? "").split(" ");
      for (const [i, line] of (measured ?? band ?? "").split("\n").filter(line => line).entries()) {
        const [across, up, ...rest] = line.split(" ");
        const error = +rest[0];
        const [limits, trial] = measured === undefined ? [rest.map(Number), ""]
          : [[up - error, +up + error], rest.slice(1).join(" ")];
        add(across, up, limits, trial, [x.place(across) + +(shifts[i] ?? 0), y.place(up)]);
      }
      if (measured !== undefined || band !== undefined) continue;
      for (const path of group.querySelectorAll("path[stroke-width='16'], path[stroke-width='28']")) {
        let place = [0, 0];
        for (const [, across, up] of path.getAttribute("d").matchAll(/(-?\d+) ?(-?\d+)/g)) {
          place = [place[0] + +across, place[1] + +up];
          add(x.value(place[0]), y.value(place[1]), [], "", place);
        }
      }
    }
    // The name of a trial may contain a line break, which leaves fragments without coordinates.
    points.splice(0, points.length, ...points.filter(point => Number.isFinite(point.x + point.y)));
    if (!points.length) return;
    // The part of the drawing that fills the panel; null: all of it.
    let view = null;
    const box = [x.from, Math.min(y.from, y.to), x.to - x.from, Math.abs(y.to - y.from)];
    const [left, top, width, height] = box;
    const frame = make("svg", { class: "zoom", x: left, y: top, width, height, preserveAspectRatio: "none" }, panel);
    frame.remove();
    const seen = point => (view ? [left + (point.x - view[0]) * width / view[2],
      top + (point.y - view[1]) * height / view[3]] : [point.x, point.y]);
    const under = event => {
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(panel.getScreenCTM().inverse());
      return [at.x, at.y];
    };
    const is_inside = ([across, up]) =>
      across >= left && across <= left + width && up >= top && up <= top + height;
    for (const of of panel.querySelectorAll(":scope > path, :scope > text")) {
      if (of.tagName === "path" || /^[-\u2212]?[\d.]/.test(of.textContent)) of.classList.add("unzoomed");
    }
    const zoom = to => {
      view = to;
      show(null);
      panel.classList.toggle("zoomed", view !== null);
      panel.querySelectorAll(":scope > .tick").forEach(tick => tick.remove());
      if (!view && frame.isConnected) frame.replaceWith(...frame.childNodes);
      if (!view) return light(lit);
      if (!frame.isConnected) {
        const data = panel.querySelectorAll(":scope > g[data-name], :scope > .cursor");
        panel.append(frame);
        frame.append(...data);
        for (const line of frame.querySelectorAll("[stroke-width]")) {
          line.style.setProperty("--stroke", `${line.getAttribute("stroke-width") / 10}px`);
        }
      }
      frame.setAttribute("viewBox", view.join(" "));
      const ink = { class: "tick", stroke: "#222222", "stroke-width": 10 };
      const text = { class: "tick", fill: "#222222" };
      make("rect", { ...ink, x: left, y: top, width, height }, panel);
      const tick = (value, d, at) => {
        make("path", { ...ink, d }, panel);
        make("text", { ...text, ...at }, panel).textContent = value;
      };
      for (const value of ticks(x.value(view[0]), x.value(view[0] + view[2]))) {
        const [at] = seen({ x: x.place(value), y: 0 });
        tick(value, `M${at} ${top + height}v40`, { x: at, y: top + height + 150, "text-anchor": "middle" });
      }
      for (const value of ticks(y.value(view[1] + view[3]), y.value(view[1]))) {
        const [, at] = seen({ x: 0, y: y.place(value) });
        tick(value, `M${left} ${at}h-40`, { x: left - 60, y: at + 40, "text-anchor": "end" });
      }
      light(lit);
    };

    const shown = point => point.group.style.display !== "none" && is_inside(seen(point));
    for (const point of points.filter(point => point.trial)) {
      file(marks, point.trial, () => {
        if (!shown(point)) return;
        const [cx, cy] = seen(point);
        make("circle", { class: "lit", cx, cy, r: 70 }, panel);
      });
    }
    let near = null;
    let pinned = false;
    const show = (point, pin = false) => {
      [near, pinned] = [point, pin];
      tip.hidden = !point;
      tip.classList.toggle("pinned", pin);
      panel.style.cursor = point && pages.has(point.trial) ? "pointer" : "";
      if (lit !== (point?.trial || selected)) light(point?.trial || selected);
      if (!point) return;
      tip.textContent = point.text;
      if (pin && pages.has(point.trial)) {
        const link = document.createElement("a");
        [link.href, link.textContent] = [pages.get(point.trial), "Open its page"];
        tip.append(" ", link);
      }
      place();
    };
    const place = () => {
      if (!near) return;
      const at = new DOMPoint(...seen(near)).matrixTransform(panel.getScreenCTM());
      tip.style.left = `${Math.max(4, Math.min(at.x + 12, innerWidth - tip.offsetWidth - 4))}px`;
      tip.style.top = `${Math.max(4, at.y - tip.offsetHeight - 8)}px`;
    };
    const open = () => { if (near && pages.has(near.trial)) location.href = pages.get(near.trial); };
    // Returns the closest point within reach; measured points take precedence over curves.
    const find = (event, reach) => {
      const at = under(event);
      const far = point => {
        const [across, up] = seen(point);
        return Math.hypot(across - at[0], up - at[1]) + (point.curve ? 50 : 0);
      };
      const best = points.filter(shown).reduce((a, b) => (far(b) < far(a) ? b : a), points[0]);
      return shown(best) && far(best) < reach ? best : null;
    };
    // Touch does not hover, and a finger covers several points.
    const is_finger = event => event.pointerType === "touch";
    let finger = false;
    // Where a rectangle is dragged from, and the rectangle.
    let [start, dragged] = [null, null];
    panel.addEventListener("pointerdown", event => {
      finger = is_finger(event);
      dragged = null;
      start = !finger && event.button === 0 && is_inside(under(event)) ? under(event) : null;
      if (!finger) event.preventDefault();
    });
    panel.addEventListener("pointermove", event => {
      if (is_finger(event)) return;
      if (!start || !(event.buttons & 1)) return pinned || show(find(event, 150));
      const at = under(event);
      if (!dragged && Math.hypot(at[0] - start[0], at[1] - start[1]) < 80) return;
      dragged ??= { rect: make("rect", { class: "dragged" }, panel) };
      const end = [0, 1].map(i => Math.max(box[i], Math.min(at[i], box[i] + box[i + 2])));
      dragged.corner = [0, 1].map(i => Math.min(start[i], end[i]));
      dragged.size = [0, 1].map(i => Math.abs(end[i] - start[i]));
      const { rect, corner, size } = dragged;
      change(rect, { x: corner[0], y: corner[1], width: size[0], height: size[1] });
    });
    panel.addEventListener("pointerup", () => {
      start = null;
      if (!dragged) return;
      const { rect, corner, size } = dragged;
      rect.remove();
      const scale = [0, 1].map(i => (view ? view[i + 2] / box[i + 2] : 1));
      const from = [0, 1].map(i => (view ?? box)[i] + (corner[i] - box[i]) * scale[i]);
      if (Math.min(...size) > 80) zoom([...from, ...size.map((length, i) => length * scale[i])]);
    });
    panel.addEventListener("pointerleave", event => { if (!is_finger(event) && !pinned) show(null); });
    panel.addEventListener("dblclick", () => { if (view) zoom(null); });
    panel.addEventListener("click", event => {
      if (dragged) { dragged = null; return; }
      const [before, point] = [pinned ? near : null, find(event, finger ? 300 : 150)];
      if (point && point === before) return open();
      if (point?.trial && rows.has(point.trial) && point.trial !== selected) select(point.trial);
      show(point, point !== null);
    });
    document.addEventListener("pointerdown", event => {
      if (pinned && !panel.contains(event.target) && !tip.contains(event.target)) show(null);
    });
    addEventListener("scroll", place, { passive: true });
    panel.setAttribute("tabindex", "0");
    panel.setAttribute("role", "group");
    panel.setAttribute("aria-label", `${y.label} against ${x.label}; the arrow keys move from point to point and from`
      + " series to series, + magnifies, 0 shows all");
    panel.addEventListener("blur", () => { if (!pinned) show(null); });
    panel.addEventListener("keydown", event => {
      const along = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      const across = { ArrowDown: 1, ArrowUp: -1 }[event.key];
      if (event.key === "Enter") open();
      if (event.key === "Escape") show(null);
      if (event.key === "0") zoom(null);
      if (event.key === "+") {
        // Half the width and height around the point that is shown.
        const [across, up, wide, high] = view ?? box;
        const middle = near ?? { x: across + wide / 2, y: up + high / 2 };
        const low = [[across, wide, middle.x], [up, high, middle.y]].map(([from, size, at]) =>
          Math.max(from, Math.min(at - size / 4, from + size / 2)));
        zoom([...low, wide / 2, high / 2]);
      }
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
  if (fragment.get("trial")) select(fragment.get("trial"));
})();
