"""Pressure on the skin is in kPa wherever the program prints or writes it; coding keeps the source's pseudo-units."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rig.cli.json_schemas import OUTPUTS, schema_of
from rig.compare.stimuli import CONTROL_UNITS
from rig.data.dictionary import MODEL_TABLES
from rig.data.schema import STREAMS
from rig.plan.config import Config
from rig.settings import LimitSettings
from rig.study.parameter_study import columns

ROOT = Path(__file__).parents[2]
IN_PSEUDO_UNITS = ("encode", "decode", "impulse", "shift-invariance")
"""Commands of the source's coding model, whose options take pseudo-units."""
FILES = ("rig", "docs", "examples", "tests/refusals")
SAYS = re.compile(r"pressures?\b[^.\n]{0,60}(N/cm²|pseudo|\bMPa\b)|N/cm²", re.IGNORECASE)
MAY_SAY = (
    *("rig/report/coding_figures.py", "rig/cli/encode.py", "rig/cli/decode.py", "rig/cli/coding_options.py"),
    *("rig/compare/pressure_formula.py", "examples/gallery/library/12_decode.py", "docs/coding.md"),
    *("docs/commands.md", "docs/decisions/", "docs/model.md", "docs/library.md"),
)
"""Pages and modules of coding, of the source's formula, and of what was renamed."""


def _json_keys() -> Iterator[tuple[str, str]]:
    for command in OUTPUTS:
        if command not in IN_PSEUDO_UNITS:
            yield from ((f"{command} --json", key) for key in _keys(schema_of(command)))


def _keys(schema: object) -> Iterator[str]:
    if isinstance(schema, dict):
        yield from schema.get("properties", {})
    for inner in schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ():
        yield from _keys(inner)


def _configuration() -> Iterator[tuple[str, str]]:
    yield from (("configuration", key) for key in _keys(Config.model_json_schema()))


def _csv_columns() -> Iterator[tuple[str, str]]:
    yield from ((f"{name}.csv", column) for name, columns in MODEL_TABLES.items() for column in columns)
    yield from ((f"{name}.csv", column) for name, columns in STREAMS.items() for column in columns)
    yield from (("study.csv", column) for column in columns([]))


WRITTEN: dict[str, Callable[[], Iterator[tuple[str, str]]]] = {
    "JSON": _json_keys,
    "configuration": _configuration,
    "CSV and journal": _csv_columns,
}


@pytest.mark.parametrize("where", WRITTEN)
def test_keys_and_columns_of_pressure_end_in_kpa(where: str) -> None:
    found = [(place, key) for place, key in WRITTEN[where]() if "pressure" in key and key != "pressure"]
    assert found
    assert not [(place, key) for place, key in found if not key.endswith("_kpa")]


def test_the_profile_of_a_press_is_in_kpa() -> None:
    profile = schema_of("indent")["$defs"]["PressureProfileJson"]["properties"]
    assert list(profile) == ["x_mm", "kpa"]
    assert CONTROL_UNITS["skin pressure"] == "kPa"


def test_no_page_and_no_sentence_has_another_unit() -> None:
    said = [
        (str(path.relative_to(ROOT)), found[0])
        for folder in FILES
        for path in sorted((ROOT / folder).rglob("*"))
        if path.suffix in (".py", ".md", ".txt", ".j2", ".js", ".html", ".toml")
        for line in path.read_text(encoding="utf-8").splitlines()
        if (found := SAYS.search(line)) and '"""' not in line and not line.lstrip().startswith("#")
    ]
    assert not [(path, words) for path, words in said if not path.startswith(MAY_SAY)]


@pytest.mark.parametrize(("old", "kpa"), [(30.0, 300.0), (0.5, 5.0), (60, 600.0)])
def test_a_configuration_of_0_2_keeps_its_limit(old: float, kpa: float) -> None:
    assert LimitSettings.model_validate({"max_pressure_n_cm2": old}).max_pressure_kpa == kpa


@pytest.mark.parametrize(
    "table",
    [{"max_pressure_n_cm2": 61}, {"max_pressure_n_cm2": "a"}, {"max_pressure_n_cm2": 3, "max_pressure_kpa": 30}],
)
def test_a_limit_that_cannot_be_read(table: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="max_pressure_kpa"):
        LimitSettings.model_validate(table)
