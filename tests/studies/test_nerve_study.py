"""The study of published tests of afferents: what it scores with."""

import sys
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.compare.recordings.recording import recording
from sim.nerve.models import BUILT_IN
from sim.nerve.stimulus import Stimulus
from studies.nerve import beside_touchsim
from studies.nerve.loop import Judged, first_repeats, interval, share
from studies.nerve.loop import cells as cells_of_loop
from studies.nerve.rows import Row, _line, _log, _log_tanh, _power, aic, over_seeds, rate_errors, variation
from studies.nerve.scenes import held
from studies.nerve.table import CAUSES, FITTED, cells, parameters
from studies.registry import read_table

Array = NDArray[np.float64]


def test_pins_hold_what_they_overlap_and_pull_nowhere() -> None:
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


def test_rates_that_level_off_are_not_those_of_a_power() -> None:
    v = np.geomspace(1, 60, 10)
    rate = 80 * v**1.4 / (v**1.4 + 9**1.4) + 0.1 * np.sin(9 * v)
    assert aic(_log_tanh, (80.0, 0.5, -1.0), v, rate) < aic(_power, (10.0, 0.5), v, rate) - 10


# --- the loop ---


def test_a_shorter_run_has_the_first_repeats() -> None:
    rows = [(float(x), float(n), np.nan) for n in range(10) for x in (0.4, -0.4)]
    found = first_repeats(recording("synthetic.csv", rows, 0.5), 3)
    assert (found.position_mm.tolist(), found.window_s) == ([-0.4, 0.4], 0.5)
    assert [one.tolist() for one in found.repeats] == [[0, 1, 2]] * 2


def test_shares_have_the_interval_of_wilson() -> None:
    assert interval(8, 10) == pytest.approx((0.490, 0.943), abs=1e-3)
    assert (share([]), share([True] * 10), share([False] * 10)) == ("–", "100 (72 to 100)", "0 (0 to 28)")


def test_afferents_without_a_verdict_count_in_no_share() -> None:
    found = [Judged("silent", False, 0), Judged("explained", True, 2), Judged("nothing", False, 0)]
    number, silent, contains, nothing, control, size = cells_of_loop(found)
    assert (number, silent, size) == ("3", "1", "1.0")
    assert [one.split()[0] for one in (contains, nothing, control)] == ["50", "50", "0"]


# --- TouchSim ---


def test_without_touchsim_the_reason_is_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "touchsim", None)
    beside_touchsim.main()
    assert capsys.readouterr().out == f"{beside_touchsim.MISSING}\n"


def test_both_programs_have_the_same_stimulus() -> None:
    stimulus = Stimulus.ramp(0.5, 10.0, 0.8, begins_s=0.05, away_mm=0.1)
    depth = beside_touchsim.trace(stimulus, 1.0)
    assert (len(depth), depth.min(), depth.max()) == (5000, 0.0, pytest.approx(0.5))
    assert depth[1000] == pytest.approx(float(stimulus.depth_mm(0.2)))
    pins = beside_touchsim.bar_pins()
    assert np.ptp(pins, axis=0) + beside_touchsim.PIN_MM == pytest.approx(beside_touchsim.BAR_MM)


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
