/** Steps of the run: done, present and next, and the remaining time. */

import { at, mark, show, write } from "/static/page.js";
import { asClock, known } from "/static/units.js";

const ENDED = ["done", "incomplete", "aborted", "tripped", "limited", "failed", "killed"];

export class Schedule {
  constructor() {
    this.shown = "";
    this.of = null;
    this.run = null;
  }

  state({ run }) {
    this.run = run;
  }

  schedule({ run, steps }) {
    this.of = run ?? null;
    const text = JSON.stringify(steps);
    if (text === this.shown) return;
    this.shown = text;
    const list = at("steps");
    while (list.children.length > steps.length) list.lastChild.remove();
    while (list.children.length < steps.length) list.append(document.createElement("li"));
    steps.forEach((step, n) => written(list.children[n], step));
    this.followed = false;
  }

  /** Scroll the present step into view, within its own frame. */
  follow() {
    const frame = at("steps_frame");
    const now = frame.querySelector("[aria-current]");
    this.followed = true;
    if (now && document.activeElement !== frame) frame.scrollTop = now.offsetTop - frame.clientHeight / 3;
  }

  look() {
    const { run } = this;
    left(run);
    write("done_words", run ? `${run.done} of ${run.planned ?? "?"} indentations` : "–");
    write("now_words", run?.now || "–");
    write("next_words", run?.next || "–");
    at("done_bar").value = run?.planned ? run.done / run.planned : 0;
    show("schedule", Boolean(run));
    show("steps_frame", at("steps").children.length > 0 && run?.name === this.of);
    if (!this.followed && at("steps_frame").offsetParent) this.follow();
  }
}

function left(run) {
  if (!run) write("left_words", "no run", "no_run");
  else if (ENDED.includes(run.state)) write("left_words", run.state, run.state);
  else if (known(run.left_s)) write("left_words", `${asClock(run.left_s)} left`, "left");
  else write("left_words", "time left unknown", "unknown");
}

function written(row, { words, block, condition, repeat, done, now }) {
  const marks = [known(block) ? `block ${block}` : null, condition, known(repeat) ? `repeat ${repeat}` : null];
  const text = [words, marks.filter(Boolean).join(", ")].filter(Boolean).join(" · ");
  const state = now ? "now" : done ? "done" : "";
  if (row.dataset.shown === `${state} ${text}`) return;
  row.dataset.shown = `${state} ${text}`;
  const first = document.createElement("span");
  first.className = "mark";
  first.textContent = state;
  row.replaceChildren(first, ` ${text}`);
  mark(row, "done", Boolean(done) && !now);
  if (now) row.setAttribute("aria-current", "step");
  else row.removeAttribute("aria-current");
}
