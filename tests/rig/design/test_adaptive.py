"""The adaptive rule on a table of bumps: what it chooses, when it ends, and what a resumed run repeats."""

from dataclasses import replace

import numpy as np
import pytest

from rig.design.adaptive import AdaptiveRule, AdaptiveState, End, PressChoice, SpikeCount
from rig.design.counts import CountModel
from rig.design.fibers import Unknowns
from rig.design.posterior import LEVEL
from rig.design.press_times import PressTimes
from rig.design.response_table import ResponseTable
from tests.rig.design.conftest import ALIKE

MODEL = CountModel(1.0, Unknowns((10.0, 30.0)))
THREE = ("ep1", "sed", "e22")


def a_rule(
    table: ResponseTable, times: PressTimes, minutes: float = 6.0, candidates: tuple[str, ...] = THREE
) -> AdaptiveRule:
    return AdaptiveRule.of(table, candidates, MODEL, times, minutes, draws=1024)


def run(rule: AdaptiveRule, truth: int, shape: str | None = None) -> tuple[list[SpikeCount], AdaptiveState, End]:
    """Counts of a fiber among the draws, rounded means, until the rule ends."""
    posterior, state = rule.replayed([], shape)
    counted: list[SpikeCount] = []
    while isinstance(choice := rule.chosen(posterior, state), PressChoice):
        assert choice.seconds == pytest.approx(
            10.0 + (60.0 if state.shape not in (None, rule.presses[choice.press].shape) else 0.0)
        )
        mean = 25 * np.exp(rule.prior.log_rate[truth, 7, choice.press])
        counted.append(SpikeCount(choice.press, float(mean.round())))
        posterior, state = rule.updated(posterior, state, counted[-1])
    return counted, state, choice


@pytest.mark.parametrize("truth", range(len(THREE)))
def test_one_candidate_is_left(table: ResponseTable, times: PressTimes, truth: int) -> None:
    rule = a_rule(table, times)
    counted, state, end = run(rule, truth)
    assert end == End("one_candidate")
    assert rule.replayed(counted)[0].probabilities[0].argmax() == truth
    assert state.elapsed_s < 360


def test_a_resumed_run_repeats_posterior_and_choice(table: ResponseTable, times: PressTimes) -> None:
    """Bit for bit, after every press, and with another rule of the same seed."""
    rule, again = a_rule(table, times), a_rule(table, times)
    counted, _, _ = run(rule, 1, "bar:3.0")
    counted[1] = SpikeCount(counted[1].press, None)  # its count did not arrive
    now = rule.replayed([], "bar:3.0")
    for n, one in enumerate(counted):
        now = rule.updated(*now, one)
        resumed = again.replayed(counted[: n + 1], "bar:3.0")
        assert resumed[1] == now[1]
        assert resumed[0].log_likelihood.tobytes() == now[0].log_likelihood.tobytes()
        assert again.chosen(*resumed) == rule.chosen(*now)


@pytest.mark.parametrize(
    ("minutes", "candidates", "reason"),
    [(0.4, THREE, "no_time"), (6.0, ALIKE, "nothing_to_learn")],
)
def test_it_ends_at_once(
    table: ResponseTable, times: PressTimes, minutes: float, candidates: tuple[str, ...], reason: str
) -> None:
    rule = a_rule(table, times, minutes, candidates)
    assert rule.chosen(*rule.replayed([])) == End(reason)  # type: ignore[arg-type]


def test_never_beyond_the_minutes(table: ResponseTable, times: PressTimes) -> None:
    """Although no candidate wins."""
    rule = a_rule(table, times, 2.0)
    posterior, state = rule.replayed([], "bar:1.5")
    while isinstance(choice := rule.chosen(posterior, state), PressChoice):
        posterior, state = rule.updated(posterior, state, SpikeCount(choice.press, None))
    assert choice == End("no_time")
    assert 110 < state.elapsed_s <= 120
    assert {rule.presses[k].shape for k in state.made} == {"bar:1.5"}


def test_no_press_follows_itself(table: ResponseTable, times: PressTimes) -> None:
    rule = a_rule(table, times)
    posterior, state = rule.replayed([], "bar:1.5")
    first = rule.chosen(posterior, state)
    assert isinstance(first, PressChoice)
    second = rule.chosen(posterior, replace_made(state, first.press))
    assert isinstance(second, PressChoice)
    assert second.press != first.press


def replace_made(state: AdaptiveState, press: int) -> AdaptiveState:
    return state._replace(made=(press,))


def test_a_free_change_is_made_and_a_dear_one_is_not(table: ResponseTable, times: PressTimes) -> None:
    """The other shape tells more; how much a change costs decides."""
    rule = a_rule(table, times, 3.0)
    start = rule.replayed([])
    free = rule.chosen(*start)
    assert isinstance(free, PressChoice)
    (other,) = {press.shape for press in rule.presses} - {rule.presses[free.press].shape}
    changed = {}
    for change_s in (0.0, 100.0):
        dear = replace(rule, times=times._replace(change_s=change_s))
        choice = dear.chosen(*dear.replayed([], other))
        assert isinstance(choice, PressChoice)
        changed[change_s] = dear.presses[choice.press].shape != other
    assert changed == {0.0: True, 100.0: False}


def test_one_count_ends_no_session(table: ResponseTable, times: PressTimes) -> None:
    """Two in a row do; a press whose count is lost changes nothing."""
    rule = a_rule(table, times)
    posterior, state = rule.replayed([], "bar:1.5")
    once, twice = (state._replace(sure=sure) for sure in (1, 2))
    assert isinstance(rule.chosen(posterior, once), PressChoice)
    assert rule.chosen(posterior, twice) == End("one_candidate")
    assert rule.updated(posterior, once, SpikeCount(0, None))[1].sure == 1
    middle = next(k for k, press in enumerate(rule.presses) if press.x_mm == 0)
    assert rule.updated(posterior, once, SpikeCount(middle, 10.0))[1].sure == 0


@pytest.mark.parametrize("truth", range(len(THREE)))
def test_the_last_two_counts_agree(table: ResponseTable, times: PressTimes, truth: int) -> None:
    rule = a_rule(table, times)
    counted, state, _ = run(rule, truth)
    likely = [rule.replayed(counted[:n])[0].probabilities[0].max() for n in range(len(counted) + 1)]
    assert [p >= LEVEL for p in likely[-2:]] in ([True, True], [False, True])
    assert state.sure == (2 if likely[-2] >= LEVEL else 1)
