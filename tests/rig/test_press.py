"""A press past the skin: the numbers that it goes by, each worked out by hand where it alone decides."""

import contextlib
import itertools

import pytest

from rig.engine import LimitError, Target, TripError
from rig.engine.press import Press
from tests.error_codes import has_code, raises
from tests.rig.plain_bench import PlainBench, pressing, shows

NOISE_OF_16 = 0.05  # gwt: 16 readings know 2 gwt to a quarter of its tolerance, 0.0125


def _steps_mm(bench: PlainBench, doi_mm: float, phase: str = "press") -> list[float]:
    """How far each move of a phase went down, from where the press began."""
    heights = [-doi_mm, *(height for height, _ in bench.readings(phase))]
    return [a - b for a, b in itertools.pairwise(heights) if a != b]


# --- to a depth ---


@pytest.mark.parametrize(("steps", "moves"), [(0.45, 0), (-0.45, 0), (0.55, 1), (-0.55, 1), (20.0, 1), (21.0, 2)])
def test_a_press_reaches_a_depth_within_half_a_motor_step_in_moves_of_an_increment(steps: float, moves: int) -> None:
    """A step is 0.0025 mm, an increment 0.05 mm."""
    bench, press = pressing(lambda bench: bench.hertz(6.0, 0.0), 0.5)
    hold = press.hold_at(Target("doi_mm", 0.5 + steps * 0.0025), hold=1, hold_s=0.1)
    assert bench.stage.moves == moves
    assert hold.doi_mm == pytest.approx(0.5 + steps * 0.0025 if moves else 0.5, abs=1e-9)


def test_a_move_up_within_a_press_is_no_longer_than_an_increment() -> None:
    bench, press = pressing(lambda bench: bench.hertz(6.0, 0.0), 0.5)
    press.hold_at(Target("doi_mm", 0.38), hold=1, hold_s=0.1)
    assert _steps_mm(bench, 0.5) == pytest.approx([-0.05, -0.05, -0.02])


def test_a_depth_that_a_compliant_rig_never_reaches_ends_after_400_moves() -> None:
    """1 mm/N: between 1.0 and 1.6 gwt it gives 0.006 mm, more than a step."""
    gives = {"compliance_mm_per_n": {"value": 1.0, "date": "2026-01-01", "expires": "2027-01-01"}}
    bench, press = pressing(lambda bench: (1.0, 1.6)[bench.stage.moves % 2], 0.5, settings={"calibration": gives})
    with raises(LimitError, "doi_not_reached", doi_mm=0.6, moves=400):
        press.hold_at(Target("doi_mm", 0.6), hold=1, hold_s=0.1)
    assert bench.stage.moves == 400


@pytest.mark.parametrize(("max_doi_mm", "refused"), [(0.55, False), (0.549, True)])
def test_the_deepest_depth_allowed_may_be_reached_and_not_passed(max_doi_mm: float, refused: bool) -> None:
    bench, press = pressing(lambda bench: bench.hertz(6.0, 0.0), 0.5, settings={"limits": {"max_doi_mm": max_doi_mm}})
    if refused:
        with raises(LimitError, "too_deep", doi_mm=pytest.approx(0.55), x_mm=0.0, limit_mm=0.549):
            press.hold_at(Target("doi_mm", 0.55), hold=1, hold_s=0.1)
        assert bench.stage.moves == 0
    else:
        assert press.hold_at(Target("doi_mm", 0.55), hold=1, hold_s=0.1).doi_mm == pytest.approx(0.55)


# --- towards a force ---

TOLERANCES = [
    # target, step of the sensor, tolerance: 0.05 gwt, 1 % or a step of the sensor, whichever is widest
    (2.0, 0.01, 0.05),
    (20.0, 0.01, 0.2),
    (2.0, 0.1, 0.1),
]


@pytest.mark.parametrize(("target_gwt", "resolution_gwt", "tolerance_gwt"), TOLERANCES)
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(("share", "moves"), [(0.45, 0), (0.55, 1)])
def test_a_press_reaches_a_force_within_half_its_tolerance(
    target_gwt: float, resolution_gwt: float, tolerance_gwt: float, sign: int, share: float, moves: int
) -> None:
    off = target_gwt + sign * share * tolerance_gwt
    settings = {"force": {"resolution_gwt": resolution_gwt}}
    bench, press = pressing(shows(off, target_gwt), 1.2, settings=settings)
    press.hold_at(Target("force_gwt", target_gwt), hold=1, hold_s=0.0)
    assert bench.stage.moves == moves


