"""The virtual bench of the campaign: real drivers and bytes, a finger of springs, and the truth beside them."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, Self

from rig.bench.virtual import (
    looked_after_by,
    stage_opener,
    true_carriage,
    virtual_force,
    virtual_line,
    virtual_stage,
)
from rig.devices.base import ForceSensor, Stage, StageError
from rig.devices.make_drivers import force_driver, stage_driver
from rig.devices.registry import BUILT_IN, kind_of
from rig.engine import Journal
from rig.engine.bench import NO_PAUSE, Meanwhile, Pause
from rig.engine.bench_memory import BenchMemory, LastKnown
from rig.engine.limits import Heartbeat
from rig.engine.sensing import ForceZero
from rig.plan.config import Config
from rig.transport import TransportError
from rig.transport.wire import LoopbackTransport
from rig.units import GWT_N
from sim.devices.clock import VirtualClock
from sim.devices.line import Load, SerialLine
from studies.faults.campaign.messages import Language, language
from studies.faults.faulty_bench import PREDICTED, SOFT_TRIP_N

TRUTH_S = 0.002
"""How often the true force is computed, where the indentor could come to the finger within that."""
_FASTEST_MM_S, _LONGEST_LOOK_S = 50.0, 0.1

_ALWAYS: Mapping[str, Any] = {
    "limits": {"soft_trip_n": SOFT_TRIP_N},
    "frame": {"apex_z_mm": -12.0},  # a shorter way down than the default, and as many digits
    "habits": {"clearance_mm": 1.0},
}
_MODBUS: dict[str, dict[str, Any]] = {"stage": {"kind": "leadshine"}, "force": {"kind": "laumas", "baud": 115200}}
_TCP = {name: {**device, "framing": "tcp"} for name, device in _MODBUS.items()}
_FIRST: dict[str, Mapping[str, Any]] = {"grbl": {}, "rtu": _MODBUS, "tcp": _TCP}
_OTHER_KINDS = [(room, name) for room, kinds in BUILT_IN.items() for name in kinds[1:]]
BENCHES: dict[str, Mapping[str, Any]] = _FIRST | {
    name: {room: {"kind": name}}
    for room, name in _OTHER_KINDS
    if not any(bench.get(room, {}).get("kind") == name for bench in _FIRST.values())
}
"""GRBL with MT-SICS; Leadshine with Laumas as Modbus RTU, and in the frames of Modbus TCP; every other kind in the
registry in the place of the usual one."""

Way = Literal["to", "from"]
"""To the device, or from it."""


@dataclass(frozen=True)
class Message:
    """One write of the program, or one line or frame of a device.

    t_s and force_gwt (the true one) are those of its instant, phase is what the rig was doing.
    """

    language: Language
    number: int
    phase: str
    wire: str
    way: Way
    data: bytes
    t_s: float
    force_gwt: float

    @property
    def shape(self) -> str:
        """What it is besides its numbers."""
        return self.language.shape(self.data)

    @property
    def content(self) -> bytes:
        """Without what changes although nothing is said anew."""
        return self.language.content(self.data)

    @property
    def is_command(self) -> bool:
        """Whether it tells the stage something, and does not only ask."""
        return self.wire == "stage" and self.way == "to" and self.language.is_command(self.data)


Tap = Callable[[Message], list[tuple[float, bytes]]]
"""What becomes of a message: pieces, each late by so many seconds."""


def untouched(message: Message) -> list[tuple[float, bytes]]:
    """The message as it is."""
    return [(0.0, message.data)]


class FaultMechanics(Protocol):
    """What a fault of the carriage makes of a commanded pose (x and height above the apex, mm)."""

    def pose_mm(self, t_s: float) -> tuple[float, float]:
        """Where the indentor truly is at an instant."""


@dataclass
class Worst:
    """The highest true force (gwt) since it was last cleared, and mm moved sideways while touching."""

    force_gwt: float = 0.0
    phase: str = ""
    drag_mm: float = 0.0


def config_of(bench: str) -> Config:
    """The configuration of a bench."""
    return Config.model_validate({**_ALWAYS, **BENCHES[bench]})


class VirtualWorld:
    """Virtual devices with a finger of springs between them; whoever connects comes and goes.

    phase and verb: what the rig is doing. journal: that of the run that is under way. folder: where the run is kept
    instead of where it began.
    """

    def __init__(self, bench: str) -> None:
        self.clock = clock = VirtualClock(1.7e9)
        self.config = config = config_of(bench)
        self.phase = self.verb = ""
        self.journal: Journal | None = None
        self.folder: Path | None = None
        self.tap: Tap = untouched
        self.messages = 0
        self.mechanics: FaultMechanics | None = None
        self.felt_n: Callable[[float], float] = self.true_n
        self.worst = Worst()
        self.languages: dict[str, Language] = {one.room: language(one) for one in (config.stage, config.force)}
        self.lines = {
            "stage": virtual_line(clock, config.stage),
            "force": virtual_line(clock, config.force),
        }
        self.board: Any = virtual_stage(clock, self.lines["stage"], config)
        self.carriage = true_carriage(self.board, config)
        load = Load(lambda t_s: self.felt_n(t_s))
        self.sensor: Any = virtual_force(clock, self.lines["force"], config, load)
        for name, line in self.lines.items():
            for one in (line, *line.further):
                self._tap_device(name, one)
        self._before: tuple[float, float] | None = None
        self.touch_n = config.habits.touch_force_gwt * GWT_N
        self._look()

    # the truth

    def pose_mm(self, t_s: float) -> tuple[float, float]:
        """True x from the pad's center and true height above the apex."""
        if self.mechanics is not None:
            return self.mechanics.pose_mm(t_s)
        pose = self.carriage.pose_at(t_s)
        return pose.x_mm, pose.above_apex_mm

    def true_n(self, t_s: float) -> float:
        """What the finger feels."""
        return PREDICTED.force_at(self.pose_mm(t_s)[1])

    @property
    def true_gwt(self) -> float:
        """What the finger feels now."""
        return self.true_n(self.clock.monotonic_s()) / GWT_N

    def _look(self) -> None:
        now_s = self.clock.monotonic_s()
        x_mm, height_mm = self.pose_mm(now_s)
        force_n = PREDICTED.force_at(height_mm)
        worst = self.worst
        if force_n > 0:
            if force_n > worst.force_gwt * GWT_N:
                worst.force_gwt, worst.phase = force_n / GWT_N, self.phase
            if force_n >= self.touch_n:
                if self._before is not None:
                    worst.drag_mm += abs(x_mm - self._before[0])
                self._before = (x_mm, height_mm)
            else:
                self._before = None
        else:
            self._before = None
        far_s = (height_mm - PREDICTED.contact_mm) / _FASTEST_MM_S
        self.clock.call_at(now_s + min(max(far_s, TRUTH_S), _LONGEST_LOOK_S), self._look)

    # the wires

    def passed(self, wire: str, way: Way, data: bytes) -> list[tuple[float, bytes]]:
        """What comes of a message at the other end."""
        now_s, language = self.clock.monotonic_s(), self.languages[wire]
        message = Message(language, self.messages, self.phase, wire, way, data, now_s, round(self.true_gwt, 3))
        self.messages += 1
        found = self.tap(message)
        if kind_of(getattr(self.config, wire)).datagrams:  # UDP and TCP drop what their checksum does not fit.
            return [(late_s, piece) for late_s, piece in found if piece == data]
        return found

    def later(self, late_s: float, action: Callable[[], None]) -> None:
        """At once, or on the clock."""
        if late_s:
            self.clock.call_at(self.clock.monotonic_s() + late_s, action)
        else:
            action()

    def _tap_device(self, name: str, line: SerialLine) -> None:
        send = line.device_write

        def tapped(data: bytes) -> None:
            for part in self.languages[name].messages(data):
                for late_s, piece in self.passed(name, "from", part):
                    self.later(late_s, lambda piece=piece: send(piece))  # type: ignore[misc]

        line.device_write = tapped  # type: ignore[method-assign]

    def wire(self, name: str, line: SerialLine | None = None) -> "TappedWire":
        """The host's end of a wire; line: of a further port of that device."""
        return TappedWire(self, line or self.lines[name], self.clock, name)

    def connected(self, *, moves: bool = True) -> "CampaignBench":
        """Fresh drivers on these devices: the bench of another program."""
        if self.config.stage.framing == "tcp":
            for line in self.lines.values():
                line.renewed()  # another connection
        force_wire = self.wire("force")
        memory = BenchMemory(self.config)
        before = memory.read()
        if moves:
            memory.moves()
        return CampaignBench(
            self,
            self.clock,
            stage_driver(
                stage_opener(self.config, self.lines["stage"], lambda line, _: self.wire("stage", line)),
                self.clock,
                self.config,
            ),
            force_driver(lambda _: force_wire, self.clock, self.config),
            before,
        )


