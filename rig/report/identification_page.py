"""Page of an identification: known forces, measured and predicted presses, parameters before and after."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from rig.data.folder import replace_text
from rig.report.page_parts import Section, alone, render
from rig.report.plot import PAGE_IN, PHONE_IN, Plot, Series, Subplot, in_grid, rows_of
from rig.report.style import BLUE, GREY, ORANGE, as_number, signed
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
        Section("The force band", _message(page), figures=(force_band(page.bands, _message(page)),)),
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


def identification_figures(page: IdentificationPage) -> list[Plot]:
    """Return the figures of the page, in its order."""
    return [presses_over_time(page), marginals(page), correlations(page)]


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


def force_band(bands: Sequence[ForceBand], message: str = "") -> Plot:
    """Plot the predicted band of each force, with the measured force on it."""
    series = []
    for row, one in enumerate(bands):
        ends, rows = [one.width.low, one.width.high], rows_of("bands", "force_gwt", "rows", band=row)
        series.append(
            Series("plot", ends, [row, row], rows=rows, color=BLUE, lw=7, alpha=0.45, solid_capstyle="butt")
        )
        rows = rows_of("bands", "middle_gwt", "row", band=row)
        series.append(
            Series("plot", [one.width.middle], [row], rows=rows, ls="", marker="|", color=BLUE, ms=11, mew=1.6)
        )
        if one.measured_gwt is not None:
            rows = rows_of("bands", "measured_gwt", "row", band=row)
            series.append(
                Series("plot", [one.measured_gwt], [row], rows=rows, ls="", marker="o", color="black", ms=4.5)
            )

    def finish(figure: Figure, panels: list[Axes]) -> None:
        (axes,) = panels
        for row, one in enumerate(bands):
            axes.annotate(one.press, (0.0, row), (3, 8), textcoords="offset points", fontsize=8)
        axes.set_yticks(())
        axes.set_ylim(len(bands) - 0.5, -0.8)
        axes.set_xlim(0, None)

    return Plot(
        (PHONE_IN, 0.8 + 0.4 * len(bands)),
        [Subplot("force (gwt)", "", series, printed="x", y_names=[one.press for one in bands])],
        "The force band",
        f"Blue: the {100 * COVERAGE:.0f} % band of the force that the identified finger predicts, and its middle. "
        "Black: the highest force that was measured. Rows without a black dot were asked for and not pressed.",
        message, finish=finish,
    )  # fmt: skip


_PRESS = ("shape", "x (mm)", "depth (mm)")
_IN_BRACKETS = f"In brackets: the {100 * COVERAGE:.0f} % band."
_AFTER_AND_BEFORE = (
    "The estimates are those of the most likely finger whose parameters all lie within their bands. "
    f"{100 * COVERAGE:.0f} % bands, after the last press and before the first."
)


def presses_over_time(page: IdentificationPage) -> Plot:
    """Plot readings and predictions of each press against time."""
    panels = []
    for k, measured in enumerate(page.measured):
        path = measured.trajectory
        t_s, forces = path.read_s - path.t_s[0], page.predicted.forces_gwt(page.learned.draws[:_SHOWN], path)
        series = [
            *(
                Series("plot", t_s, force, color=BLUE, lw=0.3,
                       rows=rows_of("presses", "t_s", "predicted_gwt", press=k, draw=n))
                for n, force in enumerate(forces)
            ),
            Series("plot", t_s, measured.force_gwt, ls="", marker=".", color="black", ms=4,
                   rows=rows_of("presses", "t_s", "force_gwt", press=k)),
        ]  # fmt: skip
        title = title_lines(f"{k + 1}: {path.indentor} at {signed(path.x_mm)} mm", 2.3, 9)
        time = "time since the start of the press (s)"
        panels.append(Subplot(time, "force (gwt)", series, title, printed="x" if k % _ACROSS else "xy"))
    return Plot(
        (10.2, 2.6 * -(-len(panels) // _ACROSS)), panels,
        "Each press over time",
        "Black: readings minus the mean reading in the air. Blue: 60 samples of the finger after the last press. "
        "The hold begins where a line turns, and the tissue relaxes.",
        arrange=in_grid(len(panels), _ACROSS), titles={"fontsize": 9},
    )  # fmt: skip


def marginals(page: IdentificationPage) -> Plot:
    """Plot the density of each parameter before and after the presses."""
    names, draws = page.learned.prior.names, (page.before.draws, page.learned.draws)
    panels = []
    for k, name in enumerate(names):
        likely = page.learned.most_likely[k]
        both = np.concatenate([*(one[:, k] for one in draws), [likely]])
        edges = np.linspace(both.min(), both.max(), 41)
        series = [
            Series("hist", one[:, k], edges, density=True, color=color, alpha=alpha, rows=rows_of(when, name))
            for one, when, color, alpha in zip(draws, ("before", "after"), (GREY, BLUE), (0.5, 0.7), strict=True)
        ]
        x = f"{named(name)} ({unit_of_key(named(name)) or '1'})"
        estimate = Series("axvline", likely, rows=rows_of("after", f"estimate of {name}"), color=ORANGE, lw=1)
        panels.append(Subplot(x, "density (1)", [*series, estimate], printed="x" if k % _ACROSS else "xy"))

    def finish(figure: Figure, axes: list[Axes]) -> None:
        for one, name in zip(axes, names, strict=True):
            one.xaxis.set_major_locator(MaxNLocator(4))
            one.xaxis.set_major_formatter(FuncFormatter(lambda value, _, name=name: as_number(plain(name, value), 2)))
            one.set_yticks([])

    return Plot(
        (10.2, min(2.2 * -(-len(panels) // _ACROSS), PAGE_IN[1])), panels,
        "Before and after",
        "Probability density of each parameter along its axis, which may be logarithmic. Gray: before the first "
        "press. Blue: after the last press. Orange: the estimate.",
        arrange=in_grid(len(panels), _ACROSS), finish=finish,
    )  # fmt: skip


def correlations(page: IdentificationPage) -> Plot:
    """Plot the correlation of every two parameters after the presses."""
    varied = page.learned.draws.std(axis=0) > 0
    names = [named(name) for name, varies in zip(page.learned.prior.names, varied, strict=True) if varies]
    fixed = [named(name) for name, varies in zip(page.learned.prior.names, varied, strict=True) if not varies]
    left_out = f" Left out, as all samples have one value: {', '.join(fixed)}." * bool(fixed)
    image = Series("imshow", np.corrcoef(page.learned.draws[:, varied].T), vmin=-1, vmax=1, cmap="RdBu_r",
                   rows=rows_of("after", "r"))  # fmt: skip
    panel = Subplot("", "", [image], printed="", x_names=names, y_names=names, color="correlation (1)")

    def finish(figure: Figure, panels: list[Axes]) -> None:
        (axes,) = panels
        axes.set_xticks(range(len(names)), names, rotation=45, ha="right")
        axes.set_yticks(range(len(names)), names)
        figure.colorbar(axes.images[0], ax=axes, label=panel.color)

    return Plot(
        (5.6, 4.8), [panel],
        "Correlations",
        f"Correlation over samples of the finger.{left_out} Parameters with a correlation near 1 or −1 cannot be "
        "distinguished by these presses; forces may be well known although neither parameter is.",
        finish=finish,
    )  # fmt: skip
