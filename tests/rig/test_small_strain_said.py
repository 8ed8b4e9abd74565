"""Every place that gives a force or SED at a depth says how far small strain is off there, in one line."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest

from rig.compare.comparison import compare
from rig.compare.stimuli import stimuli
from rig.data import read_run
from rig.plan.config import load_config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.rehearsal_summary import Page
from rig.session.session import NewRun, Session
from sim.config import FingertipConfig, Geometry, Tissue
from sim.models import small_strain_error as module
from sim.models.default_finger import is_default_finger
from sim.models.fingertip import Fingertip
from sim.models.small_strain_error import DeviationRange, small_strain
from tests.program import Program
from tests.sim.coarse_mesh import as_toml, coarse_mesh

MESH = coarse_mesh(0.4, 0.4, patch_x_mm=2.0, patch_z_mm=2.0)
COARSE = as_toml(MESH)
SCRIPT = """\
def run(rig):
    rig.mount("cylinder:9")
    rig.home()
    rig.zero()
    for x_mm in (-0.4, 0.0, 0.4):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.3, hold_s=0.5)
"""
STUDY = '[[press]]\nshape = "cylinder:9"\ndoi_mm = [0.3]\n'
SAID = re.compile(r"small strain: at 0\.(29|3\d|90) mm the linear force is ")  # a bench's true depth is a little off


class At(NamedTuple):
    """A folder with a script and a coarse finger, the program, and a run made once."""

    folder: Path
    program: Program
    run: Callable[[], Path]
    study: str = STUDY

    def said(self, *arguments: object) -> str:
        """What the program prints on that finger."""
        ended = self.program(*arguments, "--config", self.folder / "coarse.toml")
        assert ended.code == 0, ended.err
        return " ".join(ended.out.split())

    @property
    def finger(self) -> Fingertip:
        """In the program's own process."""
        return Fingertip.load(load_config(self.folder / "coarse.toml").finger)


def _page(at: At) -> str:
    settings, finger = load_config(at.folder / "coarse.toml"), at.finger
    script = load_script(str(at.folder / "mine.py"))
    session = Session(script, settings, finger, make_plan(script, settings, finger), NewRun(at.folder / "none"))
    return Page.of(session).lines["force"]


def _study(at: At, *more: str) -> str:
    (at.folder / "study.toml").write_text(at.study, encoding="utf-8")
    return at.program("study", at.folder / "study.toml", *more).out


def _compared(at: At, *more: str) -> str:
    run = at.run()
    ended = at.program("compare", run, *more)
    assert ended.code == 0, ended.err
    return ended.out if more else (run / "comparison.html").read_text("utf-8")


INDENT = ("indent", "--shape", "cylinder:9", "--x-mm", "0", "--doi-mm", "0.3")
ENCODE = ("encode", "--shape", "cylinder:9", "--x-mm", "0", "--doi-mm", "0.3")
PLACES: dict[str, Callable[[At], str]] = {
    "library, JSON": lambda at: str(at.finger.indent("cylinder:9", doi_mm=0.3).as_json()),
    "rig indent": lambda at: at.said(*INDENT),
    "rig encode": lambda at: at.said(*ENCODE),
    "rig check": lambda at: at.said("check", at.folder / "mine.py"),
    "the page before a run": _page,
    "a run's report": lambda at: (at.run() / "report.html").read_text("utf-8"),
    "a comparison's report": _compared,
    "rig study": _study,
}


@pytest.fixture
def at(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    program: Program,
    made_once: Callable[[str, Callable[[], object]], Path],
) -> At:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "coarse.toml").write_text(COARSE, encoding="utf-8")
    (tmp_path / "mine.py").write_text(SCRIPT, encoding="utf-8")

    def run() -> Path:
        config = tmp_path / "coarse.toml"
        kind = "run" if config.read_text("utf-8") == COARSE else "run on another finger"
        return made_once(kind, lambda: program("dry-run", tmp_path / "mine.py", "--config", config))

    return At(tmp_path, program, run)


@pytest.mark.usefixtures("empty_figures")
@pytest.mark.parametrize("place", PLACES)
def test_every_output_of_force_or_sed_states_the_small_strain_error(place: str, at: At) -> None:
    assert SAID.search(PLACES[place](at))


NOT_MEASURED = "small strain: not measured for this finger, only for the default one"
LAYERED = "[finger.tissue]\ne_dermis = 1.0\ne_fat = 1.0\n"
"""A shell as stiff as all below it: its linear force is no longer too high (`docs/validation/small_strain.md`)."""


@pytest.mark.usefixtures("empty_figures")
@pytest.mark.parametrize("place", ["rig indent", "rig check", "a comparison's report"])
def test_every_output_says_that_another_finger_was_not_compared(place: str, at: At) -> None:
    (at.folder / "coarse.toml").write_text(COARSE + LAYERED, encoding="utf-8")
    said = PLACES[place](at._replace(study="[finger.tissue]\ne_dermis = [1.0]\n" + STUDY))
    assert NOT_MEASURED in said
    assert not SAID.search(said)


@pytest.mark.parametrize(
    ("finger", "compared"),
    [
        (FingertipConfig(), True),
        (FingertipConfig(tissue=Tissue(stiffness=3.0), mesh=MESH), True),  # a ratio of forces knows no unit
        (FingertipConfig(tissue=Tissue(e_fat=0.09)), False),
        (FingertipConfig(geometry=Geometry(length_mm=13.0)), False),
    ],
)
def test_small_strain_error_is_known_for_the_default_finger_at_any_stiffness_only(
    finger: FingertipConfig, compared: bool
) -> None:
    assert is_default_finger(finger) is compared


@pytest.fixture
def curves(monkeypatch: pytest.MonkeyPatch) -> None:
    point = (0.5, DeviationRange(0.02, 0.1), DeviationRange(-0.2, 0.1))
    monkeypatch.setattr(
        module, "_curves", lambda: {"finger": (point, (1.0, DeviationRange(-0.1, 0.0), DeviationRange(0.0, 0.0)))}
    )


@pytest.mark.usefixtures("curves")
def test_small_strain_error_is_interpolated_between_depths_and_unknown_beyond() -> None:
    assert small_strain("finger", 0.25).force == pytest.approx((0.01, 0.05))
    assert small_strain("finger", 0.75).force == pytest.approx((-0.04, 0.05))
    assert small_strain("interpolated finger", 0.5).sed == pytest.approx((-0.2, 0.1))
    assert small_strain("finger", 1.0).force == pytest.approx((-0.1, 0.0))
    assert small_strain("finger", 1.01).force is None
    assert small_strain("finger", 0.5).note == (
        "small strain: at 0.50 mm the linear force is 2 to 10 % high, SED 20 % low to 10 % high"
    )


STIFFENS = "finite strain, stiffening 0.4: force within "


def test_a_comparison_on_a_stiffening_finger_states_the_error_of_its_correction(at: At) -> None:
    config = load_config(at.folder / "coarse.toml").finger
    stiff = Fingertip.load(config.model_copy(update={"tissue": Tissue(stiffening=0.4)}))
    stiffened = stimuli(read_run(at.run()), stiff)
    assert compare(stiffened, {}).small_strain.note.startswith(STIFFENS)
    linear = replace(stiffened[0], stiffening=None)
    assert compare([linear], {}).small_strain.note.startswith("small strain")
    other = replace(linear, default_finger=False)
    assert compare([other], {}).small_strain.note == NOT_MEASURED
    assert compare([], {}).small_strain == small_strain("finger", 0.0)
