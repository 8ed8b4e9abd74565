"""Every figure and table of the source that the model can be asked about: `claims.toml`, read.

Matrix, page, tables and `docs/validation/source.md` come from this list.
"""

import ast
import tomllib
from collections.abc import Iterator, Mapping
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from studies.source.printed import answers
from studies.source.printed.answers import PrintedPress
from studies.source.printed.entry import Claim, Entry
from studies.source.printed.rules import Above, Below, Near, Rule, Same, Within

CLAIMS = Path(__file__).with_name("claims.toml")
_RULES: dict[str, type[Any]] = {"near": Near, "within": Within, "below": Below, "above": Above}


def entries(path: Path = CLAIMS) -> Iterator[Entry]:
    """Yield the entries of a file. Raises KeyError and AttributeError for what is not there."""
    for one in tomllib.loads(path.read_text(encoding="utf-8"))["entry"]:
        scenes = [scene for expression in one.pop("presses", ()) for scene in _scenes(_value(expression))]
        functions = {key: _value(one.pop(key)) for key in ("figures", "tables") if key in one}
        claims = tuple(map(_claim, one.pop("claims", ())))
        yield Entry(**one, claims=claims, scenes=tuple(scenes), **functions)


def _claim(one: dict[str, Any]) -> Claim:
    beside = _value(one["beside"]) if "beside" in one else None
    return Claim(one["says"], one["source"], _rule(one), _value(one["ours"]), one.get("form", "{:.2f}"), beside)


def _rule(one: Mapping[str, Any]) -> Rule:
    if "same" in one:
        return Same(*map(tuple, one["same"]))
    (name,) = one.keys() & _RULES.keys()
    rule: Rule = _RULES[name](*one[name])
    return rule


def _scenes(value: object) -> Iterator[PrintedPress]:
    """The presses in a value: itself, or those within it."""
    if isinstance(value, PrintedPress):
        yield value
    elif isinstance(value, dict | list | tuple):
        for part in value.values() if isinstance(value, dict) else value:
            yield from _scenes(part)


def _value(expression: str) -> Any:
    """MODULE.NAME, MODULE.NAME['key'], MODULE.FUNCTION(key=value), or a press: deep(…), forced(…)."""
    return _of(ast.parse(expression, mode="eval").body)


def _of(node: ast.expr) -> Any:
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        return getattr(import_module(f"studies.source.printed.{node.value.id}"), node.attr)
    if isinstance(node, ast.Subscript):
        return _of(node.value)[ast.literal_eval(node.slice)]
    if isinstance(node, ast.Call):
        keywords = {str(word.arg): _of(word.value) for word in node.keywords}
        if isinstance(node.func, ast.Name):
            return getattr(answers, node.func.id)(*map(_of, node.args), **keywords)
        return partial(_of(node.func), **keywords)
    return ast.literal_eval(node)


ENTRIES: tuple[Entry, ...] = tuple(entries())


def named(keys: list[str]) -> tuple[Entry, ...]:
    """Those of some keys, all without any. Raises KeyError with the first that there is none of."""
    by_key = {entry.key: entry for entry in ENTRIES}
    return tuple(by_key[key] for key in keys) or ENTRIES
