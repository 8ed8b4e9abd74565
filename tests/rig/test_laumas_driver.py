"""The Laumas driver as pairs of bytes: transmitter 1, counts of 0.01 g."""

from collections.abc import Callable
from typing import Any

import pytest

from rig.devices.force import (
    ForceBroken,
    ForceBusy,
    ForceError,
    ForceOverload,
    ForceReading,
    ForceSensor,
    ForceTimeout,
    ForceUnderload,
)
from rig.devices.force.laumas.laumas_force import LaumasForce
from rig.devices.force.laumas.laumas_settings import LaumasSettings
from rig.transport.modbus import ModbusMaster
from sim.devices.clock import VirtualClock

Pair = tuple[str, str]
Make = Callable[..., LaumasForce]
ASK = "01 03 00 06 00 08"
STABLE, STABLE_AT_ZERO = "08 00", "18 00"


def snapshot(status: str, gross: str, net: str = "00 00 00 00", units: str = "01 0C") -> Pair:
    """Status, gross, net, peak, divisions and units: registers 6 … 13."""
    return ASK, f"01 03 10 {status} {gross} {net} 00 00 00 00 {units}"


def command(number: str) -> Pair:
    return f"01 10 00 05 00 01 02 {number}", "01 10 00 05 00 01"


@pytest.fixture
def transmitter(clock: VirtualClock, scripted: Callable[[list[Any]], Any], rtu: Callable[[str], bytes]) -> Make:
    def make(pairs: list[Pair], *, scale: float = 1.0, **changes: Any) -> LaumasForce:
        wire = scripted([(rtu(sent), rtu(reply) if reply else b"") for sent, reply in pairs])
        return LaumasForce(ModbusMaster(wire, clock), clock, LaumasSettings(**changes), scale=scale)

    return make


def test_connect_checks_the_unit(transmitter: Make) -> None:
    identity = ("01 03 00 00 00 04", "01 03 08 01 05 00 1E 07 E8 04 D2")
    there: ForceSensor = transmitter([identity, snapshot(STABLE, "00 00 00 00")])
    assert there.connect() == "Laumas transmitter type 30, serial 1234 of 2024, firmware 261"
    assert (there.sample_period_s, there.resolution_gwt) == (0.05, 0.01)


def test_another_unit_is_refused(transmitter: Make) -> None:
    """Kilograms instead of grams: forces would be a thousand times too small."""
    with pytest.raises(ForceError, match=r"division and unit \(register 13\) are 0x000C, expected 0x010C"):
        transmitter([snapshot(STABLE, "00 00 00 E9", units="00 0C")]).read()


def test_a_weight_is_a_magnitude_with_its_sign_in_the_status(transmitter: Make, clock: VirtualClock) -> None:
    """233 counts are 2.33 g; 100000 need both words; bit 7 is the minus of gross."""
    there = transmitter(
        [snapshot(STABLE, "00 00 00 E9"), snapshot("00 00", "00 01 86 A0"), snapshot("00 80", "00 00 00 E9")]
    )
    clock.wait_s(3.0)
    first = there.read()
    assert first == ForceReading(pytest.approx(2.33 * 9.80665e-3), True, pytest.approx(3.0, abs=1e-6))
    assert there.read() == ForceReading(pytest.approx(9.80665), False, pytest.approx(3.0, abs=0.01))
    assert there.read().force_n == pytest.approx(-2.33 * 9.80665e-3)


def test_net_has_its_own_registers_and_sign(transmitter: Make) -> None:
    there = transmitter([snapshot("01 80", "00 00 00 01", "00 00 00 E9")], weight="net")
    assert there.read().force_n == pytest.approx(-2.33 * 9.80665e-3)


def test_weights_in_twos_complement(transmitter: Make) -> None:
    there = transmitter([snapshot("00 80", "FF FF FF 17")], signs="registers")
    assert there.read().force_n == pytest.approx(-2.33 * 9.80665e-3)


def test_scale_and_filter(transmitter: Make) -> None:
    """What was measured against a weight; a value of four samples is new after four."""
    there = transmitter([snapshot(STABLE, "00 00 00 64")], scale=1.02, filter_samples=4)
    assert there.read().force_n == pytest.approx(1.02 * 9.80665e-3)
    assert there.sample_period_s == pytest.approx(0.2)
    assert there.resolution_gwt == pytest.approx(0.0102)


