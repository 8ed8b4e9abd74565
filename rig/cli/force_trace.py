"""The force of a run as text: its newest reading, and a trace of blocks as wide as the terminal allows."""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

from rig.data.events import READING
from rig.data.run_state import RunState

BLOCKS = " ▁▂▃▄▅▆▇█"
COLUMNS, ROWS, EACH = 64, 3, 4
"""Columns and lines of the trace, in characters, and readings per column."""


class ForceTrace:
    """Recent readings of a run: the newest as a number, the highest of each group as a column of a trace."""

    def __init__(self, run: RunState) -> None:
        self._run = run
        self._columns: deque[float] = deque(maxlen=COLUMNS)
        self._readings = 0

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Receive an entry of the journal; only readings count."""
        if not stream.endswith(READING):
            return
        force_gwt = float(data["force_gwt"])
        if self._readings % EACH:
            self._columns[-1] = max(self._columns[-1], force_gwt)
        else:
            self._columns.append(force_gwt)
        self._readings += 1

    @property
    def line(self) -> str:
        """Force, depth and position of the newest reading."""
        newest = self._run.newest
        if not newest:
            return "no reading yet"
        depth, place = newest.get("doi_mm"), newest.get("x_mm")
        parts = [f"{newest['force_gwt']:.2f} gwt"]
        parts += [] if depth is None else [f"depth {depth:.3f} mm"]
        parts += [] if place is None else [f"x = {place:+.2f} mm"]
        return ", ".join([*parts, str(newest["phase"])])

    @property
    def highest_gwt(self) -> float:
        """Largest force of the trace, its full height (gwt)."""
        return max(self._columns, default=0.0)

    @property
    def trace(self) -> list[str]:
        """Lines of blocks from the top, as wide as the trace; values below zero are plotted as zero."""
        full = self.highest_gwt
        levels = [round(len(BLOCKS[1:]) * ROWS * force / full) if full > 0 else 0 for force in self._columns]
        lines = []
        for row in reversed(range(ROWS)):
            below = len(BLOCKS[1:]) * row
            lines.append("".join(BLOCKS[min(max(level - below, 0), len(BLOCKS) - 1)] for level in levels))
        return [line.ljust(COLUMNS) for line in lines]


class Screen:
    """Lines cut to the width of the terminal, with text above and below the force."""

    def __init__(self, force: ForceTrace, above: Callable[[], list[str]], below: Callable[[], list[str]]) -> None:
        self._force, self._above, self._below = force, above, below

    @property
    def lines(self) -> list[str]:
        """Current lines."""
        force = self._force
        trace = force.trace
        trace[0] += f" {force.highest_gwt:.2f} gwt"
        trace[-1] += " 0"
        return [*self._above(), named("force", force.line), *(f"  {line}" for line in trace), *self._below()]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for line in self.lines:
            yield Text(line, no_wrap=True, overflow="ellipsis")


def named(name: str, words: str) -> str:
    """Return a line of the screen."""
    return f"{name:<8}{words}"
