"""The MT-SICS driver as pairs of bytes."""

from collections.abc import Callable
from typing import Any

import pytest

from rig.devices.force import (
    ForceBusy,
    ForceError,
    ForceOverload,
    ForceReading,
    ForceSensor,
    ForceTimeout,
    ForceUnderload,
)
from rig.devices.force.mtsics.mtsics_force import MtSicsForce
from sim.devices.clock import VirtualClock

HELLO = (b"@\r\n", b'I4 A "0123456789"\r\n')
Make = Callable[[list[Any]], MtSicsForce]


@pytest.fixture
def balance(clock: VirtualClock, scripted: Callable[[list[Any]], Any]) -> Make:
    """A driver that has said hello to the far end of this script."""

    def make(script: list[Any]) -> MtSicsForce:
        force = MtSicsForce(scripted([HELLO, *script]), clock)
        assert force.connect() == "MT-SICS balance 0123456789"
        return force

    return make


def test_read_gives_newtons(balance: Make, clock: VirtualClock) -> None:
    force: ForceSensor = balance([(b"SI\r\n", b"S S     100.00 g\r\n"), (b"SI\r\n", b"S D  -0.01 g\r\n")])
    clock.wait_s(3.0)
    assert force.read() == ForceReading(pytest.approx(0.980665), True, 3.0)
    assert force.read() == ForceReading(pytest.approx(-9.80665e-5), False, 3.0)
    assert force.sample_period_s == 0.05


def test_columns_do_not_matter(balance: Make) -> None:
    assert balance([(b"SI\r\n", b"S\tS 2.33     g  \r\n")]).read().force_n == pytest.approx(0.02284949)


def test_an_answer_may_come_in_pieces(balance: Make) -> None:
    assert balance([(b"SI\r\n", [b"S S   ", b"  1.00 ", b"g\r", b"\n"])]).read().stable


@pytest.mark.parametrize(
    ("answer", "kind"),
    [
        (b"S +\r\n", ForceOverload), (b"S -\r\n", ForceUnderload), (b"S I\r\n", ForceBusy),
        (b"ES\r\n", ForceError), (b"ET\r\n", ForceError), (b"EL\r\n", ForceError),
        (b"S S 1.00 kg\r\n", ForceError), (b"S S nan g\r\n", ForceError), (b"S S 1e400 g\r\n", ForceError),
        (b"S S 1.00\r\n", ForceError), (b"S X 1.00 g\r\n", ForceError), (b"Z A\r\n", ForceError),
        (b"\xff\xff\r\n", ForceError), (b"", ForceTimeout),
    ],
)  # fmt: skip
def test_no_force_is_an_exception(balance: Make, answer: bytes, kind: type[Exception]) -> None:
    with pytest.raises(kind) as caught:
        balance([(b"SI\r\n", answer)]).read()
    assert type(caught.value) is kind


def test_the_unit_must_be_grams(balance: Make) -> None:
    with pytest.raises(ForceError, match="reports oz, it must be set to g"):
        balance([(b"SI\r\n", b"S S 1.00 oz\r\n")]).read()


def test_a_late_answer_is_never_taken_for_the_next(balance: Make) -> None:
    force = balance([(b"SI\r\n", b""), (b"@\r\n", b"S S 9.99 g\r\n" + HELLO[1]), (b"SI\r\n", b"S S 1.00 g\r\n")])
    with pytest.raises(ForceTimeout, match=r"no answer to SI in 0\.5 s"):
        force.read()
    assert force.read().force_n == pytest.approx(9.80665e-3)


def test_stable_value_zero_and_tare(balance: Make) -> None:
    force = balance(
        [
            (b"S\r\n", b"S S 3.00 g\r\n"),
            (b"Z\r\n", b"Z A\r\n"),
            (b"T\r\n", b"T S 100.00 g\r\n"),
            (b"Z\r\n", b"Z I\r\n"),
            (b"Z\r\n", b"Z +\r\n"),
            (b"T\r\n", b"T I\r\n"),
            (b"S\r\n", b"S I\r\n"),
        ]
    )
    assert force.read_stable(5.0).stable
    force.zero()
    assert force.tare() == pytest.approx(0.980665)
    with pytest.raises(ForceBusy):
        force.zero()
    with pytest.raises(ForceOverload):
        force.zero()
    with pytest.raises(ForceBusy):
        force.tare()
    with pytest.raises(ForceBusy):
        force.read_stable(5.0)


def test_a_stable_value_has_a_bounded_wait(balance: Make, clock: VirtualClock) -> None:
    with pytest.raises(ForceTimeout, match="no answer to S in 2 s"):
        balance([(b"S\r\n", b"")]).read_stable(2.0)
    assert clock.monotonic_s() == pytest.approx(2.0)


def test_hello_ends_a_repeating_balance(clock: VirtualClock, scripted: Callable[[list[Any]], Any]) -> None:
    wire = scripted([(b"", b"S D 1.0"), (b"@\r\n", b"0 g\r\nS D 1.00 g\r\n" + HELLO[1])])
    assert MtSicsForce(wire, clock).connect() == "MT-SICS balance 0123456789"


def test_a_balance_that_answers_no_at(clock: VirtualClock, scripted: Callable[[list[Any]], Any]) -> None:
    wire = scripted([(b"@\r\n", b""), (b"I4\r\n", b'I4 A "7"\r\n')])
    force = MtSicsForce(wire, clock)
    assert force.connect() == "MT-SICS balance 7"
    force.close()
    assert wire.closed


def test_looking_on_leaves_the_tare_alone(clock: VirtualClock, scripted: Callable[[list[Any]], Any]) -> None:
    """Not a single `@`, even where the balance repeats itself to somebody else."""
    wire = scripted(
        [
            (b"", b"S D 1.0"),
            (b"I4\r\n", b"0 g\r\nS D 1.00 g\r\n" + HELLO[1]),
            (b"SI\r\n", b"S S 1.50 g\r\n"),
        ]
    )
    force = MtSicsForce(wire, clock)
    assert force.identify() == "MT-SICS balance 0123456789"
    assert force.read().force_n == pytest.approx(1.5 * 9.80665e-3)


def test_nobody_there(clock: VirtualClock, scripted: Callable[[list[Any]], Any]) -> None:
    with pytest.raises(ForceTimeout, match="no balance answers"):
        MtSicsForce(scripted([(b"@\r\n", b""), (b"I4\r\n", b"")]), clock).connect()
