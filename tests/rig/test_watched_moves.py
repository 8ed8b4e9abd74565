"""Every motion is watched: the force is read while it lasts, on every stage, and what must not be felt ends it.

The class, walked once: each verb that moves × each kind of stage. The bench is virtual, the bytes are real.
"""

import io
import json
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any

import pytest

from rig.bench.virtual import VirtualBench, bench_around
from rig.devices.base import LOOK_S, ForceReading, next_look_s
from rig.engine import Target, TripError, indent, verbs
from rig.engine.bench import NO_PAUSE
from rig.engine.engine import Engine, State
from rig.engine.sensing import MotionForce
from rig.plan.config import Config
from rig.units import GWT_N
from sim.carriage import Carriage, Pose, TruePose
from sim.devices.clock import VirtualClock
from tests.error_codes import shows

GRBL: dict[str, Any] = {"force": {"baud": 115200}}
LEADSHINE: dict[str, Any] = {"stage": {"kind": "leadshine"}, "force": {"kind": "laumas", "baud": 115200}}
STAGES = {"grbl": GRBL, "leadshine": LEADSHINE}


class Hand:
    """A plant that pushes when told to, wherever the indentor is; it keeps when it was felt, and where that was."""

    def __init__(self, carriage: Carriage) -> None:
        self.carriage = carriage
        self.force_gwt: Callable[[float], float] = lambda t_s: 0.0
        self.felt_s: list[float] = []

    def mount(self, indentor: str) -> None:
        """It does not matter."""

    def pose_at(self, t_s: float) -> TruePose:
        pose = self.carriage.pose_at(t_s)
        return TruePose(pose.x_mm, pose.above_apex_mm, -pose.above_apex_mm)

    def force_n(self, t_s: float) -> float:
        self.felt_s.append(t_s)
        return self.force_gwt(t_s) * GWT_N


class Watched:
    """An engine, ready at x = 0, over a hand."""

    def __init__(self, kind: Mapping[str, Any], tables: Mapping[str, Any] | None = None, **limits: Any) -> None:
        config = Config.model_validate({**kind, **(tables or {}), "limits": limits})
        hands: list[Hand] = []

        def make(carriage: Carriage) -> Hand:
            hands.append(Hand(carriage))
            return hands[0]

        self.clock, self.wire = VirtualClock(1.7e9), io.StringIO()
        self.bench: VirtualBench = bench_around(make, config, self.clock, self.wire, NO_PAUSE)
        self.hand = hands[0]
        self.events: list[tuple[str, dict[str, Any]]] = []
        self.engine = Engine(config, self.bench, self, 0.5)

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        self.events.append((stream, dict(data)))

    def settle(self) -> None:
        """There is no disk."""

    def ready(self) -> Engine:
        for verb in (lambda e: verbs.mount(e, "bar:3.0"), verbs.home, verbs.zero, lambda e: verbs.move_to(e, 0.0)):
            verb(self.engine)
        return self.engine

    @property
    def pose(self) -> Pose:
        return self.hand.carriage.pose_at(self.clock.monotonic_s())


# Long enough to be looked at on the way, on both stages.
MOTIONS: dict[str, Callable[[Engine], object]] = {
    "home": verbs.home,
    "move_to": lambda engine: verbs.move_to(engine, 4.0),
    "down to clearance": lambda engine: (engine.go_to_height(8.0, 5.0), verbs.move_to(engine, 0.0)),
    "retract": lambda engine: (engine.go_to_height(1.95, 0.5), engine.go_to_height(1.9, 0.5), engine.lift(9.0)),
    "a slow increment": lambda engine: (engine.go_to_height(1.96, 0.5), engine.go_to_height(1.92, 1 / 60)),
}


@pytest.fixture(params=STAGES)
def watched(request: pytest.FixtureRequest) -> Callable[..., Watched]:
    return lambda **limits: Watched(STAGES[request.param], **limits)


def _stays(*, watched: str, motion: str) -> bool:
    """All on one stage, on the other what it does itself."""
    return watched == "grbl" or motion in ("home", "move_to")


@pytest.mark.quick(rows=_stays)
@pytest.mark.parametrize("motion", MOTIONS)
def test_a_force_above_the_trip_ends_every_motion_at_the_next_poll(
    watched: Callable[..., Watched], motion: str
) -> None:
    """60 gwt with a soft trip of 51, from the middle of the motion on; it is felt before the motion would be over.

    Its position is kept and it is lifted; homing that was ended is held, and not trusted.
    """
    lasts_s = _read_at_every_look(watched(), motion)
    cut = watched()
    engine = cut.ready()
    from_s = cut.clock.monotonic_s() + 0.4 * lasts_s
    cut.hand.force_gwt = lambda t_s: 60.0 if t_s >= from_s else 0.0
    with pytest.raises(TripError) as caught:
        MOTIONS[motion](engine)
    assert caught.value.code in ("soft_trip", "touch_at_clearance")
    if caught.value.code == "soft_trip":
        assert shows(str(caught.value), 50.99)
    assert engine.state is State.TRIPPED
    before, (stream, tripped), (lifted, _) = cut.events[-3:]
    assert (stream, round(tripped["force_gwt"]), lifted) == ("trip", 60, "retract")
    if "while moving" in tripped["reason"]:  # what ended it is on record like every other reading
        assert before[1] | {"x_mm": 0, "height_mm": 0, "contact_s": 0, "force_gwt": 60} == {
            "index": -1, "phase": "moving", "x_mm": 0, "height_mm": 0, "doi_mm": None, "force_gwt": 60,
            "stable": False, "contact_s": 0,
        }  # fmt: skip
    felt = min(t_s for t_s in cut.hand.felt_s if t_s >= from_s)
    assert felt - from_s < LOOK_S + 0.15
    assert cut.bench.stage.homed is (motion != "home")
    if motion != "home":
        assert engine.x_mm == pytest.approx(cut.pose.x_mm, abs=0.003)
        assert engine.height_mm == pytest.approx(cut.pose.above_apex_mm, abs=0.003)
        assert cut.pose.above_apex_mm > 1.99


