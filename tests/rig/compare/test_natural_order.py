"""Conditions and indentors stand in the order of their numbers, wherever they are listed."""

import random
from typing import Any

import numpy as np
import pytest

from rig.compare.comparison import compare
from rig.report.run_tables import conditions
from rig_shared.natural_order import natural_order
from tests.rig.compare.test_run_report import run_of

ORDERED = [
    ["bar:3.0 to 1 gwt", "bar:3.0 to 2 gwt", "bar:3.0 to 5 gwt", "bar:3.0 to 10 gwt"],
    ["bar:1.5", "bar:3.0", "bar:10.0", "step:1", "step:10"],
    ["x = −2", "x = −1", "x = 0", "x = 1"],
    ["at 2 mm/s", "at 10 mm/s"],
    ["heightmap:r2.csv,spacing_mm=0.15", "heightmap:r10.csv,spacing_mm=0.15"],
]


@pytest.mark.parametrize("names", ORDERED)
def test_names_are_in_the_order_of_their_numbers(names: list[str]) -> None:
    mixed = random.Random(1).sample(names, len(names))
    assert sorted(mixed, key=natural_order) == names


def test_a_comparison_lists_its_shapes_in_that_order(make_stimulus: Any) -> None:
    x, receptor = np.linspace(-1.0, 1.0, 3), np.array([0.0])
    made = [make_stimulus(shape, x, receptor, {"ep1": x[:, None] ** 2}) for shape in ("bar:10", "bar:2", "bar:1.5")]
    assert [one.shape for one in compare(made, {}).stimuli] == ["bar:1.5", "bar:2", "bar:10"]


@pytest.mark.parametrize("key", ["x_mm", "value"])
def test_what_differs_by_arithmetic_alone_is_one_condition(key: str) -> None:
    """3 × 0.1 is 0.30000000000000004 and is written so; the stage and the sensor know no difference."""
    press = {"indentor": "bar:3.0", "x_mm": 0.0, "target": "force_gwt", "value": 1.0}
    made = [{"index": k, **press, key: value} for k, value in enumerate((0.3, 0.1 * 3, 0.1 + 0.2))]
    (only,) = conditions(run_of(made, []))
    assert only.indices == (0, 1, 2)
