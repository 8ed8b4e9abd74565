"""Pressure on the skin is in kPa wherever the program prints or writes it; coding keeps the source's pseudo-units."""

from collections.abc import Callable, Iterator

import pytest

from rig.cli.json_schema import OUTPUTS, schema_of_command
from rig.data.dictionary import MODEL_TABLES
from rig.data.events import STREAMS
from rig.plan.config import Config
from rig.settings import LimitSettings
from rig.study.parameter_study import columns

IN_PSEUDO_UNITS = ("encode", "decode", "impulse", "shift-invariance")
"""Commands of the source's coding model, whose options take pseudo-units."""


def _json_keys() -> Iterator[tuple[str, str]]:
    for command in OUTPUTS:
        if command not in IN_PSEUDO_UNITS:
            yield from ((f"{command} --json", key) for key in _keys(schema_of_command(command)))


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


@pytest.mark.parametrize(("old", "kpa"), [(30.0, 300.0), (0.5, 5.0), (60, 600.0)])
def test_a_pressure_limit_in_n_cm2_from_version_0_2_is_read_as_kpa(old: float, kpa: float) -> None:
    assert LimitSettings.model_validate({"max_pressure_n_cm2": old}).max_pressure_kpa == kpa


@pytest.mark.parametrize(
    "table",
    [{"max_pressure_n_cm2": 61}, {"max_pressure_n_cm2": "a"}, {"max_pressure_n_cm2": 3, "max_pressure_kpa": 30}],
)
def test_an_invalid_or_doubled_pressure_limit_is_refused(table: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="max_pressure_kpa"):
        LimitSettings.model_validate(table)
