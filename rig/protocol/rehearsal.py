"""A protocol rehearsed on a finger of springs: how long it will take, before anything moves.

The engine, the drivers, the bytes and the clock are those of a dry-run; only the finger is replaced, by one spring
for each indentation, fitted to two solutions of the finger model, since a spring costs next to nothing.
"""

import io
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rig.protocol.config import Config, VirtualSettings
from rig.protocol.live import LiveRig
from rig.protocol.plan import CheckingRig, Plan, PlannedIndentation
from rig.protocol.script import Script
from rig.protocol.virtual_bench import bench_around
from rig.run import Engine, Indentation
from sim.clock import VirtualClock
from sim.fingertip import Fingertip
from sim.plant import Carriage, TruePose


@dataclass(frozen=True)
class Spring:
    """force = at_target · (DOI / target)^exponent."""

    contact_mm: float
    doi_mm: float
    force_n: float
    exponent: float

    @classmethod
    def fitted(cls, planned: PlannedIndentation, finger: Fingertip) -> "Spring":
        """Through the model's force at the target and at half of its depth."""
        target = finger.indent(planned.indentor, planned.x_mm, doi_mm=planned.predicted_doi_mm)
        half = finger.indent(planned.indentor, planned.x_mm, doi_mm=0.5 * planned.predicted_doi_mm)
        exponent = math.log2(target.force_n / half.force_n)
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


class _Nowhere:
    """A journal of what has not happened."""

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Forget it."""


class _RehearsedRig(LiveRig):
    """Puts the right spring under the indentor."""

    def __init__(self, engine: Engine, check: CheckingRig, plant: SpringPlant, springs: list[Spring]) -> None:
        super().__init__(engine, check)
        self._plant, self._springs = plant, springs

    def _press(self, index: int, deed: Callable[[], Indentation]) -> Indentation:
        self._plant.spring = self._springs[index]
        return deed()


def rehearsed_s(script: Script, config: Config, finger: Fingertip, plan: Plan) -> float:
    """Seconds of the run's clock on springs. Raises EngineError where the script would not come to its end."""
    believed = config.model_copy(update={"virtual": VirtualSettings()})
    springs = [Spring.fitted(planned, finger) for planned in plan.indentations]
    clock = VirtualClock()
    plants: list[SpringPlant] = []

    def make_plant(carriage: Carriage) -> SpringPlant:
        plants.append(SpringPlant(carriage))
        return plants[0]

    bench = bench_around(make_plant, believed, clock, io.StringIO())
    engine = Engine(believed, clock, bench.stage, bench.force, _Nowhere(), bench, soft_trip_n=plan.soft_trip_n)
    check = CheckingRig(script.parameters, believed, finger)
    script.run(_RehearsedRig(engine, check, plants[0], springs))
    return clock.monotonic_s()
