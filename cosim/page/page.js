"use strict";
// Unpacks library and figures, gives what all charts share to `build`, and draws with the function
// that it returns every [data-chart] and [data-view] that is not folded away, and others once they
// are unfolded.
const drawPage = async (build) => {
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
      outage: "rgba(213,94,0,0.20)", loss: "rgba(230,159,0,0.20)",
    },
    dark: {
      series: ["#56b4e9", "#e69f00", "#33c79b", "#e29ac2", "#f0e442", "#d5713a", "#dddddd"],
      ink: "#e6edf2", soft: "#9fb0bd", grid: "#2a3742", card: "#17212a",
      reference: "#e6edf2", limit: "#ff9a4d", start: "#33c79b", end: "#ff9a4d",
      outage: "rgba(255,154,77,0.26)", loss: "rgba(240,228,66,0.18)",
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

  const charts = [...document.querySelectorAll("[data-chart], [data-view]")];
  const drawn = new Set();
  const chart = build({ figures, theme, narrow, config, numbers, axes, common, axis, drawn });
  const draw = (div) => { chart(div); drawn.add(div); };

  // one after the other, so that the page answers meanwhile
  const folded = (div) => Boolean(div.closest("details:not([open])"));
  const queue = charts.filter((div) => !folded(div));
  const next = () => {
    const div = queue.shift();
    if (!div) { root.dataset.ready = "yes"; return; }
    if (!drawn.has(div)) draw(div);
    setTimeout(next, 0);
  };
  const all = () => charts.filter((div) => !folded(div) || drawn.has(div)).forEach(draw);
  const folds = [...document.querySelectorAll("details")];
  folds.forEach((part) => part.addEventListener("toggle", () => {
    if (part.open) charts.forEach((div) => {
      if (part.contains(div) && !drawn.has(div) && !folded(div)) draw(div);
    });
  }));
  // a link to a section unfolds it
  const unfold = () => {
    const part = location.hash ? document.getElementById(location.hash.slice(1)) : null;
    part?.querySelector(":scope > details")?.setAttribute("open", "");
  };
  window.addEventListener("hashchange", unfold);
  unfold();
  next();

  document.getElementById("theme").addEventListener("click", () => {
    const now = root.dataset.theme || (dark.matches ? "dark" : "light");
    root.dataset.theme = now === "dark" ? "light" : "dark";
    all();
  });
  dark.addEventListener("change", all);
  // on paper nothing can be unfolded: all of it is printed
  let unfolded = [];
  window.addEventListener("beforeprint", () => {
    printing = true;
    unfolded = folds.filter((part) => !part.open);
    unfolded.forEach((part) => { part.open = true; });
    all();
  });
  window.addEventListener("afterprint", () => {
    printing = false;
    unfolded.forEach((part) => { part.open = false; });
    all();
  });
};
