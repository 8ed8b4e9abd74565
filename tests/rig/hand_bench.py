"""Manual control on a virtual clock: its session, and its process without the process and a person who asks of it.

Devices virtual, bytes real; the finger is a spring. The person is a generator that says how long until the next deed.
"""

import io
import json
import math
from collections.abc import Iterator
from typing import Any

from rig.bench.virtual import bench_around
from rig.devices.base import ForceReading, StageStatus
from rig.devices.registry import BUILT_IN
from rig.engine.bench_memory import BenchMemory
from rig.engine.contact import KnownContact
from rig.engine.motion import Direction, slices
from rig.engine.sensing import ForceZero
from rig.engine.steps import MOST_MM, StepEnd
from rig.errors import EngineError
from rig.manual.owner_process import ManualOwner
from rig.manual.session import ManualSession
from rig.plan.config import Config
from rig.transport.stop_gate import StopGate
from rig.units import GWT_N
from sim.carriage import Carriage, TruePose
from sim.devices.clock import VirtualClock
from tests.contracts.tables import stage_table

KINDS: dict[str, dict[str, Any]] = {
    "grbl": {"force": {"baud": 115200}},
    "leadshine": {"stage": {"kind": "leadshine"}, "force": {"kind": "laumas", "baud": 115200}},
}
STAGES = {kind: KINDS.get(kind, {"stage": {"kind": kind}}) for kind in BUILT_IN["stage"]}
"""Every stage, where a table has a row for each; most tests are made on the two of KINDS."""
APEX_MM = Config().frame.apex_z_mm
Person = Iterator[float]


class Spring:
    """A finger F = k d^1.5 below its skin, which lies skin_mm above the nominal apex, with a wall beside it.

    offset_gwt is what hangs on the sensor.
    """

    def __init__(self, carriage: Carriage, k_gwt: float, skin_mm: float = 0.0) -> None:
        self.carriage, self.k_gwt, self.skin_mm = carriage, k_gwt, skin_mm
        self.wall_x_mm, self.offset_gwt = math.inf, 0.0

    def mount(self, indentor: str) -> None:
        """It does not matter."""

    def pose_at(self, t_s: float) -> TruePose:
        pose = self.carriage.pose_at(t_s)
        return TruePose(pose.x_mm, pose.above_apex_mm, self.skin_at_mm(t_s) - pose.above_apex_mm)

    def true_gwt(self, t_s: float) -> float:
        pose = self.pose_at(t_s)
        wall_gwt = abs(self.k_gwt) * max(pose.x_mm - self.wall_x_mm, 0.0) ** 1.5
        return float(self.k_gwt * max(pose.doi_mm, 0.0) ** 1.5 + wall_gwt)

    def skin_at_mm(self, t_s: float) -> float:
        """How high above the nominal apex the skin is at a time."""
        return self.skin_mm

    def next_look_s(self, t_s: float) -> float:
        """When the truth is looked at again: later where nothing is met meanwhile, at up to 25 mm/s."""
        return 0.02 if self.pose_at(t_s).doi_mm < -0.5 else 0.002

    def force_n(self, t_s: float) -> float:
        return (self.true_gwt(t_s) + self.offset_gwt) * GWT_N


class BenchOverSpring:
    """A homed stage so far above a spring, left there by the last command, which may have zeroed and lifted, too.

    The true force is sampled every few milliseconds.
    """

    def __init__(
        self,
        kind: str,
        *,
        k_gwt: float = 6.0,
        skin_mm: float = 0.0,
        above_mm: float = 3.0,
        known: bool = True,
        zero: ForceZero | None = None,
        lifted: bool = False,
        sample_period_s: float = 0.05,
        spring: type[Spring] | None = None,
        **limits: Any,
    ) -> None:
        force = {**STAGES[kind].get("force", {}), "sample_period_s": sample_period_s}
        self.kind, self.config = kind, Config.model_validate({**STAGES[kind], "force": force, "limits": limits})
        self.clock, self.wire, self.gate = VirtualClock(1.7e9), io.StringIO(), StopGate()
        springs: list[Spring] = []

        def make(carriage: Carriage) -> Spring:
            springs.append((spring or Spring)(carriage, k_gwt, skin_mm))
            return springs[0]

        self.bench = bench_around(make, self.config, self.clock, self.wire, gate=self.gate)
        self.spring, self.memory, self.worst_gwt = springs[0], BenchMemory(self.config), 0.0
        self.bench.stage.connect()
        self.bench.stage.home()
        self.bench.stage.move_to(x_mm=self.config.frame.pad_centre_x_mm, speed_mm_s=10)
        if kind == "grbl":
            self.bench.stage.move_to(y_mm=self.config.frame.pad_y_mm, speed_mm_s=10)
        self.bench.stage.move_to(z_mm=APEX_MM + above_mm, speed_mm_s=10)
        if known:
            self.memory.left(self.bench.stage.status())
        if zero is not None:
            self.memory.record_zero(zero)
        if lifted:
            self.memory.touched(KnownContact("lifted", 0.0, 0.0, above_mm))

    def sample(self) -> None:
        """Sample the true force from now on."""
        now_s = self.clock.monotonic_s()
        self.worst_gwt = max(self.worst_gwt, self.spring.true_gwt(now_s))
        self.clock.call_at(now_s + self.spring.next_look_s(now_s), self.sample)

    @property
    def force_gwt(self) -> float:
        """The true force now."""
        return self.spring.true_gwt(self.clock.monotonic_s())

    @property
    def height_mm(self) -> float:
        return self.spring.carriage.pose_at(self.clock.monotonic_s()).above_apex_mm

    @property
    def x_mm(self) -> float:
        return self.spring.pose_at(self.clock.monotonic_s()).x_mm

    def sent(self, port: str = "stage") -> list[tuple[float, bytes]]:
        """What went out, and when."""
        lines = [json.loads(line) for line in self.wire.getvalue().splitlines()]
        return [
            (line["t_s"], bytes.fromhex(line["hex"]))
            for line in lines
            if line.get("dir") == "tx" and line["port"] == port
        ]

    def moves_sent(self) -> list[float]:
        """When the stage was told to move."""
        return [t_s for t_s, data in self.sent() if is_move(self.kind, data)]


