"""Which figures a comparison's report has, and what is written under them."""

from collections.abc import Sequence
from functools import partial
from itertools import groupby

from rig.compare.answers.answer import Answer
from rig.compare.comparison import Comparison
from rig.compare.shape_test import THRESHOLD
from rig.compare.stimuli import Stimulus
from rig.compare.stimulus_maps import StimulusMap
from rig.report.comparison import map_figures, profile_figures
from rig.report.comparison.source_section import SURVIVORS
from rig.report.comparison.strain_figures import strain_maps
from rig.report.html import Figure, figures_of
from sim.measures.measures import MEASURES

_MOST_SHOWN = 3


def shape_figures(comparison: Comparison, shown: Sequence[str]) -> list[Figure]:
    """Profiles and their shape tests; no figure is larger than a printed page holds."""
    profiles = [_profiles(s, shown, tested=comparison.passes(s) is not None) for s in _moved(comparison)]
    return [*_heat_maps(comparison), *profiles]


def simulation_figures(comparison: Comparison, shown: Sequence[str], maps: Sequence[StimulusMap]) -> list[Figure]:
    """What the finger does, in the order of the page."""
    moved = _moved(comparison)
    return [
        *(_population(stimulus, shown) for stimulus in comparison.stimuli),
        *_pressures(moved),
        *_strain_maps(maps),
    ]


def shown_measures(comparison: Comparison, answers: Sequence[Answer]) -> list[str]:
    """The measures in the figures of the simulation: the likeliest, then candidates, then the source's survivors."""
    likeliest = (row.name for answer in answers for row in answer.measures)
    passed = comparison.candidates()
    candidates = [name for name in (*SURVIVORS, *MEASURES) if name in passed]
    return list(dict.fromkeys((*likeliest, *candidates, *SURVIVORS)))[:_MOST_SHOWN]


def _moved(comparison: Comparison) -> list[Stimulus]:
    return [stimulus for stimulus in comparison.stimuli if len(stimulus.x_mm) > 1]


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


def _profiles(stimulus: Stimulus, shown: Sequence[str], *, tested: bool) -> Figure:
    caption = (
        "One profile a receptor, shifted upwards. Dotted: the mean of the two ends; black tick: the receptor's own x."
    )
    test = (
        f" Profiles in blue pass the shape test, grey ones do not. Orange: the least dip (steps) or prominence "
        f"(bars) that counts, {100 * THRESHOLD:g} % of the peak or of the range."
    )
    drawn = profile_figures.ssrps(stimulus, shown)
    if tested:
        return Figure(f"SSRPs and shape test: {stimulus.title}", drawn, caption + test)
    return Figure(f"SSRPs: {stimulus.title}", drawn, caption)


def _population(stimulus: Stimulus, shown: Sequence[str]) -> Figure:
    return Figure(
        f"Population responses: {stimulus.title}",
        profile_figures.populations(stimulus, shown),
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
