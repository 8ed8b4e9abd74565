/** The page: takes the server's events, passes them to its parts, and updates what they show ten times a second. */

import { fixed, known, N_PER_GWT, Section, Traces } from "/static/charts.js";
import { Controls } from "/static/controls.js";
import { at, hasToken, options, post, show, tab, write } from "/static/stop.js";

const OLD_S = 1;
const EVENTS = ["state", "readings", "schedule", "section"];
const [LOOK_MS, AGAIN_MS, LOST_S, SILENT_S] = [100, 500, 5, 1.5]; // the server sends its state ten times a second

// --- numbers in words ---

const inBoth = (gwt) => (known(gwt) ? `${fixed(gwt, 2)} gwt (${fixed(gwt * N_PER_GWT, 4)} N)` : "–");
const inMm = (mm, decimals) => (known(mm) ? `${fixed(mm, decimals)} mm` : "–");
const two = (n) => String(n).padStart(2, "0");
const mark = (element, name, on) => element.classList.contains(name) !== on && element.classList.toggle(name, on);

/** h:mm:ss of seconds. */
function asClock(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  return `${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
}

function timeOfDay(unix_s) {
  const then = new Date(unix_s * 1000);
  return [then.getHours(), then.getMinutes(), then.getSeconds()].map(two).join(":");
}

function since(when) {
  if (when.age_s >= 86_400) return `${new Date(when.unix_s * 1000).toLocaleDateString("sv")} ${timeOfDay(when.unix_s)}`; // ISO 8601
  return `${timeOfDay(when.unix_s)}, ${when.age_s < 100 ? `${Math.floor(when.age_s)} s` : asClock(when.age_s)} ago`;
}

/** The time of an event by the server's clock, which is this machine's, and by the time passed here since.
 *
 * The larger age counts, so that neither a clock set back nor delayed events make data look younger.
 */
class Instant {
  constructor(unix_s) {
    this.unix_s = unix_s;
    this.came_ms = performance.now();
    this.age_then_s = Math.max(0, Date.now() / 1000 - unix_s);
  }

  get age_s() {
    return Math.max(Date.now() / 1000 - this.unix_s, this.age_then_s + (performance.now() - this.came_ms) / 1000);
  }
}

const instant = (unix_s, age_s) => (known(age_s) ? new Instant(unix_s - age_s) : null);

// --- events from the server ---

/** Reconnects after each loss, and only while the tab is visible. An EventSource cannot send the token. */
class Feed {
  constructor(take) {
    this.take = take;
    this.heard = null;
    this.refused = false; // by another panel, which has another token
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
    if (this.source !== null && this.silent && (performance.now() - this.begun_ms) / 1000 > LOST_S) this.follow();
  }

  follow() {
    clearTimeout(this.again);
    this.begun_ms = performance.now();
    this.source?.abort();
    this.source = null;
    if (document.visibilityState === "hidden" || !hasToken()) return;
    const source = new AbortController();
    this.source = source;
    this.listen(source.signal).catch(() => {}).then(() => {
      if (source === this.source) this.again = setTimeout(() => this.follow(), AGAIN_MS);
    });
  }

  async listen(signal) {
    const response = await fetch(`/events?tab=${encodeURIComponent(tab)}`, { ...options(), signal });
    this.refused = response.status === 403;
    if (!response.ok) return;
    const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
    for (let text = ""; ; ) {
      const { value, done } = await reader.read();
      if (done || signal.aborted) return;
      const events = (text + value).split("\n\n");
      text = events.pop();
      for (const event of events) {
        const [, name, json] = /^event: (.*)\ndata: (.*)$/.exec(event) ?? [];
        if (!EVENTS.includes(name)) continue;
        const data = JSON.parse(json);
        this.heard = new Instant(data.unix_s);
        this.take(name, data);
      }
    }
  }
}

// --- force, position and devices ---

class Numbers {
  constructor() {
    const steps = [{ opacity: 0 }, { opacity: 0, offset: 0.999 }, { opacity: 1 }];
    // The browser's compositor runs it, so that old data turn gray even if this page hangs.
    this.veils = [...document.querySelectorAll(".veil")].map((one) => one.animate(steps, { duration: OLD_S * 1000, fill: "forwards" }));
    this.forget();
  }

  forget() {
    [this.newest, this.read, this.placed, this.devices, this.y_moves] = [{}, null, null, {}, false];
  }

  state({ unix_s, newest, limits, devices, owner }) {
    this.unix_s = unix_s;
    this.limits = limits ?? {};
    this.owner = owner;
    this.newer(instant(unix_s, newest?.age_s), newest ?? {}, ["force_gwt", "doi_mm", "phase"], "read");
    this.newer(instant(unix_s, newest?.placed_age_s), newest ?? {}, ["x_mm", "y_mm", "height_mm"], "placed");
    for (const name of ["stage", "force"]) this.devices[name] = devices?.[name] && { ...devices[name], seen: instant(unix_s, devices[name].age_s) };
  }

  readings({ columns, rows }) {
    if (!rows.length) return;
    const last = Object.fromEntries(columns.map((name, n) => [name, rows.at(-1)[n]]));
    this.newer(new Instant(last.unix_s), last, ["force_gwt", "doi_mm", "phase"], "read");
    this.newer(new Instant(last.unix_s), last, ["x_mm", "y_mm", "height_mm"], "placed");
  }

  /** Keep values of the latest time. */
  newer(when, values, names, kind) {
    if (when === null || (this[kind] !== null && when.unix_s < this[kind].unix_s - 0.05)) return;
    if (this[kind] === null || when.unix_s > this[kind].unix_s) this[kind] = when;
    for (const name of names) if (name in values) this.newest[name] = values[name];
    this.y_moves ||= Boolean(this.newest.y_mm);
  }

  look() {
    const { force_gwt, doi_mm, x_mm, y_mm, height_mm, phase } = this.newest;
    const { trip_gwt, max_doi_mm } = this.limits ?? {};
    const place = (mm, decimals) => (!known(mm) && this.devices.stage?.seen && this.devices.stage.homed === false ? "unknown" : inMm(mm, decimals));
    write("force_gwt", fixed(force_gwt, 2));
    mark(at("force_gwt").parentElement, "long", fixed(force_gwt, 2).length > 4);
    write("force_n", known(force_gwt) ? fixed(force_gwt * N_PER_GWT, 4) : "–");
    write("depth_words", known(doi_mm) ? `${inMm(doi_mm, 3)} (${fixed(doi_mm * 1000, 0)} µm)` : "–");
    write("x_words", place(x_mm, 2));
    write("y_words", place(y_mm, 2));
    show("y", this.y_moves);
    write("height_words", place(height_mm, 3));
    write("phase_words", phase || "–");
    write("trip_words", inBoth(trip_gwt));
    write("deepest_words", inMm(max_doi_mm, 2));
    const share = known(force_gwt) && trip_gwt > 0 ? Math.min(1, Math.abs(force_gwt) / trip_gwt) : 0; // push and pull alike
    write("margin_words", known(force_gwt) && known(trip_gwt) ? inBoth(trip_gwt - Math.abs(force_gwt)) : "–");
    at("margin").setAttribute("aria-valuenow", Math.round(share * 100));
    at("margin").setAttribute("aria-valuetext", `${Math.round(share * 100)} % of the trip`);
    at("margin_bar").style.width = `${share * 100}%`;
    mark(at("margin_bar"), "near", share >= 0.6);
    mark(at("margin_bar"), "next_to", share >= 0.9);
    this.dated();
    this.device("stage", "stage_words");
    this.device("force", "sensor_words");
    write("port_words", this.owner ? `${this.owner.ports.join(", ")}${this.owner.virtual ? " (virtual bench)" : ""}` || "–" : known(this.unix_s) ? "free" : "–");
    show("stop_button", Boolean(this.owner?.stop_button));
    write("stop_button_words", this.owner?.stop_button ?? "–");
  }

  dated() {
    const { read } = this;
    const old = read !== null && read.age_s > OLD_S;
    mark(document.body, "old", old);
    mark(document.body, "unread", read === null);
    if (read === null) write("read_at", "no reading yet", "unread");
    else if (old) write("read_at", `NOT LIVE: ${since(read)}`, "old");
    else write("read_at", "live", "live");
    for (const veil of this.veils) {
      veil.currentTime = read === null ? 0 : Math.min(read.age_s, OLD_S) * 1000;
      if (read === null) veil.pause();
      else if (!old && veil.playState !== "running") veil.play();
    }
  }

  /** The last status of a device; of an old one its time. */
  device(name, id) {
    const one = this.devices[name];
    const old = Boolean(one?.seen && one.seen.age_s > OLD_S && one.word !== "Home");
    mark(at(id), "warn", old);
    if (!one) return write(id, "–");
    if (one.word === "Home") return write(id, "homing"); // without reports until its end
    const homed = typeof one.homed !== "boolean" || !one.seen || one.word === "homed" ? "" : one.homed ? ", homed" : ", not homed";
    if (name === "force" && old && one.word === "reads") return write(id, `no reading since ${since(one.seen)}`);
    write(id, `${one.word ?? "–"}${homed}${old ? `, ${since(one.seen)}` : ""}`);
  }
}

// --- the run and its schedule ---

class Schedule {
  constructor() {
    [this.shown, this.of, this.run] = ["", null, null];
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
    steps.forEach((step, n) => this.row(list.children[n], step));
    this.followed = false;
  }

  row(row, { words, block, condition, repeat, done, now }) {
    const marks = [known(block) && `block ${block}`, condition, known(repeat) && `repeat ${repeat}`].filter(Boolean).join(", ");
    const state = now ? "now" : done ? "done" : "";
    const text = [words, marks].filter(Boolean).join(" · ");
    if (row.dataset.shown === `${state} ${text}`) return;
    row.dataset.shown = `${state} ${text}`;
    row.replaceChildren(element("span", state), element("div", text));
    mark(row, "done", Boolean(done) && !now);
    if (now) row.setAttribute("aria-current", "step");
    else row.removeAttribute("aria-current");
  }

  look() {
    const { run } = this;
    const ended = run && run.state !== "running";
    const here = at("steps").querySelector("[aria-current] span");
    if (here) here.textContent = ended ? "ended" : "now";
    if (ended) write("left_words", run.state, run.state);
    else if (known(run?.left_s)) write("left_words", `${asClock(run.left_s)} left`, "left");
    else write("left_words", "time left unknown", "unknown");
    write("done_words", run ? `${run.done} of ${run.planned ?? "?"} indentations` : "–");
    write("now_words", run?.now || "–");
    write("next_words", run?.next || "–");
    at("done_bar").value = run?.planned ? run.done / run.planned : 0;
    show("schedule", Boolean(run));
    show("steps_frame", at("steps").children.length > 0 && run?.name === this.of);
    const frame = at("steps_frame");
    if (this.followed || !frame.offsetParent) return;
    const now = frame.querySelector("[aria-current]"); // scroll it into view, within its own frame
    if (now && document.activeElement !== frame) frame.scrollTop = now.offsetTop - frame.clientHeight / 3;
    this.followed = true;
  }
}

function element(kind, words) {
  const made = document.createElement(kind);
  made.textContent = words;
  return made;
}

/** The list of runs, with filters. */
class Runs {
  constructor() {
    [this.limit, this.asked] = [100, 0];
    const again = (wait_ms) => {
      clearTimeout(this.typing);
      this.typing = setTimeout(() => this.load(), wait_ms);
    };
    at("filters").addEventListener("input", () => again(250));
    at("filters").addEventListener("reset", () => again(0));
    at("filters").addEventListener("submit", (event) => (event.preventDefault(), again(0)));
    at("more").addEventListener("click", () => ((this.limit *= 4), this.load()));
  }

  async load() {
    const asked = ++this.asked;
    const query = new URLSearchParams([...new FormData(at("filters"))].filter(([, value]) => value.trim()));
    query.set("limit", this.limit);
    try {
      const response = await fetch(`/runs.json?${query}`, { cache: "no-store" });
      const reply = await response.json();
      if (asked !== this.asked) return;
      if (response.ok) this.list(reply);
      else write("runs_words", reply.problem ?? `the server returned ${response.status}`);
    } catch {
      write("runs_words", "the panel's server does not answer");
    }
  }

  list({ runs, unreadable = [], problem }) {
    const more = runs.length >= this.limit;
    write("runs_words", problem ?? `${runs.length} run${runs.length === 1 ? "" : "s"}${more ? ", the newest" : ""}`);
    at("runs_rows").replaceChildren(...runs.map((run) => this.row(run)));
    at("unreadable").replaceChildren(...unreadable.map((one) => element("li", `${one.name}: ${one.problem}`)));
    show("more", more);
  }

  row(run) {
    const row = document.createElement("tr");
    const first = element("th", "");
    first.scope = "row";
    const report = element("a", run.date_utc.replace("T", " ").replace(/(\+00:00|Z)$/, ""));
    Object.assign(report, { href: `/runs/${encodeURIComponent(run.name)}/report.html`, target: "_blank", rel: "noopener" });
    first.append(report);
    const shapes = run.shapes.length > 1 ? `${run.shapes[0]} and ${run.shapes.length - 1} more` : (run.shapes[0] ?? "–");
    const state = run.virtual ? `${run.state}, virtual` : run.state;
    const cells = [run.protocol, run.subject || "–", shapes, `${run.done} of ${run.planned}`, state, run.name];
    row.append(first, ...cells.map((words) => element("td", words)));
    return row;
  }
}

// --- the page ---

/** Light or dark, by the system or by choice. */
class Theme {
  constructor(changed) {
    this.changed = changed;
    this.system = matchMedia("(prefers-color-scheme: dark)");
    this.system.addEventListener("change", () => this.apply());
    at("theme").addEventListener("click", () => this.apply(this.dark ? "light" : "dark"));
    this.apply();
  }

  get dark() {
    const chosen = localStorage.getItem("rig theme");
    return chosen ? chosen === "dark" : this.system.matches;
  }

  apply(chosen = null) {
    if (chosen !== null) localStorage.setItem("rig theme", chosen);
    document.documentElement.dataset.theme = this.dark ? "dark" : "light";
    at("theme").textContent = this.dark ? "Light" : "Dark";
    this.changed();
  }
}

let [state, taking] = [null, false];
const loaded_unix_s = Date.now() / 1000;
const mine = () => hasToken() && state?.controls === tab;
const traces = new Traces();
const parts = [new Numbers(), new Controls(said, () => mine() && !feed.silent), traces, new Section(), new Schedule()];
const runs = new Runs();
new Theme(() => traces.recolor());
const feed = new Feed(take);

function take(name, data) {
  if (name === "state") heard(data);
  if (name === "readings" && data.reset) for (const part of parts) part.forget?.();
  for (const part of parts) part[name]?.(data);
}

/** The first tab with a token gets control. */
async function heard(data) {
  state = data;
  if (data.controls !== null || !hasToken() || taking) return;
  taking = true;
  await post("/take");
  taking = false;
}

function look() {
  feed.look();
  for (const part of parts) part.look();
  show("no_token", !hasToken());
  show("watching", hasToken() && state !== null && state.controls !== null && !mine() && !feed.silent);
  show("no_server", hasToken() && feed.silent && (feed.heard !== null || Date.now() / 1000 - loaded_unix_s > 2));
  if (feed.heard !== null && feed.silent) write("controls_words", "not known: no data from the panel's server", "lost");
  const lost = feed.heard === null ? "The panel's server has not answered yet" : `No data from the panel's server since ${timeOfDay(feed.heard.unix_s)}`;
  const retrying = feed.refused ? "another panel answers: open the address that rig panel printed last" : "retrying";
  write("no_server", `${lost}; ${retrying}. No value here is live and STOP may not work: use the emergency stop.`, feed.heard === null ? "not_answered_yet" : "lost");
  document.body.dataset.owner = state?.owner?.kind ?? (state?.run ? "ended" : "");
  what();
  attend(state?.attention ?? null);
}

