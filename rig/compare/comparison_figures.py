"""Figures of a comparison as SVG."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from rig.compare.comparison import Comparison, Joint, Pairing
from rig.compare.fit import Fit, predicted
from rig.compare.shape_test import THRESHOLD, shape_test
from rig.compare.stimuli import Stimulus
from rig.compare.style import BLUE, GREEN, GREY, ORANGE, Plot, position_bar, shade_of, signed
from sim.measures.measures import MEASURES, PLOTTED_AS_MAGNITUDE

Array = NDArray[np.float64]
Pair = tuple[int, int]  # measure, receptor

_STRAINS = MEASURES[:9]
_SHAPE_STYLES = ((BLUE, "o"), (ORANGE, "s"), (GREEN, "^"), (GREY, "D"))
_RATE = "discharge rate (unit of the recording)"
_ABBREVIATED = {"sed": "SED"}


def label(measure: str) -> str:
    """A measure with its sign convention: "−ep1" where compression is plotted upwards."""
    name = _ABBREVIATED.get(measure, measure)
    return f"−{name}" if measure in PLOTTED_AS_MAGNITUDE else name


def unit(measure: str) -> str:
    """Strains are numbers, everything else is in pseudo-units."""
    return "strain" if measure in _STRAINS else "pseudo-units³" if measure == "third" else "pseudo-units"


def frame(pairings: Sequence[Pairing]) -> str:
    """How recorded positions and rates were laid over the simulation; printed on every figure that does."""
    changed = {f"{p.stimulus.indentor} {change}" for p in pairings for change in p.recording.changes}
    return "; ".join(["indentor x = recorded position + receptor x, no offset fitted", *sorted(changed)])


def ssrps(stimulus: Stimulus, measures: list[str]) -> Plot:
    """One panel a measure: the SSRPs of all receptors above each other, and how each did in the shape test."""
    size = (3.4 * len(measures), 1.2 + 0.42 * len(stimulus.receptor_mm))
    return Plot(size, lambda figure: _ssrps(figure, stimulus, measures))


def correlations(comparison: Comparison) -> Plot:
    """18 measures × receptors for each stimulus: Pearson's r in colour, a dot where the shape test is passed."""
    rows, columns = _grid(len(comparison.judged), 4)
    size = (1.0 + 2.5 * columns, 0.9 + 3.9 * rows)
    return Plot(size, lambda figure: _correlations(figure, comparison, rows, columns))


def overlays(joint: Joint, pairs: list[Pair]) -> Plot:
    """Rates that the joint line predicts from the SSRP, over the recorded ones: pairs down, shapes across."""
    rows, columns = (len(pairs), len(joint.pairings)) if len(joint.pairings) > 1 else (1, len(pairs))
    return Plot(
        (0.6 + 3.2 * columns, 0.7 + 2.1 * rows), lambda figure: _overlays(figure, joint, pairs, rows, columns)
    )


def scatter(joint: Joint, pairs: list[Pair]) -> Plot:
    """Recorded rate against the measure, all shapes, with the joint line."""
    return Plot((0.4 + 2.7 * len(pairs), 3.1), lambda figure: _scatter(figure, joint, pairs))


def populations(stimulus: Stimulus, measures: list[str]) -> Plot:
    """The measures at all receptors, one line for each indentor position."""
    return Plot((0.8 + 3.1 * len(measures), 2.9), lambda figure: _populations(figure, stimulus, measures))


def pressure_maps(stimuli: tuple[Stimulus, ...]) -> Plot:
    """Pressure in the receptor plane for each position of each schedule, and the ends of the contact regions."""
    rows, columns = _grid(len(stimuli), 3)
    return Plot(
        (0.4 + 3.4 * columns, 0.4 + 2.8 * rows), lambda figure: _pressure_maps(figure, stimuli, rows, columns)
    )


