"""The facts of the source: bounds judge as they read, and every row has its measurement."""

import runpy
from typing import Any

import numpy as np
import pytest

from rig.protocol.script import find_script
from sim.config import FingertipConfig
from studies.registry import read_table
from studies.source import __main__ as facts
from studies.source import answers, pressures, profiles
from studies.source.__main__ import FACTS, TABLE, UNKNOWN, computed, number, verdict
from studies.source.answers import FingerAnswers, PrintedPress, deep, forced
from tests.sim.coarse_mesh import coarse_mesh

ROWS = read_table(TABLE)[1:]


@pytest.fixture(scope="module")
def coarse() -> FingerAnswers:
    return FingerAnswers(FingertipConfig(mesh=coarse_mesh(0.4, 0.6)))


# --- bounds ---


@pytest.mark.parametrize(
    ("bound", "agrees", "partly", "differs"),
    [
        ("10 ± 10 %, ± 20 %", (9.0, 11.0), (8.0, 12.0), (7.9, 12.1)),
        ("−1 ± 0.5, ± 1", (-1.5, -0.5), (-2.0, 0.0), (-2.1, 0.1)),
        ("≤ 1, ≤ 2", (1.0, -5.0), (1.1, 2.0), (2.1, np.inf)),
        ("≥ 1, ≥ 0.5", (1.0, 5.0), (0.9, 0.5), (0.4, -np.inf)),
        ("≤ 1e−06, ≤ 0.001", (1e-6,), (1e-4,), (0.1,)),
        ("a or b, fully; in part c", ("a", "b, fully"), ("c",), ("d", "b")),
    ],
)
def test_a_value_on_a_limit_of_a_bound_has_the_better_verdict(
    bound: str, agrees: tuple[Any, ...], partly: tuple[Any, ...], differs: tuple[Any, ...]
) -> None:
    for word, values in (("agrees", agrees), ("partly", partly), ("differs", differs)):
        assert [verdict(bound, value) for value in values] == [word] * len(values)


@pytest.mark.parametrize("bound", ["10 ± 10 %, ± 20 %", "1 ± 1, ± 2", "≤ 1, ≤ 2", "≥ 1, ≥ 0"])
def test_a_value_of_nan_has_the_verdict_differs(bound: str) -> None:
    assert verdict(bound, np.nan) == "differs"


def test_a_malformed_bound_is_refused() -> None:
    with pytest.raises(ValueError, match="'about 3' is no bound"):
        verdict("about 3", 3.0)


# --- the table ---


def test_every_source_fact_has_a_measurement() -> None:
    pages = [page for page, of_page in FACTS.items() for _ in of_page]
    assert [row[0] for row in ROWS] == pages
    assert len({(row[0], row[1]) for row in ROWS}) == len(ROWS) == 100


def test_every_stored_verdict_follows_from_its_bound() -> None:
    for page, claim, _, bound, ours, stored in ROWS:
        value: Any = ours
        if "in part" not in bound:
            value = number(ours.removesuffix(" %")) / (100 if ours.endswith(" %") else 1)
        assert stored in (verdict(bound, value), UNKNOWN), f"{page}: {claim}"


@pytest.mark.study  # the other tests
def test_every_source_fact_recomputes_to_its_stored_value() -> None:
    assert computed(ROWS, FingerAnswers()) == ROWS


def test_a_changed_verdict_of_a_source_fact_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    changed = [[*row[:-1], "differs"] if n == 7 else row for n, row in enumerate(ROWS)]
    monkeypatch.setattr(facts, "FingerAnswers", lambda: None)
    monkeypatch.setattr(facts, "computed", lambda rows, answers: changed)
    assert facts.main() == 1
    assert f"{ROWS[7][0]}, {ROWS[7][1]}: {ROWS[7][-1]} became differs" in capsys.readouterr().err


# --- what is measured ---


def test_the_source_facts_use_the_positions_of_the_protocols() -> None:
    assert runpy.run_path(str(find_script("steps")))["POSITIONS_MM"] == pressures.POSITIONS_MM
    assert runpy.run_path(str(find_script("bars")))["POSITIONS"] == profiles.BAR_POSITIONS


@pytest.mark.parametrize(
    ("left", "right", "told"),
    [
        (0.0, 1.0, "none"),
        (1.01, 0.5, "left slightly"),
        (1.5, 1.0, "left fully"),
        (0.9, 1.2, "right slightly"),
        (2.5, 1.36, "left fully, right slightly"),
        (1.2, 1.2, "both slightly"),
        (1.5, 9.0, "both fully"),
    ],
)
def test_touched_edges_are_named_from_their_peak_pressures(left: float, right: float, told: str) -> None:
    assert pressures.in_words(left, right) == told


