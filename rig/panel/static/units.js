/** Numbers in the page's format: units, signs, clocks. */

export const N_PER_GWT = 0.00980665;

/** Fixed decimals, a true minus, no negative zero; a dash if unknown. */
export function fixed(value, decimals) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = value.toFixed(decimals);
  return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "−");
}

/** A force in both units. */
export function inBoth(force_gwt) {
  return known(force_gwt) ? `${fixed(force_gwt, 2)} gwt (${fixed(force_gwt * N_PER_GWT, 4)} N)` : "–";
}

/** A length in both units. */
export function inMmAndUm(length_mm) {
  return known(length_mm) ? `${fixed(length_mm, 3)} mm (${fixed(length_mm * 1000, 0)} µm)` : "–";
}

export function known(value) {
  return typeof value === "number" && Number.isFinite(value);
}

/** h:mm:ss of seconds. */
export function asClock(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  const two = (n) => String(n).padStart(2, "0");
  return `${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
}

/** The time of day, to the second. */
export function timeOfDay(unix_s) {
  const at = new Date(unix_s * 1000);
  return [at.getHours(), at.getMinutes(), at.getSeconds()].map((n) => String(n).padStart(2, "0")).join(":");
}

/** The age in words that change at most once a second. */
export function ago(age_s) {
  return age_s < 100 ? `${Math.floor(age_s)} s ago` : `${asClock(age_s)} ago`;
}
