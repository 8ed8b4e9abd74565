"""Pages without their figures, which take most of the time of making them."""

from collections.abc import Sequence

import numpy as np
import pytest
from matplotlib.figure import Figure

from rig.compare.stimuli import MAPPED, StimulusMap, StimulusRow
from rig.data import Run
from rig.report.plot import Plot
from sim.models.fingertip import Fingertip


def draw_nothing(patch: pytest.MonkeyPatch) -> None:
    """Leave figures empty, and the whole mesh of a comparison unsolved."""
    patch.setattr(Plot, "_laid_out", property(lambda plot: Figure((1, 1))))
    patch.setattr("rig.cli.compare.stimulus_maps", _unsolved)


def _unsolved(run: Run, finger: Fingertip, stimuli: Sequence[StimulusRow]) -> list[StimulusMap]:
    corners, receptors, values = np.zeros((2, 2, 2)), np.zeros((1, 2)), dict.fromkeys(MAPPED, np.zeros((1, 1)))
    return [StimulusMap(one, float(one.x_mm[0]), corners, receptors, values) for one in stimuli]
