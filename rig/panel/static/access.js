/** Who this tab is: its token, from the address or kept for the tab, and its id; what it asks of the server. */

const TOKEN = "rig token";
const TAB = "rig tab";

let token = sessionStorage.getItem(TOKEN);
takeToken();
window.addEventListener("hashchange", takeToken);

/** The token leaves the address at once, so that it is in no bookmark and no picture of the screen. */
function takeToken() {
  const found = /^#token=(.+)$/.exec(location.hash);
  if (!found) return;
  token = decodeURIComponent(found[1]);
  sessionStorage.setItem(TOKEN, token);
  history.replaceState(null, "", location.pathname);
  window.dispatchEvent(new Event("token"));
}

export const hasToken = () => token !== null;

/** This tab's id; a tab that was copied from another has one of its own, which the lock tells. */
export const tab = await (async () => {
  const kept = sessionStorage.getItem(TAB);
  if (kept !== null && (await alone(kept))) return kept;
  const own = crypto.randomUUID();
  sessionStorage.setItem(TAB, own);
  await alone(own);
  return own;
})();

function alone(id) {
  return new Promise((told) => {
    const held = (lock) => (told(lock !== null), lock && new Promise(() => {}));
    navigator.locks.request(`rig panel ${id}`, { ifAvailable: true }, held).catch(() => told(true));
  });
}

export function headers() {
  return { "Content-Type": "application/json", "X-Rig-Token": token ?? "", "X-Rig-Tab": tab };
}

/** What the server answers to a POST: {status, ok, problem, …}; status 0 where nothing came. */
export async function post(path, body = {}, options = {}) {
  try {
    return await answered(await fetch(path, request(body, options)));
  } catch (error) {
    return { status: 0, ok: false, problem: "the panel's server does not answer", gone: error.name };
  }
}

function request(body, options) {
  const same = { method: "POST", cache: "no-store", credentials: "omit", redirect: "error" };
  return { ...same, headers: headers(), body: JSON.stringify(body), ...options };
}

async function answered(response) {
  const told = await response.json().catch(() => ({}));
  return { problem: response.ok ? null : `the server returned ${response.status}`, ...told, status: response.status, ok: response.ok && told.ok !== false };
}
