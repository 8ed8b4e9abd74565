"""What the time of a run went to: a rest is a rest, and a person's time is a person's."""

from pathlib import Path
from typing import Any

import pytest

from rig.data.run import Run
from rig.data.tables import booked_s

Event = tuple[float, str, str | None]
NOTHING = dict.fromkeys(
    ("waiting for a person", "homing, zero and notes", "lateral moves", "rest", "approach", "touch-off",
     "press and seek", "hold", "lift"), 0.0,
)  # fmt: skip


def _run(*events: Event, superseded: tuple[Event, ...] = ()) -> Run:
    def by_stream(found: tuple[Event, ...]) -> dict[str, list[dict[str, Any]]]:
        streams: dict[str, list[dict[str, Any]]] = {}
        for t_s, stream, phase in found:
            streams.setdefault(stream, []).append({"t_s": t_s, "phase": phase})
        return streams

    start = {"t_s": 100.0}
    return Run(Path(), start, None, {}, by_stream(events), by_stream(superseded), 0.0, 0.0)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("events", "went_to"),
    [
        ([(112.0, "home", None), (113.0, "zero", None), (114.0, "note", None), (115.0, "checkpoint", None),
          (116.0, "trip", None)], {"homing, zero and notes": 16.0}),
        ([(103.0, "move", None), (104.0, "sample", "clearance"), (106.0, "sample", "moving")],
         {"lateral moves": 6.0}),
        ([(103.0, "move", None), (163.0, "rest", None), (165.0, "sample", "approach")],
         {"lateral moves": 3.0, "rest": 60.0, "approach": 2.0}),
        # a rest in which somebody paused for 500 s
        ([(110.0, "paused", None), (610.0, "resumed", None), (660.0, "rest", None)],
         {"rest": 60.0, "waiting for a person": 500.0}),
        # a pause that ended the run
        ([(110.0, "retract", None), (115.0, "paused", None)], {"lift": 10.0}),
        ([(101.0, "sample", "approach"), (103.0, "sample", "back off"), (106.0, "sample", "touch"),
          (110.0, "sample", "press"), (115.0, "hold_start", None), (117.0, "sample", "hold"),
          (117.0, "hold_end", None), (120.0, "retract", None), (120.0, "indentation_end", None)],
         {"approach": 1.0, "touch-off": 5.0, "press and seek": 4.0, "hold": 7.0, "lift": 3.0}),
        # a script that notes or checks something right after a press: the lift took the time
        ([(117.0, "sample", "hold"), (120.0, "note", None), (120.0, "retract", None)], {"hold": 17.0, "lift": 3.0}),
        # and after a rest or a move
        ([(117.0, "rest", None), (120.0, "checkpoint", None), (120.0, "rest", None)], {"rest": 20.0}),
        # presses that are no data are no lift
        ([(101.0, "reference_sample", "approach"), (104.0, "precondition_sample", "hold"),
          (110.0, "find_sample", "touch"), (111.0, "retract", None)],
         {"approach": 1.0, "hold": 3.0, "touch-off": 6.0, "lift": 1.0}),
    ],
)  # fmt: skip
def test_the_time_of_a_run_counts_for_the_step_that_follows(events: list[Event], went_to: dict[str, float]) -> None:
    assert booked_s(_run(*events)) == pytest.approx({**NOTHING, **went_to})
