/** The panel's scripts without a browser: walks through steps on a virtual clock, and prints what they sent and showed.
 *
 * node page_scripts.mjs FOLDER SCENES; FOLDER: the scripts, which import one another from there; SCENES: JSON, see test_page_scripts.py.
 */

import { readFileSync, writeFileSync } from "node:fs";
import vm from "node:vm";

const [folder, scenes] = process.argv.slice(2);
const settled = () => new Promise((resolve) => setImmediate(resolve));

class Target {
  constructor(fields = {}) {
    Object.assign(this, { listeners: [], dataset: {}, disabled: false, hidden: false, offsetParent: {}, ...fields });
  }
  addEventListener(type, handle, { capture = false } = {}) { this.listeners.push({ type, handle, capture }); }
  dispatchEvent(event) { this.hear(event); }
  hear(event, captures = [true, false]) {
    for (const one of [...this.listeners]) if (one.type === event.type && captures.includes(one.capture)) one.handle(event);
  }
  click() { if (!this.disabled) this.hear({ type: "click", target: this }); }
  closest(selector) { return selector === "#directions" ? (this.dataset.axis ? this : null) : this.tag === "button" ? this : null; }
  matches() { return false; }
  hasAttribute() { return this.hidden; }
  toggleAttribute(_, on) { this.hidden = on; }
  focus() {}
  setPointerCapture() {}
  querySelector(selector) { return this.children.find((one) => selector === `[data-key="${one.dataset.key}"]`) ?? null; }
}

class Scene {
  constructor() {
    Object.assign(this, { now_ms: 1000, timers: new Map(), sent: [], shown: [], last: 0, silent: false, status: 200 });
    const ways = [["a", "x", "-1"], ["d", "x", "1"], ["w", "z", "1"]].map(([key, axis, sign]) => this.button({ key, axis, sign }));
    const sizes = [["3", "0.1"], ["5", "1"]].map(([key, value]) => new Target({ value, dataset: { key }, click: () => (this.size = { value }) }));
    this.elements = {
      directions: new Target({ children: ways }), hand_controls: new Target({ children: [...ways, ...sizes] }),
      stop: this.button(), home: this.button({ post: "home" }),
    };
    this.size = sizes[0];
    this.window = new Target();
    this.document = new Target({
      hidden: false,
      documentElement: new Target({ dataset: { stopPort: "9" } }),
      getElementById: (id) => (this.elements[id] ??= new Target({ classList: { contains: () => false, toggle() {} } })),
      querySelector: () => this.size,
      querySelectorAll: () => [this.elements.home],
    });
  }

  button(dataset = {}) {
    return new Target({ tag: "button", dataset, classList: { contains: () => false, toggle() {} }, firstChild: { textContent: "" } });
  }

  /** What scripts and worker find around them. */
  globals() {
    const timer = (every) => (handle, ms, ...more) => {
      this.timers.set(++this.last, { handle: () => handle(...more), at_ms: this.now_ms + ms, every_ms: every ? ms : null });
      return this.last;
    };
    const clear = (number) => this.timers.delete(number);
    return {
      setInterval: timer(true), setTimeout: timer(false), clearInterval: clear, clearTimeout: clear,
      performance: { now: () => this.now_ms, timeOrigin: 0 },
      fetch: (path, { body } = {}) => this.fetch(path, body), AbortSignal: { timeout: () => undefined },
    };
  }

  fetch(path, body) {
    const port = path.startsWith("http://here:9/") ? "stop" : "page";
    path = path.replace("http://here:9", "");
    this.sent.push({ at_ms: this.now_ms - 1000, path, port, body: body === undefined ? null : JSON.parse(body), by: this.by });
    if (this.silent) return new Promise(() => {});
    const answer = { ok: this.status === 200, status: this.status, json: async () => ({ ok: this.status === 200, code: "refused" }) };
    return Promise.resolve(answer);
  }

