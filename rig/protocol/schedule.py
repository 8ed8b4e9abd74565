"""Schedules: seeded random order, repeats, blocks, rests, reference presses, and ranges of positions.

schedule = p.schedule(positions_mm)
for block in schedule.on(rig):          # a checkpoint; the sensor is zeroed before and after
    for x_mm in block:                  # with a rest between two items
        rig.move_to(x_mm=x_mm)
        rig.indent(force_gwt=p.force_gwt)
"""

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from reprlib import Repr
from typing import Generic, Literal, TypeVar

from pydantic import Field, model_validator

from rig.errors import RuleError
from rig.protocol.api import ProtocolParameters, Rig

T = TypeVar("T")
Order = Literal["given", "random"]

_SHORT = Repr()
_SHORT.maxother = 80


@dataclass(frozen=True)
class Block(Generic[T]):
    """Items between two zeros of the force sensor, in order.

    Iterate over a block to get its items; `Schedule.on` makes the blocks.

    Attributes
    ----------
    number : int
        Number of the block, from 1.
    items : tuple
        The items in their order.
    schedule : Schedule
        The schedule that the block belongs to.
    rig : Rig
        The rig that carries out rests and reference presses.

    Examples
    --------
    >>> from rig.protocol import Rig, Schedule
    >>> def run(rig: Rig) -> None:
    ...     for block in Schedule((-1.0, 0.0, 1.0)).on(rig):
    ...         for x_mm in block:
    ...             rig.move_to(x_mm=x_mm)
    ...             rig.indent(doi_mm=0.5)
    """

    number: int
    items: tuple[T, ...]
    schedule: "Schedule[T]"
    rig: Rig

    def __iter__(self) -> Iterator[T]:
        """Yield the items; rest between two of them, and make the reference presses that are due."""
        try:
            for n, item in enumerate(self.items):
                self.rig.mark({"block": self.number})
                self._before(n)
                self.rig.mark({"block": self.number, "repeat": self._repeat(n), "condition": _as_text(item)})
                yield item
        finally:
            self.rig.mark({"block": self.number})

    def _before(self, n: int) -> None:
        schedule = self.schedule
        if n and schedule.rest_s:
            self.rig.rest(schedule.rest_s)
        if schedule.reference is not None and n % schedule.reference.every == 0:
            self.rig.reference(x_mm=schedule.reference.x_mm, doi_mm=schedule.reference.doi_mm)

    def _repeat(self, n: int) -> int:
        """Return how often the item has occurred in this block so far."""
        return [repr(item) for item in self.items[: n + 1]].count(repr(self.items[n]))


@dataclass(frozen=True)
class ReferencePress:
    """A press that is repeated at a fixed position, before every `every`-th indentation of a block.

    Parameters
    ----------
    every : int
        Number of indentations from one reference press to the next.
    x_mm : float
        Lateral position from the center of the finger pad (mm).
    doi_mm : float
        Depth past contact (mm).

    Examples
    --------
    >>> from rig.protocol import ReferencePress, Schedule
    >>> Schedule((0.0, 1.0), reference=ReferencePress(every=10, x_mm=0.0, doi_mm=0.4)).reference.every
    10
    """

    every: int
    x_mm: float
    doi_mm: float


@dataclass(frozen=True)
class Schedule(Generic[T]):
    """Items in blocks, as listed or in a random order.

    A random order depends only on the seed and on the number of the block: it is the same in every pass over a script
    and in every version of Python.

    Parameters
    ----------
    items : sequence
        For example lateral positions (mm), or names of conditions.
    order : {'given', 'random'}, optional
        Order of the items in a block.
    seed : int, optional
        Seed of a random order.
    repeats : int, optional
        How often each item occurs in a block.
    blocks : int, optional
        Number of blocks.
    rest_s : float, optional
        Rest between two indentations (s).
    block_rest_s : float, optional
        Rest between two blocks (s).
    reference : ReferencePress, optional
        Reference press; none by default.

    Examples
    --------
    >>> from rig.protocol import Schedule
    >>> schedule = Schedule((-1.0, 0.0, 1.0), order="random", seed=1, repeats=2, blocks=2)
    >>> sorted(schedule.block(1))
    [-1.0, -1.0, 0.0, 0.0, 1.0, 1.0]
    >>> schedule.block(1) == schedule.block(1)
    True
    """

    items: Sequence[T]
    order: Order = "given"
    seed: int = 0
    repeats: int = 1
    blocks: int = 1
    rest_s: float = 0.0
    block_rest_s: float = 0.0
    reference: ReferencePress | None = None

    def block(self, number: int) -> tuple[T, ...]:
        """Return the items of a block in their order.

        Parameters
        ----------
        number : int
            Number of the block, from 1.

        Returns
        -------
        tuple
            The items, each `repeats` times.

        Examples
        --------
        >>> from rig.protocol import Schedule
        >>> Schedule(("left", "right"), repeats=2).block(1)
        ('left', 'right', 'left', 'right')
        """
        items = tuple(self.items) * self.repeats
        if self.order == "given":
            return items
        # Of all random orders, Python guarantees only that of random() to stay the same between versions.
        chance = random.Random(f"{self.seed}, block {number}")
        return tuple(
            item for _, item in sorted(((chance.random(), item) for item in items), key=lambda pair: pair[0])
        )

    def on(self, rig: Rig) -> Iterator[Block[T]]:
        """Yield the blocks; zero the force sensor before and after each.

        Parameters
        ----------
        rig : Rig
            The rig of the script.

        Yields
        ------
        Block
            One block after the other, with a checkpoint before each and a rest between two.
        """
        for number in range(1, self.blocks + 1):
            if number > 1 and self.block_rest_s:
                rig.rest(self.block_rest_s)
            rig.checkpoint(f"block {number} of {self.blocks}")
            rig.zero()
            rig.mark({"block": number})
            try:
                yield Block(number, self.block(number), self, rig)
            finally:
                rig.mark({})
            rig.zero()


