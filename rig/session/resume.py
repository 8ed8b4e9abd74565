"""Stopped runs, read to resume them, and the provenance of a run: versions, command, devices."""

import platform
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from functools import reduce
from importlib.metadata import version
from operator import getitem
from pathlib import Path
from typing import Any

from rig.clock import WallClock
from rig.data import FolderBusyError, Run, RunError, RunFolder, read_run
from rig.data.documents import JournalError
from rig.data.folder import IDENTIFICATION_PAGE, SCRIPT, UnwritableError
from rig.data.journal import mend_journal
from rig.data.run import read_provenance
from rig.data.run_time import resumed_s
from rig.data.tables import FOREIGN, foreign_in_one_line
from rig.devices.registry import StageKind, find, stage_ports
from rig.engine import RunAborted
from rig.engine.bench_memory import BenchMemory
from rig.errors import BadInputError
from rig.plan.config import Config, config_from, load_config
from rig.plan.finger_model import about_model
from rig.protocol.script import Script, script_with
from rig.session.early_ending import Ending, FinalPosition
from sim.finger_process import Finger, asked


@dataclass(frozen=True)
class StoppedRun:
    """Stopped run from its folder: its own script, parameters, configuration and journal.

    `run` is None if the program ended before it journalled anything.
    """

    folder: RunFolder
    script: Script
    config: Config
    virtual: bool
    run: Run | None
    subject: str | None = None

    @property
    def begins_at_s(self) -> float:
        """Time of the run (`t_s`) at which a part begins now; the clock of a virtual run stops between its parts."""
        if self.run is None:
            return 0.0
        since_start_s = WallClock().unix_s() - self.run.start["unix_s"]
        return resumed_s(self.run.end_s, 0.0 if self.virtual else since_start_s)

    @property
    def complete(self) -> bool:
        """Whether all steps are done."""
        return self.run is not None and self.run.complete


def read_stopped(path: Path) -> StoppedRun:
    """Read a run folder and mend its journal. Raises BadInputError, FolderBusyError, UnwritableError."""
    folder = RunFolder(path)
    try:
        with folder.owned(), foreign_in_one_line(path):
            return _read(folder)
    except UnwritableError:
        raise
    except OSError as error:
        raise BadInputError(
            f"run folder {path}: cannot read {error.filename}: {error.strerror}; give a run folder", "no_run_folder"
        ) from None
    except (RunError, JournalError) as error:
        raise BadInputError(str(error), error.code) from None


def with_ports(stopped: StoppedRun, path: Path) -> StoppedRun:
    """Return the run with the ports of a configuration file. Raises BadInputError if anything else differs.

    A device may be plugged into another port; what decides a press may not change.
    """
    entry = find(StageKind, stopped.config.stage.kind)
    ports = {"stage.port", "force.port", *(f"stage.{entry.place}.{key}" for key in entry.further_ports)}
    new = load_config(path)
    if stopped.config.sync.adapter is not None and new.sync.adapter is not None:
        ports.add("sync.output")
    own, given = (dict(_flat(one.model_dump(mode="json"))) for one in (stopped.config, new))
    others = sorted(key for key in own.keys() | given.keys() if own.get(key) != given.get(key) and key not in ports)
    if others:
        key = others[0]
        raise BadInputError(
            f"config {path}: {key} = {given.get(key)}, but {own.get(key)} in the run; when it is resumed, only "
            f"{', '.join(sorted(ports))} may change",
            "other_settings",
        )
    tables = stopped.config.model_dump(mode="json", exclude_none=True)
    for name in ports & given.keys():
        *place, key = name.split(".")
        reduce(getitem, place, tables)[key] = given[name]
    return replace(stopped, config=config_from(f"config {path}", tables, path.parent))


