// Draws the figures whose numbers lie in the page as JSON (see interactive.py for their form). Nothing is fetched.
"use strict";
(() => {
  const NARROW_PX = 600;
  const CONFIG = {
    displaylogo: false,
    doubleClick: "reset",
    // plotly's own button that sends the figure to a server is on by default.
    showSendToCloud: false,
    plotlyServerURL: "",
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
    toImageButtonOptions: { format: "svg" },
  };

  const narrow = () => document.documentElement.clientWidth < NARROW_PX;

  // The trace that plotly draws: columns by name become its coordinates, `magnified` ones are worked out.
  function trace(spec, source, axis, factor) {
    const { columns = {}, hover = [], magnified, ...drawn } = source;
    for (const [attribute, name] of Object.entries(columns)) {
      drawn[attribute] = spec.columns[typeof name === "string" ? name : name[axis]];
    }
    if (hover.length) {
      const shown = hover.map((name) => spec.columns[name]);
      drawn.customdata = shown[0].map((_, row) => shown.map((column) => column[row]));
    }
    if (drawn.textfont && narrow()) drawn.textfont = { ...drawn.textfont, size: 10.5 };
    return magnified ? { ...drawn, ...enlarged(magnified, factor) } : drawn;
  }

  function enlarged({ x, y, dx, dy }, factor) {
    const moved = (from, by) => from.map((value, i) => (value === null || by[i] === null ? null : value + factor * by[i]));
    return { x: moved(x, dx), y: moved(y, dy) };
  }

  // Rows of the legend: plotly makes all its columns as wide as the widest.
  function legendRows(spec, width) {
    const entries = spec.data.filter((source) => source.showlegend !== false).map(({ name }) => 46 + 7 * name.length);
    const room = width - spec.layout.margin.l - spec.layout.margin.r;
    if (entries.reduce((sum, entry) => sum + entry, 0) < room) return 1;
    return Math.ceil(entries.length / Math.max(1, Math.floor(room / Math.max(...entries))));
  }

  // The legend has its room below the axis; a map keeps the shape of its site.
  function size(spec, width) {
    const { margin } = spec.layout;
    const below = 56 + 20 * legendRows(spec, width);
    const map = Math.min(Math.max((width - margin.l - margin.r) * spec.aspect, 260), 720);
    const inner = spec.aspect ? Math.round(map) : spec.height_px;
    return { width, height: inner + margin.t + below, margin: { ...margin, b: below } };
  }

  // Dotted lines with the names of the visits. A name that would run into its left neighbour is left out; zooming in
  // brings it back.
  function lines({ spec, axis }, [low, high], width) {
    const at = spec.columns[spec.lines.at[axis]];
    const scale = (width - spec.layout.margin.l - spec.layout.margin.r) / (high - low);
    const right = scale * (high - low);
    const label = { textposition: "end", textangle: 0, yanchor: "bottom" };
    const names = at.map(() => ({ ...label, text: "" }));
    let free = -Infinity;
    for (const i of at.map((_, row) => row).sort((i, j) => at[i] - at[j])) {
      const half = 3.8 * spec.lines.text[i].length;
      const centre = scale * (at[i] - low);
      const atEdge = centre + half > right; // stays inside the figure
      if (at[i] < low || at[i] > high || centre - (atEdge ? 2 : 1) * half < free) continue;
      names[i] = { ...label, text: spec.lines.text[i], xanchor: atEdge ? "right" : "center" };
      free = centre + half + 6;
    }
    const line = { color: "#888888", width: 1, dash: "dot" };
    const across = { type: "line", yref: "paper", y0: 0, y1: 1, layer: "below", line };
    return at.map((x, i) => ({ ...across, x0: x, x1: x, label: names[i] }));
  }

  function fitLines(figure) {
    if (!figure.spec.lines) return;
    const { layout } = figure.div;
    const shapes = lines(figure, layout.xaxis.range, layout.width);
    const said = (list) => list.map(({ label }) => label.text).join("\n");
    if (said(shapes) !== said(layout.shapes)) Plotly.relayout(figure.div, { shapes });
  }

  function slider(figure) {
    const { spec, div, tools } = figure;
    const { factors, start, label } = spec.magnify;
    const input = document.createElement("input");
    const shown = document.createElement("output");
    Object.assign(input, { type: "range", min: 0, max: factors.length - 1, step: 1, value: factors.indexOf(start) });
    const which = spec.data.flatMap((source, i) => (source.magnified ? [i] : []));
    const say = () => {
      const factor = factors[input.value];
      shown.textContent = factor === 1 ? "true to scale" : `magnified ${factor} times`;
      input.setAttribute("aria-valuetext", shown.textContent);
      return factor;
    };
    input.addEventListener("input", () => {
      const factor = say();
      const moved = which.map((i) => enlarged(spec.data[i].magnified, factor));
      Plotly.restyle(div, { x: moved.map((m) => m.x), y: moved.map((m) => m.y) }, which);
    });
    const box = document.createElement("label");
    box.append(`${label} `, input, " ", shown);
    tools.append(box);
    say();
  }

  function axisButtons(figure) {
    const { spec, div, tools } = figure;
    const said = document.createElement("span");
    said.textContent = "Horizontal axis: ";
    tools.append(said);
    const buttons = Object.entries(spec.axes).map(([axis, { name }]) => {
      const button = document.createElement("button");
      Object.assign(button, { type: "button", textContent: name });
      button.addEventListener("click", () => show(axis));
      tools.append(button, " ");
      return [axis, button];
    });
    const press = () => buttons.forEach(([axis, b]) => b.setAttribute("aria-pressed", String(axis === figure.axis)));
    function show(axis) {
      figure.axis = axis;
      press();
      const x = spec.data.map((source) => spec.columns[source.columns.x[axis]]);
      const { title, range, head } = spec.axes[axis];
      const layout = { "xaxis.title.text": title, "xaxis.range": [...range], "xaxis.unifiedhovertitle.text": head };
      Plotly.Fx.unhover(div, {}, "xy", true);
      if (spec.lines) layout.shapes = lines(figure, range, div.layout.width);
      Plotly.update(div, { x }, layout);
    }
    press();
  }

  function draw(box) {
    const spec = JSON.parse(box.querySelector("script").textContent);
    const div = document.createElement("div");
    const tools = document.createElement("div");
    tools.className = "tools";
    div.className = "plot";
    box.prepend(tools, div);
    box.closest(".either").classList.add("drawn"); // shown before it is drawn, so that it has a width
    const figure = { spec, div, tools, group: box.dataset.group, axis: spec.axes ? Object.keys(spec.axes)[0] : "" };
    const data = spec.data.map((source) => trace(spec, source, figure.axis, spec.magnify ? spec.magnify.start : 1));
    const layout = { ...spec.layout, ...size(spec, div.clientWidth) };
    if (spec.lines) layout.shapes = lines(figure, spec.layout.xaxis.range, layout.width);
    if (narrow()) {
      layout.dragmode = false; // a finger on the figure moves the page
      layout.xaxis = { ...layout.xaxis, nticks: 4, tickangle: 0 };
    }
    try {
      Plotly.newPlot(div, data, layout, CONFIG);
    } catch (error) {
      box.closest(".either").classList.remove("drawn"); // the picture without JavaScript comes back
      throw error;
    }
    if (spec.magnify) slider(figure);
    if (spec.axes) axisButtons(figure);
    div.on("plotly_relayout", () => fitLines(figure));
    return figure;
  }

  // What the pointer is over in one figure is pointed at in the other figures of the same path.
  function link(figures) {
    for (const from of figures) {
      const others = figures.filter((f) => f !== from && f.group === from.group && f.spec.linked !== undefined);
      if (!from.group || from.spec.linked === undefined || !others.length) continue;
      from.div.on("plotly_hover", ({ points }) => {
        const here = points.find((p) => p.curveNumber === from.spec.linked);
        if (!here) return;
        for (const to of others) {
          const there = [{ curveNumber: to.spec.linked, pointNumber: here.pointNumber }];
          Plotly.Fx.hover(to.div, there, "xy", true); // true: without an event of its own, which would come back
        }
      });
      from.div.on("plotly_unhover", () => others.forEach((to) => Plotly.Fx.unhover(to.div, {}, "xy", true)));
    }
  }

  function fit(figure) {
    const width = figure.div.parentElement.clientWidth;
    if (!width || width === figure.div.layout.width) return;
    Plotly.relayout(figure.div, size(figure.spec, width));
  }

  const figures = [];
  for (const box of document.querySelectorAll(".interactive")) {
    try {
      figures.push(draw(box));
    } catch (error) {
      console.error(`${box.getAttribute("aria-label")}: ${error.stack}`);
    }
  }
  link(figures);
  let waiting = 0;
  window.addEventListener("resize", () => {
    cancelAnimationFrame(waiting);
    waiting = requestAnimationFrame(() => figures.forEach(fit));
  });
})();
