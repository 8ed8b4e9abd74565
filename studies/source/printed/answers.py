"""The presses of the study, each made once, and facts that are measured on them once."""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Concatenate, NamedTuple, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from rig.compare.stimuli import StimulusRow
from sim.config import FingertipConfig
from sim.measures.measures import shown
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM
from sim.models.fingertip import Fingertip
from sim.models.many_indentations import indent_many
from sim.models.result import IndentationResult
from sim.models.small_strain_error import SmallStrain, small_strain
from studies.source.simulated_stimuli import stimulus_of

Array = NDArray[np.float64]
Given = ParamSpec("Given")
Fact = TypeVar("Fact")

ROW_X_MM = tuple(float(x) for x in (0.17 * np.arange(-14, 15)).round(2))
"""One receptor an element (170 µm, as the source's mesh and ours)."""

ROW_DEPTH_MM = 0.75
LOW_GWT, HIGH_GWT = 2.33, 8.0


class PrintedPress(NamedTuple):
    """One press: a shape at a place, to a depth or a force."""

    shape: str
    x_mm: float
    kind: str
    value: float


def deep(shape: str, doi_mm: float, x_mm: float = 0.0) -> PrintedPress:
    """To a depth."""
    return PrintedPress(shape, x_mm, "doi_mm", doi_mm)


def forced(shape: str, force_gwt: float, x_mm: float = 0.0) -> PrintedPress:
    """To a force."""
    return PrintedPress(shape, x_mm, "force_gwt", force_gwt)


def load(config: FingertipConfig | None = None) -> Fingertip:
    """The finger with the ten receptors of the profiles and a close row for what lies beneath the skin."""
    x_mm = sorted({*ROW_X_MM, *DEFAULT_X_MM})
    return Fingertip.load(config, receptor_x_mm=x_mm, receptor_depth_mm=(ROW_DEPTH_MM, DEFAULT_DEPTH_MM))


class FingerAnswers:
    """What the finger answers; a scene that nobody announced is pressed when it is asked for."""

    def __init__(self, finger: Fingertip) -> None:
        self.finger = finger
        self.facts: dict[object, object] = {}
        self._pressed: dict[PrintedPress, IndentationResult] = {}

    def press_all(
        self,
        scenes: Sequence[PrintedPress],
        say: Callable[[int, int], object] | None = None,
        cores: int | None = None,
    ) -> None:
        """Over the cores of this machine. Raises RuntimeError, naming the scene, where there is no answer."""
        depth, force = ([s.value if s.kind == kind else np.nan for s in scenes] for kind in ("doi_mm", "force_gwt"))
        shapes, x_mm = [s.shape for s in scenes], [s.x_mm for s in scenes]
        found = indent_many(self.finger, shapes, x_mm, doi_mm=depth, force_gwt=force, cores=cores, progress=say)
        for scene, answer in zip(scenes, found.answers, strict=True):
            if answer.result is None or answer.problem:
                raise RuntimeError(f"{scene}: {answer.problem}")
            self._pressed[scene] = answer.result

    @property
    def presses(self) -> int:
        """How many there are."""
        return len(self._pressed)

    @property
    def small_strain(self) -> SmallStrain:
        """How far finite strain is from the deepest of them."""
        return small_strain("finger", max((found.doi_mm for found in self._pressed.values()), default=0.0))

    def press(self, scene: PrintedPress) -> IndentationResult:
        """The answer to one scene."""
        if scene not in self._pressed:
            self.press_all([scene], cores=1)
        return self._pressed[scene]

    @cached_property
    def _ten(self) -> NDArray[np.int64]:
        return self._receptors(DEFAULT_DEPTH_MM, DEFAULT_X_MM)

    @cached_property
    def _row(self) -> NDArray[np.int64]:
        return self._receptors(ROW_DEPTH_MM, ROW_X_MM)

    def _receptors(self, depth_mm: float, x_mm: Sequence[float]) -> NDArray[np.int64]:
        places = self.finger.model.receptors
        return np.flatnonzero((places.depths_mm == depth_mm) & np.isin(places.position_mm[:, 0].round(6), x_mm))

    def beneath(self, scene: PrintedPress, measure: str) -> tuple[Array, Array]:
        """x (mm) and a measure, in the sign in which profiles are shown, 0.75 mm below the skin."""
        values = shown(measure, self.press(scene).receptor_measures[measure])
        return self.finger.model.receptors.position_mm[self._row, 0], values[self._row]

    def stimulus(self, scenes: Sequence[PrintedPress]) -> StimulusRow:
        """Presses of one shape to one value at a row of places, at the ten receptors."""
        ordered = sorted(scenes, key=lambda scene: scene.x_mm)
        return stimulus_of(ordered[0].shape, ordered[0][2:], [self.press(one) for one in ordered], self._ten)


def once(
    function: Callable[Concatenate[FingerAnswers, Given], Fact],
) -> Callable[Concatenate[FingerAnswers, Given], Fact]:
    """A fact is measured once for figures, verdicts and tables alike."""

    def measured(answers: FingerAnswers, /, *args: Given.args, **kwargs: Given.kwargs) -> Fact:
        key = function, args, tuple(kwargs.items())
        if key not in answers.facts:
            answers.facts[key] = function(answers, *args, **kwargs)
        return answers.facts[key]  # type: ignore[return-value]

    return measured
