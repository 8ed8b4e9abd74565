"""Taking up a run that stopped: what it was made from, what it has done, and the script run again over that."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.data import Run, RunError, RunFolder, read_run
from rig.engine import Engine, Hold, Indentation, Target
from rig.engine.journal import JournalError, mend_journal
from rig.engine.reference import Reference
from rig.plan.config import Config, load_config
from rig.plan.plan import CheckingRig
from rig.protocol.errors import BadInputError
from rig.protocol.script import Script, script_with
from rig.session.live import LiveRig

# What an indentation needs before it; the last of each is made up for, in the order in which the script came to them.
_OWED = ("mount", "zero", "reference", "move_to", "precondition", "rest")
# What is journalled once and for all.
_ONCE = ("note", "checkpoint")


@dataclass(frozen=True)
class StoppedRun:
    """A run as its folder tells it: the run's own script, parameters and configuration, and what was journalled.

    `run` is None where the program ended before anything was journalled.
    """

    folder: RunFolder
    script: Script
    config: Config
    virtual: bool
    run: Run | None

    @property
    def complete(self) -> bool:
        """Whether there is nothing left to do."""
        return self.run is not None and self.run.complete


def read_stopped(path: Path) -> StoppedRun:
    """What a run folder holds, its journal mended. Raises BadInputError, FolderBusyError."""
    folder = RunFolder(path)
    try:
        with folder.owned():
            return _read(folder)
    except OSError as error:
        raise BadInputError(f"run {path}: {error.filename}: {error.strerror}, expected a run folder") from None
    except (RunError, JournalError) as error:
        raise BadInputError(str(error)) from None


def _read(folder: RunFolder) -> StoppedRun:
    changed = folder.changed()
    if changed:
        raise BadInputError(
            f"run {folder.path}: {', '.join(changed)}: changed since the run began, cannot go on with it"
        )
    about: dict[str, Any] = json.loads(folder.provenance.read_text(encoding="utf-8"))
    copy = folder.path / "protocol.py"
    return StoppedRun(
        folder=folder,
        script=script_with(copy, Path(about["protocol"]).stem, about["parameters"]),
        config=load_config(folder.path / "config.toml"),
        virtual=about["virtual"],
        run=read_run(folder.path) if mend_journal(folder.events) else None,
    )


class ResumedRig(LiveRig):
    """The script's rig in a run that goes on, on an engine that has just homed.

    The script runs from its beginning. What is done answers as it was journalled; what comes before the next missing
    indentation is owed, and carried out only when that comes.
    """

    def __init__(self, engine: Engine, check: CheckingRig, before: Run) -> None:
        super().__init__(engine, check)
        self._done = {index: _as_journalled(before, index) for index in before.done}
        self._touched = {event["index"]: event["contact_height_mm"] for event in before.stream("find")}
        self._reference = Reference(_first_reference_gwt(before))
        self._written = {verb: len(before.stream(verb)) for verb in _ONCE}
        self._owed: dict[str, Callable[[], None]] = {}
        self._behind = True  # until the first missing indentation after the last one that is done

    def _do(self, verb: str, deed: Callable[[], None]) -> None:
        if not self._behind:
            deed()
        elif verb in _ONCE:
            self._written[verb] -= 1
            if self._written[verb] < 0:
                deed()
        elif verb in _OWED:
            self._owed.pop(verb, None)
            self._owed[verb] = deed

    def _indent(self, index: int, deed: Callable[[], Indentation]) -> Indentation:
        if index in self._done:
            self._owed.pop("rest", None)  # it was for this one
            return self._done[index]
        self._make_up()
        self._behind = index < max(self._done, default=-1)
        return deed()

    def _touch(self, index: int, deed: Callable[[], float]) -> float:
        if index in self._touched:
            return float(self._touched[index])
        self._make_up()
        return deed()

    def _make_up(self) -> None:
        owed, self._owed = self._owed, {}
        for make_up_for in owed.values():
            make_up_for()


def _as_journalled(run: Run, index: int) -> Indentation:
    asked = {event["hold"]: event for event in run.stream("hold_start") if event["index"] == index}
    holds = tuple(
        Hold(
            Target(asked[end["hold"]]["target"], asked[end["hold"]]["commanded"]),
            end["doi_mm"],
            end["force_gwt"],
            end["force_sd_gwt"],
        )
        for end in run.done[index]
    )
    return Indentation(index, run.done[index][0]["x_mm"], holds)


def _first_reference_gwt(run: Run) -> list[float] | None:
    """The forces of the first reference that was compared."""
    compared = {event["index"] for event in run.stream("reference")}
    forces = {(e["index"], e["hold"]): e["force_gwt"] for e in run.stream("reference_hold_end")}
    first = min(compared, default=None)
    return None if first is None else [force for (index, _), force in sorted(forces.items()) if index == first]
