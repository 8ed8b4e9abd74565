"""How wrong SED of the model is: its size, how far it is alike, and whether it is as large as it is said to be."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sim.coding.bayes import CONTACTS_ERROR, ModelError
from sim.coding.encoding import noise_sd
from sim.coding.operators import centred
from sim.coding.pressure import Frictionless, frictionless
from studies.coding.bands import model_error
from studies.coding.bands.drawn_presses import CHOOSING_SEED, NEAR, drawn
from studies.coding.bands.model_error import Wrong
from studies.coding.profiles_read_back import default_section


@pytest.fixture(scope="module")
def operator() -> Frictionless:
    return frictionless(default_section(), centred(40, 0.17), "finite")


def test_within_contacts_errors_are_smaller_and_alike_over_less_skin() -> None:
    assert (CONTACTS_ERROR.share, CONTACTS_ERROR.length_mm) == (0.02, 0.5)
    assert (ModelError().share, ModelError().length_mm) == (0.04, 1.0)


def test_one_factor_on_all_sed_is_its_share_and_alike_everywhere(operator: Frictionless) -> None:
    true = np.where(np.abs(operator.place_mm) < 1, 300.0, 0.0)
    found = Wrong.of(operator, [(true, 1.1 * operator.sed(true))] * 2)
    assert_allclose(found.relative_l2, 0.1 / 1.1)
    assert_allclose(found.share, 0.1 / 1.1)
    felt = (operator.sed(true) > 0.1 * operator.sed(true).max()).sum()
    assert felt < 40  # beyond them nothing counts
    assert_allclose(found.alike, 1.0)


def test_an_error_here_and_there_is_not_alike(operator: Frictionless) -> None:
    true = np.where(np.abs(operator.place_mm) < 1, 300.0, 0.0)
    to_and_fro = 1 + 0.05 * (-1.0) ** np.arange(49)  # three receptors on it is the other way round
    found = Wrong.of(operator, [(true, to_and_fro * operator.sed(true))])
    assert found.alike == pytest.approx(-1.0, abs=0.15)
    assert found.share == pytest.approx(0.05, rel=0.01)


def test_a_misfit_is_one_where_errors_are_as_large_as_said(operator: Frictionless) -> None:
    true = np.where(np.abs(operator.place_mm) < 1, 300.0, 0.0)
    rng = np.random.default_rng(0)
    upright = replace(operator, lateral=0 * operator.lateral)
    there = upright.sed(true)
    sd = noise_sd(there, 40.0)
    errors = rng.multivariate_normal(np.zeros(49), CONTACTS_ERROR.covariance(upright, there), 200)
    said = [model_error._misfit(upright, CONTACTS_ERROR, true, there + error) for error in errors]
    assert np.mean(said) == pytest.approx(1.0, abs=0.05)
    assert model_error._misfit(upright, ModelError(0.0), true, there) == pytest.approx(1.0)
    twice = model_error._misfit(upright, ModelError(0.0), true, there + sd)
    assert twice == pytest.approx(1.0 + (sd / noise_sd(there, 40.0)) ** 2)


def test_it_is_told_for_each_shape(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    asked = []
    monkeypatch.setattr(model_error, "default_section", lambda: None)
    monkeypatch.setattr(model_error, "finer_section", lambda: None)
    monkeypatch.setattr(model_error, "frictionless", lambda *_: None)
    monkeypatch.setattr(model_error, "pressed", lambda _, scene: asked.append(scene))
    monkeypatch.setattr(Wrong, "of", lambda *_: Wrong(0.0123, 0.0456, 0.789, (0.9, 1.2)))
    model_error.main(2)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"2 presses a shape, seeds {CHOOSING_SEED} …"
    assert lines[1] == (
        "| shape | relative L2 | where felt | alike 0.5 mm apart | misfit, 4% over 1 mm | misfit, 2% over 0.5 mm |"
    )
    assert lines[2] == "|---|---|---|---|---|---|"
    assert lines[3] == "| cylinder:9 | 1.2% | 4.6% | 0.79 | 0.90 | 1.20 |"
    assert len(lines) == 3 + 6
    assert asked == [scene for kind in range(6) for scene in drawn(NEAR, kind, 2, CHOOSING_SEED)]
