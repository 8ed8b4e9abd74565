"""What docs/validation/allowed_fingers.md says of the kept tables: printed by the command, and compared by a test."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from studies.source.allowed.facts import FACTS, Fact
from studies.source.allowed.implausible import CUT_OFF, Judge, allowed
from studies.source.allowed.pins import pins
from studies.source.allowed.ranges import LOW_FORCE, NAMES, RANGES, place_of
from studies.source.allowed.study import CHOOSES, AllowedStudy, better, score
from studies.source.allowed.summary import lines
from studies.source.allowed.waves import RemainingPlaces

Array = NDArray[np.float64]

DEFLATED = (0.8, 0.7)
"""Factors on the errors of reading and model, to see what rests on these."""

BY_KEY = {fact.key: fact for fact in FACTS}
FORESEEN = 2.0
"""Deviations within which 95 % of normal errors lie."""

_GROWTH, _SHARE = "growth", "upper_share"


def sentences(study: AllowedStudy) -> list[str]:
    """In the order of docs/validation/allowed_fingers.md."""
    return [
        waves(study.lefts),
        deflated(study.last),
        checked(study),
        held_back((*study.last.judges, *study.checks.judges)),
        pinned(study.last),
        *([foreseen(study), later(study)] if study.tables[1:] else []),
        together(study.last),
        nearest(study),
        *best(study),
    ]


def waves(lefts: Sequence[RemainingPlaces]) -> str:
    """What each left."""
    first, *others = lefts
    told = ", ".join(f"after {left.fingers} {percent(left.share)}" for left in others)
    return f"After {first.fingers} fingers {percent(first.share)} of the ranges' volume are left, {told}."


def deflated(last: RemainingPlaces) -> str:
    """What would be left if reading and model were trusted more."""
    shares = [float(np.mean(allowed(last.judges, last.places, last.inflation * k))) for k in DEFLATED]
    told = ", ".join(
        f"with {factor:g} times of them {percent(s)}" for factor, s in zip(DEFLATED, shares, strict=True)
    )
    return f"Reading and model errors are multiplied by {last.inflation:g}; {told} would be left."


def checked(study: AllowedStudy) -> str:
    """What the checking half leaves of that, and which of its facts rule out most."""
    last, inside = study.last, study.last.places[study.last.allowed]
    both = float(np.mean(study.checks.allowed[last.allowed]))
    out = {
        j.target.key: float(np.mean(j.implausibility(inside, last.inflation) > CUT_OFF)) for j in study.checks.judges
    }
    most = sorted(out, key=lambda key: -out[key])[:2]
    told = " and ".join(f"{_named(BY_KEY[key])} ({percent(out[key])})" for key in most)
    return (
        f"Of what is left the checking half allows {percent(both)}, so that all figures together leave "
        f"{percent(both * last.share)} of the ranges; most of it is ruled out by {told}."
    )


def held_back(judges: Sequence[Judge]) -> str:
    """How good the emulators are, and which facts have none."""
    half, most = np.quantile([judge.relative_error for judge in judges], (0.5, 0.9)).tolist()
    silent = [_named(fact) for key, fact in BY_KEY.items() if key not in {judge.target.key for judge in judges}]
    told = f"; judged by none: {', '.join(silent)}" if silent else ""
    return (
        f"Held back, half of the emulators miss by {percent(half)} of a number's spread or less, nine in ten by "
        f"{percent(most)} or less{told}."
    )


def pinned(last: RemainingPlaces) -> str:
    """The parameters of which the source says something."""
    found = [pin for pin in pins(last) if pin.pinned]
    told = "; ".join(f"`{pin.one.name}` {typeset(f'{pin.low:.2f} … {pin.high:.2f}')}" for pin in found)
    return f"Pinned are {len(found)} of {len(RANGES)}, the middle nine tenths of what is left: {told or 'none'}."


def foreseen(study: AllowedStudy) -> str:
    """Whether what the emulators expected of the last wave came."""
    before, last = study.lefts[-2], study.tables[-1]
    x = np.array([place_of(dict(zip(NAMES, row, strict=True))) for row in last.values])
    off = []
    for judge in before.judges:
        mean, deviation = judge.emulator.predict(x)
        off.append((last.facts[:, _column(judge.target.key)] - mean) / (judge.widened * deviation))
    found = np.concatenate(off)
    within = float(np.mean(np.abs(found[np.isfinite(found)]) <= FORESEEN))
    return (
        f"The choosing half's emulators of {before.fingers} fingers foresaw the {len(x)} pressed after them: "
        f"{percent(within)} of the numbers lie within {FORESEEN:g} deviations of what was expected."
    )


def later(study: AllowedStudy) -> str:
    """What the low force does on the fingers of the later waves."""
    columns = {key: np.concatenate([t.facts[:, _column(key)] for t in study.tables[1:]]) for key in (_GROWTH, _SHARE)}
    growth, share = ((np.nanmin(found), np.nanmax(found)) for found in columns.values())
    default = [study.default[_column(key)] for key in (_GROWTH, _SHARE)]
    return (
        f"On the fingers of later waves the population's peak grows {growth[0]:.1f} to {growth[1]:.1f} times "
        f"(default {default[0]:.1f}), and the upper flat carries {share[0]:.2f} to {share[1]:.2f} of the force "
        f"(default {default[1]:.2f})."
    )


def together(last: RemainingPlaces) -> str:
    """The two parameters that are most alike in what is left."""
    r = np.triu(np.corrcoef(last.places[last.allowed].T), 1)
    a, b = np.unravel_index(int(np.abs(r).argmax()), r.shape)
    return f"Most alike in what is left are `{NAMES[a]}` and `{NAMES[b]}` (r = {typeset(f'{r[a, b]:.2f}')})."


def nearest(study: AllowedStudy) -> str:
    """Facts out of reach, and those nearest to it."""
    found = sorted((line for line in lines(study) if np.isfinite(line.nearest)), key=lambda line: -line.nearest)
    beyond = [line for line in found if line.out_of_reach]
    told = ", ".join(f"{_named(line.fact)} ({line.nearest:.1f})" for line in found[:2])
    return f"Out of reach are {len(beyond)} numbers; the farthest from every finger, in deviations: {told}."


def best(study: AllowedStudy) -> list[str]:
    """Each of those that were built in full beside the default finger at its low force, and what the rule says."""
    force = NAMES.index(LOW_FORCE)
    found = []
    rows = zip(study.best.numbers, study.best.values, study.best.facts, study.alike.facts, strict=True)
    for number, values, own, alike in rows:
        halves = "; ".join(
            f"{name} {_scored(own, flags)} for {_scored(alike, flags)}"
            for name, flags in (("choose", CHOOSES), ("check", ~CHOOSES))
        )
        rule = "passes the rule" if better(own, alike) else "does not pass the rule"
        found.append(f"Finger {number} at {values[force]:.2f} gwt, ruled out and rms: {halves}: {rule}.")
    return found


def _named(fact: Fact) -> str:
    return f"“{typeset(fact.says)}” ({fact.figure})"


def _scored(facts: Array, flags: NDArray[np.bool_]) -> str:
    out, rms = score(facts, flags)
    return f"{out}, {rms:.2f}"


def _column(key: str) -> int:
    return list(BY_KEY).index(key)


def percent(share: float) -> str:
    """7.8 %, 71 %, or nothing."""
    return "nothing" if share == 0 else f"{100 * share:.2g} %"


def typeset(text: str) -> str:
    """With a minus."""
    return text.replace("-", "−")