def _grid(panels: int, widest: int) -> tuple[int, int]:
    """Rows and columns that leave few places empty."""
    rows = -(-panels // widest)
    return rows, -(-panels // rows)


def _ssrps(figure: Figure, stimulus: Stimulus, measures: list[str]) -> None:
    panels = figure.subplots(1, len(measures), squeeze=False, sharex=True, sharey=True)[0]
    for axes, measure in zip(panels, measures, strict=True):
        values = stimulus.measures[MEASURES.index(measure)]
        size = float(np.ptp(values)) or 1.0
        for k in range(len(stimulus.receptor_mm)):
            _one_ssrp(axes, stimulus, values[:, k] / size, k)
        axes.set_title(f"{label(measure)}, one step up = {0.8 * size:.3g} {unit(measure)}", fontsize=8)
        axes.set_xlabel("indentor x (mm)")
        axes.set_yticks(_OFFSET * np.arange(len(stimulus.receptor_mm)), [signed(x) for x in stimulus.receptor_mm])
    panels[0].set_ylabel("receptor x (mm)")


_OFFSET = 0.8


def _one_ssrp(axes: Axes, stimulus: Stimulus, profile: Array, k: int) -> None:
    """A profile on its own baseline; the bar at its right end is as long as the dip must at least be."""
    verdict = shape_test(stimulus.indentor, stimulus.x_mm, profile)
    base = 0.5 * float(profile[0] + profile[-1])
    passed = verdict is not None and verdict.passed
    colour = BLUE if passed else GREY
    level = _OFFSET * k
    axes.plot(stimulus.x_mm, profile - base + level, "-o", ms=1.8, lw=1.6 if passed else 0.8, color=colour)
    axes.axhline(level, color=GREY, lw=0.4, ls=":")
    axes.plot([stimulus.receptor_mm[k]], [level], marker="|", ms=7, color="black")
    if verdict is None:
        return
    end = float(stimulus.x_mm[-1]) + 0.04 * float(np.ptp(stimulus.x_mm))
    least = THRESHOLD * max(verdict.judged_by.get("peak", verdict.judged_by.get("range", 0.0)), 0.0)
    axes.plot([end, end], [level - least, level], color=ORANGE, lw=2)
    mark = "pass" if passed else "–"
    axes.annotate(mark, (end, level), (4, 0), textcoords="offset points", fontsize=7, color=colour, va="center")


def _correlations(figure: Figure, comparison: Comparison, rows: int, columns: int) -> None:
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
    recorded = {pairing.stimulus: pairing.r for pairing in comparison.pairings}
    image = None
    for axes in panels[len(comparison.judged) :]:
        axes.set_visible(False)
    for axes, stimulus in zip(panels, comparison.judged, strict=False):
        drawn = _heat_map(axes, stimulus, recorded.get(stimulus), comparison.passes(stimulus))
        image = drawn if stimulus in recorded else image
    if image is not None:
        figure.colorbar(image, ax=panels.tolist(), label="Pearson's r", shrink=0.6)
        figure.suptitle(frame(comparison.pairings), fontsize=7, color=GREY)


def _heat_map(axes: Axes, stimulus: Stimulus, r: Array | None, passed: NDArray[np.bool_] | None) -> AxesImage:
    n = len(stimulus.receptor_mm)
    shown = np.full((len(MEASURES), n), np.nan) if r is None else r
    image = axes.imshow(shown, cmap="PuOr_r", vmin=-1, vmax=1, aspect="auto", interpolation="nearest")
    if passed is not None:
        measure, receptor = np.nonzero(passed)
        axes.plot(receptor, measure, "o", ms=4, mfc="black", mec="white", mew=0.6)
    axes.set_xticks(range(n), [signed(x) for x in stimulus.receptor_mm], fontsize=6.5, rotation=90)
    axes.set_yticks(range(len(MEASURES)), [label(m) for m in MEASURES], fontsize=7)
    axes.set_title(stimulus.title + ("" if passed is not None else "\nno shape test"), fontsize=8)
    axes.set_xlabel("receptor x (mm)", fontsize=8)
    for side in axes.spines.values():
        side.set_visible(True)
    return image


def _overlays(figure: Figure, joint: Joint, pairs: list[Pair], rows: int, columns: int) -> None:
    panels = figure.subplots(rows, columns, squeeze=False, sharex=rows == 1 or "col", sharey=True)
    figure.suptitle(frame(joint.pairings), fontsize=7, color=GREY)
    shown = [(pairing, pair) for pair in pairs for pairing in joint.pairings]
    for axes, (pairing, pair) in zip(panels.ravel(), shown, strict=True):
        _overlay(axes, pairing, joint.fit, pair)
        axes.set_title(f"{pairing.stimulus.title}: {_named(pairing.stimulus, pair)}", fontsize=8)
    figure.supylabel(_RATE, fontsize=9)
    for axes in panels[-1]:
        axes.set_xlabel("position from field centre (mm)")
    handles = [
        Line2D([], [], color="black", marker="o", ms=3, ls="", label="recorded, ± 1 sd"),
        Line2D([], [], color=BLUE, label="predicted by the joint line"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=8)


def _overlay(axes: Axes, pairing: Pairing, fit: Fit, pair: Pair) -> None:
    recording = pairing.recording
    fine = np.linspace(recording.position_mm[0], recording.position_mm[-1], 241)
    line = Fit(*(np.asarray(v[pair]) for v in fit))
    axes.plot(fine, predicted(line, pairing.stimulus.at(fine)[pair[0], :, pair[1]]), color=BLUE, lw=1.4)
    bars = np.nan_to_num(recording.sd)
    axes.errorbar(recording.position_mm, recording.rate, bars, fmt="o", ms=3, color="black", elinewidth=0.7)


def _scatter(figure: Figure, joint: Joint, pairs: list[Pair]) -> None:
    panels = figure.subplots(1, len(pairs), squeeze=False, sharey=True)[0]
    figure.suptitle(frame(joint.pairings), fontsize=7, color=GREY)
    for axes, (measure, receptor) in zip(panels, pairs, strict=True):
        for pairing, (colour, marker) in zip(joint.pairings, _SHAPE_STYLES, strict=False):
            eps = pairing.eps[measure, :, receptor]
            axes.plot(
                eps, pairing.recording.rate, marker, ms=4, mfc="none", mec=colour, label=pairing.stimulus.indentor
            )
        k, eps0 = joint.fit.k[measure, receptor], joint.fit.eps0[measure, receptor]
        low, high = (float(f(joint.eps[measure, :, receptor])) for f in (np.nanmin, np.nanmax))
        fine = np.linspace(low - 0.05 * (high - low), high + 0.05 * (high - low), 101)
        axes.plot(fine, np.maximum(0, k * (fine - eps0)), color="black", lw=1)
        name = MEASURES[measure]
        stimulus = joint.pairings[0].stimulus
        r2 = f"R² = {joint.explained[measure, receptor]:.3f}"
        axes.set_title(f"{_named(stimulus, (measure, receptor))}\n{r2}, k = {k:.3g}, ε₀ = {eps0:.3g}", fontsize=8)
        axes.set_xlabel(f"{label(name)} ({unit(name)})")
    figure.supylabel(_RATE, fontsize=9)
    panels[0].legend(fontsize=7)


def _populations(figure: Figure, stimulus: Stimulus, measures: list[str]) -> None:
    panels = figure.subplots(1, len(measures), squeeze=False)[0]
    positions = [float(x) for x in stimulus.x_mm]
    for axes, measure in zip(panels, measures, strict=True):
        for x, row in zip(positions, stimulus.measures[MEASURES.index(measure)], strict=True):
            axes.plot(stimulus.receptor_mm, row, "-o", ms=2, lw=0.9, color=shade_of(x, positions), label=signed(x))
        axes.set(xlabel="receptor x (mm)", ylabel=f"{label(measure)} ({unit(measure)})")
    if len(positions) <= _FEW:
        panels[0].legend(fontsize=7, title="indentor x (mm)", title_fontsize=7)
    else:
        position_bar(figure, panels.tolist(), positions)


_FEW = 6


def _pressure_maps(figure: Figure, stimuli: tuple[Stimulus, ...], rows: int, columns: int) -> None:
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(stimuli) :]:
        axes.set_visible(False)
    for axes, stimulus in zip(panels, stimuli, strict=False):
        image = axes.pcolormesh(
            stimulus.skin_mm,
            stimulus.x_mm,
            stimulus.pressure,
            cmap="viridis",
            shading="nearest",
            rasterized=True,
            vmin=0,
        )
        ends = [
            (end, x)
            for position, x in enumerate(stimulus.x_mm)
            for region in stimulus.contact_regions_mm(position)
            for end in region
        ]
        axes.plot(*np.array(ends).reshape(-1, 2).T, "|", ms=5, mew=1.1, color="white")
        axes.set_title(stimulus.title, fontsize=8)
        axes.set(xlabel="skin, undeformed x (mm)", ylabel="indentor x (mm)")
        figure.colorbar(image, ax=axes, label="pressure (pseudo-units)")


def _named(stimulus: Stimulus, pair: Pair) -> str:
    return f"{label(MEASURES[pair[0]])} at {signed(stimulus.receptor_mm[pair[1]])} mm"
