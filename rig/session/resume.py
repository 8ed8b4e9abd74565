"""Taking up a run that stopped: what it was made from, and what it has done."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.data import Run, RunError, RunFolder, read_run
from rig.engine.journal import JournalError, mend_journal
from rig.plan.config import Config, load_config
from rig.protocol.errors import BadInputError
from rig.protocol.script import Script, script_with


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
    subject: str | None = None

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
        subject=about.get("subject"),
    )


def first_reference_gwt(run: Run) -> list[float] | None:
    """The forces of the first reference that was compared."""
    compared = {event["index"] for event in run.stream("reference")}
    forces = {(e["index"], e["hold"]): e["force_gwt"] for e in run.stream("reference_hold_end")}
    first = min(compared, default=None)
    return None if first is None else [force for (index, _), force in sorted(forces.items()) if index == first]
