"""Drivers, engine and tools hold a clock: nobody else waits or asks for the time of day."""

import ast
from pathlib import Path

import rig
from tests.sources import trees_with

PACKAGE = Path(rig.__file__).parent
FORBIDDEN = {"sleep", "time", "time_ns"}


def _uses(tree: ast.AST) -> list[str]:
    """Every use of time.sleep, time.time or time.time_ns, however it was imported."""
    modules, found = set(), []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules |= {alias.asname or alias.name for alias in node.names if alias.name == "time"}
        elif isinstance(node, ast.ImportFrom) and node.module == "time":
            found += [f"line {node.lineno}: {a.name}" for a in node.names if a.name in FORBIDDEN | {"*"}]
    for node in ast.walk(tree):
        if not (isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)):
            continue
        if node.value.id in modules and node.attr in FORBIDDEN:
            found.append(f"line {node.lineno}: {node.value.id}.{node.attr}")
    return found


def test_only_the_clock_module_sleeps_or_reads_the_time() -> None:
    found = {
        path.relative_to(PACKAGE).as_posix(): uses
        for path, tree in trees_with(PACKAGE, "time")
        if (uses := _uses(tree))
    }
    assert set(found) == {"clock.py"}, found
