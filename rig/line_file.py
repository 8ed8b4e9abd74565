"""A file that a run appends whole lines to, and that notices when it is no longer the file at its path."""

import contextlib
import os
from pathlib import Path
from typing import Any

from rig.errors import RigError


class LostFileError(RigError, OSError):
    """The file is open, but nobody will find at its path what was written to it."""

    default_code = "lost"

    def __init__(self, path: Path, what: str, *, code: str | None = None, **fields: Any) -> None:
        super().__init__(what, code=code, **fields)
        self.strerror, self.filename = str(self.args[0]), str(path)

    def __reduce__(self) -> tuple[Any, ...]:
        # What an OSError keeps of its own is not in the dictionary.
        return type(self), (Path(self.filename), self.strerror), self.__dict__

    def __str__(self) -> str:
        return str(self.strerror)


class LineFile:
    """An open file of whole lines, to be appended to.

    Whoever deletes, moves, replaces or shortens a file leaves its descriptor writable: a write alone notices nothing.
    """

    def __init__(self, path: Path) -> None:
        """Open or make it.

        Raises
        ------
        OSError
            If it cannot be opened.
        """
        self.path = path
        self.lost: LostFileError | None = None
        self._at = path.absolute()  # a script may change the working folder
        self._file = path.open("ab+", buffering=0)
        self._size = self._file.seek(0, os.SEEK_END)
        self._content: bytes | None = None

    def append(self, line: bytes, *, sync: bool = False) -> None:
        """Write a whole line, or none of it.

        Parameters
        ----------
        line : bytes
            The line, with its line end.
        sync : bool
            Wait until it is on the disk.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        end = self._file.tell()
        try:
            left = memoryview(line)
            while left:
                left = left[os.write(self._file.fileno(), left) :]
            if sync:
                os.fsync(self._file.fileno())
        except OSError:
            with contextlib.suppress(OSError):  # a torn line is mended before the file is used again
                if os.fstat(self._file.fileno()).st_size > end:
                    self._file.truncate(end)
                    self._file.seek(end)
            raise
        # At least so much is there: an interrupt, or a line of another thread, may have come between.
        self._size = end + len(line)

    def check(self) -> None:
        """Make sure that what was written is what is found at the path.

        Raises
        ------
        LostFileError
            If the file was deleted, moved, replaced or shortened by somebody else.
        """
        if self.lost is None:
            self.lost = self._what_happened()
        if self.lost is not None:
            raise self.lost

    def _what_happened(self) -> LostFileError | None:
        mine = os.fstat(self._file.fileno())
        try:
            there = os.stat(self._at)
        except FileNotFoundError:
            if mine.st_nlink == 0:
                return LostFileError(self.path, "was deleted during the run", code="deleted")
            return LostFileError(self.path, "was moved during the run, alone or with its folder", code="moved")
        except OSError as error:
            what = "can no longer be found: {problem}"
            return LostFileError(self.path, what, code="not_found", problem=error.strerror)
        if not os.path.samestat(mine, there):
            return LostFileError(self.path, "was replaced during the run", code="replaced")
        if mine.st_size < self._size:
            what = "was shortened during the run by another program"
            return LostFileError(self.path, what, code="shortened")
        return None

    def content(self) -> bytes:
        """Return everything in the file, wherever it is now. Raises OSError."""
        if self._content is not None:
            return self._content
        if self._file.closed:
            return self._at.read_bytes()
        self._file.seek(0)
        return self._file.readall()

    def close(self) -> None:
        """Close it; what is in a lost file can still be read with content()."""
        if self.lost is not None and not self._file.closed:
            with contextlib.suppress(OSError):
                self._content = self.content()
        self._file.close()
