/** Readings for the plots: the last minute and the present indentation, up to a limit. */

import { known } from "/static/units.js";

export const WINDOW_S = 60;
const MOST_ROWS = 6000;
const MOST_CURVES = 50;

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
    for (const row of rows) this.row((name) => row[place[name]]);
    this.trim();
  }

  row(of) {
    const t_s = of("t_s");
    if (this.time[0].length && t_s < this.time[0].at(-1)) this.forget();
    const press = known(of("index")) && of("index") >= 0 ? `${of("purpose") ?? "data"} ${of("index")}` : null; // −1: outside a press
    const doi_mm = of("doi_mm") ?? null;
    [t_s, of("force_gwt"), doi_mm, this.said(press, doi_mm), press].forEach((value, n) => this.time[n].push(value));
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

  /** Store the prediction for a press, and apply it to the readings that came before. */
  prediction({ run, index, purpose, doi_mm, force_gwt }) {
    if (!doi_mm?.length || !force_gwt?.length) return;
    const press = `${purpose ?? "data"} ${index}`;
    this.curves.set(`${run ?? null} ${press}`, [doi_mm, force_gwt]);
    if (this.curves.size > MOST_CURVES) this.curves.delete(this.curves.keys().next().value);
    this.time[3] = this.time[3].map((before, n) => (this.time[4][n] === press ? this.said(press, this.time[2][n]) : before));
  }

  /** The force predicted for the reading's press; null without a prediction. */
  said(press, doi_mm) {
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
  if (n === 0) return ys[0];
  return ys[n - 1] + ((ys[n] - ys[n - 1]) * (x - xs[n - 1])) / (xs[n] - xs[n - 1]);
}
