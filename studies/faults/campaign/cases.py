"""Which faults strike which messages: the census of a bench, and the list of its cases.

A census plays each scenario undisturbed and notes every message. Its *shape* is what it is besides its numbers:
digits of text masked, a frame's transaction, register values and checksum left out. Of each shape in a phase

- the first message gets every fault,
- so does the one at the highest force,
- and every other message gets those that hit a byte which no message struck before had at that place. The messages at
  the highest forces come first. (Not of what a device sends as RTU: its checksum is wrong whatever the values are.)

`EXACT` phases strike every distinct message of the program whole. So every byte of every distinct message is flipped,
dropped, doubled, swapped and cut at least once. Words that the same kind of program exchanges again under force
(`AGAIN`) are struck there, not in the air.
"""

import os
import re
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
    return message.phase, message.wire, message.way, content(message.data)


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
        groups.setdefault((message.phase, message.wire, message.way, shape(message.data)), []).append(message)
    found: dict[int, list[WireFault]] = {}
    for (phase, _, way, _), group in groups.items():
        whole = {group[0].number, max(group, key=lambda m: m.force_gwt).number}
        if way == "to" and phase in EXACT:
            by_content = {content(m.data): m.number for m in sorted(group, key=lambda m: m.force_gwt)}
            whole |= set(by_content.values())
        met: set[tuple[int, int]] = set()
        for message in sorted(group, key=lambda m: (m.number not in whole, -m.force_gwt, m.number)):
            new = {at for at, byte in enumerate(content(message.data)) if (at, byte) not in met}
            met |= set(enumerate(content(message.data)))
            sealed = way == "from" and not any(known(message.data) for known in (_is_text, _is_tcp, _is_tmcl))
            if message.number not in whole and (sealed or not new):
                continue
            faults = list(wire_faults(message.data, from_device=way == "from"))
            if message.number not in whole:
                faults = [f for f in faults if f.kind in ("flip", "drop", "double", "swap") and f.at in new]
            if faults:
                found[message.number] = faults
    return found


def is_command(message: Message) -> bool:
    """Whether it tells the stage something, and does not only ask."""
    if message.wire != "stage" or message.way != "to":
        return False
    data = message.data
    if data.startswith(b"/"):
        return re.search(rb" \d\d (home|move|stop|estop|set|warnings clear)", data) is not None
    if is_ximc(data):
        return data[:1] not in b"g\0"
    if _is_tmcl(data):
        return data[1] not in (6, 136) and (data[1], data[2]) != (13, 2)
    if _is_text(data):
        return data.endswith(b"\n")
    return data[7 if _is_tcp(data) else 1] != 3


_RECORD_BYTES, _LINES = 36, (b"<", b"[", b"@", b"!", b"#", b"/", b"$", b"G")
"""Length of a record of the Net F/T, and what lines of other devices begin with."""


def is_ximc(data: bytes) -> bool:
    """Whether it is a frame of a Standa controller: four letters and perhaps a payload, or zero bytes."""
    return re.match(rb"[a-z]{4}|\0{4}", data) is not None and re.fullmatch(rb"[ -~\t]*\r?\n", data) is None


def _is_text(data: bytes) -> bool:
    return data.endswith(b"\n") or len(data) <= 3


def _is_tmcl(data: bytes) -> bool:
    """Whether it is a frame of a Trinamic module; a reply with two registers of RTU is as long."""
    return len(data) == 9 and data[1:3] != b"\3\4" and sum(data[:8]) & 0xFF == data[8]


def _is_tcp(data: bytes) -> bool:
    return len(data) >= 8 and data[2:4] == b"\0\0" and int.from_bytes(data[4:6], "big") == len(data) - 6


def shape(data: bytes) -> str:
    """What a message is besides its numbers."""
    if len(data) == _RECORD_BYTES and not data.startswith(_LINES):
        return "record"
    if is_ximc(data) or _is_tmcl(data):
        return f"{data[:4].hex()} {len(data)}"
    if _is_text(data):
        return re.sub(r"[0-9]", "#", content(data).decode("latin-1"))
    body = data[6:] if _is_tcp(data) else data[:-2]
    answers = body[1] == 3 and len(body) > 2 and body[2] == len(body) - 3
    return f"{body[: 3 if answers else 6].hex()} {len(body)}"


def content(data: bytes) -> bytes:
    """A message without what changes although nothing is said anew: its transaction, its checksum."""
    if is_ximc(data):
        return data if len(data) == 4 else data[:-2] + b"\0\0"
    if _is_tmcl(data):
        return data
    if _is_text(data):
        return _of_a_chain(data)
    return b"\0\0" + data[2:] if _is_tcp(data) else data[:-2] + b"\0\0"


_CHAIN = re.compile(rb"([/@]\d+ \d+ )\d\d((?: .*)?:)[0-9A-F]{2}(\r?\n)", re.S)


def _of_a_chain(data: bytes) -> bytes:
    """A line of a Zaber chain without its id and its checksum; any other line as it is."""
    found = _CHAIN.fullmatch(data)
    return data if found is None else b"00".join(found.groups())
