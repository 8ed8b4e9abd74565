"""Pressures over x and z of the skin, read back from a sheet of receptors, and how sure they are."""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.report.style import Plot

Array = NDArray[np.float64]


class Drawn(NamedTuple):
    """What was found; pseudo-units."""

    x_mm: Array  # (n_x,)
    z_mm: Array  # (n_z,)
    pressure: Array  # (n_x, n_z)
    sd: Array  # (n_x, n_z)
    receptor_mm: Array  # (m, 2) x and z


def sheet_figure(drawn: Drawn) -> Plot:
    """Pressures, and their standard deviation in the same colours, with the receptors."""
    return Plot((9.6, 4.2), lambda figure: _draw(figure, drawn))


def _draw(figure: Figure, drawn: Drawn) -> None:
    highest = max(float(drawn.pressure.max()), float(drawn.sd.max()))
    for axes, values, title in zip(
        figure.subplots(1, 2, sharey=True), (drawn.pressure, drawn.sd), ("pressure", "its sd"), strict=True
    ):
        shown = axes.pcolormesh(drawn.z_mm, drawn.x_mm, values, vmin=0.0, vmax=highest, cmap="viridis")
        axes.plot(drawn.receptor_mm[:, 1], drawn.receptor_mm[:, 0], ".", color="white", ms=2)
        axes.set(title=title, xlabel="z (mm)", ylabel="x (mm)", aspect="equal")
        figure.colorbar(shown, ax=axes, label="pseudo-units")
