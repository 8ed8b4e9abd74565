"""An engine over a stub stage and a stub force sensor: no bytes, no devices, no finger."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from rig.devices.base import LOOK_S, ForceReading, StageNotHomed, StageStatus
from rig.engine import Engine, Pause, verbs
from rig.engine.bench import Meanwhile
from rig.engine.contact import KnownContact
from rig.engine.limits import Heartbeat
from rig.engine.sensing import ForceZero
from rig.settings import RigSettings
from rig.units import GWT_N
from sim.devices.clock import VirtualClock


def raising(error: Exception) -> Callable[..., None]:
    """What a stage, a sensor or a journal is told that shall fail."""

    def fail(*_: object) -> None:
        raise error

    return fail


class StubStage:
    """Moves at the speed it is told, in a straight line; before each look it does what `at_look` says."""

    switches_mm, homing_s = (-7.0, -3.0, -1.0), 0.3

    def __init__(self, clock: VirtualClock) -> None:
        self.clock, self.homed = clock, False
        self.told: list[Any] = []
        self.at_mm = list(self.switches_mm)
        self.state = "Idle"
        self.silent = False  # whether it says nothing while it moves
        self.at_look: Callable[[], object] = lambda: None
        self.at_stop: Callable[[], object] = lambda: None
        self.floors_mm: list[float] = []

    def connect(self) -> str:
        return "stub stage"

    def homing(self) -> Iterator[StageStatus | None]:
        self.told.append("home")
        yield from self._going(list(self.switches_mm), self.homing_s)
        self.homed = True

    def moving(
        self,
        *,
        x_mm: float | None = None,
        y_mm: float | None = None,
        z_mm: float | None = None,
        speed_mm_s: float,
        look_s: float = LOOK_S,
    ) -> Iterator[StageStatus | None]:
        if not self.homed:
            raise StageNotHomed("the stub stage")
        to_mm = [was if to is None else to for was, to in zip(self.at_mm, (x_mm, y_mm, z_mm), strict=True)]
        self.told.append((*to_mm, speed_mm_s))
        lasts_s = max(abs(to - was) for to, was in zip(to_mm, self.at_mm, strict=True)) / speed_mm_s
        yield from self._going(to_mm, lasts_s)

    def limit_depth(self, lowest_z_mm: float) -> None:
        self.floors_mm.append(lowest_z_mm)

    def allow_unhomed_jogs(self) -> None:
        """It jogs unhomed."""

    def halt(self) -> None:
        self.told.append("halt")

    def stop(self) -> None:
        self.told.append("stop")
        self.homed = False
        self.at_stop()

    def unlock(self) -> None:
        self.told.append("unlock")

    def steps_per_mm(self, axis: str) -> float:
        return 400.0

    def jog(self, axis: str, mm: float, speed_mm_s: float) -> None:
        self.told.append(("jog", axis, mm))
        self.clock.wait_s(abs(mm) / speed_mm_s)
        self.at_mm["xyz".index(axis)] += mm

    def end_jog(self) -> None:
        """At rest already."""

    def status(self) -> StageStatus:
        return StageStatus(self.state, *self.at_mm)

    def _going(self, to_mm: list[float], lasts_s: float) -> Iterator[StageStatus | None]:
        from_mm, begun_s = list(self.at_mm), self.clock.monotonic_s()
        share = 0.0
        while share < 1.0:
            self.clock.wait_s(LOOK_S)
            share = min((self.clock.monotonic_s() - begun_s) / max(lasts_s, LOOK_S), 1.0)
            self.at_mm = [was + share * (to - was) for was, to in zip(from_mm, to_mm, strict=True)]
            self.at_look()
            yield None if self.silent else self.status()
        self.at_mm = list(to_mm)


class StubSensor:
    """Shows what it is told, gwt; `at_read` may raise, or change what it shows."""

    sample_period_s, resolution_gwt = 0.05, 0.01

    def __init__(self, clock: VirtualClock) -> None:
        self.clock, self.shows_gwt, self.stable, self.age_s = clock, 0.0, True, 0.0
        self.read_s: list[float] = []
        self.at_read: Callable[[], object] = lambda: None

    def connect(self) -> str:
        return "stub sensor"

    def read(self) -> ForceReading:
        self.read_s.append(self.clock.monotonic_s())
        self.at_read()
        return ForceReading(self.shows_gwt * GWT_N, self.stable, self.clock.monotonic_s() - self.age_s)

    def zero(self) -> None:
        """It has no zero of its own."""


class Promises(Heartbeat):
    """A heartbeat that keeps for how long each beat was."""

    def __init__(self, clock: VirtualClock, stop: Callable[[], None]) -> None:
        super().__init__(clock, stop)
        self.within_s: list[float] = []

    def beat(self, within_s: float) -> None:
        self.within_s.append(within_s)
        super().beat(within_s)


class KeptMemory:
    """Memory that keeps what it is given in lists."""

    def __init__(
        self,
        contacts: list[KnownContact] | None = None,
        zeros: list[ForceZero | None] | None = None,
        touched: Callable[[KnownContact], None] = lambda known: None,
    ) -> None:
        self.contacts, self._touched = [] if contacts is None else contacts, touched
        self.zeros = [] if zeros is None else zeros

    def touched(self, known: KnownContact) -> None:
        self.contacts.append(known)
        self._touched(known)

    def record_zero(self, zero: ForceZero | None) -> None:
        self.zeros.append(zero)


class StubBench:
    """The engine, its bench, and what it has journalled; `at_event` may raise."""

    virtual, begins_at_s = False, 100.0
    make_stage: type[StubStage] = StubStage

    def __init__(
        self, tables: Mapping[str, Any] | None = None, soft_trip_n: float | None = None, **before: Any
    ) -> None:
        self.settings = RigSettings.model_validate(tables or {})
        self.clock = VirtualClock(1.7e9, self.begins_at_s)
        self.stage, self.force = self.make_stage(self.clock), self.make_force()
        self.operator, self.pause = self, Pause()
        self.events: list[tuple[str, dict[str, Any]]] = []
        self.at_event: Callable[[str], object] = lambda stream: None
        self.engine = Engine(self.settings, self, self, soft_trip_n, **before)

    def make_force(self) -> Any:
        """Return the sensor of the bench."""
        return StubSensor(self.clock)

    def mount(self, indentor: str, meanwhile: Meanwhile) -> str:
        return indentor

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        self.at_event(stream)
        self.events.append((stream, dict(data)))

    def settle(self) -> None:
        """There is no disk."""

    def of(self, stream: str) -> list[dict[str, Any]]:
        """The events of one stream so far."""
        return [data for name, data in self.events if name == stream]

    def ready(self) -> Engine:
        """Mounted, homed, zeroed and over x = 0, at clearance; the machine's frame is the usual one."""
        verbs.mount(self.engine, "bar:3.0")
        verbs.home(self.engine)
        verbs.zero(self.engine)
        verbs.move_to(self.engine, 0.0)
        return self.engine

    def in_contact(self, height_mm: float = 1.95) -> Engine:
        """Ready, and an increment below clearance."""
        self.ready().go_to_height(height_mm, 0.5)
        return self.engine

    def promises(self) -> list[float]:
        """From here on, for how long each beat is."""
        self.engine.heartbeat = promises = Promises(self.clock, self.engine._stop_stage)
        return promises.within_s

    @property
    def height_mm(self) -> float:
        """Where the stage is."""
        return self.stage.at_mm[2] - self.settings.frame.apex_z_mm
