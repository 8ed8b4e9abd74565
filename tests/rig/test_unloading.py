"""A falling force never stops a motion away from the finger: every such motion, on both stages, from three forces."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from rig.engine import Engine, RunAborted, TripError, verbs
from rig.engine.bench import Pause
from rig.engine.bench_memory import LastKnown
from rig.engine.contact import KnownContact
from rig.engine.engine import State
from rig.engine.motion import UP
from rig.engine.steps import Steps
from rig.units import GWT_N
from studies.faults.faulty_bench import PREDICTED, SOFT_TRIP_N, FaultyBench
from tests.error_codes import raises
from tests.faults.catalogue import GRBL, MODBUS

FORCES_GWT = (0.5, 8.0, 28.9)  # the soft trip is at 16
Act = Callable[[FaultyBench], None]


def _trips(bench: FaultyBench) -> None:
    with raises(TripError, "for_the_test"):
        bench.engine.trip(TripError("for the test", "for_the_test"))


def _backs_off(bench: FaultyBench) -> None:
    while bench.engine.height_mm < 0.0:
        bench.engine.go_to_height(bench.engine.height_mm + bench.config.habits.increment_mm, 0.5)


def _paused(bench: FaultyBench) -> None:
    bench.pause = Pause(lambda: True, lambda meanwhile: False)
    with raises(RunAborted, "stopped_at_a_safe_point"):
        verbs.safe_point(bench.engine)


def _by_hand(bench: FaultyBench) -> None:
    """At the known height, and then at an unknown one."""
    steps = Steps(bench.engine)
    assert steps.make(UP, 0.1, 5.0).ended_by is None
    bench.stage.stop()
    bench.stage.connect()
    bench.stage.unlock()
    bench.engine.state = State.UNHOMED
    assert steps.make(UP, 5.0, 5.0).ended_by is None


def _resumed(bench: FaultyBench) -> None:
    """A new program, as the one before it left the bench."""
    zero = bench.engine.sensing.zero
    bench.engine = Engine(bench.config, bench, bench.journal, SOFT_TRIP_N)
    known = {} if zero is None else {"zero_offset_n": zero.offset_n, "zero_noise_gwt": zero.noise_gwt}
    before = LastKnown(contact=KnownContact("touching", 28.9), **known)  # type: ignore[arg-type]
    verbs.leave_finger(bench.engine, before, resumed=True)
    assert bench.engine.known_contact.kind == ("raised" if zero is None else "lifted")


AWAY: dict[str, Act] = {
    "home": lambda bench: verbs.home(bench.engine),
    "lift": lambda bench: bench.engine.lift(),
    "retract": lambda bench: verbs.retract(bench.engine),
    "trip": _trips,
    "park": _trips,
    "back off": _backs_off,
    "pause": _paused,
    "make safe": lambda bench: bench.engine.make_safe(),
    "by hand": _by_hand,
    "resume": _resumed,
}
STAGES = {"grbl": GRBL, "modbus": MODBUS}


@dataclass(frozen=True)
class Pressed:
    """A bench whose indentor stands in the finger."""

    folder: Path
    stage: str
    on_trip: str = "retract"

    def bench(self, force_gwt: float, *, zeroed: bool) -> FaultyBench:
        tables: dict[str, Any] = {
            **STAGES[self.stage],
            "limits": {"soft_trip_n": SOFT_TRIP_N, "on_trip": self.on_trip, "max_doi_mm": 2.0},
            "frame": {"apex_z_mm": -12.0},  # a shorter way down than the default
        }  # fmt: skip
        bench = FaultyBench(self.folder, tables)
        verbs.mount(bench.engine, "bar:3.0")
        verbs.home(bench.engine)
        verbs.zero(bench.engine)
        verbs.move_to(bench.engine, 0.0)
        depth_mm = PREDICTED.doi_mm * (force_gwt * GWT_N / PREDICTED.force_n) ** (1 / PREDICTED.exponent)
        z_mm = bench.config.frame.apex_z_mm + PREDICTED.contact_mm - depth_mm
        bench.stage.move_to(z_mm=round(z_mm, 4), speed_mm_s=5.0)
        bench.engine.motion.set_position(bench.stage.status())
        bench.engine._below_clearance()
        bench.engine.sensing.moved = True
        if not zeroed:
            bench.engine.sensing.zero = None
        assert bench.true_n(bench.clock.monotonic_s()) / GWT_N == pytest.approx(force_gwt, abs=0.1)
        return bench


def _stays(*, stage: str, motion: str, force_gwt: float, zeroed: bool) -> bool:
    """From the highest force, with and without a zero; on the other stage what it does itself."""
    return force_gwt == FORCES_GWT[2] and (stage == "grbl" or (zeroed and motion in ("home", "lift", "by hand")))


@pytest.mark.quick(rows=_stays)
@pytest.mark.parametrize("zeroed", [True, False], ids=["zeroed", "unzeroed"])
@pytest.mark.parametrize("force_gwt", FORCES_GWT)
@pytest.mark.parametrize("motion", AWAY)
@pytest.mark.parametrize("stage", STAGES)
def test_a_motion_away_from_the_finger_continues_while_the_force_falls(
    tmp_path: Path, stage: str, motion: str, force_gwt: float, zeroed: bool
) -> None:
    bench = Pressed(tmp_path, stage, "park" if motion == "park" else "retract").bench(force_gwt, zeroed=zeroed)
    bench.worst_n = 0.0
    AWAY[motion](bench)
    assert bench.true_n(bench.clock.monotonic_s()) == 0.0
    assert bench.worst_n / GWT_N == pytest.approx(force_gwt, abs=0.1)
    bench.journal.close()


@pytest.mark.parametrize("sign", [1, -1], ids=["push", "pull"])
@pytest.mark.parametrize("stage", STAGES)
def test_a_motion_away_from_the_finger_ends_when_the_force_grows(tmp_path: Path, stage: str, sign: int) -> None:
    """Something comes along, or the skin sticks: the motion ends, and the way up stays free, as after every trip."""
    bench = Pressed(tmp_path, stage).bench(8.0, zeroed=True)
    from_s = bench.clock.monotonic_s() + 0.3
    bench.extra_n = lambda t_s: sign * 25 * GWT_N if from_s < t_s < from_s + 1.0 else 0.0
    with pytest.raises(TripError) as tripped:
        verbs.retract(bench.engine)
    code = tripped.value.code
    assert code in ("soft_trip", "no_reading", "not_lifted")
    assert code == "soft_trip" or "underloaded" in str(tripped.value)
    assert bench.true_n(bench.clock.monotonic_s()) == 0.0
    bench.journal.close()


@pytest.mark.parametrize("stage", STAGES)
def test_a_run_that_finds_a_force_lifts_first_and_journals_an_alarm(tmp_path: Path, stage: str) -> None:
    """Nothing is on record but a zero."""
    bench = Pressed(tmp_path, stage).bench(28.9, zeroed=True)
    zero = bench.engine.sensing.zero
    assert zero is not None
    engine = Engine(bench.config, bench, bench.journal, SOFT_TRIP_N)
    verbs.leave_finger(engine, LastKnown(zero_offset_n=zero.offset_n), resumed=False)
    assert bench.true_n(bench.clock.monotonic_s()) == 0.0
    assert engine.known_contact.kind == "lifted"
    assert engine.sensing.zero is None, "the script takes its own"
    bench.journal.close()
    text = bench.journal_path.read_text(encoding="utf-8")
    assert '"alarm"' in text
    assert "28.9" in text
