/** Figures can be enlarged and saved; charts follow the data and the color scheme, and are zoomed by dragging. */

const dark = matchMedia("(prefers-color-scheme: dark)");
const HEIGHT_PX = 260, BAND_PX = 10, ROOM = 0.12, STEP = 1.5, LARGEST = 8;

function action(words, does) {
  const button = Object.assign(document.createElement("button"), { type: "button", textContent: words, onclick: does });
  return button;
}

function enlarge(image) {
  const dialog = document.createElement("dialog");
  const copy = Object.assign(document.createElement("img"), { src: image.src, alt: image.alt });
  let scale = 1;
  const to = (wanted) => {
    scale = Math.min(Math.max(wanted, 1), LARGEST);
    copy.style.width = `${100 * scale}%`;
  };
  const bar = document.createElement("p");
  bar.append(action("Larger", () => to(scale * STEP)), action("Smaller", () => to(scale / STEP)), action("Close", () => dialog.close()));
  dialog.append(bar, copy);
  dialog.onclose = () => dialog.remove();
  to(1);
  document.body.append(dialog);
  dialog.showModal();
}

for (const image of document.querySelectorAll("figure img")) {
  const caption = image.closest("figure").querySelector("figcaption");
  const title = (image.closest("figure").dataset.title ?? document.title).trim();
  const name = document.body.dataset.name + title.toLowerCase().replace(/[^a-z0-9]+/g, "-");
  const save = Object.assign(document.createElement("a"), { textContent: "Save as SVG", download: `${name}.svg`, href: image.src });
  const actions = Object.assign(document.createElement("span"), { className: "save" });
  actions.append(action("Enlarge", () => enlarge(image)), " ", save);
  caption.append(" ", actions);
}

function chart(frame) {
  const { x_label, y_label, lines, bands, spans, data } = JSON.parse(frame.firstElementChild.textContent);
  const of = ({ colors }) => colors[dark.matches ? 1 : 0];
  const ink = () => getComputedStyle(document.body).color;
  const faint = () => getComputedStyle(document.body).getPropertyValue("--hair");
  const axis = (label) => ({ label, stroke: ink, grid: { stroke: faint, width: 1 }, ticks: { stroke: faint, width: 1 } });
  const strip = (plot) => {
    const { left, top, width, height } = plot.bbox, high = BAND_PX * devicePixelRatio;
    plot.ctx.save();
    plot.ctx.beginPath();
    plot.ctx.rect(left, top, width, height);
    plot.ctx.clip();
    bands.forEach((band, k) => {
      plot.ctx.fillStyle = of(band);
      for (const [begin, end] of spans[k]) {
        const from = plot.valToPos(begin, "x", true);
        plot.ctx.fillRect(from, top + height - high, plot.valToPos(end, "x", true) - from, high);
      }
    });
    plot.ctx.restore();
  };
  const series = [{ label: x_label }, ...lines.map((line) => ({ label: line.name, stroke: () => of(line), width: 1.5, spanGaps: false, points: { show: false } }))];
  const plot = new uPlot({
    width: frame.clientWidth, height: HEIGHT_PX, series, axes: [axis(x_label), axis(y_label)], scales: { x: { time: false }, y: { range: (_, low, high) => uPlot.rangeNum(low - (bands.length ? ROOM * (high - low) : 0), high, 0.05, true) } }, hooks: { draw: [strip] },
  }, data, frame);
  const key = document.createElement("p");
  for (const band of bands) {
    const swatch = Object.assign(document.createElement("span"), { className: "swatch" });
    const paint = () => (swatch.style.background = of(band));
    paint();
    dark.addEventListener("change", paint);
    key.append(swatch, `${band.name} `);
  }
  const hint = Object.assign(document.createElement("p"), { textContent: "Drag over the chart to zoom in; double-click to zoom out." });
  frame.append(key, hint);
  new ResizeObserver(() => plot.setSize({ width: frame.clientWidth, height: HEIGHT_PX })).observe(frame);
  dark.addEventListener("change", () => plot.redraw());
}

for (const frame of document.querySelectorAll(".zoom")) {
  frame.closest("figure").classList.add("live");
  chart(frame);
}
