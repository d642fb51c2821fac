"use strict";
/* Response curves and the motions on them, drawn by Plotly from what hbgear.web.view writes. */
const hbgear = (() => {
  const DASH = { stable: "solid", unstable: "dash", undecided: "dot", unknown: "solid" };
  const WIDTH = { stable: 2, unstable: 1.8, undecided: 2.4, unknown: 1 };
  const SYMBOL = { o: "circle", "^": "triangle-up", v: "triangle-down", s: "square", D: "diamond", d: "diamond-tall",
                   "*": "star", X: "x", x: "x-thin-open", "+": "cross-thin-open", p: "pentagon", P: "cross",
                   h: "hexagon", ".": "circle", "<": "triangle-left", ">": "triangle-right" };
  const SANS = "system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif";
  const NARROW = 560, LOW = 400; // width and height [px] of the response below which the layout is that of a phone
  const state = { curves: [], behind: [], measure: "pp2", element: 0, theme: "light", at: null, frame: null, printing: false,
                  units: null };
  const PAPER = [700, 440], SMALL = [340, 230]; // size [px] of printed figures, equal to that in page.css
  let settings = null, busy = false, chosenMeasure = false;

  const $ = (id) => document.getElementById(id);
  const words = (text) => text.replace(/_sided/g, "-sided").replace(/_/g, " ");
  const palette = () => settings.palettes[state.theme];
  const short = (x, digits = 5) => (x === null || !isFinite(x) ? "–" : String(Number(Number(x).toPrecision(digits))));

  function floats(text) {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    return new Float32Array(bytes.buffer);
  }

  function prepared(curve) { // decode the base64 arrays once
    if (!curve.c) {
      curve.c = floats(curve.coefficients);
      if (curve.multipliers) {
        curve.re = floats(curve.multipliers.real);
        curve.im = floats(curve.multipliers.imag);
      }
    }
    return curve;
  }

  function physical(curves) { // speeds in r/min and lengths in um, if all curves have the same scales
    const same = (name) => curves.every((c) => c.scales[name] && Math.abs(c.scales[name] / curves[0].scales[name] - 1) < 1e-9);
    state.units = curves.length && same("rpm") && same("um") ? { ...curves[0].scales } : null;
    return state.units ? curves.map(converted) : curves;
  }

  function converted(curve) {
    const { rpm, um, Hz } = state.units, out = prepared({ ...curve }), times = (xs, k) => xs.map((x) => (x === null ? null : x * k));
    const length = (all) => Object.fromEntries(Object.entries(all).map(([m, of]) => [m, m in curve.axes ? of : of.map((y) => (Array.isArray(y) ? times(y, um) : y * um))]));
    const own = (of) => of && Object.fromEntries(Object.entries(of).map(([m, each]) => [m, m in curve.axes ? each : times(each, um)]));
    return { ...out, x: times(curve.x, rpm), asymptotes: times(curve.asymptotes, rpm), c: out.c.map((x) => x * um),
             breakpoints: curve.breakpoints.map((points) => times(points, um)), amplitudes: length(curve.amplitudes),
             top: curve.top && length(curve.top), special: curve.special.map((p) => ({ ...p, x: p.x * rpm, sizes: own(p.sizes) })),
             jumps: curve.jumps.map((j) => ({ ...j, x: j.x * rpm, before: own(j.before), after: own(j.after) })),
             parameter: "n", label: "speed of the pinion [r/min]", xUnit: " r/min", unit: "µm", motion: curve.motion.replace(/ \/ .*$/, ""),
             scales: { Hz: Hz / rpm, rpm: null } };
  }

  function usualMeasure() { // that of measured points, or the transmission error
    const given = state.behind.filter((b) => b.measure), dots = given.find((b) => b.mode === "markers") || given[0];
    const known = state.curves[0].amplitudes;
    if (dots && (dots.measure in known || /^H[1-9]/.test(dots.measure))) return dots.measure;
    if (state.behind.some((b) => b.sizes && !("dte" in b.sizes))) return "pp2"; // tori and backbones have no transmission error
    return "dte" in known && state.units && state.curves[0].meshes[elementOf(state.curves[0])] ? "dte" : "pp2";
  }

  function compared() { // measured points were added: show their measure
    if (!chosenMeasure && state.curves.length) { state.measure = usualMeasure(); fillControls(); }
    return redraw();
  }

  function behind() { // lines and dots behind the curves, in the units of the axes
    const first = state.curves[0], j = elementOf(first), { rpm, um } = state.units || { rpm: 1, um: 1 };
    const times = (xs, k) => xs.map((x) => (x === null ? null : x * k));
    const fits = (b) => (!b.measure || b.measure === state.measure) && (b.element === undefined || b.element === j || b.element === first.elements[j]);
    const own = (b) => (b.sizes ? (b.sizes[state.measure] || [])[Math.min(j, b.sizes.pp2.length - 1)] : fits(b) ? b.y : null); // others are not comparable
    const factor = (b) => (b.sizes && state.measure in first.axes ? 1 : um); // quantities with axes of their own have their unit
    return state.behind.map((b) => ({ ...b, x: times(b.x, rpm), y: own(b) && times(own(b), factor(b)), jumps: b.jumps && times(b.jumps, rpm) }));
  }

  function coefficientsAt(curve, i, element) { // a0, a1, b1, ... of an element at point i
    const width = 2 * curve.harmonics + 1, start = (i * curve.elements.length + element) * width;
    return prepared(curve).c.subarray(start, start + width);
  }

  const elementOf = (curve) => Math.min(state.element, curve.elements.length - 1);
  // end of the axis of a curve that goes to infinity; otherwise undefined, which no amplitude exceeds
  const endOf = (curve) => (curve.top && curve.top[state.measure] && curve.top[state.measure][elementOf(curve)]) || undefined;

  function sizes(curve) { // the shown measure at each point
    const j = elementOf(curve);
    if (curve.amplitudes[state.measure]) return curve.amplitudes[state.measure][j];
    const k = Number(state.measure.slice(1)) * curve.nu;
    return curve.x.map((_, i) => {
      const a = coefficientsAt(curve, i, j);
      return k > curve.harmonics ? null : Math.hypot(a[2 * k - 1], a[2 * k]);
    });
  }

  const size = (curve, all) => (state.measure in all ? all[state.measure][elementOf(curve)] : null);

  function measureText(curve) {
    const known = curve.measures[state.measure];
    return known || `amplitude of harmonic ${state.measure.slice(1)}`;
  }

  function pointText(curve, i, y) { // description of one point
    const lines = [`${curve.parameter} = ${short(curve.x[i], 6)}${curve.xUnit || ""}`];
    const { Hz, rpm } = curve.scales;
    if (rpm) lines.push(`${short(curve.x[i] * rpm)} r/min`);
    if (Hz) lines.push(`${short(curve.x[i] * Hz)} Hz mesh`);
    lines.push(`${state.measure} = ${short(y)}${unitOf(curve)}`, curve.stability[i]);
    if (curve.regimes[i] !== "unknown") lines.push(words(curve.regimes[i]));
    if (curve.multipliers) lines.push(`largest |μ| = ${short(curve.multipliers.largest[i])}`);
    return lines;
  }

  /* ---- the response */

  function curveTraces() {
    const many = state.curves.length > 1, traces = [], legend = new Map(), ink = palette();
    state.curves.forEach((curve, n) => {
      const y = sizes(curve), groups = new Map(), line = hbgearLines.smooth(curve.x, y);
      const hover = y.map((v, i) => (many ? `<b>${escaped(nameOf(curve))}</b><br>` : "") + pointText(curve, i, v).join("<br>"));
      for (const [regime, stability, first, last] of curve.sections[elementOf(curve)]) {
        const key = `${regime}|${stability}`;
        if (!groups.has(key)) groups.set(key, { regime, stability, x: [], y: [], text: [], points: [] });
        const g = groups.get(key);
        if (g.x.length) { g.x.push(null); g.y.push(null); g.text.push(""); g.points.push(null); }
        const drawn = line(first, last);
        g.x.push(...drawn.x); g.y.push(...drawn.y);
        for (const i of drawn.point) { g.text.push(hover[i]); g.points.push([n, i]); }
      }
      const own = ink.branches[n % ink.branches.length];
      for (const g of groups.values()) {
        const color = many ? own : ink.regimes[g.regime];
        const width = many ? (settings.widths[g.regime] * WIDTH[g.stability]) / 1.4 : WIDTH[g.stability];
        traces.push({ x: g.x, y: g.y, text: g.text, customdata: g.points, mode: "lines", hoverinfo: "text",
                      line: { color, width, dash: DASH[g.stability] }, showlegend: false });
        if (many) entry(legend, `branch ${n}`, nameOf(curve), { color: own, width: 2.5 });
        else if (g.regime !== "unknown") entry(legend, g.regime, words(g.regime), { color, width: 2 });
        if (many && g.regime !== "unknown")
          entry(legend, `~${g.regime}`, words(g.regime), { color: ink.line, width: settings.widths[g.regime] * 1.4 });
        if (g.stability === "unstable" || g.stability === "undecided")
          entry(legend, `~~${g.stability}`, g.stability, { color: ink.line, width: 2, dash: DASH[g.stability] });
      }
    });
    const entries = [...legend.entries()].sort(([a], [b]) => (a.startsWith("~") - b.startsWith("~")) || 0);
    return [...traces, ...entries.map(([, trace]) => trace)];
  }

  function entry(legend, key, name, line) {
    if (!legend.has(key))
      legend.set(key, { x: [null], y: [null], mode: "lines", name: escaped(name), line, showlegend: true, hoverinfo: "skip" });
  }

  function specialTraces() {
    const kinds = new Map(), ink = palette(), many = state.curves.length > 1;
    state.curves.forEach((curve, n) => {
      const y = sizes(curve);
      for (const point of curve.special) {
        const key = `${point.kind} ${!!point.certified}`; // certified points have filled symbols and an entry of their own
        if (!kinds.has(key)) kinds.set(key, { point, x: [], y: [], text: [], hover: [], points: [] });
        const k = kinds.get(key), v = size(curve, point.sizes) ?? y[point.index];
        k.x.push(point.x); k.y.push(v); k.points.push([n, point.index]);
        k.text.push(point.kind === "GR" ? "" : point.label + (many ? ` (${n + 1})` : "")); // grazing points are many and have no label
        k.hover.push(`<b>${point.label}</b> ${escaped(point.meaning)}<br>${curve.parameter} = ${short(point.x, 7)}${curve.xUnit || ""}` +
                     (curve.scales.rpm ? `<br>${short(point.x * curve.scales.rpm)} r/min` : "") +
                     `<br>${state.measure} = ${short(v)}${unitOf(curve)}` +
                     (point.certified ? `<br>${escaped(point.certified)}` : ""));
      }
    });
    placeLabels([...kinds.values()]);
    return [...kinds.values()].map((k) => ({
      x: k.x, y: k.y, text: k.text, hovertext: k.hover, customdata: k.points, mode: "markers+text", hoverinfo: "text",
      textposition: k.side, textfont: { size: 11, color: ink.text }, name: escaped(k.point.meaning),
      cliponaxis: false,
      marker: markerOf(SYMBOL[k.point.marker] || "circle", ink, k.point.certified),
    }));
  }

  const markerOf = (symbol, ink, filled) => ({ symbol, size: 9, color: filled || symbol.endsWith("open") ? ink.text : ink.paper,
                                       line: { color: ink.text, width: filled ? 2.4 : 1.4 } });

  const SIDES = [["top center", 0, 1], ["middle right", 1, 0], ["middle left", -1, 0], ["bottom center", 0, -1],
                 ["top right", 1, 1], ["top left", -1, 1], ["bottom right", 1, -1], ["bottom left", -1, -1]];

  function placeLabels(kinds) { // each on the side where it covers no symbol or label and the fewest points of lines; else only the hover text shows it
    const [low, high] = state.frame || span(), all = kinds.flatMap((k) => k.y).filter((y) => y !== null);
    const bound = topOf() || Infinity, heights = state.curves.flatMap((c) => sizes(c)).filter((y) => y !== null && y <= bound);
    const top = Math.max(...heights, ...all.filter((y) => y <= bound)) || 1;
    const wide = 0.75 * $("response").clientWidth || 700, tall = 0.72 * $("response").clientHeight || 380, taken = [];
    const at = (x, y) => [((x - low) / (high - low)) * wide, (y / top) * tall];
    kinds.forEach((k) => k.x.forEach((x, i) => { const [px, py] = at(x, k.y[i]); taken.push([px - 5, px + 5, py - 5, py + 5]); }));
    if (state.at) { // the ring of the selected point
      const [n, i] = state.at, [px, py] = at(state.curves[n].x[i], sizes(state.curves[n])[i]);
      taken.push([px - 6, px + 6, py - 6, py + 6]);
    }
    const lines = drawnPoints().map(([x, y]) => at(x, y));
    const covered = ([x0, x1, y0, y1]) => lines.filter(([x, y]) => x > x0 && x < x1 && y > y0 && y < y1).length;
    const order = [...kinds].sort((a, b) => (a.point.kind === "GR") - (b.point.kind === "GR"));
    for (const k of order) {
      k.side = [];
      k.text = k.text.map((text, i) => {
        const [px, py] = at(k.x[i], k.y[i]), w = 6.6 * text.length, h = 13;
        let best = null;
        for (const [side, dx, dy] of SIDES) {
          const x = px + dx * (dy ? w / 2 : w / 2 + 7), y = py + dy * 13, box = [x - w / 2, x + w / 2, y - h / 2, y + h / 2];
          if (taken.some((t) => box[0] < t[1] && t[0] < box[1] && box[2] < t[3] && t[2] < box[3])) continue;
          const count = covered(box);
          if (!best || count < best.count) best = { side, box, count };
          if (!count) break;
        }
        k.side.push(best ? best.side : "top center");
        if (best) taken.push(best.box);
        return best ? text : "";
      });
    }
  }

  function drawnPoints() { // points of curves and jump arrows, between which a label does not fit
    const out = [], PARTS = 5;
    const line = (x0, y0, x1, y1, parts) => {
      for (let s = 0; s < parts; s++) out.push([x0 + ((x1 - x0) * s) / parts, y0 + ((y1 - y0) * s) / parts]);
    };
    for (const curve of state.curves) {
      const y = sizes(curve);
      for (let i = 1; i < y.length; i++) if (y[i - 1] !== null && y[i] !== null) line(curve.x[i - 1], y[i - 1], curve.x[i], y[i], PARTS);
      for (const jump of curve.jumps.filter((each) => each.after)) line(jump.x, size(curve, jump.before), jump.x, size(curve, jump.after), 60);
    }
    return out;
  }

  function topOf() { // upper limit of the axes if a curve goes to infinity
    const tops = state.curves.map(endOf);
    const known = tops.filter((x) => x);
    return known.length ? Math.max(...known) : null;
  }

  function jumpArrows() {
    const ink = palette();
    return state.curves.flatMap((curve) => curve.jumps.filter((jump) => jump.after).flatMap((jump) => {
      const from = size(curve, jump.before), to = size(curve, jump.after);
      if (from === null || to === null) return [];
      return [{ x: jump.x, y: to, ax: jump.x, ay: from, xref: "x", yref: "y", axref: "x", ayref: "y", showarrow: true,
                arrowhead: 2, arrowsize: 1.2, arrowwidth: 1.4, arrowcolor: ink.text, opacity: 0.75, text: "",
                hovertext: `jump at ${short(jump.x, 7)}` }];
    }));
  }

  function nameOf(curve) { // without the beginning that all names share, such as "Gear pair 25/40, m = 3 mm, "
    const parts = state.curves.map((each) => each.name.split(", ")), own = curve.name.split(", ");
    let same = 0;
    while (same < own.length - 1 && parts.every((each) => each.length > same + 1 && each[same] === own[same])) same += 1;
    return own.slice(same).join(", ");
  }

  const escaped = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;");

  function span() { // range of the parameter with a margin
    const all = state.curves.flatMap((curve) => curve.x).concat(behind().flatMap((b) => b.x)).filter((x) => x !== null);
    const low = all.reduce((a, b) => Math.min(a, b)), high = all.reduce((a, b) => Math.max(a, b));
    const margin = 0.02 * (high - low) || 0.05 * Math.abs(high) || 1;
    return [low - margin, high + margin];
  }

  function common(name) { // a scale that all curves share
    const all = state.curves.map((curve) => curve.scales[name]);
    return all[0] && all.every((x) => x && Math.abs(x / all[0] - 1) < 1e-9) ? all[0] : null;
  }

  function axis(title, more = {}) {
    const ink = palette();
    return { title: { text: title, font: { size: 13 }, standoff: 8 }, gridcolor: ink.grid, linecolor: ink.line, zeroline: false,
             showline: true, automargin: true, ticks: "outside", ticklen: 4, tickcolor: ink.line, ...more };
  }

  function layoutOf(more) {
    const ink = palette();
    return { paper_bgcolor: ink.paper, plot_bgcolor: ink.paper, font: { family: SANS, size: 12, color: ink.text }, separators: ".",
             margin: { l: 62, r: 14, t: 14, b: 48 }, hovermode: "closest", dragmode: "zoom", uirevision: "kept",
             hoverlabel: { bgcolor: ink.paper, bordercolor: ink.line, font: { color: ink.text } }, ...more };
  }

  const unitText = (curve) => (state.units ? ` [${curve.unit}]` : curve.unit === "1" ? " [-]" : "");

  function heightText(curve) { // label of the vertical axis
    return curve.axes[state.measure] || `${measureText(curve)} of ${curve.motion}${unitText(curve)}`;
  }

  function unitOf(curve) { // of the shown measure, after a number
    const found = heightText(curve).match(/\[([^[\]]*)\]$/);
    return found && found[1] !== "-" ? ` ${found[1]}` : "";
  }

  function responseFigure() {
    const first = state.curves[0], rpm = common("rpm"), Hz = common("Hz"), range = state.frame || span();
    const narrow = !state.printing && $("response").clientWidth < NARROW, ink = palette();
    const low = ($("response").clientHeight || 520) < LOW; // space for one axis only, and a label of two lines
    const layout = layoutOf({
      xaxis: axis(first.label, { range: [...range], ...(state.units ? { exponentformat: "none" } : {}) }),
      yaxis: axis(low ? heightText(first).replace(", ", ",<br>") : heightText(first), { rangemode: "tozero" }),
      annotations: jumpArrows(),
      shapes: state.curves.flatMap((curve) => curve.asymptotes.map((x) => ({ type: "line", x0: x, x1: x, yref: "paper", y0: 0, y1: 1,
        line: { color: ink.line, width: 1, dash: "dot" } }))),
      showlegend: !(narrow && document.body.classList.contains("explorer")),
      legend: narrow ? { orientation: "h", y: -0.22, x: 0 } : { x: 1.01, y: 1, xanchor: "left", tracegroupgap: 2 },
    });
    if (topOf()) layout.yaxis.range = [0, topOf()];
    const shown = behind().filter((b) => b.y), asymptote = layout.shapes[0];
    layout.shapes.push(...shown.flatMap((b) => (b.jumps || []).map((x) => ({ type: "line", x0: x, x1: x, yref: "paper", y0: 0, y1: 1,
      line: { color: ink.text, width: 0.8, dash: "dot" } }))));
    const lines = shown.map((b) => ({ ...(b.sizes ? hbgearLines.smoothParts(b.x, b.y) : { x: b.x, y: b.y }), mode: b.mode, name: escaped(b.name), hoverinfo: "x+y+name",
      line: b.kind ? { color: b.kind === "tori" ? ink.branches[0] : ink.text, width: 1.6, dash: b.dash } : { color: ink.line, width: 0.8 },
      opacity: b.mode === "lines" && !b.kind ? 0.5 : 1, showlegend: b.mode !== "lines" || b.legend === true,
      marker: { symbol: b.symbol || "circle-open", size: 6, color: ink.text } }));
    const data = [...lines, ...curveTraces(), ...specialTraces()];
    if (asymptote) data.push({ x: [null], y: [null], mode: "lines", name: "asymptote", hoverinfo: "skip", line: { ...asymptote.line } });
    if (layout.annotations.length)
      data.push({ x: [null], y: [null], mode: "markers", name: "jump", hoverinfo: "skip",
                  marker: { symbol: "triangle-up", size: 9, color: ink.text } });
    if (state.at) data.push(chosenTrace());
    let above = 0;
    for (const [scale, title] of [[low ? null : Hz, "mesh frequency [Hz]"], [rpm, "speed of the pinion [r/min]"]]) {
      if (!scale) continue;
      above += 1;
      layout[`xaxis${above + 1}`] = axis(title, {
        overlaying: "x", side: "top", range: range.map((x) => x * scale), showgrid: false, fixedrange: true, tickmode: "auto",
        nticks: narrow ? 4 : 8, exponentformat: "none",
        ...(above === 1 ? { anchor: "y" } : { anchor: "free", position: 1 }),
      });
      data.push({ x: [null], y: [null], xaxis: `x${above + 1}`, yaxis: "y", showlegend: false, hoverinfo: "skip" });
    }
    const tall = state.printing ? PAPER[1] : $("response").clientHeight || 520;
    if (above === 2) layout.yaxis.domain = [0, 1 - 62 / (tall - 110 - (narrow ? 150 : 0))];
    layout.margin.t = above ? 52 : 36;
    sized(layout, PAPER);
    return { data, layout, scales: [low ? null : Hz, rpm].filter((x) => x) };
  }

  function sized(layout, [width, height]) { // fixed size on paper, otherwise the size of the container
    Object.assign(layout, state.printing ? { width, height, autosize: false } : { autosize: true });
    return layout;
  }

  function chosenTrace() {
    const [n, i] = state.at, curve = state.curves[n], ink = palette();
    return { x: [curve.x[i]], y: [sizes(curve)[i]], mode: "markers", hoverinfo: "skip", showlegend: false, cliponaxis: false,
             marker: { symbol: "circle-open", size: 12, color: ink.text, line: { width: 1.6 } } };
  }

  // Only these buttons: others of Plotly upload the data to its servers.
  const BUTTONS = [["toImage"], ["zoom2d", "pan2d"], ["zoomIn2d", "zoomOut2d", "autoScale2d", "resetScale2d"]];
  const CONFIG = { displaylogo: false, responsive: true, modeBarButtons: BUTTONS, plotlyServerURL: "", sendData: false,
                   showSendToCloud: false, showEditInChartStudio: false, showLink: false,
                   toImageButtonOptions: { format: "svg", filename: "hbgear" } };

  function drawResponse() {
    const figure = responseFigure(), div = $("response");
    busy = true;
    const config = { ...CONFIG, displayModeBar: div.clientWidth < NARROW ? false : "hover" };
    const done = Plotly.react(div, figure.data, figure.layout, config).then(() => { busy = false; return div; });
    div.scalesAbove = figure.scales;
    if (!div.listens) {
      div.listens = true;
      div.on("plotly_click", (event) => {
        const point = event.points.map((p) => p.customdata).find((c) => Array.isArray(c));
        if (point) choose(point[0], point[1]);
      });
      div.on("plotly_relayout", (event) => {
        const moved = Object.keys(event).some((key) => key.startsWith("xaxis."));
        if (busy || !moved) return;
        state.frame = event["xaxis.autorange"] ? null : [...div.layout.xaxis.range];
        const range = state.frame || span(), change = { "xaxis.range": range };
        div.scalesAbove.forEach((scale, k) => { change[`xaxis${k + 2}.range`] = range.map((x) => x * scale); });
        busy = true;
        Plotly.relayout(div, change).then(() => { busy = false; });
      });
      div.addEventListener("keydown", stepped);
    }
    return done;
  }

  function stepped(event) { // arrow keys move along the curve
    const steps = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageUp: 10, PageDown: -10 };
    if (!state.at || !(event.key in steps)) return;
    event.preventDefault();
    const [n, i] = state.at, last = state.curves[n].x.length - 1;
    choose(n, Math.max(0, Math.min(last, i + steps[event.key])));
  }

  /* ---- one motion */

  function motion(curve, i, element, count) {
    const a = coefficientsAt(curve, i, element), time = state.units ? 1e-3 * state.units.rate : 1, // velocities in mm/s
          rate = (time * (curve.Omega[i] === null ? 1 : curve.Omega[i])) / curve.nu;
    const out = { periods: [], d: [], v: [] };
    for (let s = 0; s <= count; s++) {
      const theta = (2 * Math.PI * s) / count;
      let d = a[0], v = 0;
      for (let k = 1; k <= curve.harmonics; k++) {
        const c = Math.cos(k * theta), z = Math.sin(k * theta);
        d += a[2 * k - 1] * c + a[2 * k] * z;
        v += k * (a[2 * k] * c - a[2 * k - 1] * z);
      }
      out.periods.push((curve.nu * s) / count); out.d.push(d); out.v.push(rate * v);
    }
    return out;
  }

  function breakpointLines(curve, element, d, vertical) {
    const low = Math.min(...d), high = Math.max(...d), reach = high - low || 1, ink = palette();
    return curve.breakpoints[element].filter((x) => low - reach <= x && x <= high + reach).map((x) => ({
      type: "line", line: { color: ink.line, width: 1, dash: "dot" }, layer: "below",
      ...(vertical ? { x0: x, x1: x, yref: "paper", y0: 0, y1: 1 } : { y0: x, y1: x, xref: "paper", x0: 0, x1: 1 }),
    }));
  }

  function small(id, traces, layout) {
    const whole = layoutOf({ margin: { l: 58, r: 10, t: 8, b: 42 }, showlegend: false, ...layout });
    return Plotly.react($(id), traces, sized(whole, SMALL),
                        { ...CONFIG, displayModeBar: false });
  }

  function drawMotion() {
    if (!state.at || !$("time")) return Promise.resolve();
    const [n, i] = state.at, curve = state.curves[n], j = elementOf(curve), ink = palette();
    const regime = curve.sections[j].find(([, , first, last]) => first <= i && i <= last)[0];
    const color = state.curves.length > 1 ? ink.branches[n % ink.branches.length] : ink.regimes[regime];
    const m = motion(curve, i, j, Math.min(2048, 16 * curve.harmonics + 256)), line = { color, width: 1.6 };
    const a = coefficientsAt(curve, i, j), name = curve.motion, unit = unitText(curve);
    const order = [], height = [];
    for (let k = 1; k <= curve.harmonics; k++) { order.push(k / curve.nu); height.push(Math.hypot(a[2 * k - 1], a[2 * k])); }
    const top = Math.max(...height) || 1, floor = top * 1e-6, stems = { x: [], y: [] };
    order.forEach((x, k) => { if (height[k] >= floor) { stems.x.push(x, x, null); stems.y.push(floor, height[k], null); } });
    const marks = order.map((x, k) => [x, height[k]]).filter(([, h]) => h >= floor);
    const jobs = [
      small("time", [{ x: m.periods, y: m.d, mode: "lines", line, hoverinfo: "x+y" }],
            { xaxis: axis("excitation periods [-]"), yaxis: axis(name + unit), shapes: breakpointLines(curve, j, m.d, false) }),
      small("phase", [{ x: m.d, y: m.v, mode: "lines", line, hoverinfo: "x+y" }],
            { xaxis: axis(name + unit), yaxis: axis(`velocity of ${name}${state.units ? " [mm/s]" : unit}`), shapes: breakpointLines(curve, j, m.d, true) }),
      small("spectrum", [{ x: stems.x, y: stems.y, mode: "lines", line, hoverinfo: "skip" },
                         { x: marks.map((p) => p[0]), y: marks.map((p) => p[1]), mode: "markers", marker: { color, size: 5 }, hoverinfo: "x+y" }],
            { xaxis: axis("excitation order [-]", { rangemode: "tozero" }),
              yaxis: axis(`amplitude of ${name}${unit}`, { type: "log", exponentformat: "power", dtick: 1, tickfont: { size: 10 }, minor: { ticks: "" }, range: [Math.log10(floor), Math.log10(3 * top)] }) }),
    ];
    const circle = { x: [], y: [] };
    for (let s = 0; s <= 120; s++) { circle.x.push(Math.cos((2 * Math.PI * s) / 120)); circle.y.push(Math.sin((2 * Math.PI * s) / 120)); }
    const mu = { x: [], y: [], text: [], color: [] };
    if (curve.multipliers) {
      prepared(curve);
      for (let r = 0; r < curve.multipliers.count; r++) {
        const x = curve.re[i * curve.multipliers.count + r], y = curve.im[i * curve.multipliers.count + r];
        mu.x.push(x); mu.y.push(y); mu.text.push(`|μ| = ${short(Math.hypot(x, y))}`);
        mu.color.push(Math.hypot(x, y) > 1 + 1e-6 ? ink.regimes.double_sided : color);
      }
    }
    const far = 1.15 * Math.max(1, ...mu.x.map(Math.abs).filter(isFinite), ...mu.y.map(Math.abs).filter(isFinite));
    jobs.push(small("multipliers", [
      { ...circle, mode: "lines", line: { color: ink.line, width: 1 }, hoverinfo: "skip" },
      { x: mu.x, y: mu.y, text: mu.text, mode: "markers", hoverinfo: "text", marker: { color: mu.color, size: 7, symbol: "x" } },
    ], { xaxis: axis("Re μ [-]", { range: [-far, far], constrain: "domain" }), yaxis: axis("Im μ [-]", { scaleanchor: "x", range: [-far, far] }) }));
    const label = curve.special.find((p) => p.index === i);
    $("chosen").textContent = [label ? `${label.label}, ${label.meaning}` : null, state.curves.length > 1 ? nameOf(curve) : null,
      ...pointText(curve, i, sizes(curve)[i])].filter((x) => x).join("; ");
    return Promise.all(jobs);
  }

  function choose(n, i) {
    state.at = [n, i];
    document.dispatchEvent(new CustomEvent("hbgear:chosen", { detail: state.at }));
    return Promise.all([drawResponse(), drawMotion()]);
  }

  function firstChoice() { // the largest stable motion of the first curve that is not beyond the axis, on its way to infinity
    const y = sizes(state.curves[0]), top = endOf(state.curves[0]);
    const points = y.map((v, i) => i).filter((i) => y[i] !== null && !(y[i] > top));
    const stable = points.filter((i) => state.curves[0].stability[i] === "stable");
    return [0, (stable.length ? stable : points).reduce((best, i) => (y[i] > y[best] ? i : best), stable[0] ?? points[0] ?? 0)];
  }

  /* ---- the page */

  function options(select, values, chosen) {
    select.replaceChildren(...values.map(([value, text]) => new Option(text, value, false, String(value) === String(chosen))));
  }

  function fillControls() {
    const first = state.curves[0], H = Math.min(Math.floor(first.harmonics / first.nu), 6);
    const measures = Object.entries(first.measures).filter(([key]) => state.curves.every((curve) => key in curve.measures));
    for (let k = 1; k <= H; k++) measures.push([`H${k}`, `amplitude of harmonic ${k}`]);
    options($("measure"), measures.map(([key, text]) => [key, `${text} (${key})`]), state.measure);
    options($("element"), first.elements.map((name, j) => [j, name]), state.element);
    $("element").parentElement.hidden = first.elements.length < 2;
  }

  function setTheme(theme) {
    state.theme = theme;
    document.documentElement.dataset.theme = theme;
  }

  function formOf() {
    const div = $("response");
    return `${div.clientWidth < NARROW} ${div.clientHeight < LOW}`;
  }

  function redraw() {
    return Promise.all([drawResponse(), drawMotion()]);
  }

  function show(curves, motionToo = true) { // replace the curves
    const kept = state.at && state.curves[state.at[0]] ? state.curves[state.at[0]].x[state.at[1]] : null;
    curves = state.curves = physical(curves);
    if (!chosenMeasure) state.measure = usualMeasure();
    if (state.at) { // the point nearest to the previous selection
      const n = Math.min(state.at[0], curves.length - 1), x = curves[n].x;
      let best = 0;
      if (kept === null) best = firstChoice()[1];
      else x.forEach((v, i) => { if (Math.abs(v - kept) < Math.abs(x[best] - kept)) best = i; });
      state.at = [n, best];
    } else state.at = firstChoice();
    fillControls();
    return motionToo ? redraw() : drawResponse();
  }

  function begin(data, given) {
    settings = given;
    state.behind = data.behind || [];
    setTheme(window.matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
    $("measure").addEventListener("change", (event) => { state.measure = event.target.value; chosenMeasure = true; redraw(); });
    $("element").addEventListener("change", (event) => { state.element = Number(event.target.value); compared(); });
    $("theme").addEventListener("click", () => { setTheme(state.theme === "dark" ? "light" : "dark"); redraw(); });
    let before = null;
    window.addEventListener("beforeprint", () => {
      before = state.theme;
      state.printing = true;
      setTheme("light");
      document.querySelectorAll("details").forEach((each) => { each.open = true; });
      redraw();
    });
    window.addEventListener("afterprint", () => { state.printing = false; if (before) setTheme(before); redraw(); });
    let form = formOf();
    window.addEventListener("resize", () => { // orientation of a phone: legend and axes have other positions
      if (state.printing || formOf() === form || !state.curves.length) return;
      form = formOf();
      redraw();
    });
    return data.curves && data.curves.length ? show(data.curves) : Promise.resolve();
  }

  return { begin, show, redraw, compared, choose, state, short, escaped, layoutOf, axis, palette, drawMotion, CONFIG };
})();
