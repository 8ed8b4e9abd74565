"""The figures of a report at print size: what an A4 page cannot hold at full size would shrink with its letters."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure as Canvas
from matplotlib.text import Text
from numpy.typing import NDArray

from rig.compare.comparison import Comparison, compare
from rig.compare.make_verdict import answers
from rig.compare.recordings.recording import recording
from rig.compare.stimuli import StimulusMap, StimulusRow
from rig.report.comparison_report import shape_figures, shown_measures, simulation_sections
from rig.report.page_parts import PageFigure
from rig.report.profile_figures import populations
from rig.report.recording_sections import source_section
from rig.report.style import position_scale, shade, shade_of
from rig.report.verdict_section import answer_sections
from sim.measures.receptors import DEFAULT_X_MM

X = np.linspace(-4, 3, 25)
MEASURES_SHOWN = ("ep1", "ep3", "sed")


@pytest.fixture(scope="module")
def comparison(make_stimulus: Callable[..., StimulusRow]) -> Comparison:
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


@pytest.fixture(scope="module")
def section(comparison: Comparison) -> StimulusMap:
    corners = np.stack(np.meshgrid(np.linspace(-3, 3, 7), np.linspace(5, 2, 4), indexing="ij"), axis=-1)
    values = np.linspace(0, 1, 18).reshape(6, 3)
    return StimulusMap(comparison.stimuli[0], 0.5, corners, np.array([[0.0, 4.0]]), {"sed": values, "ep1": values})


@pytest.fixture(scope="module")
def drawn_once() -> Callable[[PageFigure], Canvas]:
    """Draw a figure, or have it as another test drew it; their titles differ."""
    known: dict[str, Canvas] = {}

    def once(figure: PageFigure) -> Canvas:
        if figure.title not in known:
            known[figure.title] = drawn(figure)
        return known[figure.title]

    return once


def comparison_figures(comparison: Comparison, maps: Sequence[StimulusMap]) -> list[PageFigure]:
    """All figures of a page, those of the source aside."""
    said = answers(comparison)
    sections = [
        *answer_sections(said, "no offset fitted", recorded=True),
        *simulation_sections(comparison, shown_measures(comparison, said), maps),
    ]
    return [figure for section in sections for figure in section.figures]


def drawn(figure: PageFigure) -> Canvas:
    canvas = Canvas(figsize=figure.plot.size, layout=figure.plot.layout)
    figure.plot.draw(canvas)
    canvas.draw_without_rendering()
    return canvas


def written(canvas: Canvas) -> Iterator[Text]:
    texts: list[Text] = canvas.findobj(Text)
    yield from (text for text in texts if text.get_text().strip() and text.get_visible())


def seen(canvas: Canvas) -> Iterator[Text]:
    """All but the labels of ticks beyond the ends of their axes, and all of panels that are not shown."""
    hidden = set()
    for axes in canvas.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            off = [t for t in axis.get_major_ticks() if not low - 1e-9 <= t.get_loc() <= high + 1e-9]
            hidden |= {label for tick in off for label in (tick.label1, tick.label2)}
        if not axes.get_visible():
            hidden |= set(axes.findobj(Text))
    yield from (text for text in written(canvas) if text not in hidden)


def test_letters_do_not_lie_over_each_other(
    comparison: Comparison, section: StimulusMap, drawn_once: Callable[[PageFigure], Canvas]
) -> None:
    """Ticks, titles and labels of one figure of each kind, with four times as many receptors as usual, too."""
    found = [*comparison_figures(comparison, [section] * 3), *source_section(comparison).figures]
    many = np.linspace(-2, 2, 41)
    crowded = [
        replace(s, receptor_mm=many, measures=np.repeat(s.measures[..., :1], 41, axis=-1))
        for s in comparison.stimuli[:2]
    ]
    kinds = {figure.title.partition(":")[0]: figure for figure in found}
    canvases = [(figure.title, drawn_once(figure)) for figure in kinds.values()]
    canvases += [(figure.title, drawn(figure)) for figure in shape_figures(compare(crowded, {}), ["ep1"])[:2]]
    for title, canvas in canvases:
        texts = list(seen(canvas))
        boxes = np.array([text.get_window_extent().extents for text in texts])
        over = [(texts[k].get_text(), texts[n].get_text()) for k, n in np.argwhere(_shared(boxes) > 1) if k < n]
        assert not over, title


def _shared(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, n) what each two of (n, 4) boxes share, in dots."""
    low, high = boxes[:, None, :2], boxes[:, None, 2:]
    width, height = np.moveaxis(np.minimum(high, boxes[:, 2:]) - np.maximum(low, boxes[:, :2]), -1, 0)
    return np.maximum(width, 0.0) * np.maximum(height, 0.0)


def test_population_responses_are_images_of_receptors_and_positions(
    make_stimulus: Callable[..., StimulusRow],
) -> None:
    receptors = np.array(DEFAULT_X_MM)
    both = np.add.outer(X, receptors)
    many = make_stimulus("step:1", X, receptors, {"ep1": np.abs(both), "e13": both})
    canvas = drawn(_population(many))
    images = [mesh for axes in canvas.axes for mesh in axes.collections if isinstance(mesh, QuadMesh)]
    one, other = images[:2]
    assert one.get_array().shape == (len(X), len(receptors))
    np.testing.assert_array_equal(np.asarray(one.get_array()), np.abs(both))
    assert (one.get_cmap().name, other.get_cmap().name) == ("viridis", "PuOr_r")  # of one sign, of both
    assert other.get_clim() == (-6.0, 6.0)
    assert [sum(isinstance(c, QuadContourSet) for c in axes.collections) for axes in canvas.axes[:2]] == [0, 1]
    dotted = canvas.axes[0].lines[0]
    np.testing.assert_array_equal(dotted.get_xdata(), dotted.get_ydata())
    assert (np.min(dotted.get_xdata()), np.max(dotted.get_xdata())) == (X[X >= -2][0], X[X <= 2][-1])
    few = make_stimulus("step:1", X[:6], receptors, {"ep1": both[:6]})
    canvas = drawn(_population(few))
    assert len(canvas.axes[0].lines) == 6
    assert len({line.get_marker() for line in canvas.axes[0].lines}) == 6
    assert not drawn(_population(make_stimulus("step:1", X[:7], receptors, {"ep1": both[:7]}))).axes[0].lines[1:]


@pytest.mark.parametrize(("least", "cmap"), [(-0.04, "viridis"), (-0.06, "PuOr_r")])
def test_a_little_of_the_other_sign_keeps_the_colours(
    make_stimulus: Callable[..., StimulusRow], least: float, cmap: str
) -> None:
    values = np.linspace(least, 1, 25)[:, None] * np.ones(3)
    stimulus = make_stimulus("step:1", X, np.array([-1.0, 0, 1]), {"ep1": values})
    mesh = drawn(_population(stimulus)).axes[0].collections[0]
    assert mesh.get_cmap().name == cmap


def _population(stimulus: StimulusRow) -> PageFigure:
    return PageFigure("", populations(stimulus, ["ep1", "e13"]), "")


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
    position_scale(canvas.subplots(), positions)
    assert [text.get_text() for text in canvas.axes[1].get_yticklabels()] == [
        "−3.70", "−1.02", "−0.85", "−0.68", "2.00",
    ]  # fmt: skip
