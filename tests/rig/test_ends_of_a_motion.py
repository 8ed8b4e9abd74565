"""A motion sideways ends at a reading that comes too late, and a step of manual control with the contact time."""

import pytest

from rig.engine import LimitError, verbs
from rig.engine.sensing import ForceZero
from tests.rig.hand_bench import SessionBench, code_of_end
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
        bench.step("z", 2.0)
        assert code_of_end(bench.step("z", -0.05)) is None, "a new contact counts from zero"
