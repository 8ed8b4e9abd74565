"""The page of a meeting: measured on foreseen, what is known before and after, what goes with what."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Canvas

from rig.data.folder import replace_text
from rig.report.html import Figure, Section, alone, render
from rig.report.style import BLUE, GREY, ORANGE, Plot
from sim.models.meeting.foreseen import Foreseen
from sim.models.meeting.given import Given
from sim.models.meeting.learned import Learned

_SHOWN = 60  # draws of a panel
_ACROSS = 4


@dataclass(frozen=True)
class Met:
    """All that the page is made of; rows: what each press was, and what was expected of it."""

    foreseen: Foreseen
    given: Sequence[Given]
    before: Learned
    learned: Learned
    rows: Sequence[tuple[str, ...]]
    not_learned: Sequence[str]


def write_meeting_page(path: Path, met: Met) -> None:
    """One self-contained page. Raises OSError."""
    header = ("press", "shape", "x (mm)", "depth (mm)", "foreseen (gwt)", "measured (gwt)", "forces known to")
    sections = [
        Section("Presses", "", header, tuple(met.rows)),
        alone(
            Figure("Measured on foreseen", _presses(met), "Black: readings, zero taken off. Blue: likely fingers.")
        ),
        alone(Figure("Before and after", _marginals(met), "Grey: the prior. Blue: after the last press.")),
        alone(Figure("What goes with what", _correlations(met), "Correlation over the likely fingers.")),
        Section(
            "Not learned", "" if met.not_learned else "Nothing of what was asked.", points=tuple(met.not_learned)
        ),
    ]
    about = f"{len(met.given)} presses; each of the likely fingers answers them within the errors of cell and model"
    replace_text(path, render("meeting.html.j2", title="A finger was met", about=about, sections=sections))


def _presses(met: Met) -> Plot:
    down = -(-len(met.given) // _ACROSS)

    def draw(figure: Canvas) -> None:
        grid = figure.subplots(down, _ACROSS, squeeze=False)
        for axes, given in zip(grid.flat, met.given, strict=False):
            t_s = given.way.asked_s - given.way.t_s[0]
            axes.plot(t_s, met.foreseen.forces_gwt(met.learned.draws[:_SHOWN], given.way).T, color=BLUE, lw=0.3)
            axes.plot(t_s, given.force_gwt, ".", color="black", ms=4)
            axes.set_title(f"{given.way.indentor} at {given.way.x_mm:+.1f} mm", fontsize=9)
            axes.set_xlabel("time (s)")
        for axes in list(grid.flat)[len(met.given) :]:
            axes.set_axis_off()
        grid[0, 0].set_ylabel("force (gwt)")

    return Plot((10.2, 2.6 * down), draw)


def _marginals(met: Met) -> Plot:
    names = met.learned.prior.names
    down = -(-len(names) // _ACROSS)

    def draw(figure: Canvas) -> None:
        grid = figure.subplots(down, _ACROSS, squeeze=False)
        for axes in list(grid.flat)[len(names) :]:
            axes.set_axis_off()
        for k, (axes, name) in enumerate(zip(grid.flat, names, strict=False)):
            edges = np.linspace(met.before.draws[:, k].min(), met.before.draws[:, k].max(), 41)
            axes.hist(met.before.draws[:, k], edges, density=True, color=GREY, alpha=0.5)
            axes.hist(met.learned.draws[:, k], edges, density=True, color=BLUE, alpha=0.7)
            axes.axvline(met.learned.likeliest[k], color=ORANGE, lw=1)
            axes.set_xlabel(name)
            axes.set_yticks([])

    return Plot((10.2, 2.2 * down), draw)


def _correlations(met: Met) -> Plot:
    names = met.learned.prior.names

    def draw(figure: Canvas) -> None:
        axes = figure.subplots()
        shown = axes.imshow(np.corrcoef(met.learned.draws.T), vmin=-1, vmax=1, cmap="RdBu_r")
        axes.set_xticks(range(len(names)), names, rotation=45, ha="right")
        axes.set_yticks(range(len(names)), names)
        figure.colorbar(shown, ax=axes)

    return Plot((5.6, 4.8), draw)
