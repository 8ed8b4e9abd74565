"""`rig config`: every key told, as a file, a reference and JSON; one key or table; what a file sets."""

import re
from pathlib import Path

import pytest

from rig.plan.config import ABSENT, Config, keys, load_config
from rig.settings import LimitSettings
from tests.config_keys import TABLE
from tests.program import Ended, Program

REFERENCE = Path(__file__).parents[2] / "docs" / "configuration.md"
CALIBRATED = """\
[limits]
max_doi_mm = 1.0
[calibration.x_steps_per_mm]
value = -401.5
date = 2026-03-01
expires = 2027-03-01
[sync]
output = "spindle"
"""


def _described(limit: str) -> str:
    return LimitSettings.model_fields[limit].description or ""


def _whole() -> Config:
    """A configuration that sets every optional table."""
    measured = {"value": 1.0, "date": "2026-03-01", "expires": "2026-03-02"}
    names = {name.split(".")[1] for name in TABLE if name.startswith("calibration.")}
    return Config.model_validate({"calibration": dict.fromkeys(names, measured)})


def test_rig_config_describes_every_key_once_in_one_line() -> None:
    told = list(keys(_whole()))
    assert {key.place for key in told} == set(TABLE)
    assert len(told) == len(TABLE)
    for key in [*told, *keys(Config())]:
        assert re.fullmatch(r"[^\n|]{5,110}(?<![.])", key.what), f"{key.place}: {key.what!r}"
        assert key.allowed, key.place


def test_the_output_of_rig_config_is_a_file_that_loads_as_the_same_configuration(
    program: Program, tmp_path: Path
) -> None:
    for text in ("", CALIBRATED):
        (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
        ended = program("config", "--config", tmp_path / "rig.toml")
        assert ended.code == 0
        (tmp_path / "printed.toml").write_text(ended.out, encoding="utf-8")
        assert load_config(tmp_path / "printed.toml") == load_config(tmp_path / "rig.toml")
        assert ended.out.count("by default") == text.count(" = ")


def test_the_configuration_page_is_the_output_of_rig_config_markdown(program: Program) -> None:
    assert program("config", "--markdown").out == REFERENCE.read_text(encoding="utf-8"), (
        "rig config --markdown > docs/configuration.md"
    )


def test_rig_config_prints_one_key_or_one_table_by_name(program: Program) -> None:
    of_a_key = f"[limits]\n# {_described('max_doi_mm')} (mm, number > 0, ≤ 2)\nmax_doi_mm = 1.5\n"
    for name in ("max_doi_mm", "limits.max_doi_mm"):
        assert program("config", name) == Ended(0, of_a_key, "")
    heads = re.findall(r"^\[(.*)\]$", program("config", "finger").out, flags=re.M)
    assert heads == ["finger", "finger.geometry", "finger.tissue", "finger.mesh", "finger.contact"]
    assert program("config", "stage.framing").out.endswith(f"(rtu | tcp)\n# framing = {ABSENT}\n")


def test_rig_config_prints_a_value_from_a_file_beside_the_default(program: Program, tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(CALIBRATED, encoding="utf-8")
    words = ["config", "max_doi_mm", "--config", tmp_path / "rig.toml"]
    assert program(*words).out.endswith("(mm, number > 0, ≤ 2; by default 1.5)\nmax_doi_mm = 1.0\n")
    (told,) = program(*words, "--json").json["keys"]
    assert told == {
        "key": "limits.max_doi_mm", "value": 1.0, "default": 1.5, "unit": "mm", "allowed_text": "number > 0, ≤ 2",
        "what_text": _described("max_doi_mm"),
    }  # fmt: skip


@pytest.mark.parametrize(("key", "near"), [("sof_trip_n", "soft_trip_n"), ("ß", "rig config")])
def test_rig_config_suggests_the_nearest_key_for_an_unknown_one(program: Program, key: str, near: str) -> None:
    ended = program("config", key, "--json")
    assert (ended.code, ended.error_code) == (2, "unknown_key")
    assert near in ended.complaint
