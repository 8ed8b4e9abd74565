"""A journal read as it grows, by whoever looks on from another process: it is only read, never locked or written."""

import os
from collections.abc import Callable, Iterator

from rig.data.folder import RunFolder
from rig.data.reader import RunError
from rig.engine.journal import Document, document_on


class Following:
    """The documents of a run's journal, each once, as far as they are written."""

    def __init__(self, folder: RunFolder) -> None:
        self._path, self._at, self._line = folder.events, 0, 0

    def new(self, most: int = -1) -> list[Document]:
        """What came since the last time; a line that is not whole yet is left for the next. Raises RunError.

        most: bytes, more than the longest line; what is beyond them is left, too. Without it all that there is.
        """
        try:
            # without a buffer (128 KiB from Python 3.14 on), and never room for more than there is: buffers made and
            # cut to size twenty times a second leave holes in the heap
            with self._path.open("rb", buffering=0) as file:
                file.seek(self._at)
                there = max(os.fstat(file.fileno()).st_size - self._at, 0)
                whole, end, _ = file.read(there if most < 0 else min(there, most)).rpartition(b"\n")
        except FileNotFoundError:
            return []
        except OSError as error:
            raise RunError(
                "{path}: {reason}", code="unreadable", path=str(self._path), reason=error.strerror
            ) from None
        self._at += len(whole) + len(end)
        return [self._document(line) for line in whole.split(b"\n") if line]

    def _document(self, line: bytes) -> Document:
        self._line += 1
        found = document_on(line)
        if found is None:
            raise RunError(
                "{path}, line {line}: not a journal document",
                code="no_document",
                path=str(self._path),
                line=self._line,
            )
        return found


def followed(folder: RunFolder, wait: Callable[[], None]) -> Iterator[list[Document]]:
    """What is there, then what comes, until the journal has its end or nobody writes to it any more.

    wait is called whenever there is nothing new. Raises RunError.
    """
    journal, last = Following(folder), ""
    while True:
        at_it = folder.busy  # asked first: what was written before its program let go is then read
        new = journal.new()
        if new:
            last = new[-1]["doc"]
            yield new
        if last == "stop" or not (new or at_it):
            return
        if not new:
            wait()
