"""`rig runs`, `rig show` and `rig export`: list runs, describe one, write its tables."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from itertools import groupby
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NotRequired

import typer

from rig.cli.choice_verdict import AdaptiveVerdictJson, choice_as_json, choice_lines
from rig.cli.options import JsonOption, RunArgument, checked_file, option
from rig.cli.output import THE_FINGER, busy, complain, out, print_json, writes_json
from rig.cli.recorded_run import recorded_run
from rig.cli.request import ExactlyOne, Rule, takes
from rig.data import dictionary
from rig.data.ending import EndingJson
from rig.data.folder import SCRIPT, FileSizeJson, replace_table
from rig.data.index import IndexEntry, RunFilter, listed
from rig.data.run import (
    PackageJson,
    Run,
    RunError,
    RunWarningJson,
    provenance_of,
    read_provenance,
    warnings_as_json,
)
from rig.data.run_status import RunStatus, State, reason_of
from rig.data.tables import (
    HOLD_COLUMNS,
    RUN_COLUMNS,
    Summary,
    alive,
    foreign_in_one_line,
    state_of,
    summary_of,
    tables,
)
from rig.errors import BadInputError
from rig.printable import on_one_line
from rig_shared.outputs import File, Name, Output, Settings, Shape, Time, Unit
from rig_shared.plural import number_of
from rig_shared.user_files import read_text, toml_of

if TYPE_CHECKING:
    from sim.models.fingertip import Fingertip

_DAY = "a day such as 2026-03-01"


class RunSummaryJson(Output):
    """A run."""

    name: Name
    date_utc: Time
    protocol: Name
    title: Name
    subject: Name
    shapes: list[Shape]
    state: State
    virtual: bool
    planned: int
    done: int
    duration_s: float
    damage_text: NotRequired[str]
    """Damage of its journal, and what is left out."""


class UnreadableJson(Output):
    """A folder that cannot be read."""

    name: Name
    problem_text: str


class RunsJson(Output):
    """All runs of a folder."""

    runs: list[RunSummaryJson]
    unreadable: list[UnreadableJson]
    table: NotRequired[File]
    holds: NotRequired[int]


class PressesJson(Output):
    """Holds with one indentor to one target."""

    indentor: Shape
    target_doi_mm: float | None
    target_force_gwt: float | None
    increment: bool
    """Whether the presses went on to a further target after these holds."""
    holds: int
    from_x_mm: float
    to_x_mm: float
    mean_force_gwt: float
    mean_doi_mm: float
    peak_gwt: float


class RunDevicesJson(Output):
    """Devices of a run, and the identities that they reported."""

    stage: NotRequired[Name]
    force: NotRequired[Name]
    controller: NotRequired[Name]
    sensor: NotRequired[Name]


class RunModelJson(Output):
    """Finger model of a run."""

    nodes: NotRequired[int]
    e_epidermis_mpa: NotRequired[float]
    from_cache: NotRequired[bool]


class ShowJson(Output):
    """A run."""

    run: File
    title: Name
    protocol: Name
    source_text: str
    parameters: Settings
    """Parameters of the protocol by their names."""
    subject: Name | None
    began_utc: Time
    duration_s: float
    virtual: bool
    state: State
    planned: int
    done: int
    ending: EndingJson | None
    presses: list[PressesJson]
    choice: NotRequired[AdaptiveVerdictJson]
    limits: Settings
    """Table [limits] of the configuration, and the soft trip of the plan."""
    devices: RunDevicesJson
    versions: list[PackageJson]
    model: RunModelJson | None
    files: list[FileSizeJson]
    warnings: NotRequired[list[RunWarningJson]]


class ColumnJson(Output):
    """A column of a run's tables."""

    table: Name
    name: Name
    unit: Unit
    dtype: Literal["bool", "text (UTF-8)", "float64"]
    what_text: str


class ColumnsJson(Output):
    """Columns of all tables."""

    columns: list[ColumnJson]


class ExportJson(Output):
    """Files that were written."""

    run: File
    files: list[File]
    warnings: NotRequired[list[RunWarningJson]]


