"""What a Leadshine stage refuses, when it trusts its position, and how it takes up backlash."""

from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from typing import Any

import pytest

from rig.devices.base import MoveError, StageAlarm, StageError, StageTimeout
from rig.devices.leadshine import LeadshineStage
from rig.transport.modbus import ModbusError, ModbusGarbled, ModbusTimeout
from sim.devices.clock import VirtualClock
from tests.drives_as_registers import ALARM, DISABLED, HOMED, Bus, X, Z, homed_stage
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
    "jog_while": lambda stage: stage.jog_while("z", -1, lambda: True, 1.0),
    "limit_depth": lambda stage: stage.limit_depth(-1.0),
}


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize(
    ("word", "kind", "code", "fields"),
    [
        (ALARM, StageAlarm, "alarm", {"number": 0xE0}),
        (DISABLED, StageError, "not_enabled", {"axis": "z", "drive": 2}),
    ],
    ids=["alarm", "disabled"],
)
def test_nothing_is_written_to_a_drive_that_would_not_obey(
    bench: Make, verb: str, word: int, kind: type[StageError], code: str, fields: dict[str, Any]
) -> None:
    bus, stage = bench()
    bus.status = lambda device, t_s: word
    bus.registers[Z, 0x2203] = 0xE0
    with raises(kind, code, **fields):
        VERBS[verb](stage)
    assert bus.told == []


@pytest.mark.parametrize(
    ("port", "x", "refused"),
    [("/dev/ttyUSB1", Z, True), ("/dev/ttyUSB1", X, False), ("/dev/serial/by-id/a", Z, False),
     ("tcp://10.0.0.7:502", Z, False)],
)  # fmt: skip
def test_drives_that_two_ports_could_exchange_are_refused(bench: Make, port: str, x: int, refused: bool) -> None:
    """With the same address behind two adapters, z's paths would move x if their names change places."""
    bus, stage = bench()
    bus.name = port
    stage._drives["x"].device_id = x
    with raises(StageError, "port_may_change", port=port, device=Z) if refused else nullcontext():
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


@pytest.mark.parametrize(("verb", "register"), [("home", 0x600A), ("jog", 0x6200), ("move_to", 0x6200)])
def test_a_stop_from_another_thread_before_the_trigger_is_the_last_word(
    bench: Make, verb: str, register: int
) -> None:
    bus, stage = bench()
    read = bus.read

    def stopped_meanwhile(device: int, asked: int, count: int = 1) -> list[int]:
        found = read(device, asked, count)
        if asked == register:
            bus.read = read  # type: ignore[method-assign]
            stage.stop()
        return found

    bus.read = stopped_meanwhile  # type: ignore[method-assign]
    with raises(StageError, "stopped", axis="z", drive=2):
        VERBS[verb](stage)
    triggers = [said for _, _, told, said in bus.told if told == 0x6002]
    assert triggers == [[0x40]] * len(triggers)
    assert triggers
    assert not stage.homed


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
@pytest.mark.parametrize("again", ["home", "jog", "jog_while"])
def test_after_a_drive_was_switched_off_its_own_paths_are_made_null_before_it_moves(
    bench: Make, loses: str, again: str
) -> None:
    """At power-on it has them from its memory again, and its speeds of homing and jogging."""
    bus, stage = bench()
    bus.status = lambda device, t_s: HOMED & ~0x40
    with raises(StageError, "lost_home", axis="z", drive=2):
        VERBS[loses](stage)
    path_1, jog_rpm = (Z, 0x6208), (Z, 0x01E1)
    bus.registers[path_1], bus.registers[jog_rpm] = 0x41, 60
    bus.status = lambda device, t_s: HOMED
    bus.told.clear()
    if again == "jog_while":
        held = iter([True, False])
        stage.jog_while("z", -1, lambda: next(held), 1.0)
    else:
        VERBS[again](stage)
    homing_speeds = (Z, 0x600F)
    assert [(device, register, said) for _, device, register, said in bus.told][:3] == [
        (*path_1, [0]),
        (*homing_speeds, [1, 1, 333, 333]),
        (*jog_rpm, [1]),
    ]


@pytest.mark.parametrize("verb", ["move_to", "jog", "jog_while"])
@pytest.mark.parametrize("trouble", [ModbusTimeout, ModbusGarbled, None])
def test_after_an_exchange_that_failed_paths_are_made_null_before_anything_moves(
    bench: Make, trouble: type[ModbusError] | None, verb: str
) -> None:
    """It may have been switched off and on, and has its own paths again; or it does not keep what it is told."""
    bus, stage = bench()
    if trouble is None:
        write = bus.write
        bus.write = lambda device, register, values: None  # type: ignore[method-assign]
        with raises(StageError, "not_as_configured", axis="z", register=0x6200):
            stage.jog("z", -1.0, 1.0)
        bus.write = write  # type: ignore[method-assign]
    else:
        bus.trouble = trouble("no answer")
        with raises(StageTimeout if trouble is ModbusTimeout else StageError, trouble.default_code, axis="z"):
            stage.halt()
    bus.trouble = None
    bus.registers[X, 0x6208] = 0x41
    bus.told.clear()
    if verb == "jog_while":
        stage.jog_while("z", -1, lambda: False, 1.0)
    else:
        VERBS[verb](stage)
    told = [what[1:] for what in bus.told]
    assert (X, 0x6208, [0]) in told[:-2], "the last ones are those of the motion"
    assert stage.homed


@pytest.mark.parametrize("device", [X, Z])
def test_a_status_that_shows_a_drive_without_its_home_ends_the_trust(bench: Make, device: int) -> None:
    bus, stage = bench()
    bus.status = lambda asked, t_s: HOMED & ~0x40 if asked == device else HOMED
    seen = stage.look()
    assert (seen.state, seen.referenced, stage.homed) == ("Idle", False, False)


# --- backlash ---


# --- the rest ---


@pytest.mark.parametrize("register", [0x0179, 0x017A])
def test_an_active_input_is_a_bit_of_the_vertical_drives_word(bench: Make, register: int) -> None:
    bus, stage = bench(inputs_register=register)
    for word, inputs in ((0, set()), (1, {"di1"}), (64, {"di7"}), (0b0101_0010, {"di2", "di5", "di7"}), (128, set())):
        bus.registers[Z, register] = word
        assert stage.active_inputs() == inputs
    assert {(device, asked) for _, device, asked in bus.asked} == {(Z, register)}
