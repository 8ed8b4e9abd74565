"""The numbers a press goes by, each where it alone decides: how near to a trip, how long unanswered, how far."""

import contextlib
from collections.abc import Callable, Mapping
from itertools import groupby, pairwise
from typing import Any

import pytest

from rig.engine import LimitError, Target, TripError, indent
from rig.engine.errors import EngineError
from rig.engine.rig_settings import RigSettings

Make = Callable[..., Any]


def _samples(bench: Any, phase: str) -> list[dict[str, Any]]:
    return [event for event in bench.of("sample") if event["phase"] == phase]


def _heights(bench: Any) -> list[float]:
    """From the last reading of the touch on, mm."""
    return [event["height_mm"] for event in _samples(bench, "touch")[-1:] + _samples(bench, "press")]


def _freeze(bench: Any, when: Callable[[dict[str, Any]], bool]) -> None:
    """From the first reading of a press on that `when` likes, the balance shows what it shows."""
    live = bench.force_n

    def look(stream: str, data: Mapping[str, Any]) -> None:
        if stream == "sample" and data["phase"] == "press" and when(dict(data)):
            bench.on_event = lambda stream, data: None
            held = live(bench.clock.monotonic_s())
            bench.force_n = lambda t_s: held

    bench.on_event = look


# --- near a trip ---


def test_a_press_goes_nine_tenths_of_the_way_to_a_trip_at_a_time_and_never_past_it(spring: Make) -> None:
    """6 gwt at 1 mm, a trip of 2.09: each move leaves a tenth of the way, until a tenth is less than a step."""
    bench = spring(soft_trip_n=0.0205)
    with pytest.raises(LimitError, match=r"the next move at x = 0 mm would pass the soft trip, 2\.09 gwt"):
        indent(bench.ready(), Target("doi_mm", 1.0))
    trip_mm = -0.3 - (0.0205 / 9.80665e-3 / 6.0) ** (1 / 1.5)
    left = [height - trip_mm for height in _heights(bench)]
    assert left[-1] == pytest.approx(0.0, abs=0.0025)
    near = next(later / earlier for earlier, later in pairwise(left) if earlier < 0.06)
    assert near == pytest.approx(0.1, abs=0.03)
    assert max(e["force_gwt"] for e in bench.of("sample")) <= 0.0205 / 9.80665e-3


# --- a force that does not answer ---


def test_three_moves_unanswered_are_enough_where_each_should_have_shown(spring: Make) -> None:
    bench = spring()
    engine = bench.ready()
    _freeze(bench, lambda data: data["force_gwt"] > 0.5)
    with pytest.raises(TripError, match="the force stays at"):
        indent(engine, Target("doi_mm", 1.0))
    assert _unanswered(bench) == 3


def test_small_moves_may_stay_unanswered_until_a_tenth_of_the_force_is_missing(spring: Make) -> None:
    """At 47.23 gwt, 1.27 short of the target: every move expects that much, and four are more than 4.72."""
    bench = spring(k_gwt=60.0)
    engine = bench.ready()
    _freeze(bench, lambda data: data["force_gwt"] >= 47.0)
    with pytest.raises(TripError, match=r"the force stays at 47\.23 gwt"):
        indent(engine, Target("force_gwt", 48.5))
    assert _unanswered(bench) == 4


def test_a_light_force_may_stay_unanswered_for_five_steps_of_the_sensor(spring: Make) -> None:
    """At 0.06 gwt and 0.153 mm, 0.01 mm at a time: 0.0059 … 0.0045 gwt each, and ten are more than 0.05."""
    bench = spring(k_gwt=1.0, settings=RigSettings.model_validate({"habits": {"increment_mm": 0.01}}))
    engine = bench.ready()
    _freeze(bench, lambda data: data["force_gwt"] >= 0.06)
    with pytest.raises(TripError, match=r"the force stays at 0\.06 gwt"):
        indent(engine, Target("doi_mm", 1.0))
    assert _unanswered(bench) == 10


def _unanswered(bench: Any) -> int:
    """Moves after which the last force was shown again."""
    shown = [event["force_gwt"] for event in _samples(bench, "press")]
    return shown.count(shown[-1]) - 1


# --- towards a force ---


def _gaps(spring: Make, target_gwt: float) -> list[float]:
    """What is still missing after each move, on a finger of 60 gwt at 1 mm that follows the law."""
    bench = spring(k_gwt=60.0)
    indent(bench.ready(), Target("force_gwt", target_gwt), hold_s=0.1)
    return [target_gwt - event["force_gwt"] for event in _samples(bench, "press")]


def test_a_gap_wider_than_a_twentieth_is_closed_by_three_quarters_and_a_narrower_one_at_once(spring: Make) -> None:
    *_, wide, narrow, end = _gaps(spring, 6.5)
    assert wide > 0.05 * 6.5
    assert narrow / wide == pytest.approx(0.3, abs=0.1)
    assert 0.03 * 6.5 < narrow < 0.05 * 6.5
    assert abs(end) < 0.1 * narrow


@pytest.mark.parametrize(("target_gwt", "left_gwt"), [(48.05, 0.20), (2.21, 0.02)])
def test_what_is_within_half_of_the_tolerance_is_left_as_it_is(
    spring: Make, target_gwt: float, left_gwt: float
) -> None:
    """1 % of 48.05 gwt, or 0.05 gwt where that is more: half of it is 0.24 and 0.025 gwt."""
    assert _gaps(spring, target_gwt)[-1] == pytest.approx(left_gwt, abs=0.006)


# --- noise ---


def test_no_more_than_twenty_five_readings_are_averaged(spring: Make) -> None:
    """Noise of 0.3 gwt would ask for hundreds, to know 20 gwt to a quarter of the tolerance."""
    bench = spring(k_gwt=60.0)
    engine = bench.ready()
    engine.sensing.take_zero([-0.3, 0.3])
    with contextlib.suppress(EngineError):
        indent(engine, Target("force_gwt", 20.0), hold_s=0.1)
    heights = [event["height_mm"] for event in _samples(bench, "press")]
    assert max(len(list(same)) for _, same in groupby(heights)) == 25
