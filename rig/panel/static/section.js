/** The finger's cross-section to scale, with the indentor at the last reading. */

import { interpolated } from "/static/buffer.js";
import { at, show, write } from "/static/page.js";
import { fixed, known } from "/static/units.js";

const SVG = "http://www.w3.org/2000/svg";
const ABOVE_MM = 4;
const BELOW_MM = 7;
const TURN = "scale(1 -1)"; // heights increase upwards

export class Section {
  constructor() {
    this.drawn = null;
    this.run = null;
    this.forget();
  }

  forget() {
    this.place = {};
  }

  state({ run }) {
    this.run = run?.name ?? null;
  }

  section(data) {
    this.drawn = data;
    const svg = at("section");
    svg.replaceChildren();
    if (!data.skin?.length) return;
    const [left, right] = [Math.min(...data.skin.map(([x]) => x)), Math.max(...data.skin.map(([x]) => x))];
    const top = Math.max(...data.skin.map(([, z]) => z));
    svg.setAttribute("viewBox", `${left - 1} ${-top - ABOVE_MM} ${right - left + 2} ${ABOVE_MM + BELOW_MM}`);
    const finger = add(svg, "g", { transform: TURN });
    line(finger, "skin", data.skin, true);
    for (const layer of data.layers ?? []) line(finger, "layer", layer, false);
    if (data.bone) line(finger, "bone", data.bone, true);
    if (data.nail) line(finger, "nail", data.nail, false);
    if (data.pressed_skin) line(finger, "pressed", data.pressed_skin, false);
    this.indentor = add(add(svg, "g", { transform: TURN }), "g", { class: "indentor" });
    if (data.indentor?.length) line(this.indentor, "profile", lidded(data.indentor), true);
    const over = add(svg, "g", { transform: TURN });
    for (const [from, to] of data.contact ?? []) line(over, "contact", between(data.skin, from, to), false);
    this.top = top;
  }

  readings({ columns, rows }) {
    const last = rows.at(-1);
    if (last) this.place = { x_mm: last[columns.indexOf("x_mm")], height_mm: last[columns.indexOf("height_mm")] };
  }

  look() {
    const drawn = this.drawn?.skin?.length && (this.drawn.run ?? null) === this.run;
    show("place", Boolean(drawn));
    if (!drawn) return;
    const { x_mm, height_mm } = this.place;
    const somewhere = known(x_mm) && known(height_mm);
    const seen = somewhere ? Math.min(height_mm, this.top + ABOVE_MM - 1) : 0;
    this.indentor.setAttribute("transform", somewhere ? `translate(${x_mm} ${seen})` : "translate(0 1000)");
    write("section_words", this.said(somewhere, height_mm > seen));
  }

  said(somewhere, above) {
    const { x_mm, height_mm } = this.place;
    if (!somewhere) return "the position of the indentor is unknown";
    const place = `x = ${fixed(x_mm, 2)} mm, tip ${fixed(height_mm, 3)} mm above the apex`;
    const contact = this.drawn.contact?.length ? "; thick: contact as predicted at the target" : "";
    return `${place}${above ? " (above the figure)" : ""}; the skin is drawn undeformed${contact}`;
  }
}

/** The upper side of a skin from one x to another, however narrow. */
function between(points, from, to) {
  const [low, high] = [Math.min(...points.map(([, z]) => z)), Math.max(...points.map(([, z]) => z))];
  const upper = points.filter(([, z]) => z > (low + high) / 2).sort(([one], [other]) => one - other);
  const [xs, zs] = [upper.map(([x]) => x), upper.map(([, z]) => z)];
  const end = (x) => [x, interpolated(x, xs, zs)];
  return [end(from), ...upper.filter(([x]) => x > from && x < to), end(to)].filter(([, z]) => z !== null);
}

/** Close a profile, which is the lower side, far above. */
function lidded(points) {
  const lid_mm = Math.max(...points.map(([, z]) => z)) + 2 * (ABOVE_MM + BELOW_MM);
  return [...points, [points.at(-1)[0], lid_mm], [points[0][0], lid_mm]];
}

function line(parent, name, points, closed) {
  const path = points.map(([x, z], n) => `${n ? "L" : "M"}${x} ${z}`).join("") + (closed ? "Z" : "");
  add(parent, "path", { class: name, d: path });
}

function add(parent, kind, attributes) {
  const element = document.createElementNS(SVG, kind);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return parent.appendChild(element);
}
