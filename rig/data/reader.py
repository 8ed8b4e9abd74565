"""A run read back from its journal."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.data.folder import RunFolder
from rig.run.journal import JournalError, read_journal


class RunError(Exception):
    """The folder holds no readable run."""


@dataclass(frozen=True)
class Run:
    """The documents of one run, sorted by stream. Every event has its time under "t_s"."""

    folder: RunFolder
    start: dict[str, Any]
    stop: dict[str, Any] | None  # None after a crash
    units: dict[str, dict[str, str]]
    events: dict[str, list[dict[str, Any]]]
    duration_s: float

    def stream(self, name: str) -> list[dict[str, Any]]:
        """The events of one stream in order."""
        return self.events.get(name, [])

    @property
    def complete(self) -> bool:
        """Whether the run ended by itself with every planned indentation done."""
        done = len(self.stream("indentation_end"))
        return self.stop is not None and self.stop["status"] == "done" and done == self.start["planned_indentations"]


def read_run(path: Path) -> Run:
    """Read a run folder's journal; raises RunError."""
    folder = RunFolder(path)
    try:
        documents = list(read_journal(folder.events))
    except OSError as error:
        raise RunError(f"run {path}: {folder.events.name}: {error.strerror}") from None
    except JournalError as error:
        raise RunError(f"run {path}: {error}") from None
    if not documents or documents[0]["doc"] != "start":
        raise RunError(f"run {path}: {folder.events.name} does not begin with a start document")
    units: dict[str, dict[str, str]] = {}
    events: dict[str, list[dict[str, Any]]] = {}
    for document in documents:
        if document["doc"] == "descriptor":
            units[document["stream"]] = document["units"]
        elif document["doc"] == "event":
            events.setdefault(document["stream"], []).append({"t_s": document["t_s"], **document["data"]})
    last = documents[-1]
    return Run(
        folder=folder,
        start=documents[0],
        stop=last if last["doc"] == "stop" else None,
        units=units,
        events=events,
        duration_s=last["t_s"] - documents[0]["t_s"],
    )
