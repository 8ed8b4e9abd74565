/** Controls that are allowed now: pause, continue, manual control, jog, home, zero, leave. */

import { post } from "/static/access.js";
import { Held } from "/static/held.js";
import { at, mark, show, write } from "/static/page.js";

const HINT = "hold a button or its key to move; release it to stop";

export class Controls {
  /** said(words): shows the server's reply; mine(): whether this tab has control and the server responds. */
  constructor(said, mine) {
    this.said = said;
    this.mine = mine;
    this.words = "";
    this.told = null;
    this.held = new Held((words) => (this.words = words ?? "moving while held"));
    for (const button of document.querySelectorAll("[data-post]")) button.addEventListener("click", () => this.ask(button));
    for (const button of at("jog").children) this.jogged(button);
    window.addEventListener("keydown", (event) => this.keyDown(event));
    window.addEventListener("keyup", (event) => this.held.letGo(event.code));
  }

  state(data) {
    this.told = data;
  }

  async ask(button) {
    const name = button.firstChild.textContent.trim();
    const answer = await post(`/${button.dataset.post}`, JSON.parse(button.dataset.body ?? "{}"));
    this.said(answer.ok ? `${name}: ${answer.words ?? "understood"}` : `${name}: ${answer.problem}`, !answer.ok);
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

  keyDown(event) {
    const button = at("jog").querySelector(`[data-key="${CSS.escape(event.key.toLowerCase())}"]`);
    const typing = event.target.matches("input[type=text]") || event.ctrlKey || event.altKey || event.metaKey;
    if (button === null || button.disabled || event.repeat || typing || !at("jog").offsetParent) return;
    event.preventDefault();
    this.held.press(this.what(button), event.code);
  }

  look() {
    const { told } = this;
    const kind = told?.owner?.kind ?? null;
    const may = this.mine();
    show("run_controls", kind === "run");
    show("hand_controls", kind === "by hand");
    show("idle_controls", told !== null && kind === null);
    for (const button of document.querySelectorAll("[data-post]")) button.disabled = !may || this.refused(button.dataset.post);
    for (const button of at("jog").children) {
      button.disabled = !may || this.refused("hold");
      mark(button, "held", this.held.now?.by === button || (this.held.now !== null && this.held.now.by === `Key${button.dataset.key.toUpperCase()}`));
    }
    if (this.held.now !== null && (!may || this.refused("hold"))) this.held.release("released: this tab may not move the stage now");
    write("controls_words", this.saying(kind));
    write("jog_words", this.words || HINT);
  }

  /** Whether the server would refuse a request. */
  refused(what) {
    const { owner, hand, configured } = this.told ?? {};
    if (what === "by_hand") return !configured;
    if (what === "pause") return owner?.state !== "running";
    if (what === "go_on") return owner?.state !== "paused";
    if (what === "leave") return false;
    return Boolean(hand?.stopped && what !== "home") || Boolean(hand?.busy && hand.busy !== "jog");
  }

  saying(kind) {
    const { owner, hand, configured } = this.told ?? {};
    if (kind === "run") return owner.reachable === false ? "the process of the run does not answer" : owner.stopped ? "stopped" : `the run is ${owner.state}`;
    if (kind === null) return configured ? "no process owns the ports" : "no process owns the ports; for manual control start rig panel --config TOML";
    if (hand === null || hand === undefined) return "starting manual control …";
    const busy = hand.busy ? `busy: ${hand.busy}` : null;
    const parts = [busy, hand.ended_by, hand.contact?.may_touch ? hand.contact.where_text : null, hand.stopped ? "stopped" : null, hand.next, hand.homed ? null : "not homed", hand.zeroed ? null : "not zeroed"];
    return parts.filter(Boolean).join("; ") || "by hand";
  }
}
