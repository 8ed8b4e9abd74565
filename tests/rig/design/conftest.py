"""A table of bumps instead of a finger: what candidates see differs by the width of a bump, and by its growth."""

from collections.abc import Callable

import numpy as np
import pytest

from rig.design.press_times import PressTimes
from rig.design.presses import possible_presses
from rig.design.response_table import ABOUT, CANDIDATES, ResponseTable

WIDTHS_MM = {"ep1": 0.5, "sed": 0.9, "e22": 1.6}
GROWTH = {"ep1": 1.0, "sed": 2.0, "e22": 1.0}
ALIKE = ("ep2", "ep3")
"""Two candidates that see the same."""


@pytest.fixture
def table() -> ResponseTable:
    """Return 126 presses of two shapes, the second of which is wider."""
    presses = possible_presses(("bar:1.5", "bar:3.0"), "doi_mm", (0.25, 0.5, 1.0))
    x_mm, below_mm = np.linspace(-0.5, 0.5, 5), np.linspace(0.1, 0.7, 4)
    node_x = np.tile(x_mm, len(below_mm))
    node_depth = np.repeat(below_mm, len(x_mm))
    values = np.zeros((1, len(presses), len(CANDIDATES), len(node_x)), dtype=np.float32)
    for j, press in enumerate(presses):
        for name, width in (WIDTHS_MM | dict.fromkeys(ALIKE, 0.7)).items():
            wide = width + 0.3 * node_depth + (0.4 if press.shape == "bar:3.0" else 0.0)
            bump = np.exp(-0.5 * ((press.x_mm - node_x) / wide) ** 2)
            values[0, j, CANDIDATES.index(name)] = press.target ** GROWTH.get(name, 1.5) * bump
    doi_mm = np.array([press.target for press in presses])
    about = np.tile([0.0, 5.0, 0.0, 3.0, 0.01], (len(presses), 1))
    about[:, ABOUT.index("doi_mm")] = doi_mm
    return ResponseTable(tuple(presses), values, x_mm, below_mm, about)


@pytest.fixture
def times(table: ResponseTable) -> PressTimes:
    """Return ten seconds for each press, twenty before the first, and a minute for a change."""
    return PressTimes(20.0, np.full(len(table.presses), 10.0), 60.0)


Silent = Callable[[int, int], None]


@pytest.fixture
def silent() -> Silent:
    """Return a function that shows no progress."""
    return lambda done, total: None