@pytest.mark.parametrize(("target_gwt", "resolution_gwt", "tolerance_gwt"), TOLERANCES)
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(("share", "moves"), [(0.95, 0), (1.05, 1)])
def test_on_a_coarse_stage_a_press_reaches_a_force_within_its_whole_tolerance(
    target_gwt: float, resolution_gwt: float, tolerance_gwt: float, sign: int, share: float, moves: int
) -> None:
    """At 0.02 mm a step of 0.0025 mm is 19 % of the force; beyond the tolerance it is one step of the stage."""
    off = target_gwt + sign * share * tolerance_gwt
    settings = {"force": {"resolution_gwt": resolution_gwt}}
    bench, press = pressing(shows(off, target_gwt), 0.02, settings=settings)
    press.hold_at(Target("force_gwt", target_gwt), hold=1, hold_s=0.0)
    assert _steps_mm(bench, 0.02) == pytest.approx([-sign * 0.0025] * moves)


@pytest.mark.parametrize(("target_gwt", "resolution_gwt", "tolerance_gwt"), [(2.0, 0.01, 0.05), (2.0, 0.125, 0.125)])
def test_a_force_between_two_motor_steps_is_refused(
    target_gwt: float, resolution_gwt: float, tolerance_gwt: float
) -> None:
    """After one step up and before one down."""
    off = 0.02 * target_gwt + resolution_gwt + 0.04
    bench, press = pressing(
        shows(target_gwt - off, target_gwt + off), 0.02, settings={"force": {"resolution_gwt": resolution_gwt}}
    )
    refused = {"target_gwt": target_gwt, "step_mm": 0.0025, "tolerance_gwt": tolerance_gwt}
    with raises(LimitError, "step_too_coarse", **refused):
        press.hold_at(Target("force_gwt", target_gwt), hold=1, hold_s=0.0)
    assert bench.stage.moves == 1


@pytest.mark.parametrize(
    ("shown_gwt", "steps"),
    [
        ((1.8, 1.85, 1.9, 2.0), (1, 1, 1)),
        ((2.2, 2.15, 2.1, 2.0), (-1, -1, -1)),
        # 0.02 · ((2 / 3)^(2/3) - 1) mm and so on lie between them: more than a step
        ((1.94, 3.0, 2.06, 2.0), (1, None, -1)),
    ],
)
def test_single_steps_in_one_direction_do_not_count_as_passing_over_a_force(
    shown_gwt: tuple[float, ...], steps: tuple[int | None, ...]
) -> None:
    """2 gwt at 0.02 mm: a step of the stage is far more than the tolerance."""
    bench, press = pressing(shows(*shown_gwt), 0.02)
    press.hold_at(Target("force_gwt", 2.0), hold=1, hold_s=0.0)
    for made, step in zip(_steps_mm(bench, 0.02), steps, strict=True):
        assert made < -0.005 if step is None else made == pytest.approx(step * 0.0025)


def test_a_force_that_never_settles_ends_after_400_moves() -> None:
    bench, press = pressing(lambda bench: (1.5, 2.5)[bench.stage.moves % 2], 0.5)
    with raises(LimitError, "force_not_settled", target_gwt=2.0, moves=400):
        press.hold_at(Target("force_gwt", 2.0), hold=1, hold_s=0.1)
    assert bench.stage.moves == 400


@pytest.mark.parametrize(
    ("shown_gwt", "doi_mm", "target_gwt", "step_mm"),
    [
        # a gap of a tenth: three quarters of it
        (1.8, 0.4, 2.0, 0.4 * ((1.95 / 1.8) ** (2 / 3) - 1)),
        # a gap of a twenty-fifth: all of it
        (1.92, 0.4, 2.0, 0.4 * ((2 / 1.92) ** (2 / 3) - 1)),
        # too much by a tenth: all of it
        (2.2, 0.4, 2.0, 0.4 * ((2 / 2.2) ** (2 / 3) - 1)),
        # a reading below half of habits.touch_force_gwt counts as that
        (0.0, 0.04, 0.08, 0.04 * ((0.06 / 0.025) ** (2 / 3) - 1)),
        # a depth below a step of the stage counts as a step, 0.0025 · ((1.75 / 1)^(2/3) - 1), and a step is made
        (1.0, 0.0, 2.0, 0.0025),
        # a large gap: an increment; where little answers too
        (1.0, 0.9, 2.0, 0.05),
        (0.3, 1.0, 0.34, 0.05),
    ],
)
def test_the_first_step_towards_a_force_covers_three_quarters_of_a_large_gap(
    shown_gwt: float, doi_mm: float, target_gwt: float, step_mm: float
) -> None:
    bench, press = pressing(shows(shown_gwt, target_gwt), doi_mm)
    press.hold_at(Target("force_gwt", target_gwt), hold=1, hold_s=0.0)
    assert _steps_mm(bench, doi_mm) == pytest.approx([step_mm], abs=2e-6)


