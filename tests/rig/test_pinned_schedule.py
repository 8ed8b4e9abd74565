"""What a schedule makes of its items: every step in its place with its marks; and what its parameters may be."""

from typing import Any

import pytest
from pydantic import ValidationError

from rig.protocol import ReferencePress, Rig, Schedule, ScheduledParameters
from rig.protocol.steps import Checkpoint, Mount, MoveTo, Note, Reference, Rest, Step, Zero
from tests.rig.walked import walked


def _steps(schedule: Schedule[Any]) -> list[Step[Any, Any]]:
    """What is handed on for a script that notes each block and each item."""

    def script(rig: Rig) -> None:
        rig.mount("bar")
        rig.home()
        for block in schedule.on(rig):
            rig.note("begun")
            for item in block:
                rig.note(str(item))
            rig.note("ended")

    return walked(script).steps[2:]


def test_items_alone_are_done_once_in_one_block() -> None:
    assert _steps(Schedule(("a", "b"))) == [
        Checkpoint(name="block 1 of 1"),
        Zero(),
        Note(text="begun", block=1),
        Note(text="a", block=1, repeat=1, condition="a"),
        Note(text="b", block=1, repeat=1, condition="b"),
        Note(text="ended", block=1),
        Zero(),
    ]


def test_rests_lie_between_items_and_between_blocks() -> None:
    """Neither before the first nor after the last; a rest belongs to the block, not to an item."""
    found = _steps(Schedule(("a", "b", "c"), blocks=3, rest_s=1.5, block_rest_s=10.0))
    between = [Rest(seconds=10.0)]
    assert found == [
        step
        for number in (1, 2, 3)
        for step in (
            *(between if number > 1 else []),
            Checkpoint(name=f"block {number} of 3"),
            Zero(),
            Note(text="begun", block=number),
            Note(text="a", block=number, repeat=1, condition="a"),
            Rest(seconds=1.5, block=number),
            Note(text="b", block=number, repeat=1, condition="b"),
            Rest(seconds=1.5, block=number),
            Note(text="c", block=number, repeat=1, condition="c"),
            Note(text="ended", block=number),
            Zero(),
        )
    ]


def test_where_no_rest_is_asked_there_is_none() -> None:
    """Not even one of no seconds."""
    assert not [step for step in _steps(Schedule("ab", repeats=2, blocks=3)) if isinstance(step, Rest)]


def test_a_reference_comes_before_every_so_many_items() -> None:
    """And a schedule without one has none."""
    presses = [
        step
        for step in _steps(Schedule("abcde", reference=ReferencePress(2, x_mm=-1.0, doi_mm=0.3)))
        if isinstance(step, Reference) or (isinstance(step, Note) and step.condition)
    ]
    reference = Reference(x_mm=-1.0, doi_mm=0.3, block=1)
    a, b, c, d, e = (Note(text=name, block=1, repeat=1, condition=name) for name in "abcde")
    assert presses == [reference, a, b, reference, c, d, reference, e]


def test_repeats_are_counted_from_one_in_each_block() -> None:
    found = _steps(Schedule((0.5, 1), repeats=3, blocks=2))
    marks = [(s.block, s.repeat, s.condition) for s in found if s.condition]
    assert marks == [
        (block, repeat, condition) for block in (1, 2) for repeat in (1, 2, 3) for condition in ("0.5", "1")
    ]
    assert [s.repeat for s in _steps(Schedule("aab")) if s.condition] == [1, 2, 1]


class Wordy:
    """An item that says much of itself."""

    def __repr__(self) -> str:
        return "begin" + 90 * "-" + "end"


