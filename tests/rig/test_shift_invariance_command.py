"""`rig shift-invariance`: its table beside the printed one, its picture, and what it refuses."""

from pathlib import Path

import numpy as np
import pytest

import sim.coding.raju_table_6_1 as kept
from rig.cli import encode
from sim.config import Contact, FingertipConfig, Tissue
from tests.program import Program, program_of
from tests.sim.coarse_mesh import as_toml, coarse_mesh

QUICK = ("--config", "coarse.toml", "--spacing-mm", 0.5, "--half-width-mm", 2)


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Program:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    Path("coarse.toml").write_text(as_toml(coarse_mesh(0.5, 0.5)), encoding="utf-8")
    return program_of(monkeypatch, capsys)


def test_it_prints_every_site_beside_the_printed_table_and_draws_one(rig: Program) -> None:
    ended = rig("shift-invariance", *QUICK, "--picture", "spread.svg")
    assert ended.code == 0
    assert ended.err == "24 point loads on the whole finger: loading from the cache, or computing them …\n"
    assert "SED 0.76 mm below the skin = A / r^m, under 1 gwt along the inward normal" in ended.out
    assert "receptors 0.5 mm apart within ± 2 mm of each site in x and in z" in ended.out
    rows = [line.split() for line in ended.out.splitlines()]
    sites = [row for row in rows if row and row[0].isdigit() and "sites," not in row]
    assert [row[0] for row in sites] == [str(n) for n in range(1, 25)]
    assert [row[1] == "tip" for row in sites] == [False] * 18 + [True] * 6
    assert sites[9][-3:] == ["12.80", "3.96", "0.961"]  # Raju 1998, Table 6.1
    assert "18 pulp sites, printed     m 3.886 ± 4.9%, A 12.04 ± 10.2%" in ended.out
    assert "all 24 sites, printed     m 3.980 ± 6.2%, A 13.05 ± 17.7%" in ended.out
    assert "18 pulp sites, linear      m " in ended.out
    assert ", A 12.04 ± " in ended.out.split("18 pulp sites, linear")[1].splitlines()[0]  # by the common factor
    assert Path("spread.svg").read_text(encoding="utf-8").startswith("<?xml")
    again = rig("shift-invariance", *QUICK, "--picture", "spread.svg", "--json")
    assert (again.code, again.error_code) == (2, "exists_already")


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


def test_other_choices_are_solved_for_anew(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path))
    keys: list[str] = []
    monkeypatch.setattr(kept, "cached_arrays", lambda key, make, kind: (keys.append(key), kind))
    monkeypatch.setattr(kept, "_read", lambda arrays: arrays)
    usual = kept.Sampled()
    others = [usual._replace(**{name: 0.7}) for name in usual._fields]
    for config, sampled in (
        *((FingertipConfig(), one) for one in (usual, *others, usual)),
        (FingertipConfig(tissue=Tissue(epidermis_mm=0.3)), usual),
        (FingertipConfig(contact=Contact(patch_gb=1.0)), usual),  # says nothing of point loads
    ):
        kept.cached_sites(config, sampled)
    assert keys[5] == keys[0] == keys[7]
    assert len(set(keys)) == 6


def test_a_large_sheet_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(encode, "say_now", said.append)
    for done in range(200, 2700, 200):
        encode._report_progress(done, 2693)
    encode._report_progress(2693, 2693)
    encode._report_progress(300, 300)
    assert said == [
        "computing strain at 1000 of 2693 receptors …",
        "computing strain at 2000 of 2693 receptors …",
        "factorizing the stiffness, then solving 24 point loads …",
    ]


def test_a_finger_that_the_sites_lie_beside_is_one_line(rig: Program) -> None:
    Path("short.toml").write_text(as_toml(coarse_mesh(0.5, 0.5)) + "\n[finger.geometry]\nlength_mm = 11.0\n")
    ended = rig("shift-invariance", "--config", "short.toml", *QUICK[2:], "--json")
    assert ended.code == 2
    assert ended.error_code