@pytest.mark.parametrize(
    ("first_gwt", "then_gwt", "step_mm"),
    [
        # 0.105 gwt on 0.0219 mm are 4.8 gwt/mm, less than the law says: by the law
        (1.8, 1.905, 0.421925 * ((2 / 1.905) ** (2 / 3) - 1)),
        # 0.16 gwt on 0.0219 mm are 7.3 gwt/mm, more than that: 0.04 gwt at 7.3 gwt/mm
        (1.8, 1.96, 0.04 / (0.16 / 0.021925)),
        # 0.705 gwt on 0.05 mm are 14.1 gwt/mm, more than that: 0.095 gwt at 14.1 gwt/mm
        (1.2, 1.905, 0.095 / 14.1),
        # a force that has sunk: by the law, three quarters of 0.3 gwt
        (1.8, 1.7, 0.421925 * ((1.925 / 1.7) ** (2 / 3) - 1)),
        # what answered on the way up counts too: 0.295 gwt on 0.0246 mm
        (2.2, 1.905, 0.095 / (0.295 / 0.024625)),
        # on the way up: by the law, however little has answered
        (2.2, 2.19, 0.375375 * ((2 / 2.19) ** (2 / 3) - 1)),
    ],
)
def test_the_second_step_is_shorter_on_a_finger_stiffer_than_the_force_law(
    first_gwt: float, then_gwt: float, step_mm: float
) -> None:
    """The second step, from 0.4 mm and one move."""
    bench, press = pressing(shows(first_gwt, then_gwt, 2.0), 0.4)
    press.hold_at(Target("force_gwt", 2.0), hold=1, hold_s=0.0)
    _, second = _steps_mm(bench, 0.4)
    assert second == pytest.approx(step_mm, abs=2e-6)


def test_the_journal_has_the_peak_force_of_each_hold_and_the_ramp_before() -> None:
    """0.45 on the way to the first hold, 0.2 in the second; what the touch felt belongs to neither."""
    bench, press = pressing(shows(0.36, 0.45, 0.4, 0.15, 0.2), 0.4)
    for k, target_gwt in enumerate((0.4, 0.2), 1):
        press.hold_at(Target("force_gwt", target_gwt), hold=k, hold_s=0.2)
    assert [event["peak_gwt"] for event in bench.of("hold_end")] == [0.45, 0.2]


# --- under noise ---


@pytest.mark.parametrize(
    ("noise_gwt", "off_gwt", "readings"),
    [
        (0.0, 0.09, 0),
        (0.0124, 0.09, 0),
        (0.0126, 0.09, 1),  # twice 0.0126 is known to better than 0.0125
        (0.02, 0.09, 2),
        (NOISE_OF_16, 0.09, 15),
        (NOISE_OF_16, 0.0, 15),
        (NOISE_OF_16, -0.09, 15),
        (NOISE_OF_16, 0.11, 0),
        (NOISE_OF_16, -0.11, 0),
        (1.0, 0.09, 24),
    ],
)
def test_near_its_target_force_a_press_averages_as_many_readings_as_the_noise_requires(
    noise_gwt: float, off_gwt: float, readings: int
) -> None:
    """2 gwt to a quarter of 0.05, within 0.1 of it; with the one after the move at most 25."""
    bench, press = pressing(shows(2.0 + off_gwt, 2.0), 0.5, noise_gwt=noise_gwt)
    press.hold_at(Target("force_gwt", 2.0), hold=1, hold_s=0.0)
    assert sum(height == -0.5 for height, _ in bench.readings("press")) == readings


def test_the_averaged_force_includes_the_reading_after_the_move() -> None:
    """1.92 and then 2.0 fifteen times: 1.995 is near enough, where 1.92 was not."""
    again = iter([1.92])
    bench, press = pressing(lambda bench: next(again, 2.0), 0.5, noise_gwt=NOISE_OF_16)
    press.hold_at(Target("force_gwt", 2.0), hold=1, hold_s=0.0)
    (start,) = bench.of("hold_start")
    assert start["force_gwt"] == pytest.approx(1.995)
    assert bench.stage.moves == 0