@dataclass(frozen=True)
class RunsRequest:
    """Arguments and options of `rig runs`."""

    runs: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that contains the run folders.")] = Path("runs")
    subject: Annotated[str | None, option("List only runs of this subject.", "CODE")] = None
    shape: Annotated[
        str | None, option("List only runs with this indentor, e.g. bar:3.0; bar matches any bar.", "S")
    ] = None
    protocol: Annotated[str | None, option("List only runs of this protocol.", "NAME")] = None
    state: Annotated[str | None, option(f"List only runs in this state: {', '.join(RunStatus)}.", "STATE")] = None
    since: Annotated[str | None, option("First start date to list, UTC, e.g. 2026-03-01.", "DAY")] = None
    until: Annotated[str | None, option("Last start date to list, UTC, e.g. 2026-03-31.", "DAY")] = None
    table: Annotated[Path | None, option("Write a table of all holds, one row each, to this file.", "CSV")] = None
    as_json: JsonOption = False

    @property
    def filter(self) -> RunFilter:
        """The runs to list. Raises RunError, ShapeError."""
        if self.state not in (None, *RunStatus):
            raise RunError(f"--state {self.state!r}: must be one of {', '.join(RunStatus)}", "unknown_choice")
        days = _day("--since", self.since), _day("--until", self.until)
        return RunFilter(self.subject, _shape(self.shape), self.protocol, self.state, *days)


@takes(RunsRequest)
def runs_command(request: RunsRequest) -> None:
    """List runs, newest last; an unreadable or damaged run gets one line on standard error."""
    chosen, table = request.filter, request.table
    if table is not None:
        checked_file("--table", table, ".csv")
    entries = _entries(request.runs)
    found = [one for one in entries if not one.summary.problem and chosen.has(one.summary)]
    broken = [one.summary for one in entries if one.summary.problem]
    for listed_run in (one.summary for one in found if one.summary.damage):
        complain(f"{request.runs / listed_run.name}: {listed_run.damage}")
    if table is not None:
        replace_table(table, (*RUN_COLUMNS, *HOLD_COLUMNS), (row for one in found for row in one.rows))
    if writes_json():
        print_json(_runs_json(found, broken, table))
        return
    for one in broken:
        complain(f"{request.runs / one.name}: {one.problem}")
    out.print(
        _list(found)
        if table is None
        else f"{number_of(sum(len(one.rows) for one in found), 'holds')} of {_runs(found)}: {table}"
    )


def _entries(runs: Path) -> list[IndexEntry]:
    with busy(f"reading the runs in {runs} …", quick=True):
        try:
            return listed(runs)
        except OSError as error:
            raise RunError(
                f"{runs}: {error.strerror}; give the folder that contains the run folders", "no_such_folder"
            ) from None


def _day(option: str, text: str | None) -> date | None:
    try:
        return None if text is None else date.fromisoformat(text)
    except ValueError:
        raise RunError(f"{option} {text!r}: must be {_DAY}", "no_day") from None


def _shape(text: str | None) -> Callable[[str], bool] | None:
    if text is None:
        return None
    from sim.contact.shapes import shape_filter  # imports numpy, which a list of all runs does not need

    return shape_filter(text)


def _list(found: Sequence[IndexEntry]) -> str:
    """Return runs as aligned lines."""
    lines = [_line(one.summary) for one in found]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    padded = ("  ".join(word.ljust(width) for word, width in zip(line, widths, strict=True)) for line in lines)
    return "\n".join([*(line.rstrip() for line in padded), _runs(found)])


def _line(run: Summary) -> list[str]:
    shapes = f"{run.shapes[0]} and {len(run.shapes) - 1} more" if len(run.shapes) > 1 else "".join(run.shapes)
    done = f"{run.done} of {run.planned}"
    state = run.state + (", virtual" if run.virtual else "")
    return [on_one_line(text) for text in (run.name, run.subject or "-", shapes or "-", done, state)]


def _runs(found: Sequence[IndexEntry]) -> str:
    return number_of(len(found), "runs")


