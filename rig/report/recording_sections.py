"""Which figures of the source's chapter 5 hang on recordings, which file would fill each, and those that are filled.

The published recordings are figures, not tables, and are not shipped. Source: Raju 1998, ch. 5.
"""

from typing import NamedTuple

import numpy as np

from rig.compare.comparison import Comparison, Joint, Overlay
from rig.compare.tables import Pair
from rig.report.comparison import fit_figures
from rig.report.html import Figure, Section
from rig.report.labels import as_number, label
from rig.report.style import signed
from sim.measures.measures import MEASURES

SURVIVORS = ("ep1", "ep3", "sed")
"""What the source is left with, and draws."""


class Published(NamedTuple):
    """Recordings that the source compares with, where it judges them, and the figures that show it."""

    scatter: str
    profiles: str
    who: str
    shapes: tuple[str, ...]  # canonical names
    condition: str
    receptor_mm: float


PUBLISHED = (
    Published("5-8", "5-9", "Srinivasan & LaMotte 1987", ("step:1", "step:3", "step:5"), "8 gwt", -1.0),
    Published("5-12", "5-13", "Phillips & Johnson 1981", ("bar:1.5", "bar:3"), "1 mm", 0.0),
)


def source_sections(comparison: Comparison) -> list[Section]:
    """Which file fills which figure, and the table, where something fills it."""
    table = table_5_1(comparison)
    return [source_section(comparison), *([table] if table.rows else [])]


def source_section(comparison: Comparison) -> Section:
    """A row for each figure and table, and the figures of those whose recordings are loaded."""
    return Section(
        "Figures of the source that recordings fill",
        "Raju (1998, ch. 5) draws these over recordings that were published as figures, not as tables; none is "
        "shipped. Steps are published as mirror images of the frame used here (--mirror). Whatever is loaded for a "
        "shape is taken for it: whose recording it is, its file must say.",
        ("of the source", "what it shows", "needs", "here"),
        (*(row for one in PUBLISHED for row in _rows(comparison, one)), _row_of_table(comparison)),
        tuple(figure for one in PUBLISHED for figure in _figures(comparison, one)),
    )


def table_5_1(comparison: Comparison) -> Section:
    """Pearson's r of what survives in the source with each recording, and its joint line; no rows without one."""
    return Section(
        "Table 5.1 of the source",
        "Pearson's r between the recorded rates and the measure at the recorded positions, shape by shape, and k and "
        "ε₀ of one line R = max(0, k(ε − ε₀)) over them, by least squares; steps at −1.0 mm and bars at 0, as in the "
        "source. r and R² are not what the verdict goes by.",
        ("recordings", "measure", "receptor (mm)", "r, shape by shape", "k", "ε₀", "R²"),
        tuple(row for one in PUBLISHED for row in _correlations(comparison, one)),
    )


def _rows(comparison: Comparison, one: Published) -> list[tuple[str, ...]]:
    needs = f"{', '.join(one.shapes)} at {one.condition} ({one.who})"
    what = f"one line over {', '.join(one.shapes)}, receptor at {signed(one.receptor_mm)} mm"
    here = _here(comparison, one)
    return [
        (f"Fig. {one.scatter}", f"rate against measure, {what}", needs, here),
        (f"Fig. {one.profiles}", f"predicted over recorded profiles, {what}", needs, here),
    ]


def _row_of_table(comparison: Comparison) -> tuple[str, ...]:
    filled = [one for one in PUBLISHED if _recorded(comparison, one)]
    here = "filled" if len(filled) == len(PUBLISHED) else "filled in part" if filled else "empty"
    return ("Table 5.1", "correlation of rates and measures, shape by shape", "either of them", here)


def _here(comparison: Comparison, one: Published) -> str:
    """The files that fill it, or what is missing."""
    found = {overlay.stimulus.shape: overlay.recording.name for overlay in _recorded(comparison, one)}
    missing = [shape for shape in one.shapes if shape not in found]
    if not missing:
        return f"filled: {', '.join(found.values())}"
    pressed = {s.shape for s in comparison.stimuli if s.condition == one.condition}
    runs = [f"a run of {shape} at {one.condition}" for shape in missing if shape not in pressed]
    return "empty: give " + ", ".join([*(f"--recorded {shape}=FILE" for shape in missing), *runs])


def _recorded(comparison: Comparison, one: Published) -> list[Overlay]:
    """The overlays that belong to it, in its order."""
    mine = {p.stimulus.shape: p for p in comparison.overlays if p.stimulus.condition == one.condition}
    return [mine[shape] for shape in one.shapes if shape in mine]


def _joint(comparison: Comparison, one: Published) -> tuple[Joint, list[Pair]] | None:
    """All of its recordings with one line, and the survivors at its receptor; None if one is missing."""
    found = _recorded(comparison, one)
    if len(found) < len(one.shapes):
        return None
    receptor = int(np.argmin(np.abs(found[0].stimulus.receptor_mm - one.receptor_mm)))
    joint = Joint(tuple(found))
    pairs = [(MEASURES.index(name), receptor) for name in SURVIVORS]
    return joint, [pair for pair in pairs if np.isfinite(joint.fit.k[pair])]


def _figures(comparison: Comparison, one: Published) -> list[Figure]:
    found = _joint(comparison, one)
    if found is None or not found[1]:
        return []
    joint, pairs = found
    files = ", ".join(overlay.recording.name for overlay in joint.overlays)
    return [
        Figure(
            f"Fig. {one.scatter} of the source: rate against measure",
            fit_figures.scatter(joint, pairs),
            f"Each point is a recorded position, black the line over all shapes. {files}.",
        ),
        Figure(
            f"Fig. {one.profiles} of the source: predicted over recorded",
            fit_figures.overlays(joint, pairs),
            f"Rates that this line predicts. {files}.",
        ),
    ]


def _correlations(comparison: Comparison, one: Published) -> list[tuple[str, ...]]:
    found = _joint(comparison, one)
    return [] if found is None else [_correlation(found[0], pair) for pair in found[1]]


def _correlation(joint: Joint, pair: Pair) -> tuple[str, ...]:
    measure, receptor = pair
    r = [as_number(float(overlay.r[pair]), 2) for overlay in joint.overlays]
    fitted = (float(v[pair]) for v in (joint.fit.k, joint.fit.eps0, joint.explained))
    place = signed(float(joint.overlays[0].stimulus.receptor_mm[receptor]))
    return (joint.title, label(MEASURES[measure]), place, "  ".join(r), *map(as_number, fitted))
