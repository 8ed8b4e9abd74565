"""Every kind of force sensor has a declared maximum sample age, and an older reading trips."""

from typing import Any

import pytest

from rig.devices.registry import BUILT_IN, ForceKind, KnownBench, find
from rig.engine.sensing import NoReadingError, Sensing
from rig.plan.config import Config
from sim.devices.clock import VirtualClock
from tests.contracts.force import UNASKED, Connected, ForceBytes
from tests.contracts.test_forces import DEVICES
from tests.error_codes import raises
from tests.stub_bench import StubSensor

DECLARED_S = {"mtsics": 0.5, "laumas": 0.4, "text_cell": 0.6, "net_ft": 0.02}
every_kind = pytest.mark.parametrize("kind", BUILT_IN["force"])


def _max_age_s(kind: str, **table: object) -> float:
    settings = KnownBench.model_validate({"force": {"kind": kind, **table}})
    return find(ForceKind, kind).max_age_s(settings.force)


def _sensing(device: ForceBytes) -> tuple[Connected, Sensing]:
    """A connected driver as the engine reads it, which has just read a usual reply."""
    there = Connected(device)
    config = Config.model_validate({"force": {"kind": device.kind, **device.table}})
    sensing = Sensing(config, there.clock, there.driver)
    sensing.now()
    return there, sensing


def _delay(there: Connected, by_s: float) -> None:
    """The next reply, or the next reading of a stream, comes so much later."""
    if there.device.reading == UNASKED:
        there.wire._next_s = there.clock.monotonic_s() + by_s
    else:
        there.wire.after_s = by_s


@every_kind
def test_every_kind_declares_its_own(kind: str) -> None:
    assert _max_age_s(kind) == pytest.approx(DECLARED_S[kind])


@pytest.mark.parametrize("device", DEVICES, ids=lambda device: device.name)
def test_a_reading_within_it_is_used_and_an_older_one_trips(device: ForceBytes) -> None:
    max_age_s = _max_age_s(device.kind, **device.table)
    there, sensing = _sensing(device)
    _delay(there, 0.4 * max_age_s)
    sensing.now()
    _delay(there, 1.05 * max_age_s)
    with pytest.raises(NoReadingError):
        sensing.now()


@every_kind
def test_a_driver_that_returns_late_is_not_believed(kind: str) -> None:
    """A computer that stood still between the request and the reading."""
    clock = VirtualClock()
    sensor: Any = StubSensor(clock)
    sensing = Sensing(Config.model_validate({"force": {"kind": kind}}), clock, sensor)
    sensor.at_read = lambda: clock.wait_s(0.99 * DECLARED_S[kind])
    sensing.now()
    sensor.at_read = lambda: clock.wait_s(1.01 * DECLARED_S[kind])
    with raises(NoReadingError, "too_old", age_s=1.01 * DECLARED_S[kind], max_age_s=DECLARED_S[kind]):
        sensing.now()
