"""Sections of the report on one afferent; every number comes from one `AfferentVerdict`."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import numpy as np

from rig.compare.verdict import LEVEL, AfferentVerdict, PairRow
from rig.compare.verdict_text import TOO_FEW, methods, percent, probability, sentence, sentences
from rig.report import verdict_figures
from rig.report.page_parts import Section, figures_of
from rig.report.plot import Plot
from rig.report.style import as_limits, as_number
from rig.report.verdict_figures import STIMULI_ACROSS, apart, most_telling, of_stimulus, plotted_pairs, ranking, rival

_PAIR = (
    "pair", "in the set", "misfit F", "p of the fit", "p in the set", "held-out deviance predicted", "k [95 %]",
    "ε₀ [95 %]", "R²", "remarks",
)  # fmt: skip
_NOTHING = (
    "No recording was given (`--recorded SHAPE=FILE`), so no measure is tested. The rest of this page is a "
    "simulation."
)
_WOULD_CHANGE = {
    "explained": (
        "The answer would change if a control entered the set, or if, with less noise, the fit of "
        "every pair of the set were rejected."
    ),
    "not beyond controls": (
        "The answer would change if the controls in the set were rejected, by more "
        "presses or by stimuli under which they differ from the measures."
    ),
    "nothing": (
        "The answer would change if the noise were larger than estimated, for another finger "
        "(--fingers states the range), for receptors between or below those tested (--receptor-x-mm, "
        "--receptor-depth-mm), or for a rate that saturates."
    ),
}


def answer_sections(
    answers: Sequence[AfferentVerdict], frame: str, *, recorded: bool, instead: Sequence[Plot] = ()
) -> list[Section]:
    """Return the sections of each afferent in page order.

    `frame` is printed on every figure; `instead` are the figures of a page without a verdict.
    """
    if not answers:
        return [Section("Verdicts", TOO_FEW if recorded else _NOTHING, figures=tuple(instead))]
    return [section for one in answers for section in _sections(one, frame, _of(one, answers))]


def _of(answer: AfferentVerdict, answers: Sequence[AfferentVerdict]) -> str:
    return f": {answer.title}" if len(answers) > 1 else ""


def _sections(answer: AfferentVerdict, frame: str, of: str) -> list[Section]:
    if answer.outcome == "silent":
        return [Section(f"Verdicts{of}", sentence(answer))]
    besides = (*sentences(answer), *_other_measure(answer), _WOULD_CHANGE[answer.outcome])
    return [
        Section(
            f"Verdicts{of}",
            sentence(answer),
            figures=(verdict_figures.the_answer(answer, most_telling(answer), frame, of),),
        ),
        Section(f"Details, and what would change the answer{of}", "", points=besides),
        _recorded(answer, frame, of),
        _residuals(answer, frame, of),
        _fits(answer, of),
        _controls(answer, of),
        *_together(answer, of),
        Section(f"Methods text for a paper{of}", methods(answer)),
    ]


def _other_measure(answer: AfferentVerdict) -> list[str]:
    """Return by how much the best other measure is worse, and where more presses would distinguish it."""
    first, other, distance = answer.headline or answer.closest, rival(answer), apart(answer)
    if other is None or distance is None:
        return []
    status = "also in the set" if other.in_set else "not in the set" if other.fits else "rejected by its own fit"
    k = int(np.argmax(np.nan_to_num(distance)))
    rates = f"{as_number(float(first.predicted[k]))} and {as_number(float(other.predicted[k]))}"
    by = (
        f"The maximum-likelihood pair of another measure is {other.title}. Its deviance is larger by "
        f"{as_number(other.deviance - first.deviance)} times the noise, and it is {status}."
    )
    return [
        *([] if other is answer.next else [by]),
        (
            f"{other.title} and {first.title} differ most at {_place(answer, k)}: they predict {rates}, "
            f"{as_number(float(distance[k]), 2)} standard errors apart. More presses there are the most "
            "informative."
        ),
    ]


def _place(answer: AfferentVerdict, k: int) -> str:
    places = answer.places
    return f"{as_number(float(places.position_mm[k]))} mm under {answer.stimuli[places.stimulus[k]]}"


def _recorded(answer: AfferentVerdict, frame: str, of: str) -> Section:
    stimuli = range(len(answer.stimuli))
    over = figures_of(stimuli, STIMULI_ACROSS, lambda shown: verdict_figures.profiles(answer, shown, frame, of))
    return Section(
        f"Recorded over predicted{of}",
        "The maximum-likelihood pair, that of another measure, and that of a control. The answer would change "
        "where a prediction leaves the bars at many neighboring positions; see the residuals.",
        figures=(*over, verdict_figures.scatter(answer, frame, of)),
    )


def _residuals(answer: AfferentVerdict, frame: str, of: str) -> Section:
    stimuli = range(len(answer.stimuli))
    figures = figures_of(stimuli, STIMULI_ACROSS, lambda shown: verdict_figures.residuals(answer, shown, frame, of))
    limit = as_number(2 / max(len(_neighbours(answer)), 1) ** 0.5, 2)
    return Section(
        f"Residuals by position{of}",
        "With noise alone, 95 % of the residuals lie within two standard deviations, and neighbors are "
        f"uncorrelated (|r| below {limit} here). Where they are correlated, the measure misses a part of the "
        "profile's shape. A measure without this misfit would change the answer, even if no test rejects the "
        "fit yet.",
        points=tuple(f"{row.title}: {_residual_words(answer, row)}" for row in plotted_pairs(answer)),
        figures=tuple(figures),
    )


def _neighbours(answer: AfferentVerdict) -> list[tuple[int, int]]:
    """Return the indices of positions that follow each other under one stimulus."""
    ordered = [of_stimulus(answer, number).tolist() for number in range(len(answer.stimuli))]
    return [pair for mine in ordered for pair in pairwise(mine)]


def _residual_words(answer: AfferentVerdict, row: PairRow) -> str:
    size = row.residual
    k = int(np.argmax(np.abs(size)))
    beyond = int((np.abs(size) > verdict_figures.USUAL).sum())
    products = sum(float(size[a] * size[b]) for a, b in _neighbours(answer))
    r = products / (float(size @ size) or 1.0)
    return (
        f"the largest residual is {as_number(float(size[k]), 2)} ({_place(answer, k)}), {beyond} of "
        f"{len(size)} exceed two, and neighbors have r = {as_number(r, 2)}."
    )


def _fits(answer: AfferentVerdict, of: str) -> Section:
    finger = "The results hold for this finger (--fingers states a range of fingers)."
    if answer.fingers > 1:
        finger = f"The finger was fitted with each pair, among {answer.fingers} fingers of the stated ranges."
    rest = [row for row in ranking(answer) if not row.in_set]
    return Section(
        f"Fits to the recording{of}",
        "The set contains the pairs whose fit is not rejected and that lie in the model confidence set, both "
        f"at {percent(LEVEL)} without correction, all over the same {len(answer.places.rate)} positions. A "
        f"pair leaves the set if either p falls below {LEVEL:g}. Below the set: other measures and controls, each at "
        "its maximum-likelihood receptor. The intervals in a row are those of that pair; the list above gives "
        f"them over all receptors of the set. {finger}",
        _PAIR,
        tuple(_cells(row) for row in (*answer.set, *rest)),
        (verdict_figures.every_pair(answer, of),),
        tuple(_over_receptors(answer, name) for name in dict.fromkeys(row.name for row in answer.set)),
    )


def _over_receptors(answer: AfferentVerdict, name: str) -> str:
    k, eps0 = (_interval(answer.interval(name, of)) for of in _OF)
    return f"{name}, over all receptors of the set: k in {k}, ε₀ in {eps0}."


_OF: tuple[Literal["k", "eps0"], ...] = ("k", "eps0")


def _cells(row: PairRow) -> tuple[str, ...]:
    remarks = ["fires without load"] * row.fires_unloaded + ["k < 0"] * bool(row.k < 0)
    remarks += [f"{name.rpartition('.')[2]} {as_number(value)}" for name, value in (row.finger or {}).items()]
    return (
        f"{row.title} (control)" if row.control else row.title,
        "yes" if row.in_set else "no",
        _finite(row.lack_of_fit),
        *(probability(p).removeprefix("p ").removeprefix("= ") for p in (row.p_fit, row.p_set)),
        percent(row.left_out),
        f"{_finite(row.k)} {_interval(row.k_interval)}".strip(),
        f"{_finite(row.eps0)} {_interval(row.eps0_interval)}".strip(),
        _finite(row.r2),
        ", ".join(remarks),
    )


def _finite(value: float) -> str:
    return as_number(value if np.isfinite(value) else None)


def _interval(limits: tuple[float, float]) -> str:
    if not np.isfinite(limits).any():
        return ""
    return as_limits([v if np.isfinite(v) else None for v in limits]).replace(" ", "\N{NO-BREAK SPACE}")


def _controls(answer: AfferentVerdict, of: str) -> Section:
    best = {row.name: row for row in reversed(answer.controls)}
    return Section(
        f"Controls{of}",
        "Controls do not depend on the tissue below the skin. They are tested like a measure, each at its "
        "maximum-likelihood receptor. A measure that does not beat them explains nothing: the answer would change "
        "if one of them entered the set.",
        _PAIR,
        tuple(_cells(row) for row in sorted(best.values(), key=lambda row: row.deviance)),
        points=tuple(
            (
                f"If the afferent followed {one.control}, {one.pair} would imitate it best and be rejected with a "
                f"probability of {one.probability:.2f}."
            )
            for one in answer.power.mimics
        ),
    )


def _together(answer: AfferentVerdict, of: str) -> list[Section]:
    found = answer.together
    if found is None:
        return []
    a, b = (as_number(v, 4) for v in found.freedom)
    differ = "differ" if found.p < LEVEL else "do not differ"
    return [
        Section(
            f"Joint and separate fits of one afferent{of}",
            f"Separate fits of {answer.closest.title} to each stimulus {differ} from the joint fit (F({a}, "
            f"{b}) = {as_number(found.ratio)}, {probability(found.p)}). If they differ, the afferent, its "
            "location, the finger or the law changed between stimuli, and the answer holds for each stimulus "
            "alone.",
            ("stimulus", "k", "ε₀", "predicted from the other stimuli"),
            tuple((one.stimulus, _finite(one.k), _finite(one.eps0), percent(one.left_out)) for one in found.separate),
        )
    ]
