"""Choice of presses on a table of bumps, and what it is worth beside the usual designs."""

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from rig.design.choose import Effort, PressChooser, some_of
from rig.design.confusion import Confusion, expected_confusion, share_and_error
from rig.design.counts import CountModel
from rig.design.exceptions import DesignError
from rig.design.fibers import Unknowns, draw_fibers, relative_rates
from rig.design.order import blocks_of, carry_over, history, imbalance, ordered
from rig.design.posterior import CandidatePosterior
from rig.design.power import power_rows
from rig.design.press_times import PressTimes
from rig.design.response_table import ResponseTable
from rig.design.usual_designs import everything, usual_designs
from tests.error_codes import raises
from tests.rig.design.conftest import ALIKE, Silent

THREE = ("ep1", "sed", "e22")
SMALL = Effort(draws=512, compared=48, sets=24, particles=24, steps=6, coarse_sets=12, coarse_steps=2, exchanges=2)
MODEL = CountModel(1.0, Unknowns((10.0, 30.0)))


def a_chooser(table: ResponseTable, times: PressTimes, seed: int = 1) -> PressChooser:
    return PressChooser(table, THREE, MODEL, times, SMALL, seed)


def test_rates_are_relative_to_the_strongest_press(table: ResponseTable) -> None:
    draws = draw_fibers(256, table, Unknowns(), 1)
    for name in THREE:
        rates = relative_rates(table, name, draws)
        assert rates.min() == 0.0
        assert rates.max(axis=1) == pytest.approx(1.0)


def test_a_design_beats_the_usual_ones(table: ResponseTable, times: PressTimes, silent: Silent) -> None:
    """It fails less than half as often as 21 positions, and the truth is in the set in 90 %."""
    minutes = 4.0
    chooser = a_chooser(table, times)
    shapes = chooser.coarse(minutes, some_of(("bar:1.5", "bar:3.0")), silent).shapes
    chosen = chooser.chosen(minutes, shapes, silent)
    made = ordered("designed", blocks_of(chosen.repeats, table.presses, chosen.shapes, 1), times, minutes)
    usual = usual_designs(table.presses, times, minutes, 1)
    found = expected_confusion(table, THREE, MODEL, [made, *usual], 60, 2048, 3)
    failures = [float(one.failed.mean()) for one in found]
    assert failures[0] <= failures[1] / 2
    assert min(failures[1:]) > failures[0] - 0.03
    assert min(float(one.kept.mean()) for one in found) >= 0.9
    for design in (made, *usual):
        assert 20 + 10 * len(design.order) <= 60 * minutes


def test_the_same_seed_makes_the_same_design(table: ResponseTable, times: PressTimes, silent: Silent) -> None:
    one, again, other = (a_chooser(table, times, seed).chosen(3.0, ("bar:1.5",), silent) for seed in (1, 1, 2))
    assert one.repeats.tolist() == again.repeats.tolist() != other.repeats.tolist()


def test_candidates_that_see_the_same_are_not_separated(table: ResponseTable, times: PressTimes) -> None:
    (found,) = expected_confusion(
        table, ("ep1", *ALIKE), MODEL, [everything(table.presses, times, 30.0)], 60, 4096, 1
    )
    ((one, other, right),) = found.not_separated()
    assert {one, other} == set(ALIKE)
    assert right == pytest.approx(0.5, abs=0.05)


def test_too_few_minutes(table: ResponseTable, times: PressTimes, silent: Silent) -> None:
    with raises(DesignError, "too_few_minutes", minutes=0.4, needed_s=30.0):
        a_chooser(table, times).coarse(0.4, some_of(("bar:1.5", "bar:3.0")), silent)


def test_a_change_of_shape_costs_its_time(table: ResponseTable, times: PressTimes, silent: Silent) -> None:
    both = a_chooser(table, times).chosen(3.0, ("bar:1.5", "bar:3.0"), silent)
    assert both.repeats.sum() == (180 - 20 - 60) / 10


