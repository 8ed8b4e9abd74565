"""A design in words, for the terminal and the page, and as JSON."""

import math
from typing import Literal

from rig.compare.verdict import Candidate
from rig.design.confusion import LEFT_OVER, SEPARATED, Confusion, DesignName, share_and_error
from rig.design.design import DESIGNED, Design
from rig.design.power import POWER, PowerRow, needed
from rig.design.recorded_counts import FITS, SessionVerdict
from rig_shared.outputs import Output, Ratio, Shape
from rig_shared.plural import number_of

SURE = 2.0
"""Standard errors by which two designs must differ to count as different."""

_DEPENDS = ((0.1, "hardly depend"), (0.3, "depend weakly"), (0.6, "depend moderately"), (1.0, "depend strongly"))
"""Words for the largest |correlation| of a press with the one before, up to each value."""

FAILS = f"the truth is not in the 95 % set, or more than {LEFT_OVER} candidates are"


class DesignedPressJson(Output):
    """A press of a design, in order."""

    shape: Shape
    x_mm: float
    target: Literal["doi_mm", "force_gwt"]
    value: float
    unit: Literal["mm", "gwt"]


class DesignOutcomeJson(Output):
    """Simulated experiments of a design; shares with their Monte Carlo errors.

    An experiment fails if the truth is not in the 95 % set, or more than two candidates are.
    """

    design: DesignName
    session_s: float
    presses: int
    experiments: int
    failed: Ratio
    failed_error: Ratio
    truth_in_set: Ratio
    truth_in_set_error: Ratio
    right: Ratio
    right_error: Ratio


class ConfusionJson(Output):
    """Share of experiments (row: true, column: most probable) and its Monte Carlo error."""

    true: list[Candidate]
    share: list[list[Ratio]]
    error: list[list[Ratio]]


class NotSeparatedJson(Output):
    """Pair of candidates that all presses in an hour cannot separate."""

    one: Candidate
    other: Candidate
    right: Ratio


class SampleSizeJson(Output):
    """Experiments with several fibers: share in which the set is the truth alone, or the truth and one other."""

    session_s: float
    presses: int
    repeats: Ratio
    fibers: int
    few: Ratio
    few_error: Ratio
    one: Ratio
    one_error: Ratio


class DesignedJson(Output):
    """A design of presses."""

    candidates: list[Candidate]
    shapes: list[Shape]
    session_s: float
    seed: int
    quick: bool
    possible_presses: int
    refused_presses: int
    fingers: int
    presses: list[DesignedPressJson]
    information_bits: float
    effective_draws: Ratio
    outcomes: list[DesignOutcomeJson]
    confusion: ConfusionJson
    not_separated: list[NotSeparatedJson]
    separated_from: Ratio
    dependence: Ratio
    carried_over: Ratio | None
    power: list[SampleSizeJson]


def headline(found: Design) -> str:
    """Return the answer in one sentence."""
    failed, error = share_and_error(found.outcome.failed)
    usual = [one for one in found.outcomes if one.minutes == found.request.minutes and one.name != DESIGNED]
    best = min(usual, key=lambda one: float(one.failed.mean()))
    other, other_error = share_and_error(best.failed)
    more, sure = other - failed, SURE * math.hypot(error, other_error)
    gain = (
        "so the choice of presses helps"
        if more > sure
        else "so this usual design is the better one"
        if more < -sure
        else "so this simulation shows no gain from the choice of presses"
    )
    return (
        f"{number_of(len(found.made.order), 'presses')} in {found.request.minutes:g} minutes fail in "
        f"{percent(failed, error)} of experiments, and the best usual design, {best.name}, in "
        f"{percent(other, other_error)}, {gain}."
    )


def percent(share: float, error: float) -> str:
    """Format a share with its Monte Carlo error, e.g. "3.1 ± 0.9 %"."""
    digits = 0 if error >= 0.01 else 1
    return f"{100 * share:.{digits}f} ± {max(100 * error, 0.1):.{digits}f} %"


def about_the_design(found: Design) -> str:
    """Return candidates, presses and seed as a paragraph of the script."""
    made = found.presses
    different = len(set(found.made.order.tolist()))
    per_shape = ", ".join(f"{sum(p.shape == s for p in made)} with {s}" for s in dict.fromkeys(p.shape for p in made))
    return (
        f"Candidates: {', '.join(found.request.candidates)}. {number_of(len(made), 'presses')} in "
        f"{found.request.minutes:g} minutes, of which {different} differ: {per_shape}. Seed {found.request.seed}."
    )


def separation_line(found: Design) -> str:
    """Return which pairs all presses in an hour do not separate."""
    pairs = found.bound.not_separated()
    if not pairs:
        return (
            f"{bound_name(found).capitalize()} in {found.bound.minutes:g} minutes separate every pair of candidates."
        )
    named = ", ".join(f"{a} and {b}" for a, b, _ in pairs)
    return f"Not even {bound_name(found)} in {found.bound.minutes:g} minutes separate {named}."


def bound_name(found: Design) -> str:
    """Return which presses the bounding design has."""
    possible, different = len(found.table.presses), found.bound.different
    return (
        f"all {possible} possible presses"
        if different == possible
        else f"as many of the {possible} possible presses as fit ({different})"
    )


