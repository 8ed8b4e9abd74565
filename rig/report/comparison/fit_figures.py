"""Figures of fits: recorded rates under what a joint line predicts, and against the measure itself."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from rig.compare.comparison import Joint, Overlay
from rig.compare.fit import Fit, predicted
from rig.compare.tables import Pair
from rig.report.labels import label, unit
from rig.report.style import BLUE, GREEN, GREY, ORANGE, Plot, signed
from sim.measures.measures import MEASURES

_SHAPE_STYLES = ((BLUE, "o"), (ORANGE, "s"), (GREEN, "^"), (GREY, "D"))
_RATE = "discharge rate (unit of the recording)"
_WIDEST_IN = 9.8


def overlays(joint: Joint, pairs: list[Pair]) -> Plot:
    """Rates that the joint line predicts from the SSRP, over the recorded ones: pairs down, shapes across."""
    rows, columns = (len(pairs), len(joint.overlays)) if len(joint.overlays) > 1 else (1, len(pairs))
    size = (0.6 + min(3.2 * columns, _WIDEST_IN), 0.7 + 1.85 * rows)
    return Plot(size, lambda figure: _overlays(figure, joint, pairs, rows, columns))


def scatter(joint: Joint, pairs: list[Pair]) -> Plot:
    """Recorded rate against the measure, all shapes, with the joint line."""
    return Plot((0.4 + 2.7 * len(pairs), 3.1), lambda figure: _scatter(figure, joint, pairs))


def _overlays(figure: Figure, joint: Joint, pairs: list[Pair], rows: int, columns: int) -> None:
    panels = figure.subplots(rows, columns, squeeze=False, sharex=rows == 1 or "col", sharey=True)
    figure.suptitle(frame(joint.overlays), fontsize=7, color=GREY)
    shown = [(overlay, pair) for pair in pairs for overlay in joint.overlays]
    for axes, (overlay, pair) in zip(panels.ravel(), shown, strict=True):
        _overlay(axes, overlay, joint.fit, pair)
        axes.set_title(f"{overlay.stimulus.title}: {named(overlay.stimulus.receptor_mm, pair)}", fontsize=8)
    figure.supylabel(_RATE, fontsize=9)
    for axes in panels[-1]:
        axes.set_xlabel("position from field centre (mm)")
    handles = [
        Line2D([], [], color="black", marker="o", ms=3, ls="", label="recorded, ± 1 sd"),
        Line2D([], [], color=BLUE, label="predicted by the joint line"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=8)


def _overlay(axes: Axes, overlay: Overlay, fit: Fit, pair: Pair) -> None:
    recording = overlay.recording
    fine = np.linspace(recording.position_mm[0], recording.position_mm[-1], 241)
    line = Fit(*(np.asarray(v[pair]) for v in fit))
    axes.plot(fine, predicted(line, overlay.stimulus.at(fine)[pair[0], :, pair[1]]), color=BLUE, lw=1.4)
    bars = np.nan_to_num(recording.sd)
    axes.errorbar(recording.position_mm, recording.rate, bars, fmt="o", ms=3, color="black", elinewidth=0.7)


def _scatter(figure: Figure, joint: Joint, pairs: list[Pair]) -> None:
    panels = figure.subplots(1, len(pairs), squeeze=False, sharey=True)[0]
    figure.suptitle(frame(joint.overlays), fontsize=7, color=GREY)
    for axes, pair in zip(panels, pairs, strict=True):
        _against_measure(axes, joint, pair)
    figure.supylabel(_RATE, fontsize=9)
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=len(names), fontsize=8)


def _against_measure(axes: Axes, joint: Joint, pair: Pair) -> None:
    measure, receptor = pair
    for overlay, (colour, marker) in zip(joint.overlays, _SHAPE_STYLES, strict=False):
        eps, name = overlay.eps[measure, :, receptor], overlay.stimulus.indentor
        axes.plot(eps, overlay.recording.rate, marker, ms=4, mfc="none", mec=colour, label=name)
    k, eps0 = joint.fit.k[pair], joint.fit.eps0[pair]
    low, high = (float(f(joint.eps[measure, :, receptor])) for f in (np.nanmin, np.nanmax))
    fine = np.linspace(low - 0.05 * (high - low), high + 0.05 * (high - low), 101)
    axes.plot(fine, np.maximum(0, k * (fine - eps0)), color="black", lw=1)
    fitted = f"R² = {joint.explained[pair]:.3f}, k = {k:.3g}, ε₀ = {eps0:.3g}".replace("-", "−")
    axes.set_title(f"{named(joint.overlays[0].stimulus.receptor_mm, pair)}\n{fitted}", fontsize=8)
    axes.set_xlabel(f"{label(MEASURES[measure])} ({unit(MEASURES[measure])})")


def frame(overlays: Sequence[Overlay]) -> str:
    """How recorded positions and rates were laid over the simulation; printed on every figure that does."""
    changed = {f"{p.stimulus.indentor} {change}" for p in overlays for change in p.recording.changes}
    return "; ".join(["indentor x = recorded position + receptor x, no offset fitted", *sorted(changed)])


def named(receptor_mm: NDArray[np.float64], pair: Pair) -> str:
    """A measure at a receptor."""
    return f"{label(MEASURES[pair[0]])} at {signed(receptor_mm[pair[1]])} mm"