def _runs_json(found: Sequence[IndexEntry], broken: Sequence[Summary], table: Path | None) -> RunsJson:
    result: RunsJson = {
        "runs": [_summary(one.summary) for one in found],
        "unreadable": [{"name": one.name, "problem_text": one.problem} for one in broken],
    }
    if table is not None:
        result["table"], result["holds"] = str(table), sum(len(one.rows) for one in found)
    return result


def _summary(run: Summary) -> RunSummaryJson:
    found: RunSummaryJson = {
        "name": run.name,
        "date_utc": run.date_utc,
        "protocol": run.protocol,
        "title": run.title,
        "subject": run.subject,
        "shapes": list(run.shapes),
        "state": run.state,
        "virtual": run.virtual,
        "planned": run.planned,
        "done": run.done,
        "duration_s": run.duration_s,
    }
    return {**found, "damage_text": run.damage} if run.damage else found


_UNKNOWN = "unknown"


@dataclass(frozen=True)
class ShowRequest:
    """Arguments and options of `rig show`."""

    run: Annotated[Path | None, typer.Argument(metavar="RUN", help="Folder of the run.")] = None
    columns: Annotated[bool, option("Explain the columns of the run tables; takes no run.", name="--columns")] = False
    as_json: JsonOption = False

    rules: ClassVar[Sequence[Rule]] = (ExactlyOne(("RUN", "--columns")),)


@takes(ShowRequest)
def show_command(request: ShowRequest) -> None:
    """Print a run: protocol, state, limits, versions, forces, ending and files."""
    if request.run is None:
        if writes_json():
            print_json(_columns())
        else:
            out.print(dictionary.as_markdown(), end="")
        return
    with foreign_in_one_line(request.run):
        with busy("reading the run …", quick=True):
            result = _described(request.run)
        if writes_json():
            print_json(result)
        else:
            out.print("\n".join(f"{name:<12}{on_one_line(line)}" for name, line in _lines(result)))


def _columns() -> ColumnsJson:
    return {
        "columns": [
            {"table": table, "name": one.name, "unit": one.unit, "dtype": one.dtype, "what_text": one.what}
            for table, columns in dictionary.described_tables().items()
            for one in columns
        ]
    }


def _described(path: Path) -> ShowJson:
    return _run_as_json(recorded_run(path, prints_state=True))


def _run_as_json(run: Run) -> ShowJson:
    about = alive(summary_of(run), run.folder.path.parent)
    made = provenance_of(run)
    result: ShowJson = {
        "run": str(run.folder.path),
        "title": about.title,
        "protocol": about.protocol,
        "source_text": str(run.start.get("source", "")),
        "parameters": run.start.get("parameters", {}),
        "subject": about.subject or None,
        "began_utc": about.date_utc,
        "duration_s": about.duration_s,
        "virtual": about.virtual,
        "state": about.state,
        "planned": about.planned,
        "done": about.done,
        "ending": ending_of(run, about.state),
        "presses": _presses(run),
        "limits": {**_limits(run), "soft_trip_of_the_plan_n": run.start.get("soft_trip_n")},
        "devices": made.get("devices", {}) | _identities(run),
        "versions": [{"package": "python", "version": made.get("python", _UNKNOWN)}]
        + [{"package": name, "version": found} for name, found in made.get("versions", {}).items()],
        "model": made.get("model", {}),
        "files": [
            {"name": name, "bytes": (run.folder.path / name).stat().st_size} for name in sorted(run.folder.files)
        ],
    }
    if (choice := choice_as_json(run)) is not None:
        result["choice"] = choice
    if warnings := warnings_as_json([run]):
        result["warnings"] = warnings
    return result


def _limits(run: Run) -> dict[str, Any]:
    """Return the limits from the copy of the configuration; none without a readable copy."""
    try:
        found = toml_of(read_text(run.folder.config)).get("limits", {})
    except (OSError, ValueError):
        return {}
    return dict(found)


