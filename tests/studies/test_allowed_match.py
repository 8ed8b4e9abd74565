"""Which fingers the source allows: emulators, implausibility, waves and tables, where the answer is known."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import check_grad

from sim.config import FingertipConfig, Tissue
from sim.models import catalogue
from studies.source.allowed import design, emulator, kept
from studies.source.allowed.emulator import HELD_BACK, Emulator, held_back, learn
from studies.source.allowed.implausible import (
    CUT_OFF,
    FEWEST,
    FactTarget,
    Judge,
    MeshDeviation,
    allowed,
    inflation_needed,
    judges,
    measured,
    mesh_error,
    worst,
)
from studies.source.allowed.waves import Match, RemainingPlaces, WavePlan
from tests.sim.coarse_mesh import coarse_mesh

Array = NDArray[np.float64]


def known(x: Array) -> Array:
    return np.asarray(np.sin(3 * x[:, 0]) + x[:, 1] ** 2 + 0.3 * x[:, 2] * x[:, 3])


@pytest.fixture(scope="module")
def places() -> Array:
    return design.filling(64, 6)


@pytest.fixture(scope="module")
def learnt(places: Array) -> Emulator:
    return learn(places, 10 + 5 * known(places))


# --- the emulator ---


def test_an_emulator_knows_a_known_function_where_it_was_not_told(learnt: Emulator) -> None:
    elsewhere = np.random.default_rng(1).random((400, 6))
    mean, deviation = learnt.predict(elsewhere)
    off = mean - (10 + 5 * known(elsewhere))
    assert np.sqrt(np.mean(off**2)) < 0.03 * np.std(5 * known(elsewhere))
    assert 0.3 < np.sqrt(np.mean((off / deviation) ** 2)) < 1.7


def test_what_does_nothing_gets_a_long_length(learnt: Emulator) -> None:
    assert learnt.lengths[4:].min() > 10 > learnt.lengths[:2].max()


def test_its_held_back_error_is_that_of_places_it_has_not_seen(places: Array, learnt: Emulator) -> None:
    y = 10 + 5 * known(places)
    error = held_back(places, y, learnt)
    assert error.rms == pytest.approx(error.relative * y.std())
    assert 0 < error.relative < 0.06
    assert 0.3 < error.expected < 1.7


def test_what_is_held_back_is_not_learnt(places: Array, learnt: Emulator) -> None:
    """One finger that lies: its own error is the lie, whatever the emulator was told."""
    y = 10 + 5 * known(places)
    lied = y.copy()
    lied[7] += 100.0
    assert held_back(places, lied, learnt).rms >= 100 / math.sqrt(len(y))
    assert HELD_BACK == 5


def test_at_the_places_of_the_design_it_says_what_it_was_told(places: Array, learnt: Emulator) -> None:
    mean, deviation = learnt.predict(places)
    np.testing.assert_allclose(mean, 10 + 5 * known(places), atol=0.02)
    assert deviation.max() < 0.03


def test_scatter_is_counted_as_its_own_error() -> None:
    rng = np.random.default_rng(3)
    x = design.filling(128, 2)
    noisy = x[:, 0] + 0.2 * rng.standard_normal(128)
    _, deviation = learn(x, noisy).predict(rng.random((50, 2)))
    assert deviation.mean() == pytest.approx(0.2, rel=0.25)


def test_a_constant_is_constant() -> None:
    x = design.filling(32, 3)
    mean, deviation = learn(x, np.full(32, 4.0)).predict(x + 0.1)
    np.testing.assert_allclose(mean, 4.0, atol=1e-9)
    assert deviation.max() < 0.01


def test_the_slope_of_the_likelihood_is_its_slope(places: Array) -> None:
    logs, y = np.log([*np.linspace(0.5, 3, 6), 0.7, 0.2]), known(places)
    wrong = check_grad(lambda v: emulator._cost(v, places, y)[0], lambda v: emulator._cost(v, places, y)[1], logs)
    assert wrong < 1e-4 < np.linalg.norm(emulator._cost(logs, places, y)[1])


# --- implausibility ---


@pytest.mark.parametrize(
    ("value", "off"), [(0.5, 0.5), (1.0, 0.0), (1.7, 0.0), (2.0, 0.0), (2.25, 0.25), (-1.0, 2.0)]
)
def test_the_distance_from_a_target(value: float, off: float) -> None:
    assert FactTarget("a", 1.0, 2.0, 0.1, 0.1).off(np.array([value]))[0] == pytest.approx(off)


def judge(learnt: Emulator, **given: float) -> Judge:
    told = {"low": -100.0, "high": 8.0, "reading": 0.3, "model": 0.4, "shift": 0.0, "deviation": 0.0, "widened": 1.0}
    told |= given
    target = FactTarget("a", *(told[name] for name in ("low", "high", "reading", "model")))
    return Judge(target, MeshDeviation(told["shift"], told["deviation"]), learnt, told["widened"], 0.0)


def test_implausibility_is_distance_over_all_errors(learnt: Emulator) -> None:
    x = np.full((1, 6), 0.37)
    (mean,), (sd,) = learnt.predict(x)
    one = judge(learnt, shift=0.7, deviation=1.2, widened=2.0)
    expected = (mean + 0.7 - 8.0) / math.sqrt((2 * sd) ** 2 + 1.2**2 + 0.3**2 + 0.4**2)
    assert one.implausibility(x)[0] == pytest.approx(expected)
    inflated = (mean + 0.7 - 8.0) / math.sqrt((2 * sd) ** 2 + 1.2**2 + 9 * (0.3**2 + 0.4**2))
    assert one.implausibility(x, 3.0)[0] == pytest.approx(inflated)
    assert one.expected(x) == (pytest.approx([mean + 0.7]), pytest.approx([math.hypot(2 * sd, 1.2)]))


def test_a_place_is_allowed_when_no_fact_rules_it_out(learnt: Emulator) -> None:
    x = np.random.default_rng(5).random((500, 6))
    both = [judge(learnt, high=10.0), judge(learnt, low=11.0, high=100.0)]
    largest = np.maximum(*(one.implausibility(x) for one in both))
    np.testing.assert_array_equal(worst(both, x), largest)
    flags = allowed(both, x)
    np.testing.assert_array_equal(flags, largest <= CUT_OFF)
    assert 0 < flags.sum() < len(x)
    assert CUT_OFF == 3.0


def test_inflation_is_the_least_that_leaves_a_share(learnt: Emulator) -> None:
    x = np.random.default_rng(5).random((500, 6))
    both = [judge(learnt, high=7.0), judge(learnt, low=12.0, high=100.0)]
    needed = inflation_needed(both, x, 0.05)
    assert needed > 1
    assert np.mean(allowed(both, x, needed)) >= 0.05 > np.mean(allowed(both, x, needed - 0.1))
    assert inflation_needed([judge(learnt, high=13.0)], x, 0.05) == 1.0


def test_the_error_of_a_mesh_is_its_mean_and_its_spread() -> None:
    coarse, full = np.array([1.0, 2.0, np.nan, 4.0]), np.array([1.5, 2.7, 3.0, 4.3])
    found = mesh_error(coarse, full)
    assert found.shift == pytest.approx(0.5)
    assert found.deviation == pytest.approx(0.2 * math.sqrt(4 / 3))
    assert mesh_error(coarse[:1], full[:1]) == MeshDeviation(0.5, math.inf)


def test_what_is_measured_is_held_against_reading_and_model() -> None:
    targets = [FactTarget("a", 0.0, 1.0, 0.3, 0.4), FactTarget("b", -math.inf, 2.0, 1.0, 0.0)]
    np.testing.assert_allclose(measured(targets, np.array([[2.0, 1.0], [-1.0, 4.0]])), [[2.0, 0.0], [2.0, 2.0]])


def test_facts_that_few_fingers_show_judge_nobody(places: Array) -> None:
    facts = np.stack([known(places), known(places), known(places)], axis=1)
    assert FEWEST == 2  # for six parameters and a constant 14: of 11, a fifth held back, 7 coefficients can be told
    facts[13:, 0] = np.nan
    facts[14:, 1] = np.nan
    targets = [FactTarget(key, 0.0, 1.0, 0.1, 0.1) for key in "abc"]
    found = judges(places, facts, targets, [MeshDeviation(), MeshDeviation(), MeshDeviation(0.0, math.inf)])
    assert [one.target.key for one in found] == ["b"]
    assert found[0].widened >= 1.0


# --- designs and tables ---


def test_the_first_wave_fills_all_ranges_and_begins_alike_however_long() -> None:
    long = design.filling(64, 5)
    assert long.min(axis=0).max() < 0.02 < 0.98 < long.max(axis=0).min()
    np.testing.assert_array_equal(long[:16], design.filling(16, 5))
    assert not np.array_equal(long, design.filling(64, 5, 7))


def test_a_later_wave_keeps_away_from_what_there_is() -> None:
    line = np.linspace(0, 1, 11)[:, None]
    np.testing.assert_allclose(design.spread_among(line, 2, np.array([[0.0]])).ravel(), [1.0, 0.5])
    assert len(design.spread_among(line, 99, np.empty((0, 1)))) == 11


def steps_of(asked: list[Mapping[str, float]]) -> design.Asked:
    def ask(values: Mapping[str, float]) -> dict[str, float]:
        asked.append(values)
        if values["a"] > 0.9:
            raise ValueError("no such finger")
        return {"f": values["a"] + 2, "g": math.nan}

    def values_at(place: Array) -> dict[str, float]:
        return {"a": float(place[0])}

    return design.Asked(values_at, lambda values: np.array([values["a"]]), ask, ("a",), ("f", "g"))


def test_a_finger_is_on_disk_before_the_next_and_none_is_asked_twice(tmp_path: Path) -> None:
    path, places, told = (
        tmp_path / "new" / "wave_1.csv",
        np.array([[0.1], [0.95], [0.3]]),
        list[Mapping[str, float]](),
    )
    on_disk: list[int] = []
    asked = steps_of(told)
    said: list[str] = []

    def say(text: str) -> None:
        said.append(text)
        on_disk.append(len(path.read_text(encoding="utf-8").splitlines()) - 1)

    found = design.run(asked, places, path, say)
    assert on_disk == [1, 2, 3]
    assert said == [f"wave_1: finger {k} of 3" for k in (1, 2, 3)]
    np.testing.assert_allclose(found.facts, [[2.1, np.nan], [np.nan, np.nan], [2.3, np.nan]])
    np.testing.assert_array_equal(found.numbers, [0, 1, 2])
    np.testing.assert_allclose(asked.places_of(found), places)
    again = design.run(asked, np.append(places, [[0.4]], axis=0), path, say)
    assert (len(told), len(again.numbers)) == (4, 4)


def test_a_table_that_is_not_there_has_no_rows(tmp_path: Path) -> None:
    empty = kept.read(tmp_path / "none.csv", ("a", "b"), ("f",))
    assert (empty.values.shape, empty.facts.shape) == ((0, 2), (0, 1))
    both = kept.together([empty, kept.FingerSample(np.array([3]), np.ones((1, 2)), np.zeros((1, 1)))])
    assert both.numbers.tolist() == [3]


# --- waves, end to end, on the section ---

TRUTH = {"epidermis_mm": 0.45, "bone_fraction": 0.3}
LOWEST, WIDTH = np.array([0.25, 0.2]), np.array([0.35, 0.22])


def section(values: Mapping[str, float]) -> dict[str, float]:
    """Ratios of the section's forces: what a finger of unknown stiffness can be asked."""
    config = FingertipConfig(tissue=Tissue(**values), mesh=coarse_mesh(0.25, 0.5))
    finger = catalogue.load("section", config, receptor_x_mm=(0.0,))
    thick = {doi: finger.indent("cylinder:9", doi_mm=doi).force_n for doi in (0.3, 1.0)}
    return {
        "growth": thick[1.0] / thick[0.3],
        "thin": finger.indent("cylinder:3", doi_mm=1.0).force_n / thick[1.0],
    }


