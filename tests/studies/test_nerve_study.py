"""The study of published tests of afferents: what it scores with."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.nerve.models import BUILT_IN
from studies.nerve.rows import Row, _line, _log, _power, aic, over_seeds, rate_errors, variation
from studies.nerve.scenes import held
from studies.nerve.table import CAUSES, FITTED, cells, parameters
from studies.registry import read_table

Array = NDArray[np.float64]


def test_a_plate_holds_what_it_overlaps_and_pulls_nowhere() -> None:
    rng = np.random.default_rng(1)
    half = rng.normal(size=(40, 40))
    compliance = half @ half.T / 40 + 0.5 * np.eye(40)
    overlap = rng.normal(size=40)
    p = held(compliance, overlap)
    slack = compliance @ p - overlap
    assert p.min() >= 0
    assert slack.min() >= -1e-9
    assert np.abs(p * slack).max() < 1e-8


def test_errors_are_those_of_the_score() -> None:
    assert rate_errors(np.array([5.0, 15.0, -9.0]), (5, 5, 0)) == pytest.approx((0.0, 1 / 3))


def test_variation_removes_a_line_and_leaves_other_rates_out() -> None:
    slowing = np.cumsum(np.linspace(0.04, 0.06, 80))
    assert variation([slowing, np.arange(0.0, 3.9, 0.005)], 0.0, 3.9) == pytest.approx([0.0], abs=1e-9)


@pytest.mark.parametrize(("form", "start"), [(_log, (1.0, 1.0)), (_power, (1.0, 0.5)), (_line, (1.0, 1.0))])
def test_the_right_form_has_the_least_criterion(form: Callable[..., Array], start: tuple[float, float]) -> None:
    v = np.geomspace(1, 60, 10)
    rate = form(v, 12.0, 0.6) + 0.01 * np.sin(9 * v)
    found = {one.__name__: aic(one, start, v, rate) for one in (_log, _power, _line)}
    assert min(found, key=found.__getitem__) == form.__name__


def test_a_failure_has_its_cause_and_a_pass_none() -> None:
    row = Row("7, RA", "ramps", "known", "-3 | 4", False, remark="fitted")
    assert cells(row)[3:] == ("−3 \\| 4", "–", "fail", f"fitted; {CAUSES['7, RA']}")
    assert cells(Row("7, RA", "ramps", "known", over_seeds([1, 2]), True))[3:] == (
        "1.50 (1.00 to 2.00)",
        "–",
        "pass",
        "",
    )


def test_the_table_lists_the_parameters_as_they_are() -> None:
    _, *stored = read_table("nerve/parameters")
    assert [tuple(row) for row in stored] == list(parameters())
    assert {row[0] for row in stored} == set(BUILT_IN)
    assert {*FITTED} <= {(row[0], row[1]) for row in stored}


def test_every_failure_of_the_table_has_a_cause() -> None:
    head, *stored = read_table("nerve/tests")
    numbers = {row[0].split(",")[0].removesuffix(" ▸") for row in stored}
    assert numbers == {str(number) for number in range(1, 19)}
    assert all(row[head.index("remark")] for row in stored if row[head.index("verdict")] == "fail")
