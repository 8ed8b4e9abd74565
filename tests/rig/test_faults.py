"""Every fault of the catalogue in studies/faults: what comes of it, and how hard the finger was pressed."""

import re
from pathlib import Path

import pytest

from rig.devices.units import GWT_N
from studies.faults.catalogue import CATALOGUE, Fault
from studies.faults.faulty_bench import SOFT_TRIP_N
from studies.faults.outcomes import bound_gwt, suffer

DOCS = Path(__file__).parents[2] / "docs" / "faults.md"


@pytest.mark.parametrize("fault", CATALOGUE, ids=lambda fault: fault.name)
def test_a_fault_ends_as_the_catalogue_says(fault: Fault, tmp_path: Path) -> None:
    """Never beyond the soft trip and the computed overshoot; what was journalled is whole lines."""
    found = suffer(fault, tmp_path)
    assert found.outcome == fault.outcome, found.reason
    assert re.search(fault.says, found.reason), found.reason
    assert found.worst_gwt <= bound_gwt()
    assert found.journalled > 5
    expected = {"done": {"ready"}, "lifted": {"tripped", "ready"}, "held": {"tripped", "unhomed"}}
    assert found.state in expected[fault.outcome]


def test_the_bound_is_below_the_hard_trip_and_its_overshoot() -> None:
    """5 N is 510 gwt; the bound of these runs is that of their own soft trip, 16 gwt."""
    assert pytest.approx(16.0) == SOFT_TRIP_N / GWT_N
    assert 16.0 < bound_gwt() < 510.0


def test_every_fault_has_its_row() -> None:
    rows = re.findall(r"^\| ([^|]+) \|", DOCS.read_text(encoding="utf-8"), re.MULTILINE)
    assert {fault.name for fault in CATALOGUE} <= set(rows)
