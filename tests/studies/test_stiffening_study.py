"""The kept references of a finger that stiffens: one pressed again, and how near the quick answer comes to some."""

import re
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest

from sim.models.stiffening import (
    ENERGY,
    FORCE,
    FORCE_ERROR,
    SED_ERROR,
    ReceptorPress,
)
from studies.registry import expanded, read_table, tables_in
from studies.stiffening import in_time, references, twins
from studies.stiffening.fingers import FINGERS, deepest_mm, finger
from studies.stiffening.fitted import (
    DEEPEST_MM,
    StiffeningSample,
    energies,
    errors,
    fitted,
    forces,
    left_out,
    strain_errors,
    strains,
    table,
)
from studies.stiffening.references import PATHS, StiffeningPress, read, scenes
from studies.stiffening.twins import AFTERWARDS, KEPT, REFERENCES, TWINS, kept_pairs

ROWS = read(KEPT / REFERENCES)
MEET = Path(__file__).parents[2] / "docs" / "validation" / "stiffening.md"


@pytest.fixture(scope="module")
def force() -> list[StiffeningSample]:
    return list(forces(kept_pairs()))


@pytest.fixture(scope="module")
def energy() -> list[StiffeningSample]:
    return list(energies(kept_pairs()))


def test_a_reference_is_what_was_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(references, "DEPTHS_MM", (0.25,))
    (row,) = references.rows(StiffeningPress("default", "flat", 0.3))
    (kept,) = [
        r
        for r in ROWS
        if StiffeningPress(r["finger"], r["shape"], r["stiffening"]) == StiffeningPress("default", "flat", 0.3)
        and r["doi_mm"] == 0.25
    ]
    assert row["force"] == pytest.approx(kept["force"], rel=1e-5)
    assert row["sed"] == pytest.approx(kept["sed"], rel=1e-3)


def test_a_twin_is_what_was_kept() -> None:
    kept = next(row for row in read(KEPT / TWINS) if row["finger"] == "other moduli" and row["doi_mm"] == 1.0)
    found = twins.twin("other moduli", kept["shape"], 1.0)
    assert found is not None
    assert found["force"] == pytest.approx(kept["force"], rel=1e-5)
    assert found["sed"] == pytest.approx(kept["sed"], rel=1e-4)
    for field in ReceptorPress._fields:
        assert found[field] == pytest.approx(kept[field], rel=1e-4, abs=1e-6)


def test_every_reference_has_its_twin() -> None:
    found = kept_pairs()
    assert len(found) == len(ROWS) + len(read(KEPT / AFTERWARDS))
    assert sum(pair.afterwards for pair in found) == len(read(KEPT / AFTERWARDS)) > 0


def test_missing_twins_are_pressed_and_those_off_their_patch_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in (REFERENCES, AFTERWARDS):
        (tmp_path / name).write_bytes((KEPT / name).read_bytes())
    lines = (KEPT / TWINS).read_text("utf-8").splitlines(keepends=True)
    (tmp_path / TWINS).write_text("".join(lines[2:]), "utf-8")
    rows = {press: row for row in read(KEPT / TWINS)[:1] for press in [(row["finger"], row["shape"], row["doi_mm"])]}
    monkeypatch.setattr(twins, "twin", lambda *press: rows.get(press))
    twins.main(str(tmp_path))
    assert read(tmp_path / TWINS) == [*read(KEPT / TWINS)[2:], *rows.values()]


def test_numbers_in_the_code_are_those_that_the_references_give(
    force: list[StiffeningSample], energy: list[StiffeningSample]
) -> None:
    """Four digits are kept: a fit from them moves by what rounding does to numbers that lean on one another."""
    np.testing.assert_allclose(fitted(force, FORCE), FORCE, rtol=2e-3)
    np.testing.assert_allclose(fitted(energy, ENERGY), ENERGY, rtol=2e-3)


def test_force_and_the_highest_energy_are_as_near_as_is_said(
    force: list[StiffeningSample], energy: list[StiffeningSample]
) -> None:
    highest = [one for one in energy if one.highest]
    for seen, numbers, said in ((force, FORCE, FORCE_ERROR), (highest, ENERGY, SED_ERROR)):
        within = [one for one in seen if one.doi_mm <= DEEPEST_MM]
        assert said - 0.01 <= np.expm1(np.abs(errors(within, numbers)).max()) <= said
    assert max(abs(one.log) for one in force) > 0.5  # without the correction


def test_what_is_held_back_moves_no_number(force: list[StiffeningSample], energy: list[StiffeningSample]) -> None:
    held = [one for one in force if one.held_back]
    assert {one.shape for one in held} > {"cylinder:4"}
    assert len({one.finger for one in held}) > 4
    assert any(one.afterwards for one in held)
    for seen, numbers in ((force, FORCE), (energy, ENERGY)):
        wrong = [one._replace(log=one.log + 1.0) if one.held_back or one.doi_mm > DEEPEST_MM else one for one in seen]
        assert fitted(wrong, numbers) == fitted(seen, numbers)