def _flat(tables: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield each key of nested tables with its place, and its value."""
    for key, value in tables.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


def _refuse_foreign(run: Run) -> None:
    """Raise an error in `FOREIGN` if the journal lacks what a resumed run needs."""
    for needed in ("done", "missing", "repeated", "contact_s"):
        getattr(run, needed)


def _never_planned(run: Run) -> bool:
    """Return whether the run was stopped during planning, so that its remaining steps are unknown."""
    stopped_while = None if run.stop is None else run.stop.get("stopped_while")
    return not run.start["planned_indentations"] and stopped_while == "planning"


def _results(folder: RunFolder) -> str:
    """Return where the results of an identification are, in words."""
    page = folder.path / IDENTIFICATION_PAGE
    if page.exists():
        return f"its result is in its finger file and in {page}"
    return "its presses remain in its journal"


def _read(folder: RunFolder) -> StoppedRun:
    changed = folder.changed()
    if changed:
        raise BadInputError(
            f"run folder {folder.path}: {', '.join(changed)} changed since the run began, so it cannot be "
            "resumed; start a new run",
            "changed_since",
        )
    about = read_provenance(folder, "protocol", "parameters", "virtual")
    if about["protocol"] == SCRIPT:
        raise BadInputError(
            f"run folder {folder.path}: an identification cannot be resumed; repeat `rig identify`. In this run, "
            f"{_results(folder)}",
            "identification",
        )
    if about.get("choose"):
        raise BadInputError(
            f"run folder {folder.path}: an adaptive run of an earlier version (--choose) cannot be resumed; design "
            "its script again, and start a new run",
            "earlier_choice",
        )
    copy = folder.path / "protocol.py"
    mend_journal(folder.events)
    run = read_run(folder.path) if folder.events.exists() and folder.events.stat().st_size else None
    if run is not None:
        _refuse_foreign(run)
    if run is not None and run.damage and run.damage[0].line == 1:
        raise BadInputError(
            f"run folder {folder.path}: {folder.events.name}, line 1: {run.damage[0].problem}; it gives the soft "
            "trip, so resuming is refused; put back an undamaged copy, or start a new run; `rig export` reads "
            "the presses",
            "start_damaged",
        )
    if run is not None and _never_planned(run):
        raise BadInputError(
            f"run folder {folder.path} was stopped during planning and cannot be resumed; start a new run",
            "never_planned",
        )
    return StoppedRun(
        folder=folder,
        script=script_with(copy, Path(about["protocol"]).stem, about["parameters"]),
        config=load_config(folder.config),
        virtual=about["virtual"],
        run=run,
        subject=about.get("subject"),
    )


def left_on_record(runs: Path, config: Config) -> str | None:
    """Return a warning from the recorded contact of the bench and the end of the last run, or None.

    Without a record of the bench, only the journals in runs/ count.
    """
    return careful_of(last_ending(runs, config), config)


def careful_of(left: Ending | None, config: Config) -> str | None:
    """Return the same warning for a run with this ending; none after a lift, which is confirmed again by force."""
    record = BenchMemory(config).read()
    known = record.aged_contact(None)
    ended = None if left is None else f"{left.reason}; the indentor was {left.at.words}; {left.next} ({left.resume})"
    if known is None:
        return ended
    if record.is_lifted:
        return None
    return f"{known.words}; {known.to_do}" if ended is None else f"{ended}; on record: {known.words}"


def last_ending(runs: Path, config: Config) -> Ending | None:
    """Return the ending of the last real run on this stage, if the indentor may still touch the finger.

    `runs` is the folder of run folders. A run that another process carries out does not count.
    """
    folders = sorted(runs.iterdir(), reverse=True) if runs.is_dir() else []
    ports = set(stage_ports(config.stage))
    for folder in map(RunFolder, folders):
        try:
            about = read_provenance(folder, "virtual")
            if about["virtual"] or not ports & set(stage_ports(load_config(folder.config).stage)):
                continue
            with folder.owned():
                return ending_on_record(read_run(folder.path))
        except FolderBusyError:
            return None
        except (OSError, *FOREIGN, BadInputError, RunError):
            continue
    return None


def ending_on_record(run: Run) -> Ending | None:
    """Return the ending of a run if it left the indentor where it may touch, else None."""
    if run.killed:
        return Ending.killed(run)
    assert run.stop is not None
    if "indentor" not in run.stop:
        return None
    at = FinalPosition(**run.stop["indentor"])
    return Ending.of(RunAborted(run.stop["reason"]), at, run.folder.path) if at.may_touch else None


def first_reference_gwt(run: Run) -> list[float] | None:
    """Return the forces of the first reference press that was compared (gwt)."""
    compared = {event["index"] for event in run.stream("reference")}
    forces = {(e["index"], e["hold"]): e["force_gwt"] for e in run.stream("reference_hold_end")}
    first = min(compared, default=None)
    return None if first is None else [force for (index, _), force in sorted(forces.items()) if index == first]


_PATIENCE_S = 5.0
_PACKAGES = ("indentation-rig", "numpy", "scipy", "h5py", "pydantic", "matplotlib")


def provenance(
    script: Script, config: Config, finger: Finger | None, now: datetime, *, virtual: bool, subject: str | None = None
) -> dict[str, Any]:
    """Return the provenance of a run, for `rig resume` and later readers; finger: None before it is loaded."""
    prefix = "virtual " if virtual else ""
    return {
        "started_utc": now.isoformat(timespec="seconds"),
        "command": ["rig", *sys.argv[1:]],
        "protocol": script.path.name,
        "parameters": script.parameters.model_dump(mode="json"),
        **({"beside": sorted(script.beside)} if script.beside else {}),
        "subject": subject,
        "virtual": virtual,
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "versions": {name: version(name) for name in _PACKAGES},
        "commit": commit(Path(__file__)),
        "model": None if finger is None else asked(finger, about_model),
        "devices": {"stage": f"{prefix}{config.stage.kind}", "force": f"{prefix}{config.force.kind}"},
    }


def commit(file: Path) -> str | None:
    """Return the commit of a file of this program, with a mark for local changes; None outside a work tree."""
    described = _git(file.parent, "ls-files", "--error-unmatch", file.name)
    head = _git(file.parent, "rev-parse", "HEAD") if described else ""
    if not head:
        return None
    return f"{head} with changes" if _git(file.parent, "status", "--porcelain", "--untracked-files=no") else head


def _git(folder: Path, *words: str) -> str:
    """Return the output of git, or nothing if it fails or is missing."""
    try:
        done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, timeout=_PATIENCE_S)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
