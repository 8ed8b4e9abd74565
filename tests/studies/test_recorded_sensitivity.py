"""The table of sensitivity holds every level of the study, and a press that did not converge is counted in it."""

from dataclasses import replace

import numpy as np
import pytest

from rig.compare.example import DOI_MM, SHAPE, ramps
from rig.report.example_page import read_levels
from sim.config import FingertipConfig
from sim.measures.measures import MEASURES
from sim.models.fingertip import Fingertip
from sim.models.friction import press_profile
from sim.models.result import IndentationResult
from studies.recorded import sensitivity
from studies.recorded.sensitivity import LEVELS, Array, Level, replaced, rubbed
from tests.sim.coarse_mesh import coarse_mesh

X_MM = np.array([-1.5, 0.1])
COARSE = FingertipConfig(mesh=coarse_mesh(0.6, 0.8))


@pytest.mark.parametrize("level", LEVELS, ids=lambda one: f"{one.axis}: {one.level}")
def test_every_level_of_the_study_is_stored(level: Level) -> None:
    stored = [one for one in read_levels() if replaced(one, level)]
    assert {one.phase for one in stored} == set(level.phases)


def test_a_ramp_with_friction_is_the_path_of_one_press() -> None:
    finger = Fingertip.load(COARSE)
    lifted, note = rubbed(Level("friction", "0.3", config=COARSE, friction=0.3), finger, X_MM)
    pressed = press_profile(finger, SHAPE, X_MM.tolist(), doi_mm=DOI_MM, friction=0.3)
    sed = [one.receptor_measures["sed"] for one in pressed]
    assert note == ""
    # Corners of the bar have more than one equilibrium, and rounding, which differs between processors, chooses: SED
    # moved by 1.4e-4 on one of them, at a residual of 1e-13. Friction moves it by 1e-2.
    assert lifted.stimulus.measures[MEASURES.index("sed")] == pytest.approx(np.array(sed), rel=1e-3)


def test_presses_without_convergence_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    def stuck(finger: Fingertip, x_mm: Array) -> list[list[IndentationResult]]:
        found = ramps(finger, x_mm)
        found[0][-1] = replace(found[0][-1], state=replace(found[0][-1].state, residual=1.0))
        return found

    monkeypatch.setattr(sensitivity, "ramps", stuck)
    _, note = rubbed(Level("friction", "0.3", config=COARSE, friction=0.3), Fingertip.load(COARSE), X_MM)
    assert "1 of 2" in note
