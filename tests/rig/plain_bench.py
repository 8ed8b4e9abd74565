"""A bench without a wire: its stage is exactly where it was told to be, its sensor shows what a test says."""

from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any

from rig.devices.base import LOOK_S, ForceReading, StageStatus
from rig.engine import Engine, PressId, verbs
from rig.engine.bench import Pause
from rig.engine.press import Press
from rig.records import ContactFit
from rig.units import GWT_N
from sim.devices.clock import VirtualClock
from tests.stub_bench import StubBench, StubStage

HERTZ = 1.5


class PlainStage(StubStage):
    """At rest where it was told to be at its only look, homed whatever comes; it keeps how many moves it was told."""

    switches_mm, homing_s = (0.0, 0.0, 0.0), 0.0

    def __init__(self, clock: VirtualClock) -> None:
        super().__init__(clock)
        self.homed, self.switching_s = True, 0.002
        self.moves = 0
        self.outputs: list[tuple[float, bool]] = []

    @property
    def at(self) -> StageStatus:
        """Where it is, machine mm."""
        return self.status()

    def moving(self, **to: float) -> Iterator[StageStatus | None]:
        self.moves += 1
        yield from super().moving(**to)

    def stop(self) -> None:
        """At rest already."""

    def set_output(self, on: bool) -> None:
        self.clock.wait_s(self.switching_s)
        self.outputs.append((self.clock.monotonic_s(), on))

    def _going(self, to_mm: list[float], lasts_s: float) -> Iterator[StageStatus | None]:
        self.clock.wait_s(lasts_s)
        self.at_mm = list(to_mm)
        yield self.status()


class GlidingStage(PlainStage):
    """On its way at every look, with time passing."""

    look_s = LOOK_S

    def moving(self, *, look_s: float = LOOK_S, **to: float) -> Iterator[StageStatus | None]:
        self.look_s = look_s
        yield from super().moving(**to)

    def _going(self, to_mm: list[float], lasts_s: float) -> Iterator[StageStatus | None]:
        from_mm, begun_s = list(self.at_mm), self.clock.monotonic_s()
        while (left_s := begun_s + lasts_s - self.clock.monotonic_s()) > 1e-9:
            self.clock.wait_s(min(self.look_s, left_s))
            share = min((self.clock.monotonic_s() - begun_s) / lasts_s, 1.0)
            self.at_mm = [was + share * (to - was) for was, to in zip(from_mm, to_mm, strict=True)]
            yield self.status()
        self.at_mm = list(to_mm)


class PlainBench(StubBench):
    """Bench whose sensor shows what `felt_gwt` says now."""

    begins_at_s, sample_period_s = 0.0, 0.05
    make_stage: type[StubStage] = PlainStage
    stage: PlainStage
    also: Mapping[str, float] = MappingProxyType({})

    def __init__(
        self, felt_gwt: Callable[["PlainBench"], float], settings: Mapping[str, Any], **options: Any
    ) -> None:
        super().__init__(settings, **options)
        self.felt_gwt, self.resolution_gwt = felt_gwt, self.settings.force.resolution_gwt
        self.wants_pause: Callable[[], bool] = lambda: False
        self.goes_on = True
        self.pause = Pause(lambda: self.wants_pause(), lambda meanwhile: self.goes_on)

    def make_force(self) -> "PlainBench":
        """Return the bench, which is its own sensor."""
        return self

    def hertz(self, k_gwt: float, contact_mm: float) -> float:
        """What a finger shows that follows F = k d^1.5."""
        return float(k_gwt * max(contact_mm - self.height_mm, 0.0) ** HERTZ)

    def ready(self, noise_gwt: float = 0.0) -> Engine:
        """Mounted, homed, zeroed with so much noise, and over the pad's centre."""
        verbs.mount(self.engine, "bar:3.0")
        verbs.home(self.engine)
        self.engine.sensing.take_zero([-noise_gwt, noise_gwt])
        verbs.move_to(self.engine, 0.0)
        return self.engine

    def readings(self, phase: str) -> list[tuple[float, float]]:
        """(height mm, force gwt) of the readings of one phase so far."""
        samples = [data for name, data in self.events if name.endswith("sample")]
        return [(data["height_mm"], data["force_gwt"]) for data in samples if data["phase"] == phase]

    # as a sensor

    def connect(self) -> str:
        return "plain"

    def read(self) -> ForceReading:
        return ForceReading(self.felt_gwt(self) * GWT_N, True, self.clock.monotonic_s(), self.also)

    def zero(self) -> None:
        """It shows what it shows."""


class GlidingBench(PlainBench):
    """A bench whose sensor is read on the way, too. `on_event` may act, once an event is on record."""

    make_stage = GlidingStage

    def __init__(self, *args: Any, **options: Any) -> None:
        self.on_event: Callable[[str, Mapping[str, Any]], object] = lambda stream, data: None
        super().__init__(*args, **options)

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        super().event(stream, data)
        self.on_event(stream, data)


def pressing(
    felt_gwt: Callable[[PlainBench], float],
    doi_mm: float,
    *,
    noise_gwt: float = 0.0,
    settings: Mapping[str, Any] | None = None,
    **options: Any,
) -> tuple[PlainBench, Press]:
    """A press that has just touched: so deep already, contact at the nominal apex, feeling what is felt there."""
    shown: list[Callable[[PlainBench], float]] = [lambda bench: 0.0]
    bench = PlainBench(lambda bench: shown[0](bench), settings or {}, **options)
    engine = bench.ready(noise_gwt)
    while engine.height_mm > -doi_mm + 1e-9:
        engine.go_to_height(max(engine.height_mm - 0.05, -doi_mm), 2.0)
    bench.stage.moves, shown[0] = 0, felt_gwt
    touch = ContactFit(0.05, engine.height_mm, round(felt_gwt(bench), 6), 0.0, 2)
    return bench, Press(engine, PressId(0), touch, 1.0)


def shows(*gwt: float) -> Callable[[PlainBench], float]:
    """One force after each move, the first before any; the last from then on."""
    return lambda bench: gwt[min(bench.stage.moves, len(gwt) - 1)]
