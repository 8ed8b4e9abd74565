"""The virtual board against what real firmware did: tests/data/firmware, by the recipe of docs/devices.md."""

import json
from pathlib import Path
from statistics import mean
from typing import Any

import pytest

from studies.firmware.__main__ import Record, record, virtual_board
from studies.firmware.stop_distances import SPEEDS_MM_S, STOPS

RECORDS = Path(__file__).parents[1] / "data" / "firmware"


def recorded(name: str) -> Record:
    found: Record = json.loads((RECORDS / f"{name}.json").read_text(encoding="utf-8"))
    return found


@pytest.fixture(scope="module")
def ours() -> dict[str, Any]:
    return dict(record(*virtual_board()))


@pytest.mark.parametrize("speed_mm_s", SPEEDS_MM_S)
@pytest.mark.parametrize("how", STOPS)
def test_it_goes_on_as_far_as_the_real_one(ours: Record, how: str, speed_mm_s: float) -> None:
    """Within 10 %: the mean of seven stops each, which come at any phase of a segment."""
    there = recorded("grbl_1_1h")["stops_mm"][how][f"{speed_mm_s:g}"]
    here = ours["stops_mm"][how][f"{speed_mm_s:g}"]
    assert len(there) == len(here) == 7
    assert mean(here) == pytest.approx(mean(there), rel=0.1)
