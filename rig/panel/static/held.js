/** Jog with a dead man's switch: sends ten times a second that a button or key is held, and its release at once.
 *
 * Any doubt (another tab or window, a second button or key, a page that hung) releases it.
 */

import { post } from "/static/access.js";

const EACH_MS = 100;
const HUNG_MS = 250; // validity of one hold signal
export const WORDS = {
  ready: "hold a button or its key to move; release it to stop",
  moving: "moving while held",
  another_window: "released: another window has the keyboard",
  page_left: "released",
  tab_hidden: "released: the tab was hidden",
  two_buttons: "released: two buttons at once",
  page_too_slow: "released: this page was too slow",
  not_allowed: "released: this tab may not move the stage now",
};

export class Held {
  constructor() {
    this.now = null;
    this.tell("ready");
    this.last_press = 0;
    window.addEventListener("blur", () => this.release("another_window"));
    window.addEventListener("pagehide", () => this.release("page_left"));
    document.addEventListener("visibilitychange", () => document.hidden && this.release("tab_hidden"));
  }

  /** What: {axis, sign, speed_mm_s}; by: the button or key. */
  press(what, by) {
    if (this.now !== null) return this.release("two_buttons");
    this.last_press = Math.max(Date.now(), this.last_press + 1);
    const abort = new AbortController();
    this.now = { what, by, press: this.last_press, abort, asked: false, ticked_ms: performance.now() };
    this.now.timer = setInterval(() => this.tick(), EACH_MS);
    this.tell("moving");
    this.send(this.now);
  }

  tick() {
    const held = this.now;
    const late_ms = performance.now() - held.ticked_ms;
    held.ticked_ms = performance.now();
    if (late_ms > HUNG_MS) this.release("page_too_slow");
    else if (!held.asked) this.send(held);
  }

  async send(held) {
    held.asked = true;
    const { what, press, abort } = held;
    const answer = await post("/hold", { ...what, press, unix_s: Date.now() / 1000 }, { signal: abort.signal });
    held.asked = false;
    if (this.now === held && !answer.ok) this.release(answer.code, `stopped: ${answer.problem}`);
  }

  /** End the hold, and say why; `ready`: it was released normally. */
  release(code = "ready", words = WORDS[code]) {
    const held = this.now;
    if (held === null) return;
    this.now = null;
    clearInterval(held.timer);
    held.abort.abort();
    post("/release", { press: held.press }, { keepalive: true });
    this.tell(code, words);
  }

  /** Store what is held, or why it was released, for the reader and as a code. */
  tell(code, words = WORDS[code]) {
    this.code = code;
    this.words = words;
  }

  /** Release what this button or key holds. */
  letGo(by) {
    if (this.now?.by === by) this.release();
  }
}
