"use strict";
(async () => {
  const root = document.documentElement;
  const bytesOf = (base64) => Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
  const unpacked = (id) => new Response(
    new Blob([bytesOf(document.getElementById(id).textContent)]).stream()
      .pipeThrough(new DecompressionStream("gzip"))).text();
  let figures;
  try {
    const library = document.createElement("script"); // runs only if it has the policy's hash
    library.textContent = await unpacked("library");
    figures = JSON.parse(await unpacked("figures"));
    document.head.append(library);
    if (typeof Plotly === "undefined") throw new Error("the library did not start");
  } catch (error) {
    const note = document.getElementById("undrawn");
    note.textContent = typeof DecompressionStream === "undefined"
      ? "The charts need a newer browser, which can unpack them (DecompressionStream: Chromium 80, "
        + "Firefox 113, Safari 16.4); everything else of this report is complete."
      : `The charts cannot be drawn: ${error.message}. Everything else of this report is complete.`;
    note.hidden = false;
    document.querySelector("main").prepend(note);
    root.dataset.ready = "undrawn";
    return;
  }
  // Okabe and Ito's colours, told apart by all kinds of eyes; chosen for either background
  const themes = {
    light: {
      series: ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#333333"],
      ink: "#16222c", soft: "#566673", grid: "#e3e9ee", card: "#ffffff",
      reference: "#16222c", limit: "#b34700", start: "#009e73", end: "#d55e00",
    },
    dark: {
      series: ["#56b4e9", "#e69f00", "#33c79b", "#e29ac2", "#f0e442", "#d5713a", "#dddddd"],
      ink: "#e6edf2", soft: "#9fb0bd", grid: "#2a3742", card: "#17212a",
      reference: "#e6edf2", limit: "#ff9a4d", start: "#33c79b", end: "#ff9a4d",
    },
  };
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  let printing = false;
  const theme = () => {
    const chosen = printing ? "light" : root.dataset.theme;
    return themes[chosen || (dark.matches ? "dark" : "light")];
  };
  const narrow = () => window.innerWidth < 640;
  const pointed = window.matchMedia("(hover: hover)").matches && !narrow();
  const config = {
    responsive: true,
    displaylogo: false,
    displayModeBar: pointed ? "hover" : false, // without a mouse it would never go away
    showSendToCloud: false, // nothing of a run leaves the page
    plotlyServerURL: "",
    modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"],
    toImageButtonOptions: { format: "svg" },
  };

  const numbers = (packed) => {
    const bytes = bytesOf(packed.bdata);
    return packed.dtype === "f8" ? new Float64Array(bytes.buffer) : new Float32Array(bytes.buffer);
  };
  const axes = (packed) => Object.fromEntries(
    Object.entries(packed).filter(([, v]) => v && v.bdata).map(([k, v]) => [k, numbers(v)]));

  const common = (t) => ({
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: t.ink, size: narrow() ? 11 : 12, family: "system-ui, sans-serif" },
    hoverlabel: { bgcolor: t.card, bordercolor: t.grid, font: { color: t.ink } },
    legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0, bgcolor: "rgba(0,0,0,0)" },
    modebar: { bgcolor: "rgba(0,0,0,0)", color: t.soft, activecolor: t.ink, orientation: "v" },
    margin: { l: 58, r: 34, t: 34, b: 42 },
    uirevision: "kept",
  });
  const axis = (t, more) => Object.assign({
    gridcolor: t.grid, zerolinecolor: t.grid, linecolor: t.soft, tickcolor: t.soft,
    automargin: true,
  }, more);

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

  // charts over time ------------------------------------------------------------------------
  let shown = figures.span.slice();
  const overTime = [...document.querySelectorAll("[data-chart]")];
  const drawn = new Set();

  const timeChart = (div) => {
    const t = theme();
    const figure = figures.charts[div.dataset.chart];
    const data = figure.data.map((trace) => dressed(trace, t));
    const layout = Object.assign(common(t), {
      hovermode: "x",
      dragmode: narrow() ? "pan" : "zoom",
      showlegend: data.length > 1,
      xaxis: axis(t, { title: { ...figure.layout.xaxis.title, standoff: 6 }, range: shown.slice() }),
      yaxis: axis(t, { title: figure.layout.yaxis.title, exponentformat: "power" }),
    });
    layout.xaxis.uirevision = String(shown);
    Plotly.react(div, data, layout, config);
    if (!drawn.has(div)) {
      drawn.add(div);
      div.on("plotly_relayout", (change) => follow(change));
    }
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
    const all = [...drawn].map((div) => Plotly.relayout(div, {
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
  const lengths = () => ["x", "y", "z"].map((k) => {
    let low = Infinity, high = -Infinity;
    for (const { line } of paths)
      for (const v of line[k]) { if (v < low) low = v; if (v > high) high = v; }
    return high - low;
  });
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
  const plan = () => {
    const t = theme();
    const place = (p) => ({ x: p.y, y: p.x });
    Plotly.react("plan", pathTraces(t, place, { type: "scatter" }), Object.assign(common(t), {
      hovermode: "closest", dragmode: "pan",
      xaxis: axis(t, { title: { text: "east y", standoff: 6 } }),
      yaxis: axis(t, { title: { text: "north x" }, scaleanchor: "x", scaleratio: 1 }),
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
        xaxis: side("east y"), yaxis: side("north x"),
        zaxis: side("depth z", { autorange: "reversed" }),
        aspectmode: trueToScale() ? "data" : "cube",
        camera: { eye: { x: 1.3, y: -1.55, z: 0.9 } }, uirevision: "kept",
      },
    }), config);
  };

  // all of it, one after the other, so that the page answers meanwhile ------------------------
  const tasks = [];
  if (paths.length) tasks.push(plan, space);
  overTime.forEach((div) => tasks.push(() => timeChart(div)));
  const visible = (div) => !div.closest("details:not([open])");
  const folded = overTime.filter((div) => !visible(div));
  const all = () => {
    if (paths.length) { plan(); space(); }
    overTime.filter((div) => visible(div) || drawn.has(div)).forEach(timeChart);
  };
  const queue = tasks.filter((_, i) => {
    const div = overTime[i - (paths.length ? 2 : 0)];
    return !div || !folded.includes(div);
  });
  const next = () => {
    const task = queue.shift();
    if (!task) { root.dataset.ready = "yes"; return; }
    task();
    setTimeout(next, 0);
  };
  document.querySelectorAll("details").forEach((part) => part.addEventListener("toggle", () => {
    if (part.open) part.querySelectorAll("[data-chart]").forEach((div) => {
      if (!drawn.has(div)) timeChart(div);
    });
  }));
  next();

  document.getElementById("theme").addEventListener("click", () => {
    const now = root.dataset.theme || (dark.matches ? "dark" : "light");
    root.dataset.theme = now === "dark" ? "light" : "dark";
    all();
  });
  dark.addEventListener("change", all);
  window.addEventListener("beforeprint", () => { printing = true; all(); });
  window.addEventListener("afterprint", () => { printing = false; all(); });
})();
