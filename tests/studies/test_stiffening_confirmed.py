"""Tissue that stiffens in another program: what CalculiX is given, and that it has our states."""

import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from sim.errors import ModelRangeError
from sim.models.full_mesh import MeshedFinger, write_displacement_deck
from studies.finite_strain.solver.scene import Specimen
from studies.stiffening import confirmed
from studies.stiffening.fingers import finger
from studies.stiffening.references import StiffeningPress, read
from tests.error_codes import raises

KEPT = Path(confirmed.__file__).parent / "kept" / "calculix.jsonl"
PAGE = Path(__file__).parents[2] / "docs" / "validation" / "stiffening.md"


def _meshed(stiffening: float, *, finite_strain: bool = True) -> MeshedFinger:
    one = Specimen(finger("default", stiffening=stiffening))
    return MeshedFinger(one.config, one.mesh, 0.18, finite_strain=finite_strain)


def test_a_deck_has_yeohs_numbers(tmp_path: Path) -> None:
    """C10 = μ / 2, C20 = a μ / 2, D1 = 2 / κ, in MPa, of the first layer; no other power counts."""
    meshed = _meshed(0.3)
    poisson = meshed.config.tissue.poisson
    write_displacement_deck(
        tmp_path / "held.inp", meshed, np.array([3, 7]), np.array([[0.0, -0.5, 0.25], [0.1, -0.4, 0.0]])
    )
    lines = (tmp_path / "held.inp").read_text("ascii").splitlines()
    (first, *_) = (after for line, after in pairwise(lines) if line == "*HYPERELASTIC,YEOH")
    mu, kappa = 0.18 / (2 * (1 + poisson)), 0.18 / (3 * (1 - 2 * poisson))
    numbers = [float(number) for number in first.split(",")]
    np.testing.assert_allclose(numbers, [mu / 2, 0.3 * mu / 2, 0.0, 2 / kappa, 1e20, 1e20], rtol=1e-11)
    at = lines.index("*NSET,NSET=NHELD")
    assert lines[at + 1] == "4,8,"
    held = lines.index("*BOUNDARY", at)
    assert lines[at + 2 : at + 5] == ["*STEP,INC=200,NLGEOM", "*STATIC,SOLVER=SPOOLES", "0.25,1."]
    assert lines[held + 1 : held + 7] == ["4,1,1,0", "4,2,2,-0.5", "4,3,3,0.25", "8,1,1,0.1", "8,2,2,-0.4", "8,3,3,0"]


def test_without_stiffening_it_is_neo_hookean_and_at_small_strain_it_is_refused(tmp_path: Path) -> None:
    write_displacement_deck(tmp_path / "held.inp", _meshed(0.0), np.array([3]), np.zeros((1, 3)))
    written = (tmp_path / "held.inp").read_text("ascii")
    assert "*HYPERELASTIC,NEO HOOKE\n" in written
    assert "YEOH" not in written
    with raises(ModelRangeError, "linear_alone", stiffening=0.3):
        _meshed(0.3, finite_strain=False)


def test_the_page_says_what_was_confirmed() -> None:
    """Both are relative to the largest. CalculiX prints seven digits; its increments end at 0.5 % of a residual."""
    rows = read(KEPT)
    kept = {(StiffeningPress(row["finger"], row["shape"], row["stiffening"]), row["doi_mm"]) for row in rows}
    assert kept == {*confirmed.CASES}
    moved, pushed = (max(row[name] for row in rows) for name in ("displacements_off", "loads_off"))
    said = " ".join(PAGE.read_text("utf-8").split())
    assert f"our displacements within {moved:.1g} and forces of touched nodes within {pushed:.1g}" in said
    assert moved < 1e-4
    assert pushed < 1e-3


@pytest.mark.skipif(shutil.which("ccx") is None, reason="no ccx (Debian package calculix-ccx)")
@pytest.mark.xdist_group("calculix")
def test_calculix_has_the_same_state() -> None:
    found = confirmed.confirmed(StiffeningPress("default", "bar:3.0", 0.3), 0.25)
    assert found["displacements_off"] < 2e-6
    assert found["loads_off"] < 2e-5


def test_without_calculix_one_line_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    confirmed.main("unused")
    assert capsys.readouterr().out == f"{confirmed.MISSING}\n"


def test_what_does_not_converge_is_said_and_asked_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    asked: list[str] = []

    def once(scene: StiffeningPress, doi_mm: float) -> dict[str, object]:
        asked.append(scene.name)
        if scene.shape == "flat" and len(asked) == 1:
            raise RuntimeError("CalculiX: diverged")
        return {**scene._asdict(), "doi_mm": doi_mm}

    monkeypatch.setattr(shutil, "which", lambda name: name)
    monkeypatch.setattr(confirmed, "confirmed", once)
    monkeypatch.setattr(confirmed, "CASES", confirmed.CASES[:2])
    file = str(tmp_path / "rows.jsonl")
    confirmed.main(file)
    assert "default, flat, 0.3 2.0 CalculiX: diverged\n" in capsys.readouterr().out
    confirmed.main(file)
    assert asked == ["default, flat, 0.3", "default, bar:3.0, 0.3", "default, flat, 0.3"]
    assert len(read(tmp_path / "rows.jsonl")) == 2
