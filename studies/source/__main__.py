"""Compute every fact of Raju 1998 anew, and compare it with the source by the bounds in `facts.csv`.

    .venv/bin/python -m studies.source          # all; some minutes; exits with 1 if a verdict changed
    .venv/bin/python -m studies run source      # the same, and stores the table

A bound holds two limits, for "agrees" and for "partly": shares of a printed number (3.5 ± 10 %, ± 25 %), distances
from it (−1.6 ± 0.17, ± 0.51), least or largest values (≤ 1000, ≤ 1200), or words (2; in part 1). Bounds were set
knowing the numbers of the default finger. `cannot be said` stays where the source does not say enough.
"""

import re
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Literal, NamedTuple

from sim.errors import ModelRangeError
from studies.registry import as_markdown, read_table
from studies.source import chapter_6, formula, pressures, profiles
from studies.source.answers import HIGH_GWT, LOW_GWT, ROW_DEPTH_MM, FingerAnswers, deep, forced

Word = Literal["agrees", "partly", "differs"]
Value = float | str
TABLE = "source/facts"
UNKNOWN = "cannot be said"

_NUMBER = r"([−\d.e]+)"
_NEAR = re.compile(rf"{_NUMBER} ± {_NUMBER}( %)?, ± {_NUMBER}(?: %)?")
_LIMITS = re.compile(rf"([≤≥]) {_NUMBER}, [≤≥] {_NUMBER}")


class Fact(NamedTuple):
    """How a fact is measured, and how its number is written."""

    measure: Callable[[FingerAnswers], Value]
    form: str = "{:.2f}"

    def written(self, value: Value) -> str:
        """Return a value with typographic signs."""
        text = value if isinstance(value, str) else self.form.format(value)
        return text.replace("-", "−").replace("%", " %")


def verdict(bound: str, ours: Value) -> Word:
    """Return what a bound says of a value; what is not a number differs. Raises ValueError for another bound."""
    if found := _NEAR.fullmatch(bound):
        value, share = number(found[1]), abs(number(found[1])) / 100 if found[3] else 1.0
        off = abs(float(ours) - value)
        return _word(off <= number(found[2]) * share, off <= number(found[4]) * share)
    if found := _LIMITS.fullmatch(bound):
        sign = 1 if found[1] == "≤" else -1
        return _word(*(sign * float(ours) <= sign * number(limit) for limit in found.groups()[1:]))
    agrees, separator, partly = bound.partition("; in part ")
    if not separator:
        raise ValueError(f"{bound!r} is no bound")
    return _word(ours in agrees.split(" or "), ours in partly.split(" or "))


def number(text: str) -> float:
    """Read a number with typographic signs."""
    return float(text.replace("−", "-"))


def _word(agrees: bool, partly: bool) -> Word:
    return "agrees" if agrees else "partly" if partly else "differs"


def _f(measure: Callable[..., Value], *given: object, form: str = "{:.2f}", **named: object) -> Fact:
    """Return a fact measured by a function of the answers and of what is given."""
    return Fact(lambda answers: measure(answers, *given, **named), form)


_percent = partial(_f, form="{:.0%}")
_tenths = partial(_f, form="{:.1%}")
_whole = partial(_f, form="{:.0f}")
_thousandths = partial(_f, form="{:.3f}")


def _apex(answers: FingerAnswers, name: str) -> float:
    return float(getattr(answers.finger.surface.apex, name))


def _doi_mm(answers: FingerAnswers, force_gwt: float) -> float:
    return answers.press(forced("step:5", force_gwt, pressures.LONG_X_MM)).doi_mm


def _under_step_1(force: float | None, measure: str) -> Fact:
    x_mm = pressures.TABLE_X_MM
    scene = deep("step:1", 0.73, x_mm) if force is None else forced("step:1", force, x_mm)
    return _f(pressures.count, scene, measure)


