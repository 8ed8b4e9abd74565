"""The faults of the campaign: of a wire with one message, of a carriage with its commands, of a cell.

A fault is data.
"""

import math
from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rig.units import GWT_N

if TYPE_CHECKING:
    from studies.faults.campaign.world import VirtualWorld

LATE_S = (0.1, 0.5, 2.0)


@dataclass(frozen=True)
class WireFault:
    """What happens to one message: `kind` at byte `at` (and bit `bit`); late_s for a late one."""

    kind: str
    at: int = 0
    bit: int = 0
    late_s: float = 0.0

    def __str__(self) -> str:
        if self.kind == "late":
            return f"late {self.late_s:g} s"
        return f"{self.kind} {self.at}" + (f".{self.bit}" if self.kind == "flip" else "")

    def pieces(self, data: bytes) -> list[tuple[float, bytes]]:
        """What arrives, each piece late by so many seconds."""
        at = self.at
        if self.kind == "late":
            return [(self.late_s, data)]
        if self.kind == "twice":
            return [(0.0, data), (0.0, data)]
        changed = {
            "flip": lambda: data[:at] + bytes([data[at] ^ 1 << self.bit]) + data[at + 1 :],
            "drop": lambda: data[:at] + data[at + 1 :],
            "double": lambda: data[: at + 1] + data[at:],
            "swap": lambda: data[:at] + data[at + 1 : at + 2] + data[at : at + 1] + data[at + 2 :],
            "cut": lambda: data[:at],
        }[self.kind]()
        return [(0.0, changed)] if changed else []


def wire_faults(data: bytes, *, from_device: bool) -> Iterator[WireFault]:
    """Every fault of a message, those that arrive as another one does left out.

    Each byte with each bit flipped, dropped, doubled, and swapped with the next one; the message cut at every length,
    nothing at all included; the whole message twice; and what a device sends late by LATE_S.
    """
    found = [WireFault("flip", at, bit) for at in range(len(data)) for bit in range(8)]
    for kind in ("drop", "double"):
        found += [WireFault(kind, at) for at in range(len(data))]
    found += [WireFault("swap", at) for at in range(len(data) - 1)]
    found += [WireFault("cut", at) for at in range(len(data))]
    found.append(WireFault("twice"))
    seen: set[tuple[tuple[float, bytes], ...]] = {((0.0, data),)}
    for fault in found:
        arrives = tuple(fault.pieces(data))
        if arrives not in seen:
            seen.add(arrives)
            yield fault
    if from_device:
        yield from (WireFault("late", late_s=late_s) for late_s in LATE_S)


# --- carriage ---

_STEP_S = 0.002
_AT_SWITCH_MM, _NEAR_SWITCH_MM = 0.05, 1.5
_RUN_ON_S, _RUN_ON_MM_S = 0.25, 1.0
_BACKLASH_MM = 0.3

Followed = Callable[[float], float]
"""How far the carriage goes where it was told to go so far, mm."""


def _times(factor: float) -> Followed:
    return lambda mm: factor * mm


MECHANICAL: dict[str, dict[str, Followed]] = {
    "none": {},
    "z stalls": {"z": _times(0.0)},
    "x stalls": {"x": _times(0.0)},
    "z slips going up": {"z": lambda mm: 0.5 * mm if mm > 0 else mm},
    "z slips going down": {"z": lambda mm: 0.5 * mm if mm < 0 else mm},
    "z backlash": {},
    "z runs on": {},
    "x runs on": {},
    "z travels 0.5": {"z": _times(0.5)},
    "z travels 0.8": {"z": _times(0.8)},
    "z travels 1.25": {"z": _times(1.25)},
    "z travels 2": {"z": _times(2.0)},
}
"""By name, how far each axis follows; what needs more than that is in `FaultyCarriage`."""

GOES_FARTHER = ("z slips going up", "z backlash", "z travels 1.25", "z travels 2")
"""Down, than it is told to."""
MENDED = "mended"
MOVES_WITHOUT_COMMAND = ("z runs on", "x runs on")


