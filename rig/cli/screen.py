"""What is seen of a run while it goes on: the live force as a number and a trace, the step now and the next."""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

BLOCKS = " ▁▂▃▄▅▆▇█"
COLUMNS, ROWS, EACH = 64, 3, 4
"""Of the trace: columns and lines of characters, readings a column."""


class Force:
    """The last readings: the newest as a number, the highest of each few as a column of a trace."""

    def __init__(self) -> None:
        self._columns: deque[float] = deque(maxlen=COLUMNS)
        self._readings = 0
        self.newest: Mapping[str, Any] = {}

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """What the journal is told; readings only count."""
        if not stream.endswith("sample"):
            return
        self.newest, force_gwt = data, float(data["force_gwt"])
        if self._readings % EACH:
            self._columns[-1] = max(self._columns[-1], force_gwt)
        else:
            self._columns.append(force_gwt)
        self._readings += 1

    @property
    def line(self) -> str:
        """Force, depth and place of the newest reading."""
        if not self.newest:
            return "no reading yet"
        depth, place = self.newest.get("doi_mm"), self.newest.get("x_mm")
        parts = [f"{self.newest['force_gwt']:.2f} gwt"]
        parts += [] if depth is None else [f"depth {depth:.3f} mm"]
        parts += [] if place is None else [f"x = {place:+.2f} mm"]
        return ", ".join([*parts, str(self.newest["phase"])])

    @property
    def highest_gwt(self) -> float:
        """Of what the trace shows: its full height."""
        return max(self._columns, default=0.0)

    @property
    def trace(self) -> list[str]:
        """Lines of blocks from the top, each as wide as the trace; what is below zero is drawn as zero."""
        full = self.highest_gwt
        levels = [round(len(BLOCKS[1:]) * ROWS * force / full) if full > 0 else 0 for force in self._columns]
        lines = []
        for row in reversed(range(ROWS)):
            below = len(BLOCKS[1:]) * row
            lines.append("".join(BLOCKS[min(max(level - below, 0), len(BLOCKS) - 1)] for level in levels))
        return [line.ljust(COLUMNS) for line in lines]


class Screen:
    """Lines of at most the width of the terminal; above and below the force stands what they say."""

    def __init__(self, force: Force, above: Callable[[], list[str]], below: Callable[[], list[str]]) -> None:
        self._force, self._above, self._below = force, above, below

    @property
    def lines(self) -> list[str]:
        """As they are now."""
        force = self._force
        trace = force.trace
        trace[0] += f" {force.highest_gwt:.2f} gwt"
        trace[-1] += " 0"
        return [*self._above(), named("force", force.line), *(f"  {line}" for line in trace), *self._below()]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for line in self.lines:
            yield Text(line, no_wrap=True, overflow="ellipsis")


def named(name: str, words: str) -> str:
    """A line of the screen."""
    return f"{name:<8}{words}"