def test_numbers_of_the_energy_foresee_fingers_and_shapes_that_they_were_not_fitted_to(
    energy: list[StiffeningSample],
) -> None:
    """Twelve numbers that knew no squeezed tissue: 9.1 % rms by finger, and by shape beyond all sense."""
    highest = np.array([one.highest and one.doi_mm <= DEEPEST_MM and not one.held_back for one in energy])
    for what, most in (("finger", 0.075), ("shape", 0.085)):
        left = left_out(energy, ENERGY, attrgetter(what))[highest]
        assert np.sqrt(np.mean(left**2)) < most


def test_a_fold_is_fitted_without_itself(energy: list[StiffeningSample]) -> None:
    wrong = [one._replace(log=one.log + 0.1) if one.shape == "sphere:3" else one for one in energy]
    there = np.array([one.shape == "sphere:3" for one in energy])
    found, off = (left_out(seen, ENERGY, attrgetter("shape")) for seen in (energy, wrong))
    np.testing.assert_allclose(off[there], found[there] - 0.1, atol=1e-9)
    assert np.abs(off[~there] - found[~there]).max() > 0.01


def test_the_table_is_the_one_in_the_docs(force: list[StiffeningSample], energy: list[StiffeningSample]) -> None:
    lines = expanded(MEET.read_text("utf-8")).splitlines()
    assert [line for line in table(force, energy) if line not in lines] == []


def test_receptors_far_below_the_highest_are_not_judged() -> None:
    wanted = {"finger": "default", "shape": "sphere:3", "stiffening": 0.3, "doi_mm": 0.5}
    (pair,) = [one for one in kept_pairs() if wanted.items() <= one.reference.items()]
    seen = list(energies([pair]))
    assert 2 < len(seen) < len(pair.linear_sed)
    assert sorted({one.counts for one in seen}) == [1.0, 10.0]
    assert sum(one.highest for one in seen) == 1


def test_the_highest_is_judged_wherever_the_linear_twin_has_it(energy: list[StiffeningSample]) -> None:
    """Under a bar on a stiff skin linear SED has a hollow in the middle, where at finite strain it is highest."""
    assert sum(one.highest for one in energy) == len(kept_pairs())
    wanted = {"finger": "stiff skin", "shape": "bar:3.0", "stiffening": 0.3, "doi_mm": 2.0}
    (pair,) = [one for one in kept_pairs() if wanted.items() <= one.reference.items()]
    top = int(np.argmax(pair.reference["sed"]))
    assert pair.linear_sed[top] < 0.3 * pair.linear_sed.max()


def test_strains_have_the_root_of_energy_without_its_law() -> None:
    """To which nothing was fitted: nearer than the linear twin's, by what `docs/validation/stiffening.md` says."""
    seen = list(strains(kept_pairs()))
    within = np.array([one.doi_mm <= DEEPEST_MM and one.stiffening <= 0.8 for one in seen])
    ours, linear = strain_errors(seen), np.array([-one.log for one in seen])
    for part, most, twin in (("fitted", 0.145, 0.22), ("held back", 0.165, 0.21), ("afterwards", 0.185, 0.26)):
        there = within & [one.part == part for one in seen]
        assert np.sqrt(np.mean(ours[there] ** 2)) < most < twin < np.sqrt(np.mean(linear[there] ** 2))


def test_every_path_of_every_finger_is_a_scene() -> None:
    assert len(list(scenes())) == len(PATHS) * len(FINGERS)
    assert [deepest_mm(name) for name in ("default", "other moduli")] == [2.0, 2.0]
    assert [deepest_mm(name) for name in ("human", "human, soft fat")] == [3.0, 3.0]
    assert finger("other moduli", stiffening=0.3).tissue.e_dermis == 0.2
    assert StiffeningPress("human", "flat", 0.3).name == "human, flat, 0.3"


# --- in time ---

IN_TIME = read(in_time.KEPT)


def test_a_step_in_time_is_what_was_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(in_time, "_elastic", lambda shape: dict.fromkeys((0.1, 1.0), 1.0))
    history = in_time.HISTORIES[0]
    row, kept = next(in_time.rows(history)), in_time.of_history(history, IN_TIME)[0]
    assert row["force"] == pytest.approx(kept["force"], rel=1e-5)


@pytest.mark.parametrize("name", ["finite_strain", "creep"])
def test_relaxation_is_as_near_as_the_page_says(name: str) -> None:
    """To what a line is rounded to; if what is remembered did not stiffen, it would be 8 percent on the way back."""
    lines = {"finite_strain": in_time.table, "creep": in_time.creep}[name](IN_TIME)
    (found,) = tables_in("\n".join(lines))
    for ours, said in zip(found, read_table(f"relaxation/{name}"), strict=True):
        assert ours[:2] == said[:2]
        assert _numbers(ours) == pytest.approx(_numbers(said), abs=0.11)


def _numbers(row: list[str]) -> list[float]:
    return [float(word) for word in re.findall(r"[+-]\d+\.\d|\d+\.\d(?= µm)", " ".join(row))]
