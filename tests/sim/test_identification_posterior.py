"""What presses say of a finger, which press tells most, and what is no finger: on made-up fingers."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import tests.made_up_fingers as made_up_fingers
from sim.identification.next_press import PressAt, PressSelector, SkinSearch, held_gwt, highest_gwt
from sim.identification.posterior import Learned, Surprise, learn, no_finger, nothing_learned
from sim.identification.predicted_forces import MeasuredPress, RampAndHold, nominal_trajectory
from sim.identification.prior import KINDS, Kind
from sim.identification.uncertainty_bands import Width, band, parameter_ends
from tests.made_up_fingers import made_up, pressed

FORESEEN, PACE, NOISE_GWT = made_up(), RampAndHold(), 0.02
PRIOR = FORESEEN.prior
SHARES = (0.2, 0.4, 0.6, 0.8, 1.0)
PRESSES = (
    ("sphere:4", 0.0, 0.4),
    ("bar:3.0", 0.0, 0.6),
    ("flat:3", 0.0, 0.6),
    ("sphere:4", 1.2, 0.6),
    ("sphere:4", -1.2, 0.6),
)
GOAL = PressAt("cylinder:9", 0.5, 0.67)


Presses = tuple[tuple[str, float, float], ...]


@cache
def _identified(seed: int, presses: Presses = PRESSES) -> tuple[np.ndarray, list[MeasuredPress], Learned]:
    """What a seed leads to, learned once for all tests that change nothing of it."""
    chance = np.random.default_rng(seed)
    truth = PRIOR.draws(1, chance)[0]
    given = [pressed(FORESEEN, truth, nominal_trajectory(*one, PACE, SHARES), chance, NOISE_GWT) for one in presses]
    return truth, given, learn(FORESEEN, given, nothing_learned(PRIOR, chance, 600), chance)


def test_the_posterior_contains_the_true_finger_and_is_narrower_than_the_prior() -> None:
    off = []
    for seed in range(5):
        truth, given, learned = _identified(seed)
        assert learned.draws.shape == (600, len(truth))
        assert learned.prior.within(learned.draws).all()
        assert learned.effective > 50
        assert learned.readings.tolist() == [len(one.force_gwt) for one in given]
        sd = learned.draws.std(axis=0)
        off.append((learned.mean - truth) / sd)
        assert sd[PRIOR.index("height_mm")] < 0.1 * PRIOR.sd[PRIOR.index("height_mm")]
        assert sd[PRIOR.index("x_mm")] < 0.5 * PRIOR.sd[PRIOR.index("x_mm")]
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.4


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: "+".join(kind.zero) or "living")
def test_identification_finds_the_kind_of_tissue(kind: Kind, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a step of force between linear tissue and any that stiffens, as in the model."""
    monkeypatch.setattr(made_up_fingers, "GEOMETRIC", -0.3)
    predicted, chance = made_up(), np.random.default_rng(11)
    truth = PRIOR.from_normal(PRIOR.to_normal(PRIOR.draws(1, chance), kind), kind)[0]
    given = [pressed(predicted, truth, nominal_trajectory(*one, PACE, SHARES), chance, NOISE_GWT) for one in PRESSES]
    learned = learn(predicted, given, nothing_learned(PRIOR, chance, 600), chance)
    assert PRIOR.is_of(learned.draws, kind).mean() > 0.5
    assert not learned.collapsed
    low, high = parameter_ends(learned.draws)
    assert ((learned.most_likely >= low) & (learned.most_likely <= high)).all()
    assert no_finger(predicted, given, learned, []) is None


def test_the_force_of_an_unpressed_goal_lies_within_its_band() -> None:
    inside, half = 0, []
    for seed in range(5):
        truth, _, learned = _identified(seed)
        known = band(held_gwt(FORESEEN, learned.draws, GOAL, PACE), 0.02)
        inside += known.low < held_gwt(FORESEEN, truth[None], GOAL, PACE)[0] < known.high
        half.append(known.half)
    assert inside >= 4
    assert max(half) < 0.09


def test_more_presses_narrow_the_band_of_a_goal() -> None:
    widths = [band(held_gwt(FORESEEN, _identified(3, PRESSES[:k])[2].draws, GOAL, PACE), 0.0).half for k in (1, 3, 5)]
    assert widths[0] > widths[1] > widths[2]


# --- which press comes next ---


CHOOSER = PressSelector(FORESEEN, (GOAL,), PACE)


def test_identification_chooses_no_press_that_may_exceed_the_force_limit() -> None:
    known = nothing_learned(PRIOR, np.random.default_rng(1), 800)
    menu = [PressAt("cylinder:9", 0.5, d) for d in (0.1, 0.2, 0.4, 0.67)]
    for most_gwt in (2.0, 5.0, 20.0):
        chosen = CHOOSER.choose(known, most_gwt, menu)
        assert highest_gwt(FORESEEN, known.draws[::2], chosen, PACE, 0.975) <= most_gwt
    assert CHOOSER.choose(known, 1e3, menu).doi_mm == 0.67
    assert CHOOSER.choose(known, 1e-3, menu).doi_mm == 0.1


