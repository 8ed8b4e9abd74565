"""A command's options as one value: a field each, rules between them as a table, and the command that repeats it."""

import inspect
import shlex
from collections.abc import Callable, Sequence, Set
from dataclasses import MISSING, fields
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

from typer.models import ArgumentInfo, ParameterInfo

from rig.cli.options import bounded
from rig.cli.output import one_line_errors
from rig.errors import BadInputError
from rig.printable import either

R = TypeVar("R")


class Option(NamedTuple):
    """Field of a request, with its name on the command line; arguments have none."""

    field: str
    name: str
    hint: Any
    usual: Any  # MISSING if it is required
    within: tuple[float, float] | None  # lowest and highest value
    choices: tuple[str, ...]  # of a Literal; empty for any other type

    @property
    def label(self) -> str:
        """Name in sentences and rules; of an argument, its field in capitals."""
        return self.name or self.field.upper()

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
    """Make a function of a request a command, with an argument or option for each field of its dataclass.

    It refuses what breaks the rules of the class; errors become one line and the right exit code.
    """

    def command(carry_out: Callable[[R], None]) -> Callable[..., None]:
        def run(**given: Any) -> None:
            made = request(**given)
            with one_line_errors(as_json=getattr(made, "as_json", False)):
                refuse(made)
                carry_out(made)

        options = options_of(request)
        run.__signature__ = inspect.Signature([  # type: ignore[attr-defined]
            inspect.Parameter(
                one.field, inspect.Parameter.KEYWORD_ONLY, annotation=one.hint,
                default=inspect.Parameter.empty if one.usual is MISSING else one.usual,
            )
            for one in options
        ])  # fmt: skip
        run.__annotations__ = {one.field: one.hint for one in options}
        run.__doc__, run.__module__, run.__name__ = carry_out.__doc__, carry_out.__module__, carry_out.__name__
        run.request = request  # type: ignore[attr-defined]
        return run

    return command


class Excludes(NamedTuple):
    """Options that cannot be combined with `option`."""

    option: str
    others: Sequence[str]
    code: str = "cannot_combine"
    because: str = ""


class Alone(NamedTuple):
    """Option that cannot be combined with any other, but for some."""

    option: str
    but: Sequence[str]
    code: str = "cannot_combine"
    because: str = ""


class Needs(NamedTuple):
    """Option that has an effect only with one of others."""

    option: str
    others: Sequence[str]
    code: str = "needs_option"


class ExactlyOne(NamedTuple):
    """Options of which a request has one."""

    options: Sequence[str]
    code: str = "exactly_one"


Rule = Excludes | Alone | Needs | ExactlyOne
"""Rule between options; it names an option, an option with its value, as "--model auto", or an argument, as "RUN"."""


def refuse(request: object) -> None:
    """Raise BadInputError for the first broken rule of a request's class, or the first value that it refuses.

    A class whose options depend on a file refuses others in `refuse_first`, before a rule asks for more of them.
    """
    getattr(request, "refuse_first", lambda: None)()
    given = given_options(request)
    values = [f"{one.label} {getattr(request, one.field)}" for one in options_of(type(request))]
    rules: Sequence[Rule] = getattr(type(request), "rules", ())
    for rule in rules:
        if isinstance(rule, Alone):
            others = [one for one in given if one not in (rule.option, *rule.but)]
            rule = Excludes(rule.option, others, rule.code, rule.because)
        if (problem := _problem(rule, {*given, *values})) is not None:
            raise BadInputError(problem, rule.code)
    for one in options_of(type(request)):
        value = getattr(request, one.field)
        if one.choices and value not in (None, *one.choices):
            raise BadInputError(f"{one.label} {value!r}: must be {either(one.choices)}", "unknown_choice")
        if one.within is not None and value is not None:
            bounded(one.label, value, *one.within)


def _problem(rule: Excludes | Needs | ExactlyOne, given: Set[str]) -> str | None:
    """Return what is wrong with a request that has these options."""
    if isinstance(rule, ExactlyOne):
        *others, last = rule.options
        return f"give exactly one of {', '.join(others)} and {last}" if len(given & {*rule.options}) != 1 else None
    there = [one for one in rule.others if one in given]
    if rule.option not in given or bool(there) is isinstance(rule, Needs):
        return None
    if isinstance(rule, Needs):
        return f"{rule.option} requires {either(rule.others)}; add {'one' if len(rule.others) > 1 else 'it'}"
    why = rule.because and f": {rule.because}"
    return f"{rule.option} and {there[0]} cannot be combined{why}; remove one"


def given_options(request: object, *, without: Sequence[str] = ()) -> list[str]:
    """Return the names of the options that a request has, without some; of an argument, its field in capitals."""
    found = (one.label for one in options_of(type(request)) if one.is_given(request))
    return [label for label in found if label not in without]


def repeats(command: str, request: object, *, without: Sequence[str] = ()) -> str:
    """Return the command line of the same request, without some options."""
    kept = (one for one in options_of(type(request)) if one.name not in without)
    return shlex.join(["rig", command, *(word for one in kept for word in one.words(request))])


def options_of(request: type) -> list[Option]:
    """Return the arguments and options of a request, the required ones first."""
    hints, found = get_type_hints(request, include_extras=True), []
    for one in fields(request):
        info = next(about for about in get_args(hints[one.name]) if isinstance(about, ParameterInfo))
        declared = [word for word in (info.default, *(info.param_decls or ())) if isinstance(word, str)]
        name = next((word for word in declared if word.startswith("--")), f"--{one.name.replace('_', '-')}")
        name = "" if isinstance(info, ArgumentInfo) else name
        hint, choices = _hint_and_choices(hints[one.name])
        found.append(Option(one.name, name, hint, one.default, getattr(info, "within", None), choices))
    return sorted(found, key=lambda one: one.usual is not MISSING)


def _hint_and_choices(hint: Any) -> tuple[Any, tuple[str, ...]]:
    """Return the type that is parsed, and the choices: a Literal is parsed as text, and `refuse` compares it."""
    kind, info = get_args(hint)
    choices = next((get_args(one) for one in (kind, *get_args(kind)) if get_origin(one) is Literal), ())
    parsed = str | None if type(None) in get_args(kind) else str
    return (Annotated[parsed, info], choices) if choices else (hint, ())
