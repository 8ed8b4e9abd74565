"""A ramp and hold at constant speed: what it does, what ends it on every stage, and what is refused."""

import itertools
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import rig.engine.indentation as indentations
from rig.devices.registry import StageKind
from rig.engine import LimitError, NotReadyError, Target, TripError, indent, limits, verbs
from rig.engine.bench import Pause
from rig.engine.engine import State
from rig.engine.indentation import ramp
from rig.engine.limits import RAMP_MARGIN, RampBound, Stopping
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.plan import Plan, make_plan
from rig.protocol.script import Script, load_script
from rig.session.rehearsal_summary import preflight
from rig.session.resume import StoppedRun, read_stopped
from rig.session.session import NewRun, Session, dry_run
from rig.settings import RigSettings
from rig.units import GWT_N
from sim.models.fingertip import Fingertip
from studies.faults.campaign.world import BENCHES
from studies.faults.faulty_bench import PREDICTED, SOFT_TRIP_N, FaultyBench, bound_gwt
from tests.error_codes import printed, raises
from tests.faults.other_fingers import OTHERS, RampCase, ramp_into

Make = Callable[..., Any]
CONTACT_MM = -0.3
SLOW = {"doi_mm": 0.8, "speed_mm_s": 0.3}


# --- the bound ---


@pytest.mark.parametrize("speed_mm_s", [0.02, 0.8, 1.5])
def test_a_ramp_that_trips_stops_within_the_force_bound_of_a_press(speed_mm_s: float) -> None:
    for tables in ({}, {"force": {"latency_s": 0.2}}, {"stage": {"acceleration_mm_s2": 5.0}}):
        for force_gwt, doi_mm in ((8.0, 0.86), (8.0, 1.4), (1.0, 0.1)):
            _ends_at_the_bound(RigSettings.model_validate(tables), speed_mm_s, force_gwt, doi_mm)


def _ends_at_the_bound(settings: RigSettings, speed_mm_s: float, force_gwt: float, doi_mm: float) -> None:
    bound = RampBound.of(settings, speed_mm_s, 16.0, force_gwt, doi_mm)
    press = Stopping.of(settings, settings.limits.max_press_speed_mm_s)
    move = Stopping.in_a_ramp(settings, speed_mm_s)
    assert bound.bound_gwt == 16.0 + press.overshoot_gwt(16.0, force_gwt, doi_mm)
    assert bound.stop_mm == move.distance_mm
    assert 0.0 <= bound.trip_gwt <= 16.0
    if 0.0 < bound.trip_gwt < 16.0:
        end_gwt = bound.trip_gwt + move.overshoot_gwt(bound.trip_gwt, force_gwt, doi_mm)
        assert end_gwt == pytest.approx(bound.bound_gwt)


@pytest.mark.parametrize(("force_gwt", "doi_mm"), [(8.0, 0.86), (5.0, 1.4)])
def test_the_fastest_allowed_ramp_trips_at_the_margin_above_its_force(force_gwt: float, doi_mm: float) -> None:
    settings = RigSettings()

    def at(speed_mm_s: float) -> RampBound:
        return RampBound.of(settings, speed_mm_s, 16.0, force_gwt, doi_mm)

    fastest_mm_s = at(0.1).fastest_mm_s
    assert at(fastest_mm_s).trip_gwt == pytest.approx(RAMP_MARGIN * force_gwt)
    at(0.999 * fastest_mm_s).refuse_too_fast(LimitError, 0.0)
    with raises(LimitError, "ramp_too_fast", x_mm=0.5, fastest_mm_s=math.floor(1000 * fastest_mm_s) / 1000):
        at(1.001 * fastest_mm_s).refuse_too_fast(LimitError, 0.5)


# --- what a ramp does ---


def _samples(bench: Any, phase: str) -> list[dict[str, Any]]:
    return [sample for sample in bench.of("sample") if sample["phase"] == phase]


