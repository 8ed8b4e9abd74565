"""The file of a finger that was met: what is written is read, and what is wrong is told in one line."""

from pathlib import Path

import pytest

from rig.plan.config import Config, load_config, with_finger
from rig.plan.met.finger_file import fingers_of, read_finger_file
from rig.protocol.errors import BadInputError
from tests.rig.met.met_file import SERIES, met_file


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "finger.toml"
    file.write_text(met_file(relaxation=SERIES).as_toml(), encoding="utf-8")
    return file


def test_what_is_written_is_read(path: Path) -> None:
    assert read_finger_file(path) == met_file(relaxation=SERIES)


def test_it_is_a_piece_of_a_configuration(path: Path) -> None:
    """So a run's own copy of its configuration keeps it, and a run that is taken up has it."""
    file = met_file(relaxation=SERIES)
    config = load_config(path)
    assert (config.finger, config.met, config.virtual.relaxation) == (file.finger, file.met, SERIES)
    again = path.with_name("config.toml")
    again.write_text(config.as_toml(), encoding="utf-8")
    assert load_config(again) == config


def test_it_goes_before_a_configurations_finger_and_not_before_its_virtual_truth(path: Path) -> None:
    assert with_finger(Config(), None) == Config()
    quick = Config.model_validate({"virtual": {"relaxation": [[0.1, 0.5]], "stiffness": 1.5}})
    found = with_finger(quick, path)
    assert found.finger == met_file().finger
    assert found.met == met_file(relaxation=SERIES).met
    assert (found.virtual.relaxation, found.virtual.stiffness) == (((0.1, 0.5),), 1.5)
    assert with_finger(Config(), path).virtual.relaxation == SERIES


def test_likely_fingers_differ_in_their_tissue_alone() -> None:
    file = met_file(stiffness=2.0)
    likely = fingers_of(file.finger, file.met)
    assert [one.tissue.stiffness for one in likely] == [draw.stiffness for draw in file.met.draw]
    assert [one.tissue.e_fat for one in likely] == [draw.e_fat for draw in file.met.draw]
    assert {one.mesh for one in likely} == {file.finger.mesh}


TO_THE_DRAWS = "stiffness = 0.9323938199059483\ne_dermis = "  # of the first of them
WRONG = {
    "no file": (None, "No such file or directory"),
    "no TOML": (("[met]", "[met"), "not valid TOML: "),
    "another file": (("[met", "[meet"), "no [met] table, expected a file that `rig meet` wrote"),
    "unknown key": (("presses = 8", "pressed = 8"), "met.presses: field required"),
    "no number": (("e_dermis = 0.1", "e_dermis = nan"), "finger.tissue.e_dermis = nan: input should be a finite"),
    "no tissue": (("e_fat = 0.1\n", "e_fat = 11.0\n"), "finger.tissue.e_fat = 11.0: input should be less than"),
    "beyond what is interpolated": (
        (TO_THE_DRAWS + "0.1", TO_THE_DRAWS + "0.01"),
        "met.draw.0: e_dermis = 0.01, e_fat = 0.107251: expected e_dermis from 0.04 to 0.64 and e_fat from 0.02 to",
    ),
    "relaxes away": (("[0.2, 1.4]", "[0.9, 1.4]"), "expected shares > 0 that sum to less than 1 and"),
    "a variance below 0": (("4e-4", "-4e-4"), "met.posterior: covariance of x_mm: -0.0004, expected a variance"),
    "hashes": (('runs = ["one"]', 'runs = ["one", "two"]'), "met: 2 runs and 1 hashes, expected one for each"),
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_is_told_in_one_line(path: Path, wrong: str) -> None:
    change, told = WRONG[wrong]
    if change is None:
        path.unlink()
    else:
        text = path.read_text(encoding="utf-8").replace("0.0004", "4e-4")
        assert change[0] in text
        path.write_text(text.replace(*change), encoding="utf-8")
    with pytest.raises(BadInputError) as caught:
        read_finger_file(path)
    said = str(caught.value)
    assert said.startswith(f"finger file {path}: ")
    assert told in said
    assert "\n" not in said


POSTERIORS = {
    "a mean too many": ({"mean": (0.0, 0.0, 0.0, 0.0)}, "expected 3 means and 3 rows of 3 covariances"),
    "a short row": ({"covariance": ((1.0,), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))}, "expected 3 means and 3 rows of 3"),
    "one way": (
        {"covariance": ((1.0, 0.5, 0.0), (0.4, 1.0, 0.0), (0.0, 0.0, 1.0))},
        "covariance of ln_e_fat and ln_stiffness: expected the same both ways",
    ),
}  # fmt: skip


@pytest.mark.parametrize("wrong", POSTERIORS)
def test_a_posterior_is_whole(wrong: str) -> None:
    change, told = POSTERIORS[wrong]
    posterior = met_file().met.posterior
    with pytest.raises(ValueError, match=told):
        type(posterior).model_validate(posterior.model_dump() | change)
