"""What is special about Leadshine drives, on registers: paths that are null until they move, limits, inputs, outputs.

The bytes are in tests/contracts/bytes/leadshine.py.
"""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from copy import copy
from functools import partial
from typing import Any

import pytest

from rig.devices.base import MoveError, StageAlarm, StageError, StageReset, StageTimeout
from rig.devices.leadshine import LeadshineStage
from rig.transport.modbus import ModbusError, ModbusGarbled, ModbusTimeout
from sim.devices.clock import VirtualClock
from tests.drives_as_registers import (
    ALARM,
    HOMED,
    PR0,
    RUNNING,
    TRIGGER,
    Bus,
    X,
    Z,
    homed_stage,
    number,
)
from tests.error_codes import raises

Make = Callable[..., tuple[Bus, LeadshineStage]]


@pytest.fixture
def bench(clock: VirtualClock) -> Make:
    return partial(homed_stage, clock)


# --- what is refused ---

VERBS: dict[str, Callable[[LeadshineStage], object]] = {
    "home": lambda stage: stage.home(),
    "move_to": lambda stage: stage.move_to(z_mm=-1.0, speed_mm_s=1.0),
    "jog": lambda stage: stage.jog("z", -1.0, 1.0),
    "limit_depth": lambda stage: stage.limit_depth(-1.0),
    "connect": lambda stage: stage.connect(),
}


@pytest.mark.parametrize(
    ("ports", "x", "refused"),
    [(("/dev/ttyUSB1", "/dev/ttyUSB1"), Z, True), (("/dev/ttyUSB1", "/dev/ttyUSB1"), X, False),
     (("/dev/serial/by-id/a", "/dev/serial/by-id/b"), Z, False), (("/dev/ttyUSB1", "/dev/serial/by-id/b"), Z, True),
     (("tcp://10.0.0.7:502", "tcp://10.0.0.7:502"), Z, False)],
)  # fmt: skip
def test_drives_that_two_ports_could_exchange_are_refused(
    bench: Make, ports: tuple[str, str], x: int, refused: bool
) -> None:
    """With the same address behind two adapters, z's paths would move x if their names change places."""
    bus, stage = bench()
    drive: Any = stage._axes["x"]
    drive.link, drive.device_id = copy(bus), x
    drive.link.name, bus.name = ports
    with raises(StageError, "port_may_change", port=ports[1], device=Z) if refused else nullcontext():
        stage.connect()
    assert bool(bus.told) is not refused


def test_a_jog_does_not_begin_where_two_answers_differ(bench: Make) -> None:
    """One of them has a wrong bit, and the target would be wrong by it; or the drive moves."""
    bus, stage = bench()
    read, said = bus.read, iter([[0, 4], [0, 5]])

    def differs(device: int, register: int, count: int = 1) -> list[int]:
        return next(said) if register == 0x602C else read(device, register, count)

    bus.read = differs  # type: ignore[method-assign]
    with raises(StageError, "answers_differ", axis="x", drive=1, once=4, again=5):
        stage.jog("x", -1.0, 1.0)
    assert bus.told == []


@pytest.mark.parametrize("per_mm", [200.0, -200.0])
def test_a_drive_runs_no_slower_than_a_turn_a_minute(bench: Make, per_mm: float) -> None:
    """A turn is 2 mm: 2 mm/min, 0.0333 mm/s, is one rpm; and no faster than asked for, 0.0999 mm/s is two."""
    bus, stage = bench(per_mm=per_mm)
    for speed_mm_s, rpm in ((1 / 30, 1), (0.0999, 2), (0.1, 3), (5.0, 150)):
        stage.move_to(x_mm=-1.0, speed_mm_s=speed_mm_s)
        assert bus.told[-2][3][3] == rpm
        assert bus.paths()[-1] == (X, -per_mm)
    with raises(MoveError, "too_slow", least_mm_s=1 / 30, speed_mm_s=0.033):
        stage.move_to(x_mm=-1.0, speed_mm_s=0.033)


# --- trust ---