@pytest.mark.parametrize(
    ("status", "kind", "meaning"),
    [
        ("00 01", ForceBroken, "load cell error"),
        ("00 02", ForceBroken, "analogue-to-digital converter"),
        ("00 04", ForceOverload, "maximum weight exceeded"),
        ("00 08", ForceOverload, "110 % of full scale"),
        ("00 10", ForceOverload, "gross weight out of range"),
        ("00 20", ForceOverload, "net weight out of range"),
        ("00 90", ForceUnderload, "gross weight out of range"),
        ("08 01", ForceBroken, "load cell error"),
    ],
)
def test_what_the_status_says_is_an_error(
    transmitter: Make, status: str, kind: type[Exception], meaning: str
) -> None:
    with pytest.raises(kind, match=f"scripted: transmitter 1: .*{meaning}") as caught:
        transmitter([snapshot(status, "00 00 00 E9")]).read()
    assert type(caught.value) is kind
    assert isinstance(caught.value, ForceError)


def test_a_bit_may_be_elsewhere(transmitter: Make) -> None:
    """Second-hand facts are configuration."""
    there = transmitter([snapshot("40 00", "00 00 00 E9")], bits={"cell_error": 14})
    with pytest.raises(ForceBroken):
        there.read()


def test_silence_and_refusal(transmitter: Make) -> None:
    with pytest.raises(ForceTimeout, match=r"read .function 3. of 8 registers at 0x0006: no answer"):
        transmitter([(ASK, "")] * 3).read()
    with pytest.raises(ForceError, match="refused with exception 2, illegal data address"):
        transmitter([(ASK, "01 83 02")]).read()


def test_zero_waits_for_rest_and_makes_sure(transmitter: Make) -> None:
    transmitter(
        [
            snapshot("00 00", "00 00 00 C8"),
            snapshot(STABLE, "00 00 00 C8"),
            command("00 08"),
            snapshot(STABLE_AT_ZERO, "00 00 00 00"),
        ]
    ).zero()


def test_zero_that_does_nothing_is_told(transmitter: Make) -> None:
    there = transmitter([snapshot(STABLE, "00 00 00 C8"), command("00 08"), snapshot(STABLE, "00 00 00 C8")])
    with pytest.raises(ForceBusy, match="still 2 gwt after zeroing"):
        there.zero()


def test_zero_of_net_is_a_tare(transmitter: Make) -> None:
    net = snapshot("0C 00", "00 00 00 C8", "00 00 00 00")
    transmitter([snapshot(STABLE, "00 00 00 C8", "00 00 00 C8"), command("00 07"), net], weight="net").zero()


def test_tare_and_gross(transmitter: Make) -> None:
    there = transmitter([command("00 07"), command("00 09")])
    there.tare()
    there.show_gross()


@pytest.mark.parametrize(("status", "gross"), [(STABLE, "00 00 00 02"), ("08 80", "00 00 00 02")])
def test_what_is_left_after_zeroing_is_refused_on_either_side(transmitter: Make, status: str, gross: str) -> None:
    """Two counts are 0.02 gwt, the resolution is 0.01; a sign in bit 7 of the status is pull."""
    script = [snapshot(STABLE, "00 00 00 05"), command("00 08"), snapshot(status, gross)]
    with pytest.raises(ForceBusy, match=r"still -?0\.02 gwt after zeroing"):
        transmitter(script).zero()


def test_a_load_that_never_rests_is_waited_for_ten_seconds(
    transmitter: Make, clock: VirtualClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock.wait_s(100.0)
    force = transmitter([])
    monkeypatch.setattr(force, "read", lambda: ForceReading(0.1, False, clock.monotonic_s()))
    with pytest.raises(ForceBusy, match="no stable load in 10 s"):
        force.zero()
    assert clock.monotonic_s() == pytest.approx(110.0, abs=0.06)


def test_closing_it_closes_the_wire(scripted: Callable[[list[Any]], Any], clock: VirtualClock) -> None:
    wire = scripted([])
    LaumasForce(ModbusMaster(wire, clock), clock, LaumasSettings()).close()
    assert wire.closed
