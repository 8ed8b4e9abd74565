/** Elements of the page, changed only if they differ, so that nothing else is drawn again. */

export const at = (id) => document.getElementById(id);

export function write(id, words) {
  const element = at(id);
  if (element.textContent !== words) element.textContent = words;
}

export function show(id, shown) {
  const element = at(id);
  if (element.hasAttribute("hidden") === shown) element.toggleAttribute("hidden", !shown);
}

export function mark(element, name, on) {
  if (element.classList.contains(name) !== on) element.classList.toggle(name, on);
}
