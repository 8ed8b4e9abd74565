/** Controls that are allowed now: pause, continue, manual control, jog, home, zero, leave. */

import { post } from "/static/access.js";
import { Held } from "/static/held.js";
import { at, mark, show, write } from "/static/page.js";

export class Controls {
  /** said(words, code, bad): shows the server's reply; mine(): whether this tab has control and the server responds. */
  constructor(said, mine) {
    this.said = said;
    this.mine = mine;
    this.latest = null;
    this.held = new Held();
    for (const button of document.querySelectorAll("[data-post]")) button.addEventListener("click", () => this.ask(button));
    for (const button of at("jog").children) this.jogged(button);
    window.addEventListener("keydown", (event) => this.keyDown(event));
    window.addEventListener("pointerdown", (event) => this.pointerDown(event));
    window.addEventListener("keyup", (event) => this.held.letGo(event.code));
  }

  state(data) {
    this.latest = data;
  }

  async ask(button) {
    const name = button.firstChild.textContent.trim();
    const answer = await post(`/${button.dataset.post}`, JSON.parse(button.dataset.body ?? "{}"));
    this.said(`${name}: ${answer.ok ? (answer.words ?? "accepted") : answer.problem}`, answer.ok ? "understood" : answer.code, !answer.ok);
    if (button.dataset.post === "zero") show("zero_anyway", !answer.ok && answer.status === 409);
  }

  /** Mouse, touch and pen, and Space or Enter on the button. */
  jogged(button) {
    const begin = (event, by) => {
      event.preventDefault();
      if (!button.disabled) this.held.press(this.what(button), by);
    };
    button.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      button.focus();
      button.setPointerCapture(event.pointerId);
      begin(event, button);
    });
    for (const name of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) button.addEventListener(name, () => this.held.letGo(button));
    button.addEventListener("contextmenu", (event) => event.preventDefault());
    button.addEventListener("keydown", (event) => {
      if (event.key !== " " && event.key !== "Enter") return;
      if (event.repeat) event.preventDefault();
      else begin(event, button);
    });
    button.addEventListener("keyup", (event) => (event.key === " " || event.key === "Enter") && this.held.letGo(button));
  }

  what(button) {
    const speed_mm_s = Number(document.querySelector("input[name=speed]:checked").value);
    return { axis: button.dataset.axis, sign: Number(button.dataset.sign), speed_mm_s };
  }

  /** A second key of any kind releases: beside Cmd, macOS never reports that a letter was released. */
  keyDown(event) {
    const by = this.held.now?.by ?? null;
    const own = by === event.code || (by === event.target && (event.key === " " || event.key === "Enter"));
    if (by !== null && !own && !event.repeat) return this.held.release("two_buttons");
    const button = at("jog").querySelector(`[data-key="${CSS.escape(event.key.toLowerCase())}"]`);
    const typing = event.target.matches("input[type=text]") || event.ctrlKey || event.altKey || event.metaKey;
    if (button === null || button.disabled || event.repeat || typing || !at("jog").offsetParent) return;
    event.preventDefault();
    this.held.press(this.what(button), event.code);
  }

  /** So does a click elsewhere; the menu of its right button would swallow the release of a key. */
  pointerDown(event) {
    const by = this.held.now?.by ?? null;
    if (by !== null && by !== event.target.closest("button")) this.held.release("two_buttons");
  }

  look() {
    const { latest, held } = this;
    const kind = latest?.owner?.kind ?? null;
    const may = this.mine();
    show("run_controls", kind === "run");
    show("hand_controls", kind === "by hand");
    show("idle_controls", latest !== null && kind === null);
    for (const button of document.querySelectorAll("[data-post]")) button.disabled = !may || this.refused(button.dataset.post);
    for (const button of at("jog").children) {
      button.disabled = !may || this.refused("hold");
      mark(button, "held", held.now?.what.axis === button.dataset.axis && held.now.what.sign === Number(button.dataset.sign));
    }
    if (!may || this.refused("hold")) held.release("not_allowed");
    const parts = this.saying(kind);
    write("controls_words", parts.map(([, words]) => words).join("; "), parts.map(([code]) => code).join(" "));
    write("jog_words", held.words, held.code);
  }

  /** Whether the server would refuse a request. */
  refused(what) {
    const { owner, hand, configured } = this.latest ?? {};
    if (what === "by_hand") return !configured;
    if (what === "pause") return owner?.state !== "running";
    if (what === "go_on") return owner?.state !== "paused";
    if (what === "leave") return false;
    return Boolean(hand?.stopped && what !== "home") || Boolean(hand?.busy && hand.busy !== "jog");
  }

  /** What the controls do now: pairs of code and words. */
  saying(kind) {
    if (this.latest === null) return [["waiting", "no controls available yet"]];
    const { owner, hand, configured } = this.latest;
    if (kind === "run") return [owner.reachable === false ? ["no_answer", "the process of the run does not answer"] : owner.stopped ? ["stopped", "stopped"] : [owner.state, `the run is ${owner.state}`]];
    if (kind === null) return [configured ? ["free", "no process owns the ports"] : ["not_configured", "no process owns the ports; for manual control start rig panel --config TOML"]];
    if (hand === null || hand === undefined) return [["starting", "starting manual control …"]];
    const parts = [
      ["busy", hand.busy && `busy: ${hand.busy}`],
      ["ended", hand.ended_by],
      ["contact", hand.contact?.may_touch && hand.contact.where_text],
      ["stopped", hand.stopped && "stopped"],
      ["next", hand.next],
      ["not_homed", !hand.homed && "not homed"],
      ["not_zeroed", !hand.zeroed && "not zeroed"],
    ].filter(([, words]) => words);
    return parts.length ? parts : [["by_hand", "manual control"]];
  }
}
