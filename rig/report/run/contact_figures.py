"""Contact under each condition: indentor and skin, and the pressure below."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rig.plan.responses import Response
from rig.report.style import BLUE, GREY, ORANGE, Plot, signed
from sim.contact.patch import X, Z

CONTACTS_A_PAGE = 12
HEIGHTS_MM = (1.9, 5.7)
_COLUMNS = 4
_LEFT_IN, _WIDE_IN, _GAP_IN = 0.6, 2.25, 0.12
_TITLE_IN, _SKIN_IN, _PRESSURE_IN, _AXIS_IN = 0.36, 0.9, 0.7, 0.5
_ROW_IN = _TITLE_IN + _SKIN_IN + _PRESSURE_IN
_LATERAL_MM = (-3.6, 3.6)
_DRAWN = 361
_HIGHEST_MM = 1.3
"""Above its lowest point no more of an indentor is drawn."""


def contact_panels(found: Sequence[Sequence[Response]], top: float) -> Plot:
    """A panel for each condition, its repeats over one another; all pressures on an axis that holds `top`."""
    rows = -(-len(found) // _COLUMNS)
    columns = min(len(found), _COLUMNS)
    size = (_LEFT_IN + columns * (_WIDE_IN + _GAP_IN), rows * _ROW_IN + _AXIS_IN)
    return Plot(size, lambda figure: _contact_panels(figure, found, top), layout=None)


def highest_pressure(found: Sequence[Response]) -> float:
    """Of all in the receptor plane, in pseudo-units."""
    return max((float(r.result.pressure_profile[1].max()) for r in found), default=0.0) or 1.0


def _contact_panels(figure: Figure, found: Sequence[Sequence[Response]], top: float) -> None:
    scale = [tick for tick in MaxNLocator(3).tick_values(0, top) if tick <= 1.02 * top]
    for k, repeats in enumerate(found):
        above = _axes(figure, k, _TITLE_IN + _SKIN_IN, _SKIN_IN)
        below = _axes(figure, k, _ROW_IN, _PRESSURE_IN)
        _skin(above, repeats)
        _pressures(below, repeats)
        below.hlines(scale, *_LATERAL_MM, color=GREY, lw=0.3, alpha=0.5)
        above.set(xlim=_LATERAL_MM, ylim=HEIGHTS_MM, xticks=())
        below.set(xlim=_LATERAL_MM, ylim=(0, 1.08 * top))
        _scales(above, below, scale, first=k % _COLUMNS == 0, lowest=k + _COLUMNS >= len(found))


def _scales(above: Axes, below: Axes, scale: Sequence[float], *, first: bool, lowest: bool) -> None:
    """Ticks are slow to draw, and read at the outer panels alone."""
    above.set_yticks((3, 5) if first else ())
    below.set_yticks(scale if first else ())
    below.set_xticks((-2, 0, 2) if lowest else ())
    for axes, name in ((above, "height (mm)"), (below, "pressure")):
        axes.set_ylabel(name if first else "", fontsize=8)
        axes.tick_params(labelsize=7, length=2)
    below.set_xlabel("lateral x (mm)" if lowest else "", fontsize=8)


def _axes(figure: Figure, k: int, below_in: float, high_in: float) -> Axes:
    """In the place of the k-th panel, its lower end so far below the row's upper one."""
    width, height = figure.get_size_inches()
    row, column = divmod(k, _COLUMNS)
    left, bottom = _LEFT_IN + column * (_WIDE_IN + _GAP_IN), height - row * _ROW_IN - below_in
    return figure.add_axes((left / width, bottom / height, _WIDE_IN / width, high_in / height))


def _skin(axes: Axes, repeats: Sequence[Response]) -> None:
    """The first repeat's indentor and skin: repeats differ by less than a line is wide."""
    result = repeats[0].result
    (x, y), (undeformed, _) = result.skin_profile, result.pressure_profile
    axes.plot(x, y, color=GREY, lw=1)
    s = np.linspace(*_LATERAL_MM, _DRAWN)
    offset = {X: s - result.x_mm, Z: np.full_like(s, result.model.plane_mm - result.z_mm)}
    h = result.indentor.evaluate(np.stack([offset[axis] for axis in result.indentor.axes])).height_mm
    height = result.touch_height_mm - result.doi_mm + np.minimum(h, _HIGHEST_MM)
    axes.plot(s, np.where(h < _HIGHEST_MM, height, np.nan), color="black", lw=1.2)
    for low, high in result.contact_regions_mm:  # their ends lie between nodes
        at = np.r_[low, undeformed[(undeformed > low) & (undeformed < high)], high]
        touching = (np.interp(at, undeformed, x), np.interp(at, undeformed, y))
        axes.plot(*touching, color=ORANGE, lw=4, solid_capstyle="round", alpha=0.8)
    axes.set_title(_title(repeats), fontsize=7.5, y=1.02, pad=0)


def _pressures(axes: Axes, repeats: Sequence[Response]) -> None:
    for response in repeats:
        undeformed, pressure = response.result.pressure_profile
        axes.plot(undeformed, pressure, color=BLUE, lw=0.8)
    axes.fill_between(undeformed, pressure, color=BLUE, alpha=0.25, lw=0)


def _title(repeats: Sequence[Response]) -> str:
    force, doi = ([r.hold[key] for r in repeats] for key in ("force_gwt", "doi_mm"))
    times = f"{len(repeats)} times, " if len(repeats) > 1 else ""
    return f"x = {signed(repeats[0].hold['x_mm'])} mm\n{times}{np.mean(force):.2f} gwt, DOI {np.mean(doi):.3f} mm"
