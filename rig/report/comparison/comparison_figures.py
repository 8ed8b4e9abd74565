"""Which figures a comparison's report has, and what is written under them."""

from collections.abc import Sequence
from functools import partial
from itertools import groupby

import numpy as np

from rig.compare.comparison import Comparison, Joint
from rig.compare.shape_test import THRESHOLD
from rig.compare.stimuli import Stimulus
from rig.compare.stimulus_maps import StimulusMap
from rig.compare.tables import best_pairs
from rig.report.comparison import fit_figures, map_figures, profile_figures
from rig.report.comparison.strain_figures import strain_maps
from rig.report.html import Figure, figures_of
from sim.measures.measures import MEASURES

_SHOWN_FIRST = ("ep1", "ep3", "sed")  # the source's survivors
_MOST_SHOWN = 3


def comparison_figures(comparison: Comparison, maps: Sequence[StimulusMap]) -> list[Figure]:
    """In the order of the page; no figure is larger than a printed page holds."""
    return [*recorded_figures(comparison), *shape_figures(comparison), *simulation_figures(comparison, maps)]


def recorded_figures(comparison: Comparison) -> list[Figure]:
    """What was recorded, with what the fits say."""
    measures = _shown(comparison)
    return [figure for joint in comparison.joints for figure in _fits(joint, measures)]


def shape_figures(comparison: Comparison) -> list[Figure]:
    """Profiles and their shape tests."""
    measures = _shown(comparison)
    return [
        *_heat_maps(comparison),
        *(_profiles(s, measures, tested=comparison.passes(s) is not None) for s in _moved(comparison)),
    ]


def simulation_figures(comparison: Comparison, maps: Sequence[StimulusMap]) -> list[Figure]:
    """What the finger does, whatever was recorded."""
    measures, moved = _shown(comparison), _moved(comparison)
    return [
        *(_population(stimulus, measures) for stimulus in comparison.stimuli),
        *_pressures(moved),
        *_strain_maps(maps),
    ]


def _moved(comparison: Comparison) -> list[Stimulus]:
    return [stimulus for stimulus in comparison.stimuli if len(stimulus.x_mm) > 1]


def _shown(comparison: Comparison) -> list[str]:
    """The measures in the figures: candidates before others, then what explains most, then the source's order."""
    candidates = comparison.candidates()
    explained = np.zeros(len(MEASURES))
    for joint in comparison.joints:
        explained += np.where(joint.in_play & np.isfinite(joint.explained), joint.explained, 0.0).max(axis=1)
    order = [*_SHOWN_FIRST, *(name for name in MEASURES if name not in _SHOWN_FIRST)]
    order.sort(key=lambda name: (name not in candidates, -explained[MEASURES.index(name)]))
    return order[:_MOST_SHOWN]


def _fits(joint: Joint, measures: list[str]) -> list[Figure]:
    pairs = best_pairs(joint, measures)
    if not pairs:
        return []
    files = "; ".join(f"{p.stimulus.indentor}: {p.recording.name}" for p in joint.overlays)
    return [
        Figure(
            f"Recorded over predicted: {joint.title}",
            fit_figures.overlays(joint, pairs),
            "R = max(0, k(ε − ε₀)) with one k and ε₀ for all shapes of a row, over the recorded rates. For each "
            f"measure the receptor that explains most. {files}.",
        ),
        Figure(
            f"Rate against measure: {joint.title}",
            fit_figures.scatter(joint, pairs),
            "Each point is a recorded position; the measure is interpolated linearly in the SSRP. Black: the joint "
            "line. A negative ε₀ with a positive k says that the unloaded receptor fires.",
        ),
    ]


def _heat_maps(comparison: Comparison) -> list[Figure]:
    title, caption = f"Shape test, {len(MEASURES)} measures × receptors", "Dots: the SSRP passes the shape test. "
    if comparison.overlays:
        title = f"Correlation and {title[0].lower()}{title[1:]}"
        caption += (
            "Colour: Pearson's correlation between the recorded rates and the SSRP at the recorded positions; dash: "
            "negative; white: nothing recorded, or too few positions covered. "
        )
    caption += "Compressive measures have their sign changed (−)."
    draw = partial(map_figures.correlations, comparison)
    return figures_of(title, comparison.judged, map_figures.CORRELATIONS_A_PAGE, draw, caption)


def _profiles(stimulus: Stimulus, measures: list[str], *, tested: bool) -> Figure:
    caption = (
        "One profile a receptor, shifted upwards. Dotted: the mean of the two ends; black tick: the receptor's own x."
    )
    test = (
        f" Profiles in blue pass the shape test, grey ones do not. Orange: the least dip (steps) or prominence "
        f"(bars) that counts, {100 * THRESHOLD:g} % of the peak or of the range."
    )
    drawn = profile_figures.ssrps(stimulus, measures)
    if tested:
        return Figure(f"SSRPs and shape test: {stimulus.title}", drawn, caption + test)
    return Figure(f"SSRPs: {stimulus.title}", drawn, caption)


def _population(stimulus: Stimulus, measures: list[str]) -> Figure:
    return Figure(
        f"Population responses: {stimulus.title}",
        profile_figures.populations(stimulus, measures),
        "The measures at all receptors for each position of the indentor. In images a row is a position; dotted: "
        "the indentor's reference point is over the receptor; black, where a measure has both signs: zero.",
    )


def _pressures(moved: Sequence[Stimulus]) -> list[Figure]:
    return figures_of(
        "Pressure and contact regions along the schedules",
        moved,
        map_figures.PRESSURES_A_PAGE,
        map_figures.pressure_maps,
        "Nodal pressure in the receptor plane, unfiltered; each panel has its own scale. A row is a position of the "
        "indentor and reaches halfway to the next ones. White: the ends of the contact regions.",
    )


def _strain_maps(maps: Sequence[StimulusMap]) -> list[Figure]:
    return [
        Figure(
            f"Strain under the skin: {title}",
            strain_maps(list(members)),
            "The receptor plane, deformed, at up to three positions of the schedule: one value an element, not "
            "smoothed. The epidermis is ten times as stiff as what lies below. White circles: receptors. The highest "
            "3 % of the elements share the top colour.",
        )
        for title, members in groupby(maps, key=lambda one: one.stimulus.title)
    ]
