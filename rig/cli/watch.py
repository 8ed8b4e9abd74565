"""`rig watch`: live force, current and next step, and time left of a run in another process."""

from collections.abc import Mapping
from typing import Any

import typer
from rich.live import Live

from rig.cli.force_trace import ForceTrace, Screen, named
from rig.cli.options import JsonOption, RunArgument
from rig.cli.output import ExitCode, err, out, print_json, reporting_errors, resting, writes_json
from rig.cli.recorded_run import recorded_run
from rig.cli.runs import ended_lines, ending_of
from rig.clock import WallClock
from rig.data.documents import Document
from rig.data.ending import EndingJson
from rig.data.folder import RunFolder
from rig.data.run import Following, followed
from rig.data.run_state import RunFollower, as_clock
from rig.data.run_status import RunStatus, State
from rig.data.tables import alive, foreign_in_one_line, summary_of
from rig.printable import on_one_line
from rig.records import Phase
from rig_shared.outputs import File, Output
from rig_shared.plural import number_of

LOOK_S = 0.2


class WatchJson(Output):
    """Current state of a run."""

    run: File
    state: State
    done: int
    planned: int
    force_gwt: float | None
    doi_mm: float | None
    x_mm: float | None
    height_mm: float | None
    phase: Phase | None
    now_text: str | None
    next_text: str | None
    left_s: float | None
    ending: EndingJson | None


class RunScreen(RunFollower):
    """Screen of `rig watch`."""

    def __init__(self, folder: RunFolder) -> None:
        super().__init__(folder)
        self.force = ForceTrace(self)

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Process the next event."""
        super().event(stream, data)
        self.force.event(stream, data)

    def above(self) -> list[str]:
        """Return the lines above the force."""
        subject = f", subject {self.start['subject']}" if self.start.get("subject") else ""
        virtual = ", virtual bench" if self.start.get("virtual") else ""
        return [named("run", f"{self.folder.path.name}{subject}{virtual}")]

    def below(self) -> list[str]:
        """Return the lines below the force."""
        done = f"{len(self.finished)} of {'?' if self.planned is None else self.planned}"
        left = "time left unknown" if self.left_s is None else f"{as_clock(self.left_s)} left on the run's clock"
        return [named("now", self.now or "-"), named("next", self.next or "-"), named("done", f"{done}, {left}")]


@reporting_errors
def watch_command(
    run: RunArgument,
    as_json: JsonOption = False,
) -> None:
    """Print live force, current and next step, and time left until the run ends; in a pipe one line per event.

    With --json: the current state, at once.
    """
    shown = RunScreen(RunFolder(run))
    try:
        with foreign_in_one_line(run):
            if writes_json():
                shown.take(Following(shown.folder).new())
                print_json(_now(shown))
                return
            with resting():
                (_on_a_screen if out.is_terminal else _line_by_line)(shown)
            out.print("\n".join(_end(shown)))
    except KeyboardInterrupt:
        err.print("stopped monitoring; the run continues")
        raise typer.Exit(ExitCode.ABORTED) from None


def _on_a_screen(shown: RunScreen) -> None:
    clock, screen = WallClock(), Screen(shown.force, shown.above, shown.below)
    with Live(screen, console=out, auto_refresh=False) as live:
        for documents in followed(shown.folder, lambda: clock.wait_s(LOOK_S)):
            shown.take(documents)
            live.refresh()


def _line_by_line(shown: RunScreen) -> None:
    clock = WallClock()
    for documents in followed(shown.folder, lambda: clock.wait_s(LOOK_S)):
        shown.take(documents)
        for line in (line for document in documents for line in _line(document)):
            out.print(line)


def _line(document: Document) -> list[str]:
    """Return a line for each document, except descriptions of others."""
    if document["doc"] == "descriptor":
        return []
    of_an_event = document["doc"] == "event"
    name, data = (document["stream"], document["data"]) if of_an_event else (document["doc"], document)
    hidden = () if of_an_event else ("doc", "crc32", "uid", "seq", "t_s", "unix_s", "parameters")
    values = ", ".join(f"{key} {value}" for key, value in data.items() if value is not None and key not in hidden)
    return [f"{document['t_s']:10.3f}  {on_one_line(name):<18}  {on_one_line(values)}".rstrip()]


def _end(shown: RunScreen) -> list[str]:
    """Return the lines on the end of the run, or on its current state."""
    found = recorded_run(shown.folder.path, prints_state=True)
    about = alive(summary_of(found), shown.folder.path.parent)
    ended = ended_lines(ending_of(found, about.state))
    state = f"{about.state}, {about.done} of {number_of(about.planned, 'indentations')}"
    return [named(name, words) for name, words in (("state", state), *ended)]


def _now(shown: RunScreen) -> WatchJson:
    found = recorded_run(shown.folder.path, prints_state=True)
    about = alive(summary_of(found), shown.folder.path.parent)
    goes_on = about.state == RunStatus.RUNNING
    return {
        "run": str(shown.folder.path),
        "state": about.state,
        "done": about.done,
        "planned": about.planned,
        "force_gwt": shown.newest.get("force_gwt"),
        "doi_mm": shown.newest.get("doi_mm"),
        "x_mm": shown.newest.get("x_mm"),
        "height_mm": shown.newest.get("height_mm"),
        "phase": shown.newest.get("phase"),
        "now_text": shown.now if goes_on else None,
        "next_text": shown.next if goes_on else None,
        "left_s": shown.left_s if goes_on else None,
        "ending": ending_of(found, about.state),
    }
