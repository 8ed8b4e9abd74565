"""Numbers that pages quote from tables of studies are those of the tables: a row here for each quotation."""

import re
from pathlib import Path

import pytest

from studies.registry import read_table

DOCS = Path(__file__).parents[2] / "docs"
NUMBER = re.compile(r"[-+−]?\d+(?:\.\d+)?")


def numbers(cell: str) -> list[float]:
    """Every number of a cell."""
    return [float(found.replace("−", "-")) for found in NUMBER.findall(cell)]


def cells(table: str, column: str, **of: str) -> list[str]:
    """Cells of a column; `first` is how the first cell of a row begins, `second` the second cell."""
    head, *rows = read_table(table)
    found = [
        row[head.index(column)]
        for row in rows
        if row[0].startswith(of.get("first", "")) and row[1] == of.get("second", row[1])
    ]
    assert found, (table, column, of)
    return found


def extent(values: list[float]) -> list[float]:
    """Least and largest size."""
    sizes = [abs(value) for value in values]
    return [min(sizes), max(sizes)]


def each(table: str, column: str, at: int = 0, **of: str) -> list[float]:
    """One number of each cell: the first, the second …"""
    return [numbers(cell)[at] for cell in cells(table, column, **of)]


def most(table: str, column: str, at: int = 0, **of: str) -> list[float]:
    """The largest size in a column."""
    return [max(abs(value) for value in each(table, column, at, **of))]


def levels(first: str, at: int) -> list[float]:
    """Largest error of a level over the three families: force (0) or strain energy (1)."""
    return [max(each("performance/levels", name, at, first=first)[0] for name in ("smooth", "bars", "step 1"))]


BY_DOI = "by DOI, median / p95 (ms)"
SMOOTH = ("step 5", "cylinder")


def presses(smooth: bool) -> list[float]:
    """Extent of the median times."""
    head, *rows = read_table("speed/presses")
    return extent([numbers(row[head.index(BY_DOI)])[0] for row in rows if row[0].startswith(SMOOTH) is smooth])


def small_strain(column: str, doi: str) -> list[float]:
    """Extent over the shapes of the finger."""
    return extent(each("small_strain/finger", column, second=doi))


def truth(first: str, second: str) -> float:
    """Percent of sets with the truth in them, the mean."""
    rows = read_table("comparison/answers")
    (row,) = [row for row in rows if (row[0], row[1]) == (first, second)]
    return numbers(row[2])[1]


GIVEN, PLAUSIBLE = "given the default finger", "on all plausible fingers"
SPREAD = "largest spread"
SETS = ("first", "second", "third")
BUTTON = "median, worst (ms)"


def counted(table: str) -> float:
    """Sum of all counts of a table."""
    _, *rows = read_table(table)
    return sum(float(cell) for row in rows for cell in row[1:])


def cases() -> list[float]:
    """Cases of the campaign, in thousands and the rest."""
    *_, totals = read_table("faults/campaign")
    return [*map(float, divmod(sum(int(cell.replace(" ", "")) for cell in totals[1:] if cell), 1000))]


def passed(table: str) -> list[float]:
    """Rows that pass, and rows that count."""
    verdicts = cells(table, "verdict")
    return [float(verdicts.count("pass")), float(verdicts.count("pass") + verdicts.count("fail"))]


MEDIAN = "seconds of bench time, median and most"


def checked(name: str) -> list[float]:
    """The largest error of `rig check`, duration and peak."""
    return [max(abs(numbers(row[at])[0]) for row in read_table(f"check/{name}")[1:] for at in (2, 4))]


