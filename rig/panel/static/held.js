/** Jog with a dead man's switch: sends ten times a second that a button or key is held, and its release at once.
 *
 * Any doubt (another tab or window, a second key, a page that hung) releases it.
 */

import { post } from "/static/access.js";

const EACH_MS = 100;
const HUNG_MS = 250; // validity of one hold signal

export class Held {
  /** told(words) shows the result of a press; null while it is held. */
  constructor(told) {
    this.told = told;
    this.now = null;
    this.last_press = 0;
    window.addEventListener("blur", () => this.release("released: another window has the keyboard"));
    window.addEventListener("pagehide", () => this.release("released"));
    document.addEventListener("visibilitychange", () => document.hidden && this.release("released: the tab was hidden"));
  }

  /** What: {axis, sign, speed_mm_s}; by: the button or key. */
  press(what, by) {
    if (this.now !== null) return this.release("released: two buttons at once");
    this.last_press = Math.max(Date.now(), this.last_press + 1);
    const abort = new AbortController();
    this.now = { what, by, press: this.last_press, abort, asked: false, ticked_ms: performance.now() };
    this.now.timer = setInterval(() => this.tick(), EACH_MS);
    this.told(null);
    this.send(this.now);
  }

  tick() {
    const held = this.now;
    const late_ms = performance.now() - held.ticked_ms;
    held.ticked_ms = performance.now();
    if (late_ms > HUNG_MS) this.release("released: this page was too slow");
    else if (!held.asked) this.send(held);
  }

  async send(held) {
    held.asked = true;
    const { what, press, abort } = held;
    const answer = await post("/hold", { ...what, press, unix_s: Date.now() / 1000 }, { signal: abort.signal });
    held.asked = false;
    if (this.now === held && !answer.ok) this.release(`stopped: ${answer.problem}`);
  }

  /** End the hold; without words it was released normally. */
  release(words = "") {
    const held = this.now;
    if (held === null) return;
    this.now = null;
    clearInterval(held.timer);
    held.abort.abort();
    post("/release", { press: held.press }, { keepalive: true });
    this.told(words);
  }

  /** Release what this button or key holds. */
  letGo(by) {
    if (this.now?.by === by) this.release();
  }
}
