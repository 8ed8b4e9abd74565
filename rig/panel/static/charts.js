/** Force and depth against time, force against depth, and the cross-section; each beside its prediction. */

import uPlot from "/static/vendor/uplot/uPlot.esm.js";
import { at, show, write } from "/static/stop.js";

export const N_PER_GWT = 0.00980665;
export const known = (value) => typeof value === "number" && Number.isFinite(value);

/** Fixed decimals, a true minus, no negative zero; a dash if unknown. */
export function fixed(value, decimals) {
  if (!known(value)) return "–";
  const text = value.toFixed(decimals);
  return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "−");
}

const [WINDOW_S, GAP_S, MOST_ROWS, MOST_CURVES] = [60, 1, 6000, 50];

/** Readings for the plots: the last minute and the present indentation; a gap where nothing was read. */
export class Buffer {
  constructor() {
    this.curves = new Map(); // by press, the newest last
    this.forget();
  }

  forget() {
    this.time = [[], [], [], [], []]; // s since the start of the run, gwt, mm, predicted gwt, press
    this.press = null;
    this.pressed = [[], []]; // mm, gwt
  }

  /** Find columns by name. */
  take({ run, columns, rows }) {
    this.run = run ?? null;
    const place = Object.fromEntries(columns.map((name, n) => [name, n]));
    for (const row of rows) this.row((name) => row[place[name]] ?? null);
    const old = Math.max(this.time[0].findIndex((t_s) => t_s >= this.time[0].at(-1) - WINDOW_S), this.time[0].length - MOST_ROWS, 0);
    this.time = this.time.map((column) => column.slice(old));
    this.pressed = this.pressed.map((column) => column.slice(-MOST_ROWS));
  }

  row(of) {
    const [t_s, force_gwt, doi_mm] = [of("t_s"), of("force_gwt"), of("doi_mm")];
    const last_s = this.time[0].at(-1) ?? t_s;
    if (t_s < last_s) this.forget();
    const gap = t_s - last_s > GAP_S;
    if (gap) [(last_s + t_s) / 2, null, null, null, null].forEach((value, n) => this.time[n].push(value));
    const press = known(of("index")) && of("index") >= 0 ? `${of("purpose") ?? "data"} ${of("index")}` : null; // −1: outside a press
    [t_s, force_gwt, doi_mm, this.predictedAt(press, doi_mm), press].forEach((value, n) => this.time[n].push(value));
    if (press === null) return;
    if (press !== this.press) [this.press, this.pressed] = [press, [[], []]];
    const read = known(doi_mm) && known(force_gwt);
    for (const point of [...(gap || !read ? [[null, null]] : []), ...(read ? [[doi_mm, force_gwt]] : [])]) point.forEach((value, n) => this.pressed[n].push(value));
  }

  /** Store the prediction for a press, and apply it to the readings that came before. */
  section({ run, index, purpose, depths }) {
    if (!depths?.length) return;
    const press = `${purpose ?? "data"} ${index}`;
    this.curves.set(`${run ?? null} ${press}`, [[0, ...depths.map((one) => one.doi_mm)], [0, ...depths.map((one) => one.force_gwt)]]);
    if (this.curves.size > MOST_CURVES) this.curves.delete(this.curves.keys().next().value);
    this.time[3] = this.time[3].map((before, n) => (this.time[4][n] === press ? this.predictedAt(press, this.time[2][n]) : before));
  }

  /** The force predicted for a press at a depth; null without a prediction. */
  predictedAt(press, doi_mm) {
    const curve = this.curves.get(`${this.run} ${press}`);
    return curve && known(doi_mm) ? interpolated(doi_mm, ...curve) : null;
  }

  /** The curve of the plotted press: [mm, gwt]. */
  get predicted() {
    return this.curves.get(`${this.run} ${this.press}`) ?? [[], []];
  }
}

/** Interpolate between the two nearest points of a rising row; null outside. */
export function interpolated(x, xs, ys) {
  const n = xs.findIndex((one) => one >= x);
  if (n < 0 || (n === 0 && xs[0] > x)) return null;
  return n === 0 ? ys[0] : ys[n - 1] + ((ys[n] - ys[n - 1]) * (x - xs[n - 1])) / (xs[n] - xs[n - 1]);
}

/** A round number above all values, which changes when it is too small, or four times too large. */
export function top(before, ...columns) {
  const highest = 1.15 * Math.max(0, ...columns.flat().filter(known));
  if (highest === 0 || (highest <= before && highest * 4 / 1.15 > before)) return before;
  const power = 10 ** Math.floor(Math.log10(highest));
  return power * [1, 1.5, 2, 3, 4, 5, 6, 8, 10].find((times) => times * power >= highest * 0.999999);
}

