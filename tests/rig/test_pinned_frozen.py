"""A force that does not answer the stage: how much may be missing, and for how many moves, before it trips."""

import pytest

from rig.engine import Target, TripError
from rig.engine.pressing.press import Press
from tests.rig.plain_bench import pressing, shows


def _made(press: Press, doi_mm: float, moves: int, step_mm: float) -> int:
    """How many moves of so many were made, each to a depth of its own; a trip ends them, and counts."""
    for k in range(1, moves + 1):
        try:
            press.hold_at(Target("doi_mm", doi_mm + k * step_mm), hold=k, hold_s=0.0)
        except TripError as error:
            assert "the force stays at" in str(error)  # noqa: PT017
            return k
    return moves


LATE = [
    # each should have shown 0.31 gwt, more than a tenth of 2 gwt: three moves are the least
    (2.0, 0.5, 0.05, 3),
    # 0.030 gwt each: the seventh passes a tenth of 2 gwt
    (2.0, 1.0, 0.01, 7),
    (2.0, 1.0, -0.01, 7),
    # 0.025, 0.016 and 0.012 gwt: together more than five steps of the sensor, 0.05 gwt
    (0.03, 0.1, 0.05, 3),
    # 0.0062 gwt each down, and less and less: the ninth passes 0.05 gwt; up, the eighth
    (0.2, 0.5, 0.0103, 9),
    (0.2, 0.5, -0.0103, 8),
]


@pytest.mark.parametrize(("gwt", "doi_mm", "step_mm", "trips_at"), LATE)
def test_a_frozen_reading_trips_when_what_is_missing_cannot_be_missed(
    gwt: float, doi_mm: float, step_mm: float, trips_at: int
) -> None:
    """From the first move after the touch on."""
    bench, press = pressing(shows(gwt), doi_mm)
    assert _made(press, doi_mm, 12, step_mm) == trips_at
    assert [event["force_gwt"] for event in bench.of("trip")] == [gwt]


@pytest.mark.parametrize(("gwt", "doi_mm", "step_mm", "trips_at"), LATE)
def test_a_reading_that_changes_just_in_time_is_alive(
    gwt: float, doi_mm: float, step_mm: float, trips_at: int
) -> None:
    """By one step of the sensor; what was missing before it is forgotten."""
    bench, press = pressing(lambda bench: gwt + 0.01 * (bench.stage.moves // trips_at % 2), doi_mm)
    assert _made(press, doi_mm, trips_at + 3, step_mm) == trips_at + 3
    assert not bench.of("trip")


@pytest.mark.parametrize(("change_gwt", "trips"), [(0.004, True), (0.006, False), (-0.006, False)])
def test_less_than_half_a_step_of_the_sensor_is_no_answer(change_gwt: float, trips: bool) -> None:
    bench, press = pressing(lambda bench: 2.0 + change_gwt * (bench.stage.moves % 2), 0.5)
    assert _made(press, 0.5, 6, 0.05) == (3 if trips else 6)
    assert bool(bench.of("trip")) == trips
