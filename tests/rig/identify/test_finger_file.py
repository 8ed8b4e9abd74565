"""The file of a finger that was identified: what is written is read, and what is wrong is told in one line."""

import errno
import os
import re
import tomllib
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from rig.compare.plausible_fingers import read_plausible
from rig.errors import BadInputError, RigError, first_problem
from rig.plan.config import Config, load_config, with_finger
from rig.plan.finger_file import (
    Posterior,
    example_finger,
    fingers_of,
    read_finger_file,
)
from tests.error_codes import has_code, raises
from tests.rig.identify.finger_file import SERIES, identified_file


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "finger.toml"
    file.write_text(identified_file(relaxation=SERIES).as_toml(), encoding="utf-8")
    return file


def test_what_is_written_is_read(path: Path) -> None:
    assert read_finger_file(path) == identified_file(relaxation=SERIES)


def test_it_is_a_piece_of_a_configuration(path: Path) -> None:
    """So a run's own copy of its configuration keeps it, and a run that is taken up has it."""
    file = identified_file(relaxation=SERIES)
    config = load_config(path)
    assert (config.finger, config.identified, config.virtual.relaxation) == (file.finger, file.identified, SERIES)
    again = path.with_name("config.toml")
    again.write_text(config.as_toml(), encoding="utf-8")
    assert load_config(again) == config


def test_it_goes_before_a_configurations_finger_and_not_before_its_virtual_truth(path: Path) -> None:
    assert with_finger(Config(), None) == Config()
    quick = Config.model_validate({"virtual": {"relaxation": [[0.1, 0.5]], "stiffness": 1.5}})
    found = with_finger(quick, path)
    assert found.finger == identified_file().finger
    assert found.identified == identified_file(relaxation=SERIES).identified
    assert (found.virtual.relaxation, found.virtual.stiffness) == (((0.1, 0.5),), 1.5)
    assert with_finger(Config(), path).virtual.relaxation == SERIES


def test_likely_fingers_differ_in_their_tissue_alone() -> None:
    file = identified_file(stiffness=2.0)
    likely = fingers_of(file.finger, file.identified)
    assert [one.tissue.stiffness for one in likely] == [draw.stiffness for draw in file.identified.draw]
    assert [one.tissue.e_fat for one in likely] == [draw.e_fat for draw in file.identified.draw]
    assert {one.mesh for one in likely} == {file.finger.mesh}


def test_likely_fingers_keep_what_a_draw_does_not_name() -> None:
    file = identified_file()
    other = {"poisson": 0.45, "dermis_mm": 0.9, "bone": "elastic"}
    tissue = file.finger.tissue.model_copy(update=other)
    for one in fingers_of(file.finger.model_copy(update={"tissue": tissue}), file.identified):
        assert one.tissue.model_dump().items() >= other.items()


TO_THE_DRAWS = "stiffness = 0.9323938199059483\ne_dermis = "  # of the first of them
WRONG: dict[str, tuple[Any, str, dict[str, Any]]] = {
    "no file": (None, "unreadable", {"problem": os.strerror(errno.ENOENT)}),
    "no TOML": (("[identified]", "[identified"), "no_toml", {}),
    "another file": (("[identified", "[other"), "no_identified_table", {}),
    "no tissue": (
        ("e_fat = 0.1\n", "e_fat = 11.0\n"),
        "invalid_value", {"key": "finger.tissue.e_fat", "value": 11.0, "rule": "must be less than or equal to 10"},
    ),
    "beyond what is interpolated": (
        (TO_THE_DRAWS + "0.1", TO_THE_DRAWS + "0.01"),
        "beyond_interpolation",
        {
            "key": "identified.draw.0", "e_dermis": 0.01, "e_fat": pytest.approx(0.107251, rel=1e-5),
            "e_dermis_low": 0.04, "e_dermis_high": 0.64, "e_fat_low": 0.02,
        },
    ),
    "relaxes away": (("[0.2, 1.4]", "[0.9, 1.4]"), "no_prony_series", {"key": "relaxation"}),
    "a variance below 0": (
        ("4e-4", "-4e-4"), "negative_variance", {"key": "identified.posterior", "name": "x_mm", "variance": -4e-4},
    ),
    "hashes": (
        ('runs = ["one"]', 'runs = ["one", "two"]'),
        "not_one_hash_a_run", {"key": "identified", "runs": 2, "hashes": 1},
    ),
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_is_told_in_one_line(path: Path, wrong: str) -> None:
    change, code, fields = WRONG[wrong]
    if change is None:
        path.unlink()
    else:
        text = path.read_text(encoding="utf-8").replace("0.0004", "4e-4")
        assert change[0] in text
        path.write_text(text.replace(*change), encoding="utf-8")
    with raises(BadInputError, code, where=f"finger file {path}", **fields) as caught:
        read_finger_file(path)
    assert str(caught.value).startswith(f"finger file {path}: ")
    assert "\n" not in str(caught.value)


CHANGED = {
    "stiffness": ("stiffness = 1.0\n", "stiffness = 1.3\n"),
    "posterior": (r"\nmean = \[0\.0,", "\nmean = [0.5,"),
    "a draw deleted": (r"(?s)\[\[identified\.draw\]\].*?(?=\[\[identified\.draw\]\])", ""),
    "the flag deleted": ("flagged = .*\n", ""),
    "number of presses": ("presses = 8", "presses = 9"),
    "the checksum deleted": ("(?m)^sha256 = .*\n", ""),
}


@pytest.mark.parametrize("changed", CHANGED)
@pytest.mark.parametrize("read", [read_finger_file, load_config, read_plausible])
def test_an_identification_that_was_changed_by_hand_is_refused(
    tmp_path: Path, changed: str, read: Callable[[Path], object]
) -> None:
    file = identified_file(relaxation=SERIES)
    flagged = {"flagged": FLAGGED} if changed == "the flag deleted" else {}
    identified = file.identified.model_copy(update={"version": "0.3.0", **flagged})
    path = tmp_path / "finger.toml"
    text = file.model_copy(update={"identified": identified}).sealed().as_toml()
    pattern, by = CHANGED[changed]
    path.write_text(re.sub(pattern, by, text, count=1), encoding="utf-8")
    assert path.read_text(encoding="utf-8") != text
    with pytest.raises(RigError) as caught:
        read(path)
    has_code(caught.value, "changed_identification")


@pytest.mark.parametrize("read", [read_finger_file, load_config, read_plausible])
def test_an_identification_of_0_2_has_no_checksum_and_is_read_with_a_warning(
    path: Path, caplog: pytest.LogCaptureFixture, read: Callable[[Path], object]
) -> None:
    for _ in range(2):
        read(path)
    (record,) = caplog.records
    assert (record.name.split(".")[0], record.levelname) == ("rig", "WARNING")
    assert f"{path}" in record.getMessage()


def test_a_sealed_file_and_the_configuration_of_its_run_are_read(path: Path) -> None:
    file = identified_file(relaxation=SERIES).sealed()
    path.write_text("# a comment does not matter\n" + file.as_toml(), encoding="utf-8")
    assert read_finger_file(path) == file
    config = path.with_name("config.toml")
    config.write_text(with_finger(Config(), path).as_toml(), encoding="utf-8")
    assert load_config(config).identified == file.identified


POSTERIORS: dict[str, tuple[Any, str, dict[str, Any]]] = {
    "a mean too many": ({"mean": (0.0, 0.0, 0.0, 0.0)}, "not_one_for_each_name", {"names": 3}),
    "a short row": (
        {"covariance": ((1.0,), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))}, "not_one_for_each_name", {"names": 3},
    ),
    "ends exchanged": (
        {"low": (0.0, 0.2, 0.0), "high": (0.0, 0.1, 0.0)}, "low_above_high", {"name": "ln_e_fat"},
    ),
    "one way": (
        {"covariance": ((1.0, 0.5, 0.0), (0.4, 1.0, 0.0), (0.0, 0.0, 1.0))},
        "not_symmetric", {"name": "ln_e_fat", "other": "ln_stiffness"},
    ),
}  # fmt: skip


