/** STOP, by button and by key: sends the request before anything else, and repeats it until there is a reply.
 *
 * A worker repeats it even if the page hangs. This module needs nothing from the rest of the page.
 */

import { hasToken, headers, post, tab } from "/static/access.js";
import { at, show, write } from "/static/page.js";

const LOUD_MS = 300;
const FINAL = [200, 403, 409];
const NOT_CONFIRMED = "STOP NOT CONFIRMED: USE THE EMERGENCY STOP";

const WORKER_FIRST_MS = 50; // it knows when its reply came, even if this page is late

const worker = new Worker("/static/stop_worker.js");
worker.onmessage = ({ data }) => said(data);
let pressed_ms = null;
let loud = null;

function stop(event) {
  post("/stop", {}, { keepalive: true, priority: "high" }).then((told) => setTimeout(said, WORKER_FIRST_MS, told));
  worker.postMessage({ headers: headers() });
  event.preventDefault();
  pressed_ms = performance.timeOrigin + event.timeStamp;
  tell("busy", "STOP sent …");
  clearTimeout(loud);
  loud = setTimeout(() => said({ status: 0, problem: "no answer yet" }), LOUD_MS);
}

/** Handle a reply to this page or to the worker; the first final one counts. */
function said({ status, ok, problem, words, at_ms }) {
  if (pressed_ms === null) return;
  const after_ms = (at_ms ?? performance.timeOrigin + performance.now()) - pressed_ms;
  if (!FINAL.includes(status)) {
    if (after_ms >= LOUD_MS) tell("bad", `${NOT_CONFIRMED}. Still trying: ${problem}.`);
    return;
  }
  giveUp();
  if (ok) tell("good", `STOP confirmed after ${after_ms.toFixed(0)} ms: ${words ?? "stopped"}.`);
  else if (status === 409) tell("good", `STOP answered: ${problem}.`);
  else tell("bad", `${NOT_CONFIRMED}. This tab may not stop: ${problem}.`);
}

function giveUp() {
  clearTimeout(loud);
  worker.postMessage(null);
  pressed_ms = null;
}

function tell(how, words) {
  at("stop_said").className = how;
  write("stop_words", words);
  write("stop_close", how === "good" ? "Close" : "I used the emergency stop: stop trying");
  show("stop_close", how !== "busy");
  show("stop_said", true);
}

function arm() {
  at("stop").disabled = false;
  write("stop_key", hasToken() ? "or Esc, anywhere" : "no token: does not work here");
}

at("stop").addEventListener("pointerdown", (event) => event.button === 0 && stop(event));
at("stop").addEventListener("click", (event) => event.detail === 0 && stop(event));
window.addEventListener("keydown", (event) => {
  const stops = event.key === "Escape" || event.code === "Escape" || (event.target === at("stop") && [" ", "Enter"].includes(event.key));
  if (stops && !event.repeat) stop(event);
}, { capture: true });
at("stop_close").addEventListener("click", () => (giveUp(), show("stop_said", false), at("stop").focus()));
window.addEventListener("token", arm);
arm();
document.documentElement.dataset.tab = tab;