def ending_of(run: Run, state: str) -> EndingJson | None:
    """Return why an incomplete run ended, and the final position of the indentor."""
    if state in (RunStatus.DONE, RunStatus.RUNNING):
        return None
    # It imports the engine, which a completed run does not need.
    from rig.session.early_ending import Ending, FinalPosition

    if run.stop is None:
        return Ending.killed(run).as_json()
    at = FinalPosition(**run.stop["indentor"]) if "indentor" in run.stop else None
    words = None if at is None else at.words
    return {"reason_text": reason_of(state_of(run), run.stop), "where_text": words}


def ending_lines(run: Run) -> dict[str, str] | None:
    """Return the description of an early end for the report, or None."""
    state = state_of(run)
    if state in (RunStatus.DONE, RunStatus.RUNNING):
        return None
    from rig.session.early_ending import Ending  # It imports the engine, which a completed run does not need.

    return (Ending.killed(run) if run.stop is None else Ending.recorded(run, state)).lines


def _identities(run: Run) -> dict[str, str]:
    """Return the identities that the devices reported."""
    streams = {"controller": run.stream("home"), "sensor": run.stream("zero")}
    return {name: str(events[-1][name]) for name, events in streams.items() if events and name in events[-1]}


def _presses(run: Run) -> list[PressesJson]:
    """Return completed holds, grouped by indentor and target; those on the way to a further target apart."""
    rows = list(tables(run)["hold_end"].rows) if run.stream("hold_end") else []
    last = {row["index"]: row["hold"] for row in rows}
    target = ("indentor", "target_doi_mm", "target_force_gwt")
    kinds = [(*(row.get(name) for name in target), row["hold"] != last[row["index"]]) for row in rows]
    order = list(dict.fromkeys(kinds))
    together = groupby(sorted(zip(kinds, rows, strict=True), key=lambda one: order.index(one[0])), lambda one: one[0])
    return [_kind(kind, [row for _, row in members]) for kind, members in together]


def _kind(kind: tuple[Any, ...], rows: Sequence[Mapping[str, Any]]) -> PressesJson:
    indentor, target_doi_mm, target_force_gwt, increment = kind
    return {
        "indentor": indentor,
        "target_doi_mm": target_doi_mm,
        "target_force_gwt": target_force_gwt,
        "increment": increment,
        "holds": len(rows),
        "from_x_mm": min(row["x_mm"] for row in rows),
        "to_x_mm": max(row["x_mm"] for row in rows),
        "mean_force_gwt": fmean(row["force_gwt"] for row in rows),
        "mean_doi_mm": fmean(row["doi_mm"] for row in rows),
        "peak_gwt": max(row["peak_gwt"] for row in rows),
    }


def _lines(run: ShowJson) -> list[tuple[str, str]]:
    """Return name and text of each printed line."""
    size = sum(one["bytes"] for one in run["files"]) / 1e6
    return [
        ("run", run["run"]),
        ("what", f"{run['title']} ({run['protocol']}){', on the virtual bench' if run['virtual'] else ''}"),
        ("source", run["source_text"] or "-"),
        ("parameters", _pairs(run["parameters"])),
        ("subject", run["subject"] or "none"),
        ("began", f"{run['began_utc']}, {run['duration_s']:.0f} s"),
        ("state", f"{run['state']}, {run['done']} of {number_of(run['planned'], 'indentations')}"),
        *ended_lines(run["ending"]),
        *(("pressed" if n == 0 else "", _pressed(one)) for n, one in enumerate(run["presses"])),
        *(choice_lines(run["choice"]) if "choice" in run else ()),
        *((name, _pairs(run[name])) for name in ("limits", "devices")),
        ("versions", ", ".join(f"{one['package']} {one['version']}" for one in run["versions"])),
        ("model", _pairs(run["model"] or {})),
        ("files", f"{len(run['files'])}, {size:.1f} MB: {', '.join(one['name'] for one in run['files'])}"),
    ]


def ended_lines(ending: EndingJson | None) -> list[tuple[str, str]]:
    """Return name and text of the lines on an early end."""
    if ending is None:
        return []
    names = {"reason_text": "because", "where_text": "where", "next_text": "next", "resume": "resume"}
    return [(name, str(words)) for key, name in names.items() if (words := ending.get(key))]