const SHIFT_S = 10; // The axis moves in steps of this length, because moving labels are hard to read.
const FONT = "13px system-ui, sans-serif";
const [AXIS, LABEL] = [54, 20]; // widths; left free where there is no axis, so that equal times stand above each other
const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export class Traces {
  constructor() {
    this.buffer = new Buffer();
    this.trip_gwt = null;
    this.charts = null; // made with the first reading
    new ResizeObserver(() => this.resize()).observe(at("traces"));
    this.forget();
  }

  forget() {
    this.buffer.forget();
    this.tops = { force: 1, depth: 0.5, press: 1, deep: 0.5 };
    this.dirty = true;
  }

  recolor() {
    for (const chart of this.charts ?? []) chart.redraw();
  }

  state({ limits }) {
    this.trip_gwt = limits?.trip_gwt ?? null;
  }

  readings(data) {
    this.buffer.take(data);
    this.dirty = true;
  }

  section(data) {
    this.buffer.section(data);
    this.dirty = true;
  }

  look() {
    if (!this.dirty || document.visibilityState === "hidden" || at("bench").hidden) return;
    this.dirty = false;
    const { time, pressed, press, predicted } = this.buffer;
    show("plots", time[0].length > 0);
    show("no_plots", time[0].length === 0);
    show("pressed_plot", press !== null);
    show("depth_plot", time[2].some(known));
    if (!time[0].length) return;
    this.charts ??= this.made();
    const { tops } = this;
    tops.force = top(tops.force, time[1], time[3]);
    tops.depth = top(tops.depth, time[2]);
    tops.press = top(tops.press, pressed[1], predicted[1]);
    tops.deep = top(tops.deep, pressed[0], predicted[0]);
    const [force, depth, both] = this.charts;
    force.setData([time[0], time[3], time[1]]);
    depth.setData([time[0], time[2]]);
    both.setData(predicted[0].length ? predicted : [[0, tops.deep], [null, null]]);
    const [purpose, index] = press?.split(" ") ?? [];
    const name = `${purpose === "data" ? "indentation" : purpose} ${Number(index) + 1}`;
    write("press_words", press === null ? "" : `(${name}${predicted[0].length ? "" : ", no prediction"})`);
    this.resize();
  }

  made() {
    const [measured, predicted] = [this.line("--measured", 2), this.line("--predicted", 6)];
    const time = { time: false, range: () => this.window() };
    const up = (name) => ({ range: () => [-0.05 * this.tops[name], this.tops[name]] });
    const newtons = { from: "y", range: (plot, low, high) => [low * N_PER_GWT, high * N_PER_GWT] };
    const forces = [this.axis("gwt"), { ...this.axis("N"), side: 1, scale: "newtons", grid: { show: false } }];
    const forced = (name, x) => ({ x, y: up(name), newtons });
    return [
      this.chart("force_time", [{}, predicted, measured], forced("force", time), [this.across("s"), ...forces], "force"),
      this.chart("depth_time", [{}, measured], { x: time, y: up("depth") }, [this.across("s"), this.axis("mm")]),
      this.chart("force_depth", [{}, predicted], forced("press", { time: false, ...up("deep") }), [this.across("mm"), ...forces], "press", (plot) => this.drawPressed(plot)),
    ];
  }

  chart(id, series, scales, axes, force, after = () => {}) {
    const hooks = { draw: [(plot) => (force && this.drawTrip(plot, this.tops[force]), after(plot))] };
    const how = { cursor: { show: false }, legend: { show: false }, padding: [8, force ? 0 : AXIS + LABEL, 0, 0], hooks };
    return new uPlot({ width: 300, height: 180, scales, series, axes, ...how }, series.map(() => []), at(id));
  }

  /** The time range in whole steps, so that it rests in between. */
  window() {
    const end_s = (Math.floor((this.buffer.time[0].at(-1) ?? 0) / SHIFT_S) + 1) * SHIFT_S;
    return [Math.max(0, end_s - WINDOW_S), Math.max(end_s, WINDOW_S)];
  }

  across(unit) {
    const line = { stroke: () => color("--faint"), width: 1 };
    return { size: 28, stroke: () => color("--ink"), grid: line, ticks: line, font: FONT, label: unit, labelFont: FONT, labelSize: LABEL, labelGap: 2 };
  }

  axis(unit) {
    return { ...this.across(unit), size: AXIS };
  }

  line(name, width) {
    return { stroke: () => color(name), width, points: { show: false }, spanGaps: false };
  }

  /** Draw readings that go down and up again, which a series sorted by depth cannot show. */
  drawPressed(plot) {
    const [doi_mm, force_gwt] = this.buffer.pressed;
    this.stroke(plot, "--measured", [], () => {
      let pen = "moveTo";
      doi_mm.forEach((depth_mm, n) => {
        if (depth_mm !== null) plot.ctx[pen](plot.valToPos(depth_mm, "x", true), plot.valToPos(force_gwt[n], "y", true));
        pen = depth_mm === null ? "moveTo" : "lineTo";
      });
    });
  }

  /** Draw the trip line if the axis reaches it. */
  drawTrip(plot, highest) {
    if (!known(this.trip_gwt) || this.trip_gwt > highest) return;
    const y = plot.valToPos(this.trip_gwt, "y", true);
    const { left, width } = plot.bbox;
    this.stroke(plot, "--trip", [8, 6], () => (plot.ctx.moveTo(left, y), plot.ctx.lineTo(left + width, y)));
  }

  stroke(plot, name, dashes, draw) {
    plot.ctx.save();
    plot.ctx.setLineDash(dashes.map((length) => length * devicePixelRatio));
    plot.ctx.strokeStyle = color(name);
    plot.ctx.lineWidth = 2 * devicePixelRatio;
    plot.ctx.beginPath();
    draw();
    plot.ctx.stroke();
    plot.ctx.restore();
  }

  resize() {
    for (const chart of this.charts ?? []) {
      const { clientWidth: width, clientHeight: height } = chart.root.parentElement;
      if (width && (width !== chart.width || height !== chart.height)) chart.setSize({ width, height });
    }
  }
}

