"""`rig indent --other-paths`: how much an answer may depend on how it was reached."""

import pytest

from sim.models.fingertip import Fingertip
from tests.program import Program

pytestmark = pytest.mark.usefixtures("empty_figures")

PRESS = ("indent", "--shape", "bar:1.5", "--x-mm", "1.215", "--doi-mm", "0.237", "--other-paths")
STEADY = ("indent", "--shape", "wedge:60", "--x-mm", "0.876", "--doi-mm", "0.3", "--other-paths")


def test_indent_reports_how_far_its_force_depends_on_the_solution_path(program: Program, finger: Fingertip) -> None:
    depends = finger.indent("bar:1.5", 1.215, doi_mm=0.237, other_paths=True)
    assert program(*PRESS, "--json").json["path"]["spread"] == depends.path_spread > 0.005
    assert f"a spread of {100 * depends.path_spread:.2f}%" in program(*PRESS).out
    assert "a spread of" not in program(*STEADY).out
