"""Impulse responses, their spectra and the shift-invariance error map, in the skin's own axes and Cartesian."""

from collections.abc import Mapping
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rig.report.style import BLUE, GREEN, GREY, ORANGE, Plot
from sim.coding.operators import NAMES, ImpulseResponses, ShiftErrors

_COLOURS = (BLUE, ORANGE, GREEN)
_MEANS = ("e11", "e22", "e12")


class Drawn(NamedTuple):
    """What is drawn of one kind of axes."""

    responses: ImpulseResponses
    errors: ShiftErrors


def impulse_figure(drawn: Mapping[str, Drawn]) -> Plot:
    """One column for each kind of axes, by its name."""
    return Plot((4.6 * len(drawn), 8.4), lambda figure: _draw(figure, drawn))


def _draw(figure: Figure, drawn: Mapping[str, Drawn]) -> None:
    panels = figure.subplots(3, len(drawn), squeeze=False, sharey="row")
    for (response, spectrum, error), (name, (responses, errors)) in zip(panels.T, drawn.items(), strict=True):
        response.set_title(f"{name} axes")
        _responses(response, responses)
        _spectra(spectrum, responses)
        _errors(error, errors)
    panels[0, 0].set_ylabel("strain per pseudo-unit on one sample")
    panels[1, 0].set_ylabel("amplitude over its largest")
    panels[2, 0].set_ylabel("relative L2 of shifting (%)")
    for row in panels[:, 0]:
        row.legend()


def _responses(axes: Axes, responses: ImpulseResponses) -> None:
    for name, means, colour, values in zip(NAMES, _MEANS, _COLOURS, responses.strain, strict=True):
        axes.plot(responses.sampling.place_mm, values, color=colour, label=f"{name} ({means})")
    axes.plot(responses.sampling.place_mm, -responses.strain[1], color=GREY, lw=0.8, ls="--", label="−g")
    axes.set_xlabel("place on the skin (mm)")


def _spectra(axes: Axes, responses: ImpulseResponses) -> None:
    frequency, amplitude = responses.spectra()
    for name, colour, values in zip(NAMES, _COLOURS, amplitude, strict=True):
        axes.plot(frequency, values / values.max(), color=colour, label=name)
    axes.set_xlabel("spatial frequency (cycles/mm)")


def _errors(axes: Axes, errors: ShiftErrors) -> None:
    for means, colour, values in zip(_MEANS, _COLOURS, errors.strain, strict=True):
        axes.plot(errors.place_mm, 100 * values, color=colour, label=means)
    axes.plot(errors.place_mm, 100 * errors.sed, color="black", label="SED")
    axes.set_xlabel("place of the load (mm)")
