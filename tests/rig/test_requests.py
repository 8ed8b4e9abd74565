"""The options of a command are one value, which its command line repeats and whose rules are a table."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass
from itertools import combinations
from pathlib import Path
from typing import Annotated, ClassVar

import pytest
import typer
from typer.testing import CliRunner

from rig.cli.options import JsonOption
from rig.cli.request import (
    Alone,
    ExactlyOne,
    Excludes,
    Needs,
    Option,
    Rule,
    given_options,
    options_of,
    refuse,
    repeats,
    takes,
)
from tests.program import Program, functions


@dataclass(frozen=True)
class Request:
    """One option of each kind."""

    runs: Annotated[list[Path] | None, typer.Argument(metavar="RUN...")] = None
    columns: Annotated[list[str] | None, typer.Option()] = None
    friction: Annotated[float, typer.Option()] = 0.0
    place_mm: Annotated[str | None, typer.Option()] = None
    exact: Annotated[bool, typer.Option("--exact")] = False
    out_file: Annotated[Path | None, typer.Option("--out")] = None
    seed: Annotated[int, typer.Option()] = 1
    as_json: JsonOption = False


def parsed(*words: str) -> Request:
    received = list[Request]()
    app = typer.Typer()
    app.command()(takes(Request)(received.append))
    result = CliRunner().invoke(app, list(words), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return received[0]


@pytest.mark.parametrize(
    "words",
    [
        (),
        ("run 1", "run2", "--columns", "position=x (mm)", "--columns", "rate=FR"),
        ("a", "--friction", "0.3", "--place-mm=-0.5,0.5", "--exact"),
        ("--friction", "1e-05", "--seed", "0"),
    ],
)
def test_the_command_that_repeats_a_request_parses_to_the_same_request(words: tuple[str, ...]) -> None:
    request = parsed(*words)
    rig, command, *again = shlex.split(repeats("compare", request))
    assert ((rig, command), parsed(*again)) == (("rig", "compare"), request)


def test_the_command_that_repeats_a_request_omits_output_options() -> None:
    request = parsed("a", "--out", "page.html", "--json", "--exact")
    assert repeats("compare", request, without=("--out", "--json")) == "rig compare a --exact"
    assert given_options(request, without=("--json",)) == ["RUNS", "--exact", "--out"]


class Ruled(Request):
    rules: ClassVar[Sequence[Rule]] = (
        Alone("--columns", ("--json",)),
        Excludes("--exact", ("--place-mm", "--seed")),
        Needs("--place-mm", ("RUNS", "--friction 2.0")),
        ExactlyOne(("--columns", "--exact", "--seed")),
    )


def test_options_that_keep_the_rules_are_not_refused() -> None:
    refuse(Ruled(columns=["a"], as_json=True))
    refuse(Ruled(seed=2, place_mm="1", runs=[Path("a")]))
    refuse(Ruled(seed=2, place_mm="1", friction=2.0))
    refuse(Ruled(exact=True, seed=1))


# --- rules between the options of every command ---


def _broken(rule: Rule, labels: Sequence[str]) -> list[tuple[str, ...]]:
    """Options that break a rule, each set as few as possible."""
    match rule:
        case Excludes(option, others):
            return [(option, other) for other in others]
        case Alone(option, but):
            return [(option, other) for other in labels if other not in (option, *but)]
        case Needs(option, others):
            return [(option, *dict.fromkeys(f"{other.split()[0]} other" for other in others if " " in other))]
        case ExactlyOne(options):
            return [(), *combinations(options, 2)]


def _completed(broken: tuple[str, ...], others: Sequence[Rule]) -> list[str]:
    """The same options with what the other rules need."""
    found = list(broken)
    for rule in sorted(others, key=lambda one: isinstance(one, ExactlyOne)):
        if isinstance(rule, Needs) and rule.option in found and not {*rule.others} & {*found}:
            found.append(rule.others[0])
        if isinstance(rule, ExactlyOne) and not {*rule.options} & {*found}:
            found.append(rule.options[0])
    return found


def _words(found: Sequence[str], options: Mapping[str, Option]) -> list[str]:
    """Words of a command line with these options, and with those that the command requires."""
    values: dict[str, str] = dict((*one.split(" ", 1), "3")[:2] for one in found)
    values = {label: "3" for label, one in options.items() if one.usual is MISSING} | values
    given = {label: [f"{label}={value}"] if options[label].name else [value] for label, value in values.items()}
    return [word for label, words in given.items() for word in ([label] if options[label].usual is False else words)]


def test_every_command_refuses_options_that_break_its_rules_before_any_work(
    program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    walked = set()
    for command, function in functions():
        request = getattr(function, "request", None)
        rules = getattr(request, "rules", ())
        options = {one.label: one for one in options_of(request)} if rules else {}
        for rule in rules:
            others = [other for other in rules if other is not rule]
            named = rule.options if isinstance(rule, ExactlyOne) else (rule.option, *rule[1])
            assert {one.split()[0] for one in named} <= options.keys(), (command, rule)
            for broken in _broken(rule, list(options)):
                words = [*command, *_words(_completed(broken, others), options), "--json"]
                ended = program(*words)
                assert (ended.code, ended.error_code) == (2, rule.code), words
                assert all(one in ended.complaint for one in broken[:1]), words
                walked.add((*command, *broken))
    assert {("indent", "--shape point", "--model other"), ("show",), ("compare", "--example", "RUNS")} <= walked
    assert len(walked) > 50
