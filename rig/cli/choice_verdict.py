"""Verdict of an adaptive run, as commands print it."""

from rig.data import Run
from rig.data.choices import WHY_ENDED, verdict_of
from rig_shared.outputs import Code, Name, Output, Ratio


class ProbableCandidateJson(Output):
    """A candidate after the counts of an adaptive run."""

    name: Name
    probability: Ratio
    in_set: bool


class AdaptiveVerdictJson(Output):
    """Verdict of an adaptive run; `truth`: that of a virtual nerve, `planned_from`: press where counts stopped."""

    candidates: list[ProbableCandidateJson]
    ended: Code | None
    truth: Name | None
    planned_from: int | None


def choice_as_json(run: Run) -> AdaptiveVerdictJson | None:
    """Return the verdict of an adaptive run as JSON, or None for another run."""
    found = verdict_of(run)
    if found is None:
        return None
    candidates: list[ProbableCandidateJson] = [
        {"name": name, "probability": p, "in_set": name in found.in_set} for name, p in found.probability.items()
    ]
    return {
        "candidates": candidates,
        "ended": found.ended,
        "truth": found.truth,
        "planned_from": found.planned_from,
    }


def choice_lines(found: AdaptiveVerdictJson) -> list[tuple[str, str]]:
    """Return the lines about an adaptive run, by their label."""
    rows = found["candidates"]
    inside = ", ".join(f"{one['name']} {100 * one['probability']:.1f} %" for one in rows if one["in_set"])
    lines = [("verdict", f"95 % set: {inside}")]
    if found["truth"] is not None:
        is_in = any(one["in_set"] and one["name"] == found["truth"] for one in rows)
        lines.append(("truth", f"{found['truth']} (virtual nerve), {'in' if is_in else 'not in'} the set"))
    if found["planned_from"] is not None:
        lines.append(
            ("plan", f"counts stopped; from press index {found['planned_from']} on, the run followed the plan")
        )
    if found["ended"] is not None:
        lines.append(("ended", WHY_ENDED[found["ended"]]))
    return lines
