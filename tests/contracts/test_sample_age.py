"""Every kind of force sensor has a declared maximum sample age, and an older reading trips."""

from typing import Any

import pytest

from rig.devices.registry import ForceKind, find
from rig.engine.sensing import NoReadingError, Sensing
from rig.plan.config import Config
from sim.devices.clock import VirtualClock
from tests.contracts.force import UNASKED, Connected, ForceBytes
from tests.contracts.test_forces import DEVICES
from tests.error_codes import raises
from tests.stub_bench import StubSensor

every_device = pytest.mark.parametrize("device", DEVICES, ids=lambda device: device.name)


def _config(device: ForceBytes) -> Config:
    return Config.model_validate({"force": {"kind": device.kind, **device.table}})


def _sensing(device: ForceBytes) -> tuple[Connected, Sensing]:
    """A connected driver as the engine reads it, which has just read a usual reply."""
    there = Connected(device)
    sensing = Sensing(_config(device), there.clock, there.driver)
    sensing.now()
    return there, sensing


def _delay(there: Connected, by_s: float) -> None:
    """The next reply, or the next reading of a stream, comes so much later."""
    if there.device.reading == UNASKED:
        there.wire._next_s = there.clock.monotonic_s() + by_s
    else:
        there.wire.after_s = by_s


@every_device
def test_every_kind_declares_its_own(device: ForceBytes) -> None:
    assert find(ForceKind, device.kind).max_age_s(_config(device).force) == pytest.approx(device.max_age_s)


@every_device
def test_a_reading_within_it_is_used_and_an_older_one_trips(device: ForceBytes) -> None:
    there, sensing = _sensing(device)
    _delay(there, 0.4 * device.max_age_s)
    sensing.now()
    _delay(there, 1.05 * device.max_age_s)
    with pytest.raises(NoReadingError):
        sensing.now()


@every_device
def test_a_reading_that_a_driver_returns_after_its_sample_age_is_refused(device: ForceBytes) -> None:
    """A computer that stood still between the request and the reading."""
    clock = VirtualClock()
    sensor: Any = StubSensor(clock)
    sensing, max_age_s = Sensing(_config(device), clock, sensor), device.max_age_s
    sensor.at_read = lambda: clock.wait_s(0.99 * max_age_s)
    sensing.now()
    sensor.at_read = lambda: clock.wait_s(1.01 * max_age_s)
    with raises(NoReadingError, "too_old", age_s=1.01 * max_age_s, max_age_s=max_age_s):
        sensing.now()
