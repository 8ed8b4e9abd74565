/** Events from the server and their age; reconnects after each loss, and only while the tab is visible.
 *
 * An EventSource cannot send the token, without which the server opens no stream.
 */

import { hasToken, headers, tab } from "/static/access.js";

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
    this.source = null; // ends the stream
    document.addEventListener("visibilitychange", () => this.follow());
    window.addEventListener("token", () => this.follow());
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
    this.source?.abort();
    this.source = null;
    if (document.visibilityState === "hidden" || !hasToken()) return;
    const source = new AbortController();
    this.source = source;
    this.listen(source).catch(() => {}).then(() => {
      if (source === this.source) this.again = setTimeout(() => this.follow(), AGAIN_MS);
    });
  }

  /** Take events until the stream ends or is aborted. */
  async listen({ signal }) {
    const options = { headers: headers(), cache: "no-store", credentials: "omit", redirect: "error", signal };
    const response = await fetch(`/events?tab=${encodeURIComponent(tab)}`, options);
    if (!response.ok) return;
    window.dispatchEvent(new Event("stream"));
    const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
    for (let text = ""; ; ) {
      const { value, done } = await reader.read();
      if (done || signal.aborted) return;
      const events = (text + value).split("\n\n");
      text = events.pop();
      for (const event of events) {
        const [, name, data] = /^event: (.*)\ndata: (.*)$/.exec(event) ?? [];
        if (EVENTS.includes(name)) this.hear(name, JSON.parse(data));
      }
    }
  }

  hear(name, data) {
    this.heard = new Instant(data.unix_s);
    this.take(name, data);
  }
}
