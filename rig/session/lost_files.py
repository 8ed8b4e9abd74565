"""Runs whose journal or byte log was deleted, moved, replaced or shortened during the run."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from rig.data import Run, RunError, RunFolder, read_run
from rig.data.folder import rescued_folder
from rig.data.journal import ByteLog, LineFile
from rig.engine import Journal
from rig.engine.bench_memory import state_folder
from rig.errors import LostRecordError
from rig.session.early_ending import FinalPosition


@dataclass(frozen=True)
class LostRun:
    """Rest of a run with lost files: the problem, and the files read back through their descriptors."""

    problem: LostRecordError
    contents: Mapping[str, bytes]

    @classmethod
    def of(cls, folder: RunFolder, copies: Mapping[str, bytes], journal: Journal, byte_log: ByteLog) -> Self | None:
        """Return None if journal and byte log are in place; only the latter must be open.

        `copies` are inputs of the run by file name.
        """
        byte_log.check()
        files = {folder.events.name: journal.file, folder.bytes_log.name: byte_log.file}
        lost = [file.lost for file in files.values() if file.lost is not None]
        if not lost:
            return None
        contents = {name: left for name, file in files.items() if (left := _left(file)) is not None}
        return cls(
            LostRecordError(f"{lost[0].filename}: {lost[0]}"),
            {**copies, **contents},
        )

    def rescued(self, folder: RunFolder, at: FinalPosition) -> Run:
        """Write the files into a new folder beside the old one, or into the user's state folder.

        Raises LostRecordError if nothing can be written, or the rest is not a whole journal.
        """
        where = Path()
        sentence = f"{self.problem}; the indentor is {at.words}"
        try:
            where = rescued_folder(folder, self.contents, state_folder() / "rescued").path
            return read_run(where)
        except OSError as error:
            raise LostRecordError(
                f"{sentence}; the data are lost because they cannot be written to a new folder: {error}", "data_lost"
            ) from error
        except RunError as error:
            raise LostRecordError(f"{sentence}; the remaining data are in {where}", "rescued") from error


def _left(file: LineFile) -> bytes | None:
    with suppress(OSError):
        return file.content()
    return None