  /** Let time pass; a page that hangs makes up for it afterwards, once for each timer. */
  async pass(ms) {
    const end_ms = this.now_ms + ms;
    for (;;) {
      await settled();
      const [number, next] = [...this.timers].sort(([, one], [, other]) => one.at_ms - other.at_ms)[0] ?? [];
      if (next === undefined || next.at_ms > end_ms) break;
      this.now_ms = Math.max(this.now_ms, next.at_ms);
      if (next.every_ms === null) this.timers.delete(number);
      else next.at_ms = this.now_ms + next.every_ms;
      next.handle();
    }
    this.now_ms = Math.max(this.now_ms, end_ms);
    await settled();
  }

  fire(target, type, fields = {}) {
    const event = { type, target, button: 0, repeat: false, detail: 1, timeStamp: this.now_ms, preventDefault() {}, ...fields };
    this.window.hear(event, [true]);
    if (target !== this.window) target.hear(event);
    this.window.hear(event, [false]);
  }

  on(name) { return this.elements.directions.querySelector(`[data-key="${name}"]`) ?? this.document.getElementById(name); }

  async step([what, of]) {
    const key = { key: of, code: of?.length === 1 ? `Key${of.toUpperCase()}` : of };
    if (what === "wait") await this.pass(of);
    else if (what === "hang") this.now_ms += of;
    else if (what === "key down") this.fire(this.elements.body ??= new Target(), "keydown", key);
    else if (what === "key repeats") this.fire(this.elements.body, "keydown", { ...key, repeat: true });
    else if (what === "mouse down") this.fire(this.on(of), "pointerdown");
    else if (what === "click") this.on(of).click();
    else if (what === "disable") this.on(of).disabled = true;
    else if (what === "runs shown") this.elements.directions.offsetParent = null;
    else if (what === "silent") this.silent = of;
    else if (what === "status") this.status = of;
    await settled();
    this.shown.push({ said: this.said ?? null, stop: this.on("stop_words").dataset.code ?? null, how: this.on("stop_said").className ?? null });
  }
}

/** The worker that repeats STOP, on the clock of the scene, but not held up by the page. */
const worker = (scene) =>
  class {
    constructor(path) {
      const post = (data) => this.onmessage?.({ data });
      this.around = vm.createContext({ ...scene.globals(), postMessage: post });
      this.around.fetch = (path, how) => ((scene.by = "worker"), scene.fetch(path, how.body));
      vm.runInContext(readFileSync(`${folder}/${path.split("/").at(-1)}`, "utf8"), this.around);
    }
    postMessage(data) { this.around.onmessage({ data }); }
  };

const found = {};
for (const [name, steps] of Object.entries(JSON.parse(scenes))) {
  const scene = new Scene();
  const { window, document } = scene;
  const stored = { "rig token": "the-token" };
  const around = {
    ...scene.globals(), window, document, Worker: worker(scene), location: { hash: "", hostname: "here" }, CSS: { escape: (text) => text },
    sessionStorage: { getItem: (key) => stored[key] ?? null, setItem() {} },
  };
  around.fetch = (path, how) => ((scene.by = "page"), scene.fetch(path, how.body));
  for (const [key, value] of Object.entries(around)) Object.defineProperty(globalThis, key, { value, configurable: true, writable: true });
  Object.defineProperty(globalThis, "navigator", { value: { locks: { request: async (_, __, held) => void held({}) } }, configurable: true });
  await import(`${folder}/stop.js?${name}`);
  const ours = `${folder}/controls of ${Object.keys(found).length}.js`; // which imports this scene's stop.js
  writeFileSync(ours, readFileSync(`${folder}/controls.js`, "utf8").replace("./stop.js", `./stop.js?${name}`));
  const { Controls } = await import(ours);
  scene.controls = new Controls((words, code) => (scene.said = code), () => true);
  scene.sent.length = 0;
  for (const step of steps) await scene.step(step);
  found[name] = { sent: scene.sent, shown: scene.shown };
}
console.log(JSON.stringify(found));
