"""The attempts at each indentation that a journal holds: what a run keeps must be of one of them, and whole."""

import csv
from collections import Counter
from typing import Any

from rig.data import Run
from rig.data.events import PRESS_STREAMS
from studies.faults.campaign.runner import attempts

Told = list[tuple[int, str, dict[str, Any]]]  # part of the run, stream, event

SAME_PLACE_MM = 0.01


def mixed(run: Run) -> int:
    """How many indentations of a run are not one whole attempt, as it is read or as it was exported."""
    told, exported = attempts(run.folder.events), _exported_holds(run)
    return sum(
        not _whole(told[index])
        or not _as_read(run, index, told[index])
        or [exported[index, hold["hold"]] for hold in holds] != [1] * len(holds)
        for index, holds in run.done.items()
    )


def _whole(attempt: Told) -> bool:
    """Begun once, touched once, each hold once, in one part of the run, at one place."""
    streams = [stream for _, stream, _ in attempt]
    (_, first, begun), holds = attempt[0], list(range(1, attempt[0][2]["increments"] + 1))
    by_hold = [
        [event["hold"] for _, stream, event in attempt if stream == name] for name in ("hold_start", "hold_end")
    ]
    away_mm = [abs(event["x_mm"] - begun["x_mm"]) for _, _, event in attempt if event.get("x_mm") is not None]
    return (
        (first, streams.count("indentation_start"), streams.count("touch")) == ("indentation_start", 1, 1)
        and by_hold == [holds, holds]
        and len({part for part, _, _ in attempt}) == 1
        and max(away_mm) < SAME_PLACE_MM
    )


def _as_read(run: Run, index: int, attempt: Told) -> bool:
    """Whether the run, as it is read, has these events and no others of this indentation."""
    return all(
        [event for event in run.stream(name) if event.get("index") == index]
        == [event for _, stream, event in attempt if stream == name]
        for name in PRESS_STREAMS
    )


def _exported_holds(run: Run) -> Counter[tuple[int, int]]:
    """How often each hold stands in the run's table."""
    with (run.folder.path / "hold_end.csv").open(encoding="utf-8", newline="") as file:
        return Counter((int(row["index"]), int(row["hold"])) for row in csv.DictReader(file))
