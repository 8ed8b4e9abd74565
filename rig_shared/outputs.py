"""Vocabulary of outputs: what a program prints as JSON is a `TypedDict` of these, beside the function that makes it.

Numbers are numbers. A quantity has its unit at the end of its key (`force_gwt`), or beside it in `unit`. Prose is in
keys that end in `_text`. Identifiers come from closed lists, or have a format that says whose names they are.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any, Union

from typing_extensions import TypedDict

UNITS = {
    "steps_per_mm": "steps/mm",
    "mm_per_n": "mm/N",
    "kpa": "kPa",
    "mm_s2": "mm/s²",
    "mm_s": "mm/s",
    "gwt": "gwt",
    "deg": "°",
    "rpm": "1/min",
    "mm": "mm",
    "um": "µm",
    "ms": "ms",
    "gb": "GB",
    "baud": "bit/s",
    "s": "s",
    "n": "N",
    "nm": "N·m",
    "bits": "bit",
    "g": "g",
}
"""Units by the end of a key of the configuration or of a run's tables; longer ends first (`mm_s` before `s`)."""

SUFFIXES: Mapping[str, str] = UNITS | {
    "mm2": "mm²",
    "n_per_mm": "N/mm",
    "cycles_per_mm": "1/mm",
    "pa_per_pseudo": "Pa per pseudo-unit",
    "mpa": "MPa",
    "pseudo": "pseudo-unit",
    "mb": "MB",
    "bytes": "bytes",
    "hz": "1/s",
}
"""Units by the end of a key of an output."""

DIMENSIONLESS = "1"
UNIT_FIELDS = (
    "", DIMENSIONLESS, *dict.fromkeys(SUFFIXES.values()),
    "pseudo-unit³", "1/pseudo-unit", "impulses/s",
)  # fmt: skip
"""Values of `unit`; empty where a value has none."""

FORMATS = ("name", "shape", "path", "port", "uri", "date-time", "date", "command-line", "toml", "code")
"""Formats of strings that are neither prose nor from a list."""


class Output(TypedDict):
    """An object of which every key is listed. A text below a key is not inherited: say such things of the class."""


# A plain dictionary, since a stop and the help do without pydantic; outside of the class, where mypy sees keys alone.
Output.__pydantic_config__ = {"extra": "forbid", "use_attribute_docstrings": True}  # type: ignore[attr-defined]


class Keywords:
    """Keywords that an annotated type adds to its JSON schema."""

    def __init__(self, **keywords: object) -> None:
        self._keywords = keywords

    def __get_pydantic_json_schema__(self, schema: Any, handler: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        """Return the schema of the type with these keywords."""
        return handler(schema) | self._keywords


def listed(words: Iterable[str]) -> Keywords:
    """Return the keyword of a closed list, for `Annotated[str, listed(...)]`."""
    return Keywords(enum=list(words))


Name = Annotated[str, Keywords(format="name")]
Shape = Annotated[str, Keywords(format="shape")]
File = Annotated[str, Keywords(format="path")]
Port = Annotated[str, Keywords(format="port")]
Uri = Annotated[str, Keywords(format="uri")]
Time = Annotated[str, Keywords(format="date-time")]
Day = Annotated[str, Keywords(format="date")]
CommandLine = Annotated[str, Keywords(format="command-line")]
Toml = Annotated[str, Keywords(format="toml")]
Code = Annotated[str, Keywords(pattern="^[a-z][a-z0-9_]*$", format="code")]
Unit = Annotated[str, listed(UNIT_FIELDS)]
Ratio = Annotated[float, Keywords(unit=DIMENSIONLESS)]
Setting = Any
"""A value of a configuration or of a protocol's parameter."""
Settings = dict[Annotated[str, Keywords(pattern="^[a-z][a-z0-9_]*$")], Setting]
"""A table of the configuration, or the parameters of a protocol."""
Range = tuple[float, float]
Ends = tuple[Ratio, Ratio]
Interval = tuple[float | None, float | None]
Places = list[float] | list[Range]
"""Places along the skin; of a sheet, x and z of each."""


def schema_of(title: str, outputs: Iterable[Any]) -> dict[str, Any]:
    """Return the JSON schema (2020-12) of an object that is one of these outputs."""
    from pydantic import TypeAdapter

    kinds: Any = Union[*outputs]
    found = TypeAdapter(kinds).json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title} | _plain(found)


def _plain(schema: Any) -> Any:
    """Return a schema without titles that only repeat keys, and with maps limited to the keys of their pattern."""
    if isinstance(schema, list):
        return [_plain(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    closed = {"additionalProperties": False} if "patternProperties" in schema else {}
    return closed | {key: _plain(one) for key, one in schema.items() if key != "title" or not isinstance(one, str)}
