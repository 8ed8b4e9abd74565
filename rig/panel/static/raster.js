/** Spikes of simulated afferents in the last seconds, a row for each afferent. */

import { at, show, write } from "/static/page.js";

const WINDOW_S = 10;
const LABELS_PX = 64;
const AXIS_PX = 20;
const MOST_LABELS = 16;
const FONT = "12px system-ui, sans-serif";

export class Raster {
  constructor(colours) {
    this.colours = colours;
    this.data = null;
  }

  /** Ages of spikes count from the time at which the server sent them, by its clock, which is this machine's. */
  spikes(data) {
    this.data = data;
  }

  look() {
    show("spikes", this.data !== null);
    if (this.data === null || !at("spikes").offsetParent) return;
    const { afferents, connected, rows, unix_s } = this.data;
    const age_s = Math.max(0, Date.now() / 1000 - unix_s);
    this.draw(afferents, rows.map(([row, then_s]) => [row, then_s + age_s]));
    const many = `${afferents.length} simulated afferent${afferents.length === 1 ? "" : "s"}, last ${WINDOW_S} s`;
    write("spikes_words", connected ? many : `not connected to rig serve; ${many}`, connected ? "connected" : "lost");
  }

  draw(afferents, spikes) {
    const canvas = at("raster");
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    const ratio = devicePixelRatio;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const ctx = canvas.getContext("2d");
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    ctx.clearRect(0, 0, width, height);
    ctx.font = FONT;
    const row_px = (height - AXIS_PX) / Math.max(1, afferents.length);
    const x = (age_s) => LABELS_PX + (width - LABELS_PX) * (1 - age_s / WINDOW_S);
    this.axis(ctx, x, height);
    const each = Math.ceil(afferents.length / MOST_LABELS);
    ctx.fillStyle = this.colours.of("--ink");
    ctx.textAlign = "right";
    ctx.textBaseline = "middle";
    afferents.forEach((name, row) => row % each === 0 && ctx.fillText(name, LABELS_PX - 6, (row + 0.5) * row_px));
    ctx.fillStyle = this.colours.of("--measured");
    const tall = Math.max(1, 0.8 * row_px);
    for (const [row, age_s] of spikes) if (age_s < WINDOW_S) ctx.fillRect(x(age_s) - 0.75, (row + 0.1) * row_px, 1.5, tall);
  }

  axis(ctx, x, height) {
    ctx.strokeStyle = this.colours.of("--faint");
    ctx.fillStyle = this.colours.of("--soft");
    ctx.textBaseline = "alphabetic";
    for (let age_s = 0; age_s <= WINDOW_S; age_s += 2) {
      ctx.beginPath();
      ctx.moveTo(x(age_s), 0);
      ctx.lineTo(x(age_s), height - AXIS_PX);
      ctx.stroke();
      ctx.textAlign = age_s === 0 ? "right" : "center";
      ctx.fillText(age_s === 0 ? "now" : `\u2212${age_s} s`, x(age_s), height - 4);
    }
  }
}
