"""One fault in one frame between the Leadshine driver and its drives, for every frame, byte and bit.

Each case takes one motion of two virtual drives and damages one of its frames, on the way out or back: a bit is
turned, a byte lost, doubled or swapped with the next, or the rest cut off. The drives are as bad as they can be
without a second fault: their EEPROMs hold paths that press and drag, and their ids are one bit apart.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby, pairwise

from rig.devices.base import Axis, StageError
from rig.devices.counted_axis import AxisSpec
from rig.devices.leadshine import LeadshineStage
from rig.devices.leadshine_drive import LeadshineDrive
from rig.devices.registry import KnownBench
from rig.settings import DriveSettings, Framing
from rig.transport import LoopbackTransport, TransportError
from rig.transport.modbus import ModbusMaster
from sim.devices import ModbusBus, SerialLine, VirtualDrive
from sim.devices.clock import VirtualClock

PER_MM = 400
X_ID, Z_ID = 3, 2
X_MM, Z_MM = -4.0, -5.0
INCREMENT_MM = 0.03
# What is not of the motion: a pulse, or what a drive creeps that was told to home instead of the other.
PULSE, CREPT = 1, 8
_AFTER_S, _SAMPLE_S = 3.0, 0.02  # nothing that goes wrong is over sooner
# Mode, position (two words), rpm, ramps, pause: fast paths down and sideways, of each type.
_PRESSES = [
    [0x41, 0xFFFF, 0xF060, 600, 10, 10, 0],
    [0x01, 0xFFFF, 0xC568, 600, 10, 10, 0],
    [2, 0, 0, 0xFF00, 9, 9, 0],
]


def _owners_paths() -> dict[int, int]:
    """PR0 to PR15 as an EEPROM could hold them, by register."""
    paths = ((0x6200 + 8 * number, _PRESSES[number % 3]) for number in range(16))
    return {first + k: word for first, path in paths for k, word in enumerate(path)}


def _settings(device_id: int) -> DriveSettings:
    return DriveSettings(device_id=device_id, homing_high_rpm=600, homing_low_rpm=100, homing_ramp_ms=50)


@dataclass(frozen=True)
class FrameFault:
    """What happens to one frame: out or back, the how-maniest of its direction, and which damage to which byte."""

    out: bool
    frame: int
    kind: str
    byte: int
    bit: int = 0

    def damage(self, data: bytes) -> bytes:
        """The frame as it arrives."""
        k = self.byte
        match self.kind:
            case "bit":
                return data[:k] + bytes([data[k] ^ 1 << self.bit]) + data[k + 1 :]
            case "lost":
                return data[:k] + data[k + 1 :]
            case "doubled":
                return data[: k + 1] + data[k:]
            case "swapped":
                return data[:k] + data[k + 1 : k + 2] + data[k : k + 1] + data[k + 2 :]
            case "cut":
                return data[:k]
        raise ValueError(self.kind)


class _Wire:
    """A transport that damages one frame, and keeps every frame that went over it meanwhile."""

    def __init__(self, line: SerialLine, clock: VirtualClock) -> None:
        self._inner = LoopbackTransport(line, clock, "wire")
        self.name, self.close = self._inner.name, self._inner.close
        self.fault: FrameFault | None = None
        self.frames: dict[bool, list[bytes]] | None = None  # by whether they went out; None: not yet of interest

    def write(self, data: bytes) -> None:
        self._inner.write(self._passed(data, out=True))

    def read(self, timeout_s: float) -> bytes:
        data = self._inner.read(timeout_s)
        return self._passed(data, out=False) if data else data

    def _passed(self, data: bytes, *, out: bool) -> bytes:
        if self.frames is None:
            return data
        frames, fault = self.frames[out], self.fault
        frames.append(data)
        hit = fault is not None and (fault.out, fault.frame) == (out, len(frames) - 1)
        return fault.damage(data) if fault is not None and hit else data


class DriveBench:
    """Two homed drives with the driver over them, z deep and x beside its home switch, ready for one motion."""

    def __init__(self, framing: Framing) -> None:
        self.clock = VirtualClock()
        line = SerialLine(self.clock, 115200)
        self.x, self.z = (VirtualDrive(self.clock, start=0, stored=_owners_paths()) for _ in range(2))
        ModbusBus(self.clock, line, {X_ID: self.x, Z_ID: self.z}, framing=framing)
        self.wire = _Wire(line, self.clock)
        bus = ModbusMaster(self.wire, self.clock, framing=framing)
        x, z = (
            LeadshineDrive(bus, self.clock, AxisSpec(axis, PER_MM, 60.0), settings)
            for axis, settings in (("x", _settings(X_ID)), ("z", _settings(Z_ID)))
        )
        self.stage = LeadshineStage(x, z, KnownBench.model_validate({"stage": {"kind": "leadshine"}}))
        for drive in (self.x, self.z):
            drive.write(0x6002, [0x21])  # homed, at its switch
        self.stage.connect()
        for one in (x, z):
            one.finish_homing()
        self.stage._trusted = True
        self.stage.move_to(x_mm=X_MM, speed_mm_s=100.0)
        self.stage.move_to(z_mm=Z_MM, speed_mm_s=100.0)
        self.at_rest_x, self.at_rest_z = self.pulses(self.clock.monotonic_s())

    def pulses(self, t_s: float) -> tuple[int, int]:
        """Where the carriage really is, x and z."""
        return self.x.carriage_at(t_s), self.z.carriage_at(t_s)


def _jogged(bench: DriveBench, axis: Axis, by_mm: float) -> None:
    """Two slices, each from rest."""
    for _ in range(2):
        bench.stage.jog(axis, by_mm / 2, 1.0)
        bench.clock.wait_s(0.5)
    bench.stage.end_jog()


def _halted(bench: DriveBench) -> None:
    """A press that is given up on its way, and the lift after it."""
    looks = bench.stage.moving(z_mm=Z_MM - 0.5, speed_mm_s=1.0)
    next(looks)
    bench.stage.halt()
    bench.stage.move_to(z_mm=Z_MM + 2.0, speed_mm_s=5.0)


@dataclass(frozen=True)
class WatchedMotion:
    """One motion, and how far from the start each axis may go and where it must end, mm; None: not to be known."""

    do: Callable[[DriveBench], None]
    x_mm: tuple[float, float] = (0.0, 0.0)
    z_mm: tuple[float, float] = (0.0, 0.0)
    ends_mm: tuple[float, float] | None = (0.0, 0.0)
    lifts_first: bool = False


MOTIONS = {
    "press": WatchedMotion(
        lambda b: b.stage.move_to(z_mm=Z_MM - INCREMENT_MM, speed_mm_s=0.5),
        z_mm=(-INCREMENT_MM, 0.0),
        ends_mm=(0.0, -INCREMENT_MM),
    ),
    "lift": WatchedMotion(lambda b: b.stage.move_to(z_mm=-3.0, speed_mm_s=5.0), z_mm=(0.0, 5.0), ends_mm=(0.0, 2.0)),
    "sideways": WatchedMotion(
        lambda b: b.stage.move_to(x_mm=-2.0, speed_mm_s=5.0), x_mm=(0.0, 4.0), ends_mm=(2.0, 0.0)
    ),
    "home": WatchedMotion(
        lambda b: b.stage.home(), x_mm=(-1.0, 4.02), z_mm=(0.0, 5.02), ends_mm=(4.0, 5.0), lifts_first=True
    ),
    "jog down": WatchedMotion(lambda b: _jogged(b, "z", -0.1), z_mm=(-0.1, 0.0), ends_mm=(0.0, -0.1)),
    "jog up": WatchedMotion(lambda b: _jogged(b, "z", 0.1), z_mm=(0.0, 0.1), ends_mm=(0.0, 0.1)),
    "limit": WatchedMotion(lambda b: b.stage.limit_depth(Z_MM - 1.0)),
    "halt and lift": WatchedMotion(lambda b: _halted(b), z_mm=(-0.5, 5.0), ends_mm=(0.0, 2.0)),
}


def faults(motion: str, framing: Framing) -> Iterator[FrameFault]:
    """Every fault of every distinct frame of a motion; of frames that come again the first and the last."""
    bench = DriveBench(framing)
    bench.wire.frames = {True: [], False: []}
    MOTIONS[motion].do(bench)
    for out, frames in bench.wire.frames.items():
        counted = 2 if framing == "tcp" else 0
        same = sorted(range(len(frames)), key=lambda n: (frames[n][counted:], n))
        for _, again in groupby(same, key=lambda n: frames[n][counted:]):
            numbers = list(again)
            for number in sorted({numbers[0], numbers[-1]}):
                yield from _of_frame(out, number, frames[number])


def _of_frame(out: bool, number: int, data: bytes) -> Iterator[FrameFault]:
    for byte in range(len(data)):
        for bit in range(8):
            yield FrameFault(out, number, "bit", byte, bit)
        for kind in ("lost", "doubled", "cut"):
            yield FrameFault(out, number, kind, byte)
    for byte, (one, other) in enumerate(pairwise(data)):
        if one != other:
            yield FrameFault(out, number, "swapped", byte)


def wrong(motion: str, framing: Framing, fault: FrameFault | None) -> str:
    """What went wrong with the carriage, or nothing."""
    bench, what = DriveBench(framing), MOTIONS[motion]
    begun_s = bench.clock.monotonic_s()
    bench.wire.fault, bench.wire.frames = fault, {True: [], False: []}
    raised = ""
    try:
        what.do(bench)
    except (StageError, TransportError) as error:
        raised = type(error).__name__
        with suppress(StageError, TransportError):
            bench.stage.stop()
    over_s = bench.clock.monotonic_s()
    bench.clock.wait_s(_AFTER_S)
    x_mm, z_mm = what.x_mm, what.z_mm
    lowest, highest = (PER_MM * mm for mm in z_mm)
    left, right = (PER_MM * mm for mm in x_mm)
    for n in range(int((bench.clock.monotonic_s() - begun_s) / _SAMPLE_S)):
        x, z = bench.pulses(begun_s + n * _SAMPLE_S)
        x, z = x - bench.at_rest_x, z - bench.at_rest_z
        if not lowest - PULSE <= z <= highest + PULSE:
            return f"z {z / PER_MM:+.3f} mm from its start, {raised or 'no error'}"
        lifting = what.lifts_first and bench.at_rest_z + z < -PER_MM
        if abs(x) > CREPT if lifting else not left - PULSE <= x <= right + PULSE:
            return f"x {x / PER_MM:+.3f} mm from its start, {raised or 'no error'}"
    if not raised and what.ends_mm is not None:
        x, z = bench.pulses(over_s)
        there = (x - bench.at_rest_x) / PER_MM, (z - bench.at_rest_z) / PER_MM
        if any(abs(is_mm - ends_mm) > 1.5 / PER_MM for is_mm, ends_mm in zip(there, what.ends_mm, strict=True)):
            return f"ended at {there} mm from its start without an error"
    return ""
