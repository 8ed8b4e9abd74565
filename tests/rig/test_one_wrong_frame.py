"""One fault in one frame of a drive's motion: it goes nowhere else, and the driver arrives or raises.

A seeded sample; `python -m tests.faults.drive_frames` runs every case.
"""

import logging
import random
from collections.abc import Callable, Iterator

import pytest

from rig.devices.base import StageError
from rig.devices.leadshine import LeadshineStage
from rig.devices.leadshine_drive import LeadshineDrive
from rig.settings import Framing
from sim.devices import VirtualDrive
from tests.faults.drive_frames import MOTIONS, DriveBench, FrameFault, faults, wrong

SAMPLE: dict[Framing, int] = {"tcp": 24, "rtu": 6}
SHARES = {"a third": 3, "all": 1}


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    """pymodbus tells of every frame that it cannot read."""
    logging.disable()
    yield
    logging.disable(logging.NOTSET)


@pytest.mark.quick(rows=lambda motion, framing, share: share == "a third")
@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("framing", SAMPLE)
@pytest.mark.parametrize("motion", MOTIONS)
def test_a_drive_goes_nowhere_but_its_target_after_one_faulty_frame(
    motion: str, framing: Framing, share: str
) -> None:
    assert wrong(motion, framing, None) == ""
    sample = random.Random(f"{motion} {framing}").sample(
        list(faults(motion, framing)), SAMPLE[framing] // SHARES[share]
    )
    assert {fault: said for fault in sample if (said := wrong(motion, framing, fault))} == {}


def _out_frame(motion: str, part: str) -> int:
    """The number of the first frame out, over TCP, that has these bytes (hex) after its transaction."""
    bench = DriveBench("tcp")
    bench.wire.frames = {True: [], False: []}
    MOTIONS[motion].do(bench)
    return next(n for n, frame in enumerate(bench.wire.frames[True]) if bytes.fromhex(part) in frame)


def test_no_wrong_bit_in_a_trigger_frame_starts_another_path() -> None:
    """0011, 0012, 0014 and 0018 would run what the owner's EEPROM holds; another unit, the other drive's path."""
    number = _out_frame("press", "06 60 02 00 10")
    cases = [FrameFault(True, number, "bit", byte, bit) for byte in range(12) for bit in range(8)]
    assert {fault: said for fault in cases if (said := wrong("press", "tcp", fault))} == {}


# What must not lie in a drive while nothing moves: a path to somewhere else.


def _modes(drive: VirtualDrive) -> list[int]:
    return [drive.read(0x6200 + 8 * number, 1)[0] for number in range(16)]


def test_a_halt_clears_the_path_that_it_ended() -> None:
    bench = DriveBench("tcp")
    next(bench.stage.moving(z_mm=-6.0, speed_mm_s=1.0))
    assert _modes(bench.z)[0] == 1
    bench.stage.halt()
    assert (bench.stage.homed, _modes(bench.z)) == (True, [0] * 16)


def test_homing_clears_the_stored_paths_of_a_drive_that_was_switched_off() -> None:
    bench = DriveBench("tcp")
    for drive in (bench.x, bench.z):
        drive.power_cycle()
        assert all(_modes(drive))
    bench.stage.home()
    assert _modes(bench.x) == _modes(bench.z) == [0] * 16


@pytest.mark.parametrize(
    "move",
    [
        lambda stage: stage.jog("z", 0.1, 1.0),
        lambda stage: stage.home(),
    ],
    ids=["jog", "home"],
)
def test_a_path_written_to_the_wrong_drive_is_cleared_before_any_motion(
    move: Callable[[LeadshineStage], None],
) -> None:
    bench = DriveBench("tcp")
    bench.wire.frames = {True: [], False: []}
    bench.wire.fault = FrameFault(True, _out_frame("press", "10 62 00 00 07"), "bit", 6, 0)
    with pytest.raises(StageError):
        MOTIONS["press"].do(bench)
    assert bench.x.read(0x6200, 3) == [1, 0xFFFF, -2012 & 0xFFFF]
    bench.wire.fault = None
    move(bench.stage)
    assert _modes(bench.x) == [0] * 16


# What the drives do where one of the precautions is left out.


def test_without_reading_a_path_back_a_wrong_bit_would_press(monkeypatch: pytest.MonkeyPatch) -> None:
    number = _out_frame("press", "10 62 00 00 07")
    monkeypatch.setattr(LeadshineDrive, "compare", lambda *_: None)
    assert wrong("press", "tcp", FrameFault(True, number, "bit", 17, 4)).startswith("z -")


@pytest.mark.parametrize("bit", [0, 1, 2, 3])
def test_without_clearing_stored_paths_a_wrong_bit_would_run_one(monkeypatch: pytest.MonkeyPatch, bit: int) -> None:
    number = _out_frame("press", "06 60 02 00 10")
    monkeypatch.setattr(LeadshineDrive, "disarm", lambda drive: setattr(drive, "harmless", True))
    assert wrong("press", "tcp", FrameFault(True, number, "bit", 11, bit)).startswith("z -")
