"""What is known about contact: the predicates, the record of it, and every place that mentions it."""

import math
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.bench.checks import contact_as_json
from rig.data.run import read_run
from rig.engine import Engine, RecordError, RunAborted, indent, verbs
from rig.engine.bench_memory import BenchMemory
from rig.engine.contact import KINDS, ContactKind, ContactRecord, KnownContact, contact_kind
from rig.engine.contact_words import DOES_NOT_TOUCH, MAY_TOUCH
from rig.engine.motion import DOWN, UP, Direction
from rig.engine.sensing import Sensing
from rig.engine.steps import Steps
from rig.manual.status import ManualStatus
from rig.plan.config import Config
from rig.session.early_ending import Ending, FinalPosition
from rig.session.resume import careful_of, left_on_record
from sim.devices.clock import VirtualClock
from studies.faults.faulty_bench import PREDICTED, SOFT_TRIP_N, TARGET, FaultyBench
from tests.error_codes import raises
from tests.rig.test_last_ending import run
from tests.stub_bench import KeptMemory

FORCES: dict[ContactKind, float | None] = {
    "lifted": 0.02, "raised": None, "disagreement": 3.6, "touching": 5.0, "unknown": 0.01
}  # fmt: skip


# --- the predicates ---


@given(st.booleans(), st.none() | st.floats(-500, 500), st.floats(0.01, 1.0))
def test_a_finger_counts_as_lifted_only_at_clearance_with_a_force_below_touch(
    clear: bool, force_gwt: float | None, touch_gwt: float
) -> None:
    found = KnownContact(contact_kind(clear=clear, force_gwt=force_gwt, touch_gwt=touch_gwt), force_gwt)
    confirmed = clear and force_gwt is not None and abs(force_gwt) < touch_gwt
    assert found.may_touch is not confirmed
    assert (found.to_do is None) is confirmed


@pytest.mark.parametrize(
    ("kind", "age_s", "trusted", "then"),
    [
        ("lifted", 0.9, True, "lifted"),
        ("lifted", 1.1, True, "raised"),
        ("lifted", -0.1, True, "raised"),  # the clock jumped back
        ("lifted", 0.9, False, "unknown"),
        ("raised", 1.1, True, "raised"),
        ("raised", 0.9, False, "unknown"),
        ("disagreement", 1.1, True, "disagreement"),
        ("disagreement", 0.9, False, "touching"),
        ("touching", 1.1, True, "touching"),
        ("touching", 1.1, False, "touching"),
        ("unknown", 1.1, True, "unknown"),
    ],
)
def test_a_measurement_of_contact_is_lifted_for_a_second_where_the_position_is_trusted(
    kind: ContactKind, age_s: float, trusted: bool, then: ContactKind
) -> None:
    found = KnownContact(kind, FORCES[kind]).after(age_s, trusted=trusted)
    assert found.kind == then
    assert found.aged is (age_s != 0.9 and FORCES[kind] is not None)


@pytest.mark.parametrize(
    ("may_touch", "kind", "gwt", "after_s", "then", "renewed"),
    [
        (False, "lifted", 0.02, 0.9, "lifted", True),
        (False, "lifted", 0.02, 1.1, "lifted", False),
        (False, "lifted", -0.06, 1.1, "disagreement", True),
        (True, "lifted", 0.06, 0.5, "lifted", False),
        (True, "lifted", 0.02, 0.5, "lifted", False),
        (False, "raised", 0.02, 0.5, "raised", False),
    ],
)
def test_a_reading_at_clearance_renews_or_ends_a_lift_and_below_clearance_neither(
    may_touch: bool, kind: ContactKind, gwt: float, after_s: float, then: ContactKind, renewed: bool
) -> None:
    before = ContactRecord(KnownContact(kind), 100.0, may_touch=may_touch)
    found = before.after_reading(KnownContact("lifted", gwt), 100.0 + after_s, 0.05)
    assert (found.measured.kind, found.measured_s) == (then, 100.0 + after_s * renewed)


# --- every place that mentions it ---


@pytest.fixture
def settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Config:
    """Of a bench that nobody has used."""
    monkeypatch.setenv("RIG_STATE_DIR", str(tmp_path / "state"))
    return Config.model_validate({"stage": {"port": "here"}})


