"""A motor that stands or slips while its position counts on, a stage that goes elsewhere: pressed, dragged, reported.

The finger, the bytes and the devices are those of `studies.faults`; the force sensor is good.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from rig.devices.base import StageError
from rig.engine import EngineError, indent, verbs
from rig.session.early_ending import FinalPosition
from rig.units import GWT_N
from studies.faults.faulty_bench import PREDICTED, SOFT_TRIP_N, TARGET, FaultyBench, bound_gwt
from tests.faults.catalogue import COARSE_SCREW, GRBL, MODBUS, SCREW

NEAR = {"frame": {"pad_centre_x_mm": -12.0, "apex_z_mm": -12.0}}
"""A short way from the switches, below where a virtual stage begins."""
STAGES: dict[str, dict[str, Any]] = {"grbl": {**GRBL, **NEAR}, "modbus": {**MODBUS, **NEAR}}
TOUCH_GWT = 0.05


class Slipping(FaultyBench):
    """A carriage that follows its screw by a share only, from some height on; it keeps what was dragged sideways."""

    def __init__(self, folder: Path, tables: Mapping[str, Any]) -> None:
        self.slips_from_mm: float | None = None
        self.follows = 1.0
        self.dragged_gwt, self.x_mm = 0.0, 0.0
        super().__init__(folder, tables)

    def reached_mm(self, height_mm: float) -> float:
        if self.slips_from_mm is None:
            return height_mm
        return self.slips_from_mm + self.follows * (height_mm - self.slips_from_mm)

    def true_n(self, t_s: float) -> float:
        pose = self.carriage.pose_at(t_s)
        force_n = PREDICTED.force_at(self.reached_mm(pose.above_apex_mm))
        if abs(pose.x_mm - self.x_mm) > 1e-3:
            self.dragged_gwt = max(self.dragged_gwt, force_n / GWT_N)
        self.x_mm = pose.x_mm
        return force_n

    def slip(self, share: float) -> None:
        self.slips_from_mm, self.follows = self.height_mm, 1 - share


@dataclass(frozen=True)
class Ended:
    """How two presses at two places ended."""

    bench: Slipping
    reason: str

    @property
    def true_gwt(self) -> float:
        return self.bench.true_n(self.bench.clock.monotonic_s()) / GWT_N


def _pressed_twice(folder: Path, tables: Mapping[str, Any], strike: Callable[[Slipping], None]) -> Ended:
    bench = Slipping(folder, {**tables, "limits": {"soft_trip_n": SOFT_TRIP_N}})
    engine, reason = bench.engine, ""
    strike(bench)
    try:
        verbs.mount(engine, "bar:3.0")
        verbs.home(engine)
        verbs.zero(engine)
        for x_mm in (0.0, 1.0):
            verbs.move_to(engine, x_mm)
            indent(engine, TARGET, hold_s=0.5, expected_contact_mm=PREDICTED.contact_mm)
    except (EngineError, StageError) as error:
        reason = str(error)
    bench.journal.close()
    bench.clock.wait_s(1.0)
    return Ended(bench, reason)


@pytest.mark.quick(rows=lambda stage, share: stage == "grbl" or share == 1.0)
@pytest.mark.parametrize("share", [1.0, 0.9, 0.8], ids=["stalls", "slips by 90 %", "slips by 80 %"])
@pytest.mark.parametrize("stage", STAGES)
def test_a_stalled_lift_is_detected_by_force_before_any_move_sideways(
    tmp_path: Path, stage: str, share: float
) -> None:
    """The position says clearance; the force says what it is."""
    ended = _pressed_twice(tmp_path, STAGES[stage], lambda b: b.after("hold_end", lambda: b.slip(share)))
    bench = ended.bench
    assert ended.reason.startswith("not lifted")
    assert bench.dragged_gwt == 0.0
    assert bench.worst_n / GWT_N <= bound_gwt()
    known, at = bench.engine.known_contact, FinalPosition.of(bench.engine)
    if ended.true_gwt >= TOUCH_GWT:
        assert known.kind == "disagreement"
        assert known.force_gwt == pytest.approx(ended.true_gwt, abs=0.02)
        assert (at.left, at.may_touch) == ("raised", True)
        assert f"{known.force_gwt:.2f} gwt" in at.words
    else:
        assert (known.kind, at.left) == ("lifted", "lifted"), "it came free on the way to where a trip lifts to"


@pytest.mark.quick(rows=lambda stage, share, phase: stage == "grbl" or (share == 1.0 and phase != "touch"))
@pytest.mark.parametrize("phase", ["approach", "touch", "press", "hold"])
@pytest.mark.parametrize("share", [1.0, 0.5], ids=["stalls", "slips"])
@pytest.mark.parametrize("stage", STAGES)
def test_a_slipping_motor_never_presses_beyond_the_force_bound(
    tmp_path: Path, stage: str, share: float, phase: str
) -> None:
    ended = _pressed_twice(tmp_path, STAGES[stage], lambda b: b.after(phase, lambda: b.slip(share)))
    bench = ended.bench
    assert bench.worst_n / GWT_N <= bound_gwt()
    assert bench.dragged_gwt < TOUCH_GWT
    assert bench.engine.known_contact.may_touch or ended.true_gwt < TOUCH_GWT


BACKLASH = {"virtual": {"z_screw_backlash_mm": 0.2}}


@pytest.mark.quick(rows=lambda stage, screw: stage == "grbl" or screw is COARSE_SCREW)
@pytest.mark.parametrize("screw", [SCREW, COARSE_SCREW, BACKLASH], ids=["finer", "coarser", "backlash"])
@pytest.mark.parametrize("stage", STAGES)
def test_a_wrong_screw_pitch_never_presses_beyond_the_force_bound(
    tmp_path: Path, stage: str, screw: Mapping[str, Any]
) -> None:
    ended = _pressed_twice(tmp_path, {**STAGES[stage], **screw}, lambda b: None)
    assert ended.bench.worst_n / GWT_N <= bound_gwt()
    assert ended.bench.dragged_gwt < TOUCH_GWT
    assert ended.bench.engine.known_contact.may_touch or ended.true_gwt < TOUCH_GWT


def _corrupt_grbl(bench: Slipping, by_mm: float) -> None:
    """The next move of Z goes so much lower than commanded, and the board's confirmation is changed to hide it."""
    write, read, struck = bench.stage_wire.write, bench.stage_wire.read, list[bytes]()

    def corrupted(data: bytes) -> None:
        placed = re.fullmatch(rb"(G92X0Y0Z)([-\d.]+)(G90.*\n)", data)
        if placed and not struck and float(placed[2]):
            data = placed[1] + f"{float(placed[2]) + by_mm:.4f}".encode() + placed[3]
            struck.append(data)
        elif struck and data.startswith(b"G1"):
            bench.stage_wire.read = read  # type: ignore[method-assign]
        write(data)

    def hidden(timeout_s: float) -> bytes:
        shown = re.search(rb"(WCO:[-\d.]+,[-\d.]+,)([-\d.]+)", data := read(timeout_s))
        if struck and shown:
            data = data.replace(shown[0], shown[1] + f"{float(shown[2]) + by_mm:.3f}".encode())
        return data

    bench.stage_wire.write = corrupted  # type: ignore[method-assign]
    bench.stage_wire.read = hidden  # type: ignore[method-assign]


