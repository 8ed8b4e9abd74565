"""A virtual bench with real drivers, on which a wire or a device can be made to fail."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pymodbus.framer import FramerRTU

from rig.bench.virtual import stage_opener, true_carriage, virtual_force, virtual_line, virtual_stage
from rig.data.events import streams_with
from rig.devices.make_drivers import force_driver, stage_driver
from rig.devices.registry import ForceKind, find
from rig.engine import Engine, Journal, Target
from rig.engine.bench import NO_PAUSE, Meanwhile
from rig.engine.limits import Stopping
from rig.plan.config import Config
from rig.session.rehearse import Spring
from rig.transport import LoopbackTransport
from rig.units import GWT_N
from sim.devices.clock import VirtualClock
from sim.devices.line import Load, SerialLine

TARGET = Target("force_gwt", 8.0)
PREDICTED = Spring(contact_mm=-0.3, doi_mm=1.0, force_n=10 * GWT_N, exponent=1.5)
SOFT_TRIP_N = 2 * TARGET.value * GWT_N
LOOK_S = 0.002
NEVER = math.nan, math.nan
FAR_MM, FAR_LOOKS = 1.0, 10
"""So far above the finger nothing that moves at up to 50 mm/s gets there in as many looks: one of them is made."""

Change = Callable[[bytes], list[bytes]]


def bound_gwt() -> float:
    """Return the soft trip, and what the worst increment may add."""
    trip_gwt = SOFT_TRIP_N / GWT_N
    return trip_gwt + Stopping.of(Config(), 1.0).overshoot_gwt(trip_gwt, PREDICTED.force_n / GWT_N, PREDICTED.doi_mm)


class FaultyBench:
    """A finger of springs under real drivers; what the devices send can be changed on its way."""

    virtual = False  # Its devices are asked in rests, too.
    _seen = NEVER  # the time and height of a look under way

    def __init__(self, folder: Path, tables: Mapping[str, Any]) -> None:
        self.config = config = Config.model_validate(tables)
        self.clock = clock = VirtualClock(1.7e9)
        self.stage_line, self.force_line = virtual_line(clock, config.stage), virtual_line(clock, config.force)
        self.board: Any = virtual_stage(clock, self.stage_line, config)
        self.carriage = true_carriage(self.board, config)
        self.extra_n: Callable[[float], float] = lambda t_s: 0.0
        self.stalled_mm: float | None = None
        self.nearer_mm = 0.0  # the finger has come up by so much
        self.felt_n: Callable[[float], float] = lambda t_s: self.true_n(t_s) + self.extra_n(t_s)
        load = Load(lambda t_s: self.felt_n(t_s))
        self.sensor: Any = virtual_force(clock, self.force_line, config, load)
        self.stage_wire = LoopbackTransport(self.stage_line, clock, "stage")
        self.force_wire = LoopbackTransport(self.force_line, clock, "force")
        self.stage = stage_driver(stage_opener(config, self.stage_line, self._stage_wire), clock, config)
        self.force = force_driver(lambda _: self.force_wire, clock, config)
        self.on_sample: dict[str, Callable[[], object]] = {}
        self.journal_path = folder / "events.jsonl"
        streams = streams_with(find(ForceKind, config.force.kind).also)
        self.journal = Journal(self.journal_path, clock, streams, self._watch, virtual=True)
        self.operator, self.pause = self, NO_PAUSE
        self.engine = Engine(config, self, self.journal, SOFT_TRIP_N)
        self.worst_n = 0.0
        self._look()

    def _stage_wire(self, line: SerialLine, name: str) -> LoopbackTransport:
        return self.stage_wire if line is self.stage_line else LoopbackTransport(line, self.clock, name)

    def mount(self, indentor: str, meanwhile: Meanwhile) -> str:
        """Whatever is asked for."""
        return indentor

    @property
    def height_mm(self) -> float:
        """Where the carriage really is."""
        return self._above_apex_mm(self.clock.monotonic_s())

    def _above_apex_mm(self, t_s: float) -> float:
        """The height of the carriage; that of a look is worked out once."""
        return self._seen[1] if t_s == self._seen[0] else self.carriage.pose_at(t_s).above_apex_mm

    def reached_mm(self, height_mm: float) -> float:
        """Where the indentor is for the finger, with the carriage at this height."""
        return (height_mm if self.stalled_mm is None else max(height_mm, self.stalled_mm)) - self.nearer_mm

    def true_n(self, t_s: float) -> float:
        """What the finger really feels."""
        return PREDICTED.force_at(self.reached_mm(self._above_apex_mm(t_s)))

    def after(self, phase: str, act: Callable[[], object]) -> None:
        """Do it once, when the first sample of this phase, or event of this stream, is on disk."""
        self.on_sample[phase] = act

    def change(self, line: SerialLine, change: Change) -> None:
        """From now on what the device sends goes through this."""
        send = line.device_write

        def changed(data: bytes) -> None:
            for part in change(data):
                send(part)

        line.device_write = changed  # type: ignore[method-assign]

    def _look(self) -> None:
        at_s = self.clock.monotonic_s()
        self._seen = at_s, self.height_mm
        far = self.reached_mm(self._seen[1]) > PREDICTED.contact_mm + FAR_MM
        if not far:
            self.worst_n = max(self.worst_n, self.true_n(at_s))
        self._seen = NEVER
        self.engine.heartbeat.look()
        for _ in range(FAR_LOOKS if far else 1):
            at_s += LOOK_S
        self.clock.call_at(at_s, self._look)

    def _watch(self, stream: str, data: Mapping[str, Any]) -> None:
        act = self.on_sample.pop(data["phase"] if stream == "sample" else stream, None)
        if act is not None:
            act()


def once(change: Change) -> Change:
    """The first time only that it makes a difference."""
    done: list[bool] = []

    def changed(data: bytes) -> list[bytes]:
        if done:
            return [data]
        found = change(data)
        if found != [data]:
            done.append(True)
        return found

    return changed


def lost(what: bytes) -> Change:
    """These bytes never arrive."""
    return lambda data: [data.replace(what, b"")]


def framed(device_id: int, content: bytes) -> bytes:
    """An RTU frame with a right CRC."""
    body = bytes([device_id]) + content
    return body + FramerRTU.compute_CRC(body).to_bytes(2, "big")


def bad_crc(data: bytes) -> list[bytes]:
    """Its last byte changed."""
    return [data[:-1] + bytes([data[-1] ^ 0x55])]


def swapped(data: bytes) -> list[bytes]:
    """Registers of a weight low word first: the answer to a read of registers 6 to 13."""
    if data[1] != 3 or data[2] != 16:
        return [data]
    words = [data[n : n + 2] for n in range(3, 19, 2)]
    for high in (1, 3, 5):
        words[high], words[high + 1] = words[high + 1], words[high]
    return [framed(data[0], data[1:3] + b"".join(words))]


def delayed(bench: FaultyBench, line: SerialLine, seconds: float) -> None:
    """Every answer comes so much later."""
    send = line.device_write

    def later(data: bytes) -> None:
        bench.clock.call_at(bench.clock.monotonic_s() + seconds, lambda: send(data))

    line.device_write = later  # type: ignore[method-assign]
