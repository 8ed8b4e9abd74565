"""The parts of a comparison's report that do without figures of their own: what is written in them."""

from collections.abc import Callable

import numpy as np
import pytest
from matplotlib.figure import Figure

from rig.compare.comparison import Comparison, compare
from rig.compare.recordings.recording import Recording, recording
from rig.compare.stimuli import StimulusRow
from rig.report.comparison_report import WHAT, measures_section, shape_sections
from rig.report.page_parts import PageFigure, Section, alone, render
from rig.report.recording_sections import source_section, table_5_1
from rig.report.style import Plot, label, some_of
from sim.measures.measures import MEASURES, PLOTTED_AS_MAGNITUDE

X = np.linspace(-4, 3, 25)
RECEPTORS = np.array([-1.0, 0.0, 1.0])
STEP = np.exp(-((X[:, None] - RECEPTORS) ** 2)) - 0.4 * np.exp(-((X[:, None] - RECEPTORS + 2) ** 2)) + 0.5
BAR = np.exp(-((X[:, None] - RECEPTORS - 1) ** 2)) + np.exp(-((X[:, None] - RECEPTORS + 1) ** 2))
PLOT = Plot((1.0, 1.0), lambda figure: None, layout=None)

Make = Callable[..., StimulusRow]


def measured(factor: float = 50.0, name: str = "mine.csv") -> Recording:
    """Rates that rise with the step's profile at the receptor −1, in straight lines."""
    places = np.linspace(-1.5, 1.5, 16)
    eps = np.interp(places - 1.0, X, STEP[:, 0])
    return recording(name, [(float(x), factor * float(e), 1.0) for x, e in zip(places, eps, strict=True)])


@pytest.fixture
def steps(make_stimulus: Make) -> list[StimulusRow]:
    """The source's steps at 8 gwt; ep1 has the recorded form, ep3 and s22 rise with it, SED is flat."""
    return [
        make_stimulus(
            f"step:{n}", X, RECEPTORS, {"ep1": STEP, "ep3": STEP**2, "s22": 3 * STEP}, commanded=8.0, run=f"r{n}"
        )
        for n in "135"
    ]


def test_every_measure_is_defined_with_unit_sign_and_range(steps: list[StimulusRow]) -> None:
    assert set(WHAT) == set(MEASURES)
    assert len(set(WHAT.values())) == len(MEASURES)
    section = measures_section(compare(steps, {}), young_mpa=0.2)
    assert "one pseudo-unit is 2e−05 MPa here" in section.text
    rows = {row[0]: dict(zip(section.header, row, strict=True)) for row in section.rows}
    assert list(rows) == list(MEASURES)
    for name, row in rows.items():
        turned = name in PLOTTED_AS_MAGNITUDE
        assert row["plotted as"] == f"{label(name)}, {'as magnitude' if turned else 'unchanged'}"
        assert row["share with the other sign"] == ("0 %" if turned else "")
    assert rows["ep1"]["range as plotted"] == f"{STEP.min():.3g} … {STEP.max():.3g}"
    assert (rows["ep1"]["unit"], rows["third"]["unit"]) == ("strain", "pseudo-units³")


def test_what_is_of_the_other_sign_is_counted(make_stimulus: Make) -> None:
    profile = np.where(np.arange(25) < 5, -1.0, 1.0)[:, None] * np.ones(3)
    section = measures_section(compare([make_stimulus("step:1", X, RECEPTORS, {"sp1": profile})], {}), 0.2)
    assert next(row for row in section.rows if row[0] == "sp1")[-1] == "20 %"


