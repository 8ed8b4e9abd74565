/** The last status of the devices. */

import { Instant, OLD_S } from "/static/feed.js";
import { at, mark, write } from "/static/page.js";
import { ago, known, timeOfDay } from "/static/units.js";

export class Devices {
  constructor() {
    this.seen = {};
    this.ports = "–";
    this.button = null;
  }

  state({ unix_s, devices, owner }) {
    for (const name of ["stage", "force"]) {
      const status = devices?.[name];
      this.seen[name] = status ? { status, read: known(status.age_s) ? new Instant(unix_s - status.age_s) : null } : null;
    }
    const ports = owner?.ports ?? [];
    this.button = owner?.stop_button ?? null;
    this.ports = owner === null ? "free" : `${Array.isArray(ports) ? ports.join(", ") : ports}${owner.virtual ? " (virtual bench)" : ""}`;
  }

  /** The age of the last status; null without one. */
  get age_s() {
    const ages = Object.values(this.seen).flatMap((one) => one?.read?.age_s ?? []);
    return ages.length ? Math.min(...ages) : null;
  }

  look() {
    this.say("stage", "stage_words");
    this.say("force", "sensor_words");
    write("port_words", this.ports || "–");
    at("stop_button").hidden = this.button === null;
    write("stop_button_words", this.button ?? "–");
    mark(at("devices"), "old", this.age_s > OLD_S);
  }

  say(name, id) {
    const seen = this.seen[name];
    if (!seen) return write(id, "–");
    const { status, read } = seen;
    const homed = status.homed === undefined || status.homed === null ? "" : status.homed ? ", homed" : ", not homed";
    const when = read === null ? "" : read.age_s > OLD_S ? `, ${timeOfDay(read.unix_s)}, ${ago(read.age_s)}` : "";
    write(id, `${status.word ?? "–"}${homed}${when}`);
    mark(at(id), "old", read !== null && read.age_s > OLD_S);
  }
}
