"""Errors of the rig, and what is wrong in a table that a person wrote."""

import re
from collections.abc import Iterator
from difflib import get_close_matches
from reprlib import Repr
from typing import TYPE_CHECKING, Any, get_args

from rig_shared.errors import CodedError

if TYPE_CHECKING:  # a stop and the help do without pydantic
    from pydantic import BaseModel, JsonValue, ValidationError


class RigError(CodedError):
    """Error of the rig."""


class RuleError(RigError, ValueError):
    """Values that do not go together, found by a validator; its code survives the validation."""

    default_code = "invalid_value"


WRITTEN_BY_COMMANDS: "dict[str, JsonValue]" = {"written_by_commands": True}
"""Marks a key that only commands write."""

_SHORT = Repr()
_SHORT.maxlist = _SHORT.maxdict = 3
_SHORT.maxstring = _SHORT.maxother = 200


class BadInputError(RigError):
    """Invalid input; nothing has moved."""

    default_code = "bad_input"


_PLAIN = {
    "Value error, ": "",
    "Input should be": "must be",
    "a valid tuple": "a list",
    "a valid list": "a list",
    "a valid dictionary": "a table",
    "a valid string": "text",
    "a valid boolean": "true or false",
    "a valid integer": "a whole number",
    "a valid number": "a number",
    "a valid date": "a date, as 2026-03-01",
    "Tuple should have": "must have",
    " after validation": "",
    "Field required": "is required, but is missing",
}


def plain_rule(message: str) -> str:
    """Return a message of the validation library in the words of this program's other errors."""
    for theirs, ours in _PLAIN.items():
        message = message.replace(theirs, ours)
    return re.sub(r" or instance of \w+| or datetime, .*|, unable to (parse|interpret) .*", "", message)


def wrong_value(message: str, cause: BaseException | None) -> str:
    """Return a message in the words of this program's other errors, with the value that a validation refused."""
    from pydantic import ValidationError  # loaded only for an error, so that programs start fast

    problems = cause.errors() if isinstance(cause, ValidationError) else []
    return plain_rule(message) + "".join(f", got {Repr().repr(problem['input'])}" for problem in problems[:1])


def first_problem(
    where: str, error: "ValidationError", model: "type[BaseModel] | None" = None, within: str = ""
) -> BadInputError:
    """Return the first error of a validation, with its place and value; a misspelled key before the missing one.

    model: validated model; for an unknown key the most similar ones are suggested. within: name of its table.

    Codes: unknown_key, missing_key, invalid_value, invalid_table, or that of the error which a validator raised.
    """
    problems = error.errors()
    problem = problems[0]
    if problem["type"] == "missing":
        problem = next((other for other in problems if other["type"] == "extra_forbidden"), problem)
    loc = (*filter(None, [within]), *problem["loc"])
    place = _short(".".join(map(str, loc)))
    rule = problem["type"]
    if rule == "extra_forbidden":
        near = [] if model is None else _neighbours(problem["loc"], model)
        meant = f", did you mean {' or '.join(near)}?" if near else ""
        return BadInputError(f"{where}: {place}: there is no such key{meant}", "unknown_key")
    raised = problem.get("ctx", {}).get("error")
    code = raised.code if isinstance(raised, CodedError) else "missing_key" if rule == "missing" else None
    what = str(raised) if rule == "value_error" else plain_rule(problem["msg"])
    if rule == "missing" and isinstance(problem["loc"][-1], int):  # a number of a list
        place, what = _short(".".join(map(str, loc[:-1]))), "has too few values"
    if rule == "model_type" and model is not None and (table := _table_at(problem["loc"], model)) is not None:
        needed = [name for name, field in table.model_fields.items() if field.is_required()]
        what += f" with {', '.join(needed)}" if needed else ""
    if isinstance(problem["input"], dict):  # about a whole table: the message names the keys
        sentence = ": ".join(part for part in (where, place, what) if part)
        return BadInputError(sentence, code or "invalid_table")
    shown = _SHORT.repr(_as_lists(problem["input"]))
    return BadInputError(f"{where}: {place} = {shown}: {what}", code or "invalid_value")


