"""What follows from an answer's rows: the set, its headline, the next pair, and whether a control is beaten."""

import numpy as np
import pytest

from rig.compare.verdict import AfferentVerdict, FittedPositions, PairRow, Power, RecordingNoise

P = 4
ZERO = np.zeros(P)


def pair(
    name: str, p_fit: float, p_set: float, deviance: float, *, receptor_mm: float | None = 0.0, control: bool = False
) -> PairRow:
    limits = ((deviance, deviance + 1), (-deviance, 0.0))
    numbers = (0.9, 0.8, deviance, 1.0, p_fit, p_set, 0.7)
    return PairRow(name, control, receptor_mm, 2.0, -0.5, 0.0, *limits, *numbers, ZERO, ZERO, ZERO)


def answer(*rows: PairRow) -> AfferentVerdict:
    places = FittedPositions(np.zeros(P, dtype=np.int64), np.arange(P, dtype=float), ZERO, ZERO)
    noise, power = RecordingNoise("counts", "repeats", 1.0, 12.0), Power(0.1, ())
    return AfferentVerdict(
        "a", ("step:1 at 8 gwt",), ("a.csv",), places, 6, (), noise, 0.9, "repeats", rows, None, power
    )


BEST = pair("ep1", 0.5, 1.0, 4.0, receptor_mm=-1.25)
TWIN = pair("ep1", 0.4, 0.3, 5.0, receptor_mm=-1.0)
MISFIT = pair("sed", 0.01, 0.9, 6.5)
WORSE = pair("e13", 0.3, 0.01, 8.0)
CONTROL = pair("skin pressure", 0.2, 0.2, 7.0, control=True)
CONSTANT = pair("a constant rate", 0.0, 0.0, 90.0, receptor_mm=None, control=True)


def test_the_set_holds_measures_that_fit_and_that_none_beats() -> None:
    found = answer(BEST, TWIN, MISFIT, WORSE, CONSTANT)
    assert found.set == [BEST, TWIN]
    assert (found.headline, found.next, found.closest) == (BEST, MISFIT, BEST)
    assert found.worse_by == 2.5
    assert found.outcome == "explained"
    assert (found.measures, found.controls) == ([BEST, TWIN, MISFIT, WORSE], [CONSTANT])


@pytest.mark.parametrize(("p_fit", "p_set", "in_set"), [(0.05, 0.05, True), (0.049, 1, False), (1, 0.049, False)])
def test_a_pair_is_in_the_set_from_five_percent_on(p_fit: float, p_set: float, in_set: bool) -> None:
    assert pair("ep1", p_fit, p_set, 1.0).in_set is in_set


def test_a_control_in_the_set_takes_the_explanation_away() -> None:
    found = answer(BEST, CONTROL, WORSE)
    assert found.outcome == "not beyond controls"
    assert (found.set, found.controls_in_set) == ([BEST], [CONTROL])


def test_nothing_explains_it() -> None:
    found = answer(CONTROL, MISFIT, WORSE)
    assert (found.outcome, found.headline, found.closest) == ("nothing", None, MISFIT)
    assert np.isnan(found.worse_by)
    assert np.isnan(answer(BEST).worse_by)  # all are in


def test_limits_include_the_choice_of_receptor() -> None:
    found = answer(BEST, TWIN, MISFIT, WORSE)
    assert found.interval("ep1", "k") == (4.0, 6.0)
    assert found.interval("ep1", "eps0") == (-5.0, 0.0)
    assert np.isnan(found.interval("sed", "k")).all()