class FaultyCarriage:
    """A carriage that follows its commands wrongly from an instant on; the controller notices nothing of it.

    Where it is told to be at a home switch, and is not stalled, it is there. Once mended it keeps its offset until it
    is homed. A stalled Z never comes to its switch, and a controller that homes Z first does not go on to X: while it
    is told to be near that switch nothing moves. (The virtual controllers believe in the switch all the same.)
    """

    def __init__(self, world: "VirtualWorld", kind: str) -> None:
        self._world, self.kind, self._from_s = world, kind, world.clock.monotonic_s()
        self._followed = dict(MECHANICAL[kind])
        pose = world.carriage.pose_at(self._from_s)
        self._told = (pose.x_mm, pose.above_apex_mm)
        self._times_s, self._true = [self._from_s], [world.pose_mm(self._from_s)]
        self._runs_on_s = [0.0, 0.0]
        self._way = [0.0, 0.0]
        frame = world.config.frame
        self._switch_mm = (-frame.pad_centre_x_mm, -frame.apex_z_mm)
        self._play_mm = 0.0

    def mend(self) -> None:
        """It follows again."""
        self.pose_mm(self._world.clock.monotonic_s())
        self.kind, self._followed = MENDED, {}

    def pose_mm(self, t_s: float) -> tuple[float, float]:
        """True x and height; the past is as it was."""
        if t_s < self._from_s:
            pose = self._world.carriage.pose_at(t_s)
            return pose.x_mm, pose.above_apex_mm
        last_s = self._times_s[-1]
        if t_s < last_s:
            return self._true[bisect_right(self._times_s, t_s) - 1]
        if not self._goes_straight(t_s):
            for n in range(1, int((t_s - last_s) / _STEP_S) + 1):
                self._advance(last_s + n * _STEP_S)
        if t_s > self._times_s[-1]:
            self._advance(t_s)
        return self._true[-1]

    def _goes_straight(self, t_s: float) -> bool:
        """Whether nothing happens on the way to an instant that its end would not show."""
        pose = self._world.carriage.pose_at(t_s)
        rests = (pose.x_mm, pose.above_apex_mm) == self._told and max(self._runs_on_s) <= 0
        return rests or self.kind == MENDED

    def _advance(self, t_s: float) -> None:
        pose = self._world.carriage.pose_at(t_s)
        now, x_z, for_s = (pose.x_mm, pose.above_apex_mm), list(self._true[-1]), t_s - self._times_s[-1]
        homing = self.kind == "z stalls" and now[1] > self._switch_mm[1] - _NEAR_SWITCH_MM
        near_mm = _NEAR_SWITCH_MM if self.kind == MENDED else _AT_SWITCH_MM
        for n, axis in enumerate("xz"):
            moved = 0.0 if homing else now[n] - self._told[n]
            x_z[n] += self._step(n, axis, moved, for_s)
            if not homing and self.kind != f"{axis} stalls" and now[n] >= self._switch_mm[n] - near_mm:
                x_z[n] = now[n]
        self._told = now
        self._times_s.append(t_s)
        self._true.append((x_z[0], x_z[1]))

    def _step(self, n: int, axis: str, moved: float, for_s: float) -> float:
        if axis in self._followed:
            return self._followed[axis](moved)
        if self.kind == "z backlash" and axis == "z":
            # Down at once, up only when the play is taken up: the indentor stays down.
            before = self._play_mm
            self._play_mm = min(max(before + moved, 0.0), _BACKLASH_MM)
            return moved - (self._play_mm - before)
        if self.kind == f"{axis} runs on":
            if moved:
                self._way[n], self._runs_on_s[n] = math.copysign(1.0, moved), _RUN_ON_S
            elif self._runs_on_s[n] > 0:
                self._runs_on_s[n] -= for_s
                return self._way[n] * _RUN_ON_MM_S * for_s
        return moved


# --- cell ---

DRIFT_GWT_S, SATURATED_GWT, CELL_LATE_S = 0.2, 1.0, 0.5


def cell(world: "VirtualWorld", kind: str) -> Callable[[float], float]:
    """What a cell that fails now shows from now on, N at an instant."""
    from_s, true_n = world.clock.monotonic_s(), world.true_n
    frozen_n = true_n(from_s)
    found: dict[str, Callable[[float], float]] = {
        "none": true_n,
        "frozen": lambda t_s: frozen_n,
        "reads 0.1": lambda t_s: 0.1 * true_n(t_s),
        "reads 0.5": lambda t_s: 0.5 * true_n(t_s),
        "reads 2": lambda t_s: 2.0 * true_n(t_s),
        "saturated": lambda t_s: min(true_n(t_s), SATURATED_GWT * GWT_N),
        "negated": lambda t_s: -true_n(t_s),
        "drifts up": lambda t_s: true_n(t_s) + DRIFT_GWT_S * GWT_N * max(t_s - from_s, 0.0),
        "drifts down": lambda t_s: true_n(t_s) - DRIFT_GWT_S * GWT_N * max(t_s - from_s, 0.0),
        "late": lambda t_s: true_n(max(t_s - CELL_LATE_S, 0.0)),
    }
    return found[kind]


CELLS = (
    "none",
    "frozen",
    "reads 0.1",
    "reads 0.5",
    "reads 2",
    "saturated",
    "negated",
    "drifts up",
    "drifts down",
    "late",
)
"""How a cell fails."""

READS_LOW = ("reads 0.1",)
"""Cells that read low by more than half."""
