"""Schemas of what commands print with --json: every command has one, keys and values are named by its rules."""

import json
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from rig.cli.json_schemas import FORMATS, OUTPUTS, SUFFIXES, UNIT_FIELDS, schema_of
from rig.cli.output import one_line_errors, print_json
from rig.cli.program import COMMANDS
from tests.program import as_in_its_schema
from tests.rig.test_public_interface import commands_with

EXAMPLES = Path(__file__).parents[2] / "docs" / "json_examples"
Schema = Mapping[str, Any]
Field = tuple[str, str, Schema, Schema]
"""Command, key, its schema, and the properties beside it."""


def fields(command: str) -> Iterator[Field]:
    """Every property of every object that a command prints."""
    schema = schema_of(command)
    for one in schema["$defs"].values():
        for key, found in one["properties"].items():
            yield command, key, found, one["properties"]


def leaves(schema: Schema) -> Iterator[Schema]:
    """What a value may be, whatever lists it is in; not the values of a map, whose keys are of a configuration."""
    for one in schema.get("anyOf", [schema]):
        if one.get("type") == "array":
            for inner in one.get("prefixItems", [one["items"]] if "items" in one else []):
                yield from leaves(inner)
        elif "anyOf" in one:
            yield from leaves(one)
        else:
            yield one


@cache
def all_fields() -> list[Field]:
    return [field for command in OUTPUTS for field in fields(command)]


def has_unit(key: str, found: Schema, beside: Mapping[str, Any]) -> bool:
    """Whether a number's unit is known."""
    at_the_end = any(key == unit or key.endswith(f"_{unit}") for unit in SUFFIXES)
    return at_the_end or bool({"unit", f"{key}_unit"} & set(beside)) or found.get("unit") == "1"


def test_every_command_with_json_has_a_schema() -> None:
    assert set(commands_with("as_json")) == set(OUTPUTS) <= set(COMMANDS)


def test_objects_have_no_other_keys() -> None:
    for command in OUTPUTS:
        assert [name for name, one in schema_of(command)["$defs"].items() if one["additionalProperties"]] == []


def test_keys_are_in_snake_case() -> None:
    assert [
        (command, key) for command, key, *_ in all_fields() if not re.fullmatch("[a-z][a-z0-9]*(_[a-z0-9]+)*", key)
    ] == []


def test_numbers_have_a_unit() -> None:
    wrong = {
        (command, key)
        for command, key, schema, beside in all_fields()
        for one in leaves(schema)
        if one.get("type") == "number" and not has_unit(key, one, beside)
    }
    assert wrong == set()


def test_units_are_from_one_list() -> None:
    for command, key, schema, _ in all_fields():
        if key == "unit" or key.endswith("_unit"):
            for one in leaves(schema):
                assert set(one.get("enum", [one.get("const", "")])) <= set(UNIT_FIELDS), (command, key)


def test_text_is_prose_or_from_a_list_or_has_a_format() -> None:
    """Prose is in keys that end in _text, which hold nothing else."""
    for command, key, schema, _ in all_fields():
        for one in leaves(schema):
            named = "enum" in one or "const" in one or one.get("format") in FORMATS
            if one.get("type") == "string":
                assert key.endswith("_text") != named, (command, key)
            elif key.endswith("_text"):
                assert one.get("type") == "null", (command, key)


def test_maps_are_only_of_settings() -> None:
    """Of a protocol, a table of the configuration, or units by measure."""
    maps = {key for _, key, schema, _ in all_fields() for one in leaves(schema) if one.get("type") == "object"}
    assert maps == {"parameters", "limits", "mesh", "unit"}


@pytest.mark.parametrize("command", OUTPUTS)
def test_the_example_is_as_its_schema_says(command: str) -> None:
    as_in_its_schema(command, json.loads((EXAMPLES / f"{command}.json").read_text(encoding="utf-8")))


def test_what_a_script_prints_is_not_beside_the_object(capsys: pytest.CaptureFixture[str]) -> None:
    for as_json in (True, False):
        with one_line_errors(as_json=as_json):
            print("asked")
            if as_json:
                print_json({"run": "r"})
        there = capsys.readouterr()
        assert (there.out, there.err) == (('{"run": "r"}\n', "asked\n") if as_json else ("asked\n", ""))
