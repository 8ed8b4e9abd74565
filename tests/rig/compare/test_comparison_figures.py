"""The figures of a report at print size: what an A4 page cannot hold at full size would shrink with its letters."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from matplotlib.figure import Figure as Canvas
from matplotlib.text import Text

from rig.compare.comparison import Comparison, compare
from rig.compare.recordings.recorded import recording
from rig.compare.stimuli import Stimulus
from rig.compare.stimulus_maps import StimulusMap
from rig.report.comparison.comparison_figures import comparison_figures
from rig.report.html import Figure
from rig.report.style import PAGE_IN, position_bar, shade, shade_of
from sim.measures.receptors import DEFAULT_X_MM

LEAST_POINTS = 6.5
X = np.linspace(-4, 3, 25)
MEASURES_SHOWN = ("ep1", "ep3", "sed")


@pytest.fixture
def comparison(make_stimulus: Callable[..., Stimulus]) -> Comparison:
    """Steps and bars at two forces or depths each, ten receptors, every one recorded."""
    receptors = np.array(DEFAULT_X_MM)
    profile = np.exp(-((X[:, None] - receptors) ** 2)) - 0.4 * np.exp(-((X[:, None] - receptors + 2) ** 2)) + 0.5
    conditions = (("step", ("1", "3", "5"), "force_gwt", (2.33, 8.0)), ("bar", ("1.5", "3.0"), "doi_mm", (1.0,)))
    stimuli = [
        make_stimulus(
            f"{family}:{which}", X, receptors, dict.fromkeys(MEASURES_SHOWN, commanded * profile),
            kind=kind, commanded=commanded,
        )
        for family, shapes, kind, values in conditions for commanded in values for which in shapes
    ]  # fmt: skip
    stimuli += [
        make_stimulus("bar:3.0", X, receptors, {"ep1": profile}, kind="doi_mm", commanded=0.1 * k) for k in (1, 2)
    ]
    rows = [(float(x), 40.0 + 20.0 * float(np.cos(x)), 5.0) for x in np.linspace(-1.5, 1.5, 16)]
    recorded = {stimulus.shape: recording("made.csv", rows) for stimulus in stimuli[:3]}
    return compare(stimuli, recorded)


@pytest.fixture
def section(comparison: Comparison) -> StimulusMap:
    corners = np.stack(np.meshgrid(np.linspace(-3, 3, 7), np.linspace(5, 2, 4), indexing="ij"), axis=-1)
    values = np.linspace(0, 1, 18).reshape(6, 3)
    return StimulusMap(comparison.stimuli[0], 0.5, corners, np.array([[0.0, 4.0]]), {"sed": values, "ep1": values})


def drawn(figure: Figure) -> Canvas:
    canvas = Canvas(figsize=figure.plot.size, layout="constrained")
    figure.plot.draw(canvas)
    canvas.draw_without_rendering()
    return canvas


def written(canvas: Canvas) -> Iterator[Text]:
    texts: list[Text] = canvas.findobj(Text)
    yield from (text for text in texts if text.get_text().strip() and text.get_visible())


def test_every_figure_is_printed_at_its_own_size_and_can_be_read(
    comparison: Comparison, section: StimulusMap
) -> None:
    found = comparison_figures(comparison, [section] * 3)
    titles = [figure.title for figure in found]
    assert len(set(titles)) == len(titles)
    kinds = ("Recorded over", "Rate against", "Correlation", "SSRPs", "Population", "Pressure", "Strain under")
    for figure in found:
        width, height = figure.plot.size
        assert width <= PAGE_IN[0], figure.title
        assert height <= PAGE_IN[1], figure.title
    for figure in (next(figure for figure in found if figure.title.startswith(kind)) for kind in kinds):
        width, height = figure.plot.size
        canvas = drawn(figure)
        assert min(text.get_fontsize() for text in written(canvas)) >= LEAST_POINTS, figure.title
        ink = canvas.get_tightbbox()  # in inches
        assert min(ink.x0, ink.y0) >= 0, f"{figure.title} is cut off"
        assert (ink.x1 <= width) & (ink.y1 <= height), f"{figure.title} is cut off"


def test_more_panels_than_a_page_holds_are_several_figures(comparison: Comparison) -> None:
    assert len(comparison.judged) == 10
    titles = [figure.title for figure in comparison_figures(comparison, [])]
    assert [title for title in titles if title.startswith("Correlation")] == [
        f"Correlation and shape test, 18 measures × receptors, {k} of 2" for k in (1, 2)
    ]
    assert [title for title in titles if title.startswith("Pressure")] == [
        f"Pressure and contact regions along the schedules, {k} of 2" for k in (1, 2)
    ]


def test_colours_by_rank_tell_close_positions_apart() -> None:
    positions = [-3.7, -1.02, -0.85, -0.68, 2.0]
    found = [shade_of(x, positions) for x in positions]
    assert found == [shade(k, 5) for k in range(5)]
    grey = [0.299 * r + 0.587 * g + 0.114 * b for r, g, b, _ in found]
    assert min(np.diff(grey)) > 0.1  # in print without colours, too
    canvas = Canvas(layout="constrained")
    position_bar(canvas, canvas.subplots(), positions)
    assert [text.get_text() for text in canvas.axes[1].get_yticklabels()] == [
        "−3.70", "−1.02", "−0.85", "−0.68", "2.00",
    ]  # fmt: skip
