// The vehicle along its path: where it is at a time, and what its links deliver then. Nothing moves
// until it is asked to; who wants less motion goes on in steps.
const animation = ({ figures, paths, numbers, theme }) => {
  const panel = document.getElementById("motion");
  const path = paths.length === 1 && paths[0].line;
  if (!panel || !path || !path.t || path.t.length < 2) return { shapes: () => [] };
  const [play, slider, readout] = ["play", "moment", "pose"].map((id) => document.getElementById(id));
  const first = path.t[0], last = path.t[path.t.length - 1], length = last - first;
  const still = window.matchMedia("(prefers-reduced-motion: reduce)");
  const SECONDS = 20; // a whole run
  const STEPS = 24;
  let t = first, playing = false, before = 0;

  const lastNotAfter = (times, at) => {
    let low = 0, high = times.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] <= at) low = middle + 1; else high = middle;
    }
    return low - 1;
  };
  const poseAt = (at) => {
    const k = Math.min(Math.max(lastNotAfter(path.t, at), 0), path.t.length - 2);
    const step = path.t[k + 1] - path.t[k];
    const share = step > 0 ? Math.min((at - path.t[k]) / step, 1) : 1;
    return Object.fromEntries(["x", "y", "z", "psi"].map((name) =>
      [name, path[name][k] + share * (path[name][k + 1] - path[name][k])]));
  };

  // a hull that points to the heading, of the same size however far one zooms
  const hull = [[15, 0], [5, 6], [-12, 6], [-15, 0], [-12, -6], [5, -6]];
  const shapes = () => {
    const { x, y, psi } = poseAt(t), colours = theme();
    const north = Math.cos(psi), east = Math.sin(psi);
    const corners = hull.map(([ahead, aside]) =>
      `${(ahead * east + aside * north).toFixed(1)},${(ahead * north - aside * east).toFixed(1)}`);
    return [{ type: "path", path: `M${corners.join("L")}Z`, xsizemode: "pixel", ysizemode: "pixel",
      xanchor: y, yanchor: x, fillcolor: colours.reference,
      line: { color: colours.card, width: 1.5 } }];
  };

  // the links: a strip of time each, and what was last
  const at = (time) => 1000 * (time - first) / (length || 1);
  const drawing = (tag, attributes) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
    Object.entries(attributes).forEach(([name, value]) => made.setAttribute(name, value));
    return made;
  };
  const strips = figures.links.map((link) => {
    const [delivered, dropped] = [numbers(link.delivered), numbers(link.dropped)];
    const row = document.createElement("div");
    const name = row.appendChild(document.createElement("span"));
    name.textContent = link.name;
    const strip = row.appendChild(drawing("svg", { viewBox: "0 0 1000 14",
      preserveAspectRatio: "none", "aria-hidden": "true" }));
    link.spans.forEach(([kind, begin, end]) => strip.append(drawing("rect", { class: kind,
      x: at(begin), width: Math.max(at(end) - at(begin), 1), y: 0, height: 14 })));
    strip.append(drawing("path", { class: "drops",
      d: Array.from(dropped, (time) => `M${at(time).toFixed(1)} 0V14`).join("") }));
    const cursor = strip.appendChild(drawing("rect", { class: "cursor", width: 4, y: 0,
      height: 14 }));
    const state = row.appendChild(document.createElement("b"));
    document.getElementById("link-states").append(row);
    return { link, delivered, dropped, cursor, state };
  });
  const stateOf = ({ link, delivered, dropped }) => {
    if (link.spans.some(([kind, begin, end]) => kind === "outage" && begin <= t && t < end))
      return "outage";
    const [got, lost] = [delivered, dropped].map((times) => {
      const k = lastNotAfter(times, t);
      return k < 0 ? -Infinity : times[k];
    });
    if (got === -Infinity && lost === -Infinity) return "waiting";
    return got >= lost ? "delivered" : "dropped";
  };

  const seconds = (time) => `${Number(time.toPrecision(5))} s`;
  const show = () => {
    const pose = poseAt(t), metres = (value) => `${value.toFixed(2)} m`;
    const degrees = ((pose.psi * 180 / Math.PI) % 360).toFixed(1);
    const words = `t = ${seconds(t)} · north ${metres(pose.x)} · east ${metres(pose.y)} · `
      + `depth ${metres(pose.z)} · heading ${degrees}°`;
    readout.textContent = words;
    slider.value = t;
    const states = strips.map((strip) => {
      const found = stateOf(strip);
      strip.state.textContent = found;
      strip.state.className = found;
      strip.cursor.setAttribute("x", at(t) - 2);
      return `${strip.link.name}: ${found}`;
    });
    slider.setAttribute("aria-valuetext", [words, ...states].join(", "));
    const plan = document.getElementById("plan");
    if (plan.layout) Plotly.relayout(plan, { shapes: shapes() });
  };

  const label = () => {
    play.textContent = still.matches ? "Step" : playing ? "Pause" : "Play";
    play.setAttribute("aria-pressed", String(playing));
  };
  const stop = () => { playing = false; label(); };
  const frame = (now) => {
    if (!playing) return;
    t = Math.min(t + (now - before) / 1000 * length / SECONDS, last);
    before = now;
    show();
    if (t < last) requestAnimationFrame(frame); else stop();
  };
  play.addEventListener("click", () => {
    if (playing) { stop(); return; }
    if (t >= last) t = first;
    else if (still.matches) t = Math.min(t + length / STEPS, last);
    if (still.matches) { show(); return; }
    playing = true;
    label();
    requestAnimationFrame((now) => { before = now; frame(now); });
  });
  still.addEventListener("change", stop);
  slider.addEventListener("input", () => { stop(); t = Number(slider.value); show(); });
  window.addEventListener("beforeprint", stop);
  Object.assign(slider, { min: first, max: last, step: length / 1000 });
  panel.hidden = false;
  label();
  show();
  return { shapes };
};
