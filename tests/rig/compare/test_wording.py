"""An answer in words: each outcome, what goes with it, and a paragraph on methods with every number in it."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rig.compare.comparison_rows import answers_as_json
from rig.compare.verdict import (
    A_CONSTANT,
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
EP1 = {"measure": "ep1", "receptor_mm": -1.0}
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


def holds(text: str, *parts: str) -> bool:
    """Whether the names and numbers are in a text, in this order."""
    at = 0
    for part in parts:
        at = text.find(part, at)
        if at < 0:
            return False
        at += len(part)
    return True


def test_one_pair_explains_it() -> None:
    assert holds(sentence(answer(BEST, BAD, CONTROL)), "ep1 at −1 mm", "87 %")
    assert "e13" not in sentence(answer(BEST, BAD, CONTROL))


def test_several_pairs_explain_it() -> None:
    said = sentence(answer(BEST, TWIN, SED, BAD))
    assert holds(said, "ep1 at −1.25 and −1 mm, sed at 0 mm", "ep1 at −1 mm", "87 %")


def test_nothing_explains_it() -> None:
    assert holds(sentence(answer(BAD, CONTROL)), "No measure", "e13 at 0.5 mm", "(p < 0.001)", "87 %")
    assert holds(sentence(answer(WORSE)), "s11 at 0.5 mm", "control (p = 0.012)")
    assert "ep1" not in sentence(answer(BAD, CONTROL))


def test_a_control_does_as_well() -> None:
    found = answer(BEST, pair("skin pressure", 0.5, 0.9, 0.5), BAD)
    assert found.outcome == "not beyond controls"
    assert holds(sentence(found), "No measure", "ep1 at −1 mm", "skin pressure at 0.5 mm", "control")


def test_the_next_pair_and_by_how_much_it_is_worse() -> None:
    (said, *_) = sentences(answer(BEST, BAD))
    assert holds(said, "e13 at 0.5 mm", "13.2 times the noise", "(p < 0.001)", "87 %")
    assert holds(sentences(answer(BEST, WORSE))[0], "model confidence set (p = 0.012)")
    assert "next" not in sentences(answer(BEST))[0]
    assert not [one for one in sentences(answer(BAD)) if "next pair" in one]


def test_controls_ceiling_power_and_positions() -> None:
    mimics = (Mimic("skin pressure at 0.5 mm", "e22 at 0 mm", 0.34), Mimic("indentor curvature at 1 mm", "s11", 0.8))
    left = (LeftOut("step:1 at 8 gwt", (-2.5, 3.0), (0.0, 0.0), "2 of 6 are left out: step:1 at 8 gwt …"),)
    found = answer(BEST, BAD, CONTROL, CONSTANT, power=Power(0.042, mimics), recorded=6, left_out=left)
    said = sentences(found)
    for one, parts in zip(
        said[1:],
        (
            ("skin pressure at 0.5 mm", "41 %"),
            ("93 %",),
            ("4 % of the largest rate", "80 %"),
            ("skin pressure at 0.5 mm", "e22 at 0 mm", "0.34"),
            ("4 of 6", "2 of 6", "step:1 at 8 gwt"),
        ),
        strict=True,
    ):
        assert holds(one, *parts), one
    bare = sentences(answer(BEST, BAD, ceiling_from="monotone"))
    assert holds(bare[1], "at most 93 %", "monotone")
    assert holds(bare[-1], "All 4")


@pytest.mark.parametrize(("p", "said"), [(0.05, "do not differ"), (0.049, "differ")])
def test_one_fit_or_several(p: float, said: str) -> None:
    separate = tuple(Separate(f"step:{n}", 1.0, 0.0, 0.5) for n in "13")
    found = answer(BEST, BAD, together=Together((2.0, 90.0), 1.5, p, separate))
    assert any(holds(one, "2 stimuli", f"ep1 at −1 mm {said} from", f"(p = {p})") for one in sentences(found))


def test_numbers_in_words() -> None:
    assert [percent(v) for v in (0.934, 1.0, -0.12, np.nan)] == ["93 %", "100 %", "−12 %", "–"]
    assert [probability(p) for p in (0.0009, 0.001, 0.0449, 1.0)] == ["p < 0.001", "p = 0.001", "p = 0.045", "p = 1"]
    assert listed([CONSTANT, BEST]) == "a constant rate, ep1 at −1 mm"
    assert listed([BEST, TWIN, replace(BEST, receptor_mm=0.5)]) == "ep1 at −1.25, −1 and 0.5 mm"


KINDS: dict[str, tuple[Callable[[], AfferentVerdict], list[str]]] = {
    "counts": (
        lambda: answer(BEST, TWIN, BAD, CONTROL, CONSTANT),
        ["step:1 at 8 gwt", "18 measures", "(skin pressure, a constant rate)", "3 receptors", "4 of 4",
         "R = max(0, k(ε − ε₀))", "variance 0.71 times", "repeated presses",
         "(90 degrees of freedom)", "F test at 5 %", "95 %",
         "Hansen, Lunde & Nason 2011; range statistic, 500 draws of blocks of 4", "below 0.5", "5 blocks",
         "2 of 3 pairs", "ep1 at −1 mm (k = 12.3, ε₀ = -0.2), had F = 1.23, p = 0.5", "87 %"],
    ),
    "an sd": (
        lambda: answer(BEST, noise=RecordingNoise("sd", "sd", 1.0, np.inf)),
        ["standard deviations (known, ", "(known) in an F"],
    ),
    "rates": (
        lambda: answer(BEST, noise=RecordingNoise("rates", "neighbours", 9.0, 30.0)),
        ["one standard deviation for all (3, ", "neighboring positions"],
    ),
    "options": (
        lambda: answer(BEST, saturating=True, silent_at_rest=True, fingers=9,
                       together=Together((2.0, 9.0), 1.0, 0.5, ())),
        ["R = z / (1 + s·z) with z = max(0, k(ε − ε₀)), with k > 0 and ε₀ ≥ 0,", "each stimulus in",
         "9 simulated fingers", "50 % of the spread", "2 % of the largest rate"],
    ),
    "a control in the set": (
        lambda: answer(BEST, pair("skin pressure", 0.5, 0.9, 0.5)), ["1 of 1 pairs", "1 of the controls;"]
    ),
    "nothing": (lambda: answer(BAD), ["No pair", "e13 at 0.5 mm", "F = 1.23 (p < 0.001)"]),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_methods_can_be_pasted(kind: str) -> None:
    made, parts = KINDS[kind]
    paragraph = methods(made())
    assert "\n" not in paragraph
    assert holds(paragraph, *parts), paragraph
    assert ("simulated fingers" in paragraph) == (kind == "options")


def test_json_has_the_answer_and_its_rows() -> None:
    separate = (Separate("step:1", 1.0, np.nan, 0.5),)
    found = answer(BEST, BAD, CONSTANT, together=Together((2.0, 90.0), 1.5, 0.25, separate),
                   left_out=(LeftOut("step:1", (9.0,)),), power=Power(0.1, (Mimic(CONSTANT.title, BEST.title, 0.5),)),
                   noise=RecordingNoise("sd", "sd", 1.0, np.inf))  # fmt: skip
    (told,) = json.loads(json.dumps(answers_as_json([found]), allow_nan=False))
    assert told["answer_text"] == sentence(found)
    assert told["besides_text"] == sentences(found)
    assert told["methods_text"] == methods(found)
    assert (told["headline"], told["next_is_worse_by"]) == (EP1, 13.25)
    assert told["next"] == {"measure": "e13", "receptor_mm": 0.5}
    assert told["noise"] == {"kind": "sd", "source": "sd", "dispersion": 1.0, "freedom": None}
    assert told["ceiling"] == {"share": 0.93, "source": "repeats"}
    assert told["intervals"] == [{"measure": "ep1", "unit": "1", "k": [10, 15], "eps0": [-0.3, None]}]
    assert told["together"] == {
        "ratio": 1.5, "p": 0.25, 
        "separate": [{"stimulus": "step:1", "unit": "1", "k": 1.0, "eps0": None, "left_out": 0.5}],
    }  # fmt: skip
    assert told["power"] == {
        "detectable_misfit": 0.1, 
        "mimics": [
            {"control": {"measure": A_CONSTANT, "receptor_mm": None}, "pair": EP1, "probability": 0.5}
        ],
    }  # fmt: skip
    assert told["left_out"] == [{"stimulus": "step:1", "position_mm": [9.0]}]
    assert [(row["measure"], row["control"], row["in_set"]) for row in told["rows"]] == [
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
