"""What the MT-SICS driver promises, on a scripted wire, at a late hour of the clock."""

from collections.abc import Callable
from typing import Any

import pytest

from rig.devices.force import ForceBusy, ForceError, ForceOverload, ForceTimeout, ForceUnderload
from rig.devices.force.mtsics.mtsics_force import MtSicsForce
from sim.devices.clock import VirtualClock

GWT_N = 9.80665e-3
HELLO = (b"@\r\n", b'I4 A "0123456789"\r\n')
WEIGHT = (b"SI\r\n", b"S S 1.00 g\r\n")
Balance = Callable[..., MtSicsForce]


@pytest.fixture
def balance(clock: VirtualClock, scripted: Callable[[list[Any]], Any]) -> Balance:
    """A balance a thousand seconds after the clock began; nothing was said to it yet."""

    def make(*script: Any, **options: Any) -> MtSicsForce:
        clock.wait_s(1000.0)
        return MtSicsForce(scripted(list(script)), clock, **options)

    return make


def test_a_balance_is_greeted_before_its_first_answer_is_believed(balance: Balance) -> None:
    """Once: a second reading asks for no more than that."""
    force = balance(HELLO, WEIGHT, WEIGHT)
    assert [force.read().force_n, force.read().force_n] == pytest.approx([GWT_N, GWT_N])


@pytest.mark.parametrize(("options", "steps"), [({}, (0.05, 0.01)), ({"scale": 1.25}, (0.05, 0.0125))], ids=str)
def test_a_balance_has_steps_of_time_and_of_force(
    balance: Balance, options: dict[str, float], steps: tuple[float, float]
) -> None:
    force = balance(HELLO, WEIGHT, **options)
    assert (force.sample_period_s, force.resolution_gwt) == pytest.approx(steps)
    assert force.read().force_n == pytest.approx(GWT_N * options.get("scale", 1.0))


GARBLED = [
    b"S S 1.00 g g", b"S S 1.00", b"S", b"T S 1.00 g", b"S S g 1.00", b"S X 1.00 g", b"Z S 1.00 g", b"S S 1,00 g",
    b"S S +-1 g", b"S S 0x10 g", b"S S inf g", b"S S 1.00g", b"1.00 g", b"SI S 1.00 g", b"S S . g", b"S A",
]  # fmt: skip


@pytest.mark.parametrize("answer", GARBLED, ids=str)
def test_after_what_is_no_weight_the_balance_is_greeted_anew(balance: Balance, answer: bytes) -> None:
    force = balance(HELLO, (b"SI\r\n", answer + b"\r\n"), HELLO, WEIGHT)
    with pytest.raises(ForceError, match="scripted: garbled answer") as caught:
        force.read()
    assert type(caught.value) is ForceError
    assert force.read().stable


REFUSALS: list[tuple[str, type[ForceError], str]] = [
    ("{} +", ForceOverload, "is overloaded"),
    ("{} -", ForceUnderload, "is underloaded"),
    ("{} I", ForceBusy, "cannot answer {} now, or found no stable value"),
    ("ES", ForceError, r"does not know the command \(ES to {}\)"),
    ("ET", ForceError, r"received garbled bytes \(ET to {}\)"),
    ("EL", ForceError, r"cannot do that \(EL to {}\)"),
]
ASK: dict[str, Callable[[MtSicsForce], object]] = {
    "SI": MtSicsForce.read,
    "Z": MtSicsForce.zero,
    "T": MtSicsForce.tare,
}


@pytest.mark.parametrize("command", ASK)
@pytest.mark.parametrize(("answer", "kind", "why"), REFUSALS)
def test_a_refusal_is_told_and_the_balance_stays_in_step(
    balance: Balance, command: str, answer: str, kind: type[ForceError], why: str
) -> None:
    """It has answered what it was asked: no need to greet it anew, which would forget its tare."""
    said = answer.format(command[0])
    force = balance(HELLO, (f"{command}\r\n".encode(), f"{said}\r\n".encode()), WEIGHT)
    with pytest.raises(kind, match=f"scripted: the balance {why.format(command)}") as caught:
        ASK[command](force)
    assert type(caught.value) is kind
    assert force.read().stable


