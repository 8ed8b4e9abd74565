"""Page of an identification: known forces, measured and predicted presses, parameters before and after."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import FuncFormatter, MaxNLocator

from rig.data.folder import replace_text
from rig.report.page_parts import PageFigure, Section, alone, render
from rig.report.style import BLUE, GREY, ORANGE, Plot, as_number, signed
from rig.report.title_lines import title_lines
from rig.units import unit_of_key
from rig_shared.plural import number_of
from sim.identification.posterior import Learned
from sim.identification.predicted_forces import MeasuredPress, PredictedForces
from sim.identification.prior import named, plain
from sim.identification.uncertainty_bands import COVERAGE, Width

_SHOWN = 60  # draws in a panel
_ACROSS = 4


class ForceBand(NamedTuple):
    """Force that the identified finger predicts, with its band, and the measured one of a press that was made."""

    press: str
    width: Width
    measured_gwt: float | None = None


@dataclass(frozen=True)
class IdentificationPage:
    """Content of the page; presses, forces and numbers are table rows."""

    predicted: PredictedForces
    measured: Sequence[MeasuredPress]
    before: Learned
    learned: Learned
    presses: Sequence[tuple[str, ...]]
    forces: Sequence[tuple[str, ...]]
    numbers: Sequence[tuple[str, ...]]
    not_learned: Sequence[str]
    bands: Sequence[ForceBand]
    source: str
    mismatch: str | None = None  # why no finger of the prior explains the presses


def write_identification_page(path: Path, page: IdentificationPage) -> None:
    """Write one self-contained page. Raises OSError."""
    over_time, before_and_after, correlated = identification_figures(page)
    sections = [
        Section("The force band", _message(page), figures=(_band_figure(page),)),
        Section(
            "Known forces",
            f"Forces that were asked for. {_IN_BRACKETS}",
            (*_PRESS, "force (gwt)", "known to"),
            tuple(page.forces),
        ),
        Section(
            "Not learned",
            "" if page.not_learned else "All requested forces are known.",
            points=tuple(page.not_learned),
        ),
        Section(
            "Presses",
            f"Highest force of each press: predicted before it, and measured. {_IN_BRACKETS} The last column "
            "shows how well all requested forces are known after the press.",
            ("press", *_PRESS, "predicted (gwt)", "measured (gwt)", "all known to"),
            tuple(page.presses),
        ),
        alone(over_time),
        Section(
            "Numbers of the finger",
            _AFTER_AND_BEFORE,
            ("parameter", "estimate", "after", "before"),
            tuple(page.numbers),
        ),
        alone(before_and_after),
        alone(correlated),
    ]
    title = "Identified finger" if page.mismatch is None else "The identified object is not a finger of the prior"
    replace_text(path, render("identification.html.j2", title=title, about=page.source, sections=sections))


def identification_figures(page: IdentificationPage) -> list[PageFigure]:
    """Return the figures of the page, in its order."""
    return [
        PageFigure("Each press over time", presses_over_time(page), _OVER_TIME),
        PageFigure("Before and after", marginals(page), _BEFORE_AND_AFTER),
        PageFigure("Correlations", correlations(page), _CORRELATED),
    ]


def _message(page: IdentificationPage) -> str:
    """Return what the presses show, in one sentence."""
    pressed = [one for one in page.bands if one.measured_gwt is not None]
    if page.mismatch is not None:
        return f"{number_of(len(pressed), 'presses')}: {page.mismatch}."
    if page.learned.collapsed:
        return (
            "The estimate has collapsed onto a few samples, so its bands are meaningless. Identify the finger again."
        )
    inside = sum(
        one.width.low <= one.measured_gwt <= one.width.high for one in pressed if one.measured_gwt is not None
    )
    known = max((one.width.half for one in page.bands if one.measured_gwt is None), default=None)
    asked = (
        "" if known is None else f", and every force that was asked for is known to ± {100 * known:.0f} % or better"
    )
    return (
        f"The identified finger explains {inside} of {number_of(len(pressed), 'presses')} within its "
        f"{100 * COVERAGE:.0f} % band{asked}."
    )


def _band_figure(page: IdentificationPage) -> PageFigure:
    return PageFigure(
        "The force band",
        force_band(page.bands),
        f"Blue: the {100 * COVERAGE:.0f} % band of the force that the identified finger predicts, and its middle. "
        "Black: the highest force that was measured. Rows without a black dot were asked for and not pressed.",
        message=_message(page),
    )


def force_band(bands: Sequence[ForceBand]) -> Plot:
    """Plot the predicted band of each force, with the measured force on it."""

    def draw(figure: Canvas) -> None:
        axes = figure.subplots()
        for row, one in enumerate(bands):
            axes.plot(
                [one.width.low, one.width.high], [row, row], color=BLUE, lw=7, alpha=0.45, solid_capstyle="butt"
            )
            axes.plot([one.width.middle], [row], "|", color=BLUE, ms=11, mew=1.6)
            if one.measured_gwt is not None:
                axes.plot([one.measured_gwt], [row], "o", color="black", ms=4.5)
            axes.annotate(one.press, (0.0, row), (3, 8), textcoords="offset points", fontsize=8)
        axes.set_yticks(())
        axes.set_ylim(len(bands) - 0.5, -0.8)
        axes.set_xlim(0, None)
        axes.set_xlabel("force (gwt)")

    return Plot((5.6, 0.8 + 0.4 * len(bands)), draw)


_PRESS = ("shape", "x (mm)", "depth (mm)")
_IN_BRACKETS = f"In brackets: the {100 * COVERAGE:.0f} % band."
_AFTER_AND_BEFORE = (
    "The estimates are those of the most likely finger whose parameters all lie within their bands. "
    f"{100 * COVERAGE:.0f} % bands, after the last press and before the first."
)
_OVER_TIME = (
    "Black: readings minus the mean reading in the air. Blue: 60 samples of the finger after the last press. "
    "The hold begins where a line turns, and the tissue relaxes."
)
_BEFORE_AND_AFTER = (
    "Probability density of each parameter along its axis, which may be logarithmic. Gray: before the first "
    "press. Blue: after the last press. Orange: the estimate."
)
_CORRELATED = (
    "Correlation over samples of the finger. Parameters with a correlation near 1 or −1 cannot be "
    "distinguished by these presses; forces may be well known although neither parameter is."
)


def presses_over_time(page: IdentificationPage) -> Plot:
    """Plot readings and predictions of each press against time."""
    down = -(-len(page.measured) // _ACROSS)

    def draw(figure: Canvas) -> None:
        grid = figure.subplots(down, _ACROSS, squeeze=False)
        for number, (axes, measured) in enumerate(zip(grid.flat, page.measured, strict=False), 1):
            t_s = measured.trajectory.read_s - measured.trajectory.t_s[0]
            axes.plot(
                t_s, page.predicted.forces_gwt(page.learned.draws[:_SHOWN], measured.trajectory).T, color=BLUE, lw=0.3
            )
            axes.plot(t_s, measured.force_gwt, ".", color="black", ms=4)
            about = f"{number}: {measured.trajectory.indentor} at {signed(measured.trajectory.x_mm)} mm"
            axes.set_title(title_lines(about, 2.3, 9), fontsize=9)
            axes.set_xlabel("time since the start of the press (s)")
        for axes in list(grid.flat)[len(page.measured) :]:
            axes.set_axis_off()
        for axes in grid[:, 0]:
            axes.set_ylabel("force (gwt)")

    return Plot((10.2, 2.6 * down), draw)


def marginals(page: IdentificationPage) -> Plot:
    """Plot the density of each parameter before and after the presses."""
    names = page.learned.prior.names
    down = -(-len(names) // _ACROSS)

    def draw(figure: Canvas) -> None:
        grid = figure.subplots(down, _ACROSS, squeeze=False)
        for axes in list(grid.flat)[len(names) :]:
            axes.set_axis_off()
        for k, (axes, name) in enumerate(zip(grid.flat, names, strict=False)):
            both = np.concatenate([page.before.draws[:, k], page.learned.draws[:, k], page.learned.most_likely[[k]]])
            edges = np.linspace(both.min(), both.max(), 41)
            axes.hist(page.before.draws[:, k], edges, density=True, color=GREY, alpha=0.5)
            axes.hist(page.learned.draws[:, k], edges, density=True, color=BLUE, alpha=0.7)
            axes.axvline(page.learned.most_likely[k], color=ORANGE, lw=1)
            axes.set_xlabel(f"{named(name)} ({unit_of_key(named(name)) or '1'})")
            axes.xaxis.set_major_locator(MaxNLocator(4))
            axes.xaxis.set_major_formatter(
                FuncFormatter(lambda value, _, name=name: as_number(plain(name, value), 2))
            )
            axes.set_yticks([])
        for axes in grid[:, 0]:
            axes.set_ylabel("density (1)")

    return Plot((10.2, 2.2 * down), draw)


def correlations(page: IdentificationPage) -> Plot:
    """Plot the correlation of every two parameters after the presses."""
    spread = page.learned.draws.std(axis=0) > 0
    names = [named(name) for name, varies in zip(page.learned.prior.names, spread, strict=True) if varies]

    def draw(figure: Canvas) -> None:
        axes = figure.subplots()
        shown = axes.imshow(np.corrcoef(page.learned.draws[:, spread].T), vmin=-1, vmax=1, cmap="RdBu_r")
        axes.set_xticks(range(len(names)), names, rotation=45, ha="right")
        axes.set_yticks(range(len(names)), names)
        figure.colorbar(shown, ax=axes, label="correlation (1)")

    return Plot((5.6, 4.8), draw)