def quick_line(found: Design) -> str | None:
    """Return the limitations of a quick design; None for a full one."""
    if not found.request.quick:
        return None
    _, error = share_and_error(found.outcome.failed)
    return (
        "The choice is coarser, without exchange, and for one duration only; its failures are known to "
        f"{100 * error:.1f} points. docs/design.md has the measured loss."
    )


def history_line(found: Design) -> str:
    """Return how presses depend on the one before, and how far relaxation carries over."""
    rest, target = found.request.rest_s, {"doi_mm": "depth", "force_gwt": "force"}[found.request.kind]
    if found.carried_over is None:
        carries = (
            "The configured finger does not relax; set virtual.relaxation, or identify it, to see the carry-over."
        )
    else:
        carries = f"Relaxation lowers the force of the next press by {100 * found.carried_over:.1f} %."
    depend = next(words for most, words in _DEPENDS if found.dependence <= most + 1e-9)
    return (
        f"In each block, each {target} follows each as often as if they were independent, within "
        f"{found.imbalance:.1f} presses. Position and {target} {depend} on the press before (|r| up to "
        f"{found.dependence:.2f}). Not every press follows every other one. Washout: the approach and a rest of "
        f"{rest:g} s. {carries}"
    )


def as_json(found: Design, rows: list[PowerRow]) -> DesignedJson:
    """Return the design as JSON, without the names of files."""
    request = found.request
    outcome = found.outcome
    return {
        "candidates": list(request.candidates),
        "shapes": list(dict.fromkeys(press.shape for press in found.presses)),
        "session_s": 60 * request.minutes,
        "seed": request.seed,
        "quick": request.quick,
        "possible_presses": len(found.table.presses),
        "refused_presses": found.possible - len(found.table.presses),
        "fingers": found.fingers,
        "presses": [
            {
                "shape": p.shape,
                "x_mm": p.x_mm,
                "target": p.kind,
                "value": p.target,
                "unit": "mm" if p.kind == "doi_mm" else "gwt",
            }
            for p in found.presses
        ],
        "information_bits": outcome.bits,
        "effective_draws": float(sorted(outcome.effective)[len(outcome.effective) // 10]),
        "outcomes": [_outcome(one) for one in (*found.outcomes, found.bound)],
        "confusion": {
            "true": list(outcome.candidates),
            "share": outcome.matrix.tolist(),
            "error": outcome.error.tolist(),
        },
        "not_separated": [{"one": a, "other": b, "right": share} for a, b, share in found.bound.not_separated()],
        "separated_from": SEPARATED,
        "dependence": found.dependence,
        "carried_over": found.carried_over,
        "power": [_power(row) for row in rows],
    }


def _power(row: PowerRow) -> SampleSizeJson:
    return {
        "session_s": 60 * row.minutes,
        "presses": row.presses,
        "repeats": row.repeats,
        "fibers": row.fibers,
        "few": row.few,
        "few_error": row.few_error,
        "one": row.one,
        "one_error": row.one_error,
    }


def _outcome(one: Confusion) -> DesignOutcomeJson:
    failed, failed_error = share_and_error(one.failed)
    kept, kept_error = share_and_error(one.kept)
    right, right_error = share_and_error(one.right)
    return {
        "design": one.name,
        "session_s": 60 * one.minutes,
        "presses": one.presses,
        "experiments": len(one.truth),
        "failed": failed,
        "failed_error": failed_error,
        "truth_in_set": kept,
        "truth_in_set_error": kept_error,
        "right": right,
        "right_error": right_error,
    }


def verdict_lines(verdict: SessionVerdict) -> list[str]:
    """Return the verdict on the counts of a session: the set in a sentence, then the probabilities."""
    inside = [row for row in verdict.candidates if row.in_set]
    best = inside[0]
    named = ", ".join(row.name for row in inside)
    left = f"{named} explain{'s' if len(inside) == 1 else ''} these counts"
    together = "it has at least" if len(inside) == 1 else "together they have"
    again = "" if verdict.different == verdict.presses else f", {verdict.different} of them different"
    over = f"{number_of(verdict.presses, 'presses')}{again}, each counted over its hold of {verdict.hold_s:g} s"
    lines = [f"{'set':<10}{left} ({over}); {together} 95 % of the probability"]
    if best.p_fit < FITS:
        lines = [
            f"{'set':<10}no candidate explains these counts: {best.name}, the most probable one, misfits (p = "
            f"{best.p_fit:.1g})"
        ]
    lines += [
        f"{row.name:<10}{100 * row.probability:.1f} %, p of its fit {row.p_fit:.2g}" for row in verdict.candidates
    ]
    return lines


def power_lines(rows: list[PowerRow]) -> list[str]:
    """Return a line for each duration: the fewest fibers for the power, to few candidates and to one."""
    lines = []
    for minutes in dict.fromkeys(row.minutes for row in rows):
        few, one = (needed(rows, minutes, alone=alone) for alone in (False, True))
        first = next(row for row in rows if row.minutes == minutes)
        lines.append(
            f"{minutes:g} min, {number_of(first.presses, 'presses')} per fiber, {first.repeats:.1f} of each: "
            f"{_fibers(few)} to two candidates, {_fibers(one)} to one"
        )
    return [f"fibers for {100 * POWER:.0f} % power", *lines]


def _fibers(row: PowerRow | None) -> str:
    if row is None:
        return "more than 12 fibers"
    return number_of(row.fibers, "fibers")
