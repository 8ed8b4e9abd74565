"""What the recording of one afferent says, as sections of the report; every number is of one `AfferentVerdict`."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import numpy as np

from rig.compare.verdict import LEVEL, AfferentVerdict, PairRow
from rig.compare.verdict_text import methods, percent, probability, sentence, sentences
from rig.report import verdict_figures
from rig.report.page import PageFigure, Section, figures_of
from rig.report.style import as_limits, as_number
from rig.report.verdict_figures import STIMULI_ACROSS, apart, drawn_pairs, most_telling, of_stimulus, ranking, rival

_PAIR = (
    "pair", "in the set", "misfit F", "p of the fit", "p in the set", "left out: predicted", "k [95 %]",
    "ε₀ [95 %]", "R²", "remarks",
)  # fmt: skip
_NOTHING = "Nothing was recorded (--recorded SHAPE=FILE), so that nothing is explained. What follows is a simulation."
_TOO_FEW = "Too few recorded positions are covered by the runs to say which measure explains them."
_WOULD_CHANGE = {
    "explained": "The answer would be another if a control came into the set, or if with less noise the fit of every "
    "pair of the set were rejected.",
    "not beyond controls": "The answer would be another if the controls in the set were rejected: with more presses, "
    "or with stimuli under which they differ from the measures.",
    "nothing": "The answer would be another if the noise were larger than it is taken for, on another finger "
    "(--fingers says how well it is known), for receptors between or below those tried (--receptor-x-mm, "
    "--receptor-depth-mm), or for a rate that saturates.",
}


def answer_sections(answers: Sequence[AfferentVerdict], frame: str, *, recorded: bool) -> list[Section]:
    """In the order of the page, of several afferents each in turn; `frame` is printed on every figure."""
    if not answers:
        return [Section("Verdicts", _TOO_FEW if recorded else _NOTHING)]
    return [section for one in answers for section in _sections(one, frame, _of(one, answers))]


def _of(answer: AfferentVerdict, answers: Sequence[AfferentVerdict]) -> str:
    return f": {answer.title}" if len(answers) > 1 else ""


def _sections(answer: AfferentVerdict, frame: str, of: str) -> list[Section]:
    besides = (*sentences(answer), *_other_measure(answer), _WOULD_CHANGE[answer.outcome])
    return [
        Section(f"Verdicts{of}", sentence(answer), figures=(_verdict(answer, frame, of),)),
        Section(f"What goes with it, and what would change it{of}", "", points=besides),
        _recorded(answer, frame, of),
        _residuals(answer, frame, of),
        _fits(answer, of),
        _controls(answer, of),
        *_together(answer, of),
        Section(f"Methods, to be pasted{of}", methods(answer)),
    ]


def _verdict(answer: AfferentVerdict, frame: str, of: str) -> PageFigure:
    shown = most_telling(answer)
    all_of_them = len(shown) == len(answer.stimuli)
    some = "" if all_of_them else f"The {len(shown)} of {len(answer.stimuli)} stimuli that tell most. "
    return PageFigure(
        f"Verdicts{of}",
        verdict_figures.the_answer(answer, shown, frame),
        f"{some}Above: recorded rates, and what the likeliest pair of measure and receptor, the likeliest pair of "
        "another measure and the likeliest control predict there; grey crosses: positions left out. Below: the "
        "likeliest receptor of the likeliest measures and controls, best first, with the p of its own fit.",
    )


def _other_measure(answer: AfferentVerdict) -> list[str]:
    """By how much the likeliest other measure is worse, and where to record for telling them apart."""
    first, other, distance = answer.headline or answer.closest, rival(answer), apart(answer)
    if other is None or distance is None:
        return []
    kept = "in the set, too" if other.in_set else "not in the set" if other.fits else "rejected by its own fit"
    k = int(np.argmax(np.nan_to_num(distance)))
    rates = f"{as_number(float(first.predicted[k]))} against {as_number(float(other.predicted[k]))}"
    by = (
        f"Of other measures the likeliest is {other.title}: its deviance is larger by "
        f"{as_number(other.deviance - first.deviance)} times the noise, and it is {kept}."
    )
    return [
        *([] if other is answer.next else [by]),
        f"Of the recorded positions {_place(answer, k)} tells {other.title} from {first.title} best: {rates}, "
        f"{as_number(float(distance[k]), 2)} standard errors apart. More presses there change the answer soonest.",
    ]


def _place(answer: AfferentVerdict, k: int) -> str:
    places = answer.places
    return f"{as_number(float(places.position_mm[k]))} mm under {answer.stimuli[places.stimulus[k]]}"


def _recorded(answer: AfferentVerdict, frame: str, of: str) -> Section:
    title = f"Recorded over predicted{of}"
    over = figures_of(
        title,
        range(len(answer.stimuli)),
        STIMULI_ACROSS,
        lambda shown: verdict_figures.profiles(answer, shown, frame),
        "One k and ε₀ for all stimuli. Bars: one standard error of the mean. Lines join what is predicted at the "
        "recorded positions. Crosses: recorded positions that are left out, since a receptor in play does not see "
        f"them in the simulation. {', '.join(answer.recordings)}.",
    )
    against = PageFigure(
        f"Rate against measure{of}",
        verdict_figures.scatter(answer, frame),
        "Each point is a recorded position; the measure is interpolated linearly in the SSRP. Black: the fit.",
    )
    return Section(
        title,
        "The likeliest pair, the likeliest pair of another measure, and the likeliest control. The answer would "
        "change where a prediction leaves the bars at many neighbouring places: see the residuals.",
        figures=(*over, against),
    )


def _residuals(answer: AfferentVerdict, frame: str, of: str) -> Section:
    title = f"Residuals by position{of}"
    figures = figures_of(
        title,
        range(len(answer.stimuli)),
        STIMULI_ACROSS,
        lambda shown: verdict_figures.residuals(answer, shown, frame),
        "Shaded: two standard deviations of the noise.",
    )
    limit = as_number(2 / max(len(_neighbours(answer)), 1) ** 0.5, 2)
    return Section(
        title,
        "Noise alone leaves 95 of 100 residuals within two standard deviations, and neighbours do not go together "
        f"(|r| below {limit} here). Where they do, the measure lacks a part of the form, and one that has it would "
        "change the answer, even if no test rejects the fit yet.",
        points=tuple(f"{row.title}: {_residual_words(answer, row)}" for row in drawn_pairs(answer)),
        figures=tuple(figures),
    )


def _neighbours(answer: AfferentVerdict) -> list[tuple[int, int]]:
    """Numbers of the places that follow each other under one stimulus."""
    ordered = [of_stimulus(answer, number).tolist() for number in range(len(answer.stimuli))]
    return [pair for mine in ordered for pair in pairwise(mine)]


def _residual_words(answer: AfferentVerdict, row: PairRow) -> str:
    size = row.residual
    k = int(np.argmax(np.abs(size)))
    beyond = int((np.abs(size) > verdict_figures.USUAL).sum())
    products = sum(float(size[a] * size[b]) for a, b in _neighbours(answer))
    r = products / (float(size @ size) or 1.0)
    return (
        f"the largest is {as_number(float(size[k]), 2)} ({_place(answer, k)}), {beyond} of {len(size)} are beyond "
        f"two, neighbours go together with r = {as_number(r, 2)}."
    )


def _fits(answer: AfferentVerdict, of: str) -> Section:
    finger = "They hold for this finger (--fingers states how well it is known)."
    if answer.fingers > 1:
        finger = f"The finger was fitted with each pair, between {answer.fingers} fingers of the stated ranges."
    figure = PageFigure(
        f"Every pair of measure and receptor{of}",
        verdict_figures.every_pair(answer),
        "Colour: lack-of-fit F of each measure and control at each receptor; noise alone gives about 1. Filled: in "
        "the set; ring: fits, but worse; none: rejected by its own fit. White: no fit.",
    )
    rest = [row for row in ranking(answer) if not row.in_set]
    return Section(
        f"Fits to what was recorded{of}",
        "The set: pairs whose own fit is not rejected and that lie in the model confidence set, both at "
        f"{percent(LEVEL)} without correction, all over the same {len(answer.places.rate)} positions. A pair would "
        f"leave it if either p fell below {LEVEL:g}. Below the set: the likeliest receptor of the likeliest others. "
        "The intervals in a row are those of this pair; over whichever receptor of the set they are listed first. "
        f"{finger}",
        _PAIR,
        tuple(_cells(row) for row in (*answer.set, *rest)),
        (figure,),
        tuple(_over_receptors(answer, name) for name in dict.fromkeys(row.name for row in answer.set)),
    )


def _over_receptors(answer: AfferentVerdict, name: str) -> str:
    k, eps0 = (_interval(answer.interval(name, of)) for of in _OF)
    return f"{name}, at whichever receptor of the set: k in {k}, ε₀ in {eps0}."


_OF: tuple[Literal["k", "eps0"], ...] = ("k", "eps0")


def _cells(row: PairRow) -> tuple[str, ...]:
    remarks = ["fires unloaded"] * row.fires_unloaded + ["k < 0"] * bool(row.k < 0)
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
        "No measures of what is under the skin, judged like one, each at its likeliest receptor. A measure that does "
        "not beat them has explained nothing: the answer would change if one of these came into the set.",
        _PAIR,
        tuple(_cells(row) for row in sorted(best.values(), key=lambda row: row.deviance)),
        points=tuple(
            f"Were {one.control} what the afferent follows, {one.pair} would imitate it best, and be rejected with a "
            f"probability of {one.probability:.2f}."
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
            f"One afferent, fitted once{of}",
            f"Fits of {answer.closest.title} to each stimulus alone {differ} from the one fit of all (F({a}, {b}) = "
            f"{as_number(found.ratio)}, {probability(found.p)}). Where they do, the afferent, its place or the "
            "finger was another from stimulus to stimulus, or the law is; the answer holds for each alone.",
            ("stimulus", "k", "ε₀", "predicted from the other stimuli"),
            tuple((one.stimulus, _finite(one.k), _finite(one.eps0), percent(one.left_out)) for one in found.separate),
        )
    ]
