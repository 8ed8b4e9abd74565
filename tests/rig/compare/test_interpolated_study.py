"""`rig study` on fingers that differ in the moduli of dermis and fat: which are interpolated, and that it is said."""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.cli import study
from sim.models.interpolation import HOW_MADE, INTERPOLATED, forget_kept
from tests.program import Program
from tests.sim.coarse_mesh import as_toml, coarse_mesh

NINE = f"""\
receptor_x_mm = [0.0]

{as_toml(coarse_mesh(0.5, 0.5, patch_x_mm=1.5, patch_z_mm=1.5))}
[finger.tissue]
e_dermis = [0.05, 0.1, 0.2]
e_fat = [0.05, 0.1, 0.2]

[[press]]
shape = "cylinder:9"
doi_mm = 0.1
"""
Said = Callable[..., tuple[str, str]]


@pytest.fixture
def nine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Nine fingers, and nothing in the cache or in memory."""
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path / "cache"))
    forget_kept()
    path = tmp_path / "nine.toml"
    path.write_text(NINE, encoding="utf-8")
    return path


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch, program: Program) -> Said:
    """Run it here, in this process: standard output and standard error."""
    monkeypatch.setattr(study, "spread", lambda function, items, *_: map(function, items))

    def run(*words: object) -> tuple[str, str]:
        ended = program("study", *words)
        assert ended.code == 0, ended.err
        return ended.out, ended.err

    return run


def rows(table: Path) -> list[dict[str, str]]:
    with table.open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_nine_fingers_are_interpolated_and_say_so(rig: Said, nine: Path, tmp_path: Path) -> None:
    out, err = rig(nine)
    assert out.endswith(f"9 rows: fingers {HOW_MADE}; --exact builds a full model of each\n")
    lines = err.splitlines()
    assert lines[0] == "16 full builds"
    assert lines[-1] == "9 of 9 cases"
    near = rows(nine.with_suffix(".csv"))
    assert [row["model"] for row in near] == [INTERPOLATED] * 9
    told = json.loads(rig(nine, "--json", "--out", tmp_path / "again.csv")[0])
    assert (told["interpolated"], told["interpolation_text"]) == (9, HOW_MADE)
    assert rows(tmp_path / "again.csv") == near
    out, err = rig(nine, "--exact", "--json", "--out", tmp_path / "exact.csv")
    told = json.loads(out)
    assert (told["interpolated"], told["interpolation_text"]) == (0, None)
    assert "full builds" not in err
    exact = rows(tmp_path / "exact.csv")
    assert [row["model"] for row in exact] == ["finger"] * 9
    for one, other in zip(near, exact, strict=True):
        assert one["force_gwt"] != other["force_gwt"]
        assert float(one["force_gwt"]) == pytest.approx(float(other["force_gwt"]), rel=0.01)
