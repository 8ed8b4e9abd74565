"""Spikes while the indentor moves: the same as afterwards, late without a table, delivered at their times."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rig.bench.live_spikes import SAMPLE_S, IndentorPlace, LiveSpikes, PlaceTable
from rig.bench.served import ServedBench
from rig.bench.served_spikes import _pressing
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.nerve import MeasureTable, SpikeRequest, Visit, Visits, run_spikes
from sim.carriage import AS_MODELLED
from sim.errors import ModelRangeError
from sim.measures.measures import MEASURES
from sim.models.fingertip import Fingertip
from sim.nerve.integrator import MOST_STEP_S
from sim.nerve.population import AfferentPopulation, SimulatedAfferent
from sim.nerve.skin import LEVELS
from sim.nerve.staircase import Staircase
from tests.error_codes import raises
from tests.program import Program

DEEPEST_MM = 1.5
DEPTHS_MM = DEEPEST_MM * np.linspace(0.0, 1.0, LEVELS + 1)[1:]
AFFERENTS = AfferentPopulation(
    [
        SimulatedAfferent(name, k, 0.0, 0.0, gain, 50.0, 0.0015, 10 * k + len(name), k * ((0.0, 0.0),))
        for name, gains in (("SA1", (0.5, 3.0)), ("RA", (20.0, 60.0)), ("PC", (12.0, 40.0)))
        for k, gain in enumerate(gains, 1)
    ]
)
HERE = IndentorPlace(0.0, 0.0)


def measured(depth_mm: float) -> Any:
    """A measure at each end organ; of an afferent that has two, the second is the weaker one until 0.3 mm."""
    share = np.concatenate([[1.0, 0.8 + 0.7 * depth_mm][: len(organs)] for organs in AFFERENTS.organs])
    return AFFERENTS.measure(dict.fromkeys(MEASURES, 150.0 * share * depth_mm**2))


def made(place: IndentorPlace) -> PlaceTable:
    """First contact lies 0.1 mm below the apex."""
    return PlaceTable(place, -0.1, tuple(DEPTHS_MM), np.array([measured(depth) for depth in DEPTHS_MM]))


def path() -> Staircase:
    """Two presses in increments of 0.1 mm, with holds."""
    down = [-0.3, *np.arange(0.0, 0.61, 0.1)]
    depth = [*down, 0.6, -0.3, -0.3] * 2
    times = np.cumsum(([0.06] * len(down) + [0.7, 0.3, 0.3]) * 2)
    return Staircase(times.tolist(), depth, [2.0] * len(depth), 50.0)


class Follower:
    """Live spikes of a path, with tables that come after some poses."""

    def __init__(self, answer: Callable[[IndentorPlace], PlaceTable] = made, after: int = 0) -> None:
        self.asked: list[IndentorPlace] = []
        self.said: list[str] = []
        self.live = LiveSpikes(AFFERENTS, self.asked.append, self.said.append)
        self.found: list[list[float]] = [[] for _ in AFFERENTS]
        self._answer, self._after = answer, after
        self.late_s = 0.0

    def go(self, t_s: Any, depth_mm: Any, x_mm: float = 0.0) -> None:
        for number, (at_s, depth) in enumerate(zip(t_s, depth_mm, strict=True)):
            self.live.known(at_s, x_mm, -0.1 - depth, 0.0)
            while self.asked and number >= self._after:
                self.live.take(self._answer(self.asked.pop()))
            if number % 4 == 0 or number == len(t_s) - 1:
                for afferent, spike_s in zip(*self.live.advance(), strict=True):
                    self.found[afferent].append(float(spike_s))
                    self.late_s = max(self.late_s, at_s - float(spike_s))


def afterwards(monkeypatch: pytest.MonkeyPatch) -> list[list[float]]:
    """What `rig nerve` computes of the same movement."""
    visit = Visit("bar:3.0", 0.0, 0.0, path())
    table = MeasureTable(DEPTHS_MM, np.array([measured(depth) for depth in DEPTHS_MM]))
    monkeypatch.setattr("rig.plan.nerve.tables_of", lambda *_: {visit.place: table})

    class OfARun:
        end_s = float(visit.path.times_s[-1])

    record: Any = run_spikes(OfARun(), Visits((visit,), 0), None, AFFERENTS)  # type: ignore[arg-type]
    return [(train.spike_s - train.delay_s).tolist() for train in record.trains]


def sampled(step_s: float) -> tuple[Any, Any]:
    t = step_s * np.arange(round(path().times_s[-1] / step_s) + 1)
    return t, path().depth_mm(t)


@pytest.mark.parametrize(("step_s", "apart_s", "others"), [(MOST_STEP_S, 1e-9, 0.0), (SAMPLE_S, 1e-3, 0.02)])
def test_spikes_are_those_of_the_run_computed_afterwards(
    monkeypatch: pytest.MonkeyPatch, step_s: float, apart_s: float, others: float
) -> None:
    """From every step of the simulation to round-off; from the poses that the bench sends, 98 % within 1 ms."""
    known, live = afterwards(monkeypatch), Follower()
    live.go(*sampled(step_s))
    assert min(map(len, known)) > 3
    assert sum(map(len, known)) > 200
    for one, other in zip(known, live.found, strict=True):
        assert abs(len(one) - len(other)) <= max(others * len(one), 1 if others else 0)
        nearest = [min(abs(t - u) for u in other) for t in one]
        assert sum(apart > apart_s for apart in nearest) <= max(others * len(one), 1 if others else 0)


def test_spikes_wait_for_a_table_and_are_not_wrong() -> None:
    t, depth = sampled(SAMPLE_S)
    at_once, later = Follower(), Follower(after=3000)
    at_once.go(t, depth)
    later.go(t, depth)
    for one, other in zip(later.found, at_once.found, strict=True):
        assert one == pytest.approx(other, abs=1e-9)
    assert at_once.late_s < 0.01
    assert later.late_s > 0.5


def test_an_indentor_in_the_air_asks_for_the_table_of_its_place() -> None:
    found = Follower(after=10**9)
    found.go([0.0, SAMPLE_S, 2 * SAMPLE_S], [-3.0, -3.0, -3.0], x_mm=0.5)
    assert found.asked == [IndentorPlace(0.5, 0.0)]


def test_a_moving_indentor_asks_for_nothing() -> None:
    found = Follower(after=10**9)
    for k in range(12):
        found.live.known(k * SAMPLE_S, 0.01 * k, 3.0, 0.0)
        if k:
            found.live.advance()
    assert len(found.asked) <= 1


def test_another_place_is_asked_for_after_the_one_before() -> None:
    found = Follower(after=10**9)
    t = SAMPLE_S * np.arange(3)
    found.go(t, [-3.0] * 3)
    found.go(1.0 + t, [-3.0] * 3, x_mm=1.0)
    found.go(2.0 + t, [-3.0] * 3, x_mm=1.0)
    assert found.asked == [HERE]
    found.live.take(made(HERE))
    found.go(3.0 + t, [-3.0] * 3, x_mm=1.0)
    assert found.asked == [HERE, IndentorPlace(1.0, 0.0)]


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (PlaceTable, 0),
        (lambda place: PlaceTable(place, problem="no press"), 1),
    ],
)
def test_a_place_that_cannot_be_pressed_is_said_once_when_it_is(answer: Any, said: int) -> None:
    found = Follower(answer)
    found.go(*sampled(SAMPLE_S))
    assert len(found.said) == said
    assert not sum(map(len, found.found))


def test_a_suspended_bench_costs_nothing_and_goes_on() -> None:
    """Ten years in a press: a signal over them would not fit into memory."""
    t, depth = sampled(SAMPLE_S)
    half, pause_s = 1500, 3e8
    whole, suspended = Follower(), Follower()
    whole.go(t, depth)
    suspended.go(t[:half], depth[:half])
    suspended.go(pause_s + t[half:], depth[half:])
    before = [[one for one in row if one < t[half - 1]] for row in whole.found]
    for row, other, first in zip(suspended.found, whole.found, before, strict=True):
        assert len(row) == len(other)
        assert row[: len(first)] == pytest.approx(first, abs=1e-9)
        assert min(row[len(first) :], default=pause_s) >= pause_s


def test_nobody_waits_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    """And what is stored in the meantime has an end."""
    monkeypatch.setattr("rig.bench.live_spikes.PATIENCE_S", 5.0)
    found = Follower(after=10**9)
    t = SAMPLE_S * np.arange(round(5.1 / SAMPLE_S))
    before = round(4.5 / SAMPLE_S)
    found.go(t[:before], np.full(before, 0.3))
    assert not found.said
    found.go(t[before:], np.full(len(t) - before, 0.3))
    assert len(found.said) == 1
    assert len(found.live._poses) < 50


# --- what is refused ---


WRONG = {
    ("--afferents", "3xQQ"): "unknown_afferent",
    ("--afferents", ","): "bad_afferents",
    ("--afferents", "3xSA1", "--seed", "-1"): "outside_range",
    ("--afferents", "3xSA1", "--stage", "grbl"): "no_finger",
    ("--seed", "1"): "needs_option",
    ("--lsl",): "needs_option",
}


@pytest.mark.parametrize("words", WRONG)
def test_what_is_wrong_is_refused_before_a_port_is_opened(
    program: Program, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.cli.serve.ServedBench", None)
    ended = program("serve", *words, "--json")
    assert (ended.error_code, ended.code) == (WRONG[words], 2)


def test_without_the_library_of_lsl_nothing_is_served(program: Program, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rig.cli.serve.ServedBench", None)
    monkeypatch.setitem(__import__("sys").modules, "pylsl", None)
    ended = program("serve", "--afferents", "SA1", "--lsl", "--json")
    assert ended.error_code == "pylsl_missing"


def test_a_turned_finger_is_refused() -> None:
    turned = Config.model_validate({"virtual": {"indentor": "sphere:4", "finger_roll_deg": 3.0}})
    with raises(BadInputError, "turned_finger"):
        ServedBench(turned, stage="grbl", force="mtsics", spikes=SpikeRequest("SA1"))


def test_an_afferent_off_the_pad_is_refused(finger: Fingertip) -> None:
    assert finger is not None
    with raises(ModelRangeError, "afferent_off_pad"):
        _pressing(Config().finger, "bar:3.0", AS_MODELLED, SpikeRequest("SA1@9"), DEEPEST_MM)
