/* The explorer: sliders request curves, and the page shows the newest result. */
const explorer = (() => {
  const $ = (id) => document.getElementById(id);
  const session = crypto.randomUUID ? crypto.randomUUID() : String(Math.random());
  const LONG = 0.4; // time [s] above which a superseded computation is cancelled
  const now = { values: {}, from: 0, to: 0, harmonics: 16 };
  const timings = []; // time [ms] from the move of a slider to the new curve
  const past = [], future = [];
  let data = null, token = "", flying = 0, quiet = 0, wanted = false, newest = 0, shownSerial = 0, took = 0, before = null, started = 0, last = {};

  async function asked(path, body, raw = false) {
    const answer = await fetch(path, { method: "POST", body: JSON.stringify(body),
      headers: { "Content-Type": "application/json", "X-Hbgear-Token": token } });
    if (answer.status === 204) return null; // superseded or cancelled
    if (raw && answer.headers.has("X-Name")) return answer;
    const found = await answer.json().catch(() => ({ error: `the server answered ${answer.status}` }));
    if (!answer.ok || found.error) throw new Error(found.error || `the server answered ${answer.status}`);
    return found;
  }

  const question = () => ({ session, values: { ...now.values }, span: [now.from, now.to], harmonics: now.harmonics });

  function say(text, wrong = false) {
    $("status").textContent = text;
    $("status").className = wrong ? "warning" : "quiet";
  }

  /* ---- the curve */

  function compute() { // immediately, or after a short computation that is running
    if (flying && took < LONG && performance.now() - started < 1000 * LONG) { wanted = true; return Promise.resolve(); }
    return send();
  }

  async function send() {
    const serial = ++newest, moved = now.moved || performance.now();
    now.moved = null; wanted = false; flying += 1; started = performance.now();
    const watch = setTimeout(() => follow("curve"), 500);
    try {
      const found = await asked("/curve", question());
      if (!found || serial < shownSerial) return;
      shownSerial = serial; took = found.seconds;
      await hbgear.show(found.curves, false);
      describeRange();
      timings.push(performance.now() - moved);
      clearTimeout(quiet);
      quiet = setTimeout(() => rest(found, serial), 80);
    } catch (error) {
      if (serial === newest) say(`${error.message}; the previous curve is shown`, true);
    } finally {
      clearTimeout(watch);
      flying -= 1;
      if (!flying) $("work").hidden = true;
      if (wanted && !flying) send();
    }
  }

  const perOmega = () => (hbgear.state.units ? hbgear.state.units.rpm : 1); // value of Ω = 1 in the fields
  let filled = 1; // perOmega() of the values in the fields

  function describeRange() { // in the units of the figure
    if (perOmega() !== filled) { // known with the first curve, and another one for another module or width
      fill();
      for (const id of ["mapx", "mapy"]) if ($(id).value === "Omega") mapRange(id);
    }
  }

  async function rest(found, serial) { // when no slider moves: motion and tables of the curve
    await hbgear.drawMotion();
    const details = await asked("/details", question()).catch(() => null);
    if (details && serial === newest) describe(found, details);
  }

  function describe(found, details) {
    const jumps = found.curves.reduce((sum, curve) => sum + curve.jumps.length, 0);
    $("title").textContent = details.model; // in words, with the values of the sliders
    const many = details.tables.length > 1, points = found.curves.reduce((sum, curve) => sum + curve.x.length, 0);
    const reliability = details.tables.flatMap((table, n) => table.reliability.map((line) => many ? `Branch ${n + 1}: ${line.charAt(0).toLowerCase()}${line.slice(1)}` : line));
    const parts = [`${points} points in ${found.seconds.toPrecision(2)} s; ${jumps} jump${jumps === 1 ? "" : "s"}`, ...reliability];
    if (found.ended) parts.push(found.ended);
    say(parts.join(". "), details.tables.some((table) => table.reliability.some((line) => line.startsWith("warning"))) || Boolean(found.ended));
    $("python").textContent = details.python;
    const headers = details.tables[0].jumpTable[0], rows = details.tables.flatMap((table, n) => table.jumpTable[1].map(([label, ...others]) => [many ? `${label} (${n + 1})` : label, ...others])), cell = (tag, text) => Object.assign(document.createElement(tag), { textContent: text });
    const line = (tag, texts) => { const row = document.createElement("tr"); row.append(...texts.map((t) => cell(tag, t))); return row; };
    $("jumps").replaceChildren(...(rows.length ? [line("th", headers), ...rows.map((row) => line("td", row))] : [line("td", ["none"])]));
  }

  async function follow(kind) { // progress of a long computation
    const bar = kind === "curve" ? $("work") : null;
    const answer = await fetch(`/progress?session=${session}&kind=${kind}`, { headers: { "X-Hbgear-Token": token } });
    const found = await answer.json();
    if (bar && found.busy && flying) {
      bar.hidden = false;
      if (found.done === null) $("done").removeAttribute("value"); else $("done").value = found.done;
      $("doing").textContent = found.text || "computing";
    }
    if (found.busy) {
      if (kind === "map") $("mapstatus").textContent = found.text || "computing";
      setTimeout(() => follow(kind), 300);
    }
  }

  /* ---- parameters */

  function parameterRow(p) {
    const row = document.createElement("div"), id = `p-${p.name}`;
    row.className = "parameter";
    row.dataset.words = `${p.name} ${p.label} ${p.unit}`.toLowerCase();
    row.innerHTML = `<label for="${id}">${p.label} <code></code></label><input type="range" aria-label="slider"><span><input type="number" step="any" id="${id}"> <span class="unit"></span></span>`;
    row.querySelector("code").textContent = p.name;
    row.querySelector(".unit").textContent = p.unit.replace(/\bum\b/g, "µm").replace(/\^2/g, "²").replace(/\^3/g, "³");
    const slider = row.querySelector("input[type=range]"), field = row.querySelector("input[type=number]");
    slider.setAttribute("aria-label", `${p.name} as a slider`);
    p.slider = slider; p.field = field;
    fitSlider(p, p.value);
    slider.addEventListener("input", () => { remember(); set(p.name, Number(slider.value)); moved(); });
    slider.addEventListener("change", () => settle(p.name));
    field.addEventListener("change", () => {
      if (field.value === "" || !isFinite(field.value)) { showValue(p.name); return; }
      fitSlider(p, Number(field.value));
      remember(); set(p.name, Number(field.value)); moved(); settle();
    });
    return row;
  }

  function fitSlider(p, value) { // the range of the model; for a value outside of it, .2 to 2.5 times the value
    let [low, high] = [p.low, p.high];
    if (value < low || value > high) {
      [low, high] = value ? [0.2 * value, 2.5 * value].sort((a, b) => a - b) : [Math.min(low, 0), Math.max(high, 0)];
      low = Math.max(low, p.limits[0] ?? -Infinity, -Number.MAX_VALUE);
      high = Math.min(high, p.limits[1] ?? Infinity, Number.MAX_VALUE);
      if (value < low || value > high) return; // the model refuses the value
    }
    Object.assign(p.slider, { min: low, max: high, step: (high - low) / 400 || "any" });
  }

  function showValue(name) { // in the slider and the field
    const p = data.parameters.find((each) => each.name === name), value = now.values[name];
    if (value < Number(p.slider.min) || value > Number(p.slider.max)) fitSlider(p, value);
    p.slider.value = value;
    if (document.activeElement !== p.field || Number(p.field.value) !== value) p.field.value = written(value);
  }

  function written(value) { // short enough for its field
    const size = Math.abs(value);
    return size && (size >= 1e6 || size < 1e-4) ? String(Number(value.toPrecision(7)).toExponential()) : hbgear.short(value, 7);
  }

  function set(name, value) { now.values[name] = value; showValue(name); }

  function moved() { now.moved = performance.now(); compute(); }

  /* ---- undo, links */

  const copy = () => JSON.stringify({ values: now.values, from: now.from, to: now.to, harmonics: now.harmonics });

  function remember() { if (before === null) before = copy(); } // state before a slider moves

  function settle(what = "") { // one undo reverts many small moves of one parameter, such as by keys
    const again = what && what === last.what && performance.now() - last.when < 1000;
    if (before !== null && before !== copy()) {
      if (!again) past.push(before);
      future.length = 0;
      last = { what, when: performance.now() };
    }
    before = null;
    buttons();
    history.replaceState(null, "", `#${link()}`);
  }

  function buttons() { $("undo").disabled = !past.length; $("redo").disabled = !future.length; }

  function take(text) {
    const found = JSON.parse(text);
    Object.assign(now, { from: found.from, to: found.to, harmonics: found.harmonics });
    for (const [name, value] of Object.entries(found.values)) if (name in now.values) set(name, value);
    fill();
    moved();
    buttons();
    history.replaceState(null, "", `#${link()}`);
  }

  function back(from, to) { last = {}; if (from.length) { to.push(copy()); take(from.pop()); } }

  function link() { // changed values, range and harmonics
    const words = new URLSearchParams();
    for (const p of data.parameters) if (now.values[p.name] !== p.value) words.set(p.name, now.values[p.name]);
    words.set("from", now.from); words.set("to", now.to); words.set("harmonics", now.harmonics);
    return words.toString();
  }

  function readLink() {
    const words = new URLSearchParams(location.hash.slice(1));
    for (const [name, text] of words) {
      const value = Number(text);
      if (text === "" || !isFinite(value)) continue;
      if (name in now.values) now.values[name] = value;
      else if (name === "from" || name === "to") now[name] = value;
      else if (name === "harmonics" && Number.isInteger(value) && value > 0) now.harmonics = value;
    }
  }

  function fill() {
    filled = perOmega();
    for (const id of ["from", "to"]) $(id).value = filled === 1 ? now[id] : hbgear.short(now[id] * filled, 7);
    document.querySelectorAll(".frequency").forEach((word) => { word.textContent = filled === 1 ? "Ω" : "speed"; });
    document.querySelectorAll(".frequency-unit").forEach((word) => { word.textContent = filled === 1 ? "" : "r/min"; });
    document.querySelectorAll("option[value=Omega]").forEach((option) => { option.textContent = filled === 1 ? "Omega" : "speed [r/min]"; });
    const choices = [...new Set([4, 8, 12, 16, 24, 32, 48, now.harmonics])].sort((a, b) => a - b);
    $("harmonics").replaceChildren(...choices.map((H) => new Option(H, H, false, H === now.harmonics)));
  }

  /* ---- jump map */

  function fillMap() {
    const names = ["Omega", ...data.parameters.map((p) => p.name)];
    for (const [id, chosen] of [["mapx", "Omega"], ["mapy", names.includes("zeta") ? "zeta" : names[1]]]) {
      $(id).replaceChildren(...names.map((name) => new Option(name, name, false, name === chosen)));
      $(id).addEventListener("change", () => mapRange(id));
      mapRange(id);
    }
    $("makemap").disabled = names.length < 2;
  }

  function mapRange(id) {
    const name = $(id).value, p = data.parameters.find((each) => each.name === name);
    const [low, high] = name === "Omega" ? [Math.min(now.from, now.to), Math.max(now.from, now.to)] : [p.low, p.high];
    const unit = name === "Omega" ? filled : 1;
    $(`${id}0`).value = hbgear.short(low * unit, 5); $(`${id}1`).value = hbgear.short(high * unit, 5);
  }

  async function makeMap() {
    const axis = (id) => [$(id).value, ...["0", "1"].map((end) => Number($(id + end).value) / ($(id).value === "Omega" ? filled : 1))];
    const at = hbgear.state.at, Omega = at ? hbgear.state.curves[at[0]].Omega[at[1]] : null;
    const axes = { x: axis("mapx"), y: axis("mapy"), Omega };
    $("makemap").disabled = true; $("cancelmap").hidden = false; $("mapstatus").textContent = "computing";
    setTimeout(() => follow("map"), 300);
    try {
      const found = await asked("/map", { ...question(), axes });
      $("mapstatus").textContent = found ? found.message : "cancelled";
      if (found && found.lines.length) await drawMap(found, axes);
      if (found && !found.message) $("mapstatus").textContent = "Click on the map to use its values.";
    } catch (error) {
      $("mapstatus").textContent = error.message;
    } finally {
      $("makemap").disabled = false; $("cancelmap").hidden = true;
    }
  }

  async function drawMap(found, axes) {
    const ink = hbgear.palette(), seen = new Set(), div = $("map"), scale = perOmega();
    const shown = (axis, xs) => (axes[axis][0] === "Omega" ? xs.map((x) => (x === null ? null : x * scale)) : xs);
    const label = (axis, text) => (axes[axis][0] === "Omega" && scale !== 1 ? "speed of the pinion [r/min]" : text);
    const styles = { "jump, sweep up": { color: ink.regimes.no_impact, dash: "solid" },
                     "jump, sweep down": { color: ink.regimes.single_sided, dash: "dashdot" } };
    const traces = found.lines.map((line) => {
      const first = !seen.has(line.kind);
      seen.add(line.kind);
      return { x: shown("x", line.x), y: shown("y", line.y), mode: "lines", name: line.kind.replace("Omega", "Ω"), showlegend: first, legendgroup: line.kind,
               line: { width: 2, ...(styles[line.kind] || { color: ink.regimes.no_impact }) }, hoverinfo: "x+y+name" };
    });
    const value = (name) => (name === "Omega" ? axes.Omega : now.values[name]);
    const [x, y] = [value(axes.x[0]), value(axes.y[0])]; // the axes of the map of a machine are parameters of its model
    if (x !== undefined && y !== undefined) traces.push({ x: shown("x", [x]), y: shown("y", [y]), mode: "markers", name: "now", hoverinfo: "x+y+name",
                  marker: { symbol: "circle-open", size: 11, color: ink.text, line: { width: 2 } } });
    div.hidden = false;
    await Plotly.react(div, traces, hbgear.layoutOf({ xaxis: hbgear.axis(label("x", found.labels[0])), yaxis: hbgear.axis(label("y", found.labels[1])),
      margin: { l: 62, r: 14, t: 14, b: 48 }, legend: { orientation: "h", y: -0.2 }, uirevision: String(newest) }), hbgear.CONFIG);
    drawn = [found, axes];
    div.removeAllListeners("plotly_click");
    div.on("plotly_click", (event) => {
      const p = event.points[0];
      remember();
      for (const [name, given] of [[axes.x[0], p.x], [axes.y[0], p.y]]) if (name in now.values) set(name, given);
      moved(); settle();
    });
  }
  let drawn = null;

  /* ---- files */

  async function save(kind) {
    try {
      const answer = await asked(`/save/${kind}`, question(), true);
      const anchor = document.createElement("a");
      anchor.href = URL.createObjectURL(await answer.blob());
      anchor.download = answer.headers.get("X-Name");
      anchor.click();
      setTimeout(() => URL.revokeObjectURL(anchor.href), 1000);
      say(`saved as ${anchor.download}`);
    } catch (error) { say(error.message, true); }
  }

  async function overlay(file) {
    try {
      const bytes = new Uint8Array(await file.arrayBuffer()); // the server decodes the text
      let binary = "";
      for (let i = 0; i < bytes.length; i += 8192) binary += String.fromCharCode(...bytes.subarray(i, i + 8192));
      const { groups } = await asked("/measured", { ...question(), content: btoa(binary), name: file.name });
      hbgear.state.behind = [...hbgear.state.behind.filter((b) => b.file !== groups[0].file), ...groups];
      await hbgear.compared();
      const count = groups.reduce((sum, group) => sum + group.x.length, 0);
      say(`${count} measured points of ${groups[0].file}, as ${groups[0].measure}`);
    } catch (error) { say(error.message, true); }
  }

  async function copied(text, what) {
    try { await navigator.clipboard.writeText(text); say(`${what} copied`); }
    catch { say(`the browser does not allow copying ${what}: ${text}`, true); }
  }

  function begin(given, settings, secret) {
    data = given; token = secret;
    Object.assign(now, { from: data.span[0], to: data.span[1], harmonics: data.harmonics });
    for (const p of data.parameters) now.values[p.name] = p.value;
    readLink();
    $("parameters").replaceChildren(...data.parameters.map(parameterRow));
    data.parameters.forEach((p) => showValue(p.name));
    fill(); fillMap(); buttons();
    for (const [id, key] of [["from", "from"], ["to", "to"], ["harmonics", "harmonics"]])
      $(id).addEventListener("change", (event) => {
        const value = Number(event.target.value);
        if (event.target.value === "" || !isFinite(value)) { fill(); return; }
        remember(); now[key] = key === "harmonics" ? value : value / filled; hbgear.state.frame = null; moved(); settle();
      });
    $("find").addEventListener("input", () => {
      const word = $("find").value.toLowerCase();
      document.querySelectorAll(".parameter").forEach((row) => { row.hidden = !row.dataset.words.includes(word); });
    });
    $("undo").addEventListener("click", () => back(past, future));
    $("redo").addEventListener("click", () => back(future, past));
    $("reset").addEventListener("click", () => {
      remember();
      for (const p of data.parameters) set(p.name, p.value);
      Object.assign(now, { from: data.span[0], to: data.span[1], harmonics: data.harmonics });
      fill(); moved(); settle();
    });
    document.addEventListener("keydown", (event) => {
      if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z" || event.target.type === "number") return;
      event.preventDefault();
      if (event.shiftKey) back(future, past); else back(past, future);
    });
    $("cancel").addEventListener("click", () => { asked("/cancel", { session, kind: "curve" }); say("cancelled; the previous curve is shown", true); });
    $("cancelmap").addEventListener("click", () => asked("/cancel", { session, kind: "map" }));
    $("makemap").addEventListener("click", makeMap);
    document.querySelectorAll("[data-save]").forEach((button) => button.addEventListener("click", () => save(button.dataset.save)));
    $("link").addEventListener("click", () => { settle(); copied(location.href, "the link"); });
    $("copy").addEventListener("click", () => copied($("python").textContent, "the script"));
    $("measured").addEventListener("change", (event) => { if (event.target.files[0]) overlay(event.target.files[0]); });
    $("theme").addEventListener("click", () => { if (drawn) drawMap(...drawn); });
    hbgear.begin({ curves: [], behind: data.behind }, settings);
    return send();
  }

  return { begin, now, timings, past };
})();
