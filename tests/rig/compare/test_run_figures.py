"""Figures of a run: every contact region is drawn, however narrow, and the lowest panels have their axis."""

from dataclasses import replace

import numpy as np
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from rig.data import Run
from rig.plan.finger_model import PredictedHold, responses
from rig.report.run_figures import contact_panels, highest_pressure
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