const SVG = "http://www.w3.org/2000/svg";
const [ABOVE_MM, BELOW_MM, FADES_MM] = [4, 7, 5]; // FADES_MM: beside the computed patch its displacement fades out

/** The finger's section to scale: the skin as predicted at the present depth, and the indentor on it. */
export class Section {
  constructor() {
    [this.drawn, this.run, this.frame] = [null, null, null];
    this.forget();
  }

  forget() {
    this.reading = {};
  }

  state({ run, newest }) {
    this.run = run?.name ?? null;
    const { x_mm, height_mm, doi_mm } = newest ?? {};
    this.reading = { ...this.reading, x_mm, height_mm, doi_mm: doi_mm ?? null };
  }

  readings({ columns, rows }) {
    const last = rows.at(-1);
    if (last) this.reading = Object.fromEntries(columns.map((name, n) => [name, last[n]]));
  }

  section(data) {
    this.drawn = data;
    this.frame = null;
    const svg = at("section");
    svg.replaceChildren();
    if (!data.skin?.length) return;
    const [xs, zs] = [data.skin.map(([x]) => x), data.skin.map(([, z]) => z)];
    const [left, right, highest, lowest] = [Math.min(...xs), Math.max(...xs), Math.max(...zs), Math.min(...zs)];
    this.middle_mm = (highest + lowest) / 2;
    this.highest_mm = highest;
    svg.setAttribute("viewBox", `${left - 1} ${-highest - ABOVE_MM} ${right - left + 2} ${ABOVE_MM + BELOW_MM}`);
    const up = add(svg, "g", { transform: "scale(1 -1)" }); // heights increase upwards
    this.skin = add(up, "path", { class: "skin", d: path(data.skin) });
    for (const layer of data.layers ?? []) add(up, "path", { class: "layer", d: path(layer, false) });
    if (data.bone) add(up, "path", { class: "bone", d: path(data.bone) });
    if (data.nail?.length) add(up, "path", { class: "nail", d: path(data.nail, false) });
    this.indentor = add(up, "g", { class: "indentor" });
    if (data.indentor?.length) add(this.indentor, "path", { class: "profile", d: path(lidded(data.indentor)) });
    this.contact = add(up, "g", {});
  }

  look() {
    const drawn = this.drawn?.skin?.length && (this.drawn.run ?? null) === this.run;
    show("place", Boolean(drawn));
    if (!drawn) return;
    const { x_mm, height_mm, doi_mm, index, purpose } = this.reading;
    const somewhere = known(x_mm) && known(height_mm);
    const pressing = somewhere && known(doi_mm) && doi_mm > 0 && this.drawn.index === index && (this.drawn.purpose ?? "data") === (purpose ?? "data");
    const frame = pressing ? this.at(doi_mm) : null;
    const touch_mm = this.touch(x_mm);
    const tip_mm = frame && known(touch_mm) ? touch_mm - Math.min(doi_mm, frame.deepest_mm) : height_mm;
    const shown = `${doi_mm} ${Boolean(frame)}`;
    if (shown !== this.frame) this.deform(frame);
    this.frame = shown;
    const ceiling = this.highest_mm + ABOVE_MM - 1;
    this.indentor.setAttribute("transform", somewhere ? `translate(${x_mm} ${Math.min(tip_mm, ceiling)})` : "translate(0 1000)");
    if (!somewhere) return write("section_words", "the position of the indentor is unknown");
    const where = `x = ${fixed(x_mm, 2)} mm, tip ${fixed(Math.abs(height_mm), 3)} mm ${height_mm < 0 ? "below" : "above"} the apex`;
    const skin = frame ? "skin and contact (thick) as predicted at this depth" : "the skin is drawn undeformed";
    write("section_words", `${where}${tip_mm > ceiling ? " (above the figure)" : ""}; ${skin}`);
  }

