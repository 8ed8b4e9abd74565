"""Files of plausible fingers, and the design that comes of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.compare.exceptions import FingersError
from rig.compare.plausible_fingers import design_places, read_plausible
from sim.config import FingertipConfig, Tissue
from tests.error_codes import raises

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


def test_the_shipped_example_holds_the_default_finger() -> None:
    example = Path(__file__).parents[3] / "examples" / "plausible_fingers" / "fingers.toml"
    assert len(read_plausible(example).design(FingertipConfig(), 0.76)) == 9


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


def invalid(key: str, rule: str) -> dict[str, Any]:
    return {"key": key, "rule": rule}


@pytest.mark.parametrize(
    ("old", "new", "code", "fields"),
    [
        (
            "[0.3, 0.5]",
            "[0.5, 0.3]",
            "invalid_value",
            invalid("finger.tissue.epidermis_mm", "must begin with the lowest value"),
        ),
        (
            "[0.3, 0.5]",
            "[nan, 0.5]",
            "invalid_value",
            invalid("finger.tissue.epidermis_mm.0", "must be a finite number"),
        ),
        ("[0.3, 0.5]", "[0.3, 9.0]", "invalid_value", invalid("tissue.epidermis_mm", "must be less than 1")),
        (
            "[0.3, 0.5]",
            "[0.41, 0.5]",
            "without_the_own",
            {"key": "tissue.epidermis_mm", "low": 0.41, "high": 0.5, "own": 0.4},
        ),
        ("epidermis_mm", "epidermis", "no_number", {"key": "tissue.epidermis", "table": "tissue"}),
        (
            "receptor_depth_mm",
            "receptor_depth",
            "unknown_key",
            {"key": "receptor_depth", "near": ["receptor_depth_mm"]},
        ),
        ("[finger.tissue]", "[finger.tissue", "no_toml", {}),
        (FILE, "", "no_range", {}),
        (
            "dermis_mm = [0.8, 0.8]",
            "dermis_mm = [0.7, 0.9]\nbone_fraction = [0.3, 0.4]",
            "many_ranges",
            {"ranges": 4, "most": 3},
        ),
    ],
)
def test_a_file_that_cannot_be_used(file: Path, old: str, new: str, code: str, fields: dict[str, Any]) -> None:
    file.write_text(FILE.replace(old, new, 1), encoding="utf-8")
    with raises(FingersError, code, where=f"--fingers {file}", **fields) as caught:
        read_plausible(file).design(FingertipConfig(), 0.76)
    assert "\n" not in str(caught.value)
