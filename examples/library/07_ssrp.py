"""The spatial response profile of one receptor: each of the 18 measures against the indentor's position."""

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from sim import MEASURES, Fingertip, indent_many
from sim.measures.measures import shown

Array = NDArray[np.float64]


def profiles(finger: Fingertip, x_mm: Array, receptor: int, cores: int | None) -> dict[str, Array]:
    """Each measure at one receptor, in the sign in which profiles are shown; nan where there is no answer."""
    found = indent_many(finger, "step:1", x_mm, force_gwt=2.33, cores=cores)
    table = found.receptor_table()
    mine = np.flatnonzero(table["receptor_x_mm"] == np.unique(table["receptor_x_mm"])[receptor])
    every = {measure: np.full(len(x_mm), np.nan) for measure in MEASURES}
    for measure, values in every.items():
        values[table["indentation"][mine]] = shown(measure, table[measure][mine])
    return every


def main(finger: Fingertip, positions: int = 34, receptor: int = 3, cores: int | None = None) -> dict[str, Array]:
    x_mm = np.linspace(2.0, -3.7, positions)
    found = profiles(finger, x_mm, receptor, cores)
    figure, axes = plt.subplots(3, 6, figsize=(14, 6), sharex=True, layout="constrained")
    for panel, (measure, values) in zip(axes.flat, found.items(), strict=True):
        panel.plot(x_mm, values)
        panel.set_title(measure)
    figure.savefig("ssrp.svg")
    plt.close(figure)
    return found


if __name__ == "__main__":
    main(Fingertip.load())
