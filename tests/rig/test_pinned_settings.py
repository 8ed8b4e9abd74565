"""What two keys must be to each other, the virtual finger's relaxation, and files that cannot be read."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from rig.plan.config import Config, load_config
from rig.protocol.errors import BadInputError


@pytest.mark.parametrize(
    ("tables", "complaint"),
    [
        ({"limits": {"x_mm": [-6.0, 6.0]}}, ""),
        ({"limits": {"x_mm": [1.0, 3.0]}}, ""),
        ({"limits": {"x_mm": [-3.0, -1.0]}}, ""),
        ({"limits": {"x_mm": [2.0, 2.0]}}, "x_mm: expected the lower limit before the upper one"),
        ({"limits": {"x_mm": [6.0, -6.0]}}, "x_mm: expected the lower limit before the upper one"),
        ({"limits": {"along_mm": [0.0, 0.0]}}, ""),
        ({"limits": {"along_mm": [0.0, 0.5]}}, ""),
        ({"limits": {"along_mm": [-0.5, 0.0]}}, ""),
        ({"limits": {"along_mm": [0.1, 4.0]}}, "along_mm: expected a limit on either side of 0"),
        ({"limits": {"along_mm": [-4.0, -0.1]}}, "along_mm: expected a limit on either side of 0"),
        ({"limits": {"along_mm": [0.5, -0.5]}}, "along_mm: expected a limit on either side of 0"),
        ({"limits": {"soft_trip_n": 2.0, "hard_trip_n": 2.0}}, ""),
        ({"limits": {"soft_trip_n": 2.1, "hard_trip_n": 2.0}}, "soft_trip_n: expected no more than hard_trip_n"),
        ({"limits": {"hard_trip_n": 1.9}}, "soft_trip_n: expected no more than hard_trip_n"),
        ({"habits": {"touch_increment_mm": 0.05, "increment_mm": 0.05}}, ""),
        (
            {"habits": {"touch_increment_mm": 0.03, "increment_mm": 0.02}},
            "touch_increment_mm: expected no more than increment_mm",
        ),
        ({"limits": {"max_press_speed_mm_s": 1.0}}, ""),  # that of habits.press_speed_mm_s
        (
            {"limits": {"max_press_speed_mm_s": 0.99}},
            "limits.max_press_speed_mm_s = 0.99: expected no less than habits.press_speed_mm_s = 1",
        ),
        (
            {"limits": {"max_press_speed_mm_s": 1.5}, "habits": {"approach_speed_mm_s": 1.6}},
            "limits.max_press_speed_mm_s = 1.5: expected no less than habits.approach_speed_mm_s = 1.6",
        ),
        ({"limits": {"max_press_speed_mm_s": 1.5}, "habits": {"travel_speed_mm_s": 9.0}}, ""),
        # shares that sum to less than 1, and time constants above 0
        ({"virtual": {"relaxation": []}}, ""),
        ({"virtual": {"relaxation": [[0.3, 1.0], [0.2, 0.01]]}}, ""),
        ({"virtual": {"relaxation": [[0.99, 0.5]]}}, ""),
        ({"virtual": {"relaxation": [[1.0, 1.0]]}}, "relaxation: expected shares > 0"),
        ({"virtual": {"relaxation": [[0.5, 1.0], [0.5, 2.0]]}}, "relaxation: expected shares > 0"),
        ({"virtual": {"relaxation": [[0.0, 1.0]]}}, "relaxation: expected shares > 0"),
        ({"virtual": {"relaxation": [[-0.1, 1.0]]}}, "relaxation: expected shares > 0"),
        ({"virtual": {"relaxation": [[0.3, 0.0]]}}, "relaxation: expected shares > 0"),
        ({"virtual": {"relaxation": [[0.3, -1.0]]}}, "relaxation: expected shares > 0"),
        ({"virtual": {"relaxation": [[0.3, 1.0], [0.3, -1.0]]}}, "relaxation: expected shares > 0"),
    ],
    ids=str,
)
def test_keys_that_go_with_each_other(tables: dict[str, dict[str, object]], complaint: str) -> None:
    """Equal is allowed where it says "no more"; the complaint names the key and what was expected."""
    if complaint:
        with pytest.raises(ValidationError) as caught:
            Config.model_validate(tables)
        assert complaint in str(caught.value)
        return
    config = Config.model_validate(tables)
    for table, keys in config.model_dump(
        mode="json", include={name: set(keys) for name, keys in tables.items()}
    ).items():
        assert keys == tables[table]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, "config {path}: No such file or directory"),
        (b"\xff\xfe", "config {path}: not valid TOML: 'utf-8' codec can't decode"),
        (b"a = = 1", "config {path}: not valid TOML: Invalid value"),
        (b"[limits]\nmax_doi_mm = 2.5\n", "config {path}: limits.max_doi_mm = 2.5: input should be less than"),
    ],
)
def test_one_line_for_a_file_that_cannot_be_used(tmp_path: Path, content: bytes | None, expected: str) -> None:
    path = tmp_path / "rig.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(BadInputError) as caught:
        load_config(path)
    assert str(caught.value).startswith(expected.format(path=path))
    assert "\n" not in str(caught.value)


def test_a_configuration_without_calibrations_is_written_without_them() -> None:
    """TOML has no word for nothing: a key that is not there is left out; days are texts."""
    assert "none" not in Config().as_toml().lower()
    assert "framing" not in Config().as_toml()
    measured = {"value": 400.0, "date": "2026-03-01", "expires": "2027-03-01"}
    text = Config.model_validate({"calibration": {"x_steps_per_mm": measured}}).as_toml()
    assert 'date = "2026-03-01"' in text
    assert "y_steps_per_mm" not in text
