"use strict";
// Replay: moves the robot over the drawing, which is complete without this script, and a cursor through the
// page's charts over time. All integers in the data are differences from the last known number. The script
// waits for the whole page, because the charts come after it.
addEventListener("DOMContentLoaded", () => {
  const replay = document.querySelector(".replay");
  const data = JSON.parse(replay.querySelector("script").textContent);
  const svg = replay.querySelector("figure > svg");
  const floor = svg.querySelector(".floor");
  const [controls, now] = [replay.querySelector(".controls"), replay.querySelector(".now")];
  const [slider, speed] = [controls.querySelector("input"), controls.querySelector("select")];
  const buttons = Object.fromEntries([...controls.querySelectorAll("button")]
    .map(button => [button.dataset.do, button]));
  const sums = differences => {
    let sum = 0;
    return differences.map(step => (step === null ? null : (sum += step)));
  };
  const seconds = sums(data.time).map(time => time / data.per_unit);
  const motions = data.motions.map(({ name, x, y, theta, phi }) =>
    ({ name, columns: [x, y, theta, ...phi].map(sums) }));
  const quantities = data.quantities.map(quantity =>
    ({ ...quantity, values: quantity.values.map(sums) }));
  const last = seconds.length - 1;

  const make = (name, attributes, parent) => {
    const element = document.createElementNS(svg.namespaceURI, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    parent.append(element);
    return element;
  };
  // The measured robot is drawn over the predicted one.
  const robots = motions.map((motion, nth) => ({ motion, nth })).reverse().map(({ motion, nth }) => {
    const group = make("g", { class: nth ? "ghost live" : "robot live" }, floor);
    const links = data.names.map((name, number) => {
      const link = make("g", {}, group);
      make("use", { href: `#replay-link${number}` }, link);
      return link;
    });
    return { motion, group, links, nth };
  });
  const { links: measured } = robots[robots.length - 1];
  const arrows = quantities.filter(({ arrow }) => arrow !== null).flatMap(quantity =>
    quantity.values.map((values, wheel) => ({ quantity, values,
      path: make("path", { class: `arrow ${quantity.across ? "skid" : "roll"}`, transform: data.wheels[wheel] ?? "" }, measured[wheel]) })));
  const markers = data.markers.map(([link, [x, y], label]) =>
    ({ label, use: make("use", { x, y, display: "none" }, measured[link]) }));

  // Returns the coordinates of a motion, interpolated by the fraction `part` between a frame and the next one.
  const at = ({ columns }, frame, part) => {
    const [here, next] = [frame, Math.min(frame + 1, last)].map(i => columns.map(of => of[i]));
    if (here.includes(null)) return null;
    return part === 0 || next.includes(null)
      ? here : here.map((value, i) => value + part * (next[i] - value));
  };
  const poses = ([x, y, theta, ...phi]) => {
    const ahead = ([x, y, angle], length) =>
      [x + length * Math.cos(angle), y + length * Math.sin(angle), angle];
    const turned = ([x, y, angle], by) => [x, y, angle + by];
    const { reference, links } = data;
    const [angle, ...joints] = [theta, ...phi].map(number => number / data.per_unit);
    const all = [];
    all[reference] = [x, y, angle];
    for (let i = reference - 1; i >= 0; i -= 1) {
      all[i] = ahead(turned(ahead(all[i + 1], links[i + 1][0]), -joints[i]), links[i][1]);
    }
    for (let i = reference + 1; i < links.length; i += 1) {
      all[i] = ahead(turned(ahead(all[i - 1], -links[i - 1][1]), joints[i - 1]), -links[i][0]);
    }
    return [all[reference], ...all.filter((pose, i) => i !== reference)];
  };
  const pointer = (length, across) => {
    const back = length - Math.sign(length) * Math.min(120, 0.5 * Math.abs(length));
    const wide = 0.5 * (length - back);
    return across ? `M0 0V${length}M${wide} ${back}L0 ${length} ${-wide} ${back}`
      : `M0 0H${length}M${back} ${wide}L${length} 0 ${back} ${-wide}`;
  };

  // Cursors in charts whose horizontal axis is the time of the recording.
  const charts = [...document.querySelectorAll(".panel[data-x]")].flatMap(panel => {
    const [from, to, low, high, logarithmic, ...label] = panel.dataset.x.split(" ");
    if (label.join(" ") !== "Time (s)" || +logarithmic) return [];
    const [bottom, top] = panel.dataset.y.split(" ");
    const scale = (to - from) / (high - low);
    const line = make("line", { class: "cursor", y1: bottom, y2: top }, panel);
    panel.addEventListener("click", event => {
      const across = new DOMPoint(event.clientX, event.clientY)
        .matrixTransform((panel.querySelector(".zoom") ?? panel).getScreenCTM().inverse()).x;
      if (across >= +from && across <= +to) go(nearest((across - from) / scale + +low));
    });
    return [{ line, place: time => +from + scale * (time - low), low: +low, high: +high }];
  });
  const nearest = time => seconds.reduce((best, second, i) =>
    (Math.abs(second - time) < Math.abs(seconds[best] - time) ? i : best), 0);

  // Numbers below the drawing.
  const fixed = (value, decimals) => (value === null ? "–" : value.toFixed(decimals).replace("-", "\u2212"));
  const rows = new Map();
  const write = (name, text) => {
    if (!rows.has(name)) {
      const [term, value] = ["dt", "dd"].map(kind => document.createElement(kind));
      term.textContent = name;
      now.append(term, value);
      rows.set(name, value);
    }
    rows.get(name).textContent = text;
  };
  const clock = () => {
    let text = `${seconds[frame].toFixed(3)} s`;
    if (data.cycles) {
      const [number, start, period] = data.cycles;
      const degrees = Math.round(360 * (seconds[frame] - start) / period);
      const cycles = Math.floor(degrees / 360);
      text += number + cycles < 0 ? ", before the first cycle"
        : `, cycle ${number + cycles}, phase ${degrees - 360 * cycles}°`;
    }
    return text;
  };
  const describe = () => {
    write("Time", clock());
    for (const { name, unit, units, decimals, values } of quantities) {
      const all = values.map(of => (of[frame] === null ? null : of[frame] * units / data.per_unit));
      // Only quantities of wheels have as many values as the robot has links.
      const ofWheels = all.length === data.names.length;
      const shown = [...all.keys()].filter(i => !ofWheels || data.wheels[i] !== null);
      write([name, ...(ofWheels ? shown.map(wheel => data.names[wheel]) : [])].join(", "),
        `${shown.map(i => fixed(all[i], decimals)).join(", ")} ${unit}`);
    }
    const [first, second] = motions.map(motion => at(motion, frame, 0));
    if (motions.length > 1) {
      const deviation = first && second && [Math.hypot(second[0] - first[0], second[1] - first[1]) / 10,
        (second[2] - first[2]) / data.per_unit * 180 / Math.PI];
      write(`Deviation of ${motions[1].name}`, deviation ? `${fixed(deviation[0], 1)} mm, ${fixed(deviation[1], 1)}°` : "–");
    }
    if (data.marks.length) {
      const said = wanted => data.marks
        .filter(([from, to, , corrected]) => from <= frame && frame <= to && corrected === wanted)
        .map(([, , marker]) => data.markers[marker][2]).join(", ") || "none";
      write("Markers missing", said(0));
      write("Markers corrected", said(1));
    }
    slider.value = frame;
    slider.setAttribute("aria-valuetext", clock());
  };

  let [frame, part, playing] = [0, 0, false];
  const draw = () => {
    for (const { motion, group, links } of robots) {
      const coordinates = at(motion, frame, part);
      group.style.display = coordinates ? "" : "none";
      if (!coordinates) continue;
      poses(coordinates).forEach(([x, y, angle], i) => links[i].setAttribute("transform",
        `translate(${x.toFixed(1)} ${y.toFixed(1)})rotate(${(angle * 180 / Math.PI % 360).toFixed(3)})`));
    }
    for (const { quantity, values, path } of arrows) {
      const value = values[frame];
      path.setAttribute("d", value === null ? "" : pointer(Math.round(value * quantity.arrow), quantity.across));
    }
    for (const { use } of markers) use.setAttribute("display", "none");
    for (const [from, to, marker, corrected] of data.marks) {
      if (frame < from || frame > to) continue;
      const [{ use }, kind] = [markers[marker], corrected ? "corrected" : "missing"];
      use.removeAttribute("display");
      use.setAttribute("href", `#replay-${kind}`);
      use.setAttribute("class", `marker ${kind}`);
    }
    const time = seconds[frame] + part * (seconds[Math.min(frame + 1, last)] - seconds[frame]);
    for (const { line, place, low, high } of charts) {
      line.style.display = time < low || time > high ? "none" : "";
      for (const end of ["x1", "x2"]) line.setAttribute(end, place(time).toFixed(0));
    }
    if (buttons.follow.getAttribute("aria-pressed") === "true") follow();
  };
  const go = to => {
    [frame, part] = [Math.max(0, Math.min(last, to)), 0];
    draw();
    describe();
  };

  // Plays in real time, interpolating between frames; disabled if the user prefers reduced motion.
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  let [time, before] = [0, null];
  const play = wanted => {
    playing = wanted && !still.matches;
    if (playing && frame === last) go(0);
    [time, before] = [seconds[frame] + part * (seconds[Math.min(frame + 1, last)] - seconds[frame]), null];
    buttons.play.textContent = playing ? "❚❚" : "▶";
    buttons.play.setAttribute("aria-label", playing ? "Pause" : "Play");
    if (playing) requestAnimationFrame(tick);
    else go(frame);
  };
  const tick = stamp => {
    if (!playing) return;
    time += before === null ? 0 : (stamp - before) / 1000 * speed.value;
    before = stamp;
    if (time >= seconds[last]) {
      go(last);
      play(false);
      return;
    }
    const shown = frame;
    while (frame < last && seconds[frame + 1] <= time) frame += 1;
    part = (time - seconds[frame]) / (seconds[Math.min(frame + 1, last)] - seconds[frame]);
    draw();
    if (frame !== shown) describe();
    requestAnimationFrame(tick);
  };
  const reduce = () => {
    if (still.matches && playing) play(false);
    buttons.play.disabled = still.matches;
    buttons.play.title = still.matches ? "Playing is disabled, because your system asks for reduced motion; use the step buttons or the slider" : "";
  };
  const step = by => {
    if (playing) play(false);
    go(frame + by);
  };

  // Zooms and pans by changing the drawing's view box.
  const whole = svg.getAttribute("viewBox").split(" ").map(Number);
  let view = [...whole];
  const turn = DOMMatrix.fromMatrix(floor.transform.baseVal.consolidate().matrix);
  // Width of the view that follows the robot: some lengths of the robot.
  const near = 4.5 * data.length;
  const following = wanted => buttons.follow.setAttribute("aria-pressed", wanted);
  const look = wanted => {
    const [wide, high] = [2, 3].map(i => Math.max(whole[i] / 40, Math.min(whole[i], wanted[i])));
    // The centre of the view stays on the floor of the whole drawing.
    const [x, y] = [[0, wide], [1, high]].map(([i, span]) =>
      Math.max(whole[i] - 0.5 * span, Math.min(whole[i] + whole[i + 2] - 0.5 * span, wanted[i])));
    view = wide === whole[2] ? [...whole] : [x, y, wide, high];
    svg.setAttribute("viewBox", view.map(number => number.toFixed(1)).join(" "));
    svg.classList.toggle("near", wide < whole[2]);
    // Length of the scale bar, rounded to 1, 2 or 5 times a power of ten.
    const span = view[2] / 10;
    const decade = 10 ** Math.floor(Math.log10(span / 10));
    const bar = decade * [1, 2, 5, 10].find(step => step * decade >= span / 10);
    replay.style.setProperty("--view", span);
    replay.style.setProperty("--mm", bar);
    for (const length of replay.querySelectorAll(".length")) {
      length.textContent = +(bar * (length.dataset.perMm || 1)).toPrecision(3);
    }
  };
  const zoom = (factor, x = view[0] + view[2] / 2, y = view[1] + view[3] / 2) =>
    look([x + (view[0] - x) * factor, y + (view[1] - y) * factor, view[2] * factor, view[3] * factor]);
  const follow = () => {
    const coordinates = at(motions[0], frame, part);
    if (!coordinates) return;
    const { x, y } = new DOMPoint(...coordinates.slice(0, 2)).matrixTransform(turn);
    if (view[2] === whole[2]) view = [0, 0, near, near * whole[3] / whole[2]];
    look([x - view[2] / 2, y - view[3] / 2, view[2], view[3]]);
  };
  const place = event => new DOMPoint(event.clientX, event.clientY)
    .matrixTransform(svg.getScreenCTM().inverse());
  svg.addEventListener("wheel", event => {
    const factor = 1.0015 ** event.deltaY;
    if (factor >= 1 && view[2] === whole[2]) return;
    event.preventDefault();
    const { x, y } = place(event);
    zoom(factor, x, y);
  }, { passive: false });
  let held = null;
  svg.addEventListener("pointerdown", event => {
    held = view[2] < whole[2] && event.button === 0 ? place(event) : null;
    if (held) svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", event => {
    if (!held) return;
    following(false);
    const { x, y } = place(event);
    look([view[0] + held.x - x, view[1] + held.y - y, view[2], view[3]]);
  });
  for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => { held = null; });

  const acts = {
    play: () => play(!playing),
    back: () => step(-1),
    on: () => step(1),
    closer: () => zoom(1 / 1.5),
    farther: () => zoom(1.5),
    whole: () => { following(false); look(whole); },
    follow: () => { following(buttons.follow.getAttribute("aria-pressed") !== "true"); draw(); },
  };
  for (const [name, act] of Object.entries(acts)) buttons[name].addEventListener("click", act);
  slider.addEventListener("input", () => { if (playing) play(false); go(+slider.value); });
  replay.addEventListener("keydown", event => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target === speed) return;
    const keys = {
      " ": event.target.tagName === "BUTTON" ? null : acts.play,
      ArrowRight: acts.on, ArrowLeft: acts.back,
      Home: () => step(-last), End: () => step(last),
    };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
  still.addEventListener("change", reduce);
  controls.hidden = now.hidden = false;
  replay.classList.add("on");
  reduce();
  following(whole[2] > 1.2 * near);
  go(0);
});
