"""What the finger answers to the presses of the facts, each made once."""

from collections.abc import Sequence
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from rig.compare.stimuli import StimulusRow
from sim.config import FingertipConfig
from sim.measures.measures import shown
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult
from studies.source.simulated_stimuli import stimulus_of

Array = NDArray[np.float64]

ROW_X_MM = tuple(float(x) for x in (0.17 * np.arange(-14, 15)).round(2))
"""One receptor an element (170 µm, as the source's mesh and ours)."""

ROW_DEPTH_MM = 0.75
LOW_GWT, HIGH_GWT = 2.33, 8.0
PROMINENT = 0.05
"""A maximum counts when it stands out by this part of the range."""


class PrintedPress(NamedTuple):
    """One press: a shape at a place, to a depth or a force."""

    shape: str
    x_mm: float
    kind: str
    value: float


def deep(shape: str, doi_mm: float, x_mm: float = 0.0) -> PrintedPress:
    """Return a press to a depth."""
    return PrintedPress(shape, x_mm, "doi_mm", doi_mm)


def forced(shape: str, force_gwt: float, x_mm: float = 0.0) -> PrintedPress:
    """Return a press to a force."""
    return PrintedPress(shape, x_mm, "force_gwt", force_gwt)


class FingerAnswers:
    """A finger with the ten receptors of the profiles, and a close row for what lies beneath the skin."""

    def __init__(self, config: FingertipConfig | None = None) -> None:
        x_mm = sorted({*ROW_X_MM, *DEFAULT_X_MM})
        self.finger = Fingertip.load(config, receptor_x_mm=x_mm, receptor_depth_mm=(ROW_DEPTH_MM, DEFAULT_DEPTH_MM))

    @cache  # noqa: B019  # one finger a process
    def press(self, scene: PrintedPress) -> IndentationResult:
        """Return the answer to one scene."""
        if scene.kind == "doi_mm":
            return self.finger.indent(scene.shape, scene.x_mm, doi_mm=scene.value)
        return self.finger.indent(scene.shape, scene.x_mm, force_gwt=scene.value)

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
        """Return x (mm) and a measure, in the sign in which profiles are shown, 0.75 mm below the skin."""
        values = shown(measure, self.press(scene).receptor_measures[measure])
        return self.finger.model.receptors.position_mm[self._row, 0], values[self._row]

    def stimulus(self, scenes: Sequence[PrintedPress]) -> StimulusRow:
        """Return presses of one shape to one value at a row of places, at the ten receptors."""
        ordered = sorted(scenes, key=lambda scene: scene.x_mm)
        return stimulus_of(ordered[0].shape, ordered[0][2:], [self.press(one) for one in ordered], self._ten)


def maxima(profile: Array) -> int:
    """Return how many maxima stand out."""
    return len(find_peaks(profile, prominence=PROMINENT * float(np.ptp(profile)))[0])


def second(profile: Array) -> float:
    """Return how far the second maximum stands out, as a part of the range; 0 without one."""
    found = find_peaks(profile, prominence=0)[1]["prominences"] / np.ptp(profile)
    return float(np.append(np.sort(found)[::-1], [0.0, 0.0])[1])
