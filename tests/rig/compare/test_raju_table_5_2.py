"""The source's table, and scores of agreement with it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.compare.raju_table_5_2 import agreement, source_flags
from sim.measures.measures import MEASURES
from sim.measures.receptors import DEFAULT_X_MM

RECEPTORS = np.array(DEFAULT_X_MM)


def test_57_of_540_cells_match() -> None:
    # Raju (1998), Table 5.2, the doubtful +1.5 counted as printed.
    flags = source_flags(RECEPTORS)
    assert flags.shape == (18, 3, 10)
    assert flags.sum() == 57


def test_some_cells_by_hand() -> None:
    flags = source_flags(RECEPTORS)

    def receptors(measure: str, shape: int) -> list[float]:
        return RECEPTORS[flags[MEASURES.index(measure), shape]].tolist()

    assert receptors("ep1", 0) == [-1.5, -1.25, -1.0]
    assert receptors("ep1", 2) == [-1.0, -0.5]
    assert receptors("e11", 0) == [-1.25, -1.0, 1.5]
    assert receptors("e12", 0) == [0.0]
    assert receptors("third", 0) == []


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=4, max_size=60))
def test_matthews_is_the_correlation_of_the_two_tables(cells: list[tuple[bool, bool]]) -> None:
    ours, source = np.array(cells).T
    found = agreement(ours, source)
    if ours.std() and source.std():
        assert found.matthews == pytest.approx(np.corrcoef(ours, source)[0, 1])
    else:
        assert found.matthews == 0.0
