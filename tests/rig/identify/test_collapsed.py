"""An identification that collapsed onto too few fingers ends with exit code 1, and no command accepts its file."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import typer

import rig.cli.identify_finger as identify_finger
from rig.cli.identify_finger import final_lines
from rig.compare.plausible_fingers import read_plausible
from rig.errors import BadInputError, RunAborted
from rig.identify.adaptive_presses import Identification, IdentificationOptions, with_reliable_touch
from rig.identify.finger_from_presses import finger_file
from rig.plan.config import Config
from rig.plan.finger_file import FingerFile
from sim.identification.next_press import PressAt
from sim.identification.posterior import least_effective
from tests.error_codes import raises
from tests.made_up_fingers import made_up
from tests.program import Program
from tests.rig.identify.finger_file import identified_file

FORESEEN = made_up()


def _flagged() -> FingerFile:
    file = identified_file()
    return file.model_copy(update={"identified": file.identified.model_copy(update={"collapsed": True})})


def _of_one_draw() -> FingerFile:
    """Whose flag was lost."""
    file = identified_file()
    return file.model_copy(
        update={"identified": file.identified.model_copy(update={"draw": 8 * file.identified.draw[:1]})}
    )


COMMANDS = {
    "run": ["run", "first_press", "--yes", "--config", "rig.toml", "--finger", "finger.toml"],
    "as a configuration": ["dry-run", "first_press", "--config", "finger.toml"],
    "one press": ["indent", "--shape", "bar:3.0", "--doi-mm", "1", "--x-mm", "0", "--config", "finger.toml"],
    "reveal": ["serve", "--reveal", "7", "--beside", "finger.toml"],
}


@pytest.mark.parametrize("file", [_flagged, _of_one_draw], ids=["flagged", "of one draw"])
@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)
def test_no_command_accepts_its_file(
    program: Program, words: list[str], file: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "finger.toml").write_text(file().as_toml(), encoding="utf-8")
    (tmp_path / "rig.toml").write_text("[stage]\nport = '/dev/none'\n", encoding="utf-8")
    ended = program(*words)
    assert (ended.code, ended.out) == (2, "")
    assert "finger.toml" in ended.err
    assert "collapsed" in ended.err
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("file", [_flagged, _of_one_draw], ids=["flagged", "of one draw"])
def test_a_comparison_does_not_take_it_for_plausible_fingers(file: Any, tmp_path: Path) -> None:
    path = tmp_path / "finger.toml"
    path.write_text(file().as_toml(), encoding="utf-8")
    with raises(BadInputError, "collapsed"):
        read_plausible(path)


# --- how the identification itself ends ---

LEAST = least_effective(len(FORESEEN.prior.names))


def _identification(effective: float) -> Identification:
    options = IdentificationOptions((PressAt("cylinder:9", 0.5, 0.67),), shapes=("sphere:4",))
    identification = Identification(with_reliable_touch(Config()), FORESEEN, options, seed=1)
    identification.learned = replace(identification.learned, effective=effective)
    return identification


@pytest.mark.parametrize(
    ("effective", "problem", "code"),
    [
        (1500.0, None, 0),
        (LEAST, None, 0),  # the fewest that carry a covariance of the parameters
        (LEAST - 0.1, None, 1),
        (1.0, None, 1),  # as on the shipped finger: one draw has all the weight
        (1.0, RunAborted("stopped"), 130),  # a stop is what ended it
    ],
)
def test_the_exit_code(effective: float, problem: Exception | None, code: int, tmp_path: Path) -> None:
    done = cast(Any, SimpleNamespace(problem=problem, ending=None, complete=problem is None, files_problem=None))
    with pytest.raises(typer.Exit) as ended:
        identify_finger._leave(done, _identification(effective), tmp_path / "finger.toml")
    assert ended.value.exit_code == code


@pytest.mark.parametrize(("problem", "code"), [(None, 3), (RunAborted("stopped"), 130)])
def test_an_object_that_no_finger_explains_has_an_exit_code_of_its_own_and_its_reason_in_the_file(
    problem: Exception | None, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Identification, "mismatch", "it is bone")
    identification = _identification(1500.0)
    done = cast(Any, SimpleNamespace(problem=problem, ending=None, complete=problem is None, files_problem=None))
    with pytest.raises(typer.Exit) as ended:
        identify_finger._leave(done, identification, tmp_path / "finger.toml")
    assert ended.value.exit_code == code
    identification.measured = [cast(Any, SimpleNamespace(zero_gwt=0.0))]
    identification.learned = replace(identification.learned, readings=np.array([1]), misfit=np.array([1.0]))
    journal = tmp_path / "events.jsonl"
    journal.write_text("", encoding="utf-8")
    assert finger_file(identification, Config(), [journal]).identified.flagged == "it is bone"


@pytest.mark.parametrize(("effective", "collapsed"), [(LEAST, False), (LEAST - 0.1, True)])
def test_file_sentence_and_table_all_show_it(effective: float, collapsed: bool, tmp_path: Path) -> None:
    identification = _identification(effective)
    identification.measured = [cast(Any, SimpleNamespace(zero_gwt=0.0))]
    identification.learned = replace(identification.learned, readings=np.array([1]), misfit=np.array([1.0]))
    journal = tmp_path / "events.jsonl"
    journal.write_text("", encoding="utf-8")
    assert finger_file(identification, Config(), [journal]).identified.collapsed is collapsed
    assert any("collapsed" in sentence for sentence in identification.not_learned) is collapsed
    identification.measured = []
    folder = SimpleNamespace(path=tmp_path)
    done = cast(Any, SimpleNamespace(folder=folder, problem=None, ending=None, duration_s=1.0))
    assert ("collapsed" in final_lines(done, identification, "finger.toml")) is collapsed
