"""Candidates, joint fits and what belongs together, on stimuli made by hand."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.compare.comparison import Comparison, compare
from rig.compare.comparison_rows import best_pairs
from rig.compare.exceptions import ComparisonError
from rig.compare.recordings.recording import Recording, recording
from rig.compare.recordings.synthetic import LinearAfferent, afferent_for, record, write_synthetic
from rig.compare.stimuli import StimulusRow
from sim.measures.measures import MEASURES
from tests.error_codes import raises

Array = NDArray[np.float64]
Make = Callable[..., StimulusRow]

X = np.linspace(-4, 3, 36)
RECEPTORS = np.array([-1.0, 0.0, 0.5])


def step_profile(depth: float) -> Array:
    """Peak of 1 and, to the left of it, a dip."""
    return 1 + np.exp(-((X - 0.5) ** 2)) - depth * np.exp(-((X + 2) ** 2))


def bar_profile(dip: float) -> Array:
    return np.exp(-((X - 0.5) ** 2)) + np.exp(-((X + 1.5) ** 2)) * (1 - dip)


GOOD, BAD = step_profile(0.5), step_profile(-0.5)


def at(*profiles: Array) -> Array:
    """(n, 3) one profile a receptor."""
    return np.stack(profiles, axis=1)


@pytest.fixture
def steps(make_stimulus: Make) -> list[StimulusRow]:
    """ep1 passes at −1 under all, sed somewhere under each but nowhere under all, e11 nowhere."""
    return [
        make_stimulus(
            f"step:{n}", X, RECEPTORS, {"ep1": at(GOOD, ep1, BAD), "sed": at(*sed), "e11": at(BAD, BAD, BAD)}
        )
        for n, ep1, sed in (
            ("1", GOOD, (GOOD, BAD, BAD)),
            ("3", BAD, (BAD, GOOD, BAD)),
            ("5", GOOD, (GOOD, GOOD, BAD)),
        )
    ]


@pytest.fixture
def bars(make_stimulus: Make) -> list[StimulusRow]:
    """ep1 passes at 0 under both, ep3 only away from the centre, sed at 0."""
    two, one = bar_profile(0.0), step_profile(0.0)
    return [
        make_stimulus(
            f"bar:{w}", X, RECEPTORS,
            {"ep1": at(one, two, one), "ep3": at(two, one, two), "sed": at(one, two, one)},
            kind="doi_mm", commanded=1.0,
        )
        for w in ("1.5", "3.0")
    ]  # fmt: skip


def test_a_candidate_passes_at_one_receptor_under_every_step(steps: list[StimulusRow]) -> None:
    assert compare(steps, {}).candidates() == ["ep1"]
    assert compare(steps[::2], {}).candidates() == ["ep1", "sed"]


def test_and_near_the_centre_under_every_bar(steps: list[StimulusRow], bars: list[StimulusRow]) -> None:
    assert compare(bars, {}).candidates() == ["ep1", "sed"]
    assert compare([*steps, *bars], {}).candidates() == ["ep1"]


def test_each_condition_is_also_judged_alone(
    steps: list[StimulusRow], bars: list[StimulusRow], make_stimulus: Make
) -> None:
    harder = make_stimulus("step:1", X, RECEPTORS, {"e11": at(GOOD, GOOD, GOOD)}, commanded=8.0)
    found = dict(compare([*steps, *bars, harder], {}).candidates_by_condition())
    assert found == {
        "step:1, step:3, step:5 at 2.33 gwt": ["ep1"],
        "step:1 at 8 gwt": ["e11"],
        "bar:1.5, bar:3.0 at 1 mm": ["ep1", "sed"],
        "step:1, step:3, step:5 at 2.33 gwt and bar:1.5, bar:3.0 at 1 mm": ["ep1"],
        "step:1 at 8 gwt and bar:1.5, bar:3.0 at 1 mm": [],
    }


def recorded(afferent: LinearAfferent, stimulus: StimulusRow, positions: Array) -> Recording:
    """Without noise."""
    rows = [(float(x), float(r), np.nan) for x, r in zip(positions, afferent.rate(stimulus, positions), strict=True)]
    return recording("made.csv", rows)


def fitted(steps: list[StimulusRow], afferent: LinearAfferent, **options: bool) -> Comparison:
    positions = np.linspace(-1.5, 1.5, 16)
    return compare(steps, {s.shape: recorded(afferent, s, positions) for s in steps}, **options)


def test_one_line_over_all_shapes(steps: list[StimulusRow]) -> None:
    afferent = LinearAfferent("ep1", 1, k=20.0, eps0=1.1)
    (joint,) = fitted(steps, afferent).joints
    assert joint.title == "step:1, step:3, step:5 at 2.33 gwt"
    ep1 = MEASURES.index("ep1")
    assert joint.fit.k[ep1, 1] == pytest.approx(20.0)
    assert joint.fit.eps0[ep1, 1] == pytest.approx(1.1)
    assert joint.explained[ep1, 1] == pytest.approx(1.0)
    assert (ep1, 1) in best_pairs(joint, joint.explained)


def test_conditions_and_families_are_fitted_apart(
    steps: list[StimulusRow], bars: list[StimulusRow], make_stimulus: Make
) -> None:
    harder = make_stimulus("step:1", X, RECEPTORS, {"ep1": at(GOOD, GOOD, GOOD)}, commanded=8.0)
    afferent = LinearAfferent("ep1", 1, k=20.0, eps0=0.9)
    everything = [*steps, *bars, harder]
    positions = np.linspace(-1.5, 1.5, 16)
    recordings = {s.shape: recorded(afferent, s, positions) for s in everything}
    titles = [joint.title for joint in compare(everything, recordings).joints]
    assert titles == ["bar:1.5, bar:3.0 at 1 mm", "step:1, step:3, step:5 at 2.33 gwt", "step:1 at 8 gwt"]


def test_measures_that_go_together_are_named(make_stimulus: Make) -> None:
    rng = np.random.default_rng(0)
    ep1, e13 = rng.normal(size=(2, len(X), 3))
    profiles = {"ep1": ep1, "ep3": 0.5 - 2 * ep1, "sed": ep1 + 0.05 * rng.normal(size=ep1.shape), "e13": e13}
    (found,) = compare([make_stimulus("step:1", X, RECEPTORS, profiles)], {}).collinear()
    assert found == ("step:1 at 2.33 gwt", [["ep1", "ep3", "sed"]])


def test_measures_that_go_together_loosely_are_not_named(make_stimulus: Make) -> None:
    """|r| = 1/√(1 + 0.25²) = 0.970, below the 0.98 that docs/statistics.md states."""
    columns = np.column_stack([np.ones(3 * len(X)), np.random.default_rng(0).normal(size=(3 * len(X), 2))])
    ep1, e13 = np.linalg.qr(columns)[0].T[1:].reshape(2, len(X), 3)  # of mean zero and orthogonal
    profiles = {"ep1": ep1, "sed": ep1 + 0.25 * e13, "e13": e13}
    assert compare([make_stimulus("step:1", X, RECEPTORS, profiles)], {}).collinear()[0][1] == []


def test_what_a_line_explains_is_of_the_scatter_about_the_mean(steps: list[StimulusRow]) -> None:
    (joint,) = fitted(steps, LinearAfferent("ep1", 1, k=20.0, eps0=1.1)).joints
    pair = MEASURES.index("sed"), 0
    expected = 1 - joint.fit.rss[pair] / ((joint.rate - joint.rate.mean()) ** 2).sum()
    assert 0 < expected < 0.95
    assert joint.explained[pair] == pytest.approx(expected)


def test_a_receptor_that_covers_too_little_is_not_the_best(make_stimulus: Make) -> None:
    """The receptor at 4 mm sees three of the twelve positions, and explains those exactly."""
    profile = np.sin(3 * X)[:, None]
    stimulus = make_stimulus("step:1", X, np.array([0.0, 4.0]), {"ep1": np.hstack([profile, profile])})
    positions = np.linspace(-3.0, 1.4, 12)
    far = stimulus.at(positions)[MEASURES.index("ep1"), :, 1]
    rates = np.where(np.isfinite(far), 10 + 5 * np.nan_to_num(far), 3.0)
    rows = [(float(x), float(r), np.nan) for x, r in zip(positions, rates, strict=True)]
    (joint,) = compare([stimulus], {"step:1": recording("made.csv", rows)}).joints
    ep1 = MEASURES.index("ep1")
    assert joint.explained[ep1, 1] > joint.explained[ep1, 0]
    np.testing.assert_array_equal(joint.in_play, [True, False])
    assert (ep1, 0) in best_pairs(joint, joint.explained)


def test_twins_and_strays_are_refused(steps: list[StimulusRow], make_stimulus: Make) -> None:
    twin = make_stimulus("step:1", X, RECEPTORS, {}, run="another")
    with raises(ComparisonError, "held_twice", run="run of step:1", other="another", held="step:1 at 2.33 gwt"):
        compare([*steps, twin], {})
    with raises(ComparisonError, "never_pressed", shape="bar:3", held=sorted({one.shape for one in steps})):
        compare(steps, {"bar:3": recording("x.csv", [(0.0, 1.0, np.nan)])})


def test_a_synthetic_recording_says_what_it_is_and_follows_its_rule(steps: list[StimulusRow], tmp_path: Path) -> None:
    afferent = afferent_for(steps, "ep1", 1, peak=50.0, silent=0.25)
    positions = np.linspace(-6, 2, 17)
    found = record(afferent, steps[0], positions, np.random.default_rng(0), repeats=4000, window_s=0.5)
    assert found.name == "synthetic_step1_2.33gwt_ep1_at_0.csv"
    assert found.changes == ("synthetic",)
    mean = afferent.rate(steps[0], found.position_mm)
    assert found.position_mm.min() >= -4  # only where the run went
    # Counts are Poisson: the mean of 4000 windows of 0.5 s has a standard error of √(rate / 2000); five of them.
    assert (np.abs(found.rate - mean) <= 5 * np.sqrt(mean / 2000) + 1e-12).all()
    assert max(float(afferent.rate(s, positions[np.abs(positions) < 2]).max()) for s in steps) <= 50.0
    few = record(afferent, steps[0], positions, np.random.default_rng(0), repeats=2)
    path = write_synthetic(tmp_path, few)
    assert path.read_text(encoding="utf-8").startswith("position_mm,rate,repeat\n-4.0000,")
