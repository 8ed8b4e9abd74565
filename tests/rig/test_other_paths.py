"""`rig indent --other-paths`: what it says of an answer that may depend on how it was reached."""

import re
from typing import Any

import pytest

from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult
from tests.program import Program

pytestmark = pytest.mark.usefixtures("empty_figures")

X_MM, DOI_MM = 1.215, 0.237


@pytest.fixture
def depends(finger: Fingertip) -> IndentationResult:
    return finger.indent("bar:1.5", X_MM, doi_mm=DOI_MM, other_paths=True)


def _path_line(ended: Any) -> str:
    assert (ended.code, ended.err) == (0, "")
    found = [line.strip() for line in ended.out.splitlines() if line.strip().startswith("path ")]
    return re.sub(r"\s+", " ", found[0]) if found else ""


def test_the_command_says_it(program: Program, depends: IndentationResult) -> None:
    press = ("indent", "--shape", "bar:1.5", "--x-mm", str(X_MM), "--doi-mm", str(DOI_MM))
    hint = "path the force may depend on the loading path; --other-paths reports by how much"
    assert _path_line(program(*press)) == hint
    n, other = depends.other_forces_n
    assert _path_line(program(*press, "--other-paths")) == (
        f"path finer increments give {n:.5f} N = {n / 9.80665e-3:.4f} gwt and "
        f"{other:.5f} N = {other / 9.80665e-3:.4f} gwt: a spread of 0.88%"
    )
    told = program(*press, "--other-paths", "--json").json["path"]
    assert told["spread"] == depends.path_spread
    steady = ("indent", "--shape", "wedge:60", "--x-mm", "0.876", "--doi-mm", "0.3", "--other-paths")
    assert _path_line(program(*steady)) == "path finer increments give the same force"
    assert _path_line(program("indent", "--shape", "bar:3", "--x-mm", "0", "--doi-mm", "0.3", "--other-paths")) == ""
