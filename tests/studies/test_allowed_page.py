"""Which fingers the source allows: what is kept, what is told of it, and when the default finger may change."""

import csv
import json
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.compare.plausible_fingers import read_plausible
from studies.registry import read_table
from studies.source.allowed import design, kept, study, tables
from studies.source.allowed.emulator import learn
from studies.source.allowed.facts import FACTS
from studies.source.allowed.implausible import Judge, MeshDeviation, worst
from studies.source.allowed.pins import but_for_the_pinned, pins
from studies.source.allowed.ranges import COARSE, DEFAULT, FULL, LOW_FORCE, NAMES, RANGES, place_of, values_at
from studies.source.allowed.study import CHOOSES, KEYS, TARGETS, AllowedStudy, best_places, better, made, score
from studies.source.allowed.waves import RemainingPlaces, WavePlan

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "plausible_fingers" / "allowed_by_the_source.toml"
PROVENANCES = [path for path in sorted((ROOT / "studies").rglob("*.json")) if '"commit"' in path.read_text("utf-8")]
TABLES = sorted(kept.RESULTS.glob("*.csv"))


def git(*words: str) -> str:
    """What it prints; nothing where there is no history."""
    return subprocess.run(
        ["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False
    ).stdout.strip()


def in_the_middle() -> Array:
    """(facts,) each on its target."""
    return np.array([f.low if np.isfinite(f.low) else f.high for f in FACTS])


def off_by(away: Array) -> Array:
    """(facts,) each so many deviations beyond its target."""
    sd = np.array([np.hypot(f.reading, f.model) for f in FACTS])
    return np.array([f.high + a if np.isfinite(f.high) else f.low - a for f, a in zip(FACTS, away * sd, strict=True)])


@pytest.fixture(scope="module")
def small() -> AllowedStudy:
    """Of emulators that all say ten times the first parameter, or that less a hundred; a quarter is left."""
    x = design.filling(64, len(NAMES))
    near, far = learn(x, 10 * x[:, 0]), learn(x, 10 * x[:, 0] - 1e6)
    judges = [
        Judge(replace(t, low=-np.inf, high=2.5, reading=1e-6, model=0.0), MeshDeviation(0.5, 0.25), near, 1.0, 0.125)
        for t in TARGETS
    ]
    judges[1] = replace(judges[1], target=replace(judges[1].target, low=0.0, high=np.inf), emulator=far)
    of = np.array(CHOOSES)
    allowed = x[:, 0] <= 0.25
    chosen, checked = ([one for one, c in zip(judges, of == half, strict=True) if c] for half in (True, False))
    left, checks = (
        RemainingPlaces(64, 1.5, x, allowed, chosen),
        RemainingPlaces(64, 1.5, x, x[:, 0] <= 0.125, checked),
    )
    facts = np.stack([off_by(np.full(len(FACTS), off)) for off in (2.0, 0.5)])
    best = kept.FingerSample(np.array([0, 1]), np.array([list(values_at(p).values()) for p in x[:2]]), facts)
    default = off_by(np.where(CHOOSES, 4.0, 0.9))
    alike = kept.FingerSample(best.numbers, best.values, np.stack([off_by(np.full(len(FACTS), 1.5))] * 2))
    return AllowedStudy([MeshDeviation()] * len(FACTS), [left, left], checks, default, best, alike)


# --- when the default may change ---


def test_the_score_of_a_half_counts_what_is_ruled_out_and_takes_the_rms() -> None:
    away = np.where(CHOOSES, 4.0, 1.0)
    away[int(np.flatnonzero(~CHOOSES)[0])] = 0.0
    n = int((~CHOOSES).sum())
    assert score(off_by(away), CHOOSES) == (int(CHOOSES.sum()), pytest.approx(4.0))
    assert score(off_by(away), ~CHOOSES) == (0, pytest.approx(np.sqrt((n - 1) / n)))
    missing = off_by(away)
    missing[np.flatnonzero(CHOOSES)[:3]] = np.nan
    assert score(missing, CHOOSES) == (int(CHOOSES.sum()) - 3, pytest.approx(4.0))


@pytest.mark.parametrize(
    ("choose", "check", "may"),
    [(1.0, 0.9, True), (0.9, 0.9, True), (1.0, 1.0, False), (1.1, 0.5, False), (0.5, 1.1, False)],
)
def test_the_default_changes_only_where_checks_improve_and_choices_are_no_worse(
    choose: float, check: float, may: bool
) -> None:
    found = off_by(np.where(CHOOSES, choose, check))
    assert better(found, off_by(np.ones(len(FACTS)))) is may


@pytest.mark.parametrize("half", [True, False])
def test_a_fact_more_that_is_ruled_out_is_worse_whatever_the_rms(half: bool) -> None:
    before, after = np.full(len(FACTS), 2.9), np.full(len(FACTS), 1.0)
    after[int(np.flatnonzero(half == CHOOSES)[0])] = 3.1
    assert not better(off_by(after), off_by(before))


def test_the_best_places_are_allowed_and_the_least_bad_is_the_first(small: AllowedStudy) -> None:
    places = best_places(small.last)
    left = small.last
    inside = left.places[left.allowed]
    assert len(places) == study.BEST == 3
    assert all((inside == place).all(axis=1).any() for place in places)
    assert worst(left.judges, places[:1], left.inflation)[0] == worst(left.judges, inside, left.inflation).min()
    assert len(np.unique(places, axis=0)) == len(places)


# --- what is told ---


def test_a_parameter_is_pinned_where_little_of_its_range_is_left(small: AllowedStudy) -> None:
    first, *others = pins(small.last)
    assert first.one is RANGES[0]
    left = small.last.places[small.last.allowed][:, 0]
    assert (first.least, first.most) == (RANGES[0].at(left.min()), RANGES[0].at(left.max()))
    low, high = np.quantile(left, (0.05, 0.95))
    assert (first.low, first.high) == (RANGES[0].at(low), RANGES[0].at(high))
    assert first.part == pytest.approx((high - low) / 0.9)
    assert first.pinned
    assert not any(pin.pinned for pin in others)


def test_the_default_but_for_the_pinned_is_in_the_middle_of_what_is_left_of_those(small: AllowedStudy) -> None:
    place = but_for_the_pinned(small.last)
    assert place[0] == pytest.approx(np.median(small.last.places[small.last.allowed][:, 0]))
    np.testing.assert_allclose(place[1:], place_of(DEFAULT)[1:])


def test_tables_have_a_row_for_each_parameter_and_half(small: AllowedStudy) -> None:
    assert tables.best_row(small) == 1  # the choosing half likes it best
    n, m = int(CHOOSES.sum()), int((~CHOOSES).sum())
    assert list(tables.halves(small))[1:] == [
        ("choose", f"{n}", "0, 0, 4.00", f"0, {n}, 1.50", f"{n}, {n}, 0.50"),
        ("check", f"{m}", f"{m}, {m}, 0.90", f"0, {m}, 1.50", f"{m}, {m}, 0.50"),
    ]
    head, first, *others = tables.parameters(small.last)
    assert first[:2] == ("`bone_axis_mm`", "−0.4 … 0.8")
    assert len(others) == len(RANGES) - 1
    assert {len(row) for row in (first, *others)} == {len(head)}


def test_the_tables_have_a_figure(small: AllowedStudy, tmp_path: Path) -> None:
    tables.drawn(small, tmp_path / "one.png")
    assert (tmp_path / "one.png").read_bytes().startswith(b"\x89PNG")


# --- what is kept ---


def test_a_table_of_other_fingers_is_begun_anew(tmp_path: Path) -> None:
    path = tmp_path / "best.csv"
    for after, forgotten in ((74, False), (106, True)):
        path.write_text("finger\n", encoding="utf-8")
        kept.write_provenance(path, after=74)
        kept.begin_anew(path, after=after)
        assert path.exists() is not forgotten
    kept.begin_anew(tmp_path / "none.csv", after=1)
    path.with_suffix(".json").unlink()
    path.write_text("finger\n", encoding="utf-8")
    kept.begin_anew(path, after=1)
    assert path.exists()


@pytest.mark.parametrize("path", PROVENANCES, ids=lambda path: path.stem)
def test_a_kept_table_names_a_commit_of_this_history(path: Path) -> None:
    """Wherever in the studies: what was rebased away cannot be looked at."""
    commit = json.loads(path.read_text(encoding="utf-8"))["commit"]
    asked = ["git", "-C", str(ROOT), "merge-base", "--is-ancestor", commit, "HEAD"]
    if git("rev-parse", "--is-shallow-repository") != "false":
        pytest.skip("no history here")
    assert subprocess.run(asked, check=False).returncode == 0, commit


def test_waves_meshes_and_the_best_are_kept() -> None:
    names = {path.stem for path in TABLES}
    assert {"mesh_design", "mesh_default", "wave_1", "best"} <= names


@pytest.mark.parametrize("path", TABLES, ids=lambda path: path.stem)
def test_a_kept_table_says_what_made_it(path: Path) -> None:
    told = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    assert told["command"] == "python -m studies.source.allowed"
    assert len(told["commit"]) >= 12
    assert (told["seed"], told["fingers"]) == (1998, len(path.read_text(encoding="utf-8").splitlines()) - 1)
    assert {"simulator", "python", "numpy", "scipy", "date"} <= set(told)


@pytest.mark.parametrize("path", TABLES, ids=lambda path: path.stem)
def test_a_kept_table_has_fingers_of_the_ranges_and_all_facts(path: Path) -> None:
    found = kept.read(path, NAMES, KEYS)
    with path.open(encoding="utf-8") as file:
        assert next(csv.reader(file)) == ["finger", *NAMES, *KEYS]
    np.testing.assert_array_equal(found.numbers, np.arange(len(found.numbers)))
    for one, values in zip(RANGES, found.values.T, strict=True):
        assert values.min() >= one.low * (1 - 1e-5) - 1e-5
        assert values.max() <= one.high * (1 + 1e-5) + 1e-5
    assert np.isfinite(found.facts).mean() > 0.95


def test_the_first_wave_is_the_design() -> None:
    found = kept.read(kept.RESULTS / "wave_1.csv", NAMES, KEYS)
    places = design.filling(WavePlan().fingers[0], len(NAMES))
    expected = [list(values_at(place).values()) for place in places]
    np.testing.assert_allclose(found.values, expected, rtol=1e-5, atol=1e-5)


def test_both_meshes_have_the_default_finger_and_some_of_the_first_wave() -> None:
    coarse, full = (kept.read(kept.RESULTS / f"mesh_{name}.csv", NAMES, KEYS) for name in ("design", "default"))
    np.testing.assert_array_equal(coarse.values, full.values)
    np.testing.assert_allclose(coarse.values[0], list(DEFAULT.values()))
    first = kept.read(kept.RESULTS / "wave_1.csv", NAMES, KEYS)
    np.testing.assert_allclose(coarse.facts[1:], first.facts[: study.COMPARED], rtol=1e-4, atol=1e-4)
    assert len(full.numbers) == study.COMPARED + 1
    assert not np.allclose(coarse.facts, full.facts, equal_nan=True)
    assert COARSE["spacing_mm"] > FULL["spacing_mm"] == 0.17


def test_there_are_as_many_fingers_as_were_asked_for() -> None:
    assert [len(table.numbers) for table in _waves()] == list(WavePlan().fingers)
    assert sum(WavePlan().fingers) >= WavePlan().fewest == 100


def _waves() -> list[kept.FingerSample]:
    return [kept.read(kept.RESULTS / f"wave_{k + 1}.csv", NAMES, KEYS) for k in range(len(WavePlan().fingers))]


def test_the_shipped_ranges_hold_the_default_finger() -> None:
    shipped = read_plausible(EXAMPLE).ranges
    assert shipped
    for name, (low, high) in shipped.items():
        assert low <= DEFAULT[name] <= high


class Judged(NamedTuple):
    """The kept tables judged again: what came of it, what was said, and the files before."""

    study: AllowedStudy
    said: list[str]
    before: dict[Path, bytes]


@pytest.fixture(scope="module")
def judged() -> Judged:
    said: list[str] = []
    before = {path: path.read_bytes() for path in kept.RESULTS.iterdir()}
    return Judged(made(kept.RESULTS, said.append), said, before)


def test_what_is_kept_is_not_pressed_again_and_leaves_what_is_shipped(judged: Judged) -> None:
    """Meshes, waves and the best are read and judged: nothing is written, and the example has the ranges left."""
    found, said, before = judged
    assert not [text for text in said if "finger " in text]
    assert {path: path.read_bytes() for path in kept.RESULTS.iterdir()} == before
    assert len(found.best.numbers) == len(found.alike.numbers) == study.BEST + 1
    assert found.last.inflation == 1.0
    assert found.last.fingers >= WavePlan().fewest
    assert [len(table.numbers) for table in found.tables] == list(WavePlan().fingers)
    assert 0.02 < found.last.share < 0.2
    left = {pin.one.name: pin for pin in pins(found.last)}
    shipped = read_plausible(EXAMPLE).ranges
    for name, (low, high) in shipped.items():
        assert low <= DEFAULT[name] <= high
        assert (low, high) == (pytest.approx(left[name].low, rel=0.08), pytest.approx(left[name].high, rel=0.08))


def test_the_docs_have_the_tables_of_what_is_kept(judged: Judged) -> None:
    for name, rows in (("ranges", tables.parameters(judged.study.last)), ("facts", tables.halves(judged.study))):
        assert [list(row) for row in rows] == read_table(f"allowed_fingers/{name}")


def test_the_default_finger_is_pressed_at_the_low_force_of_each_of_the_best() -> None:
    best, alike = (kept.read(kept.RESULTS / f"{name}.csv", NAMES, KEYS) for name in ("best", "default_alike"))
    expected = [list((DEFAULT | {LOW_FORCE: force}).values()) for force in best.values[:, NAMES.index(LOW_FORCE)]]
    np.testing.assert_allclose(alike.values, expected, rtol=1e-5)
