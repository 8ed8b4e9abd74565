/** Force and depth against time, and force against depth, each with its prediction. */

import uPlot from "/static/vendor/uplot/uPlot.esm.js";
import { Buffer, WINDOW_S } from "/static/buffer.js";
import { at, write } from "/static/page.js";
import { fixed, known, N_PER_GWT } from "/static/units.js";

const SHIFT_S = 10; // The axis moves in steps of this length, because moving labels are hard to read.
const DRAWN_MS = 100;
const ROOM = 1.15;
const FONT = "13px system-ui, sans-serif";

export class Traces {
  constructor(colours) {
    this.colours = colours;
    this.buffer = new Buffer();
    this.trip_gwt = null;
    this.tops = { force: 1, depth: 0.5, press: 1, deep: 0.5 };
    this.charts = [this.forceInTime(), this.depthInTime(), this.forceInDepth()];
    new ResizeObserver(() => this.resize()).observe(at("force_time"));
    colours.changed = () => this.charts.forEach((chart) => chart.redraw());
    this.drawn_ms = 0;
    this.dirty = true;
  }

  forget() {
    this.buffer.forget();
    this.tops = { force: 1, depth: 0.5, press: 1, deep: 0.5 };
    this.dirty = true;
  }

  state({ limits }) {
    this.trip_gwt = limits?.trip_gwt ?? null;
  }

  readings(data) {
    this.buffer.take(data);
    this.dirty = true;
  }

  prediction(data) {
    this.buffer.prediction(data);
    this.dirty = true;
  }

  look() {
    const now_ms = performance.now();
    if (!this.dirty || now_ms - this.drawn_ms < DRAWN_MS || !at("traces").offsetParent) return;
    this.drawn_ms = now_ms;
    this.dirty = false;
    this.draw();
  }

  draw() {
    const { time, pressed, press } = this.buffer;
    const [curve_mm, curve_gwt] = this.buffer.predicted;
    const modelled = time[3];
    this.tops.force = top(this.tops.force, time[1], modelled);
    this.tops.depth = top(this.tops.depth, time[2]);
    this.tops.press = top(this.tops.press, pressed[1], curve_gwt);
    this.tops.deep = top(this.tops.deep, pressed[0], curve_mm);
    const [force, depth, both] = this.charts;
    force.setData([time[0], modelled, time[1]]);
    depth.setData([time[0], time[2]]);
    both.setData(curve_mm.length ? [curve_mm, curve_gwt] : [[0, this.tops.deep], [null, null]]);
    write("press_words", press === null ? "" : `(${press.replace("data ", "index ")}${curve_mm.length ? "" : ", no prediction"})`);
  }

  /** The time range in whole steps, so that it rests in between. */
  window() {
    const newest_s = this.buffer.time[0].at(-1) ?? 0;
    const end_s = (Math.floor(newest_s / SHIFT_S) + 1) * SHIFT_S;
    return [Math.max(0, end_s - WINDOW_S), Math.max(end_s, WINDOW_S)];
  }

  forceInTime() {
    const series = [{}, this.predictedLine(), this.measuredLine()];
    const scales = { x: { time: false, range: () => this.window() }, y: { range: () => [-0.05 * this.tops.force, this.tops.force] } };
    return this.chart("force_time", series, scales, [this.across("s"), this.axis("gwt"), this.newtons()]);
  }

  depthInTime() {
    const scales = { x: { time: false, range: () => this.window() }, y: { range: () => [-0.05 * this.tops.depth, this.tops.depth] } };
    return this.chart("depth_time", [{}, this.measuredLine()], scales, [this.across("s"), this.axis("mm"), this.axis("µm", (v) => fixed(v * 1000, 0))]);
  }

  forceInDepth() {
    const scales = { x: { time: false, range: () => [-0.05 * this.tops.deep, this.tops.deep] }, y: { range: () => [-0.05 * this.tops.press, this.tops.press] } };
    const axes = [this.across("mm"), this.axis("gwt"), this.newtons()];
    return this.chart("force_depth", [{}, this.predictedLine()], scales, axes, (plot) => this.drawPressed(plot));
  }

