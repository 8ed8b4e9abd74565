"""Recorded positions that the run does not cover are listed, at each receptor and in a line."""

from collections.abc import Callable

import numpy as np
import pytest

from rig.compare.comparison import Comparison, compare, left_out_lines, left_out_rows
from rig.compare.recordings.recording import recording
from rig.compare.stimuli import StimulusRow


@pytest.fixture
def judged(make_stimulus: Callable[..., StimulusRow]) -> Callable[..., Comparison]:
    """Positions −3 … 3 mm recorded under a step that was moved from 2 to −2 mm, at given receptors."""

    def make(receptors: list[float], positions: list[float], x_mm: list[float] | None = None) -> Comparison:
        x = np.array([-2.0, 0.0, 2.0] if x_mm is None else x_mm)
        stimulus = make_stimulus("step:1", x, np.array(receptors), {})
        rows = [(position, 1.0, np.nan) for position in positions]
        return compare([stimulus], {"step:1": recording("mine.csv", rows)})

    return make


def test_what_is_left_out_at_each_receptor(judged: Callable[..., Comparison]) -> None:
    found = judged([-1.0, 0.0, 0.5], [-3, -2, -1, 0, 1, 2, 3])
    (row,) = left_out_rows(found)
    assert row == {
        "shape": "step:1",
        "condition": "2.33 gwt",
        "recording": "mine.csv",
        "positions": 7,
        "left_out": [
            {"receptor_mm": -1.0, "positions_mm": [-3.0, -2.0]},
            {"receptor_mm": 0.0, "positions_mm": [-3.0, 3.0]},
            {"receptor_mm": 0.5, "positions_mm": [-3.0, 2.0, 3.0]},
        ],
        "range_needed_mm": (-4.0, 3.5),
        "covered_receptor_x_mm": [],
        "command": "",
        "covered_by_command": 3,
    }
    (line,) = left_out_lines(found)
    for part in ("step:1 at 2.33 gwt", "mine.csv", "from 3.5 to -4 mm"):
        assert part in line


def test_the_range_that_is_named_covers_everything(judged: Callable[..., Comparison]) -> None:
    low, high = left_out_rows(judged([-1.0, 0.5], [-3.0, 3.0, 0.1]))[0]["range_needed_mm"]
    found = judged([-1.0, 0.5], [-3.0, 3.0, 0.1], [low, high])
    assert left_out_rows(found)[0]["left_out"] == []
    assert left_out_lines(found) == []
    assert left_out_lines(judged([-1.0, 0.5], [-3.0, 3.0, 0.1], [low + 0.01, high])) != []


RECEPTORS = {  # receptors, recorded positions, and the receptors at which the run from 2 to −2 mm covers all of them
    "the run that was recorded": ([-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0], [0.0]),  # no receptor but that of the field
    "a wider run": ([-2.0, -1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]),  # it reaches 1 mm beyond each end
    "none of them, but one between": ([-1.5, 1.5], [-1.0, 0.0, 1.0], [0.0]),  # from −1 to 1 mm: the middle
    "beside the middle": ([-3.0, 3.0], [-2.0, 1.0], [0.5]),  # from 0 to 1 mm
    "a run that is too short": ([0.0], [-3.0, 3.0], []),
}


@pytest.mark.parametrize("name", RECEPTORS)
def test_the_receptors_that_the_run_covers_are_offered_and_leave_nothing_out(
    judged: Callable[..., Comparison], name: str
) -> None:
    receptors, positions, covered = RECEPTORS[name]
    found = judged(receptors, positions)
    (row,), (line,) = left_out_rows(found), left_out_lines(found)
    assert row["covered_receptor_x_mm"] == covered
    assert ("--receptor-x-mm=" in line) == bool(covered)
    if covered:
        assert f"`--receptor-x-mm={','.join(f'{x:g}' for x in covered)}` compares all of them" in line
        assert left_out_lines(judged(covered, positions)) == []