QUOTED: list[tuple[str, str, list[float]]] = [
    (
        "index",
        r"(\d+) ms from the click to the byte",
        most("safety/panel_stops", "click to byte, ms: median, worst", 1),
    ),
    (
        "index",
        r"peak force within ([\d.]+) %; ([\d.]+) % on a",
        checked("like_the_model") + checked("another_finger"),
    ),
    (
        "index",
        r"force ([\d.]+) %, strain energy at receptors ([\d.]+) %",
        levels("default", 0) + levels("default", 1),
    ),
    ("index", r"half-width ([\d.]+) %", most("oracles/line_contact", "half-width", first="cylinder", second="16")),
    ("index", r"pressure ([\d.]+) %", most("oracles/line_contact", "pressure inside", first="cylinder", second="16")),
    ("index", r"linear force (\d+) to (\d+) % too high", small_strain("force", "0.33")),
    ("index", r"up to ([\d.]+) % between equilibria", most("hard_cases/flags", SPREAD)),
    ("index", r"forces ([\d.]+) % off", most("identification/demands", "first", first="median error")),
    (
        "index",
        r"(\d+) to (\d+) % in bands",
        extent([each("identification/demands", name, first="truth in")[0] for name in SETS]),
    ),
    ("index", r"bands of ± ([\d.]+) %", most("identification/demands", "third", first="median half-width")),
    ("index", r"(\d+) to (\d+) ms under smooth", presses(True)),
    ("index", r"(\d+) to (\d+) ms under sharp", presses(False)),
    ("index", r"`level = \"fine\"` ([\d.]+) and ([\d.]+) %", levels("fine", 0) + levels("fine", 1)),
    (
        "index",
        r"in the set: (\d+) %; on another finger and mesh (\d+) % with stated ranges, (\d+) %",
        [truth("right finger", GIVEN)] + [truth("another finger and mesh", way) for way in (PLAUSIBLE, GIVEN)],
    ),
    ("identify", r"\[(\d+) s at the bench\]", most("identification/demands", "first", first=MEDIAN)),
    ("small_strain", r"\| force \| (\d+) to (\d+) %", small_strain("force", "0.33")),
    ("small_strain", r"\| force \|[^|]*\| (\d+) to (\d+) %", small_strain("force", "0.67")),
    ("small_strain", r"\| force \|[^|]*\|[^|]*\| (\d+) to (\d+) %", small_strain("force", "1")),
    ("small_strain", r"contact \| up to (\d+) %", small_strain("width", "0.33")[1:]),
    ("small_strain", r"contact \|[^|]*\| up to (\d+) %", small_strain("width", "0.67")[1:]),
    ("small_strain", r"pressure \| (\d+) to (\d+) %", small_strain("peak pressure", "0.33")),
    ("small_strain", r"pressure \|[^|]*\| (\d+) to (\d+) %", small_strain("peak pressure", "0.67")),
    ("small_strain", r"pressure \|[^|]*\|[^|]*\| (\d+) to (\d+) %", small_strain("peak pressure", "1")),
    ("small_strain", r"receptors \| (\d+) to (\d+) %", small_strain("SED", "0.33")),
    ("small_strain", r"receptors \|[^|]*\| (\d+) to (\d+) %", small_strain("SED", "0.67")),
    ("small_strain", r"receptors \|[^|]*\|[^|]*\| (\d+) to (\d+) %", small_strain("SED", "1")),
    ("safety", r"up to (\d+) ms", most("safety/buttons", BUTTON, 1, first="quick-stop")),
    ("safety", r"\| (\d+) gwt \|" + r".*?\| (\d+) gwt \|" * 3, each("faults/exceptions", "worst, gwt")),
    ("safety", r"\[([\d.]+) gwt\]\(validation/faults.md#a-sensor", most("faults/nearer", "frozen at 0")),
    ("running", r"\[(\d+) runs\]", [counted("faults/kills_endings")]),
    ("validation/faults", r"All (\d+) runs", [counted("faults/kills_endings")]),
    ("validation/faults", r"Of (\d+) (\d+) cases on the first", cases()),
    (
        "validation/faults",
        r"(\d+) cases are exempt",
        [sum(each("faults/exceptions", "cases")[:-1])],
    ),  # ramps came later
    ("contact", r"up to ([\d.]+) %", most("hard_cases/flags", SPREAD)),
    ("coding", r"(\d+) to (\d+) %, by shape\]", extent(each("coding/convolution", "relative L2"))),
    ("coding", r"is (\d+) to (\d+) % off", extent(each("coding/bands_drawn", "30 dB"))),
    ("find_finger", r"within ± ([\d.]+) mm", each("safety/finger_place", "pad center x (mm)", 1, first="found")),
    ("validation/safety", r"took \[(\d+) ms\]", most("safety/panel_stops", "click to byte, ms: median, worst", 1)),
    ("validation/panel", r"up to (\d+) ms late", most("panel/soak", "second", 2, first="journal to page")),
    ("validation/coding", r"profiles\]\S+ are (\d+) to (\d+) %", extent(each("coding/bands_drawn", "30 dB"))),
    (
        "validation/coding",
        r"Classes\]\S+ are right in (\d+) %",
        each("coding/shapes", "class", first="0.17 mm", second="skin")[:1],
    ),
    ("validation/nerve", r"(\d+) of (\d+) rows pass", passed("nerve/tests")),
    ("validation/hard_cases", r"by up to ([\d.]+) %", most("hard_cases/flags", SPREAD)),
]


@pytest.mark.parametrize(("page", "pattern", "expected"), QUOTED)
def test_a_page_quotes_what_the_table_has(page: str, pattern: str, expected: list[float]) -> None:
    text = " ".join((DOCS / f"{page}.md").read_text(encoding="utf-8").split())
    found = re.search(pattern, text)
    assert found is not None, f"{page} no longer quotes it"
    for quoted, value in zip(found.groups(), expected, strict=True):
        decimals = len(quoted.partition(".")[2])
        assert abs(float(quoted) - value) <= 0.5001 * 10**-decimals, (quoted, value)