@pytest.mark.parametrize("command", ["SI", "T"])
def test_a_weight_in_ounces_is_refused(balance: Balance, command: str) -> None:
    answer = f"{command[0]} S 1.00 oz\r\n"
    force = balance(HELLO, (f"{command}\r\n".encode(), answer.encode()), WEIGHT)
    with pytest.raises(ForceError, match="scripted: the balance reports oz, it must be set to g"):
        ASK[command](force)
    assert force.read().stable


@pytest.mark.parametrize("answer", [b"Z", b"Z S", b"T A", b"Z X 1.00 g", b"S S 1.00 g"], ids=str)
def test_a_zero_that_is_not_confirmed_is_garbled(balance: Balance, answer: bytes) -> None:
    force = balance(HELLO, (b"Z\r\n", answer + b"\r\n"), HELLO, (b"Z\r\n", b"Z A\r\n"))
    with pytest.raises(ForceError, match="garbled answer"):
        force.zero()
    force.zero()


@pytest.mark.parametrize("answer", [b"T", b"T A", b"S S 1.00 g", b"T S 1.00"], ids=str)
def test_a_tare_that_is_not_told_is_garbled(balance: Balance, answer: bytes) -> None:
    force = balance(HELLO, (b"T\r\n", answer + b"\r\n"))
    with pytest.raises(ForceError, match="garbled answer"):
        force.tare()


@pytest.mark.parametrize(
    ("ask", "command", "lasts_s"),
    [
        (MtSicsForce.read, b"SI\r\n", 0.5),
        (MtSicsForce.zero, b"Z\r\n", 10.0),
        (MtSicsForce.tare, b"T\r\n", 10.0),
        (lambda force: force.read_stable(3.0), b"S\r\n", 3.0),
    ],
    ids=["read", "zero", "tare", "read_stable"],
)
def test_a_silent_balance_is_waited_for_so_long_and_greeted_anew(
    balance: Balance, clock: VirtualClock, ask: Callable[[MtSicsForce], object], command: bytes, lasts_s: float
) -> None:
    force = balance(HELLO, (command, b""), HELLO, WEIGHT)
    with pytest.raises(ForceTimeout, match=rf"no answer to {command.decode().strip()} in {lasts_s:g} s"):
        ask(force)
    assert clock.monotonic_s() == pytest.approx(1000.0 + lasts_s)
    assert force.read().stable


def test_a_balance_that_is_not_there_is_asked_twice_for_half_a_second(balance: Balance, clock: VirtualClock) -> None:
    """And nothing is believed afterwards."""
    hello = [(b"@\r\n", b""), (b"I4\r\n", b"")]
    force = balance(*hello, *hello, HELLO, WEIGHT)
    for ask in (force.connect, force.read):
        with pytest.raises(ForceTimeout, match="scripted: no balance answers"):
            ask()
    assert clock.monotonic_s() == pytest.approx(1002.0)
    assert force.read().stable


def test_a_greeting_that_fails_ends_what_was_believed_before(balance: Balance) -> None:
    force = balance(HELLO, (b"@\r\n", b""), (b"I4\r\n", b"I4 I\r\n"), HELLO, WEIGHT)
    force.connect()
    with pytest.raises(ForceTimeout):
        force.connect()
    assert force.read().stable


@pytest.mark.parametrize("late", [b"S S 9.99 g\r\n", b"S S 9."], ids=["a line", "half a line"])
def test_what_came_unasked_is_no_answer(balance: Balance, late: bytes) -> None:
    """Before the greeting and between two questions alike."""
    force = balance((b"", late), HELLO, WEIGHT, (b"", late), WEIGHT)
    assert [force.read().force_n, force.read().force_n] == pytest.approx([GWT_N, GWT_N])
