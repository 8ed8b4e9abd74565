"""The options of a command are one value, which its command line repeats and whose rules are a table."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from rig.cli.options import JsonOption
from rig.cli.request import Excludes, Needs, given_options, refuse, repeats, takes
from rig.errors import BadInputError
from tests.error_codes import raises


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
def test_the_line_that_repeats_a_request_makes_the_same_request(words: tuple[str, ...]) -> None:
    request = parsed(*words)
    rig, command, *again = shlex.split(repeats("compare", request))
    assert ((rig, command), parsed(*again)) == (("rig", "compare"), request)


def test_the_line_leaves_out_what_does_not_change_the_result() -> None:
    request = parsed("a", "--out", "page.html", "--json", "--exact")
    assert repeats("compare", request, without=("--out", "--json")) == "rig compare a --exact"
    assert given_options(request, without=("--json",)) == ["RUNS", "--exact", "--out"]


@pytest.mark.parametrize(
    ("words", "code", "shown"),
    [
        (("--place-mm", "1"), "needs_option", "--place-mm requires --columns; add it"),
        (("--exact", "--friction", "0.3"), "cannot_combine", "--exact and --friction cannot be combined; remove one"),
        (("--exact", "--friction", "0"), None, ""),
        (("--place-mm", "1", "--columns", "a"), None, ""),
    ],
)
def test_options_that_need_or_exclude_each_other_are_refused_by_name(
    words: tuple[str, ...], code: str | None, shown: str
) -> None:
    rules = [Needs("--place-mm", "--columns"), Excludes("--exact", ["--seed", "--friction"])]
    if code is None:
        refuse(parsed(*words), rules)
        return
    with raises(BadInputError, code, sentence=shown):
        refuse(parsed(*words), rules)
