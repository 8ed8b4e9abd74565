"""`--friction` on the command line; what it refuses: tests/refusals."""

import pytest

from rig.compare.stimuli import answers_key
from sim.models.catalogue import load
from tests.program import Program

pytestmark = pytest.mark.usefixtures("empty_figures")

PRESS = ("indent", "--shape", "cylinder:9", "--doi-mm", "0.3", "--model", "section", "--json")


def test_a_press_with_friction_reports_the_residuals_of_coulombs_law(program: Program) -> None:
    smooth, none, rubbed = (program(*PRESS, *more).json for more in ((), ("--friction", "0"), ("--friction", "0.3")))
    smooth["solver"]["contact_s"] = none["solver"]["contact_s"] = 0.0
    smooth["solver"]["build_s"] = none["solver"]["build_s"] = 0.0
    assert none == smooth
    assert "friction" not in smooth
    told = rubbed["friction"]
    assert (told["coefficient"], told["increments"]) == (0.3, 6)
    assert max(told["normal_residual"], told["cone_residual"], told["slip_residual"]) < 1e-8
    assert 0 < told["sticking_share"] <= 1
    assert rubbed["force_n_per_mm"] != smooth["force_n_per_mm"]


def test_responses_are_cached_by_friction() -> None:
    finger = load("section")
    keys = [answers_key(finger.with_friction(mu), "request") for mu in (0.0, 0.3, 0.6)]
    assert len(set(keys)) == 3
    assert keys[0] == answers_key(finger, "request")
