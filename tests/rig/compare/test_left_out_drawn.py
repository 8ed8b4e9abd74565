"""Positions that no run covers are gaps in every figure that draws a profile, never points at zero."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.compare.comparison import Comparison, compare
from rig.compare.make_verdict import answers
from rig.compare.recordings.recording import recording
from rig.compare.stimuli import StimulusRow
from rig.compare.verdict import AfferentVerdict, FittedPositions, LeftOut
from rig.report import recording_sections, verdict_figures
from rig.report.style import Plot

Array = NDArray[np.float64]

X = np.linspace(-4.0, 4.0, 33)
RECEPTORS = np.array([-0.5, 0.0, 0.5])
POSITIONS = np.linspace(-4.25, 5.25, 20)
"""Recorded positions; the run does not cover the first and the last of them at every receptor."""
RATE = 40.0 + 20.0 * np.cos(POSITIONS)


@pytest.fixture
def comparison(make_stimulus: Callable[..., StimulusRow]) -> Comparison:
    profile = 1.5 + np.cos(X[:, None] - RECEPTORS)
    stimuli = [
        make_stimulus(shape, X, RECEPTORS, {"ep1": profile, "sed": profile**2}) for shape in ("step:1", "step:3")
    ]
    rows = [(float(x), float(rate), 5.0) for x, rate in zip(POSITIONS, RATE, strict=True)]
    return compare(stimuli, {shape: recording("made.csv", rows) for shape in ("step:1", "step:3")})


def _answer(found: Comparison) -> AfferentVerdict:
    (answer,) = answers(found)
    assert answer.left_out
    return answer


def _joint_profiles(found: Comparison) -> Plot:
    (joint,) = found.joints
    return recording_sections.overlays(joint, [(6, 1)])


def _joint_scatter(found: Comparison) -> Plot:
    (joint,) = found.joints
    return recording_sections.scatter(joint, [(6, 1)])


FIGURES: dict[str, Callable[[Comparison], Plot]] = {
    "the answer": lambda found: verdict_figures.the_answer(_answer(found), [0, 1], ""),
    "recorded over predicted": lambda found: verdict_figures.profiles(_answer(found), [0, 1], ""),
    "residuals": lambda found: verdict_figures.residuals(_answer(found), [0, 1], ""),
    "rate against measure": lambda found: verdict_figures.scatter(_answer(found), ""),
    "predicted over recorded": _joint_profiles,
    "rate against measure of the source": _joint_scatter,
}


def _drawn(plot: Plot) -> list[Axes]:
    figure = Figure(figsize=plot.size, layout=plot.layout)
    plot.draw(figure)
    figure.draw_without_rendering()
    return [axes for axes in figure.axes if axes.lines]


def _left_out(answer: AfferentVerdict) -> Array:
    return np.array(sorted({x for one in answer.left_out for x in one.position_mm}))


@pytest.mark.parametrize("name", FIGURES)
def test_a_line_stops_where_positions_are_left_out(name: str, comparison: Comparison) -> None:
    """And no point of a profile is at zero there: a cross is at the recorded rate."""
    gaps = _left_out(_answer(comparison))
    if name.startswith("predicted"):  # one receptor, at 0 mm, which sees more than all of them together
        gaps = POSITIONS[np.abs(POSITIONS) > 4]
    assert len(gaps)
    against_measure = "rate against" in name
    for axes in _drawn(FIGURES[name](comparison)):
        for line in axes.lines:
            points = [(float(x), float(y)) for x, y in zip(line.get_xdata(), line.get_ydata(), strict=True)]
            if against_measure:
                if line.get_linestyle() == "None":
                    seen = [x for x, _ in points if np.isfinite(x)]
                    assert len(seen) in (0, len(POSITIONS) - len(gaps), int((np.abs(POSITIONS) <= 4).sum())), name
                continue
            for (x, y), (after, y_after) in pairwise(points):
                if line.get_linestyle() != "None" and line.get_xdata()[0] != 0 and np.isfinite([y, y_after]).all():
                    assert not ((gaps >= x) & (gaps <= after)).any(), (name, x, after)
            for x, y in points:
                if line.get_linestyle() == "None" and x in gaps:
                    assert y == pytest.approx(40 + 20 * np.cos(x)), (name, x)


def test_the_gaps_are_inside_the_recording_too(comparison: Comparison) -> None:
    """As where one stimulus leaves out a position between others."""
    answer = _answer(comparison)
    places, title = answer.places, answer.stimuli[0]
    gap = int(np.flatnonzero(places.stimulus == 0)[3])
    kept = np.arange(len(places.rate)) != gap
    rows = tuple(
        replace(row, eps=row.eps[kept], predicted=row.predicted[kept], residual=row.residual[kept])
        for row in answer.rows
    )
    x, rate = float(places.position_mm[gap]), float(places.rate[gap])
    used = FittedPositions(places.stimulus[kept], places.position_mm[kept], places.rate[kept], places.error[kept])
    found = replace(
        answer, rows=rows, places=used,
        left_out=(LeftOut(title, (x,), (rate,)),),
    )  # fmt: skip
    for plot in (verdict_figures.the_answer(found, [0, 1], ""), verdict_figures.profiles(found, [0, 1], "")):
        axes = _drawn(plot)[0]
        crosses = [line for line in axes.lines if line.get_marker() == "x"]
        assert [(line.get_xdata().tolist(), line.get_ydata().tolist()) for line in crosses] == [([x], [rate])]
        lines = [line for line in axes.lines if line.get_linestyle() != "None"]
        assert lines
        for line in lines:
            assert np.isnan(line.get_ydata()[line.get_xdata() == x]).all()
            assert (line.get_xdata() == x).any()


@pytest.mark.parametrize("saturation", [0.0, 0.02])
def test_the_line_of_a_fit_is_the_fit_also_between_the_points(comparison: Comparison, saturation: float) -> None:
    """It has its corner where k(ε − ε₀) is zero, wherever the recorded positions lie."""
    answer = _answer(comparison)
    rows = tuple(
        replace(row, k=10.0, eps0=float(np.mean(row.eps[:2])), saturation=saturation)
        for row in answer.rows
        if np.isfinite(row.eps).all() and np.ptp(row.eps) > 0
    )
    found = replace(answer, rows=rows)
    panels = _drawn(verdict_figures.scatter(found, ""))
    pairs = verdict_figures.drawn_pairs(found)
    assert len(panels) == len(pairs)
    for axes, row in zip(panels, pairs, strict=True):
        (line,) = [one for one in axes.lines if one.get_linestyle() == "-"]
        eps, rate = (np.asarray(values, dtype=float) for values in line.get_data())
        drive = np.maximum(row.k * (eps - row.eps0), 0.0)
        np.testing.assert_allclose(rate, drive / (1 + saturation * drive))
        assert row.eps0 in eps
        assert len(eps) > 3 * len(row.eps)
