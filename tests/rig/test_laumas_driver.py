"""What a Laumas transmitter's settings do, on registers without frames, at a late hour of the clock.

The rest is in tests/contracts.
"""

from collections.abc import Callable, Sequence
from typing import Any

import pytest

from rig.devices.base import ForceBroken, ForceError, ForceOverload, ForceReading, ForceUnderload
from rig.devices.laumas import COMMAND, IDENTITY, STATUS, LaumasForce
from rig.settings import LaumasSettings
from rig.transport.modbus import ModbusMaster
from sim.devices.clock import VirtualClock
from tests.error_codes import raises

GWT_N = 9.80665e-3
STABLE = 1 << 11


class Bus:
    """A transmitter: registers, and when which command came. Its load is `status` and `counts` at each asking."""

    name = "bus"

    def __init__(self, clock: VirtualClock) -> None:
        self.clock = clock
        self.status: Callable[[], int] = lambda: STABLE
        self.gross = self.net = 0
        self.units = 0x010C
        self.asked_s: list[float] = []
        self.told: list[tuple[float, int, int, list[int]]] = []

    def read(self, device: int, register: int, count: int) -> list[int]:
        assert device == 1
        if register == IDENTITY:
            return [261, 30, 2024, 1234][:count] + [0] * (count - 4)
        assert (register, count) == (STATUS, 8)
        self.asked_s.append(self.clock.monotonic_s())
        weights = [part for counts in (self.gross, self.net) for part in (counts >> 16 & 0xFFFF, counts & 0xFFFF)]
        return [self.status(), *weights, 0, 0, self.units]

    def write(self, device: int, register: int, values: Sequence[int]) -> None:
        self.told.append((self.clock.monotonic_s(), device, register, list(values)))
        self.gross = self.net = 0


Make = Callable[..., tuple[Bus, LaumasForce]]


@pytest.fixture
def transmitter(clock: VirtualClock) -> Make:
    def make(driver: dict[str, float] | None = None, **changes: Any) -> tuple[Bus, Any]:
        clock.wait_s(1000.0)
        bus: Any = Bus(clock)
        return bus, LaumasForce(bus, clock, LaumasSettings(**changes), **(driver or {}))

    return make


# By the manual of the LCB, status register 1.
KINDS: dict[int, tuple[type[ForceError], str]] = {
    0: (ForceBroken, "cell_error"),
    1: (ForceBroken, "converter_error"),
    2: (ForceOverload, "over_max"),
    3: (ForceOverload, "over_full_scale"),
    4: (ForceOverload, "gross_out_of_range"),
    5: (ForceOverload, "net_out_of_range"),
}


@pytest.mark.parametrize("weight", ["gross", "net"])
@pytest.mark.parametrize("bit", range(16))
def test_each_bit_of_the_status_means_what_the_manual_says(transmitter: Make, weight: str, bit: int) -> None:
    """Of 233 counts; a sign counts for its own weight only."""
    bus, force = transmitter(weight=weight)
    bus.status, bus.gross, bus.net = lambda: 1 << bit, 233, 233
    if bit in KINDS:
        with raises(*KINDS[bit], port="bus", device_id=1) as caught:
            force.read()
        assert type(caught.value) is KINDS[bit][0]
    else:
        minus = -1 if bit == {"gross": 7, "net": 8}[weight] else 1
        assert force.read() == ForceReading(pytest.approx(minus * 2.33 * GWT_N), bit == 11, 1000.0)


@pytest.mark.parametrize("weight", ["gross", "net"])
@pytest.mark.parametrize("bit", [2, 3, 4, 5])
def test_beyond_the_range_with_a_minus_is_underload(transmitter: Make, weight: str, bit: int) -> None:
    bus, force = transmitter(weight=weight)
    bus.status = lambda: 1 << bit | 1 << {"gross": 7, "net": 8}[weight]
    with raises(ForceUnderload, KINDS[bit][1]):
        force.read()


def test_a_bit_may_be_elsewhere(transmitter: Make) -> None:
    """Second-hand facts are configuration."""
    bus, force = transmitter(bits={"cell_error": 14})
    bus.status = lambda: 1 << 14
    with raises(ForceBroken, "cell_error"):
        force.read()


@pytest.mark.parametrize("weight", ["gross", "net"])
@pytest.mark.parametrize("counts", [0, 1, 65535, 65536, 2**31 - 1, -1, -65536, -100000, -(2**31)])
def test_a_weight_in_twos_complement_has_its_sign_in_its_first_bit(
    transmitter: Make, weight: str, counts: int
) -> None:
    """And nowhere else: bits 7 and 8 of the status are no signs here."""
    bus, force = transmitter(signs="registers", weight=weight)
    setattr(bus, weight, counts)
    for status in (0, 0x180):
        bus.status = lambda status=status: status  # type: ignore[misc]
        assert force.read().force_n == pytest.approx(counts * 0.01 * GWT_N)
    bus.status = lambda: 1 << 2
    with raises(ForceUnderload if counts < 0 else ForceOverload, "over_max"):
        force.read()


@pytest.mark.parametrize(("weight", "command"), [("gross", 8), ("net", 7)])
def test_zero_is_taken_of_the_first_load_at_rest_and_looked_at_once_its_filter_is_new(
    transmitter: Make, clock: VirtualClock, weight: str, command: int
) -> None:
    """Four samples of 0.05 s: asked each 0.2 s, and 0.2 s after the command; at rest after a second."""
    bus, force = transmitter(weight=weight, filter_samples=4)
    bus.gross = bus.net = 200
    bus.status = lambda: STABLE if clock.monotonic_s() > 1000.9 else 0
    force.zero()
    assert bus.asked_s == pytest.approx([1000.0, 1000.2, 1000.4, 1000.6, 1000.8, 1001.0, 1001.2])
    assert bus.told == [(pytest.approx(1001.0), 1, COMMAND, [command])]


@pytest.mark.parametrize(("weight", "sign"), [("gross", 1), ("net", -1)])
def test_a_weight_is_that_of_the_configuration_times_the_measured_scale(
    transmitter: Make, weight: str, sign: int
) -> None:
    bus, force = transmitter({"scale": 1.5}, weight=weight, signs="registers")
    bus.gross, bus.net = 233, -233
    assert force.read().force_n == pytest.approx(sign * 1.5 * 2.33 * GWT_N)


def test_the_set_point_of_the_relay_is_a_weight_of_two_registers(
    clock: VirtualClock, scripted: Callable[[list[Any]], Any], rtu: Callable[[str], bytes]
) -> None:
    wire = scripted([(rtu("01 03 00 10 00 02"), rtu("01 03 04 00 01 86 A0"))])
    force = LaumasForce(ModbusMaster(wire, clock), clock, LaumasSettings(), scale=1.5)
    assert force.set_point_gwt(16) == pytest.approx(1500.0)
