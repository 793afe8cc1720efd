drawPage(({ figures, theme, narrow, config, numbers, common, axis }) => {
  const columns = Object.fromEntries(Object.entries(figures.columns).map(([name, column]) =>
    [name, { ...column, values: numbers(column.values) }]));
  const runs = figures.runs;
  const kinds = {
    "finished": (k, y) => Number.isFinite(y[k]) && figures.tones[k] === "good",
    "flagged": (k, y) => Number.isFinite(y[k]) && figures.tones[k] === "open",
    "no result": (k, y) => Number.isFinite(y[k]) && figures.tones[k] === "bad",
    "no value": (k, y) => !Number.isFinite(y[k]),
  };

  const colour = (role, t) => typeof role === "number" ? t.series[role % t.series.length] : t[role];
  const faded = (hex, share) => hex + Math.round(255 * share).toString(16).padStart(2, "0");
  const scales = (t) => ({
    map: "Viridis",
    signed: [[0, t.series[1]], [0.5, t.card], [1, t.series[0]]],
    unstable: [[0, faded(t.limit, 0.25)], [1, faded(t.limit, 0.85)]],
  });

  const plain = (text) => String(text).replaceAll("&", "&amp;").replaceAll("<", "&lt;");
  const words = (column, value) => column.words ? column.words[value] : value;
  const filled = (trace) => {
    const { x, y, of } = trace.meta.points;
    const a = columns[x], b = columns[y];
    const kept = runs.map((_, k) => k)
      .filter((k) => Number.isFinite(a.values[k]) && kinds[of](k, b.values));
    const gone = of === "no value";
    return {
      ...trace,
      x: kept.map((k) => a.values[k]),
      y: kept.map((k) => gone ? 0.02 : b.values[k]),
      visible: kept.length > 0,
      hovertemplate: "%{text}<extra></extra>",
      text: kept.map((k) => [`run ${runs[k]}: ${figures.statuses[k]}`,
        `${x} = ${words(a, a.values[k])}`, `${y} = ${gone ? "–" : words(b, b.values[k])}`,
      ].map(plain).join("<br>")),
    };
  };
  const dressed = (given, t) => {
    const out = given.meta.points ? filled(given) : { ...given };
    const c = colour(given.meta.role, t);
    if (given.type === "heatmap") {
      out.colorscale = scales(t)[given.meta.scale];
      out.hoverongaps = false;
      out.colorbar = { thickness: 12, outlinewidth: 0, tickfont: { color: t.soft },
        ...given.colorbar };
      if (given.texttemplate) out.textfont = { size: narrow() ? 9 : 11 };
      return out;
    }
    out.marker = { ...given.marker, color: c };
    if (given.type === "bar") out.marker.line = { width: 0.5, color: t.card };
    else out.line = { ...given.line, color: c };
    if (given.meta.points && given.meta.role === 0) out.marker.opacity = runs.length > 300 ? 0.4 : 0.75;
    if (given.fill) out.fillcolor = faded(c, given.meta.share ?? 0.2);
    if (given.error_y) out.error_y = { ...given.error_y, color: given.type === "bar" ? t.ink : c };
    return out;
  };
  const titled = (t, given) => axis(t, {
    exponentformat: "power", ...given, title: { text: given.title, standoff: 6 } });

  const plot = (div, figure) => {
    const t = theme();
    const data = figure.data.map((trace) => dressed(trace, t));
    const { xaxis, yaxis, yaxis2, ...rest } = figure.layout;
    const layout = Object.assign(common(t), {
      hovermode: "closest",
      dragmode: narrow() ? "pan" : "zoom",
      bargap: 0.25,
      showlegend: data.filter((trace) => trace.name && trace.visible !== false
        && trace.showlegend !== false).length > 1,
      ...rest,
      xaxis: titled(t, xaxis),
      yaxis: titled(t, yaxis),
    });
    if (yaxis2) layout.yaxis2 = yaxis2;
    Plotly.react(div, data, layout, config);
  };

  // any column over any other ----------------------------------------------------------------
  const explored = document.querySelector("[data-chart=explore]");
  const picked = (id) => document.getElementById(id).value;
  const ticks = (column) => column.words ? {
    tickvals: column.words.map((_, k) => k), ticktext: column.words.map((w) => plain(w.slice(0, 18))),
  } : {};
  const explore = () => {
    const x = picked("explore-x"), y = picked("explore-y");
    const points = (role, of, symbol) => ({ type: "scatter", mode: "markers", name: of,
      meta: { role, points: { x, y, of } }, marker: { size: 5.5, symbol } });
    plot(explored, {
      data: [points(0, "finished", "circle"), points(1, "flagged", "x"),
        points(3, "no result", "triangle-up-open"),
        { ...points("limit", "no value", "line-ns-open"), yaxis: "y2" }],
      layout: { xaxis: { title: plain(columns[x].title), ...ticks(columns[x]) }, yaxis: { title: plain(columns[y].title), ...ticks(columns[y]) },
        yaxis2: { overlaying: "y", range: [0, 1], visible: false, fixedrange: true } },
    });
  };
  if (explored) ["explore-x", "explore-y"].forEach((id) =>
    document.getElementById(id).addEventListener("change", explore));

  // the runs with the largest or smallest values of a metric ------------------------------------
  const table = document.getElementById("worst-runs");
  const cell = (row, text, kind) => {
    const made = row.insertCell();
    if (kind) made.className = kind;
    made.textContent = text;
    return made;
  };
  const rank = () => {
    const metric = picked("worst-metric"), { worst } = figures;
    const order = worst.order[metric][picked("worst-order")];
    const names = worst.axes[metric];
    const head = table.tHead.rows[0];
    head.replaceChildren();
    for (const [name, numeric] of [["run", true], [metric, true], ["status", false],
      ...names.map((name) => [name, true]), ["one alone", false]]) {
      const title = document.createElement("th");
      title.textContent = name;
      if (numeric) title.className = "n";
      head.append(title);
    }
    const body = table.tBodies[0];
    body.replaceChildren();
    for (const run of order.slice(0, Number(picked("worst-count")))) {
      const found = worst.runs[run], row = body.insertRow();
      const first = cell(row, found.trace ? "" : run, "n");
      if (found.trace) {
        const link = document.createElement("a");
        link.href = found.trace;
        link.textContent = run;
        first.append(link);
      }
      cell(row, found.values[metric], "n");
      cell(row, found.status);
      names.forEach((name) => cell(row, found.values[name], "n"));
      cell(row, "").append(Object.assign(document.createElement("code"),
        { className: "line", textContent: `${figures.repeat} ${run}` }));
    }
  };
  if (table) ["worst-metric", "worst-order", "worst-count"].forEach((id) =>
    document.getElementById(id).addEventListener("change", rank));

  return (div) => div === explored ? explore() : plot(div, figures.charts[div.dataset.chart]);
});