def _corrupt_modbus(bench: Slipping, by_mm: float) -> None:
    drive = bench.stage._axes["z"]  # type: ignore[attr-defined]
    pulses, struck = drive.counts, list[bool]()

    def corrupted(mm: float) -> int:
        if struck:
            return int(pulses(mm))
        struck.append(True)
        return int(pulses(mm - by_mm))

    drive.counts = corrupted


CORRUPT = {"grbl": _corrupt_grbl, "modbus": _corrupt_modbus}


@pytest.mark.parametrize(("phase", "by_mm"), [("approach", 4.0), ("press", 3.0), ("hold_end", 4.0)])
@pytest.mark.parametrize("stage", STAGES)
def test_a_corrupted_motion_command_is_stopped_at_the_next_poll(
    tmp_path: Path, stage: str, phase: str, by_mm: float
) -> None:
    """Down, to above the floor that the controllers enforce.

    The second layer alone: the driver's confirmation of commands comes before it.
    """
    ended = _pressed_twice(tmp_path, STAGES[stage], lambda b: b.after(phase, lambda: CORRUPT[stage](b, by_mm)))
    bench = ended.bench
    assert bench.worst_n / GWT_N <= bound_gwt()
    assert ended.true_gwt == 0.0
    assert bench.dragged_gwt == 0.0
    assert ended.reason.startswith("commanded ")
    assert not bench.stage.homed, "it was stopped at once"
    assert FinalPosition.of(bench.engine).left == "held"


def test_one_garbled_status_report_does_not_end_a_run(tmp_path: Path) -> None:
    """A digit of the height in a report; the next one is right."""

    def strike(bench: Slipping) -> None:
        left = [1]

        def garbled(data: bytes) -> list[bytes]:
            if left and b"<Run" in data and b",-2" in data:
                left.clear()
                return [data.replace(b",-2", b",-6", 1)]
            return [data]

        bench.after("hold_end", lambda: bench.change(bench.stage_line, garbled))

    ended = _pressed_twice(tmp_path, GRBL, strike)
    assert ended.reason == ""
