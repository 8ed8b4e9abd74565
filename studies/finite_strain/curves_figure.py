"""How far linear force and SED are off, over depth: the figure of `docs/validation/small_strain.md`."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rig.data.folder import replace_text
from rig.report.style import BLUE, GREEN, GREY, ORANGE, PURPLE, Plot
from studies.finite_strain.ratios import Ratio

COLOURS = {"cylinder:9": BLUE, "sphere:3": GREEN, "flat": GREY, "step:1": PURPLE, "bar:3.0": ORANGE}
PANELS = (("finger 0.35", "finger 0.25", "whole finger"), ("section 0.17", "section 0.085", "plane-strain section"))


def write_figure(found: Sequence[Ratio], path: Path) -> None:
    """Two rows, force and SED; two columns, finger and section. Dotted: the finer mesh."""
    replace_text(path, Plot((7.2, 5.6), lambda canvas: _draw(canvas, found)).svg)


def _draw(canvas: Figure, found: Sequence[Ratio]) -> None:
    panels = canvas.subplots(2, 2, sharex=True, sharey="row")
    for column, (mesh, finer, title) in enumerate(PANELS):
        for row, (name, label) in enumerate((("force", "force"), ("sed", "highest SED"))):
            axes = panels[row, column]
            axes.axhline(0, color="black", lw=0.6)
            for shape, colour in COLOURS.items():
                _line(axes, _of(found, mesh, shape), name, colour=colour, style="-o")
                _line(axes, _of(found, finer, shape), name, colour=colour, style=":")
            axes.set_ylabel(f"linear {label} over finite strain (%)" if column == 0 else "")
        panels[0, column].set_title(title, fontsize=9)
        panels[1, column].set_xlabel("DOI (mm)")
    keys = [Line2D([], [], color=colour, marker="o", ms=2.5, label=shape) for shape, colour in COLOURS.items()]
    canvas.legend(handles=keys, loc="outside lower center", ncols=len(keys), fontsize=8)


def _of(found: Sequence[Ratio], mesh: str, shape: str) -> list[Ratio]:
    return [one for one in found if (one.mesh, one.shape, one.poisson) == (mesh, shape, 0.48)]


def _line(axes: Axes, found: Sequence[Ratio], name: str, *, colour: str, style: str) -> None:
    off = [100 * (getattr(one, name) - 1) for one in found]
    if off:
        axes.plot([0.0, *(one.doi_mm for one in found)], [0.0, *off], style, color=colour, ms=2.5, lw=1.1)
