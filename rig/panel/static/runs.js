/** The list of runs, with filters. */

import { at, show, write } from "/static/page.js";

const FIRST = 100;
const TYPED_MS = 250;

export class Runs {
  constructor() {
    this.limit = FIRST;
    this.asked = 0;
    const again = (wait_ms) => {
      clearTimeout(this.typing);
      this.typing = setTimeout(() => this.load(), wait_ms);
    };
    at("filters").addEventListener("input", () => again(TYPED_MS));
    at("filters").addEventListener("reset", () => again(0));
    at("filters").addEventListener("submit", (event) => (event.preventDefault(), again(0)));
    at("more").addEventListener("click", () => ((this.limit *= 4), this.load()));
  }

  async load() {
    const asked = ++this.asked;
    const wanted = new URLSearchParams([...new FormData(at("filters"))].filter(([, value]) => value.trim()));
    wanted.set("limit", this.limit);
    try {
      const response = await fetch(`/runs.json?${wanted}`, { cache: "no-store" });
      const reply = await response.json();
      if (asked !== this.asked) return;
      if (response.ok) this.list(reply);
      else write("runs_words", reply.problem ?? `the server returned ${response.status}`);
    } catch {
      write("runs_words", "the panel's server does not answer");
    }
  }

  list({ runs, unreadable = [] }) {
    write("runs_words", `${runs.length} run${runs.length === 1 ? "" : "s"}${runs.length >= this.limit ? ", the newest" : ""}`);
    at("runs_rows").replaceChildren(...runs.map(rowOf));
    at("unreadable").replaceChildren(...unreadable.map(({ name, problem }) => element("li", `${name}: ${problem}`)));
    show("more", runs.length >= this.limit);
  }
}

function rowOf(run) {
  const row = document.createElement("tr");
  const first = element("th", run.date_utc.replace("T", " ").replace(/(\+00:00|Z)$/, ""));
  first.scope = "row";
  const shapes = run.shapes.length > 1 ? `${run.shapes[0]} and ${run.shapes.length - 1} more` : (run.shapes[0] ?? "–");
  const state = run.virtual ? `${run.state}, virtual` : run.state;
  const cells = [run.protocol, run.subject || "–", shapes, `${run.done} of ${run.planned}`, state].map((words) => element("td", words));
  const link = element("a", run.name);
  link.href = `/runs/${encodeURIComponent(run.name)}/report.html`;
  link.target = "_blank";
  link.rel = "noopener";
  const folder = document.createElement("td");
  folder.append(link);
  row.append(first, ...cells, folder);
  return row;
}

function element(kind, words) {
  const made = document.createElement(kind);
  made.textContent = words;
  return made;
}
