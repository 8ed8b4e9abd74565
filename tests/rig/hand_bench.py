"""The process at the bench without its process: its one thread on a virtual clock, and a person who asks of it.

Devices virtual, bytes real; the finger is a spring. The person is a generator that says how long until the next deed.
"""

import io
import json
import math
from collections.abc import Callable, Iterator
from typing import Any

from rig.bench.virtual import bench_around
from rig.engine.bench_memory import BenchMemory
from rig.engine.contact import KnownContact
from rig.engine.sensing import ForceZero
from rig.errors import EngineError
from rig.manual.owner_process import ManualOwner
from rig.plan.config import Config
from rig.transport.stop_gate import StopGate
from rig.units import GWT_N
from sim.carriage import Carriage, TruePose
from sim.devices.clock import VirtualClock

KINDS: dict[str, dict[str, Any]] = {
    "grbl": {"force": {"baud": 115200}},
    "leadshine": {"stage": {"kind": "leadshine"}, "force": {"kind": "laumas", "baud": 115200}},
}
STAGES: dict[str, dict[str, Any]] = {
    **KINDS,
    **{kind: {"stage": {"kind": kind}} for kind in ("zaber", "standa", "tmcl")},
}
"""Every stage, where a table has a row for each; most tests are made on the two of KINDS."""
APEX_MM = Config().frame.apex_z_mm
STOPS = {
    "grbl": b"!\x18",
    "leadshine": bytes.fromhex("00 06 60 02 00 40"),
    "zaber": b"/0 0 ",
    "standa": b"stop",
    "tmcl": b"\1\3\0\1",
}
"""A feed hold and a reset; to all drives: the control word, quick stop; to the whole chain, by an id: stop; stop; to
the motor of z: stop."""
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


class HandBench:
    """A homed stage so far above a spring, left there by the last command, which may have zeroed and lifted, too."""

    def __init__(
        self,
        kind: str,
        *,
        k_gwt: float = 6.0,
        above_mm: float = 3.0,
        known: bool = True,
        zero: ForceZero | None = None,
        lifted: bool = False,
        sample_period_s: float = 0.05,
        spring: type["Spring"] | None = None,
        **limits: Any,
    ) -> None:
        force = {**STAGES[kind].get("force", {}), "sample_period_s": sample_period_s}
        self.kind, self.config = kind, Config.model_validate({**STAGES[kind], "force": force, "limits": limits})
        self.clock, self.wire, self.gate = VirtualClock(1.7e9), io.StringIO(), StopGate()
        springs: list[Spring] = []

        def make(carriage: Carriage) -> Spring:
            springs.append((spring or Spring)(carriage, k_gwt))
            return springs[0]

        self.bench = bench_around(make, self.config, self.clock, self.wire, gate=self.gate)
        self.spring, self.memory = springs[0], BenchMemory(self.config)
        self.bench.stage.connect()
        self.bench.stage.home()
        self.bench.stage.move_to(x_mm=self.config.frame.pad_centre_x_mm, speed_mm_s=10)
        self.bench.stage.move_to(z_mm=APEX_MM + above_mm, speed_mm_s=10)
        if known:
            self.memory.left(self.bench.stage.status())
        if zero is not None:
            self.memory.record_zero(zero)
        if lifted:
            self.memory.touched(KnownContact("lifted", 0.0, 0.0, above_mm))
        self.owner = ManualOwner(self.config, self.bench, self.gate, self.wire, self.memory.read())
        self.presses, self.worst_gwt = 0, 0.0
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

        def sample() -> None:
            now_s = self.clock.monotonic_s()
            self.worst_gwt = max(self.worst_gwt, self.spring.true_gwt(now_s))
            if not end:
                self.clock.call_at(now_s + self.spring.next_look_s(now_s), sample)

        with self.owner.begun():
            act()
            sample()
            self.owner.run()
        return end[0]

    # what a person does

    def hold(self, axis: str, sign: int, for_s: float = 1.0, speed_mm_s: float = 2.0, tab: str = "one") -> Person:
        """A button held down and let go, or until it is refused; then until nothing is done any more."""
        self.presses += 1
        press = {"axis": axis, "sign": sign, "speed_mm_s": speed_mm_s, "tab": tab, "press": self.presses}
        until_s = self.clock.monotonic_s() + for_s
        while self.clock.monotonic_s() < until_s:
            try:
                self("hold", **press, unix_s=self.clock.unix_s())
            except EngineError as error:
                self.refused.append(str(error))
                break
            yield 0.1
        self("release", tab=tab, press=self.presses)
        yield from self.done()

    def refusal(self, do: str, **more: Any) -> str:
        """What is said of what is refused; a hold is one of a new press."""
        if do == "hold":
            press = {"axis": "x", "sign": -1, "speed_mm_s": 2.0, "tab": "one", "press": 99}
            more = {**press, "unix_s": self.clock.unix_s(), **more}
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

    # what is seen from outside

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


def is_move(kind: str, data: bytes) -> bool:
    """A jog, a homing or a move; of a drive: the trigger of a path or of homing, or its own jog."""
    if kind == "grbl":
        return data.startswith((b"$J", b"$H", b"G1"))
    return data[1:6] in (
        bytes.fromhex("06 60 02 00 10"), bytes.fromhex("06 60 02 00 20"),
        bytes.fromhex("06 18 01 40 01"), bytes.fromhex("06 18 01 40 02"),
    )  # fmt: skip


Promise = Callable[[HandBench], None]
