"""`rig finger`: what it prints of the default finger and of the synthetic examples, and what it refuses."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.plan.config import load_config
from sim.finger import mesh as mesh_module
from sim.finger.surface import published_points
from tests.program import Ended, Program

EXAMPLES = Path(__file__).parents[2] / "examples" / "own_finger"
POINTS = "x_mm,y_mm,z_mm\n" + "".join(f"{x},{y},{z}\n" for x, y, z in published_points()[1])

Finger = Callable[..., Ended]


@pytest.fixture
def rig_finger(program: Program, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Finger:
    """Run `rig finger` in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    return lambda *words: program("finger", *words)


def configure(geometry: str, **files: str) -> Path:
    """A configuration in a folder of its own, with files beside it."""
    folder = Path("study")
    folder.mkdir()
    for name, text in files.items():
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")
    path = folder / "rig.toml"
    path.write_text(f"[finger.geometry]\n{geometry}\n", encoding="utf-8")
    return path


def test_rig_finger_json_describes_skin_layers_and_mesh_of_the_larger_example_finger(rig_finger: Finger) -> None:
    # 1.2 times the default finger: apex (−0.169, 5.824, 8.415), radii 4.308 and 4.072 mm.
    ended = rig_finger("--config", EXAMPLES / "points.toml", "--json")
    assert (ended.code, ended.err) == (0, "")
    found = ended.json
    assert (found["skin"]["source"], found["skin"]["count"]) == ("points", 99)
    assert found["skin"]["residual_rms_mm"] <= found["skin"]["residual_max_mm"] < 0.003
    assert found["apex"]["position_mm"] == pytest.approx([-0.169, 5.824, 8.415], abs=0.02)
    assert found["apex"]["lateral_radius_mm"] == pytest.approx(4.308, rel=0.005)
    assert found["apex"]["axial_radius_mm"] == pytest.approx(4.072, rel=0.005)
    assert found["receptor_plane_mm"] == pytest.approx(15.3 - 7.028)
    assert [layer["name"] for layer in found["layers"]] == ["epidermis", "dermis", "fat"]
    thickness = [layer["thickness_mm"] for layer in found["layers"]]
    assert thickness[:2] == pytest.approx([0.4, 0.8], rel=0.01)
    assert sum(thickness) == pytest.approx((1 - 0.32) * 5.824, rel=0.01)
    quality = found["quality"]
    assert (quality["folded"], quality["poor"]) == (0, 0)
    assert 0.3 < quality["smallest_scaled_jacobian"] < 1
    assert quality["largest_aspect_ratio_at_mm"][2] > 14  # the tip


def test_rig_finger_reads_a_finger_given_by_sections(rig_finger: Finger) -> None:
    found = rig_finger("--config", EXAMPLES / "sections.toml", "--json").json
    assert (found["skin"]["source"], found["skin"]["count"]) == ("sections", 16)
    assert found["apex"]["position_mm"] == pytest.approx([-0.169, 5.824, 8.415], abs=0.02)


def test_the_path_of_a_points_file_is_relative_to_the_configuration_file(rig_finger: Finger) -> None:
    path = configure('points = "mine.csv"', mine=POINTS)
    assert rig_finger("--config", path).code == 0
    config = load_config(path)
    assert config.finger.geometry.points == tuple(map(tuple, published_points()[1].tolist()))
    written = Path("copy.toml")
    written.write_text(config.as_toml(), encoding="utf-8")
    assert load_config(written) == config  # a run's own copy holds the numbers


def test_rig_finger_writes_the_mesh_as_vtk_and_overwrites_no_file(rig_finger: Finger) -> None:
    found = rig_finger("--vtk", "mesh.vtk", "--json").json
    assert f"POINTS {found['nodes']} double\n" in Path("mesh.vtk").read_text(encoding="ascii")
    assert rig_finger("--vtk", "mesh.vtk", "--json").error_code == "exists_already"


def test_rig_finger_warns_of_a_point_that_does_not_fit_the_skin(rig_finger: Finger) -> None:
    lines = POINTS.splitlines()
    lines[10] = "0.098,5.839,6.893"  # a slip of 1 mm
    ended = rig_finger("--config", configure('points = "mine.csv"', mine="\n".join(lines)))
    assert ended.code == 0
    assert "(0.10, 5.84, 6.89) mm" in ended.complaint


def test_rig_finger_refuses_a_mesh_with_a_folded_element(rig_finger: Finger, monkeypatch: pytest.MonkeyPatch) -> None:
    place = mesh_module.nodes_on_rays

    def with_a_fold(*arguments: object) -> tuple[Any, Any]:
        nodes, layers = place(*arguments)  # type: ignore[arg-type]
        nodes[5, 6, 2] = nodes[5, 6, 4]  # through two of its neighbours
        return nodes, layers

    monkeypatch.setattr(mesh_module, "nodes_on_rays", with_a_fold)
    ended = rig_finger("--json")
    assert (ended.code, ended.error_code) == (2, "folded")
