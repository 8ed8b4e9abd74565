/** The readings that are drawn: the last minute, and the indentation that is under way; never more than so many. */

import { known } from "/static/units.js";

export const WINDOW_S = 60;
const MOST_ROWS = 6000;

export class Buffer {
  constructor() {
    this.curve = null;
    this.forget();
  }

  forget() {
    this.time = [[], [], []]; // s on the run's clock, gwt, mm
    this.press = null;
    this.pressed = [[], []]; // mm, gwt
  }

  /** Columns are found by name. */
  take({ run, columns, rows }) {
    this.run = run ?? null;
    const place = Object.fromEntries(columns.map((name, n) => [name, n]));
    for (const row of rows) this.row((name) => row[place[name]]);
    this.trim();
  }

  row(of) {
    const t_s = of("t_s");
    if (this.time[0].length && t_s < this.time[0].at(-1)) this.forget();
    this.time[0].push(t_s);
    this.time[1].push(of("force_gwt"));
    this.time[2].push(of("doi_mm") ?? null);
    const press = known(of("index")) ? `${of("purpose") ?? "data"} ${of("index")}` : null;
    if (press !== null && press !== this.press) {
      this.press = press;
      this.pressed = [[], []];
    }
    if (press !== null && known(of("doi_mm")) && known(of("force_gwt"))) {
      this.pressed[0].push(of("doi_mm"));
      this.pressed[1].push(of("force_gwt"));
    }
  }

  trim() {
    const [times] = this.time;
    const from_s = times.at(-1) - WINDOW_S;
    const old = Math.max(times.findIndex((t_s) => t_s >= from_s), times.length - MOST_ROWS, 0);
    this.time = this.time.map((column) => column.slice(old));
    this.pressed = this.pressed.map((column) => column.slice(-MOST_ROWS));
  }

  /** What the model said of a press; empty where it said nothing. */
  prediction({ run, index, purpose, doi_mm, force_gwt }) {
    const told = doi_mm?.length && force_gwt?.length;
    this.curve = told ? { run: run ?? null, press: `${purpose ?? "data"} ${index}`, doi_mm, force_gwt } : null;
  }

  /** The curve of the press that is drawn: [mm, gwt]. */
  get predicted() {
    return this.curve && this.curve.press === this.press && this.curve.run === this.run ? [this.curve.doi_mm, this.curve.force_gwt] : [[], []];
  }

  /** What the model says at each depth that was read, over time; null where it says nothing. */
  get predictedInTime() {
    const [doi_mm, force_gwt] = this.predicted;
    return this.time[2].map((depth_mm) => (known(depth_mm) ? interpolated(depth_mm, doi_mm, force_gwt) : null));
  }
}

/** Between the two nearest points of a rising row; null outside. */
export function interpolated(x, xs, ys) {
  const n = xs.findIndex((one) => one >= x);
  if (n < 0 || (n === 0 && xs[0] > x)) return null;
  if (n === 0) return ys[0];
  return ys[n - 1] + ((ys[n] - ys[n - 1]) * (x - xs[n - 1])) / (xs[n] - xs[n - 1]);
}
