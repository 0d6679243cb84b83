// Figures wait as JSON beside their places and are drawn as SVG, as wide as the page is, again when that changes and on
// paper. Words stand around a drawing as HTML, so that they wrap and none is cut. Dragging zooms, a double click goes
// back; a finger scrolls the page.
const SVG = "http://www.w3.org/2000/svg", finger = matchMedia("(pointer: coarse)"), TICK = 12;

function node(name, given, inside) {
  const made = document.createElementNS(SVG, name);
  for (const key in given) made.setAttribute(key, given[key]);
  if (inside) inside.appendChild(made);
  return made;
}

function words(name, text, inside) {
  const made = document.createElement("div");
  made.className = name;
  made.textContent = text;
  inside.appendChild(made);
  return made;
}

// Round numbers within a range, at most so many, and the power of ten that they are written in.
function scale(low, high, most) {
  const raw = (high - low) / Math.max(most, 1), power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].find(s => s * power >= raw * (1 - 1e-9)) * power, ticks = [];
  for (let k = Math.ceil(low / step - 1e-6); k * step <= high + 1e-6 * step; k++) ticks.push(k * step);
  const largest = Math.log10(Math.max(Math.abs(low), Math.abs(high)));
  const tens = largest < -2 || largest >= 5 ? 3 * Math.floor(largest / 3) : 0;
  const digits = Math.max(0, -Math.floor(Math.log10(step / 10 ** tens) + 1e-9));
  return { ticks, tens, text: value => (value / 10 ** tens).toFixed(digits).replace("-", "\u2212") };
}

function titled(title, tens) {
  const raised = [...String(tens)].map(c => c == "-" ? "\u207b" : "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"[c]).join("");
  return tens ? `${title} × 10${raised}` : title;
}

function range(values) {
  let low = Infinity, high = -Infinity;
  for (const v of values) if (v !== null) { if (v < low) low = v; if (v > high) high = v; }
  return low <= high ? [low, high] : [0, 1];
}

function heights(row, [from, to]) {
  if (row.map) return range(row.map.y);
  const seen = [...row.levels];
  for (const c of row.curves) c.x.forEach((x, k) => {
    if (x === null || x < from || x > to || c.y[k] === null) return;
    const half = c.error ? c.error[k] : 0;
    seen.push(c.y[k] - half, c.high ? c.high[k] : c.y[k] + half);
  });
  const [low, high] = range(seen), pad = 0.06 * (high - low || Math.abs(high) || 1);
  return [low - pad, high + pad];
}

function path(c, x, y) {
  let d = "", down = false;
  c.x.forEach((at, k) => {
    if (at === null || c.y[k] === null) { down = false; return; }
    d += `${down ? "L" : "M"}${x(at).toFixed(1)} ${y(c.y[k]).toFixed(1)}`;
    down = true;
  });
  return d;
}

function trace(c, x, y, inside) {
  if (c.style == "band") {
    const there = [...c.x.keys()].filter(k => c.y[k] !== null && c.high[k] !== null);
    const corner = (k, values) => `${x(c.x[k]).toFixed(1)} ${y(values[k]).toFixed(1)}`;
    const d = [...there.map(k => corner(k, c.high)), ...there.reverse().map(k => corner(k, c.y))].join("L");
    if (d) node("path", { d: `M${d}Z`, fill: c.colour, "fill-opacity": 0.22 }, inside);
    return;
  }
  if (c.style == "points" || c.style == "rings") {
    const ring = c.style == "rings", bar = [];
    c.x.forEach((at, k) => {
      if (at === null || c.y[k] === null) return;
      const place = { cx: x(at).toFixed(1), cy: y(c.y[k]).toFixed(1) };
      if (c.error && c.error[k]) bar.push(`M${place.cx} ${y(c.y[k] - c.error[k]).toFixed(1)}V${y(c.y[k] + c.error[k]).toFixed(1)}`);
      node("circle", ring ? { ...place, r: 3.5, fill: "none", stroke: c.colour, "stroke-width": 1.6 }
                          : { ...place, r: 1.8, fill: c.colour, "fill-opacity": 0.6 }, inside);
    });
    if (bar.length) node("path", { d: bar.join(""), stroke: c.colour, "stroke-width": 1.2 }, inside);
    return;
  }
  node("path", { d: path(c, x, y), fill: "none", stroke: c.colour, "stroke-width": c.width, "stroke-linejoin": "round",
                 ...(c.style == "dashes" ? { "stroke-dasharray": "7 5" } : {}) }, inside);
}

