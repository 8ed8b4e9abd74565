"""A journal for a list of many runs: every line is seen to be whole, and of the events few are taken apart.

It is cut at once where one event follows another, as the journal writes them. Written otherwise, torn, or with bytes
that are no ASCII it is read as for anything else.
"""

import json
from collections.abc import Collection, Iterator
from pathlib import Path

from rig.engine.journal import Document, is_document, read_journal

_BETWEEN = '}}\n{"doc": "event", '
_READING = 'sample", "data": {'
"""Nine lines in ten are readings: with this in it a line is one of them."""
_STREAM = '"stream": "'
"""The first one in a line is its own: what is recorded comes after it."""
_BLOCK = 1 << 15
"""Bytes at a time: what is cut is thrown away while it is near."""


def listed_documents(path: Path, streams: Collection[str]) -> list[Document]:
    """All but the events of other streams, of which some may be among them. Raises OSError, JournalError."""
    found = _documents(_BETWEEN.join(_kept(path, tuple(f'{_STREAM}{stream}"' for stream in streams))))
    return list(read_journal(path, readings=False)) if found is None else found


def _kept(path: Path, wanted: tuple[str, ...]) -> Iterator[str]:
    """The begin and the end, events that are wanted, and whatever stands between events."""
    with path.open("rb", buffering=0) as file:
        left, first = "", True
        while block := file.read(_BLOCK):
            *lines, left = (left + block.decode("latin-1")).split(_BETWEEN)
            for line in lines:
                if first or "\n" in line or (_READING not in line and line.startswith(wanted, line.find(_STREAM))):
                    yield line
                first = False
        yield left


def _documents(text: str) -> list[Document] | None:
    """Of lines; None where they are not as the journal writes them."""
    if not (text.isascii() and text.endswith("\n")):
        return None
    try:
        found = json.loads(f"[{text[:-1].replace(chr(10), ',')}]")
    except ValueError:
        return None
    return found if len(found) == text.count("\n") and all(map(is_document, found)) else None
