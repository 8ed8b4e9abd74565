"""A virtual bench whose vertical motor can be plugged in the wrong way round, over a spring that can come up.

The controller notices nothing of a reversed plug: it counts steps upwards, and the carriage goes down, away from the
switch at the top.
"""

import io
from dataclasses import dataclass, replace
from typing import Any

from rig.bench.virtual import VirtualBench, bench_around
from rig.data.journal import NoJournal
from rig.devices.base import StageError
from rig.engine import Engine, verbs
from rig.engine.contact import ContactRecord
from rig.engine.sensing import ForceZero
from rig.errors import EngineError
from rig.plan.config import Config
from rig.units import GWT_N
from sim.carriage import Carriage, StepsAt, TruePose
from sim.devices.clock import VirtualClock
from tests.rig.hand_bench import Spring

APEX_MM = -12.0
"""A short way from the switches, below where a virtual stage begins."""
K_GWT = 6.0
TRIP_GWT = 16.0
FORCE: dict[str, dict[str, Any]] = {"leadshine": {"kind": "laumas", "baud": 115200}}


def height_mm(force_gwt: float) -> float:
    """Return the height at which the spring has this force."""
    return -((force_gwt / K_GWT) ** (2 / 3))


class MotorPlug:
    """Steps of a stage as its carriage makes them: after each turn of the plug those of z go the other way."""

    def __init__(self, steps_at: StepsAt) -> None:
        self._counted_at = steps_at
        self._turns: list[tuple[float, float, float]] = []  # s, counted and true z in steps

    def turn(self, t_s: float) -> None:
        self._turns.append((t_s, self._counted_at(t_s)[2], self.steps_at(t_s)[2]))

    def steps_at(self, t_s: float) -> tuple[float, float, float]:
        x, y, z = self._counted_at(t_s)
        turns = [turn for turn in self._turns if turn[0] <= t_s]
        if turns:
            _, counted, true = turns[-1]
            z = true + (-1) ** len(turns) * (z - counted)
        return x, y, z


class RisingSpring(Spring):
    """A finger that comes up by `by_mm` at `speed_mm_s`, from `from_s` on."""

    from_s, by_mm, speed_mm_s = 0.0, 0.0, 8.0

    def pose_at(self, t_s: float) -> TruePose:
        pose = super().pose_at(t_s)
        return replace(pose, doi_mm=pose.doi_mm + min(max(t_s - self.from_s, 0.0) * self.speed_mm_s, self.by_mm))


@dataclass(frozen=True)
class Homed:
    """How a homing ended: highest true force and the last one (gwt), code of the error, and duration (s)."""

    worst_gwt: float
    end_gwt: float
    code: str
    took_s: float


class PluggedBench:
    """A stage at a height over the spring, switched on again; zeroed: the force counts from a zero in the air."""

    def __init__(self, kind: str, above_mm: float, *, reversed_plug: bool, zeroed: bool) -> None:
        self.config = config = Config.model_validate(
            {
                "stage": {"kind": kind},
                "force": FORCE.get(kind, {}),
                "limits": {"soft_trip_n": TRIP_GWT * GWT_N},
                "frame": {"apex_z_mm": APEX_MM},
            }
        )
        self.clock = VirtualClock(1.7e9)
        self.bench: VirtualBench = bench_around(self._finger, config, self.clock, io.StringIO())
        stage = self.bench.stage
        stage.connect()
        self.bench.force.connect()
        stage.home()
        stage.move_to(x_mm=config.frame.pad_centre_x_mm, speed_mm_s=10)
        stage.move_to(z_mm=APEX_MM + above_mm, speed_mm_s=5)
        self._may_touch, self._zeroed = above_mm < config.habits.clearance_mm, zeroed
        self.switch_off_and_on()
        if reversed_plug:
            self.turn_plug()

    def _finger(self, carriage: Carriage) -> RisingSpring:
        self.plug = MotorPlug(carriage.steps_at)
        self.spring = RisingSpring(replace(carriage, steps_at=self.plug.steps_at), K_GWT)
        return self.spring

    def turn_plug(self) -> None:
        """Plug the motor of z in the other way round."""
        self.plug.turn(self.clock.monotonic_s())

    def switch_off_and_on(self) -> None:
        """Switch the controllers off and on; a new program connects."""
        board: Any = self.bench.board
        for device in [board] if hasattr(board, "power_cycle") else [board.x, board.z]:
            device.power_cycle()
        self.clock.wait_s(3.0)
        self.engine = Engine(self.config, self.bench, NoJournal())
        self.engine.contact = ContactRecord(may_touch=self._may_touch)
        if self._zeroed:
            self.engine.sensing.zero = ForceZero(0.0, 0.0)

    @property
    def force_gwt(self) -> float:
        """What the finger feels now."""
        return self.spring.true_gwt(self.clock.monotonic_s())

    def home(self) -> Homed:
        """Home, and look at the true force all the way."""
        begun_s, worst_gwt, code = self.clock.monotonic_s(), self.force_gwt, ""
        over = list[bool]()

        def look() -> None:
            nonlocal worst_gwt
            if not over:
                now_s = self.clock.monotonic_s()
                worst_gwt = max(worst_gwt, self.spring.true_gwt(now_s))
                self.clock.call_at(now_s + self.spring.next_look_s(now_s), look)

        look()
        try:
            verbs.home(self.engine)
        except (EngineError, StageError) as error:
            code = error.code
        over.append(True)
        return Homed(worst_gwt, self.force_gwt, code, self.clock.monotonic_s() - begun_s)
