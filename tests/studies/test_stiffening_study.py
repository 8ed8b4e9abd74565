"""The kept references of a finger that stiffens: one pressed again, and how near the quick answer comes to some."""

from functools import partial

import numpy as np
import pytest

from sim.models.stiffening.at_finite_strain import FORCE, FORCE_ERROR, SECANT, SED_ERROR, Press
from studies.stiffening import references
from studies.stiffening.fingers import FINGERS, deepest_mm, finger
from studies.stiffening.fitted import KEPT, Seen, energies, errors, fitted, forces, table
from studies.stiffening.references import PATHS, Scene, read, scenes
from studies.stiffening.twins import Pair, pairs

ROWS = read(KEPT)
JUDGED = [("flat", 0.3, 1.0), ("flat", 0.3, 2.0), ("flat", 1.0, 1.0), ("sphere:3", 0.3, 0.5)]


@pytest.fixture(scope="module")
def found() -> list[Pair]:
    wanted = [r for r in ROWS if (r["shape"], r["stiffening"], r["doi_mm"]) in JUDGED and r["finger"] == "default"]
    return list(pairs(wanted))


def test_a_reference_is_what_was_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(references, "DEPTHS_MM", (0.25,))
    (row,) = references.rows(Scene("default", "flat", 0.3))
    (kept,) = [r for r in ROWS if Scene(r["finger"], r["shape"], r["stiffening"]) == Scene("default", "flat", 0.3)
               and r["doi_mm"] == 0.25]  # fmt: skip
    assert row["force"] == pytest.approx(kept["force"], rel=1e-5)
    assert row["sed"] == pytest.approx(kept["sed"], rel=1e-3)


def test_force_and_the_highest_energy_are_as_near_as_is_said(found: list[Pair]) -> None:
    assert len(found) == len(JUDGED)
    judged = [one for one in forces(found) if (one.shape, one.stiffening, one.doi_mm) in JUDGED]
    assert np.expm1(np.abs(errors(judged, FORCE)).max()) < FORCE_ERROR
    highest = [one for one in energies(found) if one.highest]
    assert len(highest) == len(JUDGED)
    assert np.expm1(np.abs(errors(highest, SECANT)).max()) < SED_ERROR
    assert max(abs(one.log) for one in judged) > 0.5  # without the correction


def test_receptors_far_below_the_highest_are_not_judged(found: list[Pair]) -> None:
    seen = list(energies(found[-1:]))
    assert 2 < len(seen) < len(found[-1].linear_sed)
    assert sorted({one.counts for one in seen}) == [1.0, 3.0]


def test_numbers_are_found_again() -> None:
    chance = np.random.default_rng(1)
    presses = [Press(*values) for values in chance.uniform((0.05, 0.2, 0.02), (0.6, 3.0, 0.5), (60, 3))]
    draft = [Seen("f", "s", a, 1.0, p, p.depth, 0.0) for p, a in zip(presses, np.tile((0.0, 0.3), 30), strict=True)]
    truth = FORCE._replace(arch=0.3, squeeze=1.0, law_strain=4.0)
    exact = [one._replace(log=float(e)) for one, e in zip(draft, errors(draft, truth), strict=True)]
    assert np.abs(errors(exact, fitted(exact, "force"))).max() < 1e-3


def test_a_table_has_a_line_for_each_path() -> None:
    press = Press(0.2, 1.0, 0.1)
    at = partial(Seen, "human", "flat", 0.3)
    seen = [at(1.0, press, 0.2, 0.0), at(2.0, press, 0.2, 0.0), at(2.5, press, 0.2, 0.0)]
    lines = list(table(seen, np.log([1.01, 1 / 1.02, 1.03])))
    assert lines[2:] == ["| human | flat | 0.3 | 1.0 % | 2.0 % | 3.0 % |"]


def test_every_path_of_every_finger_is_a_scene() -> None:
    assert len(list(scenes())) == len(PATHS) * len(FINGERS)
    assert [deepest_mm(name) for name in ("default", "human", "other moduli")] == [2.0, 3.0, 2.0]
    assert finger("other moduli", stiffening=0.3).tissue.e_dermis == 0.2
    assert Scene("human", "flat", 0.3).name == "human, flat, 0.3"