def test_the_page_says_which_file_fills_which_figure(steps: list[StimulusRow]) -> None:
    section = source_section(compare(steps[:2], {"step:1": measured()}))
    here = {row[0]: row[3] for row in section.rows}
    assert list(here) == ["Fig. 5-8", "Fig. 5-9", "Fig. 5-12", "Fig. 5-13", "Table 5.1"]
    assert here["Fig. 5-8"] == here["Fig. 5-9"]
    assert here["Fig. 5-8"] == (
        "empty: give --recorded step:3=FILE, --recorded step:5=FILE, a run of step:5 at 8 gwt"
    )
    assert here["Fig. 5-12"] == (
        "empty: give --recorded bar:1.5=FILE, --recorded bar:3=FILE, a run of bar:1.5 at 1 mm, a run of bar:3 at 1 mm"
    )
    assert here["Table 5.1"] == "partly filled"
    assert section.rows[0][2] == "step:1, step:3, step:5 at 8 gwt (Srinivasan & LaMotte 1987)"
    assert section.rows[2][2] == "bar:1.5, bar:3 at 1 mm (Phillips & Johnson 1981)"
    assert not section.figures
    assert not table_5_1(compare(steps[:2], {"step:1": measured()})).rows


def test_another_force_does_not_fill_a_figure(make_stimulus: Make) -> None:
    light = [make_stimulus(f"step:{n}", X, RECEPTORS, {"ep1": STEP}, run=f"r{n}") for n in "135"]
    section = source_section(compare(light, {s.shape: measured() for s in light}))
    assert section.rows[0][3].endswith("a run of step:1 at 8 gwt, a run of step:3 at 8 gwt, a run of step:5 at 8 gwt")
    assert section.rows[-1][3] == "empty"
    assert not section.figures


def all_recorded(steps: list[StimulusRow], make_stimulus: Make) -> Comparison:
    bars = [
        make_stimulus(
            f"bar:{w}", X, RECEPTORS, {"ep1": BAR, "ep3": BAR**2}, kind="doi_mm", commanded=1.0, run=f"b{w}"
        )
        for w in ("1.5", "3.0")
    ]
    files = {s.shape: measured(50.0, f"{s.shape[-1]}.csv") for s in (*steps, *bars)}
    return compare([*steps, *bars], files)


def test_recordings_fill_figures_and_table(steps: list[StimulusRow], make_stimulus: Make) -> None:
    comparison = all_recorded(steps, make_stimulus)
    section = source_section(comparison)
    assert {row[3] for row in section.rows} == {"filled: 1.csv, 3.csv, 5.csv", "filled: 5.csv, 3.csv", "filled"}
    assert [figure.title.partition(" of")[0] for figure in section.figures] == [
        "Fig. 5-8", "Fig. 5-9", "Fig. 5-12", "Fig. 5-13",
    ]  # fmt: skip
    table = table_5_1(comparison)
    first = dict(zip(table.header, table.rows[0], strict=True))
    assert first == {
        "recordings": "step:1, step:3, step:5 at 8 gwt", "measure": "−ep1", "receptor (mm)": "−1.00",
        "r for each shape": "1  1  1", "k": "50", "ε₀": first["ε₀"], "R²": "1",
    }  # fmt: skip
    assert abs(float(first["ε₀"].replace("−", "-"))) < 1e-9
    assert [(row[0][:4], row[1], row[2]) for row in table.rows] == [
        ("step", "−ep1", "−1.00"), ("step", "ep3", "−1.00"), ("bar:", "−ep1", "0.00"), ("bar:", "ep3", "0.00"),
    ]  # fmt: skip
    assert float(table.rows[1][6]) < 1


def test_the_shape_test_is_a_section_of_its_own(steps: list[StimulusRow]) -> None:
    drawn = PageFigure("SSRPs", PLOT, "")
    test, thresholds, collinear = shape_sections(compare(steps, {}), [drawn])
    assert test.title == "The shape test: a property of the simulation"
    assert "does not use the recordings" in test.text
    assert "Candidates: ep1, ep3, s22." in test.text
    assert "at a threshold of 5 %" in test.text
    assert test.figures == (drawn,)
    assert test.header == ("measure", "candidate", "step:1 at 8 gwt", "step:3 at 8 gwt", "step:5 at 8 gwt")
    rows = {row[0]: row[1:] for row in test.rows}
    assert rows["ep1"] == ("yes", "−1 0 1", "−1 0 1", "−1 0 1")
    assert rows["sed"] == ("no", "–", "–", "–")
    assert not test.points  # one condition
    assert thresholds.rows[2] == ("5 %", "9", "9", "9", "ep1, ep3, s22")
    assert "18 measures × 3 receptors" in thresholds.text
    assert collinear.points == ("step:1, step:3, step:5 at 8 gwt: ep1 = s22",)
    assert "|r| ≥ 0.98" in collinear.text


