"""A bench whose finger only the bench knows: an identification has the wires, and nothing else."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from rig.bench.virtual import VirtualBench, bench_around, relaxation, truth
from rig.data import RunFolder
from rig.engine.bench import Pause, WatchedBench
from rig.transport.wire import Sink
from rig.units import GWT_N
from sim.carriage import Carriage, Pose
from sim.devices.clock import VirtualClock
from sim.errors import ModelRangeError
from sim.identification.next_press import PressAt
from sim.identification.predicted_forces import PressTrajectory, RampAndHold
from sim.plant import RelaxingPlant, RelaxingPress
from studies.identification.random_fingers import RandomFinger

Array = NDArray[np.float64]

_SLIPS_AT = 3  # indentors
_FINER = (1, 2, 4)  # than the cell samples, where the press has no answer


class TruthReadError(AssertionError):
    """Error of an identification that reads the truth."""


class OnlyMounts:
    """What a person at the bench can do: put an indentor on."""

    def __init__(self, mount: Callable[[str], None]) -> None:
        self.mount = mount

    def __getattr__(self, name: str) -> NoReturn:
        raise TruthReadError(f"plant.{name} was asked for by an identification")


@dataclass(frozen=True)
class BlindBench(VirtualBench):
    """Nobody but the devices feels the finger, and the journal is told no truth."""

    def witness(self, stream: str, data: Any) -> dict[str, float]:
        """Nothing."""
        return {}


class Slipping:
    """A carriage over a mount that gives way by so much when the third indentor is put on."""

    carriage: Carriage

    def __init__(self, by_mm: float) -> None:
        self._by_mm, self._mounts = by_mm, 0

    def mounted(self, bench: VirtualBench, indentor: str) -> None:
        """Another indentor is on."""
        self._mounts += 1
        bench.plant.mount(indentor)

    def pose_at(self, t_s: float) -> Pose:
        """From the finger."""
        pose = self.carriage.pose_at(t_s)
        slipped = self._mounts >= _SLIPS_AT
        return pose._replace(above_apex_mm=pose.above_apex_mm + self._by_mm) if slipped else pose


class Keeper:
    """Keeps the truth of a random finger, opens benches over it, and tells when all is over."""

    def __init__(self, drawn: RandomFinger) -> None:
        self._drawn = drawn
        self._finger = drawn.made.load(drawn.config.finger, exact=drawn.exact)
        self._over = False

    def open_bench(self, pause: Pause) -> Callable[[RunFolder, Sink, float], WatchedBench]:
        """For a session."""

        def opened(folder: RunFolder, byte_log: Sink, start_unix_s: float) -> WatchedBench:
            clock, config = VirtualClock(start_unix_s, 0.0), self._drawn.config
            slipping = Slipping(self._drawn.slips_mm)
            bench = bench_around(
                lambda carriage: self._plant(carriage, slipping, clock), config, clock, byte_log, pause
            )
            plant: Any = OnlyMounts(lambda indentor: slipping.mounted(bench, indentor))
            known = {name: getattr(bench, name) for name in ("clock", "stage", "force", "pause")}
            return BlindBench(plant=plant, shape_files=folder.path, **known)

        return opened

    def _plant(self, carriage: Carriage, slipping: "Slipping", clock: VirtualClock) -> RelaxingPlant:
        config = self._drawn.config
        slipping.carriage = carriage
        moving: Any = slipping
        period_s = config.force.sample_period_s
        return RelaxingPlant(self._finger, moving, relaxation(config), truth(config), clock, period_s)

    def over(self) -> None:
        """The identification has ended: from now on the truth may be told."""
        self._over = True

    def held_gwt(self, goal: PressAt, pace: RampAndHold) -> float:
        """The force that the bench answers the goal's press with, in its hold."""
        if not self._over:
            raise TruthReadError("the truth was asked for before the identification had ended")
        period_s = self._drawn.config.force.sample_period_s
        for finer in _FINER:
            with suppress(ModelRangeError):
                return self._held_gwt(goal, pace, period_s / finer)
        return self._held_gwt(goal, pace, period_s)

    def _held_gwt(self, goal: PressAt, pace: RampAndHold, period_s: float) -> float:
        """From instant to instant. Raises ModelRangeError, as a sharp shape may on its way."""
        config, way = self._drawn.config, goal.trajectory(pace)
        press = RelaxingPress(self._finger, goal.indentor, relaxation(config), truth(config))
        x_mm = goal.x_mm - config.virtual.finger_x_offset_mm
        touch_mm = self._finger.touch_height_mm(goal.indentor, x_mm) - self._finger.apex_height_mm
        t_s = np.arange(1.0, np.ceil(way.read_s[-1] / period_s) + 1) * period_s
        forces_gwt = [
            press.moved_to(Pose(x_mm, touch_mm + height_mm), period_s) / GWT_N
            for height_mm in _height_mm(way, t_s).tolist()
        ]
        return float(np.interp(way.read_s[-pace.readings :], t_s, forces_gwt).mean())


def _height_mm(way: PressTrajectory, t_s: Array) -> Array:
    """Of the indentor over first touch at any times: it moves in the first half of the time between two heights."""
    corners_s = np.stack([way.ended_s, way.t_s], axis=1).ravel()
    return np.asarray(np.interp(t_s, corners_s, np.repeat(way.height_mm, 2)))
