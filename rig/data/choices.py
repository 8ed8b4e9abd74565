"""Choices of an adaptive run, from its journal: probabilities after each count, and the verdict."""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

from rig.data.run import Run

LEVEL = 0.95
"""Share of the probability that the set of candidates holds."""

BY_PLAN, PLAN_DONE = "plan", "plan_done"
"""Reasons recorded for a planned press, and for the end of the plan."""


class ChoiceVerdict(NamedTuple):
    """Candidates with their probabilities, most probable first, the 95 % set, and why the presses ended.

    `ended` is None for a run that did not end by itself, and `truth` for a recorded nerve. `planned_from` is the
    first indentation that was no longer chosen, or None.
    """

    probability: Mapping[str, float]
    in_set: tuple[str, ...]
    ended: str | None
    truth: str | None
    planned_from: int | None


def probabilities_of(choice: Mapping[str, Any]) -> dict[str, float]:
    """Return the probabilities of an event."""
    return {str(name): float(p) for name, p in json.loads(choice["probabilities"]).items()}


def smallest_set(probability: Mapping[str, float]) -> tuple[str, ...]:
    """Return the fewest candidates that together hold `LEVEL` of the probability, most probable first."""
    inside: list[str] = []
    total = 0.0
    for name, p in sorted(probability.items(), key=lambda one: -one[1]):
        if total >= LEVEL:
            break
        inside.append(name)
        total += p
    return tuple(inside)


def verdict_of(run: Run) -> ChoiceVerdict | None:
    """Return the verdict of an adaptive run so far, or None for another run."""
    choices = run.stream("choice")
    if not choices:
        return None
    last = choices[-1]
    ranked = dict(sorted(probabilities_of(last).items(), key=lambda one: -one[1]))
    described = [one["truth"] for one in run.stream("count_source") if one.get("truth")]
    truth = json.loads(described[-1]) if described else {}
    planned = [int(one["index"]) for one in choices if one["reason"] in (BY_PLAN, PLAN_DONE)]
    return ChoiceVerdict(
        ranked,
        smallest_set(ranked),
        last["reason"] if last.get("possible") is None else None,
        truth.get("candidate"),
        planned[0] if planned else None,
    )


WHY_ENDED = {
    "one_candidate": "one candidate has 95 %",
    "nothing_to_learn": "nothing more can be learned",
    "no_time": "no further press fits into the session",
    PLAN_DONE: "all planned presses were made",
}
"""Why presses ended, in words."""
