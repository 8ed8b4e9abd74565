/** Controls that are allowed now: pause, continue, manual control, steps, home, zero, park, leave. */

import { at, post, show, write } from "/static/stop.js";

export class Controls {
  /** said(words, code): shows a refusal, or hides the last one; mine(): whether this tab has control and the server responds. */
  constructor(said, mine) {
    this.said = said;
    this.mine = mine;
    this.latest = null;
    this.asked = null; // the button whose request has no reply yet
    for (const button of document.querySelectorAll("[data-post]")) button.addEventListener("click", () => this.ask(button));
    for (const button of at("directions").children) button.addEventListener("click", () => this.step(button));
    window.addEventListener("keydown", (event) => this.keyDown(event));
  }

  state(data) {
    this.latest = data;
  }

  async ask(button) {
    this.asked = button.firstChild.textContent.trim();
    await this.post(button, `/${button.dataset.post}`, JSON.parse(button.dataset.body ?? "{}"));
    this.asked = null;
  }

  /** A direction: one step a click, or a press of its key. */
  step(button) {
    const by_mm = Number(document.querySelector("input[name=size]:checked").value);
    const { axis, sign } = button.dataset;
    return this.post(button, "/step", { axis, sign: Number(sign), by_mm, unix_s: Date.now() / 1000 });
  }

  async post(button, path, body) {
    const answer = await post(path, body);
    this.said(answer.ok ? "" : `${button.firstChild.textContent.trim()}: ${answer.problem}`, answer.code);
  }

  /** One press, one step or one size: the repeats of a held key do nothing. */
  keyDown(event) {
    if (event.repeat && event.target.closest("#directions")) event.preventDefault(); // Enter on a button
    const typing = event.target.matches("input[type=text]") || event.ctrlKey || event.altKey || event.metaKey;
    if (typing || !at("directions").offsetParent) return;
    const found = at("hand_controls").querySelector(`[data-key="${CSS.escape(event.key.toLowerCase())}"]`);
    if (found === null || found.disabled) return;
    event.preventDefault();
    if (!event.repeat) found.click();
  }

  look() {
    const { latest } = this;
    const kind = latest?.owner?.kind ?? null;
    const may = this.mine();
    show("run_controls", kind === "run");
    show("hand_controls", kind === "by hand");
    show("idle_controls", latest !== null && kind === null && latest.configured);
    at("idle_controls").dataset.after = latest?.attention?.may_touch ? "contact" : "";
    show("zero_anyway", latest?.hand?.did === "zero" && latest.hand.ended_by !== null);
    for (const button of document.querySelectorAll("[data-post]")) button.disabled = !may || this.asked !== null || this.refused(button.dataset.post);
    for (const button of at("directions").children) button.disabled = !may || this.asked !== null || this.refused("step");
    const parts = this.saying(kind);
    write("controls_words", parts.map(([, words]) => words).join("; "), parts.map(([code]) => code).join(" "));
  }

  /** Whether the server would refuse a request. */
  refused(what) {
    const { owner, hand, configured, attention } = this.latest ?? {};
    if (what === "by_hand") return !configured;
    if (what === "pause") return owner?.state !== "running" || Boolean(attention);
    if (what === "go_on") return owner?.state !== "paused" || Boolean(attention);
    if (what === "leave") return false;
    return Boolean(!hand || (hand.stopped && what !== "home") || hand.busy);
  }

  /** What the controls do now: pairs of code and words. */
  saying(kind) {
    if (this.asked !== null) return [["asked", `${this.asked} …`]];
    if (this.latest === null) return [["waiting", "no controls available yet"]];
    const { owner, hand, configured, attention, run } = this.latest;
    if (kind === "run") {
      if (owner.reachable === false && run?.state === "running") return [["no_answer", "the process of the run does not answer"]];
      if (attention) return [["ends", `the run ends (${attention.status}); its process closes the record`]];
      return [[owner.state, `the run is ${owner.state}`]];
    }
    if (kind === null) {
      if (!configured) return [["not_configured", "no process owns the ports; for manual control start rig panel --config TOML"]];
      return [attention?.may_touch ? ["after_contact", "first do what the notice says; then start manual control"] : ["free", "no process owns the ports"]];
    }
    if (!hand) return [["no_answer", "the process of manual control does not answer"]];
    const { busy } = hand;
    const parts = [
      ["busy", busy && `busy: ${busy}`],
      ["ended", !attention && !busy && hand.ended_by], // else the notice has it, and what follows
      ["contact", !attention && hand.contact?.may_touch && hand.contact.where_text],
      ["next", !attention && !busy && hand.next],
      ["stopped", hand.stopped && "stopped: only Home moves"],
      ["not_homed", !hand.homed && (busy || !hand.next) && "not homed"],
      ["not_zeroed", !hand.zeroed && (busy || !hand.homed) && "not zeroed"], // else `next` has it
    ].filter(([, words]) => words);
    return parts.length ? parts : [["by_hand", "manual control"]];
  }
}
