"""The lists of the keys of the configuration: defaults, kinds, bounds as decided.

tests/data/config_keys.txt has those of every configuration, tests/data/kind_keys.txt those of the own tables of kinds
of device, which stand only where the kind is named.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rig.devices.registry import BUILT_IN, KINDS, find
from rig.plan.config import Config

DECIDED = Path(__file__).parent / "data" / "config_keys.txt"
DECIDED_OF_KINDS = DECIDED.with_name("kind_keys.txt")


@dataclass(frozen=True)
class Key:
    """A row of the table. Lists of numbers are of one length, and each number is within the range."""

    name: str
    default: Any
    kind: str
    length: int | None
    lists: bool
    words: list[str]
    bounds: list[tuple[str, float]]

    def refuses(self, value: Any) -> bool:
        """Whether a configuration with this value, of a list all of these, is refused, and this key is named."""
        several = value if self.length is None or isinstance(value, list) else [value] * self.length
        place = self.name.split(".")
        tables = _own_table(place)
        inner = tables
        for name in place[:-1]:
            inner = inner.setdefault(name, {})
        inner[place[-1]] = [several] if self.lists else several
        try:
            Config.model_validate(tables)
        except ValidationError as error:
            return any(list(problem["loc"][: len(place)]) == place for problem in error.errors())
        return False


def _own_table(place: list[str]) -> dict[str, Any]:
    """A configuration that names the kind whose own table a key is in, with all of the table's defaults."""
    room, kind = place[:2] if len(place) > 2 else ("", "")
    settings = {f"{of.room}.{name}": find(of, name).settings for of in KINDS for name in BUILT_IN[of.room]}
    table = settings.get(f"{room}.{kind}")
    return {room: {"kind": kind, kind: table().model_dump()}} if table is not None else {}


def _table(decided: Path) -> Iterator[Key]:
    for line in decided.read_text(encoding="utf-8").splitlines()[2:]:
        name, default, many, allowed = re.split(r" {2,}", f"{line}  ")[:4]
        length = re.search(r"\d", many)
        kind = many.split()[-1].removesuffix("s") if length else many
        words = allowed.split() if kind == "word" else []
        number = float if kind == "number" else int
        bounds = [(sign, number(Fraction(n))) for sign, n in re.findall(r"([<>]=?) ([^,]+)", allowed)]
        found = int(length.group()) if length else None
        yield Key(name, value_of(default), kind, found, many.startswith("lists"), words, bounds)


def value_of(text: str) -> Any:
    """A default as it is written in the table."""
    try:
        return json.loads({"none": "null", "yes": "true"}.get(text, text))
    except json.JSONDecodeError:
        return text


TABLE = {key.name: key for key in _table(DECIDED)}
TABLE_OF_KINDS = {key.name: key for key in _table(DECIDED_OF_KINDS)}
