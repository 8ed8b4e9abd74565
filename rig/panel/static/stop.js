/** This tab (its token and id), its requests, and STOP, which needs nothing from the rest of the page.
 *
 * STOP has a port of its own. It is sent there before anything else, and repeated by a worker, also to the page's port.
 */

export const at = (id) => document.getElementById(id);

/** Write words for the reader and their code, as `data-code`, for programs. */
export function write(id, words, code) {
  const element = at(id);
  const [first, ...rest] = words.split("`"); // commands, as in Markdown
  if (rest.length === 0 && element.textContent !== words) element.textContent = words;
  else if (rest.length > 0 && element.textContent !== words.replaceAll("`", "")) {
    element.replaceChildren(first, ...rest.map((part, n) => (n % 2 ? part : Object.assign(document.createElement("code"), { textContent: part }))));
  }
  if (code !== undefined && element.dataset.code !== code) element.dataset.code = code;
}

export function show(id, shown) {
  const element = at(id);
  if (element.hasAttribute("hidden") === shown) element.toggleAttribute("hidden", !shown);
}

// --- this tab ---

let token = sessionStorage.getItem("rig token");
takeToken();
window.addEventListener("hashchange", takeToken);

/** Remove the token from the address at once, so that no bookmark or screenshot contains it. */
function takeToken() {
  const found = /^#token=(.+)$/.exec(location.hash);
  if (!found) return;
  token = decodeURIComponent(found[1]);
  sessionStorage.setItem("rig token", token);
  history.replaceState(null, "", location.pathname);
  window.dispatchEvent(new Event("token"));
}

export const hasToken = () => token !== null;

/** The id of this tab; a duplicated tab gets its own one, because the original holds the lock. */
export const tab = await (async () => {
  const kept = sessionStorage.getItem("rig tab");
  if (kept !== null && (await alone(kept))) return kept;
  const own = crypto.randomUUID();
  sessionStorage.setItem("rig tab", own);
  await alone(own);
  return own;
})();
document.documentElement.dataset.tab = tab;

function alone(id) {
  return new Promise((resolve) => {
    const held = (lock) => (resolve(lock !== null), lock && new Promise(() => {}));
    navigator.locks.request(`rig panel ${id}`, { ifAvailable: true }, held).catch(() => resolve(true));
  });
}

export const options = () => ({
  cache: "no-store", credentials: "omit", redirect: "error",
  headers: { "Content-Type": "application/json", "X-Rig-Token": token ?? "", "X-Rig-Tab": tab },
});

/** The reply to a POST: {status, ok, problem, code, …}; status 0 without a reply. */
export async function post(path, body = {}, more = {}) {
  try {
    const response = await fetch(path, { ...options(), method: "POST", body: JSON.stringify(body), ...more });
    const reply = await response.json().catch(() => ({}));
    const problem = response.ok ? null : `the server returned ${response.status}`;
    return { problem, code: null, ...reply, status: response.status, ok: response.ok && reply.ok !== false };
  } catch {
    return { status: 0, ok: false, problem: "the panel's server does not answer", code: "no_answer" };
  }
}

// --- STOP ---

const STOP_PORT = `http://${location.hostname}:${document.documentElement.dataset.stopPort}/stop`;
const stopOptions = () => ({ ...options(), cache: "default" }); // else the browser asks for permission each time
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
  post(STOP_PORT, { press: of }, { ...stopOptions(), keepalive: true, priority: "high" }).then((reply) => setTimeout(said, WORKER_FIRST_MS, { ...reply, of }));
  if (of > number) worker.postMessage({ addresses: [STOP_PORT, "/stop"], options: stopOptions(), body: JSON.stringify({ press: of }), of });
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
  const pressed = new Date(pressed_ms).toLocaleTimeString("en-GB");
  giveUp();
  at("stop_said").dataset.after_ms = after_ms.toFixed(0);
  if (ok) tell("good", "confirmed", `STOP at ${pressed} confirmed after ${after_ms.toFixed(0)} ms: ${(words ?? "stopped").replace(/\.$/, "")}.`);
  else if (status === 409) tell("good", "answered", `STOP at ${pressed} answered: ${problem}.`);
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
  if (hasToken()) fetch(STOP_PORT, { ...stopOptions(), method: "HEAD" }).catch(() => {});
}

function arm() {
  at("stop").disabled = false;
  write("stop_key", hasToken() ? "or Esc, anywhere" : "no token: does not work here", hasToken() ? "works" : "no_token");
  stay();
}

at("stop").addEventListener("pointerdown", (event) => event.button === 0 && stop(event));
at("stop").addEventListener("click", (event) => event.detail === 0 && stop(event));
window.addEventListener("keydown", (event) => {
  const stops = event.key === "Escape" || event.code === "Escape" || (event.target === at("stop") && [" ", "Enter"].includes(event.key));
  if (stops && !event.repeat) stop(event);
}, { capture: true });
at("stop_close").addEventListener("click", () => (giveUp(), show("stop_said", false), at("stop").focus()));
window.addEventListener("token", arm);
setInterval(stay, STAY_MS);
arm();