/** What the page is about, in one line. */
function what() {
  if (!hasToken()) return write("what", "no token", "no_token");
  if (feed.silent) return feed.heard === null ? write("what", "waiting for the panel's server", "not_answered_yet") : write("what", "no server", "lost");
  const { owner, run, notice, problem, attention, others = [] } = state ?? {};
  const kind = owner?.kind === "by hand" ? "manual control" : (owner?.kind ?? "nothing is running");
  const live = run?.state === "running" && owner?.state === "paused" ? "paused" : run?.state; // the journal runs on
  const doing = run && (owner?.kind === "run" || !owner) ? `${run.name}: ${attention?.status ?? live}` : kind;
  const bench = (owner?.virtual ?? run?.virtual) ? "virtual bench" : null;
  const others_in_words = others.map((one) => `process ${one.pid} has ${one.ports.join(", ")}, another rig; STOP stops it, too`);
  const words = [doing, run?.subject && `subject ${run.subject}`, bench, notice, run?.deviation, run?.problem, problem, ...others_in_words];
  write("what", words.filter(Boolean).join(" · "), run ? "run" : (owner?.kind.replace(" ", "_") ?? "nothing"));
}

const HEADINGS = { tripped: "TRIPPED", aborted: "STOPPED", limited: "REFUSED BY A LIMIT", failed: "FAILED", killed: "NO END RECORD", incomplete: "INCOMPLETE", "in contact": "THE INDENTOR MAY TOUCH THE FINGER" };

