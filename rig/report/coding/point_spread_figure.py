"""The finger's section deformed by a point load, and the SED that spreads under it (after Raju 1998, Fig. 6-4)."""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from rig.report.style import BLUE, GREY, ORANGE, Plot
from sim.coding.all_sites import Deformed
from sim.coding.point_spread import Judged

Array = NDArray[np.float64]

_LARGEST_MM = 0.5  # drawn displacement under the load


class Drawn(NamedTuple):
    """A site's own plane, and what spreads under it."""

    deformed: Deformed
    judged: Judged


def point_spread_figure(drawn: Drawn) -> Plot:
    """Deformed mesh, SED over the skin, SED against the distance."""
    return Plot((10.2, 3.6), lambda figure: _draw(figure, drawn))


def _draw(figure: Figure, drawn: Drawn) -> None:
    mesh, spread, fall = figure.subplots(1, 3)
    _mesh(mesh, drawn.deformed, drawn.judged.spread.load_mm)
    _spread(figure, spread, drawn.judged)
    _fall(fall, drawn.judged)


def _mesh(axes: Axes, section: Deformed, load_mm: Array) -> None:
    times = _LARGEST_MM / np.linalg.norm(section.moved_mm, axis=-1).max()
    closed = [
        np.concatenate([nodes, nodes[:1]]) for nodes in (section.at_mm, section.at_mm + times * section.moved_mm)
    ]
    axes.plot(*closed[0][:, 0].T, color=GREY, lw=0.8, ls="--")
    axes.add_collection(LineCollection([*closed[1].swapaxes(0, 1), *closed[1]], colors=BLUE, linewidths=0.3))
    x, y = load_mm[:2].tolist()
    axes.annotate("", (x, y), (x, y + 0.8), arrowprops={"arrowstyle": "->", "color": ORANGE})
    axes.set_ylim(top=y + 1.0)
    axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal", title=f"displacements × {times:.3g}")


def _spread(figure: Figure, axes: Axes, judged: Judged) -> None:
    x, _, z = judged.spread.sheet.skin_mm.T
    shown = axes.tricontourf(x, z, judged.spread.sed, levels=12, cmap="viridis")
    axes.plot(*judged.spread.load_mm[[0, 2]], "+", color="white")
    figure.colorbar(shown, ax=axes, label="SED (pseudo-units)")
    axes.set(xlabel="x (mm)", ylabel="z (mm)", aspect="equal", title=f"site {judged.spread.site.number}")


def _fall(axes: Axes, judged: Judged) -> None:
    distance = judged.spread.distance_mm
    axes.loglog(distance, judged.spread.sed, ".", ms=2, color=GREY, label="receptors")
    r = np.linspace(distance.min(), distance.max(), 60)
    for law, name, colour in ((judged.linear, "linear", BLUE), (judged.logarithmic, "logarithmic", ORANGE)):
        axes.loglog(r, law.at(r), color=colour, label=rf"{name}: $r^{{-{law.m:.2f}}}$")
    axes.set(xlabel="distance from the load (mm)", ylabel="SED (pseudo-units)")
    axes.legend()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
