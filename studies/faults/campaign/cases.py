"""Which faults strike which messages: the census of a bench, and the list of its cases.

A census plays each scenario undisturbed and notes every message. Its *shape* is what it is besides its numbers
(`studies/faults/campaign/messages.py`). Of each shape in a phase

- the first message gets every fault,
- so does the one at the highest force,
- and every other message gets those that hit a byte which no message struck before had at that place. The messages at
  the highest forces come first. (Not of what a device sends with a checksum that notices every change.)

`EXACT` phases strike every distinct message of the program whole. So every byte of every distinct message is flipped,
dropped, doubled, swapped and cut at least once. Words that the same kind of program exchanges again under force
(`AGAIN`) are struck there, not in the air.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from studies.faults.campaign.faults import CELLS, MECHANICAL, WireFault, wire_faults
from studies.faults.campaign.scenarios import HAND, RESUME, SCENARIOS, Scenario
from studies.faults.campaign.world import Message, VirtualWorld

EXACT = ("press", "hold", "lift", "sideways", "home", "zero", "resume", "home by hand", "jog up", "jog sideways")
"""Phases in which every distinct message of the program is struck whole."""
AGAIN: dict[str, tuple[str, Scenario]] = {"home": ("resume", RESUME), "jog down": ("home by hand", HAND)}
"""Phases in the air, and the phase and scenario in which the finger is pressed and the same words are exchanged."""


@dataclass(frozen=True)
class FaultCase:
    """One fault in one phase on one bench; what strikes is a message, or a pair of carriage and cell."""

    bench: str
    scenario: str
    phase: str
    message: int  # its number in the scenario
    wire: str = ""
    way: str = ""
    fault: WireFault | None = None
    mechanics: str = "none"
    cell: str = "none"
    data: bytes = b""
    force_gwt: float = 0.0  # the true one as it strikes

    @property
    def kind(self) -> str:
        """The class of the fault."""
        return "pair" if self.fault is None else f"{self.fault.kind} {self.way} {self.wire}"

    @property
    def name(self) -> str:
        """Unique, and enough to find it again at the same commit."""
        what = f"{self.mechanics} + {self.cell}" if self.fault is None else f"{self.wire} {self.way} {self.fault}"
        return f"{self.bench}/{self.phase}/{self.message}/{what}"


def census(bench: str, scenario: Scenario, folder: Path) -> list[Message]:
    """Every message of a scenario that nothing disturbs, on a bench that no command has used before."""
    os.environ["RIG_STATE_DIR"] = str(folder / "state")
    world, found = VirtualWorld(bench), list[Message]()

    def noted(message: Message) -> list[tuple[float, bytes]]:
        found.append(message)
        return [(0.0, message.data)]

    world.tap = noted
    finished = scenario.play(world, folder / "run")
    if finished.exit != "done":
        raise RuntimeError(f"{bench}, {scenario.name}: undisturbed it ended {finished.exit}: {finished.reason}")
    return found


def cases(bench: str, folder: Path, scenarios: Sequence[Scenario] = SCENARIOS) -> Iterator[FaultCase]:
    """Every case of a bench, in the order of its messages."""
    for scenario in scenarios:
        messages = [m for m in census(bench, scenario, folder / f"{bench}-{scenario.name}") if m.phase]
        again = _again(bench, {message.phase for message in messages}, folder)
        struck = _struck([m for m in messages if _words(m) not in again])
        begun: set[str] = set()
        for message in messages:
            about = bench, scenario.name, message.phase, message.number
            of_message: dict[str, Any] = {"data": message.data, "force_gwt": message.force_gwt}
            if message.phase not in begun:
                begun.add(message.phase)
                for mechanics in MECHANICAL:
                    for cell in CELLS:
                        yield FaultCase(*about, mechanics=mechanics, cell=cell, **of_message)
            for fault in struck.get(message.number, ()):
                yield FaultCase(*about, message.wire, message.way, fault, **of_message)


def _words(message: Message) -> tuple[str, str, str, bytes]:
    """What is exchanged in a phase, whenever it is."""
    return message.phase, message.wire, message.way, message.content


def _again(bench: str, phases: set[str], folder: Path) -> set[tuple[str, str, str, bytes]]:
    """The words of some phases that are exchanged again under force."""
    found = set()
    for phase in phases & set(AGAIN):
        under_force, scenario = AGAIN[phase]
        for message in census(bench, scenario, folder / f"again-{bench}-{scenario.name}"):
            if message.phase == under_force and message.force_gwt > 0:
                found.add((phase, *_words(message)[1:]))
    return found


def _struck(messages: Sequence[Message]) -> dict[int, list[WireFault]]:
    """The faults of each message, by its number."""
    groups: dict[tuple[str, ...], list[Message]] = {}
    for message in messages:
        groups.setdefault((message.phase, message.wire, message.way, message.shape), []).append(message)
    found: dict[int, list[WireFault]] = {}
    for (phase, _, way, _), group in groups.items():
        whole = {group[0].number, max(group, key=lambda m: m.force_gwt).number}
        if way == "to" and phase in EXACT:
            by_content = {m.content: m.number for m in sorted(group, key=lambda m: m.force_gwt)}
            whole |= set(by_content.values())
        met: set[tuple[int, int]] = set()
        for message in sorted(group, key=lambda m: (m.number not in whole, -m.force_gwt, m.number)):
            new = {at for at, byte in enumerate(message.content) if (at, byte) not in met}
            met |= set(enumerate(message.content))
            sealed = way == "from" and message.language.sealed
            if message.number not in whole and (sealed or not new):
                continue
            faults = list(wire_faults(message.data, from_device=way == "from"))
            if message.language.sealed:
                faults = [fault for fault in faults if fault.kind != "swap"]
            if message.number not in whole:
                faults = [f for f in faults if f.kind in ("flip", "drop", "double", "swap") and f.at in new]
            if faults:
                found[message.number] = faults
    return found