const RAMP = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
function shade(part) {
  const at = Math.min(Math.max(part, 0), 1) * (RAMP.length - 1), k = Math.min(Math.floor(at), RAMP.length - 2);
  return `rgb(${RAMP[k].map((low, i) => Math.round(low + (at - k) * (RAMP[k + 1][i] - low))).join()})`;
}

function map({ x: across, y: up, z }, x, y, inside) {
  const [low, high] = range(z.flat()), wide = x(across[1]) - x(across[0]), tall = y(up[0]) - y(up[1]);
  z.forEach((column, i) => column.forEach((value, j) => {
    if (value !== null) node("rect", { x: x(across[i]) - wide / 2, y: y(up[j]) - tall / 2, width: wide + 0.5,
                                       height: tall + 0.5, fill: shade((value - low) / (high - low || 1)) }, inside);
  }));
}

function key(place, rows) {
  const legend = words("legend", "", place), listed = new Set();
  for (const c of rows.flatMap(row => row.curves)) {
    if (!c.name || listed.has(c.name)) continue;
    listed.add(c.name);
    const item = words(`key ${c.style}`, c.name, legend);
    item.style.setProperty("--colour", c.colour);
  }
}

function draw(place) {
  const figure = place.figure, narrow = place.clientWidth < 480, whole = figure.rows.reduce((sum, row) => sum + row.share, 0);
  const all = figure.rows.flatMap(row => row.map ? row.map.x : row.curves.flatMap(c => c.x));
  const marks = figure.rows.some(row => row.curves.some(c => c.style == "points" || c.style == "rings"));
  const [first, last] = range(all), pad = marks ? 0.03 * (last - first) : 0;
  const [from, to] = place.zoom || [first - pad, last + pad || 1];
  place.dataset.from = from; place.dataset.to = to;
  place.replaceChildren();
  key(place, figure.rows);
  const limits = figure.rows.map(row => heights(row, [from, to]));
  const tall = figure.rows.map(row => Math.max(90, figure.height * (narrow ? 0.85 : 1) * row.share / whole));
  const scales = limits.map(([low, high], i) => scale(low, high, tall[i] / 45));
  const left = Math.max(...scales.flatMap(s => s.ticks.map(t => 7 * s.text(t).length))) + 10;
  const width = place.clientWidth, right = 14, inner = width - left - right, across = scale(from, to, inner / 75);
  figure.rows.forEach((row, i) => {
    const end = i == figure.rows.length - 1, title = words("ytitle", titled(row.title, scales[i].tens), place);
    if (row.map) {
      const [low, high] = range(row.map.z.flat());
      words("ramp", `${row.map.title}: ${low.toPrecision(3)} to ${high.toPrecision(3)}`, place);
    }
    const [low, high] = limits[i], height = tall[i], bottom = end ? 22 : 6;
    const x = value => (value - from) / (to - from) * inner, y = value => (high - value) / (high - low) * height;
    const svg = node("svg", { width, height: height + bottom + 6, role: "img" }, place);
    node("title", {}, svg).textContent = `${row.title} over ${figure.x}`;
    for (const t of scales[i].ticks) {
      node("line", { class: "grid", x1: left, x2: left + inner, y1: 6 + y(t), y2: 6 + y(t) }, svg);
      node("text", { x: left - 6, y: 10 + y(t), "text-anchor": "end" }, svg).textContent = scales[i].text(t);
    }
    for (const t of across.ticks) {
      node("line", { class: "grid", x1: left + x(t), x2: left + x(t), y1: 6, y2: 6 + height }, svg);
      const text = across.text(t), half = 3.5 * text.length, at = Math.min(Math.max(left + x(t), half), width - half);
      if (end) node("text", { x: at, y: height + 22, "text-anchor": "middle" }, svg).textContent = text;
    }
    const inside = node("svg", { x: left, y: 6, width: inner, height, class: "inside" }, svg);
    node("rect", { width: inner, height, fill: "transparent" }, inside);
    if (row.map) map(row.map, x, y, inside);
    for (const level of row.levels)
      node("line", { class: "level", x1: 0, x2: inner, y1: y(level), y2: y(level) }, inside);
    for (const c of row.curves) trace(c, x, y, inside);
    listen(place, inside, row, title, x, inner, height, [from, to]);
  });
  words("xtitle", titled(figure.x, across.tens), place);
}