def _pressed(one: PressesJson) -> str:
    unit, target = (
        ("mm", one["target_doi_mm"]) if one["target_doi_mm"] is not None else ("gwt", one["target_force_gwt"])
    )
    to = (_UNKNOWN if target is None else f"{target:g} {unit}") + ", on the way to more" * one["increment"]
    return (
        f"{one['indentor']} to {to}, x = {one['from_x_mm']:.2f} … {one['to_x_mm']:.2f} mm: "
        f"{number_of(one['holds'], 'holds')}, mean {one['mean_force_gwt']:.2f} gwt at {one['mean_doi_mm']:.3f} mm, "
        f"peak {one['peak_gwt']:.2f} gwt"
    )


def _pairs(values: Mapping[str, object]) -> str:
    found = {name: round(value, 6) if isinstance(value, float) else value for name, value in values.items()}
    return ", ".join(f"{name} {value}" for name, value in found.items()) or "none"


@dataclass(frozen=True)
class ExportRequest:
    """Arguments and options of `rig export`."""

    run: RunArgument
    as_csv: Annotated[bool, option("Write HDF5 and tidy CSV files.", name="--csv")] = False
    as_nwb: Annotated[bool, option("Write Neurodata Without Borders (needs the extra nwb).", name="--nwb")] = False
    report: Annotated[bool, option("Write the report again, with the strain under the skin.", name="--report")] = (
        False
    )
    as_json: JsonOption = False


@takes(ExportRequest)
def export_command(request: ExportRequest) -> None:
    """Export the journal again, also of a run that crashed, and renew the checksums of what is written."""
    from rig.data.export import export_nwb, export_run  # it imports numpy, which a list of runs does not need

    run = request.run
    if not (request.as_csv or request.as_nwb or request.report):
        raise BadInputError(
            "export: nothing to write; add --csv (HDF5 and CSV files), --nwb or --report", "no_format"
        )
    with busy("reading the run …", quick=True):
        found = recorded_run(run)
    if request.report:
        _refuse_identification(found)
    written = []
    if request.as_csv or request.as_nwb:
        with busy(f"writing the files of {run} …", quick=True), foreign_in_one_line(run):
            if request.as_csv:
                export_run(found)
                tables = (f"{stream}.csv" for stream in found.units if found.stream(stream))
                written += [str(found.folder.data), *(str(run / name) for name in tables)]
            if request.as_nwb:
                written.append(str(export_nwb(found)))
            found.folder.write_checksums()
    if request.report:
        with foreign_in_one_line(run), found.folder.owned():
            with busy(THE_FINGER):
                from rig.plan.config import load_config
                from sim.models.fingertip import Fingertip

                finger = Fingertip.load(load_config(found.folder.config).finger)
            written += [str(run / name) for name in renewed_report(found, finger, strain=True)]
    if writes_json():
        exported: ExportJson = {"run": str(run), "files": written}
        if warnings := warnings_as_json([found]):
            exported["warnings"] = warnings
        print_json(exported)
    else:
        out.print("\n".join(written))


def _refuse_identification(run: Run) -> None:
    if read_provenance(run.folder, "protocol")["protocol"] == SCRIPT:
        raise BadInputError(
            f"run folder {run.folder.path}: an identification has a page of its own, which cannot be made again "
            "from its journal",
            "identification",
        )


def renewed_report(run: Run, finger: "Fingertip", also: Collection[str] = (), *, strain: bool = False) -> list[str]:
    """Write the report of a finished run again; return the names of its files, the page first.

    With `strain`, the page shows the strain under the deepest press. The checksums of these files and of those in
    `also` are renewed; data, and their checksums, stay unchanged.
    """
    with busy("writing the report …"):
        from rig.report.run_report import AFTER, write_report
        from rig.report.strain_figure import strain_figures

        write_report(run, finger, None, ending_lines(run), strain_figures(run, finger) if strain else ())
    page = run.folder.report.name
    made = sorted(name for name in run.folder.files if name.startswith("model_") or name == AFTER)
    run.folder.add_checksums({page, *made, *also})
    return [page, *made]
