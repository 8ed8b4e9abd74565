/** The page: passes events to all of its parts, which update their ages ten times a second. */

import { hasToken, post, tab } from "/static/access.js";
import { Controls } from "/static/controls.js";
import { Devices } from "/static/devices.js";
import { Feed } from "/static/feed.js";
import { Numbers } from "/static/numbers.js";
import { at, mark, show, write } from "/static/page.js";
import { Runs } from "/static/runs.js";
import { Schedule } from "/static/schedule.js";
import { Section } from "/static/section.js";
import { Colours } from "/static/theme.js";
import { Traces } from "/static/traces.js";
import { timeOfDay } from "/static/units.js";
import { Veil } from "/static/veils.js";

const LOOK_MS = 100;

const colours = new Colours();
const numbers = new Numbers();
const devices = new Devices();
const controls = new Controls(said, () => mine() && !feed.silent);
const parts = [numbers, devices, controls, new Traces(colours), new Section(), new Schedule()];
const runs = new Runs();
const veils = ["numbers", "devices", "traces", "place"].map((id) => new Veil(at(id)));
const loaded_unix_s = Date.now() / 1000;
let state = null;
let taking = false;

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

const mine = () => hasToken() && state?.controls === tab;

function look() {
  feed.look();
  for (const part of parts) part.look();
  veils[0].data(numbers.age_s);
  veils[1].data(devices.age_s);
  veils[2].data(numbers.age_s);
  veils[3].data(numbers.age_s);
  show("no_token", !hasToken());
  show("watching", hasToken() && state !== null && state.controls !== null && !mine() && !feed.silent);
  show("no_server", hasToken() && feed.silent && (feed.heard !== null || Date.now() / 1000 - loaded_unix_s > 2));
  const { heard } = feed;
  const since = heard === null ? "The panel's server has not answered yet" : `No data from the panel's server since ${timeOfDay(heard.unix_s)}`;
  write("no_server", `${since}; retrying. No value here is live and STOP may not work: use the emergency stop.`, heard === null ? "not_answered_yet" : "lost");
  mark(document.body, "silent", feed.silent);
  document.body.dataset.owner = state?.owner?.kind ?? "";
  what();
}

function what() {
  if (!hasToken()) return write("what", "no token", "no_token");
  if (feed.heard === null) return write("what", "waiting for the panel's server", "not_answered_yet");
  if (feed.silent) return write("what", "no server", "lost");
  const { owner, run, notice } = state ?? {};
  const bench = owner ? (owner.virtual ? "virtual bench" : `devices on ${owner.ports.join(", ")}`) : null;
  const doing = run ? `${run.name}: ${[run.state, run.ending].filter(Boolean).join(", ")}` : (owner?.kind ?? "nothing is running");
  const others = (state?.others ?? []).map(({ pid, ports }) => `process ${pid} has ${ports.join(", ")}, another rig`);
  const words = [doing, run?.subject ? `subject ${run.subject}` : null, bench, notice, run?.deviation, run?.problem, ...others].filter(Boolean).join(" · ");
  write("what", words, run ? "run" : (owner?.kind.replace(" ", "_") ?? "nothing"));
}

function said(words, code, bad) {
  write("said", `${timeOfDay(Date.now() / 1000)} ${words}`, code);
  mark(at("said"), "bad", bad);
  show("said", true);
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
  if (!answer.ok) said(`Take control: ${answer.problem}`, answer.code, true);
});
window.addEventListener("hashchange", view);
view();
setInterval(look, LOOK_MS);
look();