def _as_text(item: object) -> str:
    """Return the name of the condition of an item."""
    if isinstance(item, float):
        return f"{item:g}"
    return item if isinstance(item, str) else _SHORT.repr(item)


class ScheduledParameters(ProtocolParameters):
    """Base class of the `Parameters` of a script with a schedule.

    Examples
    --------
    >>> from rig.protocol import ScheduledParameters
    >>> ScheduledParameters(repeats=2).schedule((0.0, 1.0)).block(1)
    (0.0, 1.0, 0.0, 1.0)
    """

    order: Order = Field("given", description="order of the items in a block")
    seed: int = Field(0, ge=0, description="seed of a random order")
    repeats: int = Field(1, ge=1, le=100, description="how often each item occurs in a block")
    blocks: int = Field(1, ge=1, le=100, description="number of blocks")
    rest_s: float = Field(0.0, ge=0, le=3600, description="rest between two indentations")
    block_rest_s: float = Field(0.0, ge=0, le=3600, description="rest between two blocks")
    precondition: int = Field(0, ge=0, le=100, description="presses before each block, stored apart from data")
    reference_every: int = Field(0, ge=0, le=1000, description="indentations between reference presses; 0: none")
    reference_x_mm: float = Field(0.0, description="x of the reference presses")
    reference_doi_mm: float = Field(0.4, gt=0, le=1.5, description="depth of the reference presses")

    def schedule(self, items: Sequence[T]) -> Schedule[T]:
        """Return a schedule of these items, as the parameters define it.

        Parameters
        ----------
        items : sequence
            For example lateral positions (mm), or names of conditions.

        Returns
        -------
        Schedule
            The schedule.
        """
        reference = ReferencePress(self.reference_every, self.reference_x_mm, self.reference_doi_mm)
        return Schedule(
            items,
            self.order,
            self.seed,
            self.repeats,
            self.blocks,
            self.rest_s,
            self.block_rest_s,
            reference if self.reference_every else None,
        )


SPACING_MM = 0.17
"""Spacing of positions in the schedules of the source, and the default of a range (mm)."""

_DECIMALS = 3
_MOST_POSITIONS = 500


class RangeParameters(ProtocolParameters):
    """Base class of the `Parameters` of a script that steps across the finger pad.

    Examples
    --------
    >>> from rig.protocol import RangeParameters
    >>> RangeParameters(from_mm=1.0, to_mm=-1.0, spacing_mm=0.5).positions(())
    (1.0, 0.5, 0.0, -0.5, -1.0)
    >>> RangeParameters().positions((0.5, 0.0))
    (0.5, 0.0)
    """

    from_mm: float | None = Field(None, ge=-20, le=20, description="x of a range instead of the schedule")
    to_mm: float | None = Field(None, ge=-20, le=20, description="x where it ends")
    spacing_mm: float | None = Field(None, gt=0, le=5, description="largest step of the range; 0.17 by default")

    @model_validator(mode="after")
    def _whole(self) -> "RangeParameters":
        """Require both ends or none, two that differ, and a spacing only where there is a range."""
        begin, end = self.from_mm, self.to_mm
        if begin is None and end is None:
            if self.spacing_mm is not None:
                raise RuleError(
                    f"spacing_mm = {self.spacing_mm:g}: expected from_mm and to_mm beside it", "spacing_of_no_range"
                )
        elif begin is None or end is None:
            given, missing = ("to_mm", "from_mm") if begin is None else ("from_mm", "to_mm")
            raise RuleError(f"{given} without {missing}: expected both ends of the range", "half_a_range")
        elif begin == end:
            raise RuleError(f"from_mm = {begin:g}, to_mm = {end:g}: expected two ends that differ", "empty_range")
        elif self._steps(begin, end) >= _MOST_POSITIONS:
            raise RuleError(
                f"{self._steps(begin, end) + 1} positions: expected {_MOST_POSITIONS} or fewer", "too_many_positions"
            )
        return self

    def _steps(self, begin: float, end: float) -> int:
        return math.ceil(abs(end - begin) / (self.spacing_mm or SPACING_MM) - 1e-9)

    def positions(self, schedule: Sequence[float]) -> tuple[float, ...]:
        """Return the lateral positions of the range, from one end to the other in equal steps.

        Parameters
        ----------
        schedule : sequence of float
            Positions to return if no range is set (mm).

        Returns
        -------
        tuple of float
            Positions x from the center of the finger pad (mm).
        """
        begin, end = self.from_mm, self.to_mm
        if begin is None or end is None:
            return tuple(schedule)
        n = self._steps(begin, end)
        return tuple(round(begin + (end - begin) * k / n, _DECIMALS) for k in range(n + 1))


def about_the_centre(positions: int) -> tuple[float, ...]:
    """Return equally spaced positions about the center of the finger pad, in decreasing order.

    Parameters
    ----------
    positions : int
        Number of positions.

    Returns
    -------
    tuple of float
        Positions x (mm), 0.17 mm apart: the spacing of the source (Raju 1998, ch. 5).

    Examples
    --------
    >>> from rig.protocol import about_the_centre
    >>> about_the_centre(3)
    (0.17, 0.0, -0.17)
    """
    return tuple(round(SPACING_MM * (0.5 * (positions - 1) - k), _DECIMALS) for k in range(positions))
