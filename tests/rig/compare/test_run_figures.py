"""Figures of a run: every contact region is drawn, however narrow, and the lowest panels have their axis."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from rig.data import Run, RunFolder
from rig.plan.finger_model import PredictedHold, responses
from rig.report.run_figures import contact_panels, force_depth, highest_pressure, presses
from rig.report.run_tables import by_target, conditions
from rig.report.style import ORANGE
from sim.models.fingertip import Fingertip


def drawn(found: list[PredictedHold]) -> Figure:
    canvas = Figure()
    contact_panels([[one] for one in found], highest_pressure(found)).draw(canvas)
    return canvas


def test_a_contact_region_between_two_nodes_is_drawn(bar_run: Run, finger: Fingertip) -> None:
    """Step 1 at −1.63 touches with its edge, on less than the 0.17 mm between nodes, and with its upper flat."""
    result = finger.indent("step:1", -1.63, force_gwt=2.33)
    edge, flat = result.contact_regions_mm
    assert edge[1] - edge[0] < 0.17
    panel = drawn([replace(responses(bar_run, finger)[0], result=result)]).axes[0]
    shown = [line for line in panel.lines if to_hex(line.get_color()).upper() == ORANGE]
    moved = float(np.abs(result.state.displacement[0]).max())
    for line, (low, high) in zip(shown, (edge, flat), strict=True):
        x = np.asarray(line.get_xdata(), dtype=float)
        np.testing.assert_allclose((x[0], x[-1]), (low, high), atol=moved)
        assert x[-1] > x[0]


def test_panels_above_an_empty_place_keep_their_axis(bar_run: Run, finger: Fingertip) -> None:
    found = [one for one in responses(bar_run, finger) if one.last]
    panels = [axes for axes in drawn((found * 5)[:5]).axes if axes.get_ylim()[0] == 0]
    assert [axes.get_xlabel() for axes in panels] == ["", *["lateral x (mm)"] * 4]
    assert [list(axes.get_xticks()) for axes in panels] == [[], *[[-2, 0, 2]] * 4]
    assert [axes.get_ylabel() for axes in panels] == [
        "pressure\n(kPa)",
        "",
        "",
        "",
        "pressure\n(kPa)",
    ]


def _pressed(times: int) -> Run:
    """Conditions at two places, each as often; the force steps by a reading's resolution in a hold."""
    starts, samples = [], []
    for index in range(2 * times):
        starts.append({"index": index, "indentor": "bar:3.0", "x_mm": index % 2, "increments": 1, "target": "doi_mm",
                       "value": 0.3, "t_s": 0.0})  # fmt: skip
        steps = [("press", 0.1, 1.0), ("press", 0.2, 2.0), ("hold", 0.3, 4.00), ("hold", 0.3, 4.04)]
        samples += [{"index": index, "t_s": float(k), "phase": phase, "doi_mm": doi_mm, "force_gwt": force_gwt}
                    for k, (phase, doi_mm, force_gwt) in enumerate(steps)]  # fmt: skip
    ends = [
        {"index": one["index"], "hold": 1, "t_s": 1.0, "x_mm": 0.0, "force_gwt": 4.0, "doi_mm": 0.3} for one in starts
    ]
    events = {"indentation_start": starts, "hold_end": ends, "sample": samples}
    return Run(RunFolder(Path()), {"t_s": 0.0, "planned_indentations": 9}, None, {}, events, {}, 9.0, 9.0)


@pytest.mark.parametrize("times", [1, 2])
def test_only_repeats_have_a_panel_of_their_spread(times: int) -> None:
    figure = Figure()
    force_depth(run := _pressed(times), by_target(conditions(run))).draw(figure)
    panels = [axes for axes in figure.axes if axes.get_xlabel()]
    assert len(panels) == times
    for axes in panels:
        assert len(axes.lines) == 2, "one line for each place"


def test_steps_of_a_reading_do_not_fill_the_panel_of_relative_forces() -> None:
    figure = Figure()
    presses(run := _pressed(1), by_target(conditions(run))).draw(figure)
    right = next(axes for axes in figure.axes if axes.get_xlabel() == "time in the hold (s)")
    low, high = right.get_ylim()
    drawn_y = np.concatenate([np.asarray(line.get_ydata(), dtype=float) for line in right.lines])
    assert (drawn_y.min(), drawn_y.max()) == pytest.approx((1.0, 1.01))
    assert high - low > 10 * (drawn_y.max() - drawn_y.min())