@pytest.mark.parametrize("wrong", POSTERIORS)
def test_a_posterior_is_whole(wrong: str) -> None:
    change, code, fields = POSTERIORS[wrong]
    posterior = identified_file().identified.posterior
    with pytest.raises(ValidationError) as caught:
        type(posterior).model_validate(posterior.model_dump() | change)
    has_code(first_problem("", caught.value), code, **fields)


@pytest.mark.parametrize(("off", "accepted"), [(0.5e-6, True), (-2e-6, False)])
def test_a_covariance_is_symmetric_but_for_round_off(off: float, accepted: bool) -> None:
    """Relative to the standard deviations, 2 and 3 here."""
    posterior = {"names": ("a", "b"), "mean": (0.0, 0.0), "covariance": ((4.0, 3.0), (3.0 + 6.0 * off, 9.0))}
    with nullcontext() if accepted else pytest.raises(ValidationError):
        Posterior.model_validate(posterior)


def test_a_band_is_as_stored_or_that_of_the_normal_distribution() -> None:
    posterior = Posterior(names=("a", "b"), mean=(1.0, 2.0), covariance=((4.0, 0.0), (0.0, 9.0)))
    assert posterior.band("b", 0.9) == pytest.approx((2.0 - 3.0 * 1.6448536, 2.0 + 3.0 * 1.6448536))
    half = posterior.model_copy(update={"low": (0.0, 1.0)})
    assert half.band("b", 0.9) == posterior.band("b", 0.9)
    stored = half.model_copy(update={"high": (3.0, 4.0)})
    assert [stored.band(name, 0.9) for name in ("a", "b")] == [(0.0, 3.0), (1.0, 4.0)]


FLAGGED = "it is far harder than any finger of the prior"


@pytest.mark.parametrize("as_configuration", [False, True])
def test_a_finger_that_nothing_explains_needs_force(tmp_path: Path, as_configuration: bool) -> None:
    """A comparison has no such option: it takes ranges of one's own."""
    file = identified_file()
    flagged = file.model_copy(update={"identified": file.identified.model_copy(update={"flagged": FLAGGED})})
    path = tmp_path / "finger.toml"
    path.write_text(flagged.as_toml(), encoding="utf-8")
    config, finger = (load_config(path), None) if as_configuration else (Config(), path)
    with raises(BadInputError, "flagged", why=FLAGGED):
        with_finger(config, finger)
    assert with_finger(config, finger, force=True).identified == flagged.identified
    with raises(BadInputError, "flagged", where=f"--fingers {path}", why=FLAGGED):
        read_plausible(path)


def test_the_example_finger_has_the_keys_of_its_file_and_no_defaults() -> None:
    file = Path(__file__).parents[3] / "examples" / "human_finger" / "finger.toml"
    table = tomllib.loads(file.read_text(encoding="utf-8"))["finger"]
    found = example_finger()
    assert found.keys() == table.keys()
    assert {name: found[name].keys() for name in ("geometry", "tissue")} == {
        name: table[name].keys() for name in ("geometry", "tissue")
    }