class TappedWire(LoopbackTransport):
    """A wire whose writes go through the world's tap."""

    def __init__(self, world: VirtualWorld, line: SerialLine, clock: VirtualClock, name: str) -> None:
        super().__init__(line, clock, name)
        self._world, self._device = world, line

    def write(self, data: bytes) -> None:
        self._open_line()
        for late_s, piece in self._world.passed(self.name, "to", data):
            self._world.later(late_s, lambda piece=piece: self._device.host_write(piece))  # type: ignore[misc]


@dataclass(frozen=True)
class CampaignBench:
    """What the engine needs; its operator mounts what is asked for."""

    world: VirtualWorld
    clock: VirtualClock
    stage: Stage
    force: ForceSensor
    before: LastKnown
    pause: Pause = NO_PAUSE
    virtual: Literal[True] = True

    @property
    def operator(self) -> Self:
        """Nobody else is there."""
        return self

    @property
    def memory(self) -> BenchMemory:
        """What the next command finds."""
        return BenchMemory(self.world.config)

    def mount(self, indentor: str, meanwhile: Meanwhile) -> str:
        """The indentor that was asked for."""
        return indentor

    def witness(self, stream: str, data: Mapping[str, Any]) -> dict[str, float]:
        """The journal gets no truth here."""
        return {}

    def monitor(self, heartbeat: Heartbeat) -> AbstractContextManager[None]:
        """A timer of the virtual clock looks at it."""
        return looked_after_by(self.clock, heartbeat)

    def record_zero(self, zero: ForceZero | None) -> None:
        """As a real bench remembers it."""
        self.memory.record_zero(zero)

    def touched(self, known: Any) -> None:
        """What is known about contact, as a real bench records it."""
        memory: Any = self.memory
        memory.touched(known)

    def close(self) -> None:
        """Where a homed stage is left is remembered, as by a real bench."""
        if self.stage.homed:
            with suppress(StageError, TransportError):
                self.memory.left(self.stage.status())
