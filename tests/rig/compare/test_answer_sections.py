"""What the page says of an answer: every figure and sentence follows from its rows."""

from dataclasses import replace

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from rig.compare.verdict import (
    AfferentVerdict,
    FittedPositions,
    LeftOut,
    Mimic,
    PairRow,
    Power,
    RecordingNoise,
    Separate,
    Together,
)
from rig.report.page_parts import Section
from rig.report.style import Plot
from rig.report.verdict_section import answer_sections

Array = NDArray[np.float64]

P = 12
POSITION = np.tile([1.0, -1.0, 0.0, 0.5], 3)  # of three stimuli, not in order
RATE = np.linspace(0, 60, P)
WAVE = np.tile([1.0, -2.0, 1.0, -0.5], 3)


def pair(
    name: str,
    deviance: float,
    p_fit: float = 0.0,
    p_set: float = 0.0,
    *,
    receptor_mm: float | None = -1.0,
    residual: Array = WAVE,
    control: bool = False,
) -> PairRow:
    limits = ((1.5, 2.5), (-1.0, np.nan))
    numbers = (0.9, 0.8, deviance, deviance / 10, p_fit, p_set, 0.75)
    eps = np.full(P, np.nan) if receptor_mm is None else RATE / 100
    return PairRow(name, control, receptor_mm, 2.0, -0.5, 0.0, *limits, *numbers, eps, RATE + residual, residual)


BEST = pair("ep1", 10.0, 0.5, 1.0)
TWIN = pair("ep1", 11.0, 0.4, 0.3, receptor_mm=-1.25)
FITS = pair("sed", 13.0, 0.2, 0.01, residual=np.select([np.arange(P) == 7, np.arange(P) == 3], [9.0, -2.1]))
WRONG = pair("e13", 30.0, 0.0004, 0.01)
CONTROL = pair("skin pressure", 21.0, 0.001, 0.02, control=True)
CONSTANT = pair("a constant rate", 90.0, receptor_mm=None, control=True)
ROWS = (BEST, TWIN, FITS, CONTROL, WRONG, CONSTANT)
TITLES = ("step:1 at 8 gwt", "step:3 at 8 gwt", "step:5 at 8 gwt")


def answer(*rows: PairRow, stimuli: tuple[str, ...] = TITLES, title: str = "a") -> AfferentVerdict:
    which = np.repeat(np.arange(3), 4)
    places = FittedPositions(which, POSITION, RATE, np.full(P, 3.0))
    separate = tuple(Separate(one, 2.0 + k, 0.1, 0.5) for k, one in enumerate(stimuli))
    return AfferentVerdict(
        title,
        stimuli,
        ("a.csv", "b.csv", "c.csv"),
        places,
        14,
        (LeftOut(stimuli[0], (2.0, 3.0), (7.0, 8.0)),),
        RecordingNoise("counts", "repeats", 1.1, 48.0),
        0.97,
        "repeats",
        rows,
        Together((4, 48), 0.31, 0.87, separate),
        Power(0.05, (Mimic("skin pressure", "s33 at 0 mm", 0.42),)),
    )


def sections(*found: AfferentVerdict) -> dict[str, Section]:
    made = answer_sections(found, "no offset fitted", recorded=True)
    assert len({one.title for one in made}) == len(made)
    return {one.title: one for one in made}


def drawn(plot: Plot) -> Canvas:
    canvas = Canvas(figsize=plot.size, layout=plot.layout)
    plot.draw(canvas)
    canvas.draw_without_rendering()
    return canvas


def test_residuals_are_drawn_and_told() -> None:
    section = sections(answer(*ROWS))["Residuals by position"]
    assert "(|r| below 0.67 here)" in section.text  # 9 neighbours
    assert "9 (0.5 mm under step:3 at 8 gwt), 2 of 12" in section.points[1]
    assert section.points[1].endswith(" r = 0.")
    # in order of position −2, 1, −0.5, 1: products −2, −0.5, −0.5 of squares 6.25
    assert section.points[0].endswith("0 of 12 exceed two, and neighbors have r = −0.48.")
    axes = drawn(section.figures[0].plot).axes[4]  # second row, second stimulus
    (stems,) = (c for c in axes.collections if isinstance(c, LineCollection))
    ends = [tuple(path.vertices[1]) for path in stems.get_paths()]
    assert ends == [(-1.0, 0.0), (0.0, 0.0), (0.5, 9.0), (1.0, 0.0)]


def test_the_set_comes_first_in_the_table() -> None:
    section = sections(answer(*ROWS))["Fits to the recording"]
    rows = [dict(zip(section.header[:3], row, strict=False)) for row in section.rows]
    assert [(row["pair"], row["in the set"]) for row in rows] == [
        ("ep1 at −1 mm", "yes"), ("ep1 at −1.25 mm", "yes"), ("sed at −1 mm", "no"),
        ("skin pressure at −1 mm (control)", "no"), ("e13 at −1 mm", "no"), ("a constant rate (control)", "no"),
    ]  # fmt: skip
    assert section.rows[4][2:] == (
        "3", "< 0.001", "0.01", "75 %", "2 [1.5,\N{NO-BREAK SPACE}2.5]", "−0.5 [−1,\N{NO-BREAK SPACE}–]", "0.8",
        "fires without load",
    )  # fmt: skip
    assert section.points == (
        "ep1, over all receptors of the set: k in [1.5,\N{NO-BREAK SPACE}2.5], ε₀ in [−1,\N{NO-BREAK SPACE}–].",
    )
    assert "over the same 12 positions" in section.text
    assert "for this finger (--fingers" in section.text
    assert (
        "fitted with each pair, among 9 fingers of the stated ranges"
        in sections(replace(answer(*ROWS), fingers=9))[section.title].text
    )
