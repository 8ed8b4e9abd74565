"""All facts of one finger. Its model is made, asked and forgotten: nothing goes to the disk."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist

from sim.config import FingertipConfig
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import (
    DEFAULT_DEPTH_MM,
    DEFAULT_X_MM,
    ReceptorError,
    ReceptorPlaces,
    ReceptorSet,
    receptors_at,
)
from sim.models.condensed import Columns, CondensedModel
from sim.models.finger_3d import build_finger
from sim.models.fingertip import Fingertip
from sim.models.sources import MeshKey, Recipe, widened
from studies.source.allowed.facts import FACTS, SCENES
from studies.source.allowed.ranges import LOW_FORCE, Values, finger_of
from studies.source.printed.answers import LOW_GWT, ROW_DEPTH_MM, ROW_X_MM, FingerAnswers, PrintedPress
from studies.source.printed.cylinders import DEEP_MM, DEEP_X_MM
from studies.source.stiffness_scale import calibrate

_SAME_MM = 1e-9


class OwnAnswers(FingerAnswers):
    """Answers of a finger that carries the source's 8 gwt by a stiffness of its own, at a low force of its own."""

    def __init__(self, finger: Fingertip, low_gwt: float) -> None:
        super().__init__(finger)
        self._low_gwt = low_gwt

    def press_all(self, scenes: Sequence[PrintedPress], *_: Any, **__: Any) -> None:
        """In this process. Raises RuntimeError, naming the scene, where there is no answer."""
        asked = {scene: self._own(scene) for scene in scenes}
        super().press_all(list(dict.fromkeys(asked.values())), cores=1)
        self._pressed |= {scene: self._pressed[own] for scene, own in asked.items()}

    def _own(self, scene: PrintedPress) -> PrintedPress:
        low = scene.kind == "force_gwt" and scene.value == LOW_GWT
        return scene._replace(value=self._low_gwt) if low else scene


@dataclass(frozen=True)
class BuiltOnce:
    """A finger's model and the strain at all places that are asked about, by one factorisation; nothing is kept."""

    config: FingertipConfig
    surface: FingertipSurface
    places: ReceptorSet
    columns_of: dict[MeshKey, Columns] = field(default_factory=dict)

    def model(self, key: MeshKey) -> tuple[CondensedModel, bool]:
        """Built."""
        built = build_finger(widened(self.config, key[1]), self.surface, self.places, key[0])
        self.columns_of[key] = built.columns
        return built, False

    def interior(self, _: MeshKey) -> None:
        """There is none: what is not among the places is not known."""

    def columns(self, key: MeshKey, receptors: ReceptorSet, _: object = None) -> Columns:
        """Of some of the places, in any order. Raises ReceptorError for others."""
        whole, far = self.columns_of[key], cdist(receptors.position_mm, self.places.position_mm)
        if far.min(axis=1).max() > _SAME_MM:
            raise ReceptorError("a place that nobody announced")
        k = np.argmin(far, axis=1)
        per_place = whole.per_skin_force.reshape(len(far[0]), 6, *whole.per_skin_force.shape[1:])[k]
        return Columns(receptors, whole.young_ratio[k], per_place.reshape(-1, *per_place.shape[2:]))


def finger(values: Values, mesh: Mapping[str, Any]) -> Fingertip:
    """Built, with the scale of stiffness by which it carries the source's force in the source's scene.

    Raises ValueError and its children when the values do not go together.
    """
    config = finger_of(values, mesh)
    surface = FingertipSurface.fit(config.geometry)
    source = BuiltOnce(config, surface, _places(config, surface))
    made = Fingertip(config, surface, source, Recipe.of(Fingertip.load))
    made.e_epidermis_mpa = calibrate(made)
    return made


def _places(config: FingertipConfig, surface: FingertipSurface) -> ReceptorSet:
    """A close row, the ten receptors and, where the pulp is thick enough, the deep row."""
    rows: list[tuple[Sequence[float], float]] = [(ROW_X_MM, ROW_DEPTH_MM), (DEFAULT_X_MM, DEFAULT_DEPTH_MM)]
    found = [receptors_at(config, surface, ReceptorPlaces.of(*row, None)) for row in rows]
    with contextlib.suppress(ReceptorError):
        found.append(receptors_at(config, surface, ReceptorPlaces.of(DEEP_X_MM.tolist(), DEEP_MM, None)))
    return ReceptorSet(*(np.concatenate([getattr(one, f.name) for one in found]) for f in fields(ReceptorSet)))


def facts_of(values: Values, mesh: Mapping[str, Any]) -> dict[str, float]:
    """By key; not a number where the finger gives none."""
    answers = OwnAnswers(finger(values, mesh), values[LOW_FORCE])
    with contextlib.suppress(RuntimeError):  # where one is refused, the others are pressed as they are asked for
        answers.press_all(SCENES)
    return {fact.key: _of(answers, fact.measure) for fact in FACTS}


def _of(answers: FingerAnswers, measure: Any) -> float:
    try:
        return float(measure(answers))
    except (RuntimeError, ValueError, ZeroDivisionError):
        return np.nan