def test_a_ramp_is_one_move_at_its_speed_with_readings_on_the_way(spring: Make) -> None:
    bench = spring(soft_trip_n=0.1)
    ramp(bench.ready(), **SLOW, hold_s=0.0)
    apex_mm = bench.settings.frame.apex_z_mm
    heights = [(move["Z"] - apex_mm, move["F"]) for move in bench.moves() if "Z" in move]
    long = [
        (before - after, feed)
        for (before, _), (after, feed) in itertools.pairwise(heights)
        if before < 1.9 and before - after > 0.06
    ]
    assert long == [(pytest.approx(0.84, abs=0.05), pytest.approx(60 * 0.3))]
    on_the_way = [(s["height_mm"], s["force_gwt"], s["doi_mm"]) for s in _samples(bench, "ramp")[:-1]]
    steps = [a[0] - b[0] for a, b in itertools.pairwise(on_the_way)]
    assert len(steps) > 25
    assert max(steps) < 0.3 * 0.15
    for height_mm, force_gwt, doi_mm in on_the_way:
        assert doi_mm == pytest.approx(CONTACT_MM - height_mm, abs=0.01)
        assert force_gwt == pytest.approx(6.0 * max(doi_mm, 0.0) ** 1.5, abs=0.3)


def test_a_ramp_into_a_soft_finger_has_its_own_peak_and_is_bounded_by_a_touch_at_least(spring: Make) -> None:
    """0.42 gwt at 0.8 mm; at 0.1 mm that is less than a touch."""
    bench = spring(soft_trip_n=0.1, k_gwt=0.6)
    engine = bench.ready()
    first = ramp(engine, **SLOW, hold_s=0.0)
    ramp(engine, doi_mm=0.1, speed_mm_s=0.3, hold_s=0.0)
    held = bench.of("hold_end")
    for n, found in enumerate(held):
        forces = [sample["force_gwt"] for sample in _samples(bench, "ramp") if sample["index"] == found["index"]]
        assert found["peak_gwt"] == max(forces), n
        assert found["peak_gwt"] < 1.0
    assert first is not None
    assert bench.of("ramp")[-1]["measured_gwt"] == engine.sensing.touch_gwt


def _nothing(bench: Any) -> None:
    """Between two ramps."""


def _pressed(bench: Any) -> None:
    indent(bench.engine, Target("doi_mm", 0.8), hold_s=0.0)


def _pressed_less(bench: Any) -> None:
    indent(bench.engine, Target("doi_mm", 0.4), hold_s=0.0)


def _touched(bench: Any) -> None:
    indentations.touch_place(bench.engine, 0, CONTACT_MM)


def _homed(bench: Any) -> None:
    verbs.home(bench.engine)
    verbs.move_to(bench.engine, 0.0)


def _elsewhere(bench: Any) -> None:
    verbs.move_to(bench.engine, 0.5)


def _mounted(bench: Any) -> None:
    verbs.mount(bench.engine, "bar:3.0")


def _paused(bench: Any) -> None:
    asked = [True, False]
    bench.interrupt = lambda: asked.pop(0) if asked else False
    bench.pause = type(bench.pause)(bench.pause.asked, lambda meanwhile: True)
    verbs.safe_point(bench.engine)


def test_a_ramp_presses_first_only_where_the_stiffness_is_unmeasured(spring: Make) -> None:
    bench = spring(soft_trip_n=0.1)
    ramp(bench.ready(), **SLOW, hold_s=0.0)
    for between in (_nothing, _pressed, _pressed_less, _touched, _homed, _elsewhere, _mounted, _paused):
        between(bench)
        bench.events.clear()
        done = ramp(bench.engine, **SLOW, hold_s=0.0)
        assert bool(_samples(bench, "press")) is (between not in (_nothing, _pressed)), between
        assert done.holds[0].doi_mm == pytest.approx(0.8, abs=0.0025)


