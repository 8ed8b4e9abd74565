"""Documents of a journal: one JSON object a line, with its number and a checksum.

`crc32` is the CRC-32 of the line without this key, as eight hexadecimal digits. Number and checksum together show a
line that was changed, dropped, doubled or moved. Journals of 0.2 have no checksums; their lines are read unchecked.
"""

import json
import re
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from rig.errors import RigError
from rig_shared.user_files import json_of, open_file

Document = dict[str, Any]

_NUMBER = (float, int)
_LATEST_S = 1e12
_NEEDED: dict[str, dict[str, type | tuple[type, ...]]] = {
    "start": {"t_s": _NUMBER},
    "resume": {"t_s": _NUMBER},
    "descriptor": {"t_s": _NUMBER, "stream": str, "units": dict},
    "event": {"t_s": _NUMBER, "stream": str, "data": dict},
    "stop": {"t_s": _NUMBER, "status": str},
}

MOST_ON_A_LINE = 4_000_000
"""Bytes of a document; those of runs have at most a few thousand."""

_SUM = re.compile(rb'(\{"doc": "[a-z]{1,20}", )"crc32": "([0-9a-f]{8})", ')


class JournalError(RigError):
    """Error of a journal that cannot be read or continued."""

    default_code = "no_document"


class Damage(NamedTuple):
    """Damaged place of a journal: its line, from 1, and the problem in words."""

    line: int
    problem: str


class JournalLine(NamedTuple):
    """Line of a journal: number from 1, text, and a document or a damage."""

    number: int
    text: bytes
    document: Document | None
    damage: Damage | None


def line_of(kind: str, body: str) -> bytes:
    """Return the line of a document from its kind and the rest of its JSON text, which begins with a key."""
    head = f'{{"doc": "{kind}", '
    checksum = zlib.crc32(f"{head}{body}".encode("ascii"))
    return f'{head}"crc32": "{checksum:08x}", {body}\n'.encode("ascii")


def as_line(document: Mapping[str, Any]) -> bytes:
    """Return the line of a document, with a new checksum."""
    body = {key: value for key, value in document.items() if key not in ("doc", "crc32")}
    return line_of(document["doc"], json.dumps(body, allow_nan=False)[1:])


def fits(line: bytes) -> bool | None:
    """Return whether the checksum of a line fits, None for a line without one."""
    found = _SUM.match(line)
    if found is None:
        return None
    return zlib.crc32(line[found.end() :], zlib.crc32(found[1])) == int(found[2], 16)


def document_on(line: bytes) -> Document | None:
    """Return the document on a line, or None."""
    try:
        found = json_of(line)
    except ValueError:  # neither JSON nor UTF-8
        return None
    return found if is_document(found) else None


def is_document(found: object) -> bool:
    """Return whether an object is a document, by its required keys and their types."""
    if not isinstance(found, dict) or not isinstance(doc := found.get("doc"), str):
        return False
    needed = _NEEDED.get(doc)
    if needed is None or not all(isinstance(found.get(name), kind) for name, kind in needed.items()):
        return False
    return bool(abs(found["t_s"]) < _LATEST_S)  # False for NaN


class LineCheck:
    """Check of the lines of one journal, received in order."""

    def __init__(self) -> None:
        self.number = 0  # of the last line
        self._checked: bool | None = None  # whether the journal has checksums; None before its first line
        self._next = 0  # expected `seq`
        self._unread = 0  # lines since the last document

    def document(self, line: bytes) -> tuple[Document | None, Damage | None]:
        """Return the document of the next line, and what is wrong there; a changed first line is still returned."""
        self.number += 1
        document, fit = document_on(line), fits(line)
        if self._checked is None:
            self._checked = document is None or "crc32" in document
        if document is None:
            return None, self._unreadable("not a journal document")
        if "crc32" in document and not fit:
            damage = self._unreadable("its checksum does not fit, so it was changed")
            return (document if self.number == 1 else None), damage
        if not self._checked:
            return document, None
        if fit is None:
            return None, self._unreadable("it has no checksum, so no run wrote it")
        return self._in_order(document)

    def long_line(self) -> Damage:
        """Count a line beyond the limit."""
        self.number += 1
        return self._unreadable(f"longer than {MOST_ON_A_LINE} characters, which is the limit")

    def _in_order(self, document: Document) -> tuple[Document | None, Damage | None]:
        number, expected, last = document.get("seq"), self._next, self._next + self._unread
        if not isinstance(number, int) or number < expected:
            return None, Damage(self.number, f"number {number} occurs again, or late")
        self._next, self._unread = number + 1, 0
        if number <= last:
            return document, None
        missing = f"line {last} is" if number == last + 1 else f"lines {last} to {number - 1} are"
        return document, Damage(self.number, f"{missing} missing before it, by their numbers from 0")

    def _unreadable(self, problem: str) -> Damage:
        self._unread += 1
        return Damage(self.number, problem)


def read_lines(path: Path) -> Iterator[JournalLine]:
    """Yield the lines of a journal of any length, without empty lines and a torn last one. Raises OSError."""
    check = LineCheck()
    with open_file(path) as file:
        while text := file.readline(MOST_ON_A_LINE + 1):
            whole, text = text.endswith(b"\n"), text.rstrip(b"\n")
            if len(text) > MOST_ON_A_LINE:
                if not whole:
                    _skip_line(file)
                yield JournalLine(check.number + 1, b"", None, check.long_line())
            elif text and (whole or document_on(text)):
                document, damage = check.document(text)
                yield JournalLine(check.number, text, document, damage)


def last_document(path: Path) -> Document:
    """Return the last document of a journal, empty without one. Raises OSError."""
    last: Document = {}
    for line in read_lines(path):
        last = line.document or last
    return last


def _skip_line(file: BinaryIO) -> None:
    """Read to the end of the line."""
    while (text := file.readline(MOST_ON_A_LINE)) and not text.endswith(b"\n"):
        pass