@pytest.mark.parametrize("loses", ["move_to", "limit_depth"])
@pytest.mark.parametrize("again", ["home", "jog", "connect"])
def test_after_a_drive_was_switched_off_its_own_paths_are_made_null_before_it_moves(
    bench: Make, loses: str, again: str
) -> None:
    """At power-on it has them from its memory again, and its speeds of homing and jogging."""
    bus, stage = bench()
    bus.status = lambda device, t_s: HOMED & ~0x40
    with raises(StageReset, "was_reset", axis="z", drive=2):
        VERBS[loses](stage)
    path_1, path_15, jog_rpm = (Z, 0x6208), (Z, 0x6278), (Z, 0x01E1)
    bus.registers[path_1], bus.registers[path_15], bus.registers[jog_rpm] = 0x41, 2, 60
    bus.status = lambda device, t_s: HOMED
    bus.told.clear()
    VERBS[again](stage)
    homing_speeds = (Z, 0x600F)
    assert [(device, register, said) for _, device, register, said in bus.told if device == Z][:4] == [
        (*path_1, [0]),
        (*path_15, [0]),
        (*homing_speeds, [1, 1, 333, 333]),
        (*jog_rpm, [1]),
    ]


@pytest.mark.parametrize("verb", ["move_to", "jog"])
@pytest.mark.parametrize("trouble", [ModbusTimeout, ModbusGarbled, None])
def test_after_an_exchange_that_failed_paths_are_made_null_before_anything_moves(
    bench: Make, trouble: type[ModbusError] | None, verb: str
) -> None:
    """It may have been switched off and on, and has its own paths again; or it does not keep what it is told."""
    bus, stage = bench()
    if trouble is None:
        write = bus.write
        bus.write = lambda device, register, values: None  # type: ignore[method-assign]
        with raises(StageError, "not_as_configured", axis="z", register="0x6200"):
            stage.jog("z", -1.0, 1.0)
        bus.write = write  # type: ignore[method-assign]
    else:
        bus.trouble = trouble("no answer")
        with raises(StageTimeout if trouble is ModbusTimeout else StageError, trouble.default_code, axis="z"):
            stage.halt()
    bus.trouble = None
    bus.registers[X, 0x6208] = 0x41
    bus.told.clear()
    VERBS[verb](stage)
    told = [what[1:] for what in bus.told]
    assert (X, 0x6208, [0]) in told[:-2], "the last ones are those of the motion"
    assert stage.homed


@pytest.mark.parametrize("word", range(7))
def test_a_path_that_the_drive_has_otherwise_is_not_started(bench: Make, word: int) -> None:
    """One bit of one register."""
    bus, stage = bench()
    read = bus.read

    def with_a_wrong_bit(device: int, register: int, count: int = 1) -> list[int]:
        found = read(device, register, count)
        return [value ^ 0x20 * (n == word and count == 7) for n, value in enumerate(found)]

    bus.read = with_a_wrong_bit  # type: ignore[method-assign]
    with raises(StageError, "not_as_configured", axis="x", drive=X, name="path 0", register="0x6200"):
        stage.move_to(x_mm=-1.0, speed_mm_s=5.0)
    assert TRIGGER not in {register for _, _, register, _ in bus.told}
    assert not stage.homed


# --- limits ---

POSITIVE, NEGATIVE, LIMITS_ON = 0x6006, 0x6008, 0x6000


def _limits(bus: Bus) -> tuple[int, int]:
    """Lower and upper limit of z, in pulses."""
    low, high = (number([bus.registers[Z, first + k] for k in (0, 1)]) for first in (NEGATIVE, POSITIVE))
    return low, high


@pytest.mark.parametrize(("per_mm", "limits"), [(400.0, (-24000, 0)), (-400.0, (0, 24000))])
def test_homing_limits_the_travel_also_of_a_motor_that_runs_against_its_axis(
    bench: Make, per_mm: float, limits: tuple[int, int]
) -> None:
    """60 mm; limits change places."""
    bus, stage = bench(per_mm=per_mm)
    stage.home()
    assert _limits(bus) == limits
    assert bus.registers[Z, LIMITS_ON] == 2


