"""Pressures read back from receptors, with their band, and the readings beside what these pressures explain."""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.report.style import BLUE, GREY, ORANGE, Plot

Array = NDArray[np.float64]


class Drawn(NamedTuple):
    """What was found; pseudo-units."""

    place_mm: Array  # (n,)
    pressure: Array  # (n,)
    band: tuple[Array, Array] | None  # (n,) lower and upper
    true: Array | None  # (n,)
    receptor_mm: Array  # (m,) in any order
    reading: Array  # (m,) as SED
    explained: Array  # (m,) SED under the pressures that were found


def decoded_figure(drawn: Drawn) -> Plot:
    """Pressures over readings, against the place on the skin."""
    return Plot((6.0, 5.4), lambda figure: _draw(figure, drawn))


def _draw(figure: Figure, drawn: Drawn) -> None:
    skin, energy = figure.subplots(2, sharex=True)
    if drawn.band is not None:
        skin.fill_between(drawn.place_mm, *drawn.band, color=BLUE, alpha=0.25, lw=0, label="90 % band")
    skin.plot(drawn.place_mm, drawn.pressure, ".-", color=BLUE, label="found")
    if drawn.true is not None:
        skin.plot(drawn.place_mm, drawn.true, color="black", ls="--", marker="x", ms=4, label="true")
    order = np.argsort(drawn.receptor_mm, kind="stable")
    energy.plot(drawn.receptor_mm[order], drawn.reading[order], ".", color=ORANGE, label="readings")
    energy.plot(drawn.receptor_mm[order], drawn.explained[order], color=GREY, lw=1, label="explained")
    skin.set_ylabel("pressure (pseudo-units)")
    energy.set(ylabel="SED (pseudo-units)", xlabel="place on the skin (mm)")
    skin.legend()
    energy.legend()
