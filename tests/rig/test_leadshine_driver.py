"""The Leadshine stage as pairs of bytes: x is device 1, z is device 2, 400 pulses a turn and a mm."""

from collections.abc import Callable
from typing import Any

import pytest

from rig.devices.base import StageError, StageTimeout
from rig.devices.counted_axis import AxisSpec
from rig.devices.leadshine import LeadshineStage
from rig.devices.leadshine_drive import LeadshineDrive
from rig.devices.registry import KnownBench
from rig.settings import DriveSettings, SyncSettings
from rig.transport.modbus import ModbusMaster
from sim.devices.clock import VirtualClock
from tests.error_codes import raises

Pair = tuple[str, str]
Make = Callable[..., LeadshineStage]

AT_REST = "00 32"  # enabled, command done, path done
HOMED = "00 72"
RUNNING = "00 06"


def status(device: int, word: str) -> Pair:
    return f"{device:02X} 03 10 03 00 01", f"{device:02X} 03 02 {word}"


def stands(device: int) -> Pair:
    """The position by the feedback."""
    return f"{device:02X} 03 10 14 00 02", f"{device:02X} 03 04 00 00 00 00"


def commanded(device: int, counts: str) -> Pair:
    return f"{device:02X} 03 60 2C 00 02", f"{device:02X} 03 04 {counts}"


def echoed(frame: str) -> Pair:
    """A write of one register, and its echo."""
    return frame, frame


def written(frame: str) -> Pair:
    """A write of several registers, and its answer: the first six bytes."""
    return frame, frame[: 6 * 3 - 1]


def hello(device: int) -> Pair:
    return f"{device:02X} 03 00 01 00 01", f"{device:02X} 03 02 01 90"


def set_and_read_back(device: int, register: str, words: str) -> list[Pair]:
    """Function 16, and the same registers again by function 03; `register` and `words` in hex."""
    count = len(words.split()) // 2
    head = f"{register} {count >> 8:02X} {count & 255:02X}"
    return [
        written(f"{device:02X} 10 {head} {2 * count:02X} {words}"),
        (f"{device:02X} 03 {head}", f"{device:02X} 03 {2 * count:02X} {words}"),
    ]


def started(device: int, target: str, rpm: str) -> list[Pair]:
    """A path without its trigger, read back, and only then the trigger."""
    path = set_and_read_back(device, "62 00", f"00 01 {target} {rpm} 01 4D 01 4D 00 00")
    return [*path, echoed(f"{device:02X} 06 60 02 00 10")]


def disarmed(device: int, paths: dict[int, str] | None = None) -> list[Pair]:
    """The types of sixteen paths are asked for, then the speeds of homing and jogs; what is harmless stays."""
    d, script = f"{device:02X}", list[Pair]()
    for number in range(16):
        register = f"62 {8 * number:02X}"
        word = (paths or {}).get(number, "00 00")
        script.append((f"{d} 03 {register} 00 01", f"{d} 03 02 {word}"))
        if word != "00 00":
            script += set_and_read_back(device, register, "00 00")
    return [
        *script,
        (f"{d} 03 60 0F 00 04", f"{d} 03 08 00 01 00 01 01 4D 01 4D"),
        (f"{d} 03 01 E1 00 01", f"{d} 03 02 00 01"),
    ]


def homing(device: int, lowest: str) -> list[Pair]:
    """What homing says to one drive, with the soft limits after it."""
    d = f"{device:02X}"
    return [
        written(f"{d} 10 60 0A 00 01 02 00 01"),  # mode
        (f"{d} 03 60 0A 00 01", f"{d} 03 02 00 01"),
        written(f"{d} 10 60 0F 00 04 08 01 2C 00 19 01 4D 01 4D"),  # 300 and 25 rpm, ramps of 333 ms
        (f"{d} 03 60 0F 00 04", f"{d} 03 08 01 2C 00 19 01 4D 01 4D"),
        echoed(f"{d} 06 60 02 00 20"),
        status(device, RUNNING),
        status(device, HOMED),
        commanded(device, "00 00 00 00"),
        status(device, HOMED),
        written(f"{d} 10 60 06 00 02 04 00 00 00 00"),
        (f"{d} 03 60 06 00 02", f"{d} 03 04 00 00 00 00"),
        written(f"{d} 10 60 08 00 02 04 {lowest}"),
        (f"{d} 03 60 08 00 02", f"{d} 03 04 {lowest}"),
        written(f"{d} 10 60 00 00 01 02 00 02"),
        (f"{d} 03 60 00 00 01", f"{d} 03 02 00 02"),
    ]