def test_identification_chooses_no_press_where_the_skin_may_be_out_of_reach() -> None:
    """Beside the middle the skin falls away: a finger that lies lower and farther aside is out of reach there."""
    known = nothing_learned(PRIOR, np.random.default_rng(1), 800)
    menu = [PressAt("cylinder:9", x, 0.67) for x in (-1.2, 0.0, 1.2)]
    chosen = PressSelector(FORESEEN, (PressAt("cylinder:9", 1.2, 0.67),), PACE, SkinSearch(0.4, 0.1)).choose(
        known, 1e3, menu
    )
    assert chosen.x_mm == 0.0
    assert PressSelector(FORESEEN, (PressAt("cylinder:9", 1.2, 0.67),), PACE).choose(known, 1e3, menu).x_mm == 1.2
    aside = PressSelector(FORESEEN, (GOAL,), PACE, SkinSearch(0.05, 0.1)).choose(known, 1e3, menu[2:])
    assert aside.x_mm == 1.2


def test_identification_chooses_the_goal_itself_if_it_is_on_the_menu() -> None:
    known = _identified(3, PRESSES[:1])[2]
    menu = [PressAt("sphere:4", -1.2, 0.2), GOAL, PressAt("flat:3", 0.0, 0.2)]
    assert CHOOSER.choose(known, 1e3, menu) == GOAL


def test_a_force_band_is_log_normal_and_widened_by_the_model_error() -> None:
    force = np.exp(np.random.default_rng(0).normal(1.0, 0.03, 20_000))
    known = band(force, 0.04)
    assert known.middle == pytest.approx(np.e, rel=2e-3)
    assert known.high / known.middle == pytest.approx(np.exp(1.645 * 0.05), rel=2e-3)
    assert known.middle / known.low == pytest.approx(np.exp(1.645 * 0.05), rel=2e-3)
    assert known.half == pytest.approx((known.high - known.low) / 2 / known.middle)


# --- what is no finger ---


def _judged(given: list[MeasuredPress], seed: int) -> str | None:
    chance = np.random.default_rng(seed)
    learned = learn(FORESEEN, given, nothing_learned(PRIOR, chance, 600), chance)
    return no_finger(FORESEEN, given, learned, [])


def _changed(given: MeasuredPress, factor: np.ndarray | float) -> MeasuredPress:
    return replace(given, force_gwt=given.force_gwt * factor)


def test_a_finger_of_the_prior_is_accepted_as_a_finger() -> None:
    for seed in range(4):
        _, given, learned = _identified(seed)
        assert no_finger(FORESEEN, given, learned, []) is None, seed
    assert no_finger(FORESEEN, [], nothing_learned(PRIOR, np.random.default_rng(0), 10), []) is None


@pytest.mark.parametrize(("power", "words"), [(0.5, "more steeply"), (-0.5, "less steeply")])
def test_identification_rejects_a_force_that_grows_with_another_power(power: float, words: str) -> None:
    given = [
        _changed(one, np.maximum(one.force_gwt / one.force_gwt.max(), 0.02) ** power) for one in _identified(2)[1]
    ]
    assert words in str(_judged(given, 2))


def test_identification_detects_a_mount_that_slips() -> None:
    truth, given, _ = _identified(4)
    lower, chance = truth.copy(), np.random.default_rng(4)
    lower[PRIOR.index("height_mm")] -= 0.15
    slipped = [
        pressed(FORESEEN, lower, nominal_trajectory(*one, PACE, SHARES), chance, NOISE_GWT) for one in PRESSES[3:]
    ]
    assert re.search(r" at press 4 .* -\d+ µm; .* slips", str(_judged(given[:3] + slipped, 4)))


@pytest.mark.parametrize(("off_sds", "flagged"), [(2.1, False), (2.2, True), (-2.2, True)])
def test_identification_flags_layers_at_the_ends_of_their_ranges(off_sds: float, flagged: bool) -> None:
    """Of both moduli: two squares, of which one in a hundred exceeds 9.21."""
    _, given, learned = _identified(1)
    moved = PRIOR.middle.copy()
    for name in ("ln_e_dermis", "ln_e_fat"):
        moved[PRIOR.index(name)] += off_sds * PRIOR.sd[PRIOR.index(name)]
    said = no_finger(FORESEEN, given, replace(learned, most_likely=moved), [])
    assert (said is not None) == flagged
    assert not flagged or "layers" in str(said)


def test_the_surprise_of_a_press_counts_in_sd_of_the_log_force() -> None:
    surprise = Surprise(Width(2.0, 1.0, 4.0), 0.1, 2.0 * np.exp(0.3))
    assert surprise.sds == pytest.approx(3.0)
    _, given, learned = _identified(1)
    assert no_finger(FORESEEN, given, learned, [surprise]) is None
    assert (
        no_finger(FORESEEN, given, learned, [Surprise(surprise.predicted, 0.05, surprise.measured_gwt)]) is not None
    )