def test_waves_on_a_section_close_in_on_the_finger_that_made_the_facts(tmp_path: Path) -> None:
    def values_at(place: Array) -> dict[str, float]:
        return dict(zip(TRUTH, (LOWEST + WIDTH * place).tolist(), strict=True))

    def place_of(values: Mapping[str, float]) -> Array:
        return (np.array([values[name] for name in TRUTH]) - LOWEST) / WIDTH

    true = section(TRUTH)
    targets = [FactTarget(key, value, value, 0.004 * value, 0.0) for key, value in true.items()]
    asked = design.Asked(values_at, place_of, section, tuple(TRUTH), tuple(true))
    plan = WavePlan(fingers=(16, 6, 6), places=2**10)
    said: list[str] = []
    match = Match(asked, targets, [MeshDeviation()] * 2, plan, tmp_path)
    lefts = match.all(said.append)
    assert [left.fingers for left in lefts] == [16, 22, 28]
    assert [left.inflation for left in lefts] == [1.0] * 3
    assert 0 < lefts[-1].share < 0.5
    assert worst(lefts[-1].judges, place_of(TRUTH)[None])[0] < 1.0
    later = match.tables(2)[1]
    assert worst(lefts[0].judges, asked.places_of(later)).max() <= CUT_OFF
    resumed: list[str] = []
    assert [left.share for left in match.all(resumed.append)] == [left.share for left in lefts]
    assert not [text for text in resumed if "finger " in text]


