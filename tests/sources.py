"""Source files as trees: only those are parsed in which what a test looks for can be."""

import ast
from collections.abc import Iterator
from pathlib import Path


def trees_with(folder: Path, *words: str) -> Iterator[tuple[Path, ast.Module]]:
    """Yield the modules below a folder whose text has one of these words, in their order."""
    for path in sorted(folder.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if any(word in text for word in words):
            yield path, ast.parse(text)
