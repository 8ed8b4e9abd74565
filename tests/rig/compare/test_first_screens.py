"""Pages of comparison, group, nerve, identification, design and benchmark: the message first, one color a measure."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from html import unescape
from itertools import combinations
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from rig.compare.make_verdict import answers
from rig.compare.verdict_text import sentences
from rig.data import Run
from rig.data.spike_files import SpikeRecord, SpikeTrain
from rig.design.design import Design
from rig.design.design_text import bound_name, headline, history_line, separation_line
from rig.report import profile_figures, verdict_figures
from rig.report.measure_colors import color_of
from rig.report.nerve_figures import nerve_figures, no_spikes_drawn, pressed, rate_panels
from rig.report.run_report import write_report
from sim.measures.measures import MEASURES
from sim.models.fingertip import Fingertip
from tests.empty_figures import draw_nothing
from tests.rig.compare.pages import (
    PAGES,
    RATE,
    Made,
    adaptive,
    made_comparison,
    made_design,
    of_comparison,
    whole_design,
)

Make = Callable[..., Any]


@pytest.fixture(scope="module")
def made(bar_run: Run, finger: Fingertip, make_stimulus: Make, tmp_path_factory: pytest.TempPathFactory) -> Make:
    folder = tmp_path_factory.mktemp("pages")
    known: dict[str, Made] = {}

    def page(name: str) -> Made:
        if name not in known:
            with pytest.MonkeyPatch.context() as patch:
                draw_nothing(patch)
                known[name] = PAGES[name](folder / "page.html", bar_run, finger, make_stimulus)
        return known[name]

    return page


# --- the first screen ---

MOST_WORDS = 75
"""A sentence of two phases with their intervals has as many; a paragraph has more."""


def first_section(html: str) -> str:
    """What follows the first heading, up to the list of sections or the next heading."""
    return re.split(r"<nav>|<h2", html.split("</h2>", 1)[1], maxsplit=1)[0]


@pytest.mark.parametrize("name", PAGES)
def test_the_first_section_is_a_sentence_and_a_figure(name: str, made: Make) -> None:
    first = first_section(made(name).html)
    assert re.findall(r"<(p|ul|table|figure)\b", first) == ["p", "figure"]
    words = in_words(first.split("<figure", 1)[0])
    assert words.endswith(".")
    assert len(words.split()) <= MOST_WORDS


@pytest.mark.parametrize(
    ("name", "begins"),
    [
        ("comparison without a recording", "No recording was given"),
        ("deflection", "The measured deflection of the skin differs from the simulated one by "),
    ],
)
def test_a_page_without_a_verdict_begins_with_what_it_has(name: str, begins: str, made: Make) -> None:
    assert in_words(first_section(made(name).html)).startswith(begins)


@pytest.mark.parametrize("name", PAGES)
def test_the_first_section_comes_before_any_list_of_sections(name: str, made: Make) -> None:
    html = made(name).html
    assert "<nav>" not in html.split("</figure>", 1)[0]


@pytest.mark.usefixtures("empty_figures")
def test_a_recording_without_spikes_is_a_sentence_alone(
    tmp_path: Path, bar_run: Run, finger: Fingertip, make_stimulus: Make
) -> None:
    """Nothing was compared, so there is nothing to plot."""
    page = of_comparison(0.0 * RATE)(tmp_path / "page.html", bar_run, finger, make_stimulus)
    first = first_section(page.html)
    assert re.findall(r"<(p|ul|table|figure)\b", first) == ["p"]
    assert "the recorded rate is 0 at every position" in first


@pytest.mark.usefixtures("empty_figures")
def test_an_adaptive_run_begins_with_its_verdict(tmp_path: Path, bar_run: Run, finger: Fingertip) -> None:
    folder = replace(bar_run.folder, path=copytree(bar_run.folder.path, tmp_path / "run"))
    page = write_report(replace(adaptive(bar_run), folder=folder), finger).read_text(encoding="utf-8")
    assert page.index('class="message"') < page.index('id="verdict"') < page.index("<figure")
    assert "of at most 6 indentations" in in_words(page)


# --- where it comes from ---


@pytest.mark.parametrize("name", PAGES)
def test_each_page_names_its_day_runs_and_version_and_what_is_virtual(name: str, made: Make) -> None:
    page = made(name)
    source = in_words(page.html.split('<p class="sub">', 1)[1].split("</p>", 1)[0])
    assert re.match(r"\d{4}-\d\d-\d\d · ", source)
    assert re.search(r"· indentation-rig \d", source)
    assert "virtual" in source
    assert all(run in source for run in page.runs)
    assert page.runs or "no run" in source


# --- one color a measure, one rule for best ---


def test_no_two_measures_share_a_color_and_each_is_seen_on_white() -> None:
    """WCAG asks for a contrast of 3 between a line and its background."""
    for a, b in combinations(MEASURES, 2):
        assert color_of(a) != color_of(b)
    for name in MEASURES:
        assert color_of(f"mean rate of {name}") == color_of(f"peak rate of {name}") == color_of(name)
        assert 1.05 / (_luminance(color_of(name)) + 0.05) >= 3.0, name


def _luminance(color: str) -> float:
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(color)]
    return float(np.dot((0.2126, 0.7152, 0.0722), linear))


def test_the_control_of_the_words_is_that_of_the_figure(make_stimulus: Make) -> None:
    (answer,) = answers(made_comparison(make_stimulus))
    drawn = verdict_figures.plotted_pairs(answer)[-1]
    assert drawn.control
    assert any(f"control, {drawn.title}, predicts" in one for one in sentences(answer))


# --- counts ---


def test_a_design_says_as_many_presses_as_its_table_lists(made: Make) -> None:
    """Three presses, two of which differ: two rows whose repeats sum to three, in headline and text."""
    html = made("design").html
    rows = table(html, "The presses")
    assert len(rows) == 2
    assert sum(int(row[3]) for row in rows) == 3
    text = in_words(html)
    assert "3 presses in 10 minutes fail" in text
    assert "3 presses in 10 minutes, of which 2 differ: 3 with bar:3.0" in text
    last = table(html, "Beside other designs")[-1]
    assert last[0] == "as many of the 3 possible presses as fit (2)"
    assert last[2] == "2"
    assert "all 3 possible" not in text
    assert "ll presses in" not in text


def test_an_identification_says_as_many_presses_and_forces_as_its_tables_list(made: Make) -> None:
    html = made("identification").html
    assert "explains 1 of 1 press within" in in_words(first_section(html))
    assert len(table(html, "Presses")) == 1
    assert len(table(html, "Known forces")) == 1


def test_a_group_says_as_many_afferents_as_its_table_lists(made: Make) -> None:
    """Three were compared and one was left out."""
    html = made("group").html
    assert "Which measure explains 3 afferents?" in html
    rows = table(html, "Verdict on each afferent")
    assert len(rows) == 4
    assert sum(row[1].startswith("Left out") for row in rows) == 1
    assert "Left out of 4 afferents: a9." in in_words(html)


def in_words(html: str) -> str:
    """Text of a part of a page."""
    return " ".join(
        unescape(re.sub(r"<[^>]*>", " ", re.sub(r"<(style|script).*?</\1>", " ", html, flags=re.S))).split()
    )


def table(html: str, title: str) -> list[list[str]]:
    """Cells of the first table below a heading."""
    below = re.split(rf"<h2[^>]*>{title}</h2>", html)[1].split("</table>", 1)[0]
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", row, flags=re.S) for row in below.split("<tr>")]
    return [[in_words(cell) for cell in row] for row in rows if row]


# --- words follow their number ---


@pytest.mark.parametrize(
    ("r", "words"),
    [(0.05, "hardly depend"), (0.25, "depend weakly"), (0.5, "depend moderately"), (0.99, "depend strongly")],
)
def test_the_words_on_dependence_follow_r(r: float, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Design, "dependence", r)
    monkeypatch.setattr(Design, "imbalance", 1.0)
    line = history_line(whole_design())
    assert f"{words} on the press before (|r| up to {r:.2f})" in line
    assert "little" not in line


@pytest.mark.parametrize(
    ("designed", "usual", "words"),
    [
        (5, 60, "so the choice of presses helps"),
        (30, 33, "so this simulation shows no gain from the choice of presses"),
        (60, 5, "so this usual design is the better one"),
    ],
)
def test_the_headline_says_whether_the_design_helps(designed: int, usual: int, words: str) -> None:
    """Of 100 experiments, so many fail; the standard errors are at most 5 of 100."""

    def failing(name: str, number: int) -> Any:
        one = replace(made_design().outcomes[0], name=name, minutes=10.0)
        truth = np.zeros(100, dtype=np.int64)
        evidence = 9.0 * np.eye(3)[np.where(np.arange(100) < number, 1, 0)]
        return replace(one, truth=truth, log_evidence=evidence, effective=np.full(100, 8.0))

    found = whole_design(outcomes=(failing("designed", designed), failing("random presses", usual)))
    assert headline(found).endswith(f"{words}.")


def test_an_hour_of_all_presses_is_called_so_only_if_all_fit() -> None:
    found = whole_design()
    assert bound_name(found) == "as many of the 3 possible presses as fit (2)"
    everything = replace(found, bound=replace(found.bound, presses=6, different=3))
    assert bound_name(everything) == "all 3 possible presses"
    assert "all 3 possible presses in 60 minutes" in separation_line(everything).lower()


# --- nothing fired ---


def _trains(run: Run, firing: Sequence[str]) -> SpikeRecord:
    """Afferents of three classes; those named fire five times in each last hold, and never before it."""
    times = np.sort([one.hold_s + 0.02 * k for one in pressed(run) for k in range(1, 6)])
    trains = tuple(
        SpikeTrain(f"{model}-{n}", model, 0.0, 0.0, 0.76, 1.0, 0.0, times if model in firing else np.zeros(0))
        for model in ("SA1", "RA", "PC")
        for n in (1, 2)
    )
    return SpikeRecord(trains, 0, 0.2)


def test_the_mean_of_a_class_counts_its_silent_afferents(bar_run: Run) -> None:
    """One of two afferents fires in each hold: the mean is half of its rate."""
    record = _trains(bar_run, ("SA1",))
    first, second, *others = record.trains
    record = replace(record, trains=(first, replace(second, spike_s=np.zeros(0)), *others))
    (panel,) = [one for one in rate_panels(record, pressed(bar_run)) if one.fired]
    assert panel.rates.mean(axis=0) == pytest.approx(panel.rates[0] / 2)


def test_where_nothing_fired_there_is_a_sentence_and_no_figure(bar_run: Run) -> None:
    record = _trains(bar_run, ())
    assert nerve_figures(bar_run, record) == []
    assert no_spikes_drawn(bar_run, record) == "None of 6 simulated afferents fired in 6 presses."
    assert no_spikes_drawn(bar_run, _trains(bar_run, ("SA1",))) == ""


def test_spikes_of_a_part_of_the_run_are_not_drawn(bar_run: Run) -> None:
    """A resumed run went on after `rig nerve`."""
    record = replace(_trains(bar_run, ("SA1",)), until_s=bar_run.end_s - 30.0)
    assert "repeat rig nerve" in no_spikes_drawn(bar_run, record)
    assert no_spikes_drawn(bar_run, replace(record, until_s=bar_run.end_s)) == ""


def test_only_what_fired_is_drawn_and_the_rest_is_said(bar_run: Run) -> None:
    record = _trains(bar_run, ("SA1",))
    figures = {one.title: one for one in nerve_figures(bar_run, record)}
    assert (
        "4 of 6 simulated afferents never fired and have no rows: 2 of 2 RA, 2 of 2 PC."
        in figures["Simulated spikes"].caption
    )
    panels = rate_panels(record, pressed(bar_run))
    assert [one.title.split("\n")[0] for one in panels if one.fired] == ["SA1, hold"]
    against = figures["Simulated rate against position"]
    assert "No spike, and no panel: SA1, press, bar:3.0 to 0.4 mm; RA, press, " in against.caption
    figure = Figure(figsize=against.size, layout=against.layout)
    against.draw(figure)
    (axes,) = figure.axes
    assert axes.get_ylim()[1] < 1.2 * max(one.rates.max() for one in panels)


# --- long names ---

LONG = "heightmap:braille_dots_of_the_second_print.png,width_mm=3,height_mm=0.5,turn_deg=30"


def test_titles_of_height_maps_do_not_overlap(make_stimulus: Make) -> None:
    """Neither each other nor the panel of a neighbor, in any figure that names stimuli above its panels."""
    comparison = made_comparison(make_stimulus)
    (answer,) = answers(comparison)
    names = tuple(f"{LONG} at {k} gwt" for k in (1, 2, 4))
    left_out = tuple(one._replace(stimulus=name) for one, name in zip(answer.left_out, names, strict=True))
    answer = replace(answer, stimuli=names, left_out=left_out)
    stimuli = [replace(one, indentor=LONG) for one in comparison.stimuli]
    plots = [
        verdict_figures.the_answer(answer, (0, 1, 2), ""),
        verdict_figures.profiles(answer, (0, 1, 2), ""),
        verdict_figures.residuals(answer, (0, 1, 2), ""),
        profile_figures.pressure_maps(stimuli),
    ]
    for plot in plots:
        figure = Figure(figsize=plot.size, layout=plot.layout)
        plot.draw(figure)
        figure.draw_without_rendering()
        titles = [axes.title for axes in figure.axes if axes.get_title()]
        boxes = [title.get_window_extent() for title in titles]
        assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
        panels = [axes.get_window_extent() for axes in figure.axes if axes.axison]
        assert not any(box.overlaps(panel) for box in boxes for panel in panels)
