/** Light or dark theme, by the system or by choice, and its colors for the charts. */

import { at } from "/static/page.js";

const KEPT = "rig theme";

export class Colours {
  constructor() {
    this.changed = () => {};
    this.kept = new Map();
    this.choose(localStorage.getItem(KEPT));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.forget());
    at("theme").addEventListener("click", () => this.choose(this.dark ? "light" : "dark"));
  }

  get dark() {
    const chosen = document.documentElement.dataset.theme;
    return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  }

  choose(theme) {
    if (theme === "light" || theme === "dark") {
      document.documentElement.dataset.theme = theme;
      localStorage.setItem(KEPT, theme);
    }
    this.forget();
  }

  forget() {
    this.kept.clear();
    at("theme").textContent = this.dark ? "Light" : "Dark";
    this.changed();
  }

  /** The value of a property of the style sheet. */
  of(name) {
    if (!this.kept.has(name)) this.kept.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
    return this.kept.get(name);
  }
}
