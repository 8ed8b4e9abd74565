"""An answer in words: each outcome, what goes with it, and a paragraph on methods with every number in it."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rig.compare.results import answers_as_json
from rig.compare.verdict import (
    AfferentVerdict,
    FittedPositions,
    LeftOut,
    Mimic,
    PairRow,
    Power,
    RecordingNoise,
    Separate,
    Together,
)
from rig.compare.verdict_text import listed, methods, percent, probability, sentence, sentences

ZERO = np.zeros(4)
NONE = (np.nan, np.nan)


def pair(name: str, p_fit: float, p_set: float, x: float | None, left_out: float = 0.87, **more: Any) -> PairRow:
    given: dict[str, Any] = {
        "k": 12.345, "eps0": -0.2, "saturation": 0.0, "k_interval": (10.0, 15.0), "eps0_interval": (-0.3, np.inf),
        "r": 0.9, "r2": 0.8, "deviance": 20.0, "lack_of_fit": 1.23, "eps": ZERO, "predicted": ZERO, "residual": ZERO,
    }  # fmt: skip
    control = name in ("skin pressure", "a constant rate")
    return PairRow(name, control, x, p_fit=p_fit, p_set=p_set, left_out=left_out, **(given | more))


BEST, TWIN = pair("ep1", 0.5, 1.0, -1.0), pair("ep1", 0.3, 0.4, -1.25, deviance=21.0)
SED, BAD = pair("sed", 0.3, 0.4, 0.0, deviance=22.0), pair("e13", 0.0004, 0.8, 0.5, deviance=33.25)
WORSE = pair("s11", 0.3, 0.012, 0.5, deviance=34.0)
CONTROL, CONSTANT = pair("skin pressure", 0.01, 0.3, 0.5, 0.41), pair("a constant rate", 0.0, 0.0, None, -0.03)


def answer(*rows: PairRow, **changed: Any) -> AfferentVerdict:
    places = FittedPositions(np.zeros(4, dtype=np.int64), np.arange(4.0), ZERO, ZERO)
    found = AfferentVerdict(
        "t",
        ("step:1 at 8 gwt",),
        ("a.csv",),
        places,
        4,
        (),
        RecordingNoise("counts", "repeats", 0.71, 90.0),
        0.93,
        "repeats",
        rows,
        None,
        Power(0.042, ()),
    )
    return replace(found, **changed)


def test_one_pair_explains_it() -> None:
    assert sentence(answer(BEST, BAD, CONTROL)) == (
        "ep1 at −1 mm explains this recording, and nothing else that was tried does: it predicts 87 % of the "
        "deviance of what it was not fitted to."
    )


def test_several_pairs_explain_it() -> None:
    assert sentence(answer(BEST, TWIN, SED, BAD)) == (
        "This recording is explained by ep1 at −1.25 and −1 mm, sed at 0 mm, which it cannot tell apart; the "
        "likeliest is ep1 at −1 mm: it predicts 87 % of the deviance of what it was not fitted to."
    )


def test_nothing_explains_it() -> None:
    assert sentence(answer(BAD, CONTROL)) == (
        "No measure explains this recording within its noise: the closest, e13 at 0.5 mm, is rejected by its own "
        "lack of fit (p < 0.001), though it predicts 87 % of the deviance of what it was not fitted to."
    )
    assert "the closest, s11 at 0.5 mm, is worse than a control (p = 0.012)" in sentence(answer(WORSE))
    assert "ep1" not in sentence(answer(BAD, CONTROL))


def test_a_control_does_as_well() -> None:
    control = pair("skin pressure", 0.5, 0.9, 0.5)
    assert sentence(answer(BEST, control, BAD)) == (
        "No measure is shown to explain this recording: ep1 at −1 mm cannot be told from skin pressure at 0.5 mm, "
        "and a measure that does not beat a control explains nothing."
    )


def test_the_next_pair_and_by_how_much_it_is_worse() -> None:
    (said, *_) = sentences(answer(BEST, BAD))
    assert said == (
        "The next pair, e13 at 0.5 mm, has a deviance larger by 13.2 times the noise, and its fit is rejected "
        "(p < 0.001); of what was left out it predicts 87 %."
    )
    assert "it is not in the model confidence set (p = 0.012)" in sentences(answer(BEST, WORSE))[0]
    assert sentences(answer(BEST))[0].startswith("No pair of a measure and a receptor can be excluded")
    assert not [one for one in sentences(answer(BAD)) if "next pair" in one]


def test_controls_ceiling_power_and_positions() -> None:
    mimics = (Mimic("skin pressure at 0.5 mm", "e22 at 0 mm", 0.34), Mimic("indentor curvature at 1 mm", "s11", 0.8))
    left = (LeftOut("step:1 at 8 gwt", (-2.5, 3.0)),)
    found = answer(BEST, BAD, CONTROL, CONSTANT, power=Power(0.042, mimics), recorded=6, left_out=left)
    said = sentences(found)
    assert said[1] == (
        "Of the controls none in the set; the best of them, skin pressure at 0.5 mm, predicts 41 % of what was "
        "left out."
    )
    assert said[2] == "By its repeats 93 % of the recording's variance can be explained at all."
    assert said[3] == "A misfit of 4 % of the largest rate (rms) would be seen in 80 % of such recordings."
    assert said[4] == (
        "Were skin pressure at 0.5 mm the truth, e22 at 0 mm would imitate it, and be rejected with a probability of "
        "0.34 only."
    )
    assert said[5] == (
        "4 of 6 recorded positions are used; not every receptor in play saw step:1 at 8 gwt: −2.5, 3 mm."
    )
    assert len(said) == 6
    bare = sentences(answer(BEST, BAD, ceiling_from="monotone"))
    assert bare[1] == (
        "At most 93 % of the recording's variance can be explained: so much of what was left out the best monotone "
        "function of any candidate predicts."
    )
    assert bare[-1] == "All 4 recorded positions are used."


@pytest.mark.parametrize(("p", "said"), [(0.05, "do not differ"), (0.049, "differ")])
def test_one_fit_or_several(p: float, said: str) -> None:
    separate = tuple(Separate(f"step:{n}", 1.0, 0.0, 0.5) for n in "13")
    found = answer(BEST, BAD, together=Together((2.0, 90.0), 1.5, p, separate))
    assert (
        f"Fitted to each of 2 stimuli alone, k and ε₀ of ep1 at −1 mm {said} from the one fit of all (p = {p})."
        in sentences(found)
    )


def test_numbers_in_words() -> None:
    assert [percent(v) for v in (0.934, 1.0, -0.12, np.nan)] == ["93 %", "100 %", "−12 %", "–"]
    assert [probability(p) for p in (0.0009, 0.001, 0.0449, 1.0)] == ["p < 0.001", "p = 0.001", "p = 0.045", "p = 1"]
    assert listed([CONSTANT, BEST]) == "a constant rate, ep1 at −1 mm"
    assert listed([BEST, TWIN, replace(BEST, receptor_mm=0.5)]) == "ep1 at −1.25, −1 and 0.5 mm"


KINDS: dict[str, tuple[Callable[[], AfferentVerdict], list[str]]] = {
    "counts": (
        lambda: answer(BEST, TWIN, BAD, CONTROL, CONSTANT),
        ["Responses to step:1 at 8 gwt were compared with 18 measures of stress and strain, and with controls "
         "(skin pressure, a constant rate), at 3 receptors", "over 4 of 4 recorded positions, the same for all",
         "R = max(0, k(ε − ε₀)) was fitted once to all stimuli by quasi-likelihood of spike counts (variance 0.71 "
         "times the mean, from repeated presses)", "exceeded the noise (90 degrees of freedom) in an F test at 5 %",
         "in the 95 % model confidence set (Hansen, Lunde & Nason 2011; range statistic, 500 draws of blocks of 4",
         "differences in deviance below 0.5 count as none", "leaving out each of 5 blocks of positions in turn",
         "2 of 3 pairs were kept; the likeliest, ep1 at −1 mm (k = 12.3, ε₀ = -0.2), had F = 1.23, p = 0.5 and "
         "predicted 87 % of what was left out."],
    ),
    "an sd": (
        lambda: answer(BEST, noise=RecordingNoise("sd", "sd", 1.0, np.inf)),
        ["normal likelihood of rates with their standard deviations (known, as given with the rates)",
         "(known) in an F"],
    ),
    "rates": (
        lambda: answer(BEST, noise=RecordingNoise("rates", "neighbours", 9.0, 30.0)),
        ["with one standard deviation for all (3, from differences between neighbouring positions, for want of"],
    ),
    "options": (
        lambda: answer(BEST, saturating=True, silent_at_rest=True, fingers=9,
                       together=Together((2.0, 9.0), 1.0, 0.5, ())),
        ["R = z / (1 + s·z) with z = max(0, k(ε − ε₀)), with k > 0 and ε₀ ≥ 0, was fitted",
         "leaving out each stimulus in",
         "between 9 simulated fingers, and the test allowed for a discrepancy of 50 % of the spread between these "
         "and of 2 % of the largest rate."],
    ),
    "a control in the set": (
        lambda: answer(BEST, pair("skin pressure", 0.5, 0.9, 0.5)), ["1 of 1 pairs were kept, and 1 of the controls;"]
    ),
    "nothing": (
        lambda: answer(BAD), ["No pair was kept; the closest, e13 at 0.5 mm, had F = 1.23 (p < 0.001)."]
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_methods_can_be_pasted(kind: str) -> None:
    made, parts = KINDS[kind]
    paragraph = methods(made())
    assert "\n" not in paragraph
    for part in parts:
        assert part in paragraph
    assert ("simulated fingers" in paragraph) == (kind == "options")


def test_json_has_the_answer_and_its_rows() -> None:
    separate = (Separate("step:1", 1.0, np.nan, 0.5),)
    found = answer(BEST, BAD, CONSTANT, together=Together((2.0, 90.0), 1.5, 0.25, separate),
                   left_out=(LeftOut("step:1", (9.0,)),), power=Power(0.1, (Mimic("c", "m", 0.5),)),
                   noise=RecordingNoise("sd", "sd", 1.0, np.inf))  # fmt: skip
    (told,) = json.loads(json.dumps(answers_as_json([found]), allow_nan=False))
    assert told["answer"] == sentence(found)
    assert told["besides"] == sentences(found)
    assert told["methods"] == methods(found)
    assert (told["headline"], told["next"], told["next_is_worse_by"]) == ("ep1 at −1 mm", "e13 at 0.5 mm", 13.25)
    assert told["noise"] == {"kind": "sd", "source": "sd", "dispersion": 1.0, "freedom": None}
    assert told["ceiling"] == {"share": 0.93, "from": "repeats"}
    assert told["intervals"] == {"ep1": {"k": [10, 15], "eps0": [-0.3, None]}}
    assert told["together"] == {
        "ratio": 1.5, "p": 0.25, "separate": [{"stimulus": "step:1", "k": 1.0, "eps0": None, "left_out": 0.5}]
    }  # fmt: skip
    assert told["power"] == {
        "detectable_misfit": 0.1, "mimics": [{"control": "c", "pair": "m", "probability": 0.5}]
    }  # fmt: skip
    assert told["left_out"] == [{"stimulus": "step:1", "position_mm": [9.0]}]
    assert [(row["name"], row["control"], row["in_set"]) for row in told["rows"]] == [
        ("ep1", False, True), ("e13", False, False), ("a constant rate", True, False),
    ]  # fmt: skip
    assert (told["rows"][0]["fires_unloaded"], told["rows"][0]["fits"], told["rows"][0]["finger"]) == (
        True,
        True,
        None,
    )
    (nothing,) = answers_as_json([answer(BAD)])
    assert (nothing["headline"], nothing["outcome"], nothing["next_is_worse_by"], nothing["together"]) == (
        None, "nothing", None, None,
    )  # fmt: skip
    assert answers_as_json([]) == []