  /** The predicted skin and contact at a depth, between two that were computed; null without a prediction. */
  at(doi_mm) {
    const frames = this.drawn.depths ?? [];
    if (!frames.length) return null;
    const n = frames.findIndex((one) => one.doi_mm >= doi_mm);
    const next = frames[n < 0 ? frames.length - 1 : n];
    const before = n > 0 ? frames[n - 1] : { doi_mm: 0, skin: next.skin.map(([x]) => [x, interpolated(x, ...this.upper) ?? null]) };
    const share = n < 0 ? 1 : (doi_mm - before.doi_mm) / (next.doi_mm - before.doi_mm);
    const skin = next.skin.map(([x, z], k) => [x, known(before.skin[k][1]) ? before.skin[k][1] + share * (z - before.skin[k][1]) : z]);
    return { skin, contact: next.contact, deepest_mm: frames.at(-1).doi_mm };
  }

  /** The upper side of the undeformed skin: [xs, zs], from left to right. */
  get upper() {
    const points = this.drawn.skin.filter(([, z]) => z > this.middle_mm).sort(([one], [other]) => one - other);
    return [points.map(([x]) => x), points.map(([, z]) => z)];
  }

  /** Height of the indentor where it just touches the undeformed skin. */
  touch(x_mm) {
    const [xs, zs] = this.upper;
    const heights = (this.drawn.indentor ?? []).map(([x, z]) => (interpolated(x + x_mm, xs, zs) ?? -Infinity) - z);
    const on = xs.map((x, n) => zs[n] - (interpolated(x - x_mm, ...this.profile) ?? Infinity));
    const highest = Math.max(...heights, ...on);
    return Number.isFinite(highest) ? highest : null;
  }

  get profile() {
    const points = this.drawn.indentor ?? [];
    return [points.map(([x]) => x), points.map(([, z]) => z)];
  }

  /** Draw the skin of a depth in place of the upper side of the finger, and the contact on it. */
  deform(frame) {
    this.contact.replaceChildren();
    const { skin } = this.drawn;
    if (frame === null) return this.skin.setAttribute("d", path(skin));
    const line = [...frame.skin].sort(([one], [other]) => one - other);
    const [from, to] = [line[0][0], line.at(-1)[0]];
    const within = ([x, z]) => z > this.middle_mm && x > from && x < to;
    const first = skin.findIndex(within);
    const sunk = [line[0], line.at(-1)].map(([x, z]) => [x, z - (interpolated(x, ...this.upper) ?? z)]);
    const fade = ([x, z]) => [x, sunk.reduce((sum, [end, by]) => sum + by * Math.max(0, 1 - Math.hypot(x - end, z - this.highest_mm) / FADES_MM), z)];
    const rest = [...skin.slice(first), ...skin.slice(0, first)].filter((point) => !within(point)).map(fade);
    const rightwards = Math.abs((rest.at(-1) ?? line[0])[0] - from) < Math.abs((rest.at(-1) ?? line[0])[0] - to);
    this.skin.setAttribute("d", path([...rest, ...(rightwards ? line : line.reverse())]));
    const [xs, zs] = [frame.skin.map(([x]) => x), frame.skin.map(([, z]) => z)];
    for (const [left, right] of frame.contact) {
      const end = (x) => [x, interpolated(x, xs, zs)];
      const points = [end(left), ...frame.skin.filter(([x]) => x > left && x < right), end(right)].filter(([, z]) => z !== null);
      add(this.contact, "path", { class: "contact", d: path(points, false) });
    }
  }
}

/** Close a profile, which is the lower side, far above. */
function lidded(points) {
  const lid_mm = Math.max(...points.map(([, z]) => z)) + 2 * (ABOVE_MM + BELOW_MM);
  return [...points, [points.at(-1)[0], lid_mm], [points[0][0], lid_mm]];
}

const path = (points, closed = true) => points.map(([x, z], n) => `${n ? "L" : "M"}${x} ${z}`).join("") + (closed ? "Z" : "");

function add(parent, kind, attributes) {
  const element = document.createElementNS(SVG, kind);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return parent.appendChild(element);
}
