"""Past the touch a finger is felt: a reading that hardly shows it, or pulls, trips an increment deeper."""

import pytest

from rig.engine import Target, TripError
from tests.rig.plain_bench import pressing, shows

TOUCHED_MM = 0.1


@pytest.mark.parametrize(
    ("gwt", "deeper_mm", "trips"),
    [
        # the touch threshold is 0.05 gwt: half of it an increment deeper is a finger, less is none
        (0.024, 0.05, True), (0.026, 0.05, False), (0.0, 0.05, True), (-0.3, 0.05, True),
        (0.024, 0.0475, False), (0.024, 0.02, False),  # not yet an increment
        (0.0, 0.1, True), (0.024, -0.05, False),  # going up it may well be gone
    ],
)  # fmt: skip
def test_a_finger_that_was_touched_is_felt_an_increment_deeper(gwt: float, deeper_mm: float, trips: bool) -> None:
    bench, press = pressing(shows(0.06, gwt), TOUCHED_MM)
    try:
        press.hold_at(Target("doi_mm", TOUCHED_MM + deeper_mm), hold=1, hold_s=0.0)
    except TripError as error:
        assert f"{gwt:.2f} gwt, 0.05 mm below the touch: a dead sensor, one that reads" in str(error)  # noqa: PT017
    assert [event["force_gwt"] for event in bench.of("trip")] == [gwt] * trips


def test_it_is_watched_for_in_a_hold_too() -> None:
    bench, press = pressing(lambda bench: 0.0 if bench.of("hold_start") else 0.2, TOUCHED_MM)
    with pytest.raises(TripError, match="below the touch: a dead sensor"):
        press.hold_at(Target("doi_mm", TOUCHED_MM + 0.1), hold=1, hold_s=0.5)
    assert bench.of("hold_start")