def _known(kind: ContactKind) -> KnownContact:
    return KnownContact(kind, FORCES[kind], 0.5, 2.0 if kind in ("lifted", "raised", "disagreement") else -1.0, 1.7e9)


class Stage:
    """Homed."""

    homed = True


def _engine_that(known: KnownContact) -> Engine:
    """It knows this."""
    engine = Engine.__new__(Engine)
    bench = FaultyBench.__new__(FaultyBench)
    bench.stage = Stage()  # type: ignore[assignment]
    engine.settings, engine.bench = Config(), bench
    engine.state, engine.clock = verbs.State.READY, VirtualClock(1.7e9)
    engine.contact = ContactRecord(known, engine.clock.monotonic_s(), at_rest=True, may_touch=known.may_touch)

    class Motion:
        begun, x_mm, along_mm, height_mm = True, known.x_mm, 0.0, known.height_mm

    engine.motion = Motion()  # type: ignore[assignment]
    return engine


def _whereabouts(known: KnownContact) -> FinalPosition:
    """As a run's end has it of an engine that knows this."""
    return FinalPosition.of(_engine_that(known))


def _on_record(settings: Config, known: KnownContact) -> None:
    memory = BenchMemory(settings)
    memory.touched(KnownContact("unknown"))
    memory.touched(known)


def _ended(settings: Config, known: KnownContact, tmp_path: Path) -> str:
    told = Ending.of(RunAborted("x"), _whereabouts(known), tmp_path).lines
    return f"{told['where']}; {told['next']}"


def _shown(settings: Config, known: KnownContact, tmp_path: Path) -> str:
    """Of a journal, as `rig show` and `rig resume` read it."""
    folder = run(tmp_path / "runs", "1", asdict(_whereabouts(known)))
    stop = read_run(folder).stop
    assert stop is not None
    return FinalPosition(**stop["indentor"]).words


def _panel(settings: Config, known: KnownContact, tmp_path: Path) -> str:
    clock = VirtualClock(1.7e9)
    bench = FaultyBench(tmp_path, {})
    status = ManualStatus(settings, clock, Sensing(settings, clock, bench.force))
    status.contact = BenchMemory(settings).read().contact
    bench.journal.close()
    return str(status.as_json(stopped=False, since=None)["contact"]["where_text"])


PLACES: dict[str, Callable[[Config, KnownContact, Path], str]] = {
    "the outcome of run, dry-run, resume and stop, and the report": _ended,
    "rig show, of a journal": _shown,
    "rig status of a bench that cannot be measured": lambda settings, known, tmp_path: contact_as_json(
        BenchMemory(settings).read().aged_contact(None)
    )["where_text"],
    "rig home, rig jog": lambda settings, known, tmp_path: known.as_json()["where_text"],
    "rig doctor, and the page of run": lambda settings, known, tmp_path: str(left_on_record(tmp_path, settings)),
    "the page of resume": lambda settings, known, tmp_path: str(careful_of(None, settings)),
    "the panel before its first readings": _panel,
}
FRESH = (
    "the outcome of run, dry-run, resume and stop, and the report",
    "rig show, of a journal",
    "rig home, rig jog",
)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("place", PLACES)
def test_every_report_of_contact_states_only_what_was_measured_and_when(
    settings: Config, tmp_path: Path, place: str, kind: ContactKind
) -> None:
    """Of another process's measurement: when it was made, and never that the finger is not touched."""
    known = _known(kind)
    _on_record(settings, known)
    said = PLACES[place](settings, known, tmp_path)
    assert said == "None" or f"x = 0.50 mm, {abs(known.height_mm or 0.0):.2f} mm " in said
    assert (DOES_NOT_TOUCH in said) is (kind == "lifted" and place in FRESH)
    assert (MAY_TOUCH in said) is (kind != "lifted" or (place not in FRESH and said != "None"))
    if kind in ("disagreement", "touching"):
        assert f"{FORCES[kind]:.2f} gwt" in said
    if FORCES[kind] is None:
        assert "last measured" not in said, "no force was"
    if kind == "raised" and place in FRESH:
        assert "not confirmed by force" in said
    if place not in FRESH and said != "None" and FORCES[kind] is not None:
        assert "last measured at 2023-11-1" in said
        assert "unknown since because a finger moves" in said


