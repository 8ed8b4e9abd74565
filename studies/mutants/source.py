"""The mutants of a module: every operator at every place where it says something."""

import ast
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from studies.mutants.operators import OPERATORS

_Place = tuple[ast.AST, str, int | None]


@dataclass(frozen=True)
class Mutant:
    """One change. Its key holds while lines shift: module, function, what stood there, what stands there now."""

    path: str
    function: str  # qualified name; empty at module level
    lines: tuple[int, ...]  # of the source, that must run for the change to show
    at_import: str  # the name that a statement outside functions assigns, else empty
    before: str
    after: str
    nth: int  # among equal changes of one function
    source: str

    @property
    def key(self) -> str:
        """Module, function, change."""
        again = f" #{self.nth + 1}" if self.nth else ""
        return f"{self.path}::{self.function} | {self.before} → {self.after}{again}"


def mutants_of(root: Path, path: str) -> list[Mutant]:
    """All mutants of one module, in the order of its lines."""
    tree = ast.parse((root / path).read_text(encoding="utf-8"))
    original = ast.unparse(tree).splitlines()
    seen: Counter[tuple[str, str, str]] = Counter()
    found = []
    for place, owners in _places(tree, ()):
        node = _get(place)
        statement = next(o for o in reversed([*owners, node]) if isinstance(o, ast.stmt | ast.excepthandler))
        function = ".".join(o.name for o in owners if isinstance(o, _NAMED))
        for operator in OPERATORS:
            for other in operator(node):
                _put(place, ast.fix_missing_locations(ast.copy_location(other, node)))
                source = ast.unparse(tree)
                _put(place, node)
                before, after = _difference(original, source.splitlines())
                change = (function, before, after)
                found.append(
                    Mutant(
                        path, function, _lines(statement), _name(owners, statement), *change[1:], seen[change], source
                    )
                )
                seen[change] += 1
    return [m for m in found if m.before != m.after]


def plain(root: Path, path: str) -> str:
    """The module as mutants are written, without a change."""
    return ast.unparse(ast.parse((root / path).read_text(encoding="utf-8")))


_LONG, _AROUND = 120, 40
_NAMED = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
_SPEECH = (ast.JoinedStr, ast.Import, ast.ImportFrom, ast.TypeAlias if hasattr(ast, "TypeAlias") else ast.Import)
_NOT_RUN = {"annotation", "returns", "decorator_list", "bases", "type_params", "exc", "cause", "msg"}


def _places(node: ast.AST, owners: tuple[ast.AST, ...]) -> Iterator[tuple[_Place, tuple[ast.AST, ...]]]:
    """Where an expression or statement that does something stands; texts, types and messages are left out."""
    here = (*owners, node)
    for name, value in ast.iter_fields(node):
        if (
            name in _NOT_RUN
            or (isinstance(node, ast.keyword) and node.arg == "strict")
            or (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
        ):
            continue
        for k, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if isinstance(child, ast.AST) and not isinstance(child, _SPEECH):
                yield (node, name, k), here
                yield from _places(child, here)


def _get(place: _Place) -> ast.AST:
    parent, name, k = place
    value = getattr(parent, name)
    return value if k is None else value[k]


def _put(place: _Place, node: ast.AST) -> None:
    parent, name, k = place
    if k is None:
        setattr(parent, name, node)
    else:
        getattr(parent, name)[k] = node


def _difference(before: list[str], after: list[str]) -> tuple[str, str]:
    """The lines that differ, without their indentation; of long ones what differs, with some of what is around it."""
    start, end = _shared(before, after)
    old, new = (" ; ".join(line.strip() for line in part[start : len(part) - end]) for part in (before, after))
    if max(len(old), len(new)) > _LONG:
        start, end = _shared(old, new)
        old, new = (_cut(text, max(0, start - _AROUND), max(0, end - _AROUND)) for text in (old, new))
    return old, new


def _shared(before: Sequence[str], after: Sequence[str]) -> tuple[int, int]:
    """How much is the same at the beginning, and in what is left at the end."""
    most = min(len(before), len(after))
    start = next((k for k in range(most) if before[k] != after[k]), most)
    most -= start
    return start, next((k for k in range(most) if before[-1 - k] != after[-1 - k]), most)


def _cut(text: str, left: int, right: int) -> str:
    return f"{'…' * (left > 0)}{text[left : len(text) - right]}{'…' * (right > 0)}"


def _lines(statement: ast.stmt | ast.excepthandler) -> tuple[int, ...]:
    """The lines of a statement, of its head only if it has a body; of a function (a default) its body's."""
    if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef):
        return tuple(range(statement.body[0].lineno, (statement.end_lineno or 0) + 1))
    body = getattr(statement, "body", None) or getattr(statement, "cases", None)
    last = body[0].lineno - 1 if body and hasattr(body[0], "lineno") else statement.end_lineno
    return tuple(range(statement.lineno, max(last or 0, statement.lineno) + 1))


def _name(owners: tuple[ast.AST, ...], statement: ast.AST) -> str:
    """What a statement outside functions assigns, or "*"; empty inside functions."""
    if any(isinstance(o, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) for o in owners):
        return ""
    target = getattr(statement, "target", None) or next(iter(getattr(statement, "targets", [])), None)
    named = re.match(r"\w+", ast.unparse(target)) if isinstance(target, ast.AST) else None
    return named.group() if named else "*"
