"""How long the force goes unread while anything moves: on the virtual clock, and behind `rig serve` in real time.

    .venv/bin/python -m studies.speed.looks

Homing, a move of 4 mm, the way down to clearance, an indentation to 2.33 gwt with its lift, for each stage. A motion
begins with its first byte and ends with arrival; what counts is the longest stretch of it between two readings, up to
the first one after it. Beside it: the longest motion of that kind, which would be the stretch if nobody looked.
"""

import io
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from itertools import pairwise
from typing import Any

from rig.bench.real import open_bench
from rig.bench.served import ServedBench
from rig.bench.virtual import virtual_bench
from rig.clock import WallClock
from rig.data.journal import NoJournal
from rig.devices.base import Looks
from rig.engine import Engine, Target, indent, verbs
from rig.engine.bench import NO_PAUSE, Bench
from rig.plan.config import Config
from sim.devices.clock import VirtualClock
from sim.models.fingertip import Fingertip

KINDS: dict[str, dict[str, Any]] = {
    "GRBL, balance at 9600 baud": {},
    "Leadshine, transmitter": {"stage": {"kind": "leadshine"}, "force": {"kind": "laumas", "baud": 115200}},
}
X_MM = 4.0


class Looked:
    """Keeps when a bench's force was read and when its stage moved, by what was being done."""

    def __init__(self, bench: Bench) -> None:
        self._clock = bench.clock
        self.read_s: list[float] = []
        self.motions: list[tuple[str, float, float]] = []
        self.doing = ""
        stage: Any = bench.stage
        sensor: Any = bench.force
        stage.homing, stage.moving = self._timed(stage.homing), self._timed(stage.moving)
        sensor.read = self._noted(sensor.read)

    def _timed(self, motion: Callable[..., Looks]) -> Callable[..., Looks]:
        def timed(**to: Any) -> Looks:
            begun_s = self._clock.monotonic_s()
            yield from motion(**to)
            self.motions.append((self.doing, begun_s, self._clock.monotonic_s()))

        return timed

    def _noted(self, read: Callable[[], Any]) -> Callable[[], Any]:
        def noted() -> Any:
            reading = read()
            self.read_s.append(self._clock.monotonic_s())
            return reading

        return noted

    def longest_s(self) -> Iterator[tuple[str, float, float]]:
        """Of each thing that was done: the longest stretch of a motion without a reading, the longest motion, s."""
        for doing in dict.fromkeys(name for name, _, _ in self.motions):
            motions = [(begun, over) for name, begun, over in self.motions if name == doing]
            yield doing, max(map(self._unread_s, motions)), max(over - begun for begun, over in motions)

    def _unread_s(self, motion: tuple[float, float]) -> float:
        begun_s, over_s = motion
        inside = [begun_s, *(t_s for t_s in self.read_s if begun_s < t_s <= over_s)]
        inside.append(next((t_s for t_s in self.read_s if t_s > over_s), over_s))
        return max(b - a for a, b in pairwise(inside))


def carry_out(config: Config, bench: Bench) -> Looked:
    """The same few motions on any bench."""
    looked = Looked(bench)
    engine = Engine(config, bench, NoJournal())
    verbs.mount(engine, config.virtual.indentor)
    for doing, verb in (
        ("home", verbs.home),
        ("zero", verbs.zero),
        ("down to clearance", lambda e: verbs.move_to(e, 0.0)),
        ("4 mm sideways", lambda e: verbs.move_to(e, X_MM)),
        ("back", lambda e: verbs.move_to(e, 0.0)),
        ("indentation", lambda e: indent(e, Target("force_gwt", 2.33), hold_s=1.0)),
        ("lift", lambda e: e.go_to_height(10.0, config.habits.travel_speed_mm_s)),
    ):
        looked.doing = doing
        verb(engine)
    return looked


@contextmanager
def served(config: Config) -> Iterator[Bench]:
    """Real drivers on the pseudo-terminals of a served bench."""
    with ServedBench(config, stage=config.stage.kind, force=config.force.kind) as bench:
        thread = threading.Thread(target=bench.run)
        thread.start()
        stage = config.stage.model_copy(update={"port": bench.ports["stage"]})
        force = config.force.model_copy(update={"port": bench.ports["force"]})
        ports = config.model_copy(update={"stage": stage, "force": force})
        try:
            with closing(open_bench(ports, WallClock(), io.StringIO(), lambda request: "")) as real:
                yield real
        finally:
            bench.stop()
            thread.join()


def main() -> None:
    """The table of docs/validation/safety.md."""
    finger = Fingertip.load()
    print("| bench | motion | longest unread (s) | the longest motion (s) |\n|---|---|---|---|")
    for name, tables in KINDS.items():
        config = Config.model_validate(tables)
        bench = virtual_bench(config, finger, io.StringIO(), VirtualClock(1.7e9), NO_PAUSE)
        _tell(f"{name}, virtual clock", carry_out(config, bench))
        with served(config) as real:
            _tell(f"{name}, `rig serve`", carry_out(config, real))


def _tell(bench: str, looked: Looked) -> None:
    for doing, unread_s, lasted_s in looked.longest_s():
        print(f"| {bench} | {doing} | {unread_s:.3f} | {lasted_s:.2f} |", flush=True)


if __name__ == "__main__":
    main()
