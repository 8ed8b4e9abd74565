"""The kept references of a finger that stiffens: one pressed again, and how near the quick answer comes to some."""

import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from sim.models.stiffening.at_finite_strain import FORCE, FORCE_ERROR, SECANT, SED_ERROR, Force, Press
from studies.stiffening import in_time, references, twins
from studies.stiffening.fingers import FINGERS, deepest_mm, finger
from studies.stiffening.fitted import DEEPEST_MM, Seen, energies, errors, fitted, forces, spread, table
from studies.stiffening.references import PATHS, Scene, read, scenes
from studies.stiffening.twins import KEPT, REFERENCES, TWINS, kept_pairs

ROWS = read(KEPT / REFERENCES)
MEET = Path(__file__).parents[2] / "docs" / "meet.md"


@pytest.fixture(scope="module")
def force() -> list[Seen]:
    return list(forces(kept_pairs()))


@pytest.fixture(scope="module")
def energy() -> list[Seen]:
    return list(energies(kept_pairs()))


def test_a_reference_is_what_was_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(references, "DEPTHS_MM", (0.25,))
    (row,) = references.rows(Scene("default", "flat", 0.3))
    (kept,) = [r for r in ROWS if Scene(r["finger"], r["shape"], r["stiffening"]) == Scene("default", "flat", 0.3)
               and r["doi_mm"] == 0.25]  # fmt: skip
    assert row["force"] == pytest.approx(kept["force"], rel=1e-5)
    assert row["sed"] == pytest.approx(kept["sed"], rel=1e-3)


def test_a_twin_is_what_was_kept() -> None:
    kept = next(row for row in read(KEPT / TWINS) if row["finger"] == "other moduli" and row["doi_mm"] == 1.0)
    found = twins.twin("other moduli", kept["shape"], 1.0)
    assert found is not None
    assert found["force"] == pytest.approx(kept["force"], rel=1e-5)
    assert found["sed"] == pytest.approx(kept["sed"], rel=1e-4)
    assert found["share"] == pytest.approx(kept["share"], abs=1e-5)


def test_every_reference_has_its_twin() -> None:
    assert len(kept_pairs()) == len(ROWS)


def test_missing_twins_are_pressed_and_those_off_their_patch_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / REFERENCES).write_bytes((KEPT / REFERENCES).read_bytes())
    lines = (KEPT / TWINS).read_text("utf-8").splitlines(keepends=True)
    (tmp_path / TWINS).write_text("".join(lines[2:]), "utf-8")
    rows = {press: row for row in read(KEPT / TWINS)[:1] for press in [(row["finger"], row["shape"], row["doi_mm"])]}
    monkeypatch.setattr(twins, "twin", lambda *press: rows.get(press))
    twins.main(str(tmp_path))
    assert read(tmp_path / TWINS) == [*read(KEPT / TWINS)[2:], *rows.values()]


def test_numbers_in_the_code_are_those_that_the_references_give(force: list[Seen], energy: list[Seen]) -> None:
    """Four digits are kept: a fit from them moves by what rounding does to numbers that lean on one another."""
    np.testing.assert_allclose(fitted(force, FORCE), FORCE, rtol=2e-3)
    np.testing.assert_allclose(fitted(energy, SECANT), SECANT, rtol=2e-3)


def test_force_and_the_highest_energy_are_as_near_as_is_said(force: list[Seen], energy: list[Seen]) -> None:
    highest = [one for one in energy if one.highest]
    for seen, numbers, said in ((force, FORCE, FORCE_ERROR), (highest, SECANT, SED_ERROR)):
        within = [one for one in seen if one.doi_mm <= DEEPEST_MM]
        assert said - 0.01 <= np.expm1(np.abs(errors(within, numbers)).max()) <= said
    assert max(abs(one.log) for one in force) > 0.5  # without the correction


def test_what_is_held_back_moves_no_number(force: list[Seen]) -> None:
    held = [one for one in force if one.held_back]
    assert {one.shape for one in held} > {"cylinder:4"}
    assert len({one.finger for one in held}) > 4
    wrong = [one._replace(log=one.log + 1.0) if one.held_back or one.doi_mm > DEEPEST_MM else one for one in force]
    assert fitted(wrong, FORCE) == fitted(force, FORCE)


def test_the_table_is_the_one_in_the_docs(force: list[Seen], energy: list[Seen]) -> None:
    lines = MEET.read_text("utf-8").splitlines()
    assert [line for line in table(force, energy) if line not in lines] == []


