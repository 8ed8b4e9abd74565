"""Every fault of the catalogue in studies/faults: what comes of it, and how hard the finger was pressed."""

from pathlib import Path

import pytest

from rig.engine.limits import FingerStiffness, TouchLimit
from rig.plan.config import Config
from rig.units import GWT_N
from studies.faults.campaign.judge import TOUCH_GWT
from studies.faults.faulty_bench import SOFT_TRIP_N, bound_gwt
from studies.registry import read_table
from tests.error_codes import causes, has_code
from tests.faults import phases
from tests.faults.catalogue import CATALOGUE, Fault
from tests.faults.outcomes import suffer


@pytest.mark.parametrize("fault", CATALOGUE, ids=lambda fault: fault.name)
def test_every_fault_of_the_catalog_ends_as_listed_and_within_the_force_bound(fault: Fault, tmp_path: Path) -> None:
    """Never beyond the soft trip and the computed overshoot; what was journalled is whole lines."""
    found = suffer(fault, tmp_path)
    assert found.outcome == fault.outcome, found.ended_by
    if found.ended_by is None:
        assert fault.code == ""
    else:
        has_code(found.ended_by, fault.code, shown=fault.shows)
        assert fault.cause in ("", *causes(found.ended_by))
    assert found.worst_gwt <= bound_gwt()
    assert found.journalled > 5
    expected = {"done": {"ready"}, "lifted": {"tripped", "ready"}, "held": {"tripped", "unhomed"}}
    assert found.state in expected[fault.outcome]


def test_every_fault_of_the_catalog_has_a_row_in_the_stored_table() -> None:
    _, *rows = read_table("faults/one_fault")
    assert [fault.name for fault in CATALOGUE] == [row[0] for row in rows]


# --- a failing sensor, by phase ---


def _cells() -> dict[str, dict[str, float]]:
    """Worst force by phase and fault."""
    head, *rows = read_table("faults/phases")
    return {row[0]: dict(zip(head[1:], (float(cell.split()[0]) for cell in row[1:]), strict=True)) for row in rows}


def test_the_stored_fault_table_covers_all_phases_and_stays_within_the_force_bounds() -> None:
    """A fault that shows stays below trip and overshoot; one that a single sensor cannot show, below depth."""
    cells = _cells()
    assert tuple(cells) == phases.PHASES
    for row in cells.values():
        assert set(row) == set(phases.FAULTS)
        for fault, worst_gwt in row.items():
            silent = fault in phases.SHOWN_BY_NOTHING
            assert worst_gwt <= (phases.deep_gwt() if silent else bound_gwt())


def _worst_cells() -> list[tuple[str, str, float]]:
    """Of each phase the worst fault that shows, and the worst that need not."""
    found = []
    for phase, row in _cells().items():
        for silent in (False, True):
            fault = max((f for f in row if (f in phases.SHOWN_BY_NOTHING) is silent), key=row.__getitem__)
            found.append((phase, fault, row[fault]))
    return found


def _stays(phase: str, fault: str, documented_gwt: float) -> bool:
    """What shows, where a finger is touched or come back to, and what depth alone bounds in a press and by hand."""
    if fault in phases.SHOWN_BY_NOTHING:
        return phase in ("press", "jog")
    return phase in ("touch", "press", "hold", "coming back", "jog")


@pytest.mark.quick(rows=_stays)
@pytest.mark.parametrize(("phase", "fault", "documented_gwt"), _worst_cells())
def test_the_worst_fault_of_each_phase_gives_the_documented_force(
    phase: str, fault: str, documented_gwt: float, tmp_path: Path
) -> None:
    assert phases.suffer(phase, fault, tmp_path).worst_gwt == pytest.approx(documented_gwt, abs=0.02)


# --- a finger that has come nearer, come back to ---


def _nearer() -> dict[tuple[str, str], float]:
    """Worst force by way and fault."""
    head, *rows = read_table("faults/nearer")
    return {(row[0], fault): float(gwt) for row in rows for fault, gwt in zip(head[1:], row[1:], strict=True)}


def _felt_gwt(late_s: float) -> float:
    """What the finger of 10 gwt at 1 mm feels at most of the one move, which ends at the touch."""
    limit = TouchLimit.of(Config(), SOFT_TRIP_N / GWT_N, TOUCH_GWT, FingerStiffness.unknown())
    touch_mm = FingerStiffness(10.0).depth_mm(TOUCH_GWT)
    return 10.0 * (touch_mm + limit.stop_mm + limit.speed_mm_s * late_s) ** 1.5


def test_a_finger_that_came_nearer_is_pressed_no_deeper_than_the_stopping_distance() -> None:
    """And with less than half the trip, also by a sensor that is half a second late without the rig's knowledge."""
    cells = _nearer()
    assert set(cells) == {(way, fault) for way in phases.WAYS_BACK for fault in (phases.NO_FAULT, *phases.FAULTS)}
    dead = ("frozen at 0", "frozen at its value")
    hidden_s = {"0.5 s late": phases.LATE_S, "slow, 0.5 s": phases.LATE_S, "intermittent": phases.BLINK_S}
    for (way, fault), worst_gwt in cells.items():
        if fault in dead:
            assert worst_gwt <= cells["by increments", fault], "one move makes it no worse"
        else:
            assert worst_gwt <= _felt_gwt(hidden_s.get(fault, 0.0)), way
            assert worst_gwt < 0.5 * SOFT_TRIP_N / GWT_N, way


@pytest.mark.parametrize(
    ("way", "fault"),
    [
        ("by increments", "none"),
        ("in one move", "none"),
        ("in one move", "0.5 s late"),
        ("in one move", "frozen at 0"),
    ],
)
def test_the_worst_faults_with_a_finger_that_came_nearer_give_the_documented_force(
    way: str, fault: str, tmp_path: Path
) -> None:
    cell = phases.come_nearer(way, fault, tmp_path)
    assert cell.worst_gwt == pytest.approx(_nearer()[way, fault], abs=0.02)
    assert cell.ended_by is not None
    assert cell.ended_by.code in ("contact_too_high", "no_contact")


def test_a_leadshine_stage_with_a_laumas_sensor_stops_within_the_stopping_distance(tmp_path: Path) -> None:
    devices = {"stage": {"kind": "leadshine"}, "force": {"kind": "laumas"}}
    cell = phases.come_nearer("in one move", phases.NO_FAULT, tmp_path, devices)
    assert 0.05 <= cell.worst_gwt <= _felt_gwt(0.0)
    assert cell.ended_by is not None
    has_code(cell.ended_by, "contact_too_high", x_mm=0.0)


@pytest.mark.parametrize("phase", ["touch", "press"])
def test_a_sensor_frozen_at_zero_is_detected_within_two_increments(phase: str, tmp_path: Path) -> None:
    """It used to go on to search_mm, 0.5 mm past the contact, and in a press to the deepest that is allowed."""
    cell = phases.suffer(phase, "frozen at 0", tmp_path)
    assert cell.worst_gwt < 10.0 * (0.11 + 0.05) ** 1.5
    assert cell.ended_by is not None
    if phase == "touch":
        has_code(cell.ended_by, "no_contact", before="showed a touch there just before")
    else:
        has_code(cell.ended_by, "lost_finger")