def _read_at_every_look(whole: Watched, motion: str) -> float:
    """Return how long the motion lasts.

    Between two readings lie at most a stretch without a look (1.5), being late (1), settling and the answers.
    """
    engine = whole.ready()
    at_rest_gwt, at_rest_s = engine.sensing.at_rest_gwt, list[float]()

    def noted(meanwhile: Callable[[float], object]) -> float:
        at_rest_s.append(whole.clock.monotonic_s())
        return at_rest_gwt(meanwhile)

    engine.sensing.at_rest_gwt = noted  # type: ignore[method-assign]
    begun_s = whole.clock.monotonic_s()
    MOTIONS[motion](engine)
    now_s = whole.clock.monotonic_s()
    until_s = at_rest_s[0] if motion == "home" else now_s
    read_s = [c["t_s"] for c in map(json.loads, whole.wire.getvalue().splitlines()) if c["port"] == "force"]
    inside = [begun_s, *(t_s for t_s in read_s if begun_s < t_s < until_s), until_s]
    assert max(later - earlier for earlier, later in pairwise(inside)) < 2.5 * LOOK_S + 0.2
    return now_s - begun_s


@pytest.mark.quick(rows=_stays)
@pytest.mark.parametrize("motion", [*MOTIONS, "ramp"])
def test_an_error_in_the_program_stops_every_motion(
    watched: Callable[..., Watched], motion: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = watched()
    engine = bench.ready()
    looks: list[float] = []

    def broken(begun: MotionForce) -> ForceReading:
        looks.append(bench.clock.monotonic_s())
        if len(looks) > 2:
            raise ZeroDivisionError
        return ForceReading(0.0, True, 0.0)

    def ramp(engine: Engine) -> None:
        engine.go_to_height(1.9, 0.1, on_reading=lambda reading: None)

    monkeypatch.setattr(engine.sensing, "read_in_motion", broken)
    with pytest.raises(ZeroDivisionError):
        (MOTIONS | {"ramp": ramp})[motion](engine)
    assert len(looks) == 3
    bench.clock.wait_s(0.1)  # after a stop in homing the last step is on its way
    at_rest = bench.pose
    bench.clock.wait_s(2.0)
    assert bench.pose == at_rest


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_sensor_that_gives_no_number_during_a_motion_trips(motion: str) -> None:
    """Away from the finger it goes to the end of the way first; there nothing says that it is lifted."""
    bench = Watched(GRBL)
    engine = bench.ready()
    if motion == "retract":
        engine.go_to_height(1.95, 0.5)
    sensor, read = engine.sensing.sensor, engine.sensing.sensor.read
    from_s = bench.clock.monotonic_s() + (0.0 if motion == "retract" else 0.15)

    def silent() -> Any:
        reading = read()
        if bench.clock.monotonic_s() < from_s:
            return reading
        bench.clock.wait_s(0.2)
        return type(reading)(float("nan"), False, bench.clock.monotonic_s())

    sensor.read = silent  # type: ignore[method-assign]
    act = verbs.retract if motion == "retract" else MOTIONS[motion]
    with pytest.raises(TripError, match="not a number"):
        act(engine)
    assert engine.state is State.TRIPPED


def test_before_the_first_zero_forces_count_from_the_reading_before_the_motion() -> None:
    """A sensor that was never zeroed shows the holder's weight, 80 gwt: no reason to refuse homing."""
    bench = Watched(GRBL)
    bench.hand.force_gwt = lambda t_s: 80.0
    verbs.home(bench.engine)
    from_s = bench.clock.monotonic_s() + 2.0  # on the way
    bench.hand.force_gwt = lambda t_s: 80.0 if t_s < from_s else 140.0
    with pytest.raises(TripError, match=r"force 60\.00 gwt exceeds the soft trip"):
        verbs.move_to(bench.engine, 4.0)


# --- how often ---


@pytest.mark.parametrize(
    ("over_s", "looks_s"),
    [(0.14, [0.24]), (0.16, [0.1, 0.26]), (0.34, [0.1, 0.2, 0.44]), (-1.0, [0.1, 0.2])],
)
def test_no_poll_falls_just_before_or_after_the_end_of_a_motion(over_s: float, looks_s: list[float]) -> None:
    """An increment of 0.1 s is read at rest, as it is; a late motion is looked at all the same."""
    found, last_s = [], 0.0
    while len(found) < len(looks_s):
        last_s = next_look_s(last_s, over_s, 0.1)
        found.append(last_s)
    assert found == pytest.approx(looks_s)


# --- limits that are layers of their own ---


def test_the_hard_trip_acts_on_every_reading_of_every_verb() -> None:
    """Descent, zero, press, move and homing, each with the soft trip out of the way."""
    for act in (
        lambda e: verbs.zero(e),
        lambda e: (e.go_to_height(8.0, 5.0), verbs.move_to(e, 0.0)),
        lambda e: indent(e, Target("doi_mm", 0.5)),
        lambda e: verbs.move_to(e, 4.0),
        verbs.home,
    ):
        bench = Watched(GRBL, hard_trip_n=1.0, soft_trip_n=1.0)
        engine = bench.ready()
        engine.trips.soft_gwt = float("inf")
        bench.hand.force_gwt = lambda t_s: 110.0
        with pytest.raises(TripError, match=r"force 110\.\d\d gwt exceeds the hard trip of 101\.97 gwt"):
            act(engine)
        assert engine.state is State.TRIPPED