@pytest.mark.parametrize(
    ("inflations", "shares", "still"),
    [
        ((1.0, 1.0, 1.0), (0.5, 0.46, 0.42), True),
        ((1.0, 1.0, 1.0), (0.5, 0.4, 0.4), False),
        ((1.0, 1.0, 1.0), (0.5, 0.5, 0.4), False),
        ((1.0, 1.0, 1.1), (0.5, 0.5, 0.5), False),
        ((1.2, 1.1, 1.1), (0.1, 0.1, 0.1), True),
        ((1.0, 1.0, 1.0, 1.0), (0.9, 0.4, 0.4, 0.4), True),
        ((1.0, 1.0), (0.5, 0.5), False),
        ((1.0,), (0.5,), False),
    ],
)
def test_waves_end_when_two_in_a_row_rule_out_next_to_nothing(
    inflations: tuple[float, ...], shares: tuple[float, ...], still: bool, tmp_path: Path
) -> None:
    lefts = [
        RemainingPlaces(1, inflation, np.zeros((100, 1)), np.arange(100) < round(100 * share), [])
        for inflation, share in zip(inflations, shares, strict=True)
    ]
    assert Match(steps_of([]), [], [], WavePlan(), tmp_path)._still(lefts) is still


@pytest.mark.parametrize(
    ("fingers", "shares", "enough"), [(99, (0.5,) * 3, False), (100, (0.5,) * 3, True), (100, (0.5,) * 2, False)]
)
def test_waves_go_on_until_there_are_enough_fingers(
    fingers: int, shares: tuple[float, ...], enough: bool, tmp_path: Path
) -> None:
    lefts = [RemainingPlaces(fingers, 1.0, np.zeros((100, 1)), np.arange(100) < 100 * share, []) for share in shares]
    match = Match(steps_of([]), [], [], WavePlan(), tmp_path)
    assert match._still(lefts) is (len(shares) == 3)
    assert match._enough(lefts) is enough
