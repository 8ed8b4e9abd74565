/** This tab: its token, from the address or stored for the tab, its id, and its requests to the server. */

const TOKEN = "rig token";
const TAB = "rig tab";

let token = sessionStorage.getItem(TOKEN);
takeToken();
window.addEventListener("hashchange", takeToken);

/** Remove the token from the address at once, so that no bookmark or screenshot contains it. */
function takeToken() {
  const found = /^#token=(.+)$/.exec(location.hash);
  if (!found) return;
  token = decodeURIComponent(found[1]);
  sessionStorage.setItem(TOKEN, token);
  history.replaceState(null, "", location.pathname);
  window.dispatchEvent(new Event("token"));
}

export const hasToken = () => token !== null;

/** The id of this tab; a duplicated tab gets its own one, because the original holds the lock. */
export const tab = await (async () => {
  const kept = sessionStorage.getItem(TAB);
  if (kept !== null && (await alone(kept))) return kept;
  const own = crypto.randomUUID();
  sessionStorage.setItem(TAB, own);
  await alone(own);
  return own;
})();

function alone(id) {
  return new Promise((resolve) => {
    const held = (lock) => (resolve(lock !== null), lock && new Promise(() => {}));
    navigator.locks.request(`rig panel ${id}`, { ifAvailable: true }, held).catch(() => resolve(true));
  });
}

export function headers() {
  return { "Content-Type": "application/json", "X-Rig-Token": token ?? "", "X-Rig-Tab": tab };
}

/** The reply to a POST: {status, ok, problem, code, …}; status 0 without a reply. */
export async function post(path, body = {}, options = {}) {
  try {
    return await answered(await fetch(path, request(body, options)));
  } catch (error) {
    return { status: 0, ok: false, problem: "the panel's server does not answer", code: "no_answer", gone: error.name };
  }
}

function request(body, options) {
  const same = { method: "POST", cache: "no-store", credentials: "omit", redirect: "error" };
  return { ...same, headers: headers(), body: JSON.stringify(body), ...options };
}

async function answered(response) {
  const reply = await response.json().catch(() => ({}));
  const unexplained = response.ok ? { problem: null, code: null } : { problem: `the server returned ${response.status}`, code: "unexplained" };
  return { ...unexplained, ...reply, status: response.status, ok: response.ok && reply.ok !== false };
}
