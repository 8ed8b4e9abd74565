"""What only a balance does, as pairs of bytes, at a late hour of the clock; the rest is in tests/contracts."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from rig.devices.base import ForceBusy, ForceError, ForceOverload, ForceTimeout, ForceUnderload
from rig.devices.mtsics import MtSicsForce
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.timed_wire import TimedWire

GWT_N = 9.80665e-3
HELLO = (b"@\r\n", b'I4 A "0123456789"\r\n')
WEIGHT = (b"SI\r\n", b"S S 1.00 g\r\n")
BEGUN_S = 1000.0
Balance = Callable[..., MtSicsForce]
Ask = Callable[[MtSicsForce], object]
ASK: dict[str, Ask] = {
    "SI": MtSicsForce.read,
    "Z": MtSicsForce.zero,
}


@pytest.fixture
def balance(clock: VirtualClock, scripted: Callable[[list[Any]], Any]) -> Balance:
    """A balance a thousand seconds after the clock began; nothing was said to it yet."""

    def make(*script: Any, **options: Any) -> MtSicsForce:
        clock.wait_s(BEGUN_S)
        return MtSicsForce(scripted(list(script)), clock, **options)

    return make


def _pair(command: str, reply: str) -> tuple[bytes, bytes]:
    return f"{command}\r\n".encode(), f"{reply}\r\n".encode()


# --- greeting ---


def test_a_balance_is_greeted_before_its_first_answer_is_believed(balance: Balance) -> None:
    """Once: a second reading asks for no more than that."""
    force = balance(HELLO, WEIGHT, WEIGHT)
    assert [force.read().force_n, force.read().force_n] == pytest.approx([GWT_N, GWT_N])


def test_a_balance_that_answers_no_at_is_asked_for_its_number(balance: Balance) -> None:
    assert balance((b"@\r\n", b""), (b"I4\r\n", b'I4 A "7"\r\n')).connect() == "MT-SICS balance 7"


@pytest.mark.parametrize(
    ("greet", "hello"), [(MtSicsForce.connect, b"@\r\n"), (MtSicsForce.identify, b"I4\r\n")], ids=["connect", "look"]
)
def test_a_balance_that_repeats_itself_is_understood(
    balance: Balance, greet: Callable[[MtSicsForce], str], hello: bytes
) -> None:
    """It may do so for somebody else: whoever looks on says not a single `@`."""
    force = balance((b"", b"S D 1.0"), (hello, b"0 g\r\nS D 1.00 g\r\n" + HELLO[1]), WEIGHT)
    assert greet(force) == "MT-SICS balance 0123456789"
    assert force.read().force_n == pytest.approx(GWT_N)


def test_a_greeting_that_fails_ends_what_was_believed_before(balance: Balance) -> None:
    force = balance(HELLO, (b"@\r\n", b""), (b"I4\r\n", b"I4 I\r\n"), HELLO, WEIGHT)
    force.connect()
    with raises(ForceTimeout, "no_device"):
        force.connect()
    assert force.read().stable


@pytest.mark.parametrize("late", [b"S S 9.99 g\r\n", b"S S 9."], ids=["a line", "half a line"])
def test_what_came_unasked_is_no_answer(balance: Balance, late: bytes) -> None:
    """Before the greeting and between two questions alike."""
    force = balance((b"", late), HELLO, WEIGHT, (b"", late), WEIGHT)
    assert [force.read().force_n, force.read().force_n] == pytest.approx([GWT_N, GWT_N])


@pytest.mark.parametrize("end", [b"\r", b"\x03"], ids=repr)
def test_a_balance_without_line_ends_is_told_from_a_dead_cable(balance: Balance, end: bytes) -> None:
    """Greeted, and asked for a weight: what arrives is shown."""
    number = HELLO[1].rstrip() + end
    force = balance((b"@\r\n", number), (b"I4\r\n", number), HELLO, (b"SI\r\n", b"S S 1.00 g" + end), HELLO, WEIGHT)
    with raises(ForceTimeout, "no_line_end", port="scripted", end="end of line", shown=repr(number)[2:-1]):
        force.connect()
    with raises(ForceTimeout, "no_line_end", port="scripted", shown=repr(b"S S 1.00 g" + end)):
        force.read()
    assert force.read().stable


# --- answers ---


REFUSALS: list[tuple[str, type[ForceError], str, dict[str, str]]] = [
    ("{} +", ForceOverload, "overload", {}),
    ("{} -", ForceUnderload, "underload", {}),
    ("{} I", ForceBusy, "busy", {"command": "{}"}),
    ("ES", ForceError, "unknown_command", {"command": "{}", "reply": "ES"}),
    ("ET", ForceError, "garbled_command", {"command": "{}", "reply": "ET"}),
    ("EL", ForceError, "not_possible", {"command": "{}", "reply": "EL"}),
    ("{} S 1.00 oz", ForceError, "wrong_unit", {"unit": "oz"}),
]
ANOTHER = {("Z", "wrong_unit"), ("SI", "busy")}
"""Z has no unit; a busy balance is asked for its weight again."""
REFUSED = [(command, *row) for command in ASK for row in REFUSALS if (command, row[2]) not in ANOTHER]


@pytest.mark.parametrize(("command", "reply", "kind", "code", "fields"), REFUSED)
def test_a_refusal_is_an_error_and_the_balance_stays_in_step(
    balance: Balance, command: str, reply: str, kind: type[ForceError], code: str, fields: dict[str, str]
) -> None:
    """It has answered what it was asked: no need to greet it anew, which would forget its tare."""
    force = balance(HELLO, _pair(command, reply.format(command[0])), WEIGHT)
    told = {name: text.format(command) for name, text in fields.items()}
    with raises(kind, code, port="scripted", **told) as caught:
        ASK[command](force)
    assert type(caught.value) is kind
    assert force.read().stable


class BusyWire(TimedWire):
    """A balance that replies after 10 ms, and is busy in a span of time."""

    busy_s, silent_s = (math.inf, math.inf), math.inf

    def write(self, data: bytes) -> None:
        now_s = self.clock.monotonic_s()
        if now_s >= self.silent_s:
            return
        assert data != HELLO[0] or now_s == 0.0, "greeted anew"
        weight = b"S I\r\n" if self.busy_s[0] <= now_s < self.busy_s[1] else WEIGHT[1]
        self.coming.append((now_s + 0.01, HELLO[1] if data == HELLO[0] else weight))


def test_a_busy_balance_is_asked_for_its_weight_for_half_a_second_and_not_greeted_anew(clock: VirtualClock) -> None:
    wire = BusyWire(clock)
    force = MtSicsForce(wire, clock)
    force.read()
    wire.busy_s = (clock.monotonic_s(), clock.monotonic_s() + 0.4)
    force.read()
    wire.busy_s = (clock.monotonic_s(), math.inf)
    with raises(ForceBusy, "busy", command="SI"):
        force.read()
    assert 0.4 < clock.monotonic_s() - wire.busy_s[0] < 0.5
    wire.busy_s = (math.inf, math.inf)
    assert force.read().stable


def test_a_balance_that_was_busy_and_falls_silent_is_waited_for_no_longer(clock: VirtualClock) -> None:
    wire = BusyWire(clock)
    force = MtSicsForce(wire, clock)
    force.read()
    begun_s = clock.monotonic_s()
    wire.busy_s, wire.silent_s = (begun_s, math.inf), begun_s + 0.15
    with raises(ForceTimeout, "no_reply", command="SI"):
        force.read()
    assert clock.monotonic_s() - begun_s == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("command", "reply", "told"),
    [
        ("SI", "S X 1.00 g", "S X 1.00 g"), ("SI", "S", "S"),
        ("Z", "Z", "Z"), ("Z", "Z S", "Z"), ("Z", "T A", "T A"), ("Z", "Z X 1.00 g", "Z"),
    ],
)  # fmt: skip
def test_after_a_garbled_answer_the_balance_is_greeted_anew(
    balance: Balance, command: str, reply: str, told: str
) -> None:
    force = balance(HELLO, _pair(command, reply), HELLO, WEIGHT)
    with raises(ForceError, "garbled", port="scripted", reply=told) as caught:
        ASK[command](force)
    assert type(caught.value) is ForceError
    assert force.read().stable


@pytest.mark.parametrize(("command", "lasts_s"), [("SI", 0.5), ("Z", 10.0)])
def test_a_silent_balance_is_waited_for_so_long_and_greeted_anew(
    balance: Balance, clock: VirtualClock, command: str, lasts_s: float
) -> None:
    force = balance(HELLO, (f"{command}\r\n".encode(), b""), HELLO, WEIGHT)
    with raises(ForceTimeout, "no_reply", port="scripted", command=command, timeout_s=lasts_s):
        ASK[command](force)
    assert clock.monotonic_s() == pytest.approx(BEGUN_S + lasts_s)
    assert force.read().stable
