/** The newest reading in large letters, its margin to the trip, and its age. */

import { Instant, OLD_S } from "/static/feed.js";
import { at, mark, write } from "/static/page.js";
import { N_PER_GWT, ago, fixed, inBoth, inMmAndUm, known, timeOfDay } from "/static/units.js";

const SHORT = 5; // characters that fit in large letters
const NEAR = [0.6, 0.9]; // shares of the trip

export class Numbers {
  constructor() {
    this.limits = {};
    this.forget();
  }

  forget() {
    this.newest = null;
    this.read = null;
  }

  state({ unix_s, newest, limits }) {
    this.limits = limits ?? {};
    if (newest && known(newest.age_s)) this.newer(unix_s - newest.age_s, newest);
  }

  readings({ columns, rows }) {
    const last = rows.at(-1);
    if (last) this.newer(last[columns.indexOf("unix_s")], Object.fromEntries(columns.map((name, n) => [name, last[n]])));
  }

  newer(unix_s, reading) {
    if (this.read !== null && unix_s < this.read.unix_s) return;
    if (this.read === null || unix_s > this.read.unix_s) this.read = new Instant(unix_s);
    this.newest = { ...this.newest, ...reading };
  }

  /** The age of the newest reading; null without one. */
  get age_s() {
    return this.read === null ? null : this.read.age_s;
  }

  look() {
    const { newest, limits } = this;
    const force_gwt = newest?.force_gwt;
    write("force_gwt", fixed(force_gwt, 2));
    mark(at("force_gwt").parentElement, "long", fixed(force_gwt, 2).length > SHORT);
    write("force_n", known(force_gwt) ? fixed(force_gwt * N_PER_GWT, 4) : "–");
    write("depth_words", inMmAndUm(newest?.doi_mm));
    write("x_words", known(newest?.x_mm) ? `${fixed(newest.x_mm, 2)} mm` : "–");
    write("height_words", known(newest?.height_mm) ? `${fixed(newest.height_mm, 3)} mm` : "–");
    write("phase_words", newest?.phase || "–");
    write("trip_words", inBoth(limits.trip_gwt));
    write("deepest_words", known(limits.max_doi_mm) ? `${fixed(limits.max_doi_mm, 2)} mm` : "–");
    this.margin(force_gwt, limits.trip_gwt);
    this.dated();
  }

  /** Push and pull count alike. */
  margin(force_gwt, trip_gwt) {
    const share = known(force_gwt) && trip_gwt > 0 ? Math.min(1, Math.abs(force_gwt) / trip_gwt) : 0;
    const percent = Math.round(share * 100);
    write("margin_words", known(force_gwt) && known(trip_gwt) ? inBoth(trip_gwt - Math.abs(force_gwt)) : "–");
    at("margin").setAttribute("aria-valuenow", percent);
    at("margin").setAttribute("aria-valuetext", `${percent} % of the trip`);
    at("margin_bar").style.width = `${percent}%`;
    mark(at("margin_bar"), "near", share >= NEAR[0]);
    mark(at("margin_bar"), "next_to", share >= NEAR[1]);
  }

  dated() {
    const old = this.read !== null && this.age_s > OLD_S;
    mark(at("numbers"), "old", old);
    mark(at("numbers"), "unread", this.read === null);
    if (this.read === null) write("read_at", "no reading yet", "unread");
    else if (old) write("read_at", `NOT LIVE: read at ${timeOfDay(this.read.unix_s)}, ${ago(this.age_s)}`, "old");
    else write("read_at", "live", "live");
  }
}