@pytest.mark.parametrize(
    ("lowest_mm", "per_mm", "limit"),
    [(-26.5, 400.0, -10600), (-26.5, -400.0, 10600), (-26.5, 0.5, -13), (-26.5, -0.5, 13), (-99.0, 400.0, -24000),
     (1.0, 400.0, 0)],
)  # fmt: skip
def test_a_lower_limit_lies_within_the_travel(bench: Make, lowest_mm: float, per_mm: float, limit: int) -> None:
    bus, stage = bench(per_mm=per_mm)
    bus.registers[Z, LIMITS_ON] = 2
    stage.limit_depth(lowest_mm)
    assert _limits(bus)[per_mm < 0] == limit
    assert stage.homed


@pytest.mark.parametrize(("word", "on", "code"), [(RUNNING, 2, "runs"), (HOMED, 0, "not_as_configured")])
def test_a_lower_limit_that_does_not_hold_is_an_error(bench: Make, word: int, on: int, code: str) -> None:
    """Of a drive that moves, and of one whose soft limits are off."""
    bus, stage = bench()
    bus.status, bus.registers[Z, LIMITS_ON] = lambda device, t_s: word, on
    with raises(StageError, code, axis="z", drive=Z):
        stage.limit_depth(-26.5)
    assert not stage.homed


# --- the rest ---


def test_an_output_is_a_word_to_the_configured_register(bench: Make) -> None:
    bus, stage = bench(
        sync={"output": "drive", "drive": "x", "register_address": 0x157, "on_word": 0x80, "off_word": 0}
    )
    stage.set_output(True)
    stage.set_output(False)
    assert [what[1:] for what in bus.told] == [(X, 0x157, [0x80]), (X, 0x157, [0])]


def test_a_stop_reaches_every_drive_even_if_one_is_silent(bench: Make, clock: VirtualClock) -> None:
    bus, stage = bench()
    write, begun_s = bus.write, clock.monotonic_s()

    def silent(device: int, register: int, values: Sequence[int]) -> None:
        write(device, register, values)
        if device == Z:
            clock.wait_s(0.2)
            raise ModbusTimeout("no answer", "no_reply")

    bus.write = silent  # type: ignore[method-assign]
    with raises(StageTimeout, "no_reply", axis="z"):
        stage.stop()
    assert clock.monotonic_s() - begun_s < 1.5
    assert (X, TRIGGER, [QUICK_STOP]) in [what[1:] for what in bus.told]


@pytest.mark.parametrize("register", [0x0179, 0x017A])
def test_an_active_input_is_a_bit_of_the_vertical_drives_word(bench: Make, register: int) -> None:
    bus, stage = bench(stop={"inputs_register": register})
    for word, inputs in ((0, set()), (1, {"di1"}), (64, {"di7"}), (0b0101_0010, {"di2", "di5", "di7"}), (128, set())):
        bus.registers[Z, register] = word
        assert stage.active_inputs() == inputs
    assert {(device, asked) for _, device, asked in bus.asked} == {(Z, register)}


def test_an_output_that_is_off_is_not_switched_though_its_words_are_configured(bench: Make) -> None:
    bus, stage = bench(sync={"output": "off", "register_address": 0x157, "on_word": 0x80, "off_word": 0})
    with raises(StageError, "no_output"):
        stage.set_output(True)
    assert bus.told == []


QUICK_STOP = 0x40


# --- moves ---


@pytest.mark.parametrize(
    ("word", "pulses"), [(0x76, -400), (0x52, -400), (0x72, -399)], ids=["runs", "path not done", "elsewhere"]
)
def test_a_drive_has_arrived_when_it_stands_with_its_path_done_and_the_target_for_command(
    bench: Make, clock: VirtualClock, word: int, pulses: int
) -> None:
    bus, stage = bench()
    over_s = clock.monotonic_s() + 1.0
    begun_s = clock.monotonic_s()

    def status(device: int, t_s: float) -> int:
        if t_s > begun_s:
            bus.stands(X, pulses if t_s < over_s else -400)
        return word if begun_s < t_s < over_s else HOMED

    bus.status = status
    stage.move_to(x_mm=-1.0, speed_mm_s=5.0)
    assert over_s <= clock.monotonic_s() < over_s + 0.03


