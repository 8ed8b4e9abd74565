/** Elements of the page, changed only if they differ, so that nothing else is drawn again. */

export const at = (id) => document.getElementById(id);

/** Write words for the reader and their code, as `data-code`, for programs. */
export function write(id, words, code) {
  const element = at(id);
  if (element.textContent !== words) element.textContent = words;
  if (code !== undefined && element.dataset.code !== code) element.dataset.code = code;
}

export function show(id, shown) {
  const element = at(id);
  if (element.hasAttribute("hidden") === shown) element.toggleAttribute("hidden", !shown);
}

export function mark(element, name, on) {
  if (element.classList.contains(name) !== on) element.classList.toggle(name, on);
}
