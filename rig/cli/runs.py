"""`rig runs`: the runs of a folder, as a list or as one table of all their indentations."""

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict
from datetime import date
from pathlib import Path
from typing import Annotated

import typer

from rig.cli.options import JsonOption, checked_file
from rig.cli.output import complain, looking_busy, out, print_json, told_in_one_line
from rig.data.folder import replace_text
from rig.data.reader import RunError
from rig.data.run_index import Entry, listed
from rig.data.summary import HOLD_COLUMNS, RUN_COLUMNS, STATES, Summary
from rig.data.wanted import Wanted

_DAY = "a day such as 2026-03-01"


def command(
    runs: Annotated[Path, typer.Argument(metavar="[DIR]", help="The folder in which runs have theirs.")] = Path(
        "runs"
    ),
    subject: Annotated[str | None, typer.Option(metavar="CODE", help="Of this subject only.")] = None,
    shape: Annotated[str | None, typer.Option(metavar="S", help="That pressed bar:3.0, or any bar.")] = None,
    protocol: Annotated[str | None, typer.Option(metavar="NAME", help="Of this protocol only.")] = None,
    state: Annotated[str | None, typer.Option(metavar="STATE", help=", ".join(STATES) + ".")] = None,
    since: Annotated[str | None, typer.Option(metavar="DAY", help=f"Begun on it or later (UTC): {_DAY}.")] = None,
    until: Annotated[str | None, typer.Option(metavar="DAY", help="Begun on it or before.")] = None,
    table: Annotated[
        Path | None, typer.Option(metavar="CSV", help="All their holds into one file, a row for each.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List runs, the newest last; what is no readable run gets one line on standard error."""
    with told_in_one_line(as_json=as_json):
        if state not in (None, *STATES):
            raise RunError(
                "{option} {value!r}: expected one of {expected}",
                code="unknown_choice", option="--state", value=state, expected=", ".join(STATES),
            )  # fmt: skip
        wanted = Wanted(subject, shape, protocol, state, _day("--since", since), _day("--until", until))
        if table is not None:
            checked_file("--table", table)
        entries = _entries(runs)
        found = [one for one in entries if not one.summary.problem and wanted.has(one.summary)]
        broken = [one.summary for one in entries if one.summary.problem]
        if table is not None:
            replace_text(table, _as_csv(found))
        if as_json:
            print_json(_told(found, broken, table))
            return
        for one in broken:
            complain(f"{runs / one.name}: {one.problem}")
        out.print(
            _list(found)
            if table is None
            else f"{sum(len(one.rows) for one in found)} holds of {_runs(found)}: {table}"
        )


def _entries(runs: Path) -> list[Entry]:
    with looking_busy(f"reading the runs in {runs} …"):
        try:
            return listed(runs)
        except OSError as error:
            raise RunError(
                "{folder}: {problem}, expected the folder in which runs have theirs",
                code="no_such_folder",
                folder=runs,
                problem=error.strerror,
            ) from None


def _day(option: str, text: str | None) -> date | None:
    try:
        return None if text is None else date.fromisoformat(text)
    except ValueError:
        raise RunError(
            "{option} {value!r}: expected {expected}", code="no_day", option=option, value=text, expected=_DAY
        ) from None


def _list(found: Sequence[Entry]) -> str:
    """A line for each, in columns."""
    lines = [_line(one.summary) for one in found]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    padded = ("  ".join(word.ljust(width) for word, width in zip(line, widths, strict=True)) for line in lines)
    return "\n".join([*(line.rstrip() for line in padded), _runs(found)])


def _line(run: Summary) -> list[str]:
    shapes = f"{run.shapes[0]} and {len(run.shapes) - 1} more" if len(run.shapes) > 1 else "".join(run.shapes)
    done = f"{run.done} of {run.planned}"
    return [run.name, run.subject or "-", shapes or "-", done, run.state + (", virtual" if run.virtual else "")]


def _runs(found: Sequence[Entry]) -> str:
    return f"{len(found)} run{'' if len(found) == 1 else 's'}"


def _as_csv(found: Sequence[Entry]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*RUN_COLUMNS, *HOLD_COLUMNS])
    for one in found:
        writer.writerows(one.rows)
    return text.getvalue()


def _told(found: Sequence[Entry], broken: Sequence[Summary], table: Path | None) -> dict[str, object]:
    runs = [{name: value for name, value in asdict(one.summary).items() if name != "problem"} for one in found]
    told: dict[str, object] = {"runs": runs}
    told["unreadable"] = [{"name": one.name, "problem": one.problem} for one in broken]
    return told if table is None else told | {"table": str(table), "holds": sum(len(one.rows) for one in found)}
