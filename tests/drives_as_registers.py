"""A Leadshine stage on drives that are registers without frames, at a late hour of the clock."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Any

from rig.devices.counted_axis import AxisSpec
from rig.devices.leadshine import LeadshineStage
from rig.devices.leadshine_drive import LeadshineDrive, number, words
from rig.devices.registry import KnownBench
from rig.settings import DriveSettings
from sim.devices.clock import VirtualClock

X, Z = 1, 2
STATUS, COMMANDED, FEEDBACK, CONTROL, TRIGGER, PR0 = 0x1003, 0x602C, 0x1014, 0x1801, 0x6002, 0x6200
RUN_PR0, HOME = 0x10, 0x20
HOMED, RUNNING, ALARM, DISABLED = 0x72, 0x46, 0x01, 0x30


class Bus:
    """Drives that answer at once, or after takes_s; what is written stays, and PR0 is at its end at once.

    One that is told to home shows once that it runs, and is at 0.
    """

    name = "bus"

    def __init__(self, clock: VirtualClock) -> None:
        self.clock, self.takes_s, self.closed = clock, 0.0, 0
        self.registers: dict[tuple[int, int], int] = defaultdict(int)
        self.status: Callable[[int, float], int] = lambda device, t_s: HOMED
        self.asked: list[tuple[float, int, int]] = []
        self.told: list[tuple[float, int, int, list[int]]] = []
        self.trouble: Exception | None = None
        self._homes: set[int] = set()

    def stands(self, device: int, pulses: int) -> None:
        for register in (COMMANDED, FEEDBACK):
            self.registers[device, register], self.registers[device, register + 1] = words(pulses)

    def read(self, device: int, register: int, count: int = 1) -> list[int]:
        self.clock.wait_s(self.takes_s)
        now_s = self.clock.monotonic_s()
        self.asked.append((now_s, device, register))
        if register == STATUS and device in self._homes:
            self._homes.remove(device)
            return [RUNNING]
        if register == STATUS:
            return [self.status(device, now_s)]
        return [self.registers[device, register + k] for k in range(count)]

    def write(self, device: int, register: int, values: Sequence[int]) -> None:
        self.clock.wait_s(self.takes_s)
        self.told.append((self.clock.monotonic_s(), device, register, list(values)))
        if self.trouble is not None:
            raise self.trouble
        self.registers |= {(device, register + k): value for k, value in enumerate(values)}
        if (register, list(values)) == (TRIGGER, [RUN_PR0]):
            self.stands(device, number([self.registers[device, PR0 + k] for k in (1, 2)]))
        if (register, list(values)) == (TRIGGER, [HOME]):
            self._homes.add(device)
            self.stands(device, 0)

    def write_one(self, device: int, register: int, value: int) -> None:
        self.write(device, register, [value])

    def send_now(self, devices: Sequence[int], register: int, value: int) -> None:
        self.told += [(self.clock.monotonic_s(), device, register, [value]) for device in devices]

    def close(self) -> None:
        self.closed += 1

    def paths(self) -> list[tuple[int, int]]:
        """Device and target (pulses) of every path; those that are made null are none."""
        paths = [(device, said) for _, device, register, said in self.told if register == PR0]
        return [(device, number(said[1:3])) for device, said in paths if len(said) > 1]


def homed_stage(
    clock: VirtualClock, *, per_mm: float = 400.0, drive: dict[str, Any] | None = None, **options: Any
) -> tuple[Bus, LeadshineStage]:
    """A homed stage on one bus, a thousand seconds after the clock began; `drive`: settings of both drives."""
    bus: Any = Bus(clock)
    clock.wait_s(1000.0)
    drives = []
    for device, axis in ((X, "x"), (Z, "z")):
        settings = DriveSettings(device_id=device, **(drive or {}))
        bus.registers[device, 1] = settings.pulses_per_rev
        drives.append(LeadshineDrive(bus, clock, AxisSpec(axis, per_mm, 60.0), settings))
    stage = LeadshineStage(*drives, KnownBench.model_validate({"stage": {"kind": "leadshine"}, **options}))
    stage.connect()
    stage.home()
    bus.asked.clear()
    bus.told.clear()
    return bus, stage
