"""A command's options as one value: a field each, rules between them as a table, and the command that repeats it."""

import inspect
import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import MISSING, fields
from typing import Any, NamedTuple, TypeVar, get_args, get_type_hints

from typer.models import ArgumentInfo, ParameterInfo

from rig.errors import BadInputError

R = TypeVar("R")


class _Option(NamedTuple):
    """Field of a request, with its name on the command line; arguments have none."""

    field: str
    name: str
    hint: Any
    usual: Any  # MISSING if it is required

    def is_given(self, request: object) -> bool:
        """Return whether a request has another value than without the option."""
        return bool(getattr(request, self.field) != self.usual)

    def words(self, request: object) -> list[str]:
        """Return the words of a command line that give the option its value; none for the usual one."""
        value = getattr(request, self.field)
        if not self.is_given(request) or value is None:
            return []
        if value is True:
            return [self.name]
        before = f"{self.name}=" if self.name else ""
        values = value if isinstance(value, list | tuple) else [value]
        return [f"{before}{one:.12g}" if isinstance(one, float) else f"{before}{one}" for one in values]


def takes(request: type[R]) -> Callable[[Callable[[R], None]], Callable[..., None]]:
    """Make a function of a request a command, with an argument or option for each field of its dataclass."""

    def command(carry_out: Callable[[R], None]) -> Callable[..., None]:
        def run(**given: Any) -> None:
            carry_out(request(**given))

        options = list(_options(request))
        run.__signature__ = inspect.Signature([  # type: ignore[attr-defined]
            inspect.Parameter(
                one.field, inspect.Parameter.KEYWORD_ONLY, annotation=one.hint,
                default=inspect.Parameter.empty if one.usual is MISSING else one.usual,
            )
            for one in options
        ])  # fmt: skip
        run.__annotations__ = {one.field: one.hint for one in options}
        run.__doc__, run.__module__, run.__name__ = carry_out.__doc__, carry_out.__module__, carry_out.__name__
        return run

    return command


class Excludes(NamedTuple):
    """Options that cannot be combined with `option`."""

    option: str
    others: Sequence[str]
    code: str = "cannot_combine"


class Needs(NamedTuple):
    """Option that has an effect only with another one."""

    option: str
    other: str


def refuse(request: object, rules: Sequence[Excludes | Needs]) -> None:
    """Raise BadInputError for the first rule between options that a request breaks."""
    given = {one.name for one in _options(type(request)) if one.is_given(request)}
    for rule in rules:
        if isinstance(rule, Needs) and rule.option in given and rule.other not in given:
            raise BadInputError(f"{rule.option} requires {rule.other}; add it", "needs_option")
        if isinstance(rule, Excludes) and rule.option in given:
            for other in (other for other in rule.others if other in given):
                raise BadInputError(f"{rule.option} and {other} cannot be combined; remove one", rule.code)


def given_options(request: object, *, without: Sequence[str] = ()) -> list[str]:
    """Return the names of the options that a request has, without some; of an argument, its field in capitals."""
    found = (one for one in _options(type(request)) if one.is_given(request))
    return [name for one in found if (name := one.name or one.field.upper()) not in without]


def repeats(command: str, request: object, *, without: Sequence[str] = ()) -> str:
    """Return the command line of the same request, without some options."""
    kept = (one for one in _options(type(request)) if one.name not in without)
    return shlex.join(["rig", command, *(word for one in kept for word in one.words(request))])


def _options(request: type) -> Iterator[_Option]:
    hints = get_type_hints(request, include_extras=True)
    for one in fields(request):
        info = next(found for found in get_args(hints[one.name]) if isinstance(found, ParameterInfo))
        declared = [word for word in (info.default, *(info.param_decls or ())) if isinstance(word, str)]
        name = next((word for word in declared if word.startswith("--")), f"--{one.name.replace('_', '-')}")
        yield _Option(one.name, "" if isinstance(info, ArgumentInfo) else name, hints[one.name], one.default)
