"""What the page says of an answer: every figure and sentence follows from its rows."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure as Canvas
from matplotlib.image import AxesImage
from matplotlib.text import Text
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
from rig.compare.verdict_text import methods, sentence, sentences
from rig.report import verdict_figures
from rig.report.measure_colors import color_of
from rig.report.page_parts import Section
from rig.report.style import GREY, PAGE_IN, Plot
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


def words(canvas: Canvas) -> list[str]:
    return [text.get_text() for text in canvas.findobj(Text) if text.get_text()]


def test_first_comes_one_sentence_and_one_figure() -> None:
    found = answer(*ROWS)
    made = answer_sections([found], "", recorded=True)
    assert [one.title for one in made] == [
        "Verdicts", "Details, and what would change the answer", "Recorded over predicted",
        "Residuals by position", "Fits to the recording", "Controls", "Joint and separate fits of one afferent",
        "Methods text for a paper",
    ]  # fmt: skip
    assert made[0].text == sentence(found)
    assert (len(made[0].figures), made[0].points, made[0].rows) == (1, (), ())
    assert made[-1].text == methods(found)


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (ROWS, "if a control entered the set"),
        ((BEST, replace(CONTROL, p_fit=0.5, p_set=0.5), FITS), "if the controls in the set were rejected"),
        ((CONTROL, FITS, WRONG), "if the noise were larger than estimated"),
    ],
)
def test_what_would_change_the_answer(rows: tuple[PairRow, ...], expected: str) -> None:
    found = answer(*rows)
    points = sections(found)["Details, and what would change the answer"].points
    assert points[: len(sentences(found))] == tuple(sentences(found))
    assert expected in points[-1]


def test_by_how_much_another_measure_is_worse_and_where_that_is_seen() -> None:
    """Of the set, or of those that are rejected where none explains it; else it is the next pair, told of already."""
    *_, by, where, _ = _points(answer(BEST, TWIN, replace(FITS, p_fit=0.5, p_set=0.5), CONTROL))
    assert "sed at −1 mm" in by
    assert "3 times the noise" in by
    # the seventh place: 9 + 0.5 apart, with a standard error of 3
    assert where.startswith("sed at −1 mm and ep1 at −1 mm differ most at 0.5 mm under step:3 at 8 gwt")
    assert f"{RATE[7] - 0.5:.3g} and {RATE[7] + 9:.3g}, 3.2 standard errors apart" in where
    assert not any("another measure" in point for point in _points(answer(*ROWS)))
    assert any("differ most at" in point for point in _points(answer(*ROWS)))


@pytest.mark.parametrize(
    ("rows", "kept"),
    [
        ((BEST, TWIN, replace(FITS, p_fit=0.5, p_set=0.5)), "also in the set."),
        ((BEST, replace(TWIN, p_set=0.0), FITS), "not in the set."),
        ((CONTROL, FITS, WRONG), "rejected by its own fit."),
    ],
)
def test_what_became_of_the_other_measure(rows: tuple[PairRow, ...], kept: str) -> None:
    assert any(point.endswith(f"and it is {kept}") for point in _points(answer(*rows)))


def _points(found: AfferentVerdict) -> tuple[str, ...]:
    return sections(found)["Details, and what would change the answer"].points


def test_with_one_measure_there_is_no_other() -> None:
    found = answer(BEST, TWIN)
    assert verdict_figures.rival(found) is None
    assert verdict_figures.apart(found) is None
    assert len(_points(found)) == len(sentences(found)) + 1
    assert verdict_figures.plotted_pairs(found) == [BEST]


def test_what_is_drawn() -> None:
    assert verdict_figures.plotted_pairs(answer(*ROWS)) == [BEST, FITS, CONTROL]
    in_set = replace(WRONG, p_fit=0.5, p_set=0.5)
    assert verdict_figures.rival(answer(BEST, FITS, in_set)) is in_set  # before what is likelier and outside
    assert verdict_figures.plotted_pairs(answer(FITS, WRONG, CONTROL)) == [
        FITS,
        WRONG,
        CONTROL,
    ]  # nothing explains it


def test_the_ranking_has_each_name_once_best_first() -> None:
    assert verdict_figures.ranking(answer(*ROWS)) == [BEST, FITS, CONTROL, WRONG, CONSTANT]
    many = [pair(f"m{k}", 10.0 + k) for k in range(9)] + [pair(f"c{k}", 50.0 - k, control=True) for k in range(5)]
    shown = verdict_figures.ranking(answer(*many))
    assert [row.name for row in shown] == ["m0", "m1", "m2", "m3", "m4", "m5", "m6", "c2", "c1", "c0"]


def test_the_first_figure_shows_rates_and_how_well_pairs_fit() -> None:
    canvas = drawn(verdict_figures.the_answer(answer(*ROWS), [0, 1, 2], "no offset fitted"))
    said = words(canvas)
    assert {"no offset fitted", *TITLES} <= set(said)
    fates = [text.partition(", predicts ")[0] for text in said if ", predicts " in text]
    assert fates == [
        "−ep1 at −1.00 mm: in the set",
        "SED at −1.00 mm: not rejected, but worse",
        "skin pressure (control) at −1.00 mm: rejected by its fit",
    ]
    assert {"skin pressure (control) at −1.00 mm", "a constant rate (control)", "p = 0.5", "p = 0.2"} <= set(said)
    assert {"p = 0.001", "p = 0.0004", "p < 0.0001"} <= set(said)
    panels = canvas.axes
    assert len(panels) == 4
    lines = [line for line in panels[1].lines if line.get_linestyle() in ("-", "--", ":")]
    at, predicted = lines[0].get_data()
    np.testing.assert_array_equal(at, [-1.0, 0.0, 0.5, 1.0])
    np.testing.assert_array_equal(predicted, (RATE + WAVE)[[5, 6, 7, 4]])
    crosses = [[line.get_xdata() for line in axes.lines if line.get_marker() == "x"] for axes in panels[:3]]
    assert [[list(x) for x in one] for one in crosses] == [[[2.0, 3.0]], [], []]
    marks = {round(float(line.get_xdata()[0]), 3): line for line in panels[3].lines if line.get_marker() in "osxX"}
    looks = {x: (line.get_marker(), line.get_mfc(), line.get_mec()) for x, line in marks.items()}
    ep1, sed, bad = (color_of(name) for name in ("ep1", "sed", "e13"))
    assert looks == {
        1.0: ("o", ep1, ep1), 1.3: ("o", "white", sed), 2.1: ("x", "white", GREY), 3.0: ("x", "white", bad),
        9.0: ("x", "white", GREY),
    }  # fmt: skip


def test_a_control_that_fits_is_filled_with_gray() -> None:
    control = replace(CONTROL, p_fit=0.5, p_set=0.5)
    canvas = drawn(verdict_figures.the_answer(answer(BEST, control), [0, 1, 2], ""))
    filled = [line.get_mfc() for line in canvas.axes[3].lines if line.get_marker() == "o"]
    assert filled == [color_of("ep1"), GREY]


def test_of_many_stimuli_the_first_figure_shows_those_that_tell_most() -> None:
    """Six of two places each; under 1, 3, 4 and 5 the two measures differ most."""
    apart = np.repeat([0.0, 5.0, 0.5, 9.0, 2.0, 3.0], 2)
    titles = tuple(f"bar:{k} at 1 mm" for k in range(6))
    found = answer(BEST, replace(FITS, predicted=BEST.predicted + apart), stimuli=titles)
    found = replace(found, places=found.places._replace(stimulus=np.repeat(np.arange(6), 2)))
    assert verdict_figures.most_telling(found) == [1, 3, 4, 5]
    assert verdict_figures.most_telling(answer(*ROWS)) == [0, 1, 2]
    made = sections(found)
    assert made["Verdicts"].figures[0].caption.startswith("The 4 of 6 ")
    assert made["Residuals by position"].figures[0].title == "Residuals by position, 1 of 2"
    over = made["Recorded over predicted"].figures
    assert [figure.title for figure in over] == [
        "Recorded over predicted, 1 of 2", "Recorded over predicted, 2 of 2", "Rate against measure",
    ]  # fmt: skip
    assert {"bar:4 at 1 mm\n−ep1 at −1.00 mm"} <= set(words(drawn(over[1].plot)))


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


def test_what_is_not_known_is_a_dash() -> None:
    nothing = (np.nan, np.nan)
    row = replace(BEST, k=np.nan, eps0=np.nan, r2=np.nan, k_interval=nothing, eps0_interval=nothing, left_out=np.nan)
    assert sections(answer(row))["Fits to the recording"].rows[0][5:] == ("–", "–", "–", "–", "")


def test_remarks_name_the_finger() -> None:
    row = replace(BEST, k=-2.0, finger={"finger.tissue.epidermis_mm": 0.35})
    assert sections(answer(row))["Fits to the recording"].rows[0][-1] == "k < 0, epidermis_mm 0.35"


def test_the_map_has_every_pair() -> None:
    section = sections(answer(*ROWS))["Fits to the recording"]
    canvas = drawn(section.figures[0].plot)
    axes = canvas.axes[0]
    (image,) = (one for one in axes.findobj(AxesImage))
    misfit = np.ma.filled(image.get_array(), np.nan)
    assert [text.get_text() for text in axes.get_yticklabels()] == [
        "−ep1",
        "SED",
        "e13",
        "skin pressure",
        "a constant rate",
    ]
    assert [text.get_text() for text in axes.get_xticklabels()] == ["−1.25", "−1.00"]
    expected = [[1.1, 1.0], [np.nan, 1.3], [np.nan, 3.0], [np.nan, 2.1], [9.0, 9.0]]
    np.testing.assert_allclose(misfit, expected)
    marks = {(float(x), float(y)): line.get_mfc() for line in axes.lines if line.get_marker() == "o"
             for x, y in zip(*line.get_data(), strict=True)}  # fmt: skip
    assert marks == {(1.0, 0.0): "black", (0.0, 0.0): "black", (1.0, 1.0): "none"}


def test_controls_are_judged_like_measures() -> None:
    section = sections(
        answer(CONTROL, *ROWS[:3], pair("skin pressure", 40.0, receptor_mm=1.0, control=True), CONSTANT)
    )
    rows = section["Controls"].rows
    assert [row[0] for row in rows] == ["skin pressure at −1 mm (control)", "a constant rate (control)"]
    assert section["Controls"].points == (
        "If the afferent followed skin pressure, s33 at 0 mm would imitate it best and be rejected with a "
        "probability of 0.42.",
    )


@pytest.mark.parametrize(("p", "expected"), [(0.87, "do not differ"), (0.049, "differ"), (0.05, "do not differ")])
def test_separate_fits_stand_beside_the_one(p: float, expected: str) -> None:
    found = answer(*ROWS)
    assert found.together is not None
    section = sections(replace(found, together=found.together._replace(p=p)))[
        "Joint and separate fits of one afferent"
    ]
    assert f"to each stimulus {expected} from the joint fit (F(4, 48) = 0.31, p = " in section.text
    assert section.rows[1] == ("step:3 at 8 gwt", "3", "0.1", "50 %")
    assert "Joint and separate fits of one afferent" not in sections(replace(found, together=None))


def test_several_afferents_are_told_apart_by_name() -> None:
    made = list(sections(answer(*ROWS, title="steps"), answer(*ROWS, title="bars")))
    assert (made[0], made[8]) == ("Verdicts: steps", "Verdicts: bars")


@pytest.mark.parametrize(
    ("recorded", "said"), [(True, "There is no verdict: the runs cover"), (False, "No recording was given")]
)
def test_without_an_answer(recorded: bool, said: str) -> None:
    (section,) = answer_sections([], "", recorded=recorded)
    assert section.title == "Verdicts"
    assert section.text.startswith(said)


def test_of_one_stimulus_pairs_are_side_by_side() -> None:
    found = answer(*ROWS, stimuli=TITLES[:1])
    found = replace(found, places=found.places._replace(stimulus=np.zeros(P, dtype=np.int64)))
    for section in ("Recorded over predicted", "Residuals by position"):
        panels = drawn(sections(found)[section].figures[0].plot).axes
        assert [axes.get_subplotspec().get_geometry()[:2] for axes in panels] == [(1, 3)] * 3
        assert [axes.get_title().partition("\n")[2] for axes in panels] == [
            "−ep1 at −1.00 mm", "SED at −1.00 mm", "skin pressure (control) at −1.00 mm",
        ]  # fmt: skip


def test_every_figure_of_an_answer_fits_a_page() -> None:
    for section in sections(answer(*ROWS)).values():
        for figure in section.figures:
            canvas = drawn(figure.plot)
            width, height = figure.plot.size
            assert (width <= PAGE_IN[0]) & (height <= PAGE_IN[1]), figure.title
            ink = canvas.get_tightbbox()
            assert min(ink.x0, ink.y0) >= -0.01, f"{figure.title} is cut off"
            assert (ink.x1 <= width + 0.01) & (ink.y1 <= height + 0.01), f"{figure.title} is cut off"
