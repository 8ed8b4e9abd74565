"""Figures that are maps: correlations over measures and receptors, pressure over skin and indentor positions."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from rig.compare.comparison import Comparison
from rig.compare.stimuli import Stimulus
from rig.report.comparison.fit_figures import frame
from rig.report.labels import label
from rig.report.style import GREY, Plot, signed, some_of
from sim.measures.measures import MEASURES

Array = NDArray[np.float64]

CORRELATIONS_A_PAGE, PRESSURES_A_PAGE = 8, 9
_MOST_RECEPTORS = 12
_DARK = 0.5  # |r| beyond which black is not seen on a map's colours


def correlations(comparison: Comparison, judged: Sequence[Stimulus]) -> Plot:
    """18 measures × receptors for each stimulus: Pearson's r in colour, a dot where the shape test is passed."""
    rows, columns = _grid(len(judged), 4)
    size = (1.2 + 2.35 * columns, 0.5 + 2.85 * rows)
    return Plot(size, lambda figure: _correlations(figure, comparison, judged, rows, columns))


def pressure_maps(stimuli: Sequence[Stimulus]) -> Plot:
    """Pressure in the receptor plane for each position of each schedule, and the ends of the contact regions."""
    rows, columns = _grid(len(stimuli), 3)
    size = (0.6 + 3.2 * columns, 0.45 + 1.95 * rows)
    return Plot(size, lambda figure: _pressure_maps(figure, stimuli, rows, columns))


def _grid(panels: int, widest: int) -> tuple[int, int]:
    """Rows and columns that leave few places empty."""
    rows = -(-panels // widest)
    return rows, -(-panels // rows)


def _correlations(
    figure: Figure, comparison: Comparison, judged: Sequence[Stimulus], rows: int, columns: int
) -> None:
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
    recorded = {overlay.stimulus: overlay.r for overlay in comparison.overlays}
    image = None
    for axes in panels[len(judged) :]:
        axes.set_visible(False)
    for axes, stimulus in zip(panels, judged, strict=False):
        drawn = _heat_map(axes, stimulus, recorded.get(stimulus), comparison.passes(stimulus))
        image = drawn if stimulus in recorded else image
    figure.supxlabel("receptor x (mm)", fontsize=8)
    if image is not None:
        figure.colorbar(image, ax=panels.tolist(), label="Pearson's r", shrink=0.6)
        figure.suptitle(frame(comparison.overlays), fontsize=7, color=GREY)


def _heat_map(axes: Axes, stimulus: Stimulus, r: Array | None, passed: NDArray[np.bool_] | None) -> AxesImage:
    n = len(stimulus.receptor_mm)
    shown = np.full((len(MEASURES), n), np.nan) if r is None else r
    image = axes.imshow(shown, cmap="PuOr_r", vmin=-1, vmax=1, aspect="auto", interpolation="nearest")
    _mark_negative(axes, shown)
    if passed is not None:
        measure, receptor = np.nonzero(passed)
        axes.plot(receptor, measure, "o", ms=4, mfc="black", mec="white", mew=0.6)
    written = some_of(n, _MOST_RECEPTORS)
    axes.set_xticks(written, [signed(x) for x in stimulus.receptor_mm[written]], fontsize=6.5, rotation=90)
    axes.set_yticks(range(len(MEASURES)), [label(m) for m in MEASURES], fontsize=7)
    axes.set_xticks(np.arange(n - 1) + 0.5, minor=True)
    axes.set_yticks(np.arange(len(MEASURES) - 1) + 0.5, minor=True)
    axes.grid(which="minor", color="#dddddd", lw=0.4)
    axes.tick_params(which="minor", length=0)
    axes.set_title(stimulus.title + ("" if passed is not None else "\nno shape test"), fontsize=8)
    for side in axes.spines.values():
        side.set_visible(True)
    return image


def _mark_negative(axes: Axes, r: Array) -> None:
    """A dash, since in grey the two ends of the colours are alike."""
    for colour, chosen in (("black", (r < 0) & (r > -_DARK)), ("white", r <= -_DARK)):
        measure, receptor = np.nonzero(chosen)
        axes.plot(receptor, measure, "_", ms=10, mew=0.6, color=colour)


def _pressure_maps(figure: Figure, stimuli: Sequence[Stimulus], rows: int, columns: int) -> None:
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(stimuli) :]:
        axes.set_visible(False)
    for k, (axes, stimulus) in enumerate(zip(panels, stimuli, strict=False)):
        image = _pressure_map(axes, stimulus)
        last = k % columns == columns - 1 or k == len(stimuli) - 1
        bar = figure.colorbar(image, ax=axes)
        bar.set_label("pressure (pseudo-units)" if last else "", fontsize=8)
        bar.ax.tick_params(labelsize=7)
    figure.supxlabel("skin, undeformed x (mm)", fontsize=9)
    figure.supylabel("indentor x (mm)", fontsize=9)


def _pressure_map(axes: Axes, stimulus: Stimulus) -> QuadMesh:
    at, of, pressure = stimulus.skin_mm, stimulus.x_mm, stimulus.pressure
    image = axes.pcolormesh(at, of, pressure, cmap="viridis", shading="nearest", rasterized=True, vmin=0)
    ends = [
        (end, x)
        for position, x in enumerate(stimulus.x_mm)
        for region in stimulus.contact_regions_mm(position)
        for end in region
    ]
    outline = [withStroke(linewidth=2.2, foreground="black")]
    marks = np.array(ends).reshape(-1, 2).T
    axes.plot(*marks, "|", ms=4.5, mew=1.0, color="white", path_effects=outline)
    axes.set_title(stimulus.title, fontsize=8)
    axes.tick_params(labelsize=7)
    return image
