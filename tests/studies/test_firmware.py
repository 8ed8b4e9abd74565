"""The virtual board against real firmware: tests/data/firmware, by the recipe of studies/firmware/README.md."""

import json
from pathlib import Path
from statistics import mean
from typing import Any

import pytest

from studies.firmware.__main__ import Record, differences, record, virtual_board
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
def test_the_virtual_board_stops_within_10_percent_of_the_real_distance(
    ours: Record, how: str, speed_mm_s: float
) -> None:
    """Within 10 %: the mean of seven stops each, which come at any phase of a segment."""
    there = recorded("grbl_1_1h")["stops_mm"][how][f"{speed_mm_s:g}"]
    here = ours["stops_mm"][how][f"{speed_mm_s:g}"]
    assert len(there) == len(here) == 7
    assert mean(here) == pytest.approx(mean(there), rel=0.1)


# Arcs and probing are not simulated; a host is slower than the motion and the pause that these reports are of.
NOT_SIMULATED = ["G2 X1", "G2 X1 Y1 R1 F60", "G38.2 X1"]
HOST_S_PACE = ["?"] * 4


def test_the_virtual_board_answers_line_by_line_as_real_firmware(ours: Record) -> None:
    """Some 240 lines and real-time bytes: g-code, `$` lines, reports in mm and inches, overrides, errors, alarms."""
    there = recorded("grbl_1_1h")
    assert len(there["conversation"]) > 230
    found = differences(ours, there)
    assert [row.split("`")[1] for row in found] == NOT_SIMULATED + HOST_S_PACE
    assert there["reports_of_a_flood"] == 3
    assert 1 <= ours["reports_of_a_flood"] <= 5


def test_grbl_and_grblhal_were_recorded_with_the_same_conversation(ours: Record) -> None:
    assert [sent for sent, _ in recorded("grblhal")["conversation"]] == [sent for sent, _ in ours["conversation"]]
