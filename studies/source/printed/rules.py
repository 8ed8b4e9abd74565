"""When a number or a word of ours agrees with the source's, partly agrees, or differs.

The bounds were set knowing the numbers of the default finger, and stand beside every verdict.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol

from rig.report.style import as_number

Word = Literal["agrees", "partly", "differs"]
Measured = float | str


class Rule(Protocol):
    """A rule of one claim."""

    def verdict(self, ours: Measured) -> Word:
        """What it says of ours; that differs which is not a number."""

    def difference(self, ours: Measured) -> tuple[float, str] | None:
        """By how much ours is beside the source's: a number and its form; None where both agree as words."""

    @property
    def bounds(self) -> str:
        """As a table has them."""


def _word(agrees: bool, partly: bool) -> Word:
    return "agrees" if agrees else "partly" if partly else "differs"


@dataclass(frozen=True)
class Near:
    """A printed number; the bounds are shares of it."""

    value: float
    agrees: float
    partly: float

    def verdict(self, ours: Measured) -> Word:
        """By the relative difference."""
        off, whole = abs(float(ours) - self.value), abs(self.value)
        return _word(off <= self.agrees * whole, off <= self.partly * whole)

    def difference(self, ours: Measured) -> tuple[float, str]:
        """Relative."""
        return float(ours) / self.value - 1, "{:+.0%}"

    @property
    def bounds(self) -> str:
        """As a table has them."""
        return f"± {100 * self.agrees:g} %, ± {100 * self.partly:g} %"


@dataclass(frozen=True)
class Within:
    """A printed place or number whose distance counts; the bounds are in its own unit."""

    value: float
    agrees: float
    partly: float

    def verdict(self, ours: Measured) -> Word:
        """By the distance."""
        off = abs(float(ours) - self.value)
        return _word(off <= self.agrees, off <= self.partly)

    def difference(self, ours: Measured) -> tuple[float, str]:
        """Ours less the source's."""
        return float(ours) - self.value, "{:+.3g}"

    @property
    def bounds(self) -> str:
        """As a table has them."""
        return f"± {as_number(self.agrees)}, ± {as_number(self.partly)}"


@dataclass(frozen=True)
class _OneSided:
    """A limit; as far as `partly` it is missed by little."""

    limit: float
    partly: float
    beyond: ClassVar[int]
    """What is beyond the limit lies above it (1) or below it (-1)."""
    sign: ClassVar[str]

    def verdict(self, ours: Measured) -> Word:
        """By the limits."""
        off = self.beyond * float(ours)
        return _word(off <= self.beyond * self.limit, off <= self.beyond * self.partly)

    def difference(self, ours: Measured) -> tuple[float, str]:
        """Ours less the limit."""
        return float(ours) - self.limit, "{:+.3g}"

    @property
    def bounds(self) -> str:
        """As a table has them."""
        return f"{self.sign} {as_number(self.limit, 4)}, {self.sign} {as_number(self.partly, 4)}"


class Below(_OneSided):
    """At most a limit."""

    beyond, sign = 1, "≤"


class Above(_OneSided):
    """At least a limit."""

    beyond, sign = -1, "≥"


@dataclass(frozen=True)
class Same:
    """Words: those that agree, and those that do so in part."""

    agrees: tuple[str, ...]
    partly: tuple[str, ...]

    def verdict(self, ours: Measured) -> Word:
        """By the word."""
        return _word(ours in self.agrees, ours in self.partly)

    def difference(self, ours: Measured) -> None:
        """Words do not differ by a number."""

    @property
    def bounds(self) -> str:
        """As a table has them."""
        return f"{' or '.join(self.agrees)}; in part {' or '.join(self.partly)}"
