"""A protocol rehearsed on a finger of springs: how long it will take, before anything moves.

The engine, the drivers, the bytes and the clock are those of a dry-run; only the finger is replaced, by one spring
for each press, fitted to two solutions of the finger model, since a spring costs next to nothing.
"""

import io
import math
from collections.abc import Callable
from dataclasses import dataclass

from rig.engine import Engine, Indentation, PressId
from rig.engine.journal import NoJournal
from rig.engine.touch import CONTACT_EXPONENT
from rig.plan.config import Config, VirtualSettings
from rig.plan.plan import CheckingRig
from rig.plan.planned import Plan, PlannedIndentation
from rig.protocol.script import Script
from rig.session.live import LiveRig
from rig.session.running import run_script
from rig.virtual.virtual_bench import bench_around
from sim.devices.clock import VirtualClock
from sim.models.fingertip import Fingertip
from sim.plant.plant import Carriage, TruePose


@dataclass(frozen=True)
class Spring:
    """force = at_target · (DOI / target)^exponent."""

    contact_mm: float
    doi_mm: float
    force_n: float
    exponent: float

    @classmethod
    def fitted(cls, planned: PlannedIndentation, finger: Fingertip) -> "Spring":
        """Through the model's force at the target and at half of its depth; Hertz's where there is none yet."""
        target = finger.indent(planned.indentor, planned.x_mm, doi_mm=planned.predicted_doi_mm)
        half = finger.indent(planned.indentor, planned.x_mm, doi_mm=0.5 * planned.predicted_doi_mm)
        exponent = math.log2(target.force_n / half.force_n) if half.force_n > 0 else CONTACT_EXPONENT
        return cls(planned.expected_contact_mm, planned.predicted_doi_mm, target.force_n, exponent)

    def force_at(self, height_mm: float) -> float:
        """N with the indentor's lowest point so far above the nominal apex."""
        return float(self.force_n * (max(self.contact_mm - height_mm, 0.0) / self.doi_mm) ** self.exponent)


class SpringPlant:
    """A finger of springs under a carriage; one is under the indentor, or none."""

    def __init__(self, carriage: Carriage) -> None:
        self._carriage = carriage
        self.spring: Spring | None = None

    def mount(self, indentor: str) -> None:
        """The springs know."""

    def pose_at(self, t_s: float) -> TruePose:
        """True x and DOI, mm."""
        pose = self._carriage.pose_at(t_s)
        contact_mm = -math.inf if self.spring is None else self.spring.contact_mm
        return TruePose(pose.x_mm, pose.above_apex_mm, contact_mm - pose.above_apex_mm)

    def force_n(self, t_s: float) -> float:
        """N at an instant."""
        return 0.0 if self.spring is None else self.spring.force_at(self._carriage.pose_at(t_s).above_apex_mm)


# A finger under a sphere, nearly: a touch is over before its stiffness matters.
_UNDER_A_TOUCH = {"doi_mm": 1.0, "force_n": 0.1, "exponent": 1.5}


class _RehearsedRig(LiveRig):
    """Puts the right spring under the indentor before each press."""

    def __init__(self, engine: Engine, check: CheckingRig, plant: SpringPlant, finger: Fingertip) -> None:
        super().__init__(engine, check)
        self._plant, self._finger = plant, finger
        self._springs: dict[PlannedIndentation, Spring] = {}

    def _touch(self, index: int, deed: Callable[[], float]) -> float:
        self._plant.spring = Spring(self._check.plan.touches[index], **_UNDER_A_TOUCH)
        return deed()

    def _press(self, press: PressId, planned: PlannedIndentation, speed_mm_s: float | None = None) -> Indentation:
        if planned not in self._springs:
            self._springs[planned] = Spring.fitted(planned, self._finger)
        self._plant.spring = self._springs[planned]
        return super()._press(press, planned, speed_mm_s)


@dataclass(frozen=True)
class Rehearsed:
    """How long a script takes on springs, on the run's clock, and how long of that a finger would be touched."""

    duration_s: float
    contact_s: float


def rehearsed(script: Script, config: Config, finger: Fingertip, plan: Plan) -> Rehearsed:
    """Carry a script out on springs. Raises EngineError where it would not come to its end."""
    believed = config.model_copy(update={"virtual": VirtualSettings()})
    clock = VirtualClock()
    plants: list[SpringPlant] = []

    def make_plant(carriage: Carriage) -> SpringPlant:
        plants.append(SpringPlant(carriage))
        return plants[0]

    bench = bench_around(make_plant, believed, clock, io.StringIO())
    engine = Engine(believed, clock, bench.stage, bench.force, NoJournal(), bench, soft_trip_n=plan.soft_trip_n)
    check = CheckingRig(script.parameters, believed, finger)
    run_script(script, engine, _RehearsedRig(engine, check, plants[0], finger))
    return Rehearsed(clock.monotonic_s(), engine.contact.total_s)
