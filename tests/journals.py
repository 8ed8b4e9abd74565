"""Journals that a test changes: their lines keep numbers and checksums."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rig.data.documents import as_line
from rig.data.journal import mend_journal

Document = dict[str, Any]


def rewrite(journal: Path, change: Callable[[Document], Mapping[str, Any]]) -> None:
    """Change each document of a journal."""
    lines = journal.read_bytes().splitlines()
    journal.write_bytes(b"".join(as_line(change(json.loads(line))) for line in lines))


def append(journal: Path, document: Mapping[str, Any]) -> None:
    """Add a document to a journal, whose half line is cut off."""
    mend_journal(journal)
    seq = len(journal.read_bytes().splitlines())
    with journal.open("ab") as file:
        file.write(as_line({**document, "seq": seq}))
