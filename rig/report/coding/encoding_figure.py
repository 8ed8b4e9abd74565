"""From pressure on the skin to what receptors say, one panel a stage."""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.report.style import BLUE, GREEN, GREY, ORANGE, Plot
from sim.coding.encoding import Encoded
from sim.coding.operators import Operator

Array = NDArray[np.float64]


class Drawn(NamedTuple):
    """What is encoded, and what finite elements say of the same press where there was one."""

    operator: Operator
    pressure: Array
    encoded: Encoded
    true: tuple[Array, Array] | None  # places in mm and SED


def encoding_figure(drawn: Drawn) -> Plot:
    """Pressure, SED and rate against the place on the skin."""
    return Plot((6.0, 7.2), lambda figure: _draw(figure, drawn))


def _draw(figure: Figure, drawn: Drawn) -> None:
    operator, encoded = drawn.operator, drawn.encoded
    skin, energy, said = figure.subplots(3, sharex=True)
    ends = np.flatnonzero(np.diff(operator.place_mm) < 0) + 1  # lateral pressures come after the normal ones
    kinds = zip(np.split(operator.place_mm, ends), np.split(drawn.pressure, ends), strict=True)
    for (place, pressure), name, colour in zip(kinds, ("normal", "lateral"), (BLUE, ORANGE), strict=False):
        skin.plot(place, pressure, ".-", color=colour, label=name)
    skin.axhline(0, color=GREY, lw=0.6)
    energy.plot(operator.receptor_mm, encoded.sed, color=BLUE, label=operator.name)
    if drawn.true is not None:
        energy.plot(*drawn.true, color=GREY, ls="--", label="finite elements")
    said.plot(operator.receptor_mm, encoded.rate, ".-", color=GREEN)
    for axes, label in zip((skin, energy, said), ("pressure", f"SED, {operator.energy}", "rate"), strict=True):
        axes.set_ylabel(f"{label} (pseudo-units)" if axes is not said else label)
    said.set_xlabel("place on the skin (mm)")
    skin.legend()
    energy.legend()
