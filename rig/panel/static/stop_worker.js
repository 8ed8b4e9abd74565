/** Repeats STOP until there is a reply or it gives up, even if the page hangs. */

const AGAIN_MS = 300;
const PATIENCE_MS = 900; // at most three are pending: a browser has six connections to one host
const FINAL = [200, 403, 409];

let trying = null;
let headers = null;
let of = null; // number of the stop

onmessage = ({ data }) => {
  clearInterval(trying);
  trying = null;
  if (data === null) return;
  ({ headers, of } = data);
  trying = setInterval(ask, AGAIN_MS);
  ask();
};

async function ask() {
  const asked = trying;
  const reply = await answer();
  if (asked !== trying) return;
  if (FINAL.includes(reply.status)) {
    clearInterval(trying);
    trying = null;
  }
  postMessage({ ...reply, of });
}

async function answer() {
  try {
    const options = { method: "POST", cache: "no-store", credentials: "omit", redirect: "error", priority: "high" };
    const response = await fetch("/stop", { ...options, headers, body: "{}", signal: AbortSignal.timeout(PATIENCE_MS) });
    const reply = await response.json().catch(() => ({}));
    const problem = response.ok ? null : `the server returned ${response.status}`;
    const at_ms = performance.timeOrigin + performance.now();
    return { problem, ...reply, status: response.status, ok: response.ok && reply.ok !== false, at_ms };
  } catch {
    return { status: 0, ok: false, problem: "the panel's server does not answer" };
  }
}