  newtons() {
    return this.axis("N", (value) => fixed(value * N_PER_GWT, this.tops.force < 20 ? 3 : 2));
  }

  chart(id, series, scales, axes, after = () => {}) {
    const frame = at(id);
    const hooks = { draw: [(plot) => (this.drawTrip(plot, id), after(plot))] };
    const how = { cursor: { show: false }, legend: { show: false }, padding: [8, 0, 0, 0], hooks };
    return new uPlot({ width: 300, height: frame.clientHeight || 180, scales, series, axes, ...how }, series.map(() => []), frame);
  }

  across(unit) {
    const line = { stroke: () => this.colours.of("--faint"), width: 1 };
    const text = { font: FONT, label: unit, labelFont: FONT, labelSize: 20, labelGap: 2 };
    return { size: 28, stroke: () => this.colours.of("--ink"), grid: line, ticks: line, ...text };
  }

  /** The left axis, and with values in another unit the right one. */
  axis(unit, values) {
    const left = { ...this.across(unit), size: 54 };
    return values ? { ...left, side: 1, scale: "y", grid: { show: false }, values: (_, ticks) => ticks.map(values) } : left;
  }

  predictedLine() {
    return { stroke: () => this.colours.of("--predicted"), width: 6, points: { show: false }, spanGaps: false };
  }

  measuredLine() {
    return { stroke: () => this.colours.of("--measured"), width: 2, points: { show: false }, spanGaps: false };
  }

  /** Draw readings that go down and up again, which a series sorted by depth cannot show. */
  drawPressed(plot) {
    const [doi_mm, force_gwt] = this.buffer.pressed;
    if (!doi_mm.length) return;
    plot.ctx.save();
    plot.ctx.beginPath();
    doi_mm.forEach((depth_mm, n) => plot.ctx.lineTo(plot.valToPos(depth_mm, "x", true), plot.valToPos(force_gwt[n], "y", true)));
    plot.ctx.strokeStyle = this.colours.of("--measured");
    plot.ctx.lineWidth = 2 * devicePixelRatio;
    plot.ctx.stroke();
    plot.ctx.restore();
  }

  /** Draw the trip line if the axis reaches it. */
  drawTrip(plot, id) {
    const highest = id === "force_time" ? this.tops.force : id === "force_depth" ? this.tops.press : 0;
    if (!known(this.trip_gwt) || this.trip_gwt > highest) return;
    const y = plot.valToPos(this.trip_gwt, "y", true);
    plot.ctx.save();
    plot.ctx.setLineDash([8 * devicePixelRatio, 6 * devicePixelRatio]);
    plot.ctx.strokeStyle = this.colours.of("--trip");
    plot.ctx.lineWidth = 2 * devicePixelRatio;
    plot.ctx.beginPath();
    plot.ctx.moveTo(plot.bbox.left, y);
    plot.ctx.lineTo(plot.bbox.left + plot.bbox.width, y);
    plot.ctx.stroke();
    plot.ctx.restore();
  }

  resize() {
    for (const chart of this.charts) {
      const frame = chart.root.parentElement;
      if (frame.clientWidth) chart.setSize({ width: frame.clientWidth, height: frame.clientHeight });
    }
  }
}

/** A round number above all values, which changes when it is too small, or four times too large. */
export function top(before, ...columns) {
  let highest = 0;
  for (const column of columns) for (const value of column) if (known(value) && value > highest) highest = value;
  if (highest * ROOM <= before && highest * 4 > before) return before;
  return highest > 0 ? round(highest * ROOM) : before;
}

/** The next of a few round numbers. */
function round(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 1.5, 2, 3, 4, 5, 6, 8, 10].find((times) => times * power >= value * 0.999999);
}
