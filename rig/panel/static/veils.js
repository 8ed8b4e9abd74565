/** Gray out old data even if this page hangs: an animation that the browser's compositor runs by itself.
 *
 * It ends one second after the time of the data; fresh data restart it.
 */

import { OLD_S } from "/static/feed.js";
import { mark } from "/static/page.js";

export class Veil {
  constructor(card) {
    const lasts = { duration: OLD_S * 1000, fill: "forwards" };
    const steps = [{ opacity: 0 }, { opacity: 0, offset: 0.999 }, { opacity: 1 }];
    this.veil = card.querySelector(".veil");
    this.rising = this.veil.animate(steps, lasts);
    this.rising.finish();
  }

  /** Show the age of the data below; null: there are none. */
  data(age_s) {
    mark(this.veil, "empty", age_s === null);
    if (age_s === null || age_s > OLD_S) {
      if (this.rising.playState !== "finished") this.rising.finish();
      return;
    }
    this.rising.currentTime = age_s * 1000;
    if (this.rising.playState !== "running") this.rising.play();
  }
}
