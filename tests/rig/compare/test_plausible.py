"""Files of plausible fingers, and the design that comes of them."""

from pathlib import Path

import numpy as np
import pytest

from rig.compare.errors import FingersError
from rig.compare.plausible import PlausibleFingers, design_places, read_plausible
from sim.config.fingertip_config import FingertipConfig, Tissue

FILE = """\
receptor_depth_mm = [0.7, 0.9]

[finger.tissue]
epidermis_mm = [0.3, 0.5]
dermis_mm = [0.8, 0.8]
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Two ranges, and a parameter that is known."""
    path = tmp_path / "fingers.toml"
    path.write_text(FILE, encoding="utf-8")
    return path


def test_ranges_are_read_by_name(file: Path) -> None:
    found = read_plausible(file)
    assert found.ranges == {
        "tissue.dermis_mm": (0.8, 0.8), "tissue.epidermis_mm": (0.3, 0.5), "receptor_depth_mm": (0.7, 0.9)
    }  # fmt: skip
    assert found.free == ["tissue.epidermis_mm", "receptor_depth_mm"]


def test_a_byte_order_mark_is_no_part_of_a_key(file: Path) -> None:
    file.write_text(FILE, encoding="utf-8-sig")
    assert set(read_plausible(file).ranges) == {"tissue.dermis_mm", "tissue.epidermis_mm", "receptor_depth_mm"}


def test_the_shipped_example_holds_the_default_finger() -> None:
    example = Path(__file__).parents[3] / "examples" / "plausible_fingers" / "fingers.toml"
    assert len(read_plausible(example).design(FingertipConfig(), 0.76)) == 9


def test_a_place_is_a_finger() -> None:
    plausible = PlausibleFingers("x", {"tissue.bone_fraction": (0.2, 0.4), "tissue.epidermis_mm": (0.3, 0.5)})
    assert plausible.values(np.array([-1.0, 0.5])) == pytest.approx(
        {"tissue.bone_fraction": 0.2, "tissue.epidermis_mm": 0.45}
    )


def test_the_design_is_every_combination_and_changes_nothing_else(file: Path) -> None:
    config = FingertipConfig(tissue=Tissue(e_fat=0.07))
    design = read_plausible(file).design(config, 0.8)
    found = [(one.config.tissue.epidermis_mm, one.receptor_depth_mm) for one in design]
    np.testing.assert_allclose(found, [(e, d) for e in (0.3, 0.4, 0.5) for d in (0.7, 0.8, 0.9)])
    assert {one.config.tissue.e_fat for one in design} == {0.07}
    assert len(design_places(2)) == len(design)


def test_a_range_of_one_point_is_one_finger(file: Path) -> None:
    file.write_text("[finger.tissue]\nepidermis_mm = [0.4, 0.4]\n", encoding="utf-8")
    (one,) = read_plausible(file).design(FingertipConfig(), 0.76)
    assert one.config == FingertipConfig()


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("[0.3, 0.5]", "[0.5, 0.3]", "finger.tissue.epidermis_mm: [0.5, 0.3], expected the lowest value first"),
        ("[0.3, 0.5]", "[nan, 0.5]", "finger.tissue.epidermis_mm.0: Input should be a finite number"),
        ("[0.3, 0.5]", "[0.3, inf]", "finger.tissue.epidermis_mm.1: Input should be a finite number"),
        ("[0.3, 0.5]", "[0.3]", "finger.tissue.epidermis_mm.1: Field required"),
        ("[0.3, 0.5]", "0.3", "finger.tissue.epidermis_mm: Input should be a valid tuple"),
        ("[0.3, 0.5]", '["thin", 0.5]', "finger.tissue.epidermis_mm.0: Input should be a valid number"),
        ("[0.3, 0.5]", "[0.3, 9.0]", "tissue.epidermis_mm: Input should be less than 1"),
        ("[0.3, 0.5]", "[0.41, 0.5]", "epidermis_mm: [0.41, 0.5], expected a range that holds the run's own 0.4"),
        ("[0.7, 0.9]", "[0.8, 0.9]", "depth_mm: [0.8, 0.9], expected a range that holds the run's own 0.76"),
        ("epidermis_mm", "epidermis", "finger.tissue.epidermis: expected a number of a configuration's finger"),
        ("epidermis_mm = [0.3, 0.5]", "bone = [1, 2]", "finger.tissue.bone: expected a number"),
        ("finger.tissue", "finger.mesh", "finger.mesh: Extra inputs are not permitted"),
        ("receptor_depth_mm", "receptor_depth", "receptor_depth: Extra inputs are not permitted"),
        ("[finger.tissue]", "[finger.tissue", "fingers.toml: Expected ']'"),
        (FILE, "", "expected a range in finger.tissue, finger.geometry or receptor_depth_mm"),
        (
            "dermis_mm = [0.8, 0.8]",
            "dermis_mm = [0.7, 0.9]\nbone_fraction = [0.3, 0.4]",
            "4 ranges, expected 3 or fewer",
        ),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_used(file: Path, old: str, new: str, complaint: str) -> None:
    file.write_text(FILE.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(FingersError) as caught:
        read_plausible(file).design(FingertipConfig(), 0.76)
    assert str(caught.value).startswith(f"--fingers {file}: ")
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(FingersError, match=r"--fingers .*none\.toml: No such file or directory"):
        read_plausible(tmp_path / "none.toml")