def test_a_ramp_deeper_than_measured_presses_first_and_a_shallower_one_does_not(spring: Make) -> None:
    bench = spring(soft_trip_n=0.15)
    for doi_mm, presses in ((0.6, True), (0.8, True), (0.7, False)):
        bench.events.clear()
        ramp(bench.engine if bench.engine.placed else bench.ready(), doi_mm, 0.2, hold_s=0.0)
        assert bool(_samples(bench, "press")) is presses
        assert bench.of("ramp")[0]["measured_gwt"] == pytest.approx(6.0 * doi_mm**1.5, rel=0.02)


def test_a_late_sensor_does_not_count_as_frozen_in_a_ramp(tmp_path: Path) -> None:
    """It reads zero for 0.06 mm below the contact, and shows each force 0.2 s after it was there."""
    bench = FaultyBench(tmp_path, {"force": {"latency_s": 0.2}, "limits": {"soft_trip_n": SOFT_TRIP_N}})
    bench.felt_n = lambda t_s: bench.true_n(t_s - 0.2)
    verbs.mount(bench.engine, "bar:3.0")
    verbs.home(bench.engine)
    verbs.zero(bench.engine)
    verbs.move_to(bench.engine, 0.0)
    done = ramp(bench.engine, 0.86, 0.3, hold_s=0.1, expected_contact_mm=PREDICTED.contact_mm)
    bench.journal.close()
    assert done.holds[0].doi_mm == pytest.approx(0.86, abs=0.003)


# --- what is refused ---


def test_a_ramp_too_fast_for_the_measured_stiffness_is_refused_before_it_begins(spring: Make) -> None:
    """It is lifted; the ramp itself never begins."""
    bench = spring(k_gwt=6.0, soft_trip_n=0.1)
    ramp(bench.ready(), 0.8, 0.5, hold_s=0.0)
    bench.k_gwt = 10.0
    verbs.home(bench.engine)
    verbs.move_to(bench.engine, 0.0)
    bench.events.clear()
    with raises(LimitError, "ramp_too_fast", speed_mm_s=0.5):
        ramp(bench.engine, 0.8, 0.5, hold_s=0.0)
    assert not bench.of("ramp")
    assert bench.engine.state is State.READY
    assert bench.height_mm == pytest.approx(2.0, abs=0.003)


def test_a_stage_that_cannot_ramp_is_refused_by_engine_and_plan(
    spring: Make, finger: Fingertip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "ramps", lambda stage: False)
    bench = spring()
    engine = bench.ready()
    moves = len(bench.moves())
    with raises(NotReadyError, "no_ramps", kind="grbl"):
        ramp(engine, **SLOW)
    assert len(bench.moves()) == moves
    with raises(BadInputError, "no_ramps", kind="grbl"):
        make_plan(_script(tmp_path, "rig.ramp(doi_mm=0.5, speed_mm_s=0.2)"), Config(), finger)


def test_a_packaged_stage_cannot_ramp_unless_its_kind_declares_ramps() -> None:
    kind = StageKind(name="other", device="another stage", tests=(), driver=lambda *_: None)  # type: ignore[arg-type, return-value]
    assert kind.ramps is False


# --- what ends it: every stage, real bytes ---
#
# The engine ends a ramp, alike on every stage; what a stage does itself, its ramp and its stop, is tried on each.

STAGES = {name: BENCHES[name] for name in ("grbl", "rtu", "zaber", "standa", "tmcl")}
NEAR = {"frame": {"pad_centre_x_mm": -12.0, "apex_z_mm": -12.0}}
"""A short way from the switches, below where a virtual stage begins."""
FAST = {"doi_mm": 0.86, "speed_mm_s": 0.75}