def _as_lists(value: Any) -> Any:
    """Return a value as files write it, with lists for tuples."""
    return [_as_lists(one) for one in value] if isinstance(value, tuple) else value


def _short(place: str) -> str:
    """Return the name of a key, of an endless one its beginning."""
    return place if len(place) <= _LONGEST_KEY else f"{place[:_LONGEST_KEY]}…"


_LONGEST_KEY = 200


def _neighbours(place: tuple[str | int, ...], model: "type[BaseModel]") -> list[str]:
    """Return keys similar to the last one of a place: from its own table, else from any other."""
    table, wanted = _table_at(place[:-1], model) or model, str(place[-1])
    if len(wanted) > _LONGEST_KEY:
        return []
    near = get_close_matches(wanted, table.model_fields, n=2)
    everywhere = list(_keys(model))
    likely = get_close_matches(wanted, {key for key, _ in everywhere}, n=2)
    inside = ".".join(map(str, place[:-1])) + "."
    found = [full for name in likely for key, full in everywhere if key == name]
    return near or sorted(found, key=lambda full: not full.startswith(inside))[:2]


def _table_at(place: tuple[str | int, ...], model: "type[BaseModel]") -> "type[BaseModel] | None":
    """Return the innermost table on the way to a place, below the whole model."""
    table = None
    for name in map(str, place):
        fields = (table or model).model_fields
        table = (_table(fields[name].annotation) if name in fields else None) or table
    return table


def _keys(model: "type[BaseModel]", above: str = "") -> Iterator[tuple[str, str]]:
    """Yield every key of a model and its tables that a person writes, with its full name."""
    for name, field in model.model_fields.items():
        if field.json_schema_extra == WRITTEN_BY_COMMANDS:
            continue
        yield name, f"{above}{name}"
        inner = _table(field.annotation)
        if inner is not None:
            yield from _keys(inner, f"{above}{name}.")


def _table(annotation: Any) -> "type[BaseModel] | None":
    """Return the table type that a key holds, if any."""
    from pydantic import BaseModel

    kinds = (annotation, *get_args(annotation), *(inner for one in get_args(annotation) for inner in get_args(one)))
    return next((kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)), None)


class EngineError(RigError):
    """Error of a command that the engine could not carry out."""

    default_code = "engine_failed"


class LimitError(EngineError):
    """A step exceeds a limit; it did not move anything."""

    default_code = "beyond_limit"
    run_status = "limited"
    remedy = "change the protocol or the limit, then start a new run; a resumed run would reach the same limit"


class NotReadyError(EngineError):
    """Error of a command that is not allowed in the present state."""

    default_code = "not_allowed"


class TripError(EngineError):
    """A reading exceeded a trip: the stage was stopped until an operator resets it."""

    default_code = "tripped"
    run_status = "tripped"
    remedy = "check that the finger is unharmed, and find out what caused the trip"
    lift_code: str | None = None
    """Code of the error that ended the lift after the trip."""


class RecordError(EngineError):
    """Error of a journal that cannot be written, so that the run must not continue."""

    default_code = "not_recorded"


class LostRecordError(RecordError):
    """Error of a journal or byte log that is no longer at its path."""

    default_code = "record_lost"
    remedy = "find out who moved or deleted the files of the run, then resume"


class PressPaused(EngineError):  # noqa: N818
    """Exception for a pause during an indentation, which is then repeated from clearance."""

    default_code = "press_paused"


class LateReading(EngineError):  # noqa: N818
    """Exception for a force reading that came too late in a ramp, which is then repeated from clearance."""

    default_code = "late_reading"


class RunAborted(EngineError):  # noqa: N818
    """Exception for a stop by the operator; the indentor was lifted at the next safe point."""

    default_code = "run_aborted"
    run_status = "aborted"
    remedy = "check that the finger is unharmed"


class CountError(EngineError):
    """A count of spikes that cannot be right; the indentor is lifted."""

    default_code = "bad_count"
    remedy = "correct the counts, then resume"


class ScriptError(EngineError):
    """Error of a protocol that failed while it ran."""

    default_code = "script_failed"
    remedy = "correct the protocol, then start a new run; a resumed run would use its own copy of the protocol"
