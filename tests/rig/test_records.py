"""What every journalled event has in common, and what is done wherever an operator may pause a press."""

from collections.abc import Callable
from typing import Any

import pytest

from rig.data.events import EVENTS, columns_of, stream_of
from rig.engine import Pause, Target, indent
from rig.engine.indentation import touch_place
from rig.engine.reference import measure_compliance
from rig.engine.verbs import unpaused
from rig.errors import PressPaused
from tests.stub_bench import StubBench

Make = Callable[..., Any]


def test_every_journaled_force_is_rounded_alike() -> None:
    """Each force of each stream: hold_start, trip and threshold once went in as they were."""
    bench = StubBench()
    for event in EVENTS:
        columns = columns_of(event)
        bench.engine.record(event(**{column.name: 1 / 3 for column in columns}))
        fine = {column.name: 0.333333 if column.unit == "gwt" else 1 / 3 for column in columns}
        assert bench.events[-1] == (stream_of(event), fine)


PRESSES: dict[str, Callable[[Any], object]] = {
    "indent": lambda engine: indent(engine, Target("force_gwt", 3.0), hold_s=0.2),
    "touch_place": lambda engine: touch_place(engine, 0, 0.0),
    "measure_compliance": lambda engine: measure_compliance(engine, 5.0),
}


@pytest.mark.parametrize("press", PRESSES)
@pytest.mark.parametrize("pauses", [1, 3])
def test_a_press_paused_at_any_reading_starts_again(spring: Make, press: str, pauses: int) -> None:
    """Wherever a press may be paused: the pause is over when the operator goes on, and none of it gets out."""
    bench = spring(k_gwt=400.0 if press == "measure_compliance" else 6.0)
    engine, left = bench.ready(), [None] * pauses

    def asked() -> bool:
        return bool(left) and engine.height_mm < 1.0

    bench.pause = Pause(asked, lambda meanwhile: (left.pop(), True)[1])
    PRESSES[press](engine)
    assert not left
    assert [stream for stream, _ in bench.events].count("resumed") == pauses
    assert engine.height_mm == pytest.approx(engine.settings.habits.clearance_mm)


def test_a_press_repeats_after_pauses_and_other_errors_propagate() -> None:
    done: list[int] = []

    def press() -> int:
        done.append(1)
        if len(done) < 3:
            raise PressPaused("by the operator")
        return len(done)

    assert unpaused(press) == 3
    with pytest.raises(ValueError, match="else"):
        unpaused(lambda: (_ for _ in ()).throw(ValueError("else")))
