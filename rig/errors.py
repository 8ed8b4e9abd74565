"""Bad input, told in one line: what, where, and what was expected."""

from collections.abc import Iterator
from difflib import get_close_matches
from reprlib import Repr
from typing import Any, get_args

from pydantic import BaseModel, JsonValue, ValidationError

from rig.errors import RigError, is_coded

WRITTEN_BY_COMMANDS: dict[str, JsonValue] = {"written_by_commands": True}
"""Marks the field of a table that no person writes."""

_SHORT = Repr()
_SHORT.maxlist = _SHORT.maxdict = 3
_SHORT.maxstring = _SHORT.maxother = 200


class BadInputError(RigError):
    """Something the user gave is not usable; nothing has moved."""

    default_code = "bad_input"


def first_problem(where: str, error: ValidationError, model: type[BaseModel] | None = None) -> BadInputError:
    """The first complaint of a validation, with the place and the value it is about.

    model: what was validated; an unknown key is then told with its nearest neighbours.

    Codes: unknown_key, missing_key, invalid_value, invalid_table, or that of the error which a validator raised.
    Fields: where, key, value, rule (the validation's own name for it), and the rule's bounds.
    """
    problem = error.errors()[0]
    place = ".".join(str(part) for part in problem["loc"])
    rule = problem["type"]
    if rule == "extra_forbidden":
        near = [] if model is None else _neighbours(problem["loc"], model)
        meant = f", did you mean {' or '.join(near)}?" if near else ""
        return BadInputError("{where}: {key}: there is no such key{meant}", code="unknown_key", where=where,
                             key=place, near=near, meant=meant)  # fmt: skip
    context = problem.get("ctx", {})
    raised = context.get("error")
    fields = {name: bound for name, bound in context.items() if name != "error"}
    code = {"missing": "missing_key"}.get(rule)
    if raised is not None and is_coded(raised):
        fields, code = dict(raised.fields), raised.code
    what = str(raised) if rule == "value_error" else problem["msg"].lower()
    fields |= {"where": where, "key": place, "rule": rule, "problem": what}
    if isinstance(problem["input"], dict):  # about a whole table: the message says which keys
        parts = ("{where}" if where else "", "{key}" if place else "", "{problem}" if what else "")
        return BadInputError(": ".join(part for part in parts if part), code=code or "invalid_table", **fields)
    fields |= {"value": problem["input"], "shown": _SHORT.repr(problem["input"])}
    return BadInputError("{where}: {key} = {shown}: {problem}", code=code or "invalid_value", **fields)


def _neighbours(place: tuple[str | int, ...], model: type[BaseModel]) -> list[str]:
    """Keys that look like the last one of a place: in its own table, else in any other one."""
    table, wanted = model, str(place[-1])
    for name in place[:-1]:
        inner = _table(table.model_fields[str(name)].annotation) if str(name) in table.model_fields else None
        table = inner or table
    near = get_close_matches(wanted, table.model_fields, n=2)
    everywhere = dict(_keys(model))
    return near or [everywhere[key] for key in get_close_matches(wanted, everywhere, n=2)]


def _keys(model: type[BaseModel], above: str = "") -> Iterator[tuple[str, str]]:
    """Every key of a model and of its tables that a person writes, with its whole place."""
    for name, field in model.model_fields.items():
        if field.json_schema_extra == WRITTEN_BY_COMMANDS:
            continue
        yield name, f"{above}{name}"
        inner = _table(field.annotation)
        if inner is not None:
            yield from _keys(inner, f"{above}{name}.")


def _table(annotation: Any) -> type[BaseModel] | None:
    """The table that a key holds, or may hold."""
    kinds = (annotation, *get_args(annotation))
    return next((kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)), None)