STOP: Pair = ("00 06 60 02 00 40", "")  # to both, without a reply
# −40 mm and −60 mm are −16000 and −24000 pulses.
BEFORE = [status(2, AT_REST), status(1, AT_REST), *disarmed(2), *disarmed(1)]
HOMING = [*BEFORE, *homing(2, "FF FF C1 80"), *homing(1, "FF FF A2 40")]


@pytest.fixture
def stage(clock: VirtualClock, scripted: Callable[[list[Any]], Any], rtu: Callable[[str], bytes]) -> Make:
    def make(pairs: list[Pair], *, per_mm: float = 400.0, **options: Any) -> LeadshineStage:
        wire = scripted([(rtu(sent), rtu(reply) if reply else b"") for sent, reply in pairs])
        bus = ModbusMaster(wire, clock)

        def drive(axis: str, device: int, travel_mm: float) -> LeadshineDrive:
            return LeadshineDrive(bus, clock, AxisSpec(axis, per_mm, travel_mm), DriveSettings(device_id=device))

        settings = KnownBench.model_validate({"stage": {"kind": "leadshine"}, **options})
        return LeadshineStage(drive("x", 1, 60.0), drive("z", 2, 40.0), settings)

    return make


@pytest.fixture
def homed(stage: Make) -> Make:
    """A stage that has been homed before the rest of its script."""

    def make(pairs: list[Pair], **options: Any) -> LeadshineStage:
        ready = stage([*HOMING, *pairs], **options)
        ready.home()
        assert ready.homed
        return ready

    return make


# --- hello ---


def test_paths_of_the_owner_are_made_null_and_so_is_what_homes_or_jogs_fast(stage: Make) -> None:
    """PR1 to PR8, as the EEPROM holds them; nothing is saved."""
    paths = {1: "00 01", 2: "00 41", 4: "00 02", 8: "00 03"}
    speeds = [
        ("02 03 60 0F 00 04", "02 03 08 00 C8 00 32 00 64 00 64"),
        *set_and_read_back(2, "60 0F", "00 01 00 01 01 4D 01 4D"),
        ("02 03 01 E1 00 01", "02 03 02 00 3C"),
        *set_and_read_back(2, "01 E1", "00 01"),
    ]
    stage([hello(1), *disarmed(1), hello(2), *disarmed(2, paths)[:-2], *speeds]).connect()


def test_a_path_that_stays_is_refused(stage: Make) -> None:
    script = [hello(1), *disarmed(1, {15: "00 41"})[:17], ("01 03 62 78 00 01", "01 03 02 00 41")]
    with raises(
        StageError, "not_as_configured", drive=1, name="path 15", register="0x6278", found="[65]", expected="[0]"
    ):
        stage(script).connect()


# --- homing and limits ---


def test_a_motor_that_runs_against_its_axis(stage: Make) -> None:
    """Limits change places, and positions their sign: 40 mm down is +16000 pulses."""
    d = homing(2, "00 00 00 00")[:9]
    limits = [
        written("02 10 60 06 00 02 04 00 00 3E 80"),
        ("02 03 60 06 00 02", "02 03 04 00 00 3E 80"),
        written("02 10 60 08 00 02 04 00 00 00 00"),
        ("02 03 60 08 00 02", "02 03 04 00 00 00 00"),
        written("02 10 60 00 00 01 02 00 02"),
        ("02 03 60 00 00 01", "02 03 02 00 02"),
    ]
    silent = ("01 10 60 0A 00 01 02 00 01", "")
    other = [written("02 06 60 02 00 40"), status(2, HOMED)]
    with raises(StageTimeout, "no_reply", axis="x"):
        stage([*BEFORE, *d, *limits, silent, STOP, *other], per_mm=-400.0).home()