# By page of the source, in the order of the table.
FACTS: dict[str, tuple[Fact, ...]] = {
    "ch. 3, geometry": (
        _f(_apex, "lateral_radius_mm"),
        _f(_apex, "axial_radius_mm"),
        _f(pressures.apex_x_mm),
        _thousandths(pressures.widest_element_mm),
        _whole(lambda answers: answers.finger.model.nodes),
    ),
    "4-1": (
        *(_f(pressures.edges, "bar:3.0", doi) for doi in (0.33, 0.67, 1.0, 1.33)),
        _f(pressures.widest_contact_mm),
    ),
    "ch. 4, bar 1.5": tuple(_f(pressures.edges, "bar:1.5", doi) for doi in (0.33, 0.67)),
    "4-3": (*(_tenths(pressures.more_force, doi) for doi in (0.33, 1.0)), _percent(pressures.higher_peak)),
    "4-4": (
        _whole(lambda answers: pressures.peak(answers, pressures.highest(answers, "1"))),
        _f(lambda answers: pressures.highest(answers, "1").x_mm),
        _f(lambda answers: f"{len(pressures.region_peaks(answers, pressures.AT_TABLE))}"),
        _f(pressures.comparable),
        _f(pressures.share, "1", pressures.CONCAVE),
        _f(lambda answers: pressures.shares(answers, pressures.AT_TABLE)[pressures.UPPER_FLAT]),
        _thousandths(pressures.flats),
    ),
    "4-5": (
        _whole(lambda answers: pressures.peak(answers, pressures.highest(answers, "5"))),
        _whole(lambda answers: max(len(pressures.region_peaks(answers, one)) for one in pressures.MOVED["5"])),
        _f(pressures.share, "5", pressures.CONCAVE),
        *(_thousandths(_doi_mm, force) for force in (HIGH_GWT, LOW_GWT)),
    ),
    "ch. 4, SED under step 1": tuple(_under_step_1(f, m) for m in ("sed", "s33") for f in (None, LOW_GWT)),
    "4-7": tuple(
        _tenths(pressures.second_maximum, forced("step:5", force, pressures.LONG_X_MM))
        for force in (HIGH_GWT, LOW_GWT)
    ),
    "4-8": (
        *(_f(pressures.apart, depth_mm) for depth_mm in (pressures.DEEP_MM, ROW_DEPTH_MM)),
        *(_f(pressures.sed_maxima, shape) for shape in pressures.SHAPES),
    ),
    "4-9, Eq. 4.1, 4.2": (
        _whole(formula.least_k2_over_k1),
        *(_whole(formula.least, k) for k in range(3)),
        _f(formula.k2_with_curvature),
    ),
    "5-3": (
        *(_f(pressures.two_highest, forced("step:1", force, -2.25)) for force in (HIGH_GWT, LOW_GWT)),
        _f(pressures.growth, form="{:.1f}"),
    ),
    "ch. 5, two forces": tuple(_f(pressures.alike, x_mm) for x_mm in pressures.PAIRED),
    "ch. 5, widths": (_f(pressures.width_ratio),),
    "5-5, 5-6, 5-7": (
        *(_f(profiles.step_in_words, x_mm) for x_mm in (-2.0, *profiles.WITH_A_DIP_MM)),
        _f(profiles.peak_over_dip),
        _f(profiles.dip_follows),
    ),
    "5-10, 5-11": (
        *(_percent(profiles.second_at_zero, width, m) for width in ("3.0", "1.5") for m in profiles.OF_ALL),
        *(_percent(profiles.second_at_zero, width, "e13") for width in ("3.0", "1.5")),
        _f(profiles.shallower),
        *(_f(profiles.least_mirrored, width) for width in ("3.0", "1.5")),
    ),
    "5-12, 5-13": tuple(_f(profiles.recorded_r, measure) for measure in profiles.OF_ALL),
    "Table 5.2": tuple(_f(profiles.score, name) for name in ("matthews", "precision", "recall")),
    "ch. 5, survivors": tuple(_f(profiles.overlap, bars=bars) for bars in (False, True)),
    "6-3, 6-4, Table 6.1": (
        *(
            _f(chapter_6.law, where, name, form="{:.2f}" if name == "m" else "{:.1%}")
            for where in ("pulp", "all")
            for name in ("m", "m_spread", "a_spread")
        ),
        _f(chapter_6.site_10, "m"),
        _thousandths(chapter_6.site_10, "r2"),
    ),
    "ch. 6, impulse responses": (
        _thousandths(chapter_6.opposite, "correlation"),
        _percent(chapter_6.opposite, "relative_l2"),
        *(_f(chapter_6.at_rest, k) for k in range(3)),
    ),
    "6-8 … 6-12": (
        _f(chapter_6.first_move, form="{:.1f}"),
        _f(chapter_6.ends_off, None, form="{:.0e}"),
        _thousandths(chapter_6.ends_off, 1.0),
        *(_thousandths(chapter_6.under_noise, snr_db) for snr_db in (20, 10)),
    ),
}


def computed(rows: Iterable[Sequence[str]], answers: FingerAnswers) -> list[list[str]]:
    """Return the facts with ours and the verdict computed anew."""
    found = []
    facts = [fact for of_page in FACTS.values() for fact in of_page]
    for (page, claim, source, bound, _, before), fact in zip(rows, facts, strict=True):
        try:
            value = fact.measure(answers)
        except ModelRangeError as error:
            raise RuntimeError(f"{page}, {claim}: {error}") from error
        word = UNKNOWN if before == UNKNOWN else verdict(bound, value)
        found.append([page, claim, source, bound, fact.written(value), word])
    return found


def main() -> int:
    """Print the table; return 1 if a verdict has changed."""
    head, *rows = read_table(TABLE)
    found = computed(rows, FingerAnswers())
    print(as_markdown([head, *found]))
    print(", ".join(f"{count} {word}" for word, count in Counter(row[-1] for row in found).items()))
    changed = [(old, new) for old, new in zip(rows, found, strict=True) if old[-1] != new[-1]]
    for old, new in changed:
        print(f"{new[0]}, {new[1]}: {old[-1]} became {new[-1]}", file=sys.stderr)
    return int(bool(changed))


if __name__ == "__main__":
    sys.exit(main())
