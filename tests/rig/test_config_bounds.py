"""Every key of the configuration: its default, its kind, and the first value that is refused on either side.

tests/data/config_keys.txt says what was decided, and tests/data/kind_keys.txt of the own tables of kinds of device. A
bound that changes is a decision, and changes there.
"""

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel, ValidationError

from rig.devices.registry import BUILT_IN, KINDS, find
from rig.plan.config import Config
from tests.config_keys import TABLE, TABLE_OF_KINDS, Key, value_of

SAFETY = Path(__file__).parents[2] / "docs" / "safety_promises.md"
WRONG_KIND: dict[str, list[Any]] = {
    "number": ["high", math.nan, math.inf, -math.inf],
    "integer": [2.5, "high"],
    "text": [3, "", " "],
    "flag": ["perhaps"],
    "date": ["yesterday"],
    "word": ["elsewhere"],
    "characters": [3],
    "texts": ["#", [3], [""], ["#", ""]],
}


ALL = TABLE | TABLE_OF_KINDS
every_table = pytest.mark.parametrize("table", dict.fromkeys(name.rpartition(".")[0] for name in ALL))


def _keys_of(table: str) -> list[Key]:
    return [key for name, key in ALL.items() if name.rpartition(".")[0] == table]


def _so_long(key: Key, bound: float) -> Any:
    """A value at a bound: the number itself, or so many characters, which make a line with a reading."""
    return f"{{value}}{'x' * int(bound)}"[: int(bound)] if key.kind == "characters" else bound


@every_table
def test_every_key_refuses_the_first_value_beyond_its_bound_and_takes_the_last_within(table: str) -> None:
    for key, (sign, bound) in [(k, limit) for k in _keys_of(table) for limit in k.bounds]:
        outwards = -math.inf if ">" in sign else math.inf
        towards = outwards if "=" in sign else -outwards
        step = math.nextafter(bound, towards) - bound if key.kind == "number" else math.copysign(1, towards)
        last, first = (bound, bound + step) if "=" in sign else (bound + step, bound)
        assert not key.refuses(_so_long(key, last)), f"{key.name} = {last!r} is {sign} {bound:g}"
        assert key.refuses(_so_long(key, first)), f"{key.name} = {first!r} is not {sign} {bound:g}"


@every_table
def test_a_key_without_a_bound_takes_any_large_value(table: str) -> None:
    for key in _keys_of(table):
        if key.kind in ("number", "integer") and not key.lists:
            bounded = {sign[0] for sign, _ in key.bounds}
            far = [value for sign, value in ((">", -(10**9)), ("<", 10**9)) if sign not in bounded]
            assert not [value for value in far if key.refuses(value)], key.name


@every_table
def test_every_key_refuses_a_value_of_another_type(table: str) -> None:
    for key in _keys_of(table):
        assert not [value for value in WRONG_KIND[key.kind] if not key.refuses(value)], key.name
        assert not [word for word in key.words if key.refuses(word)], key.name
        if key.length:
            assert key.refuses([1.0] * (key.length - 1)), key.name
            assert key.refuses([1.0] * (key.length + 1)), key.name


def _defaults(settings: BaseModel, place: str = "") -> Iterator[tuple[str, Any]]:
    for name in type(settings).model_fields:
        value = getattr(settings, name)
        if isinstance(value, BaseModel):
            yield from _defaults(value, f"{place}{name}.")
        else:
            yield f"{place}{name}", list(value) if isinstance(value, tuple) else value


_TABLES = {".".join(name.split(".")[:2]) for name in TABLE}
REQUIRED = [name for name, key in TABLE.items() if key.default == "required"]


def _calibrations(without: str = "") -> dict[str, dict[str, dict[str, Any]]]:
    """A configuration with every calibration there may be, less one key."""
    tables: dict[str, dict[str, Any]] = {}
    for name in REQUIRED:
        _, what, part = name.split(".")
        if name != without:
            tables.setdefault(what, {})[part] = 1.0 if part == "value" else "2026-03-01"
    return {"calibration": tables}


def test_every_configuration_key_has_its_default_in_the_table() -> None:
    told = dict(_defaults(Config.model_validate(_calibrations())))
    assert told.pop("identified") is None  # a table that commands write: tests/rig/identify/test_finger_file.py
    assert list(told) == list(TABLE)
    assert {name: value for name, value in told.items() if name not in REQUIRED} == {
        name: key.default for name, key in TABLE.items() if name not in REQUIRED
    }
    assert not list(Config().calibration.measured())


def test_every_key_of_a_device_kind_has_its_default_in_the_table() -> None:
    """All but the tables of leadshine and laumas, which may stand in any configuration."""
    told: dict[str, Any] = {}
    for of in KINDS:
        for name in BUILT_IN[of.room]:
            kind = find(of, name)
            if kind.settings is not None and f"{of.room}.{kind.place}" not in _TABLES:
                told |= _defaults(kind.settings(), f"{of.room}.{kind.place}.")
    assert told == {name: key.default for name, key in TABLE_OF_KINDS.items()}
    assert list(told) == list(TABLE_OF_KINDS)


@pytest.mark.parametrize("name", REQUIRED)
def test_a_calibration_without_value_date_or_expiry_is_refused(name: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Config.model_validate(_calibrations(without=name))
    assert [(".".join(map(str, one["loc"])), one["type"]) for one in caught.value.errors()] == [(name, "missing")]


def test_the_safety_page_lists_every_limit_with_its_default() -> None:
    """docs/safety_promises.md: | `key`, `key` | default, default | what it does |"""
    rows = re.search(r"keys\s+of\s+`\[limits\]`:\n\n.*\n.*\n((\|.*\n)+)", SAFETY.read_text(encoding="utf-8"))
    assert rows
    told: dict[str, Any] = {}
    for row in rows[1].splitlines():
        keys, defaults, _ = (cell.strip() for cell in row.strip("|").split("|", 2))
        values = [re.sub(r"± (.*)", r"[-\1, \1]", default).strip("`") for default in defaults.split(", ")]
        told |= dict(zip(re.findall(r"`(\w+)`", keys), map(value_of, values), strict=True))
    assert {f"limits.{name}" for name in told} == {name for name in TABLE if name.startswith("limits.")}
    assert told == {name: TABLE[f"limits.{name}"].default for name in told}
