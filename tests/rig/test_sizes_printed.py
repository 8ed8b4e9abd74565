"""Every command that prints a plan or a press prints the radius and the width of the indentor."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import rig.cli.compare as comparing
from rig.bench.real import Request
from rig.cli.identify_finger import final_lines, page_lines, print_before_press
from rig.cli.run import ask_at_the_bench, prompt_for
from rig.data.folder import RunFolder
from rig.identify.adaptive_presses import IdentificationOptions
from rig.identify.expected_duration import ExpectedDuration
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.rehearsal_summary import Page
from rig.session.session import NewRun, Session
from sim.identification.next_press import PressAt
from sim.models.fingertip import Fingertip
from tests.program import Program

SHAPES = {
    "sphere:4": ("4", "8"),
    "sphere:d=8": ("4", "8"),
    "flat:r=1.5": ("1.5", "3"),
    "cylinder:9": ("4.5", "9"),
    "bar:3.0": ("3",),
}
SCRIPT = """
def run(rig):
    rig.mount("SHAPE")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=0.0)
    rig.indent(doi_mm=0.2)
"""
Prints = Callable[["Printing", str], str]


class Printing(SimpleNamespace):
    """What the commands need: the program, a finger, a folder, captured output."""

    program: Program
    finger: Fingertip
    folder: Path
    capsys: pytest.CaptureFixture[str]

    @contextmanager
    def heard(self, found: list[str]) -> Iterator[None]:
        self.capsys.readouterr()
        yield
        found += self.capsys.readouterr()

    def script(self, shape: str) -> str:
        path = self.folder / "mine.py"
        path.write_text(SCRIPT.replace("SHAPE", shape), encoding="utf-8")
        return str(path)


def _indent(its: Printing, shape: str) -> str:
    return its.program("indent", "--shape", shape, "--doi-mm", "0.2", "--model", "halfspace").out


def _check(its: Printing, shape: str) -> str:
    return its.program("check", its.script(shape)).out


def _page_of_a_run(its: Printing, shape: str) -> str:
    script, config = load_script(its.script(shape)), Config()
    session = Session(script, config, its.finger, make_plan(script, config, its.finger), NewRun(its.folder))
    return " ".join(Page.of(session).lines.values())


def _request_to_mount(its: Printing, shape: str) -> str:
    found: list[str] = []
    with its.heard(found), suppress(Exception):  # nobody answers
        ask_at_the_bench(Request(f"mount {shape}", shape))
    return "".join(found)


def _mounted_before(its: Printing, shape: str) -> str:
    found: list[str] = []
    owner: Any = SimpleNamespace(asking=None)
    with its.heard(found):
        prompt_for(owner, shape)(Request(f"mount {shape}", shape))
    return "".join(found)


def _identification(shape: str) -> Any:
    return SimpleNamespace(
        options=IdentificationOptions((PressAt(shape, 0.0, 1.0),)), trip_n=lambda press: 1.0, settings=Config(),
        reports=[], learned=SimpleNamespace(collapsed=False), mismatch=None, measured=[],
    )  # fmt: skip


def _page_of_an_identification(its: Printing, shape: str) -> str:
    options = IdentificationOptions((), shapes=(shape,))
    return page_lines(Config(), options, ExpectedDuration(1.0, 1.0))["shapes"]


def _press_of_an_identification(its: Printing, shape: str) -> str:
    found: list[str] = []
    with its.heard(found):
        print_before_press(_identification(shape), PressAt(shape, 0.0, 0.5))
    return "".join(found)


def _forces_of_an_identification(its: Printing, shape: str) -> str:
    identification = _identification(shape)
    identification.measured, identification.not_learned = [None], []
    identification.widths = [SimpleNamespace(middle=1.0, low=0.5, high=2.0)]
    done: Any = SimpleNamespace(folder=RunFolder(its.folder), problem=None, ending=None, duration_s=1.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rig.cli.identify_finger.number_rows", lambda one: [])
        return str(final_lines(done, identification, "finger.toml")["forces"])


def _compare(its: Printing, shape: str) -> str:
    found: list[str] = []
    comparison: Any = SimpleNamespace(
        candidates=list, stimuli=[SimpleNamespace(indentor=shape, condition="0.5 mm")], left_out=(), overlays=()
    )
    with its.heard(found), pytest.MonkeyPatch.context() as patch:
        patch.setattr(comparing, "left_out_lines", lambda one: [])
        comparing._print(comparison, [], [], Path("report.html"), [])
    return "".join(found)


PRINTS: dict[str, Prints] = {
    "check": _check,
    "compare": _compare,
    "identify: page": _page_of_an_identification,
    "identify: press": _press_of_an_identification,
    "identify: forces": _forces_of_an_identification,
    "indent": _indent,
    "run, resume: page": _page_of_a_run,
    "run, resume, identify: request": _request_to_mount,
    "run, resume, identify: --mounted": _mounted_before,
}


@pytest.mark.quick(rows=lambda prints, shape: shape == "sphere:4" or prints == "run, resume, identify: request")
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("prints", PRINTS)
def test_a_plan_or_a_press_has_radius_and_width(
    prints: str, shape: str, program: Program, finger: Fingertip, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    its = Printing(program=program, finger=finger, folder=tmp_path, capsys=capsys)
    text = " ".join(PRINTS[prints](its, shape).split())
    *radius, wide = SHAPES[shape]
    number = f"radius {radius[0]} mm, " if radius else ""
    assert re.search(rf"\({re.escape(number)}{re.escape(wide)} mm wide\)", text), text
