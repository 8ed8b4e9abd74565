"""What virtual devices stand on: their clock, cable, load cell and drive; and the balance, bytes in and bytes out."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from sim.devices import SerialLine, VirtualBalance
from sim.devices.clock import VirtualClock
from sim.devices.counted_motor import DriveAxis, ramps_to_rest
from sim.devices.line import Load, load_cell
from sim.errors import ArgumentError
from tests.error_codes import raises

GRAM_N = 9.80665e-3


class Host:
    def __init__(self, force_n: Callable[[float], float]) -> None:
        self.clock = VirtualClock()
        self.line = SerialLine(self.clock, 9600)
        self.asked: list[float] = []

        def watched(t_s: float) -> float:
            self.asked.append(t_s)
            return force_n(t_s)

        self.balance = VirtualBalance(self.clock, self.line, Load(watched))

    def say(self, data: bytes, wait_s: float = 0.04) -> bytes:
        self.line.host_write(data)
        self.clock.wait_s(wait_s)
        return self.line.host_read()


def _bears(grams: Callable[[float], float], wait_s: float = 0.0) -> Callable[[], Host]:
    """A balance under a weight that may move, so long after it was switched on."""

    def begun() -> Host:
        host = Host(lambda t_s: grams(t_s) * GRAM_N)
        host.clock.wait_s(wait_s)
        return host

    return begun


_rests = _bears(lambda t_s: 100.0)


@pytest.fixture
def host() -> Host:
    """100 g at rest."""
    return _rests()


Said = tuple[bytes, bytes] | tuple[bytes, float, bytes]
"""A command, seconds of waiting if not 0.04, and the reply; lines end in CR LF but where a piece is sent."""

SERIAL = b'I4 A "0123456789"\r\n'
CONVERSATIONS: dict[str, tuple[Callable[[], Host], *tuple[Said, ...]]] = {
    "stable and immediate value": (_rests, (b"S\r\n", b"S S     100.00 g\r\n"), (b"SI\r\n", b"S S     100.00 g\r\n")),
    "a moving load is dynamic and of the last sample": (  # samples at 0.95 and 1.00 s; the next would be at 1.05
        _bears(lambda t_s: 10 * t_s, 1.03), (b"SI\r\n", 0.01, b""), (b"", 0.03, b"S D      10.00 g\r\n"),
    ),
    "S waits until the load rests": (
        _bears(lambda t_s: min(t_s, 1.0) * 50, 0.5), (b"S\r\n", 0.5, b""), (b"", 0.2, b"S S      50.00 g\r\n"),
    ),
    "S gives up after a bounded time": (
        _bears(lambda t_s: 15 * t_s, 1.0), (b"S\r\n", 2.9, b""), (b"", 0.3, b"S I\r\n"),
    ),
    "a second command while it waits is refused, and @ cancels": (
        _bears(lambda t_s: 20 * t_s, 1.0),
        (b"S\r\n", b""), (b"SI\r\n", b"S I\r\n"), (b"@\r\n", SERIAL), (b"", 10.0, b""),
    ),
    **{
        name: (
            _bears(lambda t_s, grams=grams: grams),  # type: ignore[misc]
            (b"SI\r\n", b"S " + sign), (b"S\r\n", b"S " + sign), (b"Z\r\n", b"Z " + sign), (b"TI\r\n", b"TI " + sign),
        )
        for name, grams, sign in (("overload", 200.5, b"+\r\n"), ("underload", -25.0, b"-\r\n"))
    },
    "a broken cell has no value": (
        _bears(lambda t_s: math.nan), (b"SI\r\n", b"S I\r\n"), (b"S\r\n", 4.0, b"S I\r\n"),
    ),
    "zero": (_rests, (b"Z\r\n", b"Z A\r\n"), (b"SI\r\n", b"S S       0.00 g\r\n")),
    "zero at once tells whether it was stable": (_bears(lambda t_s: 10 * t_s, 1.0), (b"ZI\r\n", b"ZI D\r\n")),
    "tare": (
        _rests,
        (b"T\r\n", b"T S     100.00 g\r\n"), (b"TA\r\n", b"TA A     100.00 g\r\n"),
        (b"SI\r\n", b"S S       0.00 g\r\n"), (b"TAC\r\n", b"TAC A\r\n"), (b"SI\r\n", b"S S     100.00 g\r\n"),
        (b"TA 25.5 g\r\n", b"TA A      25.50 g\r\n"), (b"SI\r\n", b"S S      74.50 g\r\n"),
        (b"TI\r\n", b"TI S     100.00 g\r\n"),
    ),
    "errors": (
        _rests,
        (b"si\r\n", b"ES\r\n"), (b"XYZ\r\n", b"ES\r\n"), (b"\r\n", b"ES\r\n"), (b"S\xb2\r\n", b"ET\r\n"),
        (b"SI 3\r\n", b"EL\r\n"), (b"TA x g\r\n", b"EL\r\n"),
    ),
    "commands may come in pieces": (_rests, (b"I", b""), (b"4\r", b""), (b"\n", SERIAL)),
}  # fmt: skip


@pytest.mark.parametrize("name", CONVERSATIONS)
def test_the_virtual_balance_answers_each_command_as_mt_sics_documents(name: str) -> None:
    begun, *said = CONVERSATIONS[name]
    host = begun()
    for command, *wait_s, reply in said:
        assert host.say(command, *wait_s) == reply, command  # type: ignore[arg-type]


def test_the_virtual_balance_repeats_every_sample_after_sir_until_canceled() -> None:
    host = Host(lambda t_s: 10 * t_s * GRAM_N)
    host.clock.wait_s(1.0)
    lines = host.say(b"SIR\r\n", 1.0).split(b"\r\n")[:-1]
    assert len(lines) in (19, 20, 21)
    grams = [float(line.split()[2]) for line in lines]
    assert [b - a for a, b in pairwise(grams[1:])] == pytest.approx([0.5] * (len(grams) - 2))
    assert host.say(b"@\r\n", 0.2).endswith(b'I4 A "0123456789"\r\n')
    assert host.say(b"", 1.0) == b""


# --- the cable ---


def test_bytes_on_a_virtual_line_arrive_with_their_last_bit() -> None:
    clock = VirtualClock()
    line = SerialLine(clock, 9600)
    line.device_write(b"hello")
    clock.wait_s(5 * 10 / 9600 - 1e-9)
    assert not line.host_pending()
    clock.wait_s(2e-9)
    assert line.host_pending()
    assert line.host_read() == b"hello"
    assert not line.host_pending()


def test_each_direction_of_a_virtual_line_sends_one_chunk_after_another() -> None:
    clock = VirtualClock()
    line = SerialLine(clock, 1000)
    heard: list[tuple[float, bytes]] = []
    line.connect(lambda data: heard.append((clock.monotonic_s(), data)))
    line.host_write(b"ab")
    line.host_write(b"c")
    line.device_write(b"x")
    clock.wait_s(1.0)
    assert heard == [(pytest.approx(0.02), b"ab"), (pytest.approx(0.03), b"c")]
    line.host_write(b"d")
    clock.wait_s(1.0)
    assert heard[-1] == (pytest.approx(1.01), b"d")


def test_a_virtual_line_refuses_a_baud_rate_of_zero() -> None:
    with raises(ArgumentError, "bad_baud", baud=0):
        SerialLine(VirtualClock(), 0)


# --- the load cell ---


def ramp(t_s: float) -> float:
    return 0.1 * t_s


def test_the_virtual_load_cell_shows_the_force_of_its_latency_ago() -> None:
    late = load_cell(ramp, sample_period_s=0.05, latency_s=0.3)
    assert late(2.0) == pytest.approx(0.17, abs=1e-15)
    assert late(0.1) == 0.0


def test_the_virtual_load_cell_adds_its_zero_drift_to_the_force() -> None:
    drifting = load_cell(ramp, sample_period_s=0.05, drift_n_per_s=-0.02)
    assert drifting(3.0) == pytest.approx(0.3 - 0.06, abs=1e-15)


def test_the_noise_of_the_virtual_load_cell_is_gaussian_and_repeatable() -> None:
    cell = load_cell(lambda t_s: 0.02, sample_period_s=0.05, noise_n=1e-3, seed=7)
    values = np.array([cell(0.05 * k) for k in range(4000)])
    # Standard errors of 4 000 draws: 1e-3 / √4000 = 1.6e-5 and 1e-3 / √8000 = 1.1e-5; bounds at four of them.
    assert values.mean() == pytest.approx(0.02, abs=6.4e-5)
    assert values.std() == pytest.approx(1e-3, abs=4.5e-5)
    assert abs(np.corrcoef(values[1:], values[:-1])[0, 1]) < 4 / np.sqrt(4000)
    again = load_cell(lambda t_s: 0.02, sample_period_s=0.05, noise_n=1e-3, seed=7)
    assert [again(0.05 * k) for k in (3999, 17, 0)] == [values[k] for k in (3999, 17, 0)]
    assert load_cell(lambda t_s: 0.02, sample_period_s=0.05, noise_n=1e-3, seed=8)(0.0) != values[0]


def test_the_virtual_balance_calls_only_a_fresh_force_stable() -> None:
    clock = VirtualClock()
    line = SerialLine(clock, 9600)
    VirtualBalance(clock, line, Load(lambda t_s: 0.1, lambda t_s: t_s < 1.0))
    heard = []
    for _ in range(2):
        line.host_write(b"SI\r\n")
        clock.wait_s(0.5)
        heard.append(line.host_read()[:3])
        clock.wait_s(0.5)
    assert heard == [b"S S", b"S D"]


# --- the axis of a drive ---

UP, DOWN, CRUISE = 4000.0, 2500.0, 1000.0


@pytest.mark.parametrize("speed", [0.0, 300.0, 900.0, 1000.0, 1500.0])
@pytest.mark.parametrize("length", [700.0, 2000.0, 20_000.0])
@pytest.mark.parametrize("cruise", [CRUISE, 5000.0])
def test_speed_ramps_cover_the_length_and_end_at_rest(cruise: float, length: float, speed: float) -> None:
    ramps = [ramp for ramp in ramps_to_rest(length, speed, cruise, UP, DOWN) if ramp.duration_s > 0]
    ends = [ramp.v0 + ramp.accel * ramp.duration_s for ramp in ramps]
    assert sum(ramp.mm for ramp in ramps) == pytest.approx(length, rel=1e-12)
    assert ramps[0].v0 == speed
    assert [following.v0 for _, following in pairwise(ramps)] == pytest.approx(ends[:-1], rel=1e-9)
    assert ends[-1] == pytest.approx(0.0, abs=1e-9)
    assert max(ramp.v0 for ramp in ramps) <= max(cruise, speed) + 1e-9
    assert {ramp.accel for ramp in ramps} <= {UP, 0.0, -DOWN}


@pytest.mark.parametrize(("length", "speed"), [(10.0, 300.0), (100.0, 1500.0)])
def test_a_drive_brakes_harder_over_too_short_a_distance(length: float, speed: float) -> None:
    (ramp,) = ramps_to_rest(length, speed, CRUISE, UP, DOWN)
    assert ramp.mm == pytest.approx(length)
    assert ramp.v0 + ramp.accel * ramp.duration_s == pytest.approx(0.0, abs=1e-9)
    assert ramp.accel < -DOWN


@pytest.mark.parametrize("target", [5000.0, 400.0, 300.0, -3000.0])
def test_a_path_begun_in_motion_ends_at_its_target(target: float) -> None:
    # From 175 at 1 000 pulses/s rest is 200 pulses away: 400 can be reached at once, 300 only by coming back.
    axis = DriveAxis(0)
    axis.go([(100_000.0, CRUISE)], UP, DOWN, 0.0)
    axis.go([(target, CRUISE)], UP, DOWN, 0.3)
    speeds = [abs(axis.velocity_at(0.01 * k)) for k in range(1000)]
    assert axis.position_at(10.0) == target
    assert max(speeds) <= CRUISE + 1e-9
    changes = [b - a for a, b in pairwise(speeds)]
    assert max(changes) <= 0.01 * UP + 1e-9
    assert min(changes) >= -0.01 * DOWN - 1e-9


# --- the clock ---


def test_virtual_time_jumps_to_the_event_that_ends_a_wait() -> None:
    clock = VirtualClock(start_unix_s=1000.0)
    heard: list[float] = []
    clock.call_at(3.0, lambda: heard.append(clock.monotonic_s()))
    clock.call_at(1.0, lambda: heard.append(clock.monotonic_s()))
    assert clock.wait_until(lambda: bool(heard), 10.0)
    assert heard == [1.0]
    assert clock.monotonic_s() == 1.0
    assert clock.unix_s() == 1001.0


def test_a_deadline_ends_a_virtual_wait_and_later_events_stay() -> None:
    clock = VirtualClock()
    heard: list[int] = []
    clock.call_at(2.0, lambda: heard.append(1))
    assert not clock.wait_until(lambda: bool(heard), 1.5)
    assert clock.monotonic_s() == 1.5
    clock.wait_s(0.5)
    assert heard == [1]


def test_a_virtual_wait_that_nothing_can_end_is_an_error() -> None:
    with pytest.raises(RuntimeError):
        VirtualClock().wait_until(lambda: False, math.inf)
    with raises(ArgumentError, "no_deadline"):
        VirtualClock().wait_until(lambda: False, math.nan)
    with raises(ArgumentError, "endless_time", t_s=math.inf):
        VirtualClock().call_at(math.inf, lambda: None)


def test_virtual_time_does_not_run_backwards() -> None:
    clock = VirtualClock()
    clock.wait_s(1.0)
    clock.wait_s(-5.0)
    assert not clock.wait_until(lambda: False, 0.5)
    assert clock.monotonic_s() == 1.0
