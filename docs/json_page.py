"""What commands print with `--json` as a page, with a schema of each command to download, read off the program."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rig.cli.json_schema import OUTPUTS, schema_of_command
from rig.cli.program import COMMANDS
from rig_shared.outputs import SUFFIXES

HERE = Path(__file__).parent
_HEAD = """\
# JSON

A command with `--json` prints exactly one JSON object on standard output, and everything else on standard error. Each
command has a [JSON schema](https://json-schema.org) (2020-12) that lists every key of every object; `rig COMMAND
--json-schema` prints it.

- Numbers are numbers. A quantity has its unit at the end of its key, e.g. `force_gwt`, or beside it in `unit` where a
  row mixes quantities. Counts and ratios have no unit; in the schema, `"unit": "1"` marks ratios.
- Prose is in keys that end in `_text`. It may change in any version: match other keys.
- Other text comes from a list, or its `format` says what it is: a `name` that a person, device or package chose, a
  `shape` as in `rig indent`, a `code` of an error.

Units at the end of a key: {units}.

The examples are shortened to two items of each list, and numbers to six digits.

## A failure

Every command can print this instead, and exits with `exit_code`.

```json
{{
 "error_text": "limits.max_dio_mm: there is no such key; use limits.max_doi_mm",
 "code": "unknown_key",
 "exit_code": 2
}}
```
"""
_SKIPPED = ("FailureJson", "NotStoppedJson")
Named = Mapping[str, Any]


def json_page() -> str:
    """Every command with an example and a table of its keys."""
    units = ", ".join(f"`_{end}` ({said})" for end, said in SUFFIXES.items())
    return _HEAD.format(units=units) + "".join("".join(_command(name)) for name in COMMANDS if name in OUTPUTS)


def write_schemas(folder: Path) -> None:
    """Write a file with the schema of each command."""
    folder.mkdir(exist_ok=True)
    for name in OUTPUTS:
        text = json.dumps(schema_of_command(name), indent=1, ensure_ascii=False)
        (folder / f"{name}.json").write_text(f"{text}\n", encoding="utf-8")


def _command(name: str) -> Iterator[str]:
    schema = schema_of_command(name)
    named, example = schema["$defs"], (HERE / "json_examples" / f"{name}.json").read_text(encoding="utf-8")
    yield f"\n## `rig {name} --json`\n\n{COMMANDS[name].line} {{download}}`Schema <json_schemas/{name}.json>`\n"
    yield f"\n```json\n{example}```\n"
    for output in schema["anyOf"]:
        which = output["$ref"].removeprefix("#/$defs/")
        if which not in _SKIPPED:
            yield f"\n{named[which]['description']}\n\n| key | value | what it is |\n|---|---|---|\n"
            yield from _rows(named[which], named, "")


def _rows(schema: Named, named: Named, place: str) -> Iterator[str]:
    for key, found in schema["properties"].items():
        inner, lists = _inner(found, named)
        absent = "" if key in schema.get("required", ()) else ", may be absent"
        about = " ".join(filter(None, (found.get("description", ""), (inner or {}).get("description", ""))))
        whole = f"{place}{key}{'[]' * lists}"
        yield f"| `{whole}` | {_value(found, named)}{absent} | {_cell(about)} |\n"
        if inner is not None:
            yield from _rows(inner, named, f"{whole}.")


def _inner(found: Named, named: Named) -> tuple[Named | None, int]:
    """The object in a value, and how many lists it is in."""
    for one in found.get("anyOf", [found]):
        if "$ref" in one:
            return named[one["$ref"].removeprefix("#/$defs/")], 0
        if "items" in one:
            inner, lists = _inner(one["items"], named)
            return inner, lists + 1 if inner is not None else 0
    return None, 0


def _value(found: Named, named: Named) -> str:
    return _cell(" or ".join(dict.fromkeys(_kind(one, named) for one in found.get("anyOf", [found]))))


def _kind(one: Named, named: Named) -> str:
    if "$ref" in one:
        return "object"
    if "const" in one:
        return f"`{one['const']}`"
    if "enum" in one:
        return ", ".join(f"`{word}`" for word in one["enum"]) if len(one["enum"]) <= _MOST else "from a list"
    if "anyOf" in one:
        return _value(one, named)
    if one.get("type") == "array":
        items = one.get("prefixItems", [one["items"]] if "items" in one else [])
        return f"list of {_value(items[0], named)}" if items else "list"
    return str(one.get("format", one.get("type", "any value")))


_MOST = 9


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