# --- near a trip ---


@pytest.mark.parametrize(
    ("trip_gwt", "doi_mm", "steps_mm", "refused"),
    [
        # 0.9 · 0.5 · ((2.018 / 2)^(2/3) - 1) is more than a step: so far, and no farther
        (2.018, 0.6, [0.45 * ((2.018 / 2) ** (2 / 3) - 1)], True),
        # 0.0024 mm: less than a step
        (2.016, 0.6, [], True),
        (2.016, 0.5015, [0.0015], False),
        # up it may go
        (2.001, 0.45, [-0.05], False),
    ],
)
def test_a_press_whose_next_step_could_pass_the_soft_trip_is_refused(
    trip_gwt: float, doi_mm: float, steps_mm: list[float], refused: bool
) -> None:
    """2 gwt at 0.5 mm, 2.01 after a move down."""
    bench, press = pressing(
        lambda bench: 2.01 if bench.height_mm < -0.502 else 2.0, 0.5, soft_trip_n=trip_gwt * 9.80665e-3
    )
    refusal = raises(LimitError, "next_move_past_soft_trip", x_mm=0.0, limit_gwt=trip_gwt)
    with refusal if refused else contextlib.nullcontext():
        press.hold_at(Target("doi_mm", doi_mm), hold=1, hold_s=0.0)
    assert _steps_mm(bench, 0.5) == pytest.approx(steps_mm, abs=2e-6)


# --- a force that does not answer the stage ---


def _made(press: Press, doi_mm: float, moves: int, step_mm: float) -> int:
    """How many moves of so many were made, each to a depth of its own; a trip ends them, and counts."""
    for k in range(1, moves + 1):
        try:
            press.hold_at(Target("doi_mm", doi_mm + k * step_mm), hold=k, hold_s=0.0)
        except TripError as error:
            has_code(error, "frozen")
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
def test_a_frozen_force_reading_trips_once_the_missing_rise_exceeds_the_noise(
    gwt: float, doi_mm: float, step_mm: float, trips_at: int
) -> None:
    """From the first move after the touch on."""
    bench, press = pressing(shows(gwt), doi_mm)
    assert _made(press, doi_mm, 12, step_mm) == trips_at
    assert [event["force_gwt"] for event in bench.of("trip")] == [gwt]


@pytest.mark.parametrize(("gwt", "doi_mm", "step_mm", "trips_at"), LATE)
def test_a_force_reading_that_changes_by_one_sensor_step_does_not_trip_as_frozen(
    gwt: float, doi_mm: float, step_mm: float, trips_at: int
) -> None:
    """By one step of the sensor; what was missing before it is forgotten."""
    bench, press = pressing(lambda bench: gwt + 0.01 * (bench.stage.moves // trips_at % 2), doi_mm)
    assert _made(press, doi_mm, trips_at + 3, step_mm) == trips_at + 3
    assert not bench.of("trip")


@pytest.mark.parametrize(("change_gwt", "trips"), [(0.004, True), (0.006, False), (-0.006, False)])
def test_a_change_below_half_a_sensor_step_counts_as_a_frozen_reading(change_gwt: float, trips: bool) -> None:
    bench, press = pressing(lambda bench: 2.0 + change_gwt * (bench.stage.moves % 2), 0.5)
    assert _made(press, 0.5, 6, 0.05) == (3 if trips else 6)
    assert bool(bench.of("trip")) == trips


# --- a finger that is not felt any more ---

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
def test_a_finger_that_shows_no_force_an_increment_below_contact_trips(
    gwt: float, deeper_mm: float, trips: bool
) -> None:
    bench, press = pressing(shows(0.06, gwt), TOUCHED_MM)
    try:
        press.hold_at(Target("doi_mm", TOUCHED_MM + deeper_mm), hold=1, hold_s=0.0)
    except TripError as error:
        has_code(error, "lost_finger", force_gwt=gwt, below_mm=pytest.approx(0.05))
    assert [event["force_gwt"] for event in bench.of("trip")] == [gwt] * trips


def test_a_finger_whose_force_vanishes_in_a_hold_trips() -> None:
    bench, press = pressing(lambda bench: 0.0 if bench.of("hold_start") else 0.2, TOUCHED_MM)
    with raises(TripError, "lost_finger", force_gwt=0.0):
        press.hold_at(Target("doi_mm", TOUCHED_MM + 0.1), hold=1, hold_s=0.5)
    assert bench.of("hold_start")
