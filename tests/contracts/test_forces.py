"""Every registered force sensor keeps the contract, and has said everything that it asks of its device."""

import pytest

from rig.devices.base import ForceError, ForceTimeout, ZeroedByDriver
from rig.devices.registry import BUILT_IN
from sim.devices.clock import VirtualClock
from tests.contracts.force import Connected, ForceBytes, ForceContract
from tests.contracts.tables import tables
from tests.error_codes import raises
from tests.parts.plain_driver import PlainForce

DEVICES = tables(ForceBytes)
TO_BE_SAID = {"overload", "underload", "busy", "cell error", "nan"}


class TestForces(ForceContract):
    """All of them."""

    devices = DEVICES


def test_every_registered_sensor_has_its_bytes() -> None:
    assert {device.kind for device in DEVICES} == set(BUILT_IN["force"])
    assert {device.name for device in DEVICES} >= {"mtsics", "laumas_rtu", "laumas_tcp"}


@pytest.mark.parametrize("device", DEVICES, ids=lambda device: device.name)
def test_a_table_leaves_nothing_open(device: ForceBytes) -> None:
    """What a device cannot say is said, too, and why."""
    assert device.source
    said = set(device.refusals) | set(device.garbled) | set(device.not_now)
    assert said | set(device.lacks) >= TO_BE_SAID
    assert not said & set(device.lacks)
    assert set(device.zeroing) >= {"at rest", "never at rest", "overloaded", "silent", "not confirmed"}
    assert {weight.stable for weight in device.weights.values()} | {"stable" in device.lacks} == {True, False}
    assert min(weight.grams for weight in device.weights.values()) < 0


@pytest.mark.parametrize("scale", [None, 1.25])
@pytest.mark.parametrize(
    "device",
    [device for device in DEVICES if not device.zeroing["at rest"].told],
    ids=lambda device: device.name,
)
def test_a_load_that_the_program_subtracts_is_subtracted_once_however_often_it_is_zeroed(
    device: ForceBytes, scale: float | None
) -> None:
    driver = Connected(device, scale=scale).driver
    assert isinstance(driver, ZeroedByDriver)
    load_n = driver.read().force_n
    assert load_n
    for _ in range(3):
        driver.zero()
        assert driver.subtracted_n == pytest.approx(load_n)
        assert driver.read().force_n == pytest.approx(0.0, abs=1e-12)


# --- a driver that raises plain text ---


@pytest.mark.parametrize(
    ("reply", "kind", "code"), [(b"x\n", ForceError, "no_force"), (b"", ForceTimeout, "no_reply")]
)
def test_the_driver_of_a_package_that_knows_no_codes(reply: bytes, kind: type[ForceError], code: str) -> None:
    clock, replies = VirtualClock(), [reply]

    class Wire:
        name = "wire"

        def write(self, data: bytes) -> None:
            assert data == b"W\n"

        def read(self, timeout_s: float) -> bytes:
            clock.wait_s(timeout_s)
            return replies.pop() if replies and timeout_s else b""

        def close(self) -> None:
            """There is nothing to close."""

    with raises(kind, code):
        PlainForce(Wire(), clock, sample_period_s=0.05, resolution_gwt=0.01, scale=1.0).read()