def test_order_depends_little_on_the_press_before(table: ResponseTable) -> None:
    repeats = np.zeros(len(table.presses), dtype=np.int64)
    repeats[:60:2] = 1
    (block,) = blocks_of(repeats, table.presses, ("bar:1.5",), 1)
    assert Counter(block.tolist()) == Counter(np.flatnonzero(repeats).tolist())
    assert history(block, table.presses) < 0.15 < history(np.sort(block), table.presses)


@pytest.mark.parametrize("made", [(9, 9, 9), (5, 1, 1), (12, 3, 7), (2, 9, 0), (1, 0, 0)])
def test_depths_are_counterbalanced(table: ResponseTable, made: tuple[int, ...]) -> None:
    """Each depth follows each as often as if independent, within one press; exactly so where it can be."""
    seed = 1
    depths = (0.25, 0.5, 1.0)
    repeats = np.zeros(len(table.presses), dtype=np.int64)
    chance = np.random.default_rng(seed)
    mine = {d: [k for k, p in enumerate(table.presses) if (p.shape, p.target) == ("bar:3.0", d)] for d in depths}
    for depth, times_made in zip(depths, made, strict=True):
        np.add.at(repeats, chance.choice(mine[depth], times_made), 1)
    (block,) = blocks_of(repeats, table.presses, ("bar:1.5", "bar:3.0"), seed)
    assert Counter(block.tolist()) == Counter(np.repeat(np.arange(len(repeats)), repeats).tolist())
    assert imbalance(block, table.presses) <= 1 + 1e-9
    follows = Counter(pairwise(table.presses[k].target for k in block))
    if len({*made}) == 1 and made[0] % 3 == 0:
        (one,) = [pair for pair, n in follows.items() if n != made[0] // 3] or [None]
        assert one is None or follows[one] == made[0] // 3 - 1  # where the circle is cut
    if min(made) > 2:
        by_depth = np.array(sorted(block, key=lambda k: table.presses[k].target))
        assert imbalance(by_depth, table.presses) > 1


def test_carry_over_of_a_prony_series() -> None:
    assert carry_over([(0.5, 2.0)], 1.0, 4.0) == pytest.approx(0.5 * (1 - np.exp(-0.5)) * np.exp(-2.0))
    assert carry_over([], 1.0, 4.0) == 0.0


def test_more_fibers_never_know_less() -> None:
    """Fibers whose evidence is weak, one by one."""
    chance = np.random.default_rng(3)
    truth = np.repeat(np.arange(3), 200)
    evidence = chance.normal(size=(600, 3))
    evidence[np.arange(600), truth] += 1.0
    outcome = Confusion("designed", 10.0, 20, 10, THREE, truth, evidence, np.ones(600))
    rows = power_rows([outcome], 1)
    assert [row.fibers for row in rows] == [1, 2, 3, 4, 6, 8, 12]
    assert all(later.one > before.one for before, later in pairwise(rows))
    assert {row.repeats for row in rows} == {2.0}
    assert rows[0].one == pytest.approx(0.1, abs=0.15)
    assert rows[-1].few > 0.95


def test_monte_carlo_error_of_a_share() -> None:
    share, error = share_and_error(np.arange(100) < 20)
    assert (share, error) == (0.2, pytest.approx(0.04, abs=0.002))
    assert 0 < share_and_error(np.zeros(100, dtype=bool))[1] < 0.02


def test_the_posterior_is_updated_press_by_press(table: ResponseTable, times: PressTimes) -> None:
    """As by all counts at once; the candidate that made them wins."""
    chooser = a_chooser(table, times)
    now = CandidatePosterior.before(MODEL, chooser.draws, chooser.log_rate)
    press = np.arange(len(table.presses))
    mean = 25 * np.exp(chooser.log_rate[1, 7, press])
    for k, count in zip(press, mean.round(), strict=True):
        now = now.updated(int(k), np.array([count]))
        assert now.probabilities.sum() == pytest.approx(1.0)
    assert now.probabilities[0, 1] > 0.9
    assert now.sums.repeats.sum() == len(press)
    added_bits = now.information_bits(64, np.random.default_rng(0))
    before = CandidatePosterior.before(MODEL, chooser.draws, chooser.log_rate).information_bits(
        64, np.random.default_rng(0)
    )
    assert added_bits.max() < before.max()
