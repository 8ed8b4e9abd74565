"""All facts of one finger. Its model is made, asked and forgotten: nothing goes to the disk."""

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sim.finger.surface import FingertipSurface
from sim.measures.reach import ReceptorPlaces, receptors_at
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM
from sim.models.fingertip import Fingertip
from sim.models.inside.interior import Interior
from sim.models.patches import widened
from sim.models.processes.recipe import Recipe
from sim.models.sources import Anew
from sim.models.whole_finger import build_finger
from studies.source.allowed.facts import FACTS, SCENES
from studies.source.allowed.ranges import LOW_FORCE, Values, finger_of
from studies.source.printed.answers import LOW_GWT, ROW_DEPTH_MM, ROW_X_MM, Answers, Scene
from studies.source.stiffness_scale import calibrate


class OwnAnswers(Answers):
    """Answers of a finger that carries the source's 8 gwt by a stiffness of its own, at a low force of its own."""

    def __init__(self, finger: Fingertip, low_gwt: float) -> None:
        super().__init__(finger)
        self._low_gwt = low_gwt

    def press_all(self, scenes: Sequence[Scene], *_: Any, **__: Any) -> None:
        """In this process. Raises RuntimeError, naming the scene, where there is no answer."""
        asked = {scene: self._own(scene) for scene in scenes}
        super().press_all(list(dict.fromkeys(asked.values())), cores=1)
        self._pressed |= {scene: self._pressed[own] for scene, own in asked.items()}

    def _own(self, scene: Scene) -> Scene:
        low = scene.kind == "force_gwt" and scene.value == LOW_GWT
        return scene._replace(value=self._low_gwt) if low else scene


def finger(values: Values, mesh: Mapping[str, Any]) -> Fingertip:
    """Built, with the scale of stiffness by which it carries the source's force in the source's scene.

    Raises ValueError and its children when the values do not go together.
    """
    config = finger_of(values, mesh)
    surface = FingertipSurface.fit(config.geometry)
    places = ReceptorPlaces.of(sorted({*ROW_X_MM, *DEFAULT_X_MM}), (ROW_DEPTH_MM, DEFAULT_DEPTH_MM), None)
    source = Anew(
        lambda key, receptors: build_finger(widened(config, key[1]), surface, receptors, key[0]),
        receptors_at(config, surface, places),
        lambda key: Interior(widened(config, key[1]), surface, key[0], "auto"),
    )
    made = Fingertip(config, surface, source, Recipe.of(Fingertip.load))
    made.e_epidermis_mpa = calibrate(made)
    return made


def facts_of(values: Values, mesh: Mapping[str, Any]) -> dict[str, float]:
    """By key; not a number where the finger gives none."""
    answers = OwnAnswers(finger(values, mesh), values[LOW_FORCE])
    with contextlib.suppress(RuntimeError):  # where one is refused, the others are pressed as they are asked for
        answers.press_all(SCENES)
    return {fact.key: _of(answers, fact.measure) for fact in FACTS}


def _of(answers: Answers, measure: Any) -> float:
    try:
        return float(measure(answers))
    except (RuntimeError, ValueError, ZeroDivisionError):
        return np.nan
