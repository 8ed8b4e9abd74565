"""Rows and repeats that are sums, means and the like, or that are two presses or one, are refused or named."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.presses_table import read_srp
from tests.rig.compare.recording_files import (
    ALL,
    TIMES,
    TWICE,
    Case,
    check,
    table,
    text,
)


def twice(*last: str, shift_mm: float = 0.0, header: str = "position_mm,rate,repeat") -> Callable[[Path], str]:
    """A table of repeats, the second ones at shifted positions, with more rows below."""
    return table(header, *(f"{x + shift_mm * (n - 1)!r},{y},{n}" for x, y, n in TWICE), *last)


def three_repeats(*labels: str, third: Sequence[str]) -> Callable[[Path], str]:
    """Rates of two presses at each of four positions, and a third row."""
    places = {-0.5: ("2.33", "4"), 0.0: ("10", "14"), 0.25: ("6", "7"), 1.0: ("0", "1")}
    rows = [(x, one, label) for x, pair in places.items() for one, label in zip(pair, labels[:2], strict=True)]
    rows += [(x, one, labels[2]) for x, one in zip(places, third, strict=True)]
    return table("position_mm,rate,repeat", *(f"{x:g},{one},{label}" for x, one, label in rows))


def four_repeats(of: Callable[[tuple[int, ...]], Any], places: int) -> Callable[[Path], str]:
    """Three presses at some positions, and a fourth repeat that is what these are together."""
    presses = ((10, 11, 13), (30, 33, 31), (25, 22, 29), (8, 9, 9), (17, 12, 13), (4, 9, 6), (2, 3, 7))[:places]
    rows = [(x, y, n) for x, some in enumerate(presses) for n, y in enumerate((of(some), *some))]
    return table("position_mm,rate,repeat", *(f"{x},{y},{n}" for x, y, n in rows))


def _sd(some: Any) -> float:
    return float(np.std(some, ddof=1))


def _beside(of: Sequence[Callable[[Any], Any]], before: bool, *, repeats: bool = True) -> list[str]:
    """Presses at uneven positions, and rows of what these are together in each column."""
    presses = [(x, y + d, n) for n, d in ((1, -1), (2, 1)) for x, y in zip((-0.6, 0.1, 0.4, 1), ALL, strict=True)]
    columns = np.array(presses if repeats else presses[:4])[:, : 3 if repeats else 2].T
    rows = [",".join(map(repr, row)) for row in columns.T.tolist()]
    totals = [",".join(f"{float(one(column))!r}" for column in columns) for one in of]
    return [*totals, *rows] if before else [*rows, *totals]


TUNING = dict(zip((-1.9, -1.35, -0.8, -0.42, -0.1, 0.22, 0.6, 1.15, 1.8, 2.05),
                  (5.1, 6.4, 16.2, 34.2, 53.0, 64.5, 57.9, 27.0, 7.6, 5.9), strict=True))  # fmt: skip
"""Rates at uneven positions."""


def tuning(*last: str, repeats: Sequence[int] = (), off: float = 3.0, block: str = "") -> Callable[[Path], str]:
    """Rates at uneven positions, each repeat higher by `off`, with rows below, or a row below each repeat."""
    rows = []
    for n in repeats or (0,):
        rows += [f"{x},{y + off * n:g}" + f",{n}" * bool(repeats) for x, y in TUNING.items()]
        rows += [block.format(n=n, mean=27.78 + off * n)] if block else []
    return table("position_mm,rate" + ",repeat" * bool(repeats), *rows, *last)


def _with(rate: float) -> list[float]:
    """Return these rates, and one between -0.1 and 0.22 mm."""
    rates = list(TUNING.values())
    return [*rates[:5], rate, *rates[5:]]


def spaced(*last: str) -> Callable[[Path], str]:
    """Rates at equally spaced positions."""
    rates = (4.2, 6.1, 16.3, 39.2, 54.4, 46.7, 21.3, 9.4, 6.1)
    return table(
        "position_mm,rate", *(f"{x},{y}" for x, y in zip(np.arange(-2, 2.5, 0.5), rates, strict=True)), *last
    )


def counted(*last: str) -> Callable[[Path], str]:
    return table("position_mm,count,window_s", *(f"{x},{y / 2:.0f},.5" for x, y in TUNING.items()), *last)


ROWS = {
    **{
        f"an unnamed row: {what}": Case(
            "no press", write, columns, code="totals", says=(f"row {row}", f"the {word} of", "delete it"))
        for what, write, columns, row, word in (
            ("the mean at 0", tuning("0,27.78"), (), 12, "mean"),
            ("the total at 0", tuning("0.0,277.8"), (), 12, "sum"),
            ("the total of counts at 0", counted("0,139,.5"), (), 12, "sum"),
            ("the mean at the next place", spaced("2.5,22.6333"), (), 11, "mean"),
            ("the sum at the next place", spaced("2.5,203.7"), (), 11, "sum"),
            ("the mean above the sum", spaced("2.5,22.6333", "3,203.7"), (), 11, "mean"),
            ("the mean of one repeat", tuning("0.125,30.78,1", repeats=(1, 2)), (), 22, "mean"),
            ("a mean below each repeat", tuning(repeats=(1, 2, 3), off=3.1, block="0.125,{mean:g},{n}"), (), 12,
             "mean"),
        )
    },
    "a table": Case(
        "what was read is said, so that a wrong row is seen", tuning(), rates=list(TUNING.values()),
        read_as="10 presses at 10 positions from -1.9 to 2.05 mm, 5.1 to 64.5 1/s, highest at 0.22 mm (row 7).",
    ),
    "a table of counts": Case(
        "what was read is said", counted(), rates=[6, 6, 16, 34, 52, 64, 58, 28, 8, 6],
        read_as="from -1.9 to 2.05 mm, 6 to 64 1/s (3 to 32 spikes), highest at 0.22 mm (row 7).",
    ),
    **{
        f"an unnamed row, stated: {what}": Case(
            f"{why}: the page and the terminal show the last row", write, rates=rates, read_as=read_as)
        for what, why, write, rates, read_as in (
            ("medians", "as high as a press", tuning("0.06,21.6"), _with(21.6),
             "row 12 has 21.6 1/s at 0.06 mm (first and last row); the sum of all is 299.4"),
            ("the rounded mean at 0", "one digit fewer", tuning("0,27.8"), _with(27.8),
             "Row 12 has the mean of the rows above and is counted as a press: delete it"),
            ("the largest", "a repeat of the peak", tuning("0.125,64.5"), _with(64.5),
             "row 12 has 64.5 1/s at 0.125 mm (first and last row)"),
        )
    },
    "repeats that rise by one step": Case(
        "the second is the mean of the others, and no first or last one", tuning(repeats=(1, 2, 3)),
        rates=[y + 6 for y in TUNING.values()],
    ),
    "a last press at 0, as high as the mean": Case(
        "value and place of the mean; in the middle it counts", table(
            "position_mm,count,window_s", "-1,4,1", "1.5,5,1", "-.5,13,1", ".5,24,1", "-1.5,2,1", "1,6,1", "0,9,1"),
        code="totals", says=("row 8", "the mean of the rows above", "move it into the middle"),
    ),
    "a press at 0 in the middle, as high as the mean": Case(
        "the way out", table(
            "position_mm,count,window_s", "-1,4,1", "1.5,5,1", "-.5,13,1", "0,9,1", ".5,24,1", "-1.5,2,1", "1,6,1"),
        rates=[2, 4, 13, 9, 24, 6, 5], silent="is counted as a press",
    ),
    "a refined position, as high as the median": Case(
        "counts are often equal", table(
            "position_mm,count,window_s", "-2,4,1", "-1,9,1", "0,24,1", "1,13,1", "2,5,1", "0.4,9,1"),
        rates=[4, 9, 24, 9, 13, 5], read_as="row 7 has 9 at 0.4 mm (first and last row)",
    ),
    **{
        f"a repeat {label} that is {what}": Case(
            "no press is what the others are together", three_repeats("1", "2", label, third=third),
            code="totals",
            says=(f"'{label}'", word, "each of 4 positions"),
        )
        for label, what, word, third in (
            ("0", "the mean", "mean", ("3.165", "12", "6.5", "0.5")),
            ("9", "the sum", "sum", ("6.33", "24", "13", "1")),
            ("3", "the rounded mean", "mean", ("3.2", "12.0", "6.5", "0.5")),
        )
    },
    **{
        f"a repeat that is {what} of the others{where}": Case(
            "no press is what the others are together", four_repeats(of, places), code="totals",
            says=("'0'", word, f"each of {places} positions"),
        )
        for what, word, of, where, places in (
            ("the mean as a whole number", "mean", lambda others: round(float(np.mean(others))), "", 7),
            ("the mean as a whole number, with a point", "mean", lambda others: float(round(np.mean(others))), "", 7),
            ("the mean, with zeros", "mean", lambda others: f"{np.mean(others):.1f}000", "", 7),
        )
    },
    "a repeat that is the mean at some positions": Case(
        "by chance", three_repeats("1", "2", "3", third=("3.165", "12", "6.5", "0")), rates=[3.165, 12, 6.5, 1 / 3],
    ),
    "positions that differ by a rounding error": Case("they are one position", twice(shift_mm=4e-16), rates=ALL),
    "positions that differ by 0.1 µm": Case("they are one position", twice(shift_mm=1e-4), rates=ALL),
    "positions that differ by 2 µm": Case("readings of a stage; four positions or eight?", twice(shift_mm=2e-3),
                                          code="close_positions", says=("row 6", "-0.498", "row 2", "round")),
    "positions 2 µm apart in one repeat": Case(
        "two positions, and it is said", table("position_mm,rate", "-0.5,6", "-0.498,24", "0.25,12", "1,1"),
        rates=ALL, read_as="-0.5 and -0.498 mm lie within 0.01 mm",
    ),
    "an sd is missing": Case("the others would not count either", table("position_mm,rate,sd", "-0.5,6,1", "0,24,",
                                                                        "0.25,12,1"),
                             code="no_number", says=("row 3", "sd", "0 or more")),
    **{
        f"an sd {missing!r}": Case("its row need not go", table("position_mm,rate,sd", "-0.5,6,1", f"0,24,{missing}"),
                                   code="no_number", says=("row 3", "sd", "fill it in, or delete the column"))
        for missing in ("", "-", "n/a", "NaN")
    },
    "a rate n/a": Case("its row says nothing", table("position_mm,rate,sd", "-0.5,6,1", "0,n/a,1"), code="no_number",
                       says=("row 3", "rate", "delete rows")),
    "an sd of no row": Case("there is none", table("position_mm,rate,sd", "-0.5,6,", "0,24,", "0.25,12,", "1,1,"),
                            rates=ALL),
    "an sd and repeats": Case("which of the two?", table("position_mm,rate,repeat,sd", *(
        f"{x},{y},{n},9" for x, y, n in TWICE)), code="sd_and_repeats", says=("column sd", "delete")),
    **{
        f"a row with repeat {word!r}": Case("a summary is no press", twice(f"0,99,{word}"), code="no_repeat",
                                            says=("row 10", repr(word), "delete"))
        for word in ("", "Mean", "sum", "Mittelwert", "mean (n=2)", "AVG(1:2)", "mean2", "n = 2")
    },
    **{
        f"repeat {again!r} after {first!r}": Case(
            "one repeat", table("position_mm,rate,repeat", f"0,6,{first}", f"0,24,{again}", f"0.25,12,{more}"),
            code="place_twice", says=("row 3", "first in row 2", f"both have {again!r} in the column repeat"),
        )
        for first, again, more in (("1", "1.0", "2"), ("01", "1", "2"), ("1e1", "10", "2"), ("a1", "A1", "a2"),
                                   ("a 1", "a  1", "a 2"), ("a 1", "a\u00a01", "a 2"))
    },
    **{
        f"a repeat {word!r} beside numbers": Case(
            "what is no number may be a mean", twice(f"0,99,{word}"), code="no_repeat", says=("row 10", repr(word))
        )
        for word in ("M", "M1", "moyenne 1-2", "Mittel", "gesamt", "promedio", "trial 3", "1-2", "1+2")
    },
    **{
        f"a repeat {word!r} beside names": Case("a summary is no press", table(
            "position_mm,rate,repeat", "0,1,a", "0,3,b", f"0,2,{word}"), code="no_repeat", says=(repr(word),))
        for word in ("moyenne", "Mittelwert 1", "Durchschnitt", "gesamt", "Promedio", "media", "somme", "Summe n=2")
    },
    "repeats with numbers and letters": Case("names", table("position_mm,rate,repeat", *(
        f"{x},{y},{('r1', 'M2')[n - 1]}" for x, y, n in TWICE)), rates=ALL),
    "repeats A1 and A01": Case("two labels", table("position_mm,rate,repeat", *(
        f"{x},{y},{('A1', 'A01')[n - 1]}" for x, y, n in TWICE)), rates=ALL),
    "one repeat, written in two ways": Case("a position of it and one nearby are two positions", table(
        "position_mm,rate,repeat", "-0.5,6,1", "-0.498,24,1.0", "0.25,12,01", "1,1,1"), rates=ALL,
        read_as="-0.5 and -0.498 mm lie within 0.01 mm"),
    "repeats with names, and a mean": Case("a summary is no press", table("position_mm,rate,repeat", "0,1,a", "0,3,b",
                                                                          "0,2,mean"), code="no_repeat"),
    "repeats with names": Case("allowed, and said", table("position_mm,rate,repeat", *(
        f"{x},{y},{'ab'[n - 1]}" for x, y, n in TWICE)), rates=ALL,
        read_as="The repeats a, b are counted as presses: delete rows of sums and means."),
    **{
        f"repeats with names, and {word!r}": Case("no list has all words for a mean: it is stated", table(
            "position_mm,rate,repeat", *(f"{x},{y},{'ab'[n - 1]}" for x, y, n in TWICE),
            *(f"{x},{y},{word}" for x, y in zip((-0.5, 0, 0.25, 1), ALL, strict=True))), rates=ALL,
            read_as=f"The repeats a, b, {word} are counted as presses: delete rows of sums and means.")
        for word in ("zu", "kesk", "\u2205")
    },
    "a row of sums": Case("no press", table("position_mm,rate", "-0.6,6", "0.1,24", "0.4,12", "1,1", "0.9,43"),
                          code="totals", says=("row 6", "'43'", "the sum of the rows above")),
    "a row of sums of counts": Case("no press", table("position_mm,count,window_s", "-1,6,1", "-.5,24,1", "1.5,12,1",
                                                      "0,42,3"), ("window=1",), code="totals", says=("the sum",)),
    "a row of means": Case("no press", table("position_mm,rate", "-0.5,6", "0.1,24", "0.4,12", "1,1", "0.25,10.75"),
                           code="totals", says=("the mean of the rows above",)),
    **{
        f"{what} of pandas {where}": Case(
            "no press", table("position_mm,rate,repeat", *_beside(of, before)), code=code, says=says)
        for what, of, code, says in (
            ("mean and sd", (np.mean, _sd), "no_repeat", ("'1.5'", "a whole number")),
            ("an sd", (_sd,), "no_repeat", ("a whole number",)),
            ("an sd of n", (np.std,), "no_repeat", ("'0.5'",)),
        )
        for where, before in (("below", False), ("above", True))
    },
    **{
        f"{what}, without repeats, {where}": Case(
            "no press", table("position_mm,rate", *_beside(of, before, repeats=False)), code="totals",
            says=(f"the {word} of the rows {'below' if before else 'above'}",))
        for what, of, word in (
            ("mean and sd", (np.mean, _sd), "mean"), ("a sum", (np.sum,), "sum"),
        )
        for where, before in (("below", False), ("above", True))
    },
    **{
        f"a row called {label!r} in a column that is not read": Case(
            "pandas writes it as the index", table("name,position_mm,rate", *(
                f"{n},{x},{y}" for n, (x, y, _) in enumerate(TWICE[:4])), f"{label},0.8,3"),
            ("position=position_mm", "rate=rate"), code="totals", says=("row 6, column name", repr(label)))
        for label in (
            "mean", "std", "sd", "sum", "median", "var", "count", "Total", "min",
            "max", "n", "SEM", "Summe", "m\u00e9dia",
            "gemiddelde", "\u5e73\u5747", "mean of 4 presses", "75%", "95% CI", "variance", "n=4",
        )
    },
    "a row called mean beside spike times": Case(
        "it is no spike", text("index,t_s\n" + "".join(f"{n},{t}\n" for n, t in enumerate(TIMES)) + "mean,47.5\n"),
        ("time=t_s",), code="totals", says=(f"row {len(TIMES) + 2}, column index", "'mean'"), pulses=False),
    "levels that are called min and max": Case(
        "conditions, not summaries", table("level,position_mm,rate", *(
            f"{level},{x},{y}" for level, x, y in zip(("min", "max") * 2, (-0.5, 0, 0.25, 1), ALL, strict=True))),
        ("position=position_mm", "rate=rate"), rates=ALL),
    "means, called so in every row": Case(
        "they are what was recorded", table("statistic,position_mm,rate", *(
            f"mean,{x},{y}" for x, y in zip((-0.5, 0, 0.25, 1), ALL, strict=True))),
        ("position=position_mm", "rate=rate"), rates=ALL),
    **{
        f"a repeat called {word!r}": Case("a summary is no press", twice(f"0,99,{word}"), code="no_repeat",
                                          says=(repr(word),))
        for word in ("var", "variance", "25%", "q25 quantile", "range", "CI", "95% CI", "stdev", "sem", "quartile 1")
    },
    **{
        f"{value} among {what}": Case("no data", table(header, *(row.replace("no", value) for row in rows)), columns,
                                      code="no_number", says=(f"row 3, column {column}", value, "no data"))
        for value, what, header, column, columns, rows in (
            ("999", "rates", "position_mm,rate", "rate", (), ("-1,6", "0,no", "1,12", "2,1")),
            ("999.0", "rates", "position_mm,rate", "rate", (), ("-1,6", "0,no", "1,12", "2,no")),
            ("999", "counts", "position_mm,count", "count", ("window=1",), ("-1,6", "0,no", "1,12", "2,1")),
            ("9999", "rates in a unit of their own", "position_mm,rate (a.u.)", "rate (a.u.)", (),
             ("-1,6", "0,no", "1,12", "2,1")),
            ("99", "positions", "position_mm,rate", "position_mm", (), ("-1,6", "no,24", "1,12", "2,1")),
            ("-99", "positions", "position_mm,rate", "position_mm", (), ("-1,6", "no,24", "1,12", "2,1")),
        )
    },
    "a rate of 99 among lower ones": Case("it may be one", table("position_mm,rate", "-1,6", "0,99", "1,12"),
                                          rates=[6, 99, 12]),
    "a rate of 999 among high ones": Case("it may be one", table("position_mm,rate", "-1,600", "0,999", "1,12"),
                                          rates=[600, 999, 12]),
    "a last press at the mean position": Case("its rate is not the mean's", table(
        "position_mm,rate", "-0.5,6", "0,24", "0.25,12", "0.75,1", "0.125,12"), rates=[6, 24, 12, 12, 1]),
    "the same rate everywhere": Case("a last press at 0 is no mean", table(
        "position_mm,rate", "-1,6", "1,6", "-.5,6", ".5,6", "0,6"), rates=[6] * 5),
}  # fmt: skip
CASES = ROWS


@pytest.mark.parametrize("name", CASES)
def test_only_presses_count_as_presses(name: str, tmp_path: Path) -> None:
    check(CASES[name], tmp_path)


@pytest.mark.parametrize(
    ("rates", "places", "presses", "most"), [((3, 43), 7, 4, 0.01), ((1, 9), 7, 5, 0.01), ((0.3, 3.3), 4, 10, 0.01)]
)
def test_presses_are_rarely_taken_for_sums_or_means(
    rates: tuple[float, float], places: int, presses: int, most: float, tmp_path: Path
) -> None:
    """Poisson counts under a bell of rates, in 200 tables, also of an afferent that hardly fires."""
    chance, x, path = np.random.default_rng(0), np.linspace(-1.5, 1.5, places), tmp_path / "synthetic.csv"
    mean = rates[0] + (rates[1] - rates[0]) * np.exp(-((x - 0.2) ** 2) / 0.8)
    refused = []
    for _ in range(200):
        counts = chance.poisson(mean, size=(presses, places)).tolist()
        rows = [f"{at},{one}.0,{n}" for n, some in enumerate(counts) for at, one in zip(x, some, strict=True)]
        path.write_text("\n".join(["position_mm,rate,repeat", *rows]), encoding="utf-8")
        try:
            read_srp(path)
        except RecordingError as error:
            refused.append(error.code)
    assert set(refused) <= {"totals"}
    assert len(refused) <= most * 200
