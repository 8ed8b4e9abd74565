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
from studies.source.allowed.emulator import Emulator, learn
from studies.source.allowed.implausible import (
    CUT_OFF,
    FactTarget,
    Judge,
    MeshDeviation,
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


def test_the_slope_of_the_likelihood_is_its_slope(places: Array) -> None:
    logs, y = np.log([*np.linspace(0.5, 3, 6), 0.7, 0.2]), known(places)
    wrong = check_grad(lambda v: emulator._cost(v, places, y)[0], lambda v: emulator._cost(v, places, y)[1], logs)
    assert wrong < 1e-4 < np.linalg.norm(emulator._cost(logs, places, y)[1])


# --- implausibility ---


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