class SessionBench(BenchOverSpring):
    """A session of manual control, one order after another."""

    def __init__(self, kind: str, **options: Any) -> None:
        super().__init__(kind, **options)
        self.shown: list[tuple[StageStatus | None, ForceReading]] = []
        self.session = ManualSession(self.config, self.bench, self.memory.read(), self._show)
        self.begun = self.session.begun()
        self.begun.__enter__()
        self.sample()

    def _show(self, at: StageStatus | None, reading: ForceReading) -> None:
        self.shown.append((at, reading))

    def step(self, axis: Any, by_mm: float, speed_mm_s: float = 2.0) -> StepEnd:
        return self.session.step(Direction(axis, 1 if by_mm > 0 else -1), abs(by_mm), speed_mm_s)

    def steps(self, axis: Any, by_mm: float, speed_mm_s: float = 2.0) -> StepEnd:
        """Step so far, until a step ends early."""
        for part_mm in slices(abs(by_mm), MOST_MM):
            found = self.step(axis, math.copysign(part_mm, by_mm), speed_mm_s)
            if found.ended_by is not None:
                break
        return found


def code_of_end(found: StepEnd) -> str | None:
    """The code of what ended a step early."""
    return None if found.ended_by is None else found.ended_by.code


class HandBench(BenchOverSpring):
    """The process at the bench without its process, and a person who asks of it."""

    def __init__(self, kind: str, **options: Any) -> None:
        super().__init__(kind, **options)
        self.owner = ManualOwner(self.config, self.bench, self.gate, self.wire, self.memory.read())
        self.refused: list[str] = []

    def __call__(self, do: str, **more: Any) -> dict[str, Any]:
        """Asked as over the socket. Raises what is a refusal there."""
        answer = self.owner.answers[do](json.loads(json.dumps({"do": do, **more})))
        return dict(json.loads(json.dumps(dict(answer), allow_nan=False)))

    def run(self, person: Person) -> dict[str, Any]:
        """Until the person has nothing more to do and leaves; how it was then."""
        end: list[dict[str, Any]] = []

        def act() -> None:
            wait_s = next(person, None)
            if wait_s is None:
                end.append(self("status"))
                self("leave")
            else:
                self.clock.call_at(self.clock.monotonic_s() + wait_s, act)

        with self.owner.begun():
            act()
            self.sample()
            self.owner.run()
        return end[0]

    # what a person does

    def step(self, axis: str, by_mm: float, tab: str = "one") -> Person:
        """A step asked for, or refused, and over."""
        yield from self.do("step", axis=axis, sign=1 if by_mm > 0 else -1, by_mm=abs(by_mm), tab=tab)

    def refusal(self, do: str, **more: Any) -> str:
        """What is said of what is refused."""
        if do == "step":
            more = {"axis": "x", "sign": -1, "by_mm": 1.0, "tab": "one", **more}
        try:
            return f"taken: {self(do, **more)}"
        except EngineError as error:
            return str(error)

    def do(self, do: str, **more: Any) -> Person:
        """Asked for, and over."""
        try:
            self(do, **more)
        except EngineError as error:
            self.refused.append(str(error))
        yield from self.done()

    def done(self) -> Person:
        """Until nothing is done any more."""
        yield 0.02
        while self("status")["busy"] is not None:
            yield 0.02


def is_stop(kind: str, data: bytes) -> bool:
    """Whether the first frame that was written is the first one of a stop."""
    device = stage_table(kind)
    port = next(iter(device.ports.values()), b"")
    return port + device.heard(device.frames(data)[0]) == device.stop[0]


def is_move(kind: str, data: bytes) -> bool:
    """A jog, a homing or a move; of a drive: the trigger of a path or of homing, or its own jog."""
    if kind == "grbl":
        return data.startswith((b"$J", b"$H", b"G1"))
    return data[1:6] in (
        bytes.fromhex("06 60 02 00 10"), bytes.fromhex("06 60 02 00 20"),
        bytes.fromhex("06 18 01 40 01"), bytes.fromhex("06 18 01 40 02"),
    )  # fmt: skip
