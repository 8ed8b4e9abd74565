"""One fault on the wire to a GRBL board: every line of every motion, with every bit flipped, and bytes lost.

Each motion is first made on a faultless wire, where what is written gives the table of faults; then once with each
fault, on a board and a carriage of its own. Whatever is wrong with one message, the carriage goes no lower than the
lower of start and target, not sideways where it should go up or down, and the driver arrives or raises.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Literal

import pytest

from rig.devices.base import Axis, StageError
from rig.devices.grbl import GrblStage
from rig.transport import LoopbackTransport
from sim.devices import SerialLine, VirtualGrbl
from sim.devices.clock import VirtualClock
from sim.devices.grbl.core import Mechanics

Direction = Literal["tx", "rx"]
Place = tuple[float, float, float]
STEP_MM = 1 / 400
PLACE_MM = (-1.0, -1.0, -4.0)
"""Where each motion begins."""
SETTLED_S = 20.0
# What the board says is longer: fewer of its faults. A byte has twelve, so that a prime strikes all in turn.
EACH: dict[str, dict[Direction, int]] = {"a sample": {"tx": 7, "rx": 101}, "all": {"tx": 1, "rx": 13}}
FAST = {24: 300.0, 110: 300.0, 111: 300.0, 112: 300.0, 120: 1000.0, 121: 1000.0, 122: 1000.0, 26: 0.0}


@dataclass(frozen=True)
class Fault:
    """What passes instead of the message of this number, one way."""

    direction: Direction
    number: int
    instead: bytes


class Faulty:
    """A wire to a board of its own that changes one message, and notes where the carriage was at each."""

    name = "stage"

    def __init__(self, fault: Fault | None = None) -> None:
        self.clock = VirtualClock()
        line = SerialLine(self.clock, 1e9)
        self.board = VirtualGrbl(self.clock, line, settings=FAST, mechanics=Mechanics(start_mm=(-1.0, -1.0, -1.0)))
        self._wire, self._fault = LoopbackTransport(line, self.clock, "stage"), fault
        self.messages: dict[Direction, list[bytes]] = {"tx": [], "rx": []}
        self.places_mm: list[Place] = []
        self.counts = False

    def write(self, data: bytes) -> None:
        data = self._passed("tx", data)
        if data:
            self._wire.write(data)

    def read(self, timeout_s: float) -> bytes:
        data = self._wire.read(timeout_s)
        return self._passed("rx", data) if data else data

    def close(self) -> None:
        self._wire.close()

    def place_mm(self) -> Place:
        x, y, z = (steps * STEP_MM for steps in self.board.carriage_steps_at(self.clock.monotonic_s()))
        return (x, y, z)

    def _passed(self, direction: Direction, data: bytes) -> bytes:
        if not self.counts:
            return data
        self.places_mm.append(self.place_mm())
        self.messages[direction].append(data)
        fault = self._fault
        if fault is not None and (fault.direction, fault.number) == (direction, len(self.messages[direction]) - 1):
            return fault.instead
        return data


@dataclass(frozen=True)
class Motion:
    """What is asked of a stage that stands at PLACE_MM, and where that should end.

    aside_mm: how far it may go sideways. A jog does not say that it arrived: whoever jogs looks where it is.
    """

    go: Callable[[GrblStage], object]
    end_mm: Place
    aside_mm: float = 0.0
    arrives: bool = True


def _jog(stage: GrblStage, axis: Axis, by_mm: float) -> None:
    for _ in range(2):
        stage.jog(axis, by_mm, 5.0)
        while stage.status().state == "Jog":
            stage._clock.wait_s(0.02)
    stage.end_jog()


X, Y, Z = PLACE_MM
MOTIONS = {
    "lift": Motion(lambda stage: stage.move_to(z_mm=-3.4, speed_mm_s=5.0), (X, Y, -3.4)),
    "increment": Motion(lambda stage: stage.move_to(z_mm=-4.05, speed_mm_s=0.5), (X, Y, -4.05)),
    "down": Motion(lambda stage: stage.move_to(z_mm=-5.25, speed_mm_s=0.5), (X, Y, -5.25)),
    "left": Motion(lambda stage: stage.move_to(x_mm=-3.5, speed_mm_s=5.0), (-3.5, Y, Z), aside_mm=math.inf),
    "oblique": Motion(
        lambda stage: stage.move_to(x_mm=-3.0, y_mm=-2.0, speed_mm_s=5.0), (-3.0, -2.0, Z), aside_mm=math.inf
    ),
    "jog up": Motion(lambda stage: _jog(stage, "z", 0.5), (X, Y, -3.0), arrives=False),
    "jog down": Motion(lambda stage: _jog(stage, "z", -0.05), (X, Y, -4.1), arrives=False),
    "jog left": Motion(lambda stage: _jog(stage, "x", -0.5), (-2.0, Y, Z), aside_mm=math.inf, arrives=False),
}


def _made(motion: Motion, fault: Fault | None = None) -> tuple[Faulty, str]:
    """The motion on a board of its own, and how it ended: "arrived", or the name of what was raised."""
    wire = Faulty(fault)
    stage = GrblStage(wire, wire.clock)
    stage.connect()
    stage.home()
    stage.move_to(z_mm=Z, speed_mm_s=5.0)
    wire.counts = True
    try:
        motion.go(stage)
        end = "arrived"
    except StageError as error:
        end = type(error).__name__
    wire.places_mm.append(wire.place_mm())
    wire.clock.wait_s(SETTLED_S)
    wire.places_mm.append(wire.place_mm())
    return wire, end


def _instead(message: bytes) -> Iterator[bytes]:
    """Every bit flipped, every byte lost, doubled, or swapped with the next, and cut short after each."""
    for i, byte in enumerate(message):
        before, after = message[:i], message[i + 1 :]
        yield from (before + bytes([byte ^ 1 << bit]) + after for bit in range(8))
        yield before + after
        yield before + bytes([byte, byte]) + after
        yield before
        if after:
            yield before + after[:1] + bytes([byte]) + after[1:]


def _faults(messages: dict[Direction, list[bytes]], direction: Direction) -> Iterator[Fault]:
    """Of each distinct message, where it comes first."""
    for number, message in enumerate(messages[direction]):
        if message not in messages[direction][:number]:
            yield from (Fault(direction, number, instead) for instead in _instead(message))


def _wrong(motion: Motion, wire: Faulty, end: str) -> str:
    """What must not be, in a word."""
    lowest_mm = min(Z, motion.end_mm[2]) - STEP_MM
    if min(z for _, _, z in wire.places_mm) < lowest_mm - 1e-9:
        return "too low"
    if any(abs(x - X) + abs(y - Y) > motion.aside_mm + STEP_MM for x, y, _ in wire.places_mm):
        return "aside"
    arrived = all(abs(a - b) <= STEP_MM + 1e-9 for a, b in zip(wire.places_mm[-1], motion.end_mm, strict=True))
    return "" if end != "arrived" or arrived or not motion.arrives else "elsewhere"


@pytest.mark.quick(rows=lambda name, direction, share: share == "a sample")
@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("direction", ["tx", "rx"])
@pytest.mark.parametrize("share", EACH)
def test_no_corrupted_grbl_line_moves_the_stage_down_or_sideways(name: str, direction: Direction, share: str) -> None:
    motion = MOTIONS[name]
    faultless, end = _made(motion)
    assert (end, _wrong(motion, faultless, end)) == ("arrived", "")
    found: dict[str, list[Fault]] = {}
    for fault in islice(_faults(faultless.messages, direction), 0, None, EACH[share][direction]):
        wire, end = _made(motion, fault)
        found.setdefault(_wrong(motion, wire, end), []).append(fault)
    found.pop("", None)
    assert not found
