"""From clearance to the skin: where contact is looked for, what counts as contact, what is journalled of it."""

import itertools
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import pytest

from rig.engine import PressId, TripError
from rig.engine.indentation import Approach
from tests.error_codes import has_code, raises
from tests.rig.plain_bench import PlainBench

Felt = Callable[[PlainBench], float]
CONTACT_MM = -0.3


def _finger(bench: PlainBench) -> float:
    return round(bench.hertz(6.0, CONTACT_MM), 2)


def _bench(felt: Felt = _finger, settings: dict[str, Any] | None = None, **options: Any) -> PlainBench:
    return PlainBench(felt, settings or {}, **options)


@pytest.mark.parametrize(("lowest_mm", "last_mm"), [(-0.5, -0.5), (-0.524, -0.5), (0.2, 0.2), (0.151, 0.2)])
def test_the_approach_searches_down_to_the_lowest_height_and_no_farther(lowest_mm: float, last_mm: float) -> None:
    """By increments of 0.05 mm from clearance, 2 mm."""
    bench = _bench(lambda bench: 0.0)
    with raises(TripError, "no_contact", x_mm=0.0, lowest_mm=lowest_mm):
        Approach(bench.ready(), PressId(0), lowest_mm, 3.0).touch_off(None)
    heights = [height for height, _ in bench.readings("approach")]
    assert heights[-1] == pytest.approx(last_mm)
    assert [a - b for a, b in itertools.pairwise([2.0, *heights])] == pytest.approx([0.05] * len(heights))


@pytest.mark.parametrize(("highest_mm", "trips"), [(0.79, True), (0.81, False)])
def test_contact_above_the_highest_expected_height_trips(highest_mm: float, trips: bool) -> None:
    """The first reading of contact is at 0.8 mm."""
    bench = _bench(lambda bench: 0.2 if bench.height_mm < 0.805 else 0.0)
    approach = Approach(bench.ready(), PressId(0), -0.5, highest_mm)
    if trips:
        with raises(TripError, "contact_too_high", x_mm=0.0, height_mm=0.8, highest_mm=0.79):
            approach.touch_off(None)
    else:
        assert approach.touch_off(None).height_at_threshold_mm == pytest.approx(0.8)


@pytest.mark.parametrize(
    ("gwt", "noise_gwt", "touched"),
    [(0.05, 0.0, True), (0.04, 0.0, False), (0.12, 0.02, True), (0.11, 0.02, False)],
)
def test_contact_needs_the_threshold_or_6_sd_and_an_equal_negative_force_trips(
    gwt: float, noise_gwt: float, touched: bool
) -> None:
    for sign in (1, -1):
        bench = _bench(lambda bench, sign=sign: sign * gwt if bench.height_mm < 0.005 else 0.0)  # type: ignore[misc]
        approach = Approach(bench.ready(noise_gwt), PressId(0), -0.2, 0.2)
        if touched and sign > 0:
            assert approach.touch_off(None).threshold_gwt == gwt
            continue
        with pytest.raises(TripError) as trip:
            approach.touch_off(None)
        has_code(trip.value, "reads_backwards" if touched else "no_contact")
        assert bench.of("trip")[0]["force_gwt"] == (-gwt if touched else None)


@pytest.mark.parametrize(
    ("left_gwt", "noise_gwt", "heights_mm"),
    [
        # as long as half a step of the sensor or more shows, at 0 here and up to 0.1; then one more, unread
        (0.01, 0.0, [0.05, 0.1, 0.15]),
        (0.004, 0.0, [0.05]),
        # of a noise of 0.02, six times that: 0.06 is half
        (0.065, 0.02, [0.05, 0.1, 0.15]),
        (0.055, 0.02, [0.05]),
    ],
)
def test_the_fine_descent_begins_one_increment_above_the_lowest_reading_without_force(
    left_gwt: float, noise_gwt: float, heights_mm: list[float]
) -> None:
    bench = _bench(lambda bench: 0.5 if bench.height_mm < 0.005 else left_gwt if bench.height_mm < 0.105 else 0.0)
    Approach(bench.ready(noise_gwt), PressId(0), -0.5, 0.5).touch_off(None)
    assert [height for height, _ in bench.readings("back off")] == pytest.approx(heights_mm)
    assert bench.readings("touch")[0][0] == pytest.approx(heights_mm[-1] + 0.05 - 0.01)


def _dies(bench: PlainBench) -> float:
    """A finger that is felt once, by a sensor that shows nothing from then on."""
    return 0.0 if any(gwt >= 0.05 for _, gwt in bench.readings("approach")) else _finger(bench)


@pytest.mark.parametrize(
    ("lowest_mm", "said_mm", "last_mm", "again"),
    [
        (-0.5, -0.4, -0.4, True),
        (-0.405, -0.4, -0.4, True),
        (-0.384, -0.384, -0.38, False),
        (-0.35, -0.35, -0.35, False),
    ],
)
def test_the_fine_descent_finds_contact_within_an_increment_of_the_coarse_one_or_trips(
    lowest_mm: float, said_mm: float, last_mm: float, again: bool
) -> None:
    """Felt at -0.35 mm, the first increment that shows 0.05 gwt; the fine descent goes on to -0.4 mm at most."""
    bench = _bench(_dies)
    with raises(TripError, "no_contact", x_mm=0.0, lowest_mm=said_mm) as missed:
        Approach(bench.ready(), PressId(0), lowest_mm, 0.2).touch_off(None)
    assert ("showed a touch there just before" in str(missed.value)) is again
    assert bench.readings("approach")[-1][0] == pytest.approx(-0.35)
    assert bench.readings("touch")[-1][0] == pytest.approx(last_mm)


@pytest.mark.parametrize(
    ("lowest_mm", "last_mm", "found"), [(-0.5, -0.37, True), (-0.37, -0.37, True), (-0.36, -0.36, False)]
)
def test_after_a_false_touch_the_fine_descent_searches_one_increment_deeper(
    lowest_mm: float, last_mm: float, found: bool
) -> None:
    """Noise touches at -0.3 mm; an increment below, the finger shows 0.02 gwt, and 0.05 gwt at -0.37 mm.

    Never below the lowest height.
    """

    def felt(bench: PlainBench) -> float:
        early = bench.height_mm < -0.295 and not bench.readings("back off")
        return 0.06 if early else round(bench.hertz(6.0, -0.33), 2)

    bench = _bench(felt)
    approach = Approach(bench.ready(), PressId(0), lowest_mm, 0.5)
    with nullcontext() if found else raises(TripError, "no_contact", lowest_mm=lowest_mm):
        approach.touch_off(None)
    assert bench.readings("approach")[-1][0] == pytest.approx(-0.3)
    assert bench.readings("touch")[-1][0] == pytest.approx(last_mm)