# --- the record ---


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("before", [None, *KINDS])
def test_only_a_confirmed_lift_is_recorded_as_lifted(
    settings: Config, before: ContactKind | None, kind: ContactKind
) -> None:
    memory = BenchMemory(settings)
    if before is not None:
        memory.touched(KnownContact("unknown"))
        memory.touched(KnownContact(before))
    memory.touched(KnownContact(kind))
    contact = memory.read().contact
    assert contact is not None
    stays = before == "lifted" and kind == "raised"  # a position alone; it was never below clearance since
    assert contact.kind == ("lifted" if stays else kind)


def test_a_contact_record_that_cannot_be_written_never_keeps_saying_lifted(
    settings: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    memory = BenchMemory(settings)
    memory.touched(KnownContact("lifted"))
    monkeypatch.setattr(Path, "open", full)
    memory.touched(KnownContact("unknown"))
    assert memory.read().contact is None, "the disk lets the file go"
    monkeypatch.undo()
    monkeypatch.setenv("RIG_STATE_DIR", str(tmp_path / "state"))
    memory.touched(KnownContact("lifted"))
    monkeypatch.setattr(Path, "open", full)
    monkeypatch.setattr(Path, "unlink", full)
    with raises(RecordError, "says_not_touched"):
        memory.touched(KnownContact("unknown"))


@pytest.fixture
def bench(tmp_path: Path, settings: Config) -> FaultyBench:
    """Ready at x = 0."""
    found = FaultyBench(tmp_path, {"stage": {"port": "here"}, "limits": {"soft_trip_n": SOFT_TRIP_N}})
    found.engine.memory = BenchMemory(settings)
    verbs.mount(found.engine, "bar:3.0")
    verbs.home(found.engine)
    verbs.zero(found.engine)
    verbs.move_to(found.engine, 0.0)
    return found


def test_a_contact_left_by_a_killed_run_stays_on_record_until_a_confirmed_homing(
    bench: FaultyBench, settings: Config, tmp_path: Path
) -> None:
    class Killed(BaseException):
        pass

    def kill() -> None:
        raise Killed

    bench.after("press", kill)
    with pytest.raises(Killed):
        indent(bench.engine, TARGET, hold_s=0.5, expected_contact_mm=PREDICTED.contact_mm)
    zero = bench.engine.sensing.zero
    run(tmp_path / "runs", "2", {"left": "not moved", "may_touch": None})
    assert MAY_TOUCH in str(left_on_record(tmp_path / "runs", settings))
    again = bench.engine = Engine(bench.config, bench, bench.journal, SOFT_TRIP_N, memory=BenchMemory(settings))
    again.sensing.zero = zero
    verbs.home(again)
    assert left_on_record(tmp_path / "runs", settings) is None
    bench.journal.close()


def test_a_step_down_is_recorded_before_it_moves_and_a_confirmed_step_up_clears_the_record(
    bench: FaultyBench, settings: Config
) -> None:
    memory, kept, engine = BenchMemory(settings), list[tuple[str, bool]](), bench.engine
    steps, at_mm = Steps(engine), bench.height_mm

    def keep(known: KnownContact) -> None:
        kept.append((known.kind, math.isclose(bench.height_mm, at_mm, abs_tol=1e-3)))
        memory.touched(known)

    engine.memory = KeptMemory(touched=keep)
    steps.make(Direction("x", 1), 1.0, 5.0)
    assert {kind for kind, _ in kept} == {"lifted"}, "sideways at clearance nothing is doubtful"
    kept.clear()
    steps.make(DOWN, 1.0, 1.0)
    assert ("unknown", True) in kept
    assert MAY_TOUCH in str(left_on_record(Path("none"), settings))
    steps.make(UP, 4.0, 5.0)
    assert kept[-1][0] == "lifted"
    assert left_on_record(Path("none"), settings) is None
    bench.journal.close()


# --- what the engine does of it ---
