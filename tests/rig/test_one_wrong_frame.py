"""One fault in one frame of a drive's motion: it goes nowhere else, and the driver arrives or raises.

A seeded sample; `python -m studies.faults.drive_frames` runs every case.
"""

import logging
import random
from collections.abc import Iterator

import pytest

from rig.devices.stage.leadshine.leadshine_drive import LeadshineDrive
from rig.transport.port_settings import Framing
from studies.faults.drive_frames import MOTIONS, Bench, Fault, faults, wrong

SAMPLE: dict[Framing, int] = {"tcp": 24, "rtu": 6}


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    """pymodbus tells of every frame that it cannot read."""
    logging.disable()
    yield
    logging.disable(logging.NOTSET)


@pytest.mark.parametrize("framing", SAMPLE)
@pytest.mark.parametrize("motion", MOTIONS)
def test_one_fault_in_one_frame_moves_nothing_elsewhere(motion: str, framing: Framing) -> None:
    assert wrong(motion, framing, None) == ""
    sample = random.Random(f"{motion} {framing}").sample(list(faults(motion, framing)), SAMPLE[framing])
    assert {fault: said for fault in sample if (said := wrong(motion, framing, fault))} == {}


def _out_frame(motion: str, part: str) -> int:
    """The number of the first frame out, over TCP, that has these bytes (hex) after its transaction."""
    bench = Bench("tcp")
    bench.wire.frames = {True: [], False: []}
    MOTIONS[motion].do(bench)
    return next(n for n, frame in enumerate(bench.wire.frames[True]) if bytes.fromhex(part) in frame)


def test_no_wrong_bit_of_a_trigger_moves_anything_elsewhere() -> None:
    """0011, 0012, 0014 and 0018 would run what the owner's EEPROM holds; another unit, the other drive's path."""
    number = _out_frame("press", "06 60 02 00 10")
    cases = [Fault(True, number, "bit", byte, bit) for byte in range(12) for bit in range(8)]
    assert {fault: said for fault in cases if (said := wrong("press", "tcp", fault))} == {}


# What the drives do where one of the precautions is left out.


def test_a_path_that_is_not_read_back_presses(monkeypatch: pytest.MonkeyPatch) -> None:
    number = _out_frame("press", "10 62 00 00 07")
    monkeypatch.setattr(LeadshineDrive, "_expect", lambda *_: None)
    assert wrong("press", "tcp", Fault(True, number, "bit", 17, 4)).startswith("z -")


@pytest.mark.parametrize("bit", [0, 1, 2, 3])
def test_a_path_of_the_owner_presses(monkeypatch: pytest.MonkeyPatch, bit: int) -> None:
    number = _out_frame("press", "06 60 02 00 10")
    monkeypatch.setattr(LeadshineDrive, "disarm", lambda drive: setattr(drive, "harmless", True))
    assert wrong("press", "tcp", Fault(True, number, "bit", 11, bit)).startswith("z -")