/** The notice of a trip, a stop or another early end, which stays until something else begins. */
function attend(attention) {
  if (attention !== null && at("attention").hidden) window.scrollTo(0, 0);
  show("attention", attention !== null);
  if (attention === null) return;
  const calm = !attention.may_touch && ["aborted", "limited", "incomplete"].includes(attention.status);
  at("attention").className = calm ? "banner" : "banner bad";
  const heading = HEADINGS[attention.status] ?? attention.status;
  const reason = attention.reason_text.startsWith("stopped") ? attention.reason_text.slice("stopped".length) : `: ${attention.reason_text}`;
  write("attention_title", `${heading}${reason}`, attention.status);
  write("attention_where", attention.where_text ?? "–");
  write("attention_next", attention.next_text ?? "–");
  write("attention_resume", attention.resume ?? "");
  show("attention_resume_row", Boolean(attention.resume));
}

/** Show what the server refuses, until it accepts a request. */
function said(words, code) {
  show("said", words !== "");
  if (words !== "") write("said", `${timeOfDay(Date.now() / 1000)} ${words}`, code ?? "refused");
}

function view() {
  const list = location.hash === "#runs";
  show("runs", list);
  show("bench", !list);
  for (const [id, here] of [["to_bench", !list], ["to_runs", list]]) {
    if (here) at(id).setAttribute("aria-current", "page");
    else at(id).removeAttribute("aria-current");
  }
  if (list) runs.load();
}

at("take").addEventListener("click", async () => {
  const answer = await post("/take");
  said(answer.ok ? "" : `Take control: ${answer.problem}`, answer.code);
});
window.addEventListener("hashchange", view);
view();
setInterval(look, LOOK_MS);
look();
