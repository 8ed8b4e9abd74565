"""The stage of a configuration for whoever only stops it: what is wrong elsewhere in the file is passed over."""

import re
import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rig.devices.bench_settings import BenchSettings, StageSettings
from rig.devices.catalogue import DEFAULTS, KindError, find
from rig.devices.kinds import StageKind
from rig.errors import RigError

_HEADER = re.compile(r"\s*\[+\s*[\"']?([A-Za-z_]\w*)")
_WHICH = ("kind", "port", "device_id")
_TRIES = 100  # values that are passed over


class NoStageError(RigError):
    """The file does not say which stage. One line."""

    default_code = "no_stage"


def stage_alone(path: Path) -> tuple[BenchSettings, tuple[str, ...]]:
    """Read [stage] of a configuration file, however wrong the rest of it is.

    A value of [stage] that is wrong is left at its default, unless it says what the stage is or where; the table of
    another kind is not read.

    Parameters
    ----------
    path : Path
        The configuration file.

    Returns
    -------
    tuple of (BenchSettings, tuple of str)
        Settings of which only the stage is read, and one line for each thing that was passed over.

    Raises
    ------
    NoStageError
        If the file cannot be read, or kind, port or device id are wrong.
    """
    tables, passed = _tables(path)
    stage = _of_its_kind(tables.get("stage", {}))
    for _ in range(_TRIES):
        try:
            return BenchSettings(stage=StageSettings.model_validate(stage)), tuple(passed)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = [str(key) for key in first["loc"]]
            wrong = NoStageError("config {path}: {key}: {problem}", code="invalid_value", path=str(path),
                                 key=".".join(["stage", *where]), problem=first["msg"])  # fmt: skip
            if not where or where[-1] in _WHICH or not _dropped(stage, where):
                raise wrong from None
            passed.append(str(wrong))
    raise NoStageError("config {path}: [stage] cannot be read", path=str(path))


def _tables(path: Path) -> tuple[dict[str, Any], list[str]]:
    try:
        text = path.read_bytes().decode("utf-8-sig", "replace")
    except OSError as error:
        problem = str(error.strerror or error)
        raise NoStageError("config {path}: {problem}", code="unreadable", path=str(path), problem=problem) from None
    try:
        return tomllib.loads(text), []
    except tomllib.TOMLDecodeError as error:
        whole = NoStageError("config {path}: not valid TOML: {problem}", code="no_toml", path=str(path),
                             problem=str(error))  # fmt: skip
    try:
        return tomllib.loads(_of_the_stage(text)), [str(whole)]
    except tomllib.TOMLDecodeError:
        raise whole from None


def _of_its_kind(stage: Any) -> Any:
    try:
        place = find(StageKind, stage.get("kind", DEFAULTS["stage"])).place
    except (AttributeError, KindError):
        return stage
    return {key: value for key, value in stage.items() if key == place or not isinstance(value, dict)}


def _of_the_stage(text: str) -> str:
    """The lines of [stage] and of the tables in it."""
    kept, inside = [], False
    for line in text.splitlines():
        header = _HEADER.match(line)
        if header is not None:
            inside = header[1] == "stage"
        if inside:
            kept.append(line)
    if not kept:
        raise tomllib.TOMLDecodeError("no [stage]")
    return "\n".join(kept)


def _dropped(table: Any, where: list[str]) -> bool:
    """Whether a value was there to be taken out: the innermost that is named, since a place may be inside a list."""
    inner = table
    for n, key in enumerate(where):
        if not isinstance(inner, dict) or key not in inner:
            return False
        if n == len(where) - 1 or not isinstance(inner[key], dict):
            del inner[key]
            return True
        inner = inner[key]
    return False