def test_the_shares_of_the_force_on_a_step_add_up_to_one(coarse: FingerAnswers) -> None:
    first, last = pressures.MOVED["1"][0], pressures.MOVED["1"][-1]
    assert pressures.shares(coarse, first) == pytest.approx((1, 0, 0, 0))  # the lower flat
    assert pressures.shares(coarse, last) == pytest.approx((0, 0, 0, 1))
    assert sum(pressures.shares(coarse, pressures.AT_TABLE)) == pytest.approx(1.0)


def test_the_source_facts_use_the_receptor_strain_of_the_finger(coarse: FingerAnswers) -> None:
    pressed = coarse.finger.indent("bar:3.0", 0.0, doi_mm=1.0)
    x, values = coarse.beneath(deep("bar:3.0", 1.0), "e22")
    np.testing.assert_allclose(x, answers.ROW_X_MM, atol=1e-9)
    places = coarse.finger.model.receptors
    row = (places.depths_mm == 0.75) & np.isin(places.position_mm[:, 0].round(6), answers.ROW_X_MM)
    np.testing.assert_allclose(values, -pressed.receptor_measures["e22"][row], rtol=1e-9)


def test_peaks_are_counted_by_their_prominence() -> None:
    x = np.linspace(0, 1, 201)
    two = np.exp(-(((x - 0.3) / 0.05) ** 2)) + 0.5 * np.exp(-(((x - 0.7) / 0.05) ** 2))
    assert answers.maxima(two) == 2
    assert answers.second(two) == pytest.approx(0.5, abs=0.001)
    assert answers.second(x * (1 - x)) == 0.0
    assert answers.maxima(two - 0.47 * np.exp(-(((x - 0.7) / 0.05) ** 2))) == 1


class Fake:
    """Answers with one profile under every press, that grows with the force."""

    def __init__(self, *tops: float) -> None:
        self.x = np.linspace(-2, 2, 401)
        self.profile = sum(
            (top * np.exp(-(((self.x - at) / 0.2) ** 2)) for top, at in zip(tops, (-1.0, 1.0), strict=False)),
            np.zeros(401),
        )

    def beneath(self, scene: PrintedPress, measure: str) -> tuple[np.ndarray, np.ndarray]:
        return self.x, self.profile * (scene.value if scene.kind == "force_gwt" else 1.0)


def test_profiles_beneath_steps_are_compared_by_peaks_growth_and_width() -> None:
    two: Any = Fake(1.0, 0.25)
    one: Any = Fake(1.0)
    assert pressures.two_highest(two, forced("step:1", 1.0)) == pytest.approx(0.25, abs=1e-4)
    assert pressures.two_highest(one, forced("step:1", 1.0)) == 0.0
    assert pressures.growth(one) == pytest.approx(8.0 / 2.33)
    assert pressures.alike(one, -1.63) == pytest.approx(1.0)
    assert pressures.width_ratio(one) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("peak", "dip", "told"),
    [(1.0, 0.5, "passes"), (1.0, 0.0, "no dip"), (0.5, 1.0, "dip exceeds peak"), (0.0, 1.0, "only a dip")],
)
def test_a_step_profile_is_described_by_its_peak_and_dip(
    peak: float, dip: float, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    class One:
        indentor, x_mm, receptor_mm = "step:1", np.arange(9.0), np.array([0.0])

        def ssrp(self, measure: str, k: int) -> np.ndarray:
            return np.array([0, 0, -dip, 0, 0, 0, peak, 0, 0], dtype=float)  # steps move towards −x

    monkeypatch.setattr(profiles, "under_step", lambda answers, number: One())
    assert profiles.step_in_words(None, 0.0) == told  # type: ignore[arg-type]


def test_the_mirror_correlation_of_a_profile_uses_its_parity() -> None:
    x = np.linspace(-2, 2, 41)

    class Symmetric:
        x_mm, receptor_mm = x, np.array([-2.0, 2.0])

        def ssrp(self, measure: str, k: int) -> np.ndarray:
            one = np.exp(-((x - 0.5) ** 2)) + 0.2 * x
            return (one, (-1.0 if measure in profiles.ODD else 1.0) * one[::-1])[k]

    stimulus: Any = Symmetric()
    for measure in ("ep1", "e12"):
        assert profiles.mirrored(stimulus, measure) == pytest.approx(1.0)
