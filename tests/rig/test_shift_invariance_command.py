"""`rig shift-invariance`: its table beside the printed one, its picture, and what it refuses."""

from pathlib import Path

import numpy as np
import pytest

import sim.coding.raju_table_6_1 as kept
from rig.cli import encode
from tests.program import Program, program_of
from tests.sim.coarse_mesh import as_toml, coarse_mesh

QUICK = ("--config", "coarse.toml", "--spacing-mm", 0.5, "--half-width-mm", 2)


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Program:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    Path("coarse.toml").write_text(as_toml(coarse_mesh(0.5, 0.5)), encoding="utf-8")
    return program_of(monkeypatch, capsys)


def test_as_json_it_has_every_number(rig: Program) -> None:
    found = rig("shift-invariance", *QUICK, "--force-gwt", 2, "--receptor-depth-mm", 0.7, "--json").json
    assert found["sampled"] == {"spacing_mm": 0.5, "half_width_mm": 2.0, "depth_mm": 0.7, "force_gwt": 2.0}
    sites = found["sites"]
    assert [site["number"] for site in sites] == list(range(1, 25))
    assert sites[9]["printed"] == {"a": 12.805, "m": 3.959, "r2": 0.961}
    assert (sites[9]["x_mm"], sites[9]["z_mm"], sites[9]["on_pulp"]) == (0.098, 6.893, True)
    assert sites[23]["on_pulp"] is False
    assert set(sites[0]["linear"]) == set(sites[0]["logarithmic"]) == {"a_pseudo", "m", "r", "r2"}
    assert len(sites[0]["by_azimuth"]) == 8
    assert sites[0]["receptors"] > 40
    for where, chosen in (("pulp", sites[:18]), ("all", sites)):
        for kind in ("linear", "logarithmic", "printed"):
            m = np.array([site[kind]["m"] for site in chosen])
            assert found[where][kind]["m"] == pytest.approx(m.mean())
            assert found[where][kind]["m_spread"] == pytest.approx(m.std(ddof=1) / m.mean())
    scaled = found["common_factor"] * found["pulp"]["linear"]["a_pseudo"]
    assert scaled == pytest.approx(found["pulp"]["printed"]["a"])


def test_what_was_solved_once_is_read_and_listed_by_rig_cache(rig: Program, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIG_CACHE_DIR", "kept")
    monkeypatch.setattr(encode, "_LINE_EVERY", 100)
    made = rig("shift-invariance", *QUICK)
    assert "strain at 200 of " in made.err
    monkeypatch.setattr(kept, "LoadedFinger", None)  # no mesh is made again
    for more in ((), ("--picture", "spread.svg")):
        again = rig("shift-invariance", *QUICK, *more)
        assert (again.code, again.out) == (0, made.out)
    listed = rig("cache").out
    assert "sites       1 file" in listed
    assert "SED under point loads at the 24 sites of the source" in listed
