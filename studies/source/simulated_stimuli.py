"""Stimuli simulated directly, without the bench: what runs of these schedules would give."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.compare.stimuli import StimulusRow, answers_key, contact_regions, controls, on_widest_skin
from sim.measures.measures import MEASURES, shown
from sim.models.cache import Arrays, cached_arrays
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult

Array = NDArray[np.float64]

SPACING_MM = 0.17
STEP_X_MM = np.arange(-4.4, 2.5, SPACING_MM)


def stimulus(finger: Fingertip, indentor: str, x_mm: Array, kind: str, value: float) -> StimulusRow:
    """What a run of these indentations would give; kept in the cache."""
    key = answers_key(finger, ["simulated", 4, indentor, x_mm.tolist(), kind, value])
    found, _ = cached_arrays(key, lambda: _answers(finger, indentor, x_mm, {kind: value}), kind="answers")
    receptors = finger.model.receptors.position_mm[:, 0].round(6) + 0.0
    return _stimulus(("simulated", indentor, kind, value), x_mm, found, receptors)


def stimulus_of(
    indentor: str, pressed: tuple[str, float], results: Sequence[IndentationResult], receptors: NDArray[np.int64]
) -> StimulusRow:
    """Presses to one depth or force, by ascending x, at some of the finger's receptors."""
    places = results[0].model.receptors.position_mm[receptors, 0].round(6) + 0.0
    x_mm = np.array([result.x_mm for result in results])
    return _stimulus(("study", indentor, *pressed), x_mm, _table(results, receptors), places)


def _stimulus(what: tuple[str, str, str, float], x_mm: Array, found: Arrays, receptor_mm: Array) -> StimulusRow:
    doi, force, measures, skin, pressure, regions, control = (
        np.asarray(found[name], dtype=float) for name in _STORED
    )
    return StimulusRow(*what, x_mm, doi, force, measures, receptor_mm, skin, pressure, regions, controls=control)


_STORED = ("doi_mm", "force_gwt", "measures", "skin_mm", "pressure", "regions_mm", "controls")


def _answers(finger: Fingertip, indentor: str, x_mm: Array, target: dict[str, Any]) -> Arrays:
    results = [finger.indent(indentor, float(x), **target) for x in x_mm]
    return _table(results, np.arange(len(finger.model.receptors.depths_mm)))


def _table(results: Sequence[IndentationResult], receptors: NDArray[np.int64]) -> Arrays:
    skin_mm, pressure = on_widest_skin([r.pressure_profile_kpa for r in results])
    return {
        **{name: np.array([getattr(r, name) for r in results]) for name in ("doi_mm", "force_gwt")},
        "measures": np.array(
            [[shown(name, r.receptor_measures[name])[receptors] for r in results] for name in MEASURES]
        ),
        "skin_mm": skin_mm,
        "pressure": pressure,
        "regions_mm": contact_regions(results),
        "controls": np.moveaxis(np.array([controls(r)[:, receptors] for r in results]), 1, 0),
    }


def steps(finger: Fingertip, force_gwt: float, x_mm: Array = STEP_X_MM) -> list[StimulusRow]:
    """Steps 1, 3 and 5 at one force."""
    return [stimulus(finger, f"step:{n}", x_mm, "force_gwt", force_gwt) for n in "135"]


def bars(finger: Fingertip) -> list[StimulusRow]:
    """Bars 1.5 and 3.0 at DOI 1.0, at 25 and 34 positions."""
    return [
        stimulus(finger, f"bar:{width}", SPACING_MM * (np.arange(n, dtype=np.float64) - 0.5 * (n - 1)), "doi_mm", 1.0)
        for width, n in (("1.5", 25), ("3.0", 34))
    ]