def test_what_chance_passes_is_said_beside_the_verdicts(
    steps: list[StimulusRow], make_stimulus: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = [
        {"shape": "step:1", "condition": "8 gwt", "passes_by_chance": 0.0651},
        {"shape": "step:3", "condition": "8 gwt", "passes_by_chance": None},
        {"shape": "step:5", "condition": "8 gwt", "passes_by_chance": 0.11},
    ]
    monkeypatch.setattr("rig.report.comparison_report.chance_rows", lambda _: found)
    text = shape_sections(compare(steps, {}), [])[0].text
    assert "Of 1000 random profiles" in text
    assert text.endswith("step:1 at 8 gwt 7 %, step:5 at 8 gwt 11 %.")
    monkeypatch.undo()
    flat = shape_sections(compare([make_stimulus("step:1", X, RECEPTORS, {})], {}), [])[0]
    assert "random profiles" not in flat.text


def test_conditions_are_listed_where_there_are_several(steps: list[StimulusRow], make_stimulus: Make) -> None:
    other = make_stimulus("step:1", X, RECEPTORS, {"ep1": STEP}, run="light")
    test = shape_sections(compare([*steps, other], {}), [])[0]
    assert test.points == ("step:1 at 2.33 gwt: ep1", "step:1, step:3, step:5 at 8 gwt: ep1, ep3, s22")


def test_without_a_shape_test_its_section_says_so(make_stimulus: Make) -> None:
    drawn = PageFigure("SSRPs", PLOT, "")
    profiles = {"ep1": X[:, None] * np.ones(3), "ep3": (X**2)[:, None] * np.ones(3)}
    (only,) = shape_sections(compare([make_stimulus("cylinder:3", X, RECEPTORS, profiles)], {}), [drawn])
    assert "No test is defined for these indentors or schedules" in only.text
    assert (only.rows, only.figures) == ((), (drawn,))


def test_a_section_on_a_page() -> None:
    figure = PageFigure("A", PLOT, "Below.")
    table = Section("T", "one\n\ntwo", ("h",), (("c",),), (figure,), points=("p <",))
    words = {
        "title": "t",
        "about": "",
        "small_strain": "as far as small strain goes",
        "provenance": {"command": "c", "draws": 1, "nodes": 1, "e_epidermis_mpa": 1.0, "versions": {}},
    }
    page = render("sections.html.j2", sections=[table, alone(figure)], **words)
    assert "<p>one</p>\n<p>two</p>" in page
    assert "(as far as small strain goes)" in page
    assert "<li>p &lt;</li>" in page
    assert '<th class="text">h</th>' in page
    assert '<td class="text">c</td>' in page
    assert "<figcaption>A. Below.</figcaption>" in page  # among others
    assert "<figcaption>Below.</figcaption>" in page  # under its own heading
    assert page.count("<p></p>") == 0


@pytest.mark.parametrize(
    ("n", "most", "written"), [(3, 9, [0, 1, 2]), (9, 9, list(range(9))), (5, 3, [0, 2, 4]), (1, 4, [0])]
)
def test_ticks_are_spread_where_there_is_no_room_for_all(n: int, most: int, written: list[int]) -> None:
    assert some_of(n, most) == written


def test_a_figure_has_the_same_bytes_each_time() -> None:
    """Its clips and markers have names in SVG, and files have dates."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.contour([[0.0, 1.0], [1.0, 3.0]])
        axes.plot([0.0, 1.0], [0.0, 1.0], "o-")

    one, other = Plot((3.0, 2.0), draw), Plot((3.0, 2.0), draw)
    assert one.svg == other.svg
    assert one.png == other.png
    assert b"Software" not in one.png
    assert "<dc:date>" not in one.svg