// The values under the pointer stand beside the title of the row; dragging chooses a part of the x axis.
function listen(place, inside, row, title, x, inner, height, [from, to]) {
  const said = title.textContent, at = event => from + (event.clientX - inside.getBoundingClientRect().left) / inner * (to - from);
  const rule = node("line", { class: "rule", y1: 0, y2: height, visibility: "hidden" }, inside);
  const chosen = node("rect", { class: "chosen", y: 0, height, visibility: "hidden" }, inside);
  let start = null;
  inside.addEventListener("pointermove", event => {
    if (event.pointerType == "touch") return;
    const now = at(event);
    rule.setAttribute("x1", x(now)); rule.setAttribute("x2", x(now)); rule.setAttribute("visibility", "visible");
    const read = row.curves.filter(c => c.name && c.style != "band").map(c => {
      let best = 0;
      c.x.forEach((value, k) => { if (Math.abs(value - now) < Math.abs(c.x[best] - now)) best = k; });
      return c.y[best] === null ? "" : `${c.name} ${Number(c.y[best].toPrecision(4))}`;
    });
    title.textContent = [`${said}  (at ${Number(now.toPrecision(4))}:`, read.filter(Boolean).join(", ") + ")"].join(" ");
    if (start === null) return;
    chosen.setAttribute("x", Math.min(x(start), x(now))); chosen.setAttribute("width", Math.abs(x(now) - x(start)));
    chosen.setAttribute("visibility", "visible");
  });
  inside.addEventListener("pointerleave", () => { rule.setAttribute("visibility", "hidden"); title.textContent = said; });
  inside.addEventListener("pointerdown", event => {
    if (event.pointerType == "touch" || finger.matches) return;
    start = at(event); inside.setPointerCapture(event.pointerId); event.preventDefault();
  });
  inside.addEventListener("pointerup", event => {
    if (start === null) return;
    const chosenEnds = [start, at(event)].sort((a, b) => a - b), wide = (chosenEnds[1] - chosenEnds[0]) / (to - from);
    start = null; chosen.setAttribute("visibility", "hidden");
    if (wide > 0.01) { place.zoom = chosenEnds; draw(place); }
  });
  inside.addEventListener("dblclick", () => { place.zoom = null; draw(place); });
}

const places = [...document.querySelectorAll(".plot")];
for (const place of places) place.figure = JSON.parse(place.nextElementSibling.textContent);
const resized = new ResizeObserver(entries => {
  for (const { target } of entries) if (target.clientWidth != target.drawn) { target.drawn = target.clientWidth; draw(target); }
});
for (const place of places) resized.observe(place);
function paper(printing) {
  document.documentElement.classList.toggle("paper", printing);
  places.forEach(place => { place.drawn = place.clientWidth; draw(place); });
}
addEventListener("beforeprint", () => paper(true));
addEventListener("afterprint", () => paper(false));