@pytest.fixture(params=STAGES)
def faulty(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[FaultyBench]:
    """A bench of each stage, ready at x = 0."""
    bench = FaultyBench(tmp_path, {**STAGES[request.param], **NEAR, "limits": {"soft_trip_n": SOFT_TRIP_N}})
    engine = bench.engine
    verbs.mount(engine, "bar:3.0")
    verbs.home(engine)
    verbs.zero(engine)
    verbs.move_to(engine, 0.0)
    yield bench
    bench.journal.close()


def _in_the_ramp(bench: FaultyBench, act: Callable[[], object], from_gwt: float = 2.0) -> None:
    """Act once, when the finger feels this force in the ramp."""

    def watch() -> None:
        if bench.true_n(bench.clock.monotonic_s()) >= from_gwt * GWT_N:
            act()
        else:
            bench.clock.call_at(bench.clock.monotonic_s() + 0.002, watch)

    def begin() -> None:
        bench.worst_n = 0.0  # of the ramp alone
        watch()

    bench.after("ramp", begin)


def _ramp(bench: FaultyBench) -> Any:
    return ramp(bench.engine, **FAST, hold_s=0.1, expected_contact_mm=PREDICTED.contact_mm)


@pytest.mark.quick(rows=lambda faulty, nearer_mm: faulty == "grbl" or (faulty == "rtu" and nearer_mm == 0.6))
@pytest.mark.parametrize("nearer_mm", [0.3, 0.6])
def test_a_finger_that_comes_nearer_in_a_ramp_trips_within_the_force_bound(
    faulty: FaultyBench, nearer_mm: float
) -> None:
    def nearer() -> None:
        faulty.nearer_mm = nearer_mm

    _in_the_ramp(faulty, nearer, 0.3)
    with raises(TripError, "ramp_trip") as caught:
        _ramp(faulty)
    assert printed(caught.value, "exceeds the ramp trip of ", " gwt") < SOFT_TRIP_N / GWT_N
    assert faulty.worst_n / GWT_N <= bound_gwt()
    assert faulty.engine.state is State.TRIPPED
    assert faulty.height_mm == pytest.approx(2.0, abs=0.003)


@pytest.mark.parametrize("late_s", [0.0, 0.5])
@pytest.mark.parametrize("other", OTHERS)
def test_a_ramp_into_an_unmeasured_finger_stops_within_the_stopping_distance(
    other: str, late_s: float, tmp_path: Path
) -> None:
    """The bound of a press holds only for the measured finger; the distance below the trip holds for each."""
    found = ramp_into(OTHERS[other], RampCase("grbl", 10.0, 0.86, 0.95, 0.0, late_s), tmp_path)
    assert found.worst_gwt > found.trip_gwt
    assert 0.0 < found.gone_mm < found.stop_mm


@pytest.mark.quick(rows=lambda faulty: faulty in ("grbl", "standa"))
def test_a_sensor_that_falls_silent_ends_a_ramp_at_once(faulty: FaultyBench) -> None:
    def silent() -> None:
        faulty.force_line.device_write = lambda data: None  # type: ignore[method-assign]

    _in_the_ramp(faulty, silent)
    with pytest.raises(TripError):
        _ramp(faulty)
    assert faulty.worst_n / GWT_N < 10.0 * 0.86**1.5 + 0.1
    assert faulty.height_mm == pytest.approx(2.0, abs=0.003)


@pytest.mark.quick(rows=lambda faulty: faulty in ("grbl", "tmcl"))
def test_a_sensor_that_lost_its_load_cell_ends_a_ramp(faulty: FaultyBench) -> None:
    """Zero from 0.5 gwt on: far less than half a touch, where a finger is."""
    _in_the_ramp(faulty, lambda: setattr(faulty, "felt_n", lambda t_s: 0.0), 0.5)
    with raises(TripError, "lost_finger"):
        _ramp(faulty)
    assert faulty.worst_n / GWT_N < 5.0
    assert faulty.height_mm == pytest.approx(2.0, abs=0.003)


@pytest.mark.quick(
    rows=lambda faulty, stays_gwt, nearer_mm: (
        (faulty, stays_gwt) in (("grbl", 2.0), ("zaber", 5.0)) and (faulty == "grbl" or nearer_mm > 0)
    )
)
@pytest.mark.parametrize("stays_gwt", [2.0, 5.0])
@pytest.mark.parametrize("nearer_mm", [0.0, 0.6])
def test_a_frozen_force_reading_ends_a_ramp(faulty: FaultyBench, stays_gwt: float, nearer_mm: float) -> None:
    """A frozen or saturated sensor that answers in time, far above half a touch and below the trip."""

    def stays() -> None:
        faulty.felt_n = lambda t_s: stays_gwt * GWT_N
        faulty.clock.call_at(faulty.clock.monotonic_s() + 0.05, lambda: setattr(faulty, "nearer_mm", nearer_mm))

    _in_the_ramp(faulty, stays, stays_gwt)
    with raises(TripError, "frozen", force_gwt=stays_gwt):
        _ramp(faulty)
    assert faulty.worst_n / GWT_N <= bound_gwt()


@pytest.mark.quick(rows=lambda faulty: faulty in ("grbl", "rtu"))
def test_a_late_reading_ends_a_ramp_which_is_lifted_and_repeated(faulty: FaultyBench) -> None:
    """The disk is away for 0.45 s: longer than was ever measured. The finger is pressed no deeper than asked."""
    _in_the_ramp(faulty, lambda: faulty.after("ramp", lambda: faulty.clock.wait_s(0.45)))
    done = _ramp(faulty)
    assert done.holds[0].doi_mm == pytest.approx(0.86, abs=0.003)
    assert faulty.journal_path.read_text(encoding="utf-8").count("the ramp is repeated") == 1
    assert faulty.worst_n / GWT_N <= bound_gwt()


@pytest.mark.quick(rows=lambda faulty: faulty in ("grbl", "zaber"))
def test_a_paused_ramp_lifts_and_starts_again(faulty: FaultyBench) -> None:
    """It is then done as any ramp, on every stage."""
    asked: list[bool] = []
    forces: list[float] = []
    faulty.pause = Pause(lambda: bool(asked), lambda meanwhile: not asked.clear())
    _in_the_ramp(faulty, lambda: asked.append(True))
    faulty.on_sample["paused"] = lambda: forces.append(faulty.worst_n / GWT_N)
    done = _ramp(faulty)
    assert 2.0 < forces[0] < 5.0
    holds = faulty.journal_path.read_text(encoding="utf-8").count('"hold": 1, "target"')
    assert holds == 1
    assert done.holds[0].doi_mm == pytest.approx(0.86, abs=0.003)
    assert faulty.worst_n / GWT_N == pytest.approx(10.0 * 0.86**1.5, rel=0.03)
    assert faulty.height_mm == pytest.approx(2.0, abs=0.003)


# --- plan, summary, dry-run, resume ---


def _script(folder: Path, *lines: str) -> Script:
    path = folder / "one.py"
    ready = ('rig.mount("bar:3.0")', "rig.home()", "rig.zero()", "rig.move_to(x_mm=0.0)")
    body = "".join(f"    {line}\n" for line in (*ready, *lines))
    path.write_text(f"from rig.protocol import Rig\n\ndef run(rig: Rig) -> None:\n{body}", encoding="utf-8")
    return load_script(str(path))


def test_the_plan_refuses_a_ramp_that_is_too_fast_and_names_the_fastest_speed(
    finger: Fingertip, tmp_path: Path
) -> None:
    def planned(speed_mm_s: float) -> Plan:
        return make_plan(_script(tmp_path, f"rig.ramp(doi_mm=0.8, speed_mm_s={speed_mm_s})"), Config(), finger)

    with raises(BadInputError, "ramp_too_fast", x_mm=0.0, speed_mm_s=2.0) as caught:
        planned(2.0)
    fastest_mm_s = printed(caught.value, "ramp at most at ", " mm/s")
    assert 0.1 < fastest_mm_s < 2.0
    (ramp_planned,) = planned(fastest_mm_s).indentations
    assert (ramp_planned.ramp_mm_s, ramp_planned.increments) == (fastest_mm_s, 1)
    with raises(BadInputError, "ramp_too_fast"):
        planned(1.01 * fastest_mm_s)


def test_a_ramp_too_fast_for_a_late_sensor_is_refused_where_a_press_is_not(finger: Fingertip, tmp_path: Path) -> None:
    """A press waits for its reading after each increment; a ramp goes on."""
    config = Config.model_validate({"force": {"latency_s": 0.5}})
    with raises(BadInputError, "too_fast_for_sensor", speed_mm_s=1.0):
        make_plan(_script(tmp_path, "rig.ramp(doi_mm=0.4, speed_mm_s=1.0)"), config, finger)
    make_plan(_script(tmp_path, "rig.indent(doi_mm=0.4, speed_mm_s=1.0)"), config, finger)


def test_check_states_the_force_bound_of_each_ramp_and_the_dry_run_stays_below(
    finger: Fingertip, tmp_path: Path
) -> None:
    script = _script(tmp_path, "rig.indent(doi_mm=0.5, hold_s=0.1)", "rig.ramp(doi_mm=0.8, speed_mm_s=0.3)")
    plan = make_plan(script, Config(), finger)
    found = preflight(script, Config(), finger, plan).as_json()
    press, step = found["steps"]
    assert not [key for key in press if key.startswith("ramp_")]
    assert step["ramp_mm_s"] == 0.3 < step["ramp_fastest_mm_s"]
    assert RAMP_MARGIN * step["force_gwt"] < step["ramp_trip_gwt"] < step["ramp_bound_gwt"]
    done = dry_run(Session(script, Config(), finger, plan, NewRun(tmp_path / "runs")))
    assert done.complete, done.problem
    (begun,) = done.run.stream("ramp")
    assert begun["trip_gwt"] == pytest.approx(step["ramp_trip_gwt"], rel=0.1)
    peak_gwt = max(sample["force_gwt"] for sample in done.run.stream("sample"))
    assert peak_gwt <= step["ramp_bound_gwt"]
    assert found["duration_s"] == pytest.approx(done.run.duration_s, rel=0.02)


@pytest.mark.quick(rows=lambda at: at == "ramp")
@pytest.mark.usefixtures("empty_figures")
@pytest.mark.parametrize("at", ["press", "ramp", "hold"])
def test_a_run_that_was_killed_in_a_ramp_repeats_the_ramp(at: str, finger: Fingertip, tmp_path: Path) -> None:
    lines = ["answer = rig.ramp(doi_mm=0.5, speed_mm_s=0.3, hold_s=0.1)", "rig.note(f'{answer.holds[0].doi_mm:.6f}')"]
    script = _script(tmp_path, *lines, "rig.ramp(doi_mm=0.5, speed_mm_s=0.3, hold_s=0.2)")
    config = Config()
    whole = dry_run(Session(script, config, finger, make_plan(script, config, finger), NewRun(tmp_path / "runs")))
    events = whole.folder.events
    documents = events.read_text(encoding="utf-8").splitlines(keepends=True)
    ends = [n for n, line in enumerate(documents) if '"stream": "indentation_end"' in line]
    inside = [n for n, line in enumerate(documents) if f'"phase": "{at}"' in line]
    cut = next(n for n in inside if n > (ends[0] if at == "hold" else -1))
    events.write_text("".join(documents[: cut + 1]), encoding="utf-8")
    stopped = read_stopped(whole.folder.path)
    plan = make_plan(stopped.script, stopped.config, finger, stopped.run, stopped.folder.path)
    again = dry_run(Session(stopped.script, stopped.config, finger, plan, stopped))
    assert again.complete, again.problem
    assert len(again.run.done) == 2
    assert len(again.run.stream("ramp")) == 2
    assert (again.run.restarted, again.run.repeated) == (1, 0)
    assert math.isclose(again.run.done[0][0]["doi_mm"], whole.run.done[0][0]["doi_mm"], abs_tol=0.003)
    assert isinstance(stopped, StoppedRun)
