"""Counts from a file that another program appends to: a line `index,count` for each press."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rig.design.counts_from.source import MadePress
from rig.errors import CountError

HEADER = "index,count"
_MOST_BYTES = 1_000_000
_LONGEST = 200


class GrowingFile:
    """CSV file with the header `index,count`. It may begin to exist during the run."""

    def __init__(self, path: Path) -> None:
        """Raise CountError if the file could never be read."""
        self._path, self._at, self._line, self._rest = path.absolute(), 0, 0, b""
        if path.is_dir() or not self._path.parent.is_dir():
            raise CountError(f"counts={path}: must be a file in an existing folder", "no_file")

    def made(self, press: MadePress) -> None:
        """Do nothing, because the file grows by itself."""

    def new(self) -> list[tuple[Any, Any]]:
        """Return the rows of the new whole lines. Raises CountError."""
        lines = self._lines()
        return [pair for text in lines if (pair := self._pair(text)) is not None]

    def truth(self) -> Mapping[str, Any] | None:
        """Return None: the nerve is recorded."""
        return None

    def close(self) -> None:
        """Do nothing: the file is open only while it is read."""

    def _lines(self) -> list[bytes]:
        try:
            with self._path.open("rb") as file:
                if file.seek(0, 2) < self._at:
                    raise CountError(f"{self._path}: was shortened", "shortened")
                file.seek(self._at)
                found = file.read(_MOST_BYTES)
        except OSError:  # not there yet, or lost: then no count arrives
            return []
        self._at += len(found)
        *lines, self._rest = (self._rest + found).split(b"\n")
        if len(self._rest) > _LONGEST:
            raise self._wrong(self._rest)
        return lines

    def _pair(self, line: bytes) -> tuple[str, str] | None:
        self._line += 1
        text = line.decode("utf-8-sig" if self._line == 1 else "utf-8", errors="replace").strip()
        if self._line == 1:
            if text.replace(" ", "") != HEADER:
                raise CountError(f"{self._path}: the first line must be {HEADER}, not {text[:60]!r}", "no_header")
            return None
        if not text:
            return None
        cells = [one.strip() for one in text.split(",")]
        if len(cells) != 2:
            raise self._wrong(line)
        return cells[0], cells[1]

    def _wrong(self, line: bytes) -> CountError:
        return CountError(
            f"{self._path}, line {max(self._line, 1)}: {line[:60].decode('utf-8', errors='replace')!r}: must be "
            f"{HEADER}",
            "bad_line",
        )