def test_receptors_far_below_the_highest_are_not_judged() -> None:
    wanted = {"finger": "default", "shape": "sphere:3", "stiffening": 0.3, "doi_mm": 0.5}
    (pair,) = [one for one in kept_pairs() if wanted.items() <= one.reference.items()]
    seen = list(energies([pair]))
    assert 2 < len(seen) < len(pair.linear_sed)
    assert sorted({one.counts for one in seen}) == [1.0, 10.0]
    assert sum(one.highest for one in seen) == 1


def test_numbers_are_found_again() -> None:
    chance = np.random.default_rng(1)
    low, high = (0.05, 0.2, 0.5, 0.0, 0.02, 0.5), (0.6, 3.0, 5.0, 0.4, 0.5, 3.0)
    presses = [Press(*values) for values in chance.uniform(low, high, (90, 6))]
    draft = [Seen("f", "s", a, 1.0, p, 0.0) for p, a in zip(presses, np.tile((0.0, 0.3, 1.0), 30), strict=True)]
    truth = FORCE._replace(arch=0.3, squeeze=1.0, strain=9.0)
    exact = [one._replace(log=float(e)) for one, e in zip(draft, errors(draft, truth), strict=True)]
    found = fitted(exact, FORCE)
    assert type(found) is Force
    assert np.abs(errors(exact, found)).max() < 1e-3


def test_a_table_has_a_line_for_each_path_and_what_is_held_back_comes_last() -> None:
    press = Press(*np.full(6, 0.2))
    (log,) = -errors([Seen("f", "flat", 0.3, 1.0, press, 0.0)], FORCE)
    (sed,) = -errors([Seen("f", "flat", 0.3, 1.0, press, 0.0)], SECANT)
    at = partial(Seen, stiffening=0.3, press=press)
    offs = ((1.0, 1.01), (2.0, 1 / 1.02), (2.5, 1.03))
    held = [at("human", "cylinder:4", doi_mm=1.0, log=-log)]
    force = [*held, *(at("human", "flat", doi_mm=doi, log=-log - np.log(off)) for doi, off in offs)]
    energy = [at("human", "flat", doi_mm=1.0, log=-sed), at("human", "flat", doi_mm=1.0, log=9.0, highest=False)]
    assert list(table(force, energy))[2:] == [
        "| human | flat | 0.3 | 2.5 | 1.0 % | 2.0 % | 3.0 % | 0.0 % | 0.0 % |  |",
        "| *held back:* human | cylinder:4 | 0.3 | 1 | 0.0 % | 0.0 % |  |  |  |  |",
    ]


def test_a_spread_is_of_what_the_prior_holds_to_two_millimetres() -> None:
    at = partial(Seen, press=Press(*np.full(6, 0.2)), log=0.0)
    seen = [
        at("human", "flat", 0.3, 2.0),
        at("human", "flat", 1.0, 2.0),
        at("human", "flat", 0.3, 2.5),
        at("firm throughout", "flat", 0.3, 2.0),
    ]
    found = spread(seen, np.log([1.02, 9.0, 9.0, 1 / 1.05]))
    assert found == "fitted: 2.0 % rms, 2.0 % at most; held back: 4.9 % rms, 5.0 % at most"


def test_every_path_of_every_finger_is_a_scene() -> None:
    assert len(list(scenes())) == len(PATHS) * len(FINGERS)
    assert [deepest_mm(name) for name in ("default", "other moduli")] == [2.0, 2.0]
    assert [deepest_mm(name) for name in ("human", "human, soft fat")] == [3.0, 3.0]
    assert finger("other moduli", stiffening=0.3).tissue.e_dermis == 0.2
    assert Scene("human", "flat", 0.3).name == "human, flat, 0.3"


# --- in time ---

IN_TIME = read(in_time.KEPT)
PAGE = Path(__file__).parents[2] / "docs" / "model.md"


def test_a_step_in_time_is_what_was_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(in_time, "_elastic", lambda shape: dict.fromkeys((0.1, 1.0), 1.0))
    history = in_time.HISTORIES[0]
    row, kept = next(in_time.rows(history)), in_time.of_history(history, IN_TIME)[0]
    assert row["force"] == pytest.approx(kept["force"], rel=1e-5)


def test_relaxation_is_as_near_as_the_page_says() -> None:
    """To what a line is rounded to; if what is remembered did not stiffen, it would be 8 percent on the way back."""
    page = {_scene(line): line for line in PAGE.read_text("utf-8").splitlines()}
    for line in list(in_time.table(IN_TIME))[2:]:
        said = page[_scene(line)]
        assert _numbers(said) == pytest.approx(_numbers(line), abs=0.11)


def _scene(line: str) -> tuple[str, ...]:
    return tuple(line.split("|")[1:3])


def _numbers(line: str) -> list[float]:
    return [float(word) for word in re.findall(r"[+-]\d+\.\d|\d+\.\d(?= µm)", line)]