# --- moves ---


MOVE_1_MM = [status(1, HOMED), stands(1), *started(1, "FF FF FE 70", "01 2C")]


@pytest.mark.parametrize("word", range(7))
def test_a_path_that_the_drive_has_otherwise_is_not_started(homed: Make, word: int) -> None:
    """One bit of one register."""
    words = ["00", "01", "FF", "FF", "FE", "70", "01", "2C", "01", "4D", "01", "4D", "00", "00"]
    words[2 * word + 1] = f"{int(words[2 * word + 1], 16) ^ 0x20:02X}"
    there = homed([*MOVE_1_MM[:3], (MOVE_1_MM[3][0], "01 03 0E " + " ".join(words))])
    with raises(StageError, "not_as_configured", axis="x", drive=1, name="path 0", register="0x6200"):
        there.move_to(x_mm=-1.0, speed_mm_s=5.0)
    assert not there.homed


# --- a lower limit ---


@pytest.mark.parametrize(
    ("lowest_mm", "per_mm", "register", "words"),
    [
        (-26.5, 400.0, "60 08", "FF FF D6 98"),
        (-26.5, -400.0, "60 06", "00 00 29 68"),
        (-26.5, 0.5, "60 08", "FF FF FF F3"),
        (-26.5, -0.5, "60 06", "00 00 00 0D"),
        (-99.0, 400.0, "60 08", "FF FF C1 80"),  # the end of the travel
        (1.0, 400.0, "60 08", "00 00 00 00"),
    ],
)
def test_a_lower_limit_is_set_at_rest_and_read_back(
    stage: Make, lowest_mm: float, per_mm: float, register: str, words: str
) -> None:
    there = stage(
        [status(2, HOMED), *set_and_read_back(2, register, words), ("02 03 60 00 00 01", "02 03 02 00 02")],
        per_mm=per_mm,
    )
    there._trusted = True
    there.limit_depth(lowest_mm)
    assert there.homed


LIMIT = [status(2, HOMED), *set_and_read_back(2, "60 08", "FF FF D6 98")]


@pytest.mark.parametrize(
    ("script", "code", "fields"),
    [
        ([status(2, "00 46")], "runs", {"axis": "z", "drive": 2}),
        ([status(2, AT_REST)], "was_reset", {"axis": "z"}),
        ([*LIMIT[:2], (LIMIT[2][0], "02 03 04 FF FF C1 80")], "not_as_configured", {"register": "0x6008"}),
        ([*LIMIT, ("02 03 60 00 00 01", "02 03 02 00 00")], "not_as_configured", {"register": "0x6000"}),
    ],
    ids=["runs", "not homed", "not taken", "off"],
)
def test_a_lower_limit_that_does_not_hold_is_an_error(
    homed: Make, script: list[Pair], code: str, fields: dict[str, Any]
) -> None:
    there = homed(script)
    with raises(StageError, code, **fields):
        there.limit_depth(-26.5)
    assert not there.homed


# --- the recording amplifier ---


def test_an_output_is_a_word_to_the_configured_register(homed: Make) -> None:
    sync = SyncSettings(output="drive", drive="x", register_address=0x0157, on_word=0x80, off_word=0)
    there = homed([echoed("01 06 01 57 00 80"), echoed("01 06 01 57 00 00")], sync=sync.model_dump())
    there.set_output(True)
    there.set_output(False)


# --- stopping ---


def test_stop_asks_every_drive_even_if_one_is_silent(homed: Make, clock: VirtualClock) -> None:
    there = homed(
        [
            ("00 06 60 02 00 40", ""),
            *[("02 06 60 02 00 40", "")] * 5,
            echoed("01 06 60 02 00 40"),
            status(1, AT_REST),
        ]
    )
    start_s = clock.monotonic_s()
    with raises(StageTimeout, "no_reply", axis="z", device=2, function="write"):
        there.stop()
    assert clock.monotonic_s() - start_s < 1.5
