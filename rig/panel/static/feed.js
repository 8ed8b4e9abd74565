/** Events from the server and their age; reconnects after each loss, and only while the tab is visible. */

import { tab } from "/static/access.js";

const EVENTS = ["state", "readings", "schedule", "prediction", "section"];
const AGAIN_MS = 500;
const LOST_S = 5;
const SILENT_S = 1.5; // the server sends its state twice a second
export const OLD_S = 1;

/** The time of an event by the server's clock, which is this machine's, and by the time passed here since.
 *
 * The larger age counts, so that neither a clock set back nor delayed events make data look younger.
 */
export class Instant {
  constructor(unix_s) {
    this.unix_s = unix_s;
    this.came_ms = performance.now();
    this.age_then_s = Math.max(0, Date.now() / 1000 - unix_s);
  }

  get age_s() {
    return Math.max(Date.now() / 1000 - this.unix_s, this.age_then_s + (performance.now() - this.came_ms) / 1000);
  }
}

export class Feed {
  /** take(name, data) is called for every event. */
  constructor(take) {
    this.take = take;
    this.heard = null;
    this.source = null;
    document.addEventListener("visibilitychange", () => this.follow());
    this.follow();
  }

  /** Whether there was no event for too long. */
  get silent() {
    return this.heard === null || this.heard.age_s > SILENT_S;
  }

  /** Treat a silent connection as lost. */
  look() {
    const waited_s = (performance.now() - this.begun_ms) / 1000;
    if (this.source !== null && this.silent && waited_s > LOST_S) this.follow();
  }

  follow() {
    clearTimeout(this.again);
    this.begun_ms = performance.now();
    this.source?.close();
    this.source = null;
    if (document.visibilityState === "hidden") return;
    const source = new EventSource(`/events?tab=${encodeURIComponent(tab)}`);
    source.onerror = () => {
      source.close();
      this.again = setTimeout(() => this.follow(), AGAIN_MS);
    };
    for (const name of EVENTS) source.addEventListener(name, (event) => this.hear(name, JSON.parse(event.data)));
    this.source = source;
  }

  hear(name, data) {
    this.heard = new Instant(data.unix_s);
    this.take(name, data);
  }
}
