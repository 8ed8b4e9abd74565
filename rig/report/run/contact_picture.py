"""Contact as one looks at the indentor's face from the finger: pressure over x and z, and the relief above."""

from collections.abc import Sequence
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from rig.report.style import BLUE, GREY, ORANGE, Plot
from sim.contact.indentor import BOTH, Indentor, Revolved
from sim.contact.patch import X, Z
from sim.models.result import IndentationResult

PICTURES_A_PAGE = 6
_COLUMNS = 3
_CONTOURS_MM = (0.02, 0.1, 0.2, 0.3, 0.4)  # above the lowest point: where skin may still come
_RELIEF_STEPS = 181
_TITLE_WIDTH = 46


def is_relief(indentor: Indentor) -> bool:
    """Whether it is neither round nor carried along or across the finger: one section does not show it."""
    return indentor.axes == BOTH and not isinstance(indentor, Revolved)


def contacts_from_below(found: Sequence[IndentationResult], titles: Sequence[str]) -> Plot:
    """One picture for each contact, the finger's tip up."""
    rows, columns = -(-len(found) // _COLUMNS), min(len(found), _COLUMNS)
    return Plot((0.4 + 3.2 * columns, 0.4 + 3.0 * rows), lambda figure: _draw(figure, found, titles))


def _draw(figure: Figure, found: Sequence[IndentationResult], titles: Sequence[str]) -> None:
    columns = min(len(found), _COLUMNS)
    panels = figure.subplots(-(-len(found) // columns), columns, squeeze=False)
    top = max(float(result.peak_pressure_pseudo) for result in found) or 1.0
    for axes in panels.ravel()[len(found) :]:
        axes.set_visible(False)
    for axes, result, title in zip(panels.ravel(), found, titles, strict=False):
        drawn = _panel(axes, result, top)
        axes.set_title("\n".join(wrap(title, _TITLE_WIDTH)), fontsize=8)
    for axes in panels[:, 0]:
        axes.set_ylabel("along the finger, z (mm)")
    for axes in panels.ravel()[: len(found)]:
        axes.set_xlabel("lateral x (mm)")
    figure.colorbar(drawn, ax=panels, label="pressure (pseudo-units)", shrink=0.8)


def _panel(axes: Axes, result: IndentationResult, top: float) -> QuadMesh:
    patch = result.model.patch
    x, z = (patch.position_mm[:, axis].reshape(patch.shape) for axis in (X, Z))
    pressure = result.nodal_pressure_pseudo.reshape(patch.shape)
    drawn = axes.pcolormesh(x, z, pressure, shading="gouraud", cmap="Blues", vmin=0, vmax=top)
    _relief(axes, result)
    at = result.state.held.on(patch).interpolate(patch.position_mm.T)
    axes.plot(at[X], at[Z], ".", ms=2, color=ORANGE)
    plane_mm = result.model.plane_mm
    axes.axhline(plane_mm, color=BLUE, lw=0.5, ls=":")
    axes.set(xlim=(x.min(), x.max()), ylim=(z.min(), z.max()), aspect="equal")
    return drawn


def _relief(axes: Axes, result: IndentationResult) -> None:
    """Lines of equal height of the indentor."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    x, z = np.meshgrid(np.linspace(left, right, _RELIEF_STEPS), np.linspace(low, high, _RELIEF_STEPS))
    offset = {X: x.ravel() - result.x_mm, Z: z.ravel() - result.z_mm}
    height = result.indentor.evaluate(np.stack([offset[axis] for axis in result.indentor.axes])).height_mm
    if height.max() > _CONTOURS_MM[0]:
        axes.contour(x, z, height.reshape(x.shape), levels=_CONTOURS_MM, colors=GREY, linewidths=0.6)
