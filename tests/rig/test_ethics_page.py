"""The numbers of docs/ethics.md are those of the program and of the tables that it points to."""

import re
from pathlib import Path
from typing import Any

import pytest

from rig.settings import LimitSettings
from rig.units import GWT_N
from studies.registry import expanded, read_table

DOCS = Path(__file__).parents[2] / "docs"
PAGE = " ".join((DOCS / "ethics.md").read_text(encoding="utf-8").split())


def table(page: str, after: str) -> list[list[str]]:
    """Cells of the rows of the first table after some words, its head left out."""
    lines = expanded((DOCS / page).read_text(encoding="utf-8")).split(after, 1)[1].splitlines()
    first = next(n for n, line in enumerate(lines) if line.startswith("|"))
    rows = []
    for line in lines[first + 2 :]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows


def limit(name: str) -> tuple[Any, Any]:
    """Its default, and the most that it may be set to."""
    field = LimitSettings.model_fields[name]
    (most,) = [bound.le for bound in field.metadata if hasattr(bound, "le")]
    return field.default, most


@pytest.mark.parametrize(
    ("row", "name", "unit", "per"),
    [
        ("force above which nothing is planned", "max_force_gwt", "gwt", 1),
        ("force that ends a run", "soft_trip_n", "N", 1),
        ("force that ends everything", "hard_trip_n", "N", 1),
        ("depth past first contact", "max_doi_mm", "mm", 1),
        ("force over contact area", "max_pressure_kpa", "kPa", 1),
        ("speed near and on the finger", "max_press_speed_mm_s", "mm/s", 1),
        ("time touched in one run", "max_contact_s", "h", 3600),
    ],
)
def test_the_ethics_page_states_the_limits_of_the_program(row: str, name: str, unit: str, per: float) -> None:
    (cells,) = [cells for cells in table("ethics.md", "how hard") if cells[0].startswith(row)]
    for cell, value in zip(cells[1:], limit(name), strict=True):
        number, _, rest = cell.partition(" ")
        assert float(number) == pytest.approx(value / per)
        assert rest.split(" (")[0] == unit
        said_n = re.search(r"\(([\d.]+) N\)", rest)
        assert said_n is None or float(said_n[1]) == pytest.approx(value * GWT_N, abs=0.05)


def test_the_ethics_page_states_number_and_worst_force_of_the_fault_table() -> None:
    _, *rows = read_table("faults/one_fault")
    assert f"{len(rows)} faults of wires" in PAGE
    worst = max(float(cells[-1]) for cells in rows)
    said = re.search(r"worst\s+([\d.]+) gram-weight", PAGE)
    assert said is not None
    assert worst <= float(said[1]) < worst + 0.1


def test_the_ethics_page_states_the_worst_force_of_all_phases() -> None:
    _, *rows = read_table("faults/phases")
    forces = [float(cell.split()[0]) for cells in rows for cell in cells[1:]]
    assert f"{len(forces)} combinations" in PAGE
    assert 15.5 < max(forces) <= 16


def test_the_ethics_page_states_the_peak_force_of_the_shipped_protocols() -> None:
    rows = table("validation/check.md", "## On a finger like the model")
    forces = [float(cell) for cells in rows for cell in cells[3].split(", ")]
    said = re.search(r"shipped protocols stay below ([\d.]+) gram-weight", PAGE)
    assert said is not None
    assert 0.9 * float(said[1]) < max(forces) <= float(said[1])
