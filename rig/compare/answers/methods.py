"""A paragraph on methods, with every number in it, that can be pasted into a paper."""

from rig.compare.answers.answer import LEVEL, Answer
from rig.compare.answers.candidates import DISCREPANCY, OF_THE_MESH
from rig.compare.answers.confidence_set import BLOCK, DRAWS, HARDLY
from rig.compare.answers.prediction import BLOCKS
from rig.compare.answers.wording import FROM, percent, probability
from sim.measures.measures import MEASURES


def methods(answer: Answer) -> str:
    """What was done, on what, and what came out."""
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


def _data(answer: Answer) -> str:
    names = dict.fromkeys(row.name for row in answer.controls)
    places = len({row.receptor_mm for row in answer.measures})
    return (
        f"Responses to {', '.join(answer.stimuli)} were compared with {len(MEASURES)} measures of stress and strain, "
        f"and with controls ({', '.join(names)}), at {places} receptors in a finite-element model of the fingertip, "
        f"over {len(answer.places.rate)} of {answer.recorded} recorded positions, the same for all."
    )


def _model(answer: Answer) -> str:
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


def _test(answer: Answer) -> str:
    noise = answer.noise
    freedom = "known" if noise.freedom > 1e6 else f"{noise.freedom:.0f} degrees of freedom"
    return (
        f"A pair was rejected when its lack of fit exceeded the noise ({freedom}) in an F test at {percent(LEVEL)}, "
        "uncorrected; intervals of k and ε₀ are 95 % profile-likelihood intervals, over the receptors of the set."
    )


def _set(answer: Answer) -> str:
    return (
        f"Pairs that were not rejected were kept if they were in the {percent(1 - LEVEL)} model confidence set "
        f"(Hansen, Lunde & Nason 2011; range statistic, {DRAWS} draws of blocks of {BLOCK} neighbouring "
        f"positions; differences in deviance below {HARDLY:g} count as none)."
    )


def _prediction(answer: Answer) -> str:
    out = "each stimulus in turn" if answer.together else f"each of {BLOCKS} blocks of positions in turn"
    return f"Prediction was judged by leaving out {out}, as the share of the deviance about the mean of the rest."


def _fingers(answer: Answer) -> list[str]:
    if answer.fingers == 1:
        return []
    return [
        f"The finger's uncertain parameters were fitted with each pair, between {answer.fingers} simulated fingers, "
        f"and the test allowed for a discrepancy of {percent(DISCREPANCY)} of the spread between these and of "
        f"{percent(OF_THE_MESH)} of the largest rate."
    ]


def _result(answer: Answer) -> str:
    best, size = answer.headline, len(answer.set)
    if best is None:
        row = answer.closest
        return (
            f"No pair was kept; the closest, {row.title}, had F = {row.lack_of_fit:.2f} ({probability(row.p_fit)})."
        )
    ratio = f"F = {best.lack_of_fit:.2f}, {probability(best.p_fit)}"
    control = f", and {len(answer.controls_in_set)} of the controls" if answer.controls_in_set else ""
    fitted = f"k = {best.k:.3g}, ε₀ = {best.eps0:.3g}"
    return (
        f"{size} of {len(answer.measures)} pairs were kept{control}; the likeliest, {best.title} ({fitted}), had "
        f"{ratio} and predicted {percent(best.left_out)} of what was left out."
    )