@pytest.mark.parametrize(
    ("item", "condition"),
    [
        (1 / 3, "0.333333"),
        ("grating, wide", "grating, wide"),
        (3, "3"),
        (("bar", 0.5), "('bar', 0.5)"),
        (Wordy(), "begin" + 33 * "-" + "..." + 36 * "-" + "end"),
    ],
)
def test_a_condition_is_an_item_in_at_most_80_characters(item: object, condition: str) -> None:
    (found,) = [s.condition for s in _steps(Schedule([item])) if s.condition]
    assert found == condition
    assert len(found) <= 80


def test_a_random_order_without_a_seed_is_that_of_seed_0() -> None:
    schedules = [Schedule("abcdef", order="random"), *(Schedule("abcdef", "random", seed) for seed in (0, 1))]
    unseeded, of_0, of_1 = (schedule.block(1) for schedule in schedules)
    assert unseeded == of_0 != of_1


# --- the parameters ---

# default, lowest, highest, what lies a little below and above; what it is, where its name does not say
BOUNDS: dict[str, tuple[float, float, float | None, float, float | None, str | None]] = {
    "seed": (0, 0, None, -1, None, "of a random order"),
    "repeats": (1, 1, 100, 0, 101, "of each item in a block"),
    "blocks": (1, 1, 100, 0, 101, None),
    "rest_s": (0.0, 0, 3600, -0.001, 3600.5, "between indentations"),
    "block_rest_s": (0.0, 0, 3600, -0.001, 3600.5, "between blocks"),
    "precondition": (0, 0, 100, -1, 101, "presses before each block that are no data"),
    "reference_every": (0, 0, 1000, -1, 1001, "indentations between reference presses; 0: none"),
    "reference_doi_mm": (0.4, 0.001, 1.5, 0.0, 1.501, None),
}


@pytest.mark.parametrize("name", BOUNDS)
def test_a_parameter_of_a_schedule_has_its_default_and_its_bounds(name: str) -> None:
    default, lowest, highest, below, above, what = BOUNDS[name]
    assert getattr(ScheduledParameters(), name) == default
    for allowed in (lowest, highest):
        if allowed is not None:
            parameters = ScheduledParameters.model_validate({name: allowed})
            assert getattr(parameters, name) == allowed
            assert len(parameters.schedule("ab").block(1)) == 2 * parameters.repeats
    for refused in (below, above):
        if refused is not None:
            with pytest.raises(ValidationError, match=f"(?s)1 validation error.*{name}"):
                ScheduledParameters.model_validate({name: refused})
    assert ScheduledParameters.model_fields[name].description == what


def test_the_table_of_bounds_leaves_out_the_two_that_have_none() -> None:
    assert set(ScheduledParameters.model_fields) - set(BOUNDS) == {"order", "reference_x_mm"}
    schedule = ScheduledParameters(reference_every=1).schedule("ab")
    assert (schedule.order, schedule.reference) == ("given", ReferencePress(1, 0.0, 0.4))


def test_parameters_as_they_are_schedule_the_items_alone() -> None:
    assert ScheduledParameters().schedule("abc") == Schedule("abc")


def test_parameters_go_into_the_schedule() -> None:
    given = {"order": "random", "seed": 5, "repeats": 2, "blocks": 3, "rest_s": 1.0, "block_rest_s": 2.0}
    reference = {"reference_every": 4, "reference_x_mm": -1.0, "reference_doi_mm": 0.2}
    schedule = ScheduledParameters.model_validate({**given, **reference}).schedule("ab")
    assert schedule == Schedule("ab", "random", 5, 2, 3, 1.0, 2.0, ReferencePress(4, -1.0, 0.2))


def test_a_script_ends_unmarked() -> None:
    def script(rig: Rig) -> None:
        rig.home()
        for block in Schedule("a").on(rig):
            for _ in block:
                rig.move_to(x_mm=1.0)
        rig.mount("bar")

    *_, zero, mount = walked(script).steps
    assert (zero, mount) == (Zero(), Mount(indentor="bar"))
    assert MoveTo(x_mm=1.0, block=1, repeat=1, condition="a") in walked(script).steps
