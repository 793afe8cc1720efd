drawPage(({ figures, theme, narrow, config, numbers, axes, common, axis, drawn }) => {
  const dressed = (trace, t) => {
    const role = trace.meta.role;
    const colour = typeof role === "number" ? t.series[role % t.series.length] : t[role];
    const out = { ...trace };
    if (trace.mode === "markers") {
      out.marker = { symbol: "x-thin", size: 7, line: { width: 1.6, color: colour } };
      out.cliponaxis = false;
    } else {
      out.line = { ...trace.line, color: colour };
      if (role === "reference") out.line.dash = "dash";
    }
    return out;
  };

  // where links deliver nothing, behind the curves
  const shades = (t) => (figures.spans ?? []).map(([kind, x0, x1]) => ({
    type: "rect", layer: "below", xref: "x", yref: "paper", x0, x1, y0: 0, y1: 1,
    line: { width: 0 }, fillcolor: kind === "outage" ? t.outage : t.loss }));

  // charts over time ------------------------------------------------------------------------
  let shown = figures.span.slice();

  const timeChart = (div) => {
    const t = theme();
    const figure = figures.charts[div.dataset.chart];
    const data = figure.data.map((trace) => dressed(trace, t));
    const layout = Object.assign(common(t), {
      hovermode: "x",
      dragmode: narrow() ? "pan" : "zoom",
      showlegend: data.length > 1,
      xaxis: axis(t, { title: { ...figure.layout.xaxis.title, standoff: 6 }, range: shown.slice() }),
      yaxis: axis(t, { title: { ...figure.layout.yaxis.title, standoff: 8 },
        exponentformat: "power" }),
      shapes: shades(t),
    });
    layout.xaxis.uirevision = String(shown);
    Plotly.react(div, data, layout, config);
    if (!drawn.has(div)) div.on("plotly_relayout", (change) => follow(change));
  };

  let following = false;
  const follow = (change) => {
    if (following) return;
    const from = change["xaxis.range[0]"] ?? change["xaxis.range"]?.[0];
    const to = change["xaxis.range[1]"] ?? change["xaxis.range"]?.[1];
    if (change["xaxis.autorange"]) show(figures.span);
    else if (from !== undefined) show([Number(from), Number(to)]);
  };
  const show = (range) => {
    shown = range.slice();
    const fields = [document.getElementById("from"), document.getElementById("to")];
    fields.forEach((field, i) => { if (field) field.value = Number(shown[i].toPrecision(8)); });
    following = true;
    const charts = [...drawn].filter((div) => div.dataset.chart);
    const all = charts.map((div) => Plotly.relayout(div, {
      "xaxis.range": shown.slice(), "xaxis.uirevision": String(shown) }));
    Promise.all(all).finally(() => { following = false; });
  };

  const bar = document.getElementById("window");
  if (bar) {
    const wanted = () => show([Number(bar.from.value), Number(bar.to.value)]);
    bar.addEventListener("change", () => {
      if (Number(bar.from.value) < Number(bar.to.value)) wanted();
    });
    bar.addEventListener("submit", (event) => event.preventDefault());
    const moves = {
      in: (a, b) => [a + (b - a) / 4, b - (b - a) / 4],
      out: (a, b) => [a - (b - a) / 2, b + (b - a) / 2],
      back: (a, b) => [a - (b - a) / 4, b - (b - a) / 4],
      on: (a, b) => [a + (b - a) / 4, b + (b - a) / 4],
      all: () => figures.span,
    };
    bar.querySelectorAll("[data-move]").forEach((button) =>
      button.addEventListener("click", () => show(moves[button.dataset.move](...shown))));
    show(shown);
  }

  // the path --------------------------------------------------------------------------------
  const paths = figures.paths.map((path) => ({ ...path, line: axes(path) }));
  const several = paths.length > 1;
  const reference = paths.find((path) => path.reference)?.reference;
  const wanted = reference && axes(reference);
  const rangeOf = (lines, k) => {
    let low = Infinity, high = -Infinity;
    for (const line of lines)
      for (const v of line[k]) { if (v < low) low = v; if (v > high) high = v; }
    return [low, high];
  };
  const lengths = () => ["x", "y", "z"].map((k) => {
    const [low, high] = rangeOf(paths.map(({ line }) => line), k);
    return high - low;
  });
  // fixed, so that nothing moves but the vehicle
  const padded = (k) => {
    const [low, high] = rangeOf([...paths.map(({ line }) => line), ...(wanted ? [wanted] : [])], k);
    const pad = 0.08 * Math.max(...lengths()) || 1;
    return [low - pad, high + pad];
  };
  const trueToScale = () => Math.max(...lengths()) < 8 * Math.min(...lengths());
  const strokes = (path) => {
    const [north, east, depth] = lengths();
    const size = 0.06 * (Math.max(north, east) || depth || 1);
    const out = { x: [], y: [], z: [] };
    for (const [x, y, z, psi] of path.headings) {
      out.x.push(x, x + size * Math.cos(psi), null);
      out.y.push(y, y + size * Math.sin(psi), null);
      out.z.push(z, z, null);
    }
    return out;
  };
  // `place` puts north, east, depth on the axes of a drawing
  const pathTraces = (t, place, kind) => {
    const line = (name, p, colour, more) => ({
      name, mode: "lines", ...kind, ...place(p), hoverinfo: "text",
      text: Array.from(p.x, (x, i) => x === null ? "" :
        `${p.t ? `t = ${p.t[i].toPrecision(5)} s<br>` : ""}north ${x.toPrecision(4)} m<br>` +
        `east ${p.y[i].toPrecision(4)} m<br>depth ${p.z[i].toPrecision(4)} m`),
      line: { color: colour, width: kind.type === "scatter3d" ? 4 : 1.8, ...more } });
    const mark = (name, [x, y, z], colour, symbol) => ({
      name, mode: "markers", ...kind, ...place({ x: [x], y: [y], z: [z] }), hoverinfo: "text",
      text: [`${name}<br>north ${x} m<br>east ${y} m<br>depth ${z} m`],
      marker: { color: colour, symbol, size: kind.type === "scatter3d" ? 6 : 11 } });
    const out = [];
    if (wanted) out.push(line("reference", wanted, t.reference, { dash: "dash", width: 2 }));
    for (const path of paths) {
      const colour = t.series[path.role], own = several ? `, ${path.name}` : "";
      out.push(line(path.name, path.line, colour, {}));
      if (!several) out.push(line("heading", strokes(path), t.series[1], { width: 2 }));
      out.push(mark(`start${own}`, path.start, several ? colour : t.start, "circle"));
      out.push(mark(`end${own}`, path.end, several ? colour : t.end, "square"));
    }
    const target = paths.find((path) => path.target)?.target;
    if (target) out.push(mark("set point", target, t.reference, "cross"));
    return out;
  };
  const motion = animation({ figures, paths, numbers, theme });
  const plan = () => {
    const t = theme();
    const place = (p) => ({ x: p.y, y: p.x });
    Plotly.react("plan", pathTraces(t, place, { type: "scatter" }), Object.assign(common(t), {
      hovermode: "closest", dragmode: "pan", shapes: motion.shapes(),
      xaxis: axis(t, { title: { text: "east y [m]", standoff: 6 }, range: padded("y") }),
      yaxis: axis(t, { title: { text: "north x [m]", standoff: 8 }, range: padded("x"), scaleanchor: "x", scaleratio: 1 }),
    }), { ...config, scrollZoom: !narrow() });
  };
  const canDrawSpace = (() => {
    try {
      const canvas = document.createElement("canvas");
      const gl = canvas.getContext("webgl2") || canvas.getContext("webgl");
      gl?.getExtension("WEBGL_lose_context")?.loseContext();
      return Boolean(gl);
    } catch { return false; }
  })();
  const space = () => {
    const t = theme();
    if (!canDrawSpace) { // no WebGL: the same path, seen from the south-west and above
      const c = Math.cos(Math.PI / 6), s = 0.5;
      const place = (p) => ({
        x: Array.from(p.x, (x, i) => x === null ? null : (p.y[i] - x) * c),
        y: Array.from(p.x, (x, i) => x === null ? null : (p.y[i] + x) * s - p.z[i]) });
      Plotly.react("space", pathTraces(t, place, { type: "scatter" }), Object.assign(common(t), {
        hovermode: "closest", dragmode: "pan",
        xaxis: axis(t, { showticklabels: false, zeroline: false,
          title: { text: "isometric view: north to the upper left, east to the upper right" } }),
        yaxis: axis(t, { showticklabels: false, zeroline: false, scaleanchor: "x" }),
      }), config);
      return;
    }
    const place = (p) => ({ x: p.y, y: p.x, z: p.z });
    const side = (text, more) => Object.assign({ title: { text }, gridcolor: t.grid,
      zerolinecolor: t.grid, backgroundcolor: t.card, showbackground: true, color: t.soft }, more);
    Plotly.react("space", pathTraces(t, place, { type: "scatter3d" }), Object.assign(common(t), {
      margin: { l: 0, r: 0, t: 34, b: 0 },
      scene: {
        xaxis: side("east y [m]"), yaxis: side("north x [m]"),
        zaxis: side("depth z [m]", { autorange: "reversed" }),
        aspectmode: trueToScale() ? "data" : "cube",
        // far enough away that the titles of the axes are whole
        camera: { eye: { x: 1.55, y: -1.85, z: 1.05 }, center: { x: 0, y: 0, z: -0.12 } },
        uirevision: "kept",
      },
    }), config);
  };

  const views = { plan, space };
  return (div) => (views[div.dataset.view] ?? timeChart)(div);
});
