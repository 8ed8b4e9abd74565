"""`rig dry-run`: a protocol on the virtual bench."""

import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from rig.cli.output import ExitCode, complain, err, out, print_json, told_in_one_line
from rig.compare import write_report
from rig.protocol.config import load_config
from rig.protocol.errors import BadInputError
from rig.protocol.plan import make_plan
from rig.protocol.script import load_script
from rig.protocol.session import DryRun, Watch, dry_run
from rig.run import RunAborted
from sim.fingertip import Fingertip


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("dry-run", help="Run a protocol on virtual devices, over the wire protocol.")(command)


def command(
    protocol: Annotated[str, typer.Argument(help="A path, or the name of a shipped protocol.")],
    more: Annotated[list[str] | None, typer.Argument(metavar="[K=V]...", help="Further settings.")] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="K=V", help="A parameter; may be repeated.")
    ] = None,
    config: Annotated[Path | None, typer.Option(metavar="TOML", help="Configuration of rig and finger.")] = None,
    out_dir: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder in which the run makes its own.")
    ] = Path("runs"),
    speed: Annotated[str, typer.Option(metavar="max|N", help="Virtual seconds per real second.")] = "max",
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> None:
    """Check the script, run it on the virtual bench, write the run folder and its report."""
    with told_in_one_line(as_json=as_json):
        settings = load_config(config)
        script = load_script(protocol, [*(set_ or []), *(more or [])])
        pace = _pace(speed)
        with err.status("fingertip: from the cache, or built in about 15 s …"):
            finger = Fingertip.load(settings.finger)
        plan = make_plan(script, settings, finger)
        began = time.perf_counter()
        with _interruptible() as interrupted, _progress(len(plan.indentations)) as watch:
            done = dry_run(script, settings, finger, plan, out_dir, interrupted=interrupted, watch=watch, speed=pace)
        done.folder.write_checksums()
        report = write_report(done.run, finger, done.wall_s)
        done.folder.write_checksums()
        _print(done, report, time.perf_counter() - began, as_json=as_json)
    if done.problem is not None:
        complain(f"stopped: {done.problem}")
    raise typer.Exit(_exit_code(done))


def _print(done: DryRun, report: Path, wall_s: float, *, as_json: bool) -> None:
    if as_json:
        print_json(
            {
                "run": str(done.folder.path),
                "complete": done.complete,
                "indentations": done.indentations,
                "duration_s": done.duration_s,
                "wall_s": wall_s,
                "report": str(report),
            }
        )
    else:
        out.print(f"{done.indentations} indentations, {done.duration_s:.0f} s of bench time in {wall_s:.1f} s")
        out.print(f"run     {done.folder.path}\nreport  {report}")


def _exit_code(done: DryRun) -> ExitCode:
    if done.complete:
        return ExitCode.DONE
    return ExitCode.ABORTED if isinstance(done.problem, RunAborted) else ExitCode.STOPPED


def _pace(text: str) -> float | None:
    if text == "max":
        return None
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < 1e6:
        raise BadInputError(f"--speed {text!r}: expected max or a positive number")
    return value


@contextmanager
def _interruptible() -> Iterator[Callable[[], bool]]:
    """Ctrl-C (or SIGTERM) once asks for a stop at the next safe point; twice stops the program at once."""
    asked: list[bool] = []

    def ask(*_: object) -> None:
        asked.append(True)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        err.print("stopping at the next safe point; Ctrl-C again stops now")

    before = [(number, signal.signal(number, ask)) for number in (signal.SIGINT, signal.SIGTERM)]
    try:
        yield lambda: bool(asked)
    finally:
        for number, handler in before:
            signal.signal(number, handler)


@contextmanager
def _progress(total: int) -> Iterator[Watch]:
    """A bar on standard error, one tick an indentation, with the time left."""
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, TextColumn("left"), TimeRemainingColumn(), console=err, transient=True) as bar:
        task = bar.add_task("starting", total=total)

        def watch(stream: str, data: Mapping[str, Any]) -> None:
            if stream == "indentation_start":
                bar.update(task, description=f"{data['indentor']} at {data['x_mm']:+.2f} mm")
            elif stream == "indentation_end":
                bar.advance(task)

        yield watch
