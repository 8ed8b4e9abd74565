"""A motion sideways ends at a reading that comes too late, and a step of manual control with the contact time."""

import pytest

from rig.devices.base import StageStatus
from rig.engine import LimitError, verbs
from rig.engine.sensing import ForceZero
from tests.rig.hand_bench import KINDS, SessionBench, code_of_end
from tests.stub_bench import StubBench


def test_a_late_reading_halts_a_motion_sideways_which_then_goes_on() -> None:
    """Readings may be 0.2 s apart: two periods of 0.05 s and a look."""
    for late_s, halts in ((0.05, 0), (0.15, 1)):
        bench = StubBench()
        engine = bench.ready()
        bench.stage.told.clear()
        waits_s = [0.0, 0.0, late_s]
        bench.stage.at_look = lambda waits_s=waits_s, clock=bench.clock: clock.wait_s(
            waits_s.pop(0) if waits_s else 0.0
        )
        verbs.move_to(engine, 3.0)
        assert bench.stage.told.count("halt") == halts
        assert engine.x_mm == pytest.approx(3.0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("late_s", "shakes_gwt", "code"),
    [(0.1, 0.0, None), (0.25, 0.0, "late_reading"), (0.0, 1.0, "late_reading")],
    ids=["late by less", "a late reading", "a touch that vanishes at rest"],
)
def test_at_an_unknown_height_a_step_sideways_that_ends_early_says_so(
    kind: str, late_s: float, shakes_gwt: float, code: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Readings may be 0.2 s apart. It is no trip: the next step goes on."""
    bench = SessionBench(kind, zero=ForceZero(0.0, 0.0), known=False)
    stage, clock = bench.bench.stage, bench.clock
    status, from_s, waits_s = stage.status, clock.monotonic_s() + 2.5, [late_s]

    def late() -> StageStatus:
        if clock.monotonic_s() > from_s and waits_s:
            clock.wait_s(waits_s.pop())
        return status()

    def shake(force_gwt: float) -> None:
        bench.spring.offset_gwt = force_gwt

    monkeypatch.setattr(stage, "status", late)
    clock.call_at(from_s, lambda: shake(shakes_gwt))
    clock.call_at(from_s + 0.1, lambda: shake(0.0))
    from_mm = bench.x_mm
    found = bench.step("x", 2.0, 0.5)
    assert code_of_end(found) == code
    made_mm = bench.x_mm - from_mm
    assert made_mm == pytest.approx(2.0, abs=0.003) if code is None else 0.1 < made_mm < 1.5
    assert not bench.session.tripped
    assert code_of_end(bench.step("x", 0.5)) is None


def test_a_step_down_ends_with_the_contact_time_and_lifts_to_clearance() -> None:
    bench = SessionBench("grbl", zero=ForceZero(0.0, 0.0), max_contact_s=1.0)
    assert code_of_end(bench.step("z", -4.0)) == "touched"
    found = bench.step("z", -1.0)
    assert code_of_end(found) == "contact_time"
    assert isinstance(found.ended_by, LimitError)
    assert found.known.kind == "lifted"
    assert bench.height_mm == pytest.approx(bench.config.habits.clearance_mm, abs=0.02)


@pytest.mark.parametrize("zero", [ForceZero(0.0, 0.0), None], ids=["zeroed", "before the first zero"])
def test_at_an_unknown_height_a_contact_time_that_is_over_ends_the_way_down(zero: ForceZero | None) -> None:
    """Between two steps nothing moves by itself; the next one down is refused, and one under way lifts."""
    for wait_s, code in ((2.0, None), (0.0, "contact_time")):
        bench = SessionBench("grbl", zero=zero, above_mm=0.4, max_contact_s=1.0)
        bench.bench.stage.stop()
        bench.bench.stage.connect()
        bench.bench.stage.unlock()
        assert code_of_end(bench.step("z", -1.0)) == "touched"
        touched_mm = bench.height_mm
        if wait_s:
            bench.clock.wait_s(wait_s)
            with pytest.raises(LimitError) as refused:
                bench.step("z", -0.05)
            assert refused.value.code == "contact_time"
            assert bench.height_mm == pytest.approx(touched_mm)
        else:
            found = bench.step("z", -0.3, 0.1)
            assert code_of_end(found) == code
            assert bench.height_mm > touched_mm + 0.3
            assert isinstance(found.ended_by, LimitError)
            assert not bench.session.tripped
        bench.step("z", 2.0)
        assert code_of_end(bench.step("z", -0.05)) is None, "a new contact counts from zero"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("known", [True, False], ids=["height known", "height unknown"])
def test_after_the_lift_of_the_contact_time_the_way_down_begins_anew(kind: str, known: bool) -> None:
    """What was touched before the lift is no finger lost."""
    bench = SessionBench(kind, zero=ForceZero(0.0, 0.0), above_mm=0.4, max_contact_s=1.0, known=known)
    for by_mm, speed_mm_s, code in ((-1.0, 2.0, "touched"), (-0.3, 0.1, "contact_time")):
        assert code_of_end(bench.step("z", by_mm, speed_mm_s)) == code
    assert bench.height_mm > 0.3
    assert code_of_end(bench.step("z", 0.1 - bench.height_mm)) is None, "in the air"
    assert code_of_end(bench.step("z", -0.5)) == "touched"
