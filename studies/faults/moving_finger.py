"""A finger that moves, on each stage: what was reported, how far it was dragged, and the highest force.

    .venv/bin/python -m studies.faults.moving_finger     # studies/results/faults/moving_finger.csv

The finger answers 13 gwt at 1 mm (F ∝ d^1.5), the soft trip is 16 gwt. Drivers, wires and bytes are those of a
dry-run; forces and ways are those of the virtual carriage, sampled every 4 ms in contact.
"""

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress

from rig.engine import Pause, Target, indent, verbs
from rig.errors import RigError
from rig.session.script_run import ENDINGS, stopped_at_once
from studies.registry import show
from tests.moving_finger import STAGES, TRIP_GWT, FingerOnBytes


def _in_s(bench: FingerOnBytes, seconds: float) -> float:
    return bench.clock.monotonic_s() + seconds


def _reported(bench: FingerOnBytes) -> str:
    """Return the highest force at which the indentor was called lifted longer than a second after the touch."""
    bench.ask()
    lies = bench.witness.lies()
    return f"lifted at {max(said.force_gwt for said in lies):.1f} gwt" if lies else "never lifted at a force"


def _dragged(bench: FingerOnBytes) -> str:
    far_mm, force_gwt = bench.witness.dragged(bench.least_gwt)
    return f"{far_mm:.2f} mm at {force_gwt:.1f} gwt"


def _status(bench: FingerOnBytes) -> str:
    bench.ready()
    bench.finger.moves(_in_s(bench, 1.0), 3.2)
    bench.clock.wait_s(10.0)
    return _reported(bench)


def _rest_ended(bench: FingerOnBytes) -> str:
    engine = bench.ready()
    bench.finger.moves(_in_s(bench, 1.0), 2.8)
    at_s = _in_s(bench, 6.0)
    bench.pause = Pause(lambda: bench.clock.monotonic_s() >= at_s)
    with suppress(KeyboardInterrupt, *ENDINGS), stopped_at_once(engine):
        verbs.rest(engine, 12.0)
    return _reported(bench)


def _jogged(bench: FingerOnBytes) -> str:
    bench.ready()
    bench.finger.moves(_in_s(bench, 1.0), 2.8)
    bench.clock.wait_s(10.0)
    with suppress(RigError):
        bench.jog("x", 9.0)
    return _dragged(bench)


def _zeroed(bench: FingerOnBytes) -> str:
    """Return the worst of several instants at which the finger comes up in a zero."""
    worst = (0.0, 0.0)
    for after_s in (0.2, 0.4, 0.6, 0.8):
        again = FingerOnBytes(bench.config.stage.kind)
        engine = again.ready()
        again.finger.moves(_in_s(again, after_s), 4.0, 4.0)
        with suppress(*ENDINGS):
            verbs.zero(engine)
            verbs.move_to(engine, 4.0)
        worst = max(worst, again.witness.dragged(again.least_gwt))
    return f"{worst[0]:.2f} mm at {worst[1]:.1f} gwt"


def _noise(bench: FingerOnBytes) -> str:
    engine = bench.ready()
    zero = bench.force.zero

    def shake() -> None:
        zero()
        bench.finger.moves(_in_s(bench, 0.0), 1.8, 20.0, stays_s=3.0)
        bench.finger.moves(_in_s(bench, 0.1), 0.6, 8.0, cycles=30)

    bench.force.zero = shake  # type: ignore[method-assign]
    with suppress(*ENDINGS):
        verbs.zero(engine)
    return f"{engine.sensing.touch_gwt:.2f} gwt"


def _moved(bench: FingerOnBytes) -> str:
    engine = bench.ready()
    bench.finger.moves(_in_s(bench, 0.4), 3.2)
    with suppress(*ENDINGS):
        verbs.move_to(engine, 6.0)
    return _dragged(bench)


def _beside(bench: FingerOnBytes) -> str:
    engine = bench.ready()
    bench.finger.stands_beside(2.0, 3.3, 3.3)
    with suppress(*ENDINGS):
        verbs.move_to(engine, 6.0)
    return _dragged(bench)


def _rested(bench: FingerOnBytes) -> str:
    engine = bench.ready()
    bench.finger.moves(_in_s(bench, 2.0), 4.0)
    with suppress(*ENDINGS):
        verbs.rest(engine, 12.0)
    above = [sample for sample in bench.witness.samples if sample.force_gwt > TRIP_GWT]
    lasted_s = above[-1].t_s - above[0].t_s if above else 0.0
    return f"{lasted_s:.1f} s above the trip, {bench.witness.worst_gwt():.1f} gwt"


def _lifted(bench: FingerOnBytes) -> str:
    engine = bench.ready()
    bench.finger.moves(_in_s(bench, 8.0), 4.4, 20.0)
    with suppress(*ENDINGS):
        indent(engine, Target("force_gwt", 6.0), hold_s=30.0)
    now = bench.witness.now()
    return f"{now.force_gwt:.1f} gwt at {now.height_mm:.1f} mm"


CASES: dict[str, Callable[[FingerOnBytes], str]] = {
    "up 3.2 mm after the lift: what is reported": _status,
    "up 2.8 mm in a rest that SIGTERM ends: what is reported": _rest_ended,
    "up 2.8 mm after the lift: dragged by `rig jog` over 9 mm": _jogged,
    "up 4 mm during a zero: dragged by the move after it": _zeroed,
    "shakes during a zero: touch threshold": _noise,
    "up 3.2 mm during a move: dragged": _moved,
    "a second finger beside it, 3.3 mm higher: dragged": _beside,
    "up 4 mm in a rest": _rested,
    "up 4.4 mm in a press: force left after the trip": _lifted,
}


def _rows() -> Iterator[list[str]]:
    for case, found in CASES.items():
        yield [case, *(found(FingerOnBytes(kind)) for kind in STAGES)]


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as state:
        os.environ["RIG_STATE_DIR"] = state
        show(["the finger goes", *STAGES], _rows())


if __name__ == "__main__":
    main()
