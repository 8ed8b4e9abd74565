"""Figures of a run as SVG: labelled, with units, in colours that survive colour blindness and print."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rig.data import Run
from rig.plan.responses import Response, by_group, measured
from rig.report.labels import label, unit
from rig.report.style import BLUE, GREY, ORANGE, Plot, position_bar, shade, shade_of, signed
from sim.contact.patch import X, Z
from sim.measures.measures import shown

CONTACTS_A_PAGE = 9
_COLUMNS = 3


def force_doi(run: Run) -> Plot:
    """Force against depth while pressing, one line for each indentation."""
    return Plot((6.6, 3.6), lambda figure: _force_doi(figure, run))


def contact_panels(found: Sequence[Response], top: float) -> Plot:
    """Indentor over deformed skin, contact regions, and the pressure below, on an axis that holds `top`."""
    rows = -(-len(found) // _COLUMNS)
    return Plot((10.2, 0.3 + 2.0 * rows), lambda figure: _contact_panels(figure, found, rows, top))


def highest_pressure(found: Sequence[Response]) -> float:
    """Of all in the receptor plane, in pseudo-units."""
    return max((float(r.result.pressure_profile[1].max()) for r in found), default=0.0) or 1.0


def population_responses(found: list[Response]) -> Plot:
    """ep1 and SED at all receptors, one line for each indentor position."""
    return Plot((9.6, 3.6), lambda figure: _population(figure, found))


def ssrps(found: list[Response], measure: str) -> Plot:
    """The measure at each receptor against the indentor's position."""
    return Plot((10.2, 4.6), lambda figure: _ssrps(figure, found, measure))


def _force_doi(figure: Figure, run: Run) -> None:
    axes = figure.subplots()
    samples = [s for s in run.stream("sample") if s["doi_mm"] is not None]
    starts = {e["index"]: e["x_mm"] for e in run.stream("indentation_start")}
    xs = list(starts.values())
    for index, x in starts.items():
        mine = [s for s in samples if s["index"] == index]
        doi, force = [s["doi_mm"] for s in mine], [s["force_gwt"] for s in mine]
        axes.plot(doi, force, "-o", ms=2, lw=1, color=shade_of(x, xs))
    axes.set(xlabel="depth of indentation from fitted contact (mm)", ylabel="force (gwt)")
    position_bar(figure, axes, xs)


def _contact_panels(figure: Figure, found: Sequence[Response], rows: int, top: float) -> None:
    panels = figure.subplots(rows, _COLUMNS, squeeze=False, sharex=True, sharey=True)
    for axes in panels.ravel()[len(found) :]:
        axes.set_visible(False)
    for k, (axes, response) in enumerate(zip(panels.ravel(), found, strict=False)):
        pressures = _contact_panel(axes, response, top)
        if k % _COLUMNS == _COLUMNS - 1 or k == len(found) - 1:
            pressures.set_ylabel("pressure (pseudo-units)", color=BLUE, fontsize=7)
    for axes in panels[:, 0]:
        axes.set_ylabel("height y (mm)")
    for axes in panels.ravel()[max(len(found) - _COLUMNS, 0) : len(found)]:  # the lowest of each column
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("lateral x (mm)")


def _contact_panel(axes: Axes, response: Response, top: float) -> Axes:
    """Skin and indentor against the left axis; pressure, scaled to the run's highest, against the right one."""
    result = response.result
    x, y = result.skin_profile
    undeformed, pressure = result.pressure_profile
    axes.plot(x, y, color=GREY, lw=1)
    s = np.linspace(-3.6, 3.6, 1441)
    plane_mm = result.model.plane_mm
    offset = {X: s - result.x_mm, Z: np.full_like(s, plane_mm - result.z_mm)}
    h = result.indentor.evaluate(np.stack([offset[axis] for axis in result.indentor.axes])).height_mm
    height = result.touch_height_mm - result.doi_mm + np.minimum(h, 1.3)
    axes.plot(s, np.where(h < 1.3, height, np.nan), color="black", lw=1.2)
    for low, high in result.contact_regions_mm:  # their ends lie between nodes
        at = np.r_[low, undeformed[(undeformed > low) & (undeformed < high)], high]
        touching = (np.interp(at, undeformed, x), np.interp(at, undeformed, y))
        axes.plot(*touching, color=ORANGE, lw=4, solid_capstyle="round", alpha=0.8)
    axes.set_ylim(1.9, 5.7)
    pressures = axes.twinx()
    pressures.fill_between(undeformed, pressure, color=BLUE, alpha=0.35, lw=0)
    pressures.set_ylim(0, 2.4 * top)
    pressures.set_yticks([0, round(top, -2) or top])
    pressures.tick_params(axis="y", colors=BLUE, labelsize=7)
    pressures.spines["right"].set_visible(True)
    pressures.spines["right"].set_color(BLUE)
    title = f"{response.indentor}  x = {signed(result.x_mm)}  {result.force_gwt:.2f} gwt  DOI {result.doi_mm:.3f} mm"
    axes.set_title(title, fontsize=8)
    return pressures


def _population(figure: Figure, found: list[Response]) -> None:
    """Coloured by position where one thing was moved, by what was commanded where one place was pressed."""
    receptor_x = found[0].result.model.receptors.position_mm[:, 0]
    panels = figure.subplots(1, 2)
    groups = by_group(found)
    xs = [response.hold["x_mm"] for response in found]
    moved = len(set(xs)) > 1
    name, chosen = list(groups.items())[-1]
    lines = [(r.hold["x_mm"], r) for r in chosen] if moved else [(k, m[0]) for k, m in enumerate(groups.values())]
    shades = [value for value, _ in lines]
    for axes, measure in zip(panels, ("ep1", "sed"), strict=True):
        for value, response in lines:
            row = shown(measure, measured([response], measure)[1][0])
            axes.plot(receptor_x, row, "-o", ms=2.5, lw=1, color=shade_of(value, shades), label=response.group)
        axes.set(xlabel="receptor x (mm)", ylabel=f"{label(measure)} ({unit(measure)})", title=name if moved else "")
    if moved:
        position_bar(figure, panels, shades)
    else:
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8)


def _ssrps(figure: Figure, found: list[Response], measure: str) -> None:
    """One line for each thing that was moved: the same indentor pressed to the same depth or force."""
    receptor_x = found[0].result.model.receptors.position_mm[:, 0]
    groups = {name: members for name, members in by_group(found).items() if len(members) > 1}
    panels = figure.subplots(2, -(-len(receptor_x) // 2), sharex=True, sharey=True, squeeze=False)
    for k, (name, members) in enumerate(groups.items()):
        positions, values = measured(members, measure)
        for axes, column in zip(panels.ravel(), shown(measure, values).T, strict=False):
            axes.plot(positions, column, "-o", ms=2, lw=1, color=shade(k, len(groups)), label=name)
    for axes, x in zip(panels.ravel(), receptor_x, strict=False):
        axes.axvline(x, color=GREY, lw=0.6, ls=":")
        axes.set_title(f"receptor at {signed(x)} mm", fontsize=8)
    for axes in panels[-1]:
        axes.set_xlabel("indentor x (mm)")
    for axes in panels[:, 0]:
        axes.set_ylabel(f"{label(measure)} ({unit(measure)})")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8)
