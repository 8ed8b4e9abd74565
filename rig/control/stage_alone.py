"""Stage of a configuration file, whatever errors the rest of the file contains: a stop needs no more."""

import re
import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rig.devices.registry import DEFAULTS, KindError, KnownBench, StageKind, checked, find
from rig.errors import RigError, first_problem
from rig.settings import BenchSettings, StageSettings
from rig_shared.user_files import MOST_TOML_BYTES, read_bytes, toml_of

_HEADER = re.compile(r"\s*\[+\s*[\"']?([A-Za-z_]\w*)")
_WHICH = ("kind", "port", "device_id")
_TRIES = 100  # number of invalid values that may be skipped


class NoStageError(RigError):
    """Error of a file that does not identify the stage."""

    default_code = "no_stage"


def stage_alone(path: Path) -> tuple[BenchSettings, tuple[str, ...]]:
    """Read [stage] of a configuration file, whatever errors the rest contains, with one line for each skipped value.

    An invalid value gets its default. The table of another kind is not read. Raises NoStageError if the file cannot
    be read, or kind, port or device id are invalid.
    """
    tables, passed = _tables(path)
    stage = _of_its_kind(tables.get("stage", {}))
    for _ in range(_TRIES):
        try:
            return KnownBench(stage=checked(StageSettings, stage)), tuple(passed)
        except ValidationError as error:
            where = [str(key) for key in error.errors(include_url=False)[0]["loc"]]
            wrong = NoStageError(str(first_problem(f"config {path}", error, within="stage")), "invalid_value")
            if not where or where[-1] in _WHICH or not _dropped(stage, where):
                raise wrong from None
            passed.append(str(wrong))
    raise NoStageError(f"config {path}: [stage] cannot be read")


def _tables(path: Path) -> tuple[dict[str, Any], list[str]]:
    try:
        text = read_bytes(path, MOST_TOML_BYTES).decode("utf-8-sig", "replace")
    except OSError as error:
        problem = str(error.strerror or error)
        raise NoStageError(f"config {path}: {problem}", "unreadable") from None
    try:
        return toml_of(text), []
    except tomllib.TOMLDecodeError as error:
        whole = NoStageError(f"config {path}: not valid TOML: {error}", "no_toml")
    try:
        return toml_of(_of_the_stage(text)), [str(whole)]
    except tomllib.TOMLDecodeError:
        raise whole from None


def _of_its_kind(stage: Any) -> Any:
    try:
        place = find(StageKind, stage.get("kind", DEFAULTS["stage"])).place
    except (AttributeError, KindError):
        return stage
    return {key: value for key, value in stage.items() if key == place or not isinstance(value, dict)}


def _of_the_stage(text: str) -> str:
    """Return the lines of [stage] and of its tables."""
    found, inside = [], False
    for line in text.splitlines():
        header = _HEADER.match(line)
        if header is not None:
            inside = header[1] == "stage"
        if inside:
            found.append(line)
    if not found:
        raise tomllib.TOMLDecodeError("no [stage]")
    return "\n".join(found)


def _dropped(table: Any, where: list[str]) -> bool:
    """Remove an invalid value, and return whether there was one; a location inside a list removes the list."""
    inner = table
    for n, key in enumerate(where):
        if not isinstance(inner, dict) or key not in inner:
            return False
        if n == len(where) - 1 or not isinstance(inner[key], dict):
            del inner[key]
            return True
        inner = inner[key]
    return False
