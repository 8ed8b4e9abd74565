/** STOP, by button and by key: sends the request before anything else, and repeats it until there is a reply.
 *
 * A worker repeats it even if the page hangs. This module needs nothing from the rest of the page.
 */

import { hasToken, headers, post, tab } from "/static/access.js";
import { at, show, write } from "/static/page.js";

const LOUD_MS = 300;
const FINAL = [200, 403, 409];
const NOT_CONFIRMED = "STOP NOT CONFIRMED: USE THE EMERGENCY STOP";

const STAY_MS = 60_000; // the server closes an idle connection after five minutes
const WORKER_FIRST_MS = 50; // it knows when its reply came, even if this page is late

const worker = new Worker("/static/stop_worker.js");
worker.onmessage = ({ data }) => said(data);
let number = 0; // of the stops
let pressed_ms = null; // when the unanswered stop was pressed first
let loud = null;

/** Every press sends a request; one that follows before there is a reply belongs to the same stop. */
function stop(event) {
  const of = pressed_ms === null ? number + 1 : number;
  post("/stop", {}, { keepalive: true, priority: "high" }).then((reply) => setTimeout(said, WORKER_FIRST_MS, { ...reply, of }));
  if (of > number) worker.postMessage({ headers: headers(), of });
  event.preventDefault();
  if (of === number) return;
  number = of;
  pressed_ms = performance.timeOrigin + event.timeStamp;
  tell("busy", "sent", "STOP sent …");
  clearTimeout(loud);
  loud = setTimeout(() => said({ of, status: 0, problem: "no answer yet" }), LOUD_MS);
}

/** Handle a reply to this page or to the worker; the first final one to this stop counts. */
function said({ of, status, ok, problem, words, at_ms }) {
  if (pressed_ms === null || of !== number) return;
  const after_ms = (at_ms ?? performance.timeOrigin + performance.now()) - pressed_ms;
  if (!FINAL.includes(status)) {
    if (after_ms >= LOUD_MS) tell("bad", "not_confirmed", `${NOT_CONFIRMED}. Still trying: ${problem}.`);
    return;
  }
  giveUp();
  at("stop_said").dataset.after_ms = after_ms.toFixed(0);
  if (ok) tell("good", "confirmed", `STOP confirmed after ${after_ms.toFixed(0)} ms: ${words ?? "stopped"}.`);
  else if (status === 409) tell("good", "answered", `STOP answered: ${problem}.`);
  else tell("bad", "not_allowed", `${NOT_CONFIRMED}. This tab may not stop: ${problem}.`);
}

function giveUp() {
  clearTimeout(loud);
  worker.postMessage(null);
  pressed_ms = null;
}

function tell(how, code, words) {
  at("stop_said").className = how;
  write("stop_words", words, code);
  write("stop_close", how === "good" ? "Close" : "I used the emergency stop: stop trying");
  show("stop_close", how !== "busy");
  show("stop_said", true);
}

/** Keep a connection open, so that STOP needs no new one while other programs flood the server with theirs. */
function stay() {
  if (!hasToken()) return;
  const options = { method: "HEAD", headers: headers(), cache: "no-store", credentials: "omit", redirect: "error" };
  fetch("/events", options).catch(() => {});
}

function arm() {
  at("stop").disabled = false;
  if (hasToken()) write("stop_key", "or Esc, anywhere", "works");
  else write("stop_key", "no token: does not work here", "no_token");
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
window.addEventListener("stream", stay); // which occupies the connection that was open
setInterval(stay, STAY_MS);
document.documentElement.dataset.tab = tab;
