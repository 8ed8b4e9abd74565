"""A verdict in words, and a paragraph on methods for a paper."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from rig.compare.candidate_measures import DISCREPANCY, OF_THE_MESH, SEEN
from rig.compare.fit import FEWEST_POSITIONS
from rig.compare.likelihood import FEWEST_SPIKES
from rig.compare.model_confidence_set import BLOCK, BLOCKS, DRAWS, HARDLY
from rig.compare.verdict import LEVEL, AfferentVerdict, Mimic, PairRow, in_mm
from rig_shared.plural import number_of
from sim.measures.measures import MEASURES

FROM = {
    "repeats": "estimated from repeated presses",
    "sd": "given with the rates",
    "neighbours": "estimated from differences between neighboring positions, since there are no repeats",
}

TOO_FEW = (
    f"There is no verdict: the runs cover fewer than {FEWEST_POSITIONS} recorded positions at the same receptors."
)


def sentence(answer: AfferentVerdict) -> str:
    """Return the verdict in one sentence."""
    if answer.outcome == "silent":
        return _silent(answer)
    best = answer.headline
    if best is None:
        row = answer.closest
        return (
            f"No measure explains this recording within its noise. The closest, {row.title}, {_why_not(row)}, "
            f"although {_explains(row)}."
        )
    among = listed(answer.set)
    if answer.outcome == "not beyond controls":
        return (
            f"No measure is shown to explain this recording: {among} cannot be distinguished from "
            f"{listed(answer.controls_in_set)}. A measure that does not beat a control explains nothing."
        )
    if len(answer.set) == 1:
        return f"{best.title} explains this recording, and none of the other pairs does: {_explains(best)}."
    return (
        f"Several pairs explain this recording and cannot be distinguished by it: {among}. "
        f"The maximum-likelihood pair is {best.title}: {_explains(best)}."
    )


def _silent(answer: AfferentVerdict) -> str:
    if answer.spikes is None:
        return "There is no verdict: the recorded rate is 0 at every position."
    spikes = {0: "no spike", 1: "one spike"}.get(answer.spikes, f"only {number_of(answer.spikes, 'spikes')}")
    return (
        f"There is no verdict: this recording has {spikes} in the windows of all presses together, and a verdict "
        f"needs at least {FEWEST_SPIKES}."
    )


def sentences(answer: AfferentVerdict) -> list[str]:
    """Return further sentences, most important first."""
    if answer.outcome == "silent":
        return [positions(answer), *answer.not_observed]
    further = [
        _next(answer),
        _controls(answer),
        _ceiling(answer),
        *_powers(answer),
        _together(answer),
        positions(answer),
        *answer.not_observed,
    ]
    return [one for one in further if one]


def listed(rows: Sequence[PairRow]) -> str:
    """Return pairs as text, e.g. "ep1 and e11 at −1.25 and −1 mm, sed at 0 mm", in the order of the rows."""
    names = dict.fromkeys(row.name for row in rows)
    places = {name: sorted(row.receptor_mm for row in rows if row.name == name and row.receptor_mm is not None)
              for name in names}  # fmt: skip
    return ", ".join(
        f"{_and(list(alike))} at {_and(list(map(in_mm, at)))} mm" if at else ", ".join(alike)
        for at, alike in groupby(names, places.get)
    )


def percent(share: float) -> str:
    """Format a share, e.g. "93 %"; negative if worse than the mean."""
    return "–" if np.isnan(share) else f"{100 * share:.0f} %".replace("-", "−")


def probability(p: float) -> str:
    """Format a p value, e.g. "p = 0.03"."""
    return "p < 0.001" if p < 0.001 else f"p = {p:.2g}"


def _and(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _explains(row: PairRow) -> str:
    return f"it predicts {percent(row.left_out)} of the held-out deviance"


def _why_not(row: PairRow) -> str:
    if not row.fits:
        return f"is rejected by its lack of fit ({probability(row.p_fit)})"
    return f"is worse than a control ({probability(row.p_set)})"


def _next(answer: AfferentVerdict) -> str:
    row = answer.next
    if answer.headline is None:
        return ""
    if row is None:
        return (
            "No pair of a measure and a receptor can be excluded; the recording does not discriminate between them."
        )
    why = "its fit is rejected" if not row.fits else "it is outside the model confidence set"
    by = probability(row.p_fit if not row.fits else row.p_set)
    more = f"{answer.worse_by:.1f}".replace("-", "−")
    return (
        f"The next pair is {row.title}. Its deviance is larger by {more} times the noise, and {why} ({by}); "
        f"it predicts {percent(row.left_out)} of the held-out deviance."
    )


def _controls(answer: AfferentVerdict) -> str:
    if not answer.controls:
        return ""
    first = answer.controls[0]
    inside = (
        f"Controls in the set: {listed(answer.controls_in_set)}"
        if answer.controls_in_set
        else "No control is in the set"
    )
    share = percent(first.left_out)
    return f"{inside}. The maximum-likelihood control, {first.title}, predicts {share} of the held-out deviance."


def _ceiling(answer: AfferentVerdict) -> str:
    if answer.ceiling_from == "repeats":
        return f"Its repeats limit the explainable share of the recording's variance to {percent(answer.ceiling)}."
    return (
        f"The explainable share of the recording's variance is at most {percent(answer.ceiling)}: the best "
        "monotone function of any candidate predicts this share of the held-out data."
    )


def _powers(answer: AfferentVerdict) -> list[str]:
    """Return sentences on the misfits and controls that the noise conceals."""
    rms = percent(answer.power.detectable)
    found = [
        (f"A misfit of {rms} of the largest rate (rms) would be detected in {percent(SEEN)} of such recordings.")
    ]
    blind = [one for one in answer.power.mimics if one.probability < SEEN]
    return found + [_blind(one) for one in blind]


def _blind(one: Mimic) -> str:
    return (
        f"If {one.control} were true, {one.pair} would imitate it and be rejected with a probability of only "
        f"{one.probability:.2f}."
    )


def _together(answer: AfferentVerdict) -> str:
    found = answer.together
    if found is None:
        return ""
    differ = "differ" if found.p < LEVEL else "do not differ"
    return (
        f"Fitted separately to each of {len(found.separate)} stimuli, k and ε₀ of {answer.closest.title} "
        f"{differ} from the joint fit ({probability(found.p)})."
    )


def positions(answer: AfferentVerdict) -> str:
    """Return a sentence on the recorded positions that the comparison uses."""
    used = len(answer.places.rate)
    if not answer.left_out:
        return f"All {used} recorded positions are used."
    return " ".join(
        [f"{used} of {answer.recorded} recorded positions are used.", *(one.sentence for one in answer.left_out)]
    )


def methods(answer: AfferentVerdict) -> str:
    """Return a paragraph on data, methods and result; of a silent afferent, the result alone."""
    if answer.outcome == "silent":
        return _silent(answer)
    return " ".join(
        [
            _data(answer),
            _model(answer),
            _test(answer),
            _set(answer),
            _prediction(answer),
            *_fingers(answer),
            _result(answer),
        ]
    )


def _data(answer: AfferentVerdict) -> str:
    names = dict.fromkeys(row.name for row in answer.controls)
    places = len({row.receptor_mm for row in answer.measures})
    return (
        f"Responses to {', '.join(answer.stimuli)} were compared with {len(MEASURES)} measures of stress and "
        f"strain, and with controls ({', '.join(names)}), at {places} receptors in a finite-element model of "
        f"the fingertip. All pairs were compared over the same {len(answer.places.rate)} of {answer.recorded} "
        "recorded positions." + "".join(f" {one}" for one in answer.not_observed)
    )


def _model(answer: AfferentVerdict) -> str:
    law = "R = z / (1 + s·z) with z = max(0, k(ε − ε₀))" if answer.saturating else "R = max(0, k(ε − ε₀))"
    rest = ", with k > 0 and ε₀ ≥ 0," if answer.silent_at_rest else ""
    noise = answer.noise
    kind = {
        "counts": f"quasi-likelihood of spike counts (variance {noise.dispersion:.2f} times the mean",
        "sd": "normal likelihood of rates with their standard deviations (known",
        "rates": f"normal likelihood of rates with one standard deviation for all ({noise.dispersion**0.5:.3g}",
    }[noise.kind]
    return (
        f"For each pair of measure and receptor {law}{rest} was fitted once to all stimuli by {kind}, "
        f"{FROM[noise.source]})."
    )


def _test(answer: AfferentVerdict) -> str:
    noise = answer.noise
    freedom = "known" if noise.freedom > 1e6 else f"{noise.freedom:.0f} degrees of freedom"
    return (
        f"A pair was rejected when its lack of fit exceeded the noise ({freedom}) in an F test at {percent(LEVEL)}, "
        "uncorrected; intervals of k and ε₀ are 95 % profile-likelihood intervals, over the receptors of the set."
    )


def _set(answer: AfferentVerdict) -> str:
    return (
        f"Pairs that were not rejected were retained if they were in the {percent(1 - LEVEL)} model "
        f"confidence set (Hansen, Lunde & Nason 2011; range statistic, {DRAWS} draws of blocks of {BLOCK} "
        f"neighboring positions; differences in deviance below {HARDLY:g} count as none)."
    )


def _prediction(answer: AfferentVerdict) -> str:
    out = "each stimulus in turn" if answer.together else f"each of {BLOCKS} blocks of positions in turn"
    return (
        f"Prediction was assessed by leaving out {out}, as the explained share of the deviance about the "
        "mean of the remaining data."
    )


def _fingers(answer: AfferentVerdict) -> list[str]:
    if answer.fingers == 1:
        return []
    return [
        (
            f"The finger's uncertain parameters were fitted with each pair, among {answer.fingers} simulated "
            f"fingers. The test allowed for a discrepancy of {percent(DISCREPANCY)} of the spread between these "
            f"fingers and of {percent(OF_THE_MESH)} of the largest rate."
        )
    ]


def _result(answer: AfferentVerdict) -> str:
    best, size = answer.headline, len(answer.set)
    if best is None:
        row = answer.closest
        return (
            f"No pair was retained; the closest, {row.title}, had F = {row.lack_of_fit:.2f} "
            f"({probability(row.p_fit)})."
        )
    ratio = f"F = {best.lack_of_fit:.2f}, {probability(best.p_fit)}"
    control = f", and {len(answer.controls_in_set)} of the controls" if answer.controls_in_set else ""
    fitted = f"k = {best.k:.3g}, ε₀ = {best.eps0:.3g}"
    return (
        f"{size} of {len(answer.measures)} pairs were retained{control}; the maximum-likelihood pair, "
        f"{best.title} ({fitted}), had {ratio} and predicted {percent(best.left_out)} of the held-out "
        "deviance."
    )