@pytest.mark.parametrize(("word", "pulses"), [(0x76, 0), (0x32, 0), (0x72, 1)], ids=["runs", "not homed", "not at 0"])
def test_a_drive_is_homed_when_it_stands_and_says_so_and_is_at_0(
    bench: Make, clock: VirtualClock, word: int, pulses: int
) -> None:
    bus, stage = bench()
    begun_s = clock.monotonic_s()

    def status(device: int, t_s: float) -> int:
        early = begun_s < t_s < begun_s + 1.0
        bus.stands(Z, pulses if early else 0)
        return word if early else HOMED

    bus.status = status
    stage.home()
    assert begun_s + 1.0 <= clock.monotonic_s() < begun_s + 1.2


@pytest.mark.parametrize("late", [0, 40])
def test_a_drive_that_is_not_seen_to_run_has_homed_if_it_was_not_homed_meanwhile(
    bench: Make, clock: VirtualClock, late: int
) -> None:
    """It may begin some looks late, within a second."""
    bus, stage = bench()
    said = {device: iter([HOMED] * (2 + late) + [0x32]) for device in (X, Z)}  # two looks before the trigger
    bus.status = lambda device, t_s: next(said[device], HOMED)
    write = bus.write

    def homes_unseen(device: int, register: int, values: Sequence[int]) -> None:
        write(device, register, values)
        bus._homes.clear()

    bus.write = homes_unseen  # type: ignore[method-assign]
    stage.home()
    assert stage.homed


# --- stopping ---


def test_a_stop_is_told_again_each_20_ms_until_the_drive_stands(bench: Make, clock: VirtualClock) -> None:
    bus, stage = bench()
    begun_s = clock.monotonic_s()
    bus.status = lambda device, t_s: RUNNING if device == Z and t_s < begun_s + 0.05 else HOMED
    stage.halt()
    told = [(t_s - begun_s, device) for t_s, device, register, said in bus.told if said == [QUICK_STOP]]
    assert [t_s for t_s, device in told if device == Z] == pytest.approx([0.0, 0.02, 0.04, 0.06])
    assert [device for _, device in told] == [Z, Z, Z, Z, X]


def test_homing_that_fails_stops_the_other_drive_until_it_stands(bench: Make, clock: VirtualClock) -> None:
    """It may have received the command, too."""
    bus, stage = bench()
    begun_s = clock.monotonic_s()

    def status(device: int, t_s: float) -> int:
        if device == X:
            return RUNNING if begun_s < t_s < begun_s + 0.2 else HOMED
        return ALARM if t_s > begun_s else HOMED

    bus.status = status
    with raises(StageAlarm, "alarm", axis="z"):
        stage.home()
    stops_s = [t_s - begun_s for t_s, device, _, said in bus.told if (device, said) == (X, [QUICK_STOP])]
    assert len(stops_s) > 5
    assert 0.2 <= stops_s[-1] < 0.25


@pytest.mark.parametrize("arrived", [True, False, None], ids=["arrived", "under way", "homed since"])
def test_a_stop_makes_a_path_null_unless_it_ends_where_the_axis_stands(
    bench: Make, clock: VirtualClock, arrived: bool | None
) -> None:
    """Else a bit error of a stop, which is written with the register of the trigger, could start it again."""
    bus, stage = bench()
    looks = stage.moving(z_mm=-10.0, speed_mm_s=1.0)
    begun_s = clock.monotonic_s()
    bus.status = lambda device, t_s: RUNNING if begun_s < t_s < begun_s + 9.0 else HOMED
    next(looks)
    if arrived:
        list(looks)
    else:
        bus.status = lambda device, t_s: HOMED
    if arrived is None:
        stage.home()
    bus.told.clear()
    stage.halt()
    nulled = [said for _, device, register, said in bus.told if (device, register) == (Z, PR0)]
    assert nulled == [[0]] * (arrived is False)
    bus.told.clear()
    stage.halt()
    assert {(register, tuple(said)) for _, _, register, said in bus.told} == {(TRIGGER, (QUICK_STOP,))}
