/** Repeats STOP until there is a reply or it gives up, even if the page hangs. */

const AGAIN_MS = 300;
const PATIENCE_MS = 900; // at most three are pending: a browser has six connections to one port
const FINAL = [200, 403, 409];

let trying = null;

onmessage = ({ data }) => {
  clearInterval(trying?.timer);
  trying = null;
  if (data === null) return;
  const one = { ...data, asked: 0 };
  one.timer = setInterval(() => ask(one), AGAIN_MS);
  trying = one;
  ask(one);
};

/** Ask each address in turn. */
async function ask(one) {
  const reply = await answer(one.addresses[one.asked++ % one.addresses.length], one);
  if (one !== trying) return;
  if (FINAL.includes(reply.status)) {
    clearInterval(one.timer);
    trying = null;
  }
  postMessage({ ...reply, of: one.of });
}

async function answer(address, { options, body }) {
  try {
    const signal = AbortSignal.timeout(PATIENCE_MS);
    const response = await fetch(address, { ...options, method: "POST", priority: "high", body, signal });
    const reply = await response.json().catch(() => ({}));
    const problem = response.ok ? null : `the server returned ${response.status}`;
    const at_ms = performance.timeOrigin + performance.now();
    return { problem, ...reply, status: response.status, ok: response.ok && reply.ok !== false, at_ms };
  } catch {
    return { status: 0, ok: false, problem: "the panel's server does not answer" };
  }
}
