"""Decoding under noise: where two pressures are found from many draws, and the error against the noise."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.report.style import BLUE, GREEN, GREY, ORANGE, PURPLE, Plot

Array = NDArray[np.float64]

_COLOURS = (ORANGE, BLUE, GREEN, PURPLE)
_ACROSS_IN, _HIGH_IN = 3.0, 2.8
_LOWEST = 1e-8


def cloud_figure(found: Mapping[str, Mapping[str, Array]], true: Array) -> Plot:
    """A row for each decoder, a panel for each SNR, by name: (draws, 2) pressures found, about the true ones."""
    across = max(len(panels) for panels in found.values())
    return Plot((_ACROSS_IN * across, _HIGH_IN * len(found)), lambda figure: _draw_clouds(figure, found, true))


def _draw_clouds(figure: Figure, found: Mapping[str, Mapping[str, Array]], true: Array) -> None:
    across = max(len(panels) for panels in found.values())
    rows = figure.subplots(len(found), across, squeeze=False, sharex=True, sharey=True)
    for row, (decoder, panels), colour in zip(rows, found.items(), _COLOURS, strict=False):
        for axes, (snr, pressures) in zip(row, panels.items(), strict=False):
            axes.plot(*true, "*", color="white", mec="black", ms=11)
            axes.plot(*pressures.T, "o", color=colour, ms=3, alpha=0.6)
            axes.set_title(f"{decoder}, {snr}")
        row[0].set_ylabel("second pressure")
    for axes in rows[-1]:
        axes.set_xlabel("first pressure (pseudo-units)")


def noise_figure(snr_db: Array, errors: Mapping[str, Array], samples: int, limit: Array | None = None) -> Plot:
    """(k, draws) errors of Eq. 6.8 by decoder, against (k,) SNRs over so many samples: mean ± its error.

    With the (k,) least mean errors that any reader could have.
    """

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        if limit is not None:
            axes.plot(snr_db, limit, "--", color=GREY, lw=1.2, label="limit, told the distribution")
        _draw_errors(axes, snr_db, errors, samples)

    return Plot((5.8, 4.0), draw)


def _draw_errors(axes: Axes, snr_db: Array, errors: Mapping[str, Array], samples: int) -> None:
    for (decoder, values), colour in zip(errors.items(), _COLOURS, strict=False):
        mean, se = values.mean(axis=1), values.std(axis=1, ddof=1) / np.sqrt(values.shape[1])
        axes.plot(snr_db, mean, "o-", color=colour, label=decoder)
        axes.fill_between(snr_db, np.maximum(mean - se, _LOWEST), mean + se, color=colour, alpha=0.2, lw=0)
    axes.axhline(0.1, color=GREY, lw=0.8, ls=":", label="10 %, squared")
    axes.set(yscale="log", xlabel=f"SNR (dB, over M = {samples} samples)", ylabel="mean Σ(x − x̂)² / Σx² (Eq. 6.8)")
    axes.legend()
