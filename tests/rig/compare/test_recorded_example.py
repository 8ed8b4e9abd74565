"""The recorded example: its file, its rates of change, and the sentences' order; the whole runs in the gallery."""

import numpy as np
import pytest

from rig.compare.example import (
    DOI_MM,
    FARTHEST_MM,
    PHASES,
    RECORDED,
    RELAXATION,
    _rates,
    judge_phase,
    positions,
    recorded,
    rehearse,
)
from rig.report.example_page import Level, lead_sentences, moved_axes, undecided
from sim.config import FingertipConfig
from sim.measures.measures import MEASURES, measures_in_layers, shown
from sim.models.fingertip import Fingertip
from tests.sim.coarse_mesh import coarse_mesh


@pytest.mark.parametrize(("phase", "largest"), [("static", 61.0), ("dynamic", 210.0)])
def test_the_file_has_36_positions_and_its_source(phase: str, largest: float) -> None:
    found = recorded(phase)
    assert len(found.position_mm) == 36
    assert found.rate.max() == largest
    assert "Phillips & Johnson 1981" in RECORDED.read_text(encoding="utf-8").splitlines()[0]


def test_the_rehearsal_holds_every_recorded_position_of_a_receptor_at_0() -> None:
    x_mm = positions()
    assert set(recorded("static").position_mm.round(6)) <= set(x_mm)
    assert np.abs(x_mm).max() <= FARTHEST_MM + 1e-9


def test_rates_of_a_proportional_ramp() -> None:
    """Strain grows linearly, so its mean and peak rate are strain / time, and stress relaxes while it grows."""
    last = np.array([[0.01, -0.05, 0.02, 0.01, 0.0, 0.0]])
    strain = (np.arange(1, 11) / 10)[None, :, None, None] * last
    arrays = {"strain": strain, "stress": strain, "receptor_e": np.array([0.1])}
    ramp_s = DOI_MM / 10.0
    mean, peak = _rates(arrays, 0.48, 10.0).reshape(2, len(MEASURES), 1, 1)
    elastic = {
        name: float(np.abs(shown(name, v)[0])) for name, v in measures_in_layers(last, np.array([0.1]), 0.48).items()
    }
    for name in ("e11", "e22", "ep1", "ep3"):
        assert mean[MEASURES.index(name), 0, 0] == pytest.approx(elastic[name] / ramp_s)
    remaining = 1 - sum(share * (1 - tau / ramp_s * (1 - np.exp(-ramp_s / tau))) for share, tau in RELAXATION)
    s22 = MEASURES.index("s22")
    assert mean[s22, 0, 0] == pytest.approx(remaining * elastic["s22"] / ramp_s)
    assert peak[s22, 0, 0] > mean[s22, 0, 0]


def test_both_phases_are_judged_on_a_coarse_finger() -> None:
    finger = Fingertip.load(FingertipConfig(mesh=coarse_mesh(0.5, 0.5)), receptor_x_mm=(-0.5, 0.0))
    rehearsal = rehearse(finger, positions()[3:-3:2])
    verdicts = [judge_phase(rehearsal, recorded(phase), phase) for phase in PHASES]
    for one in verdicts:
        shares = [row.held_out for row in one.rows if np.isfinite(row.held_out)]
        assert shares == sorted(shares, reverse=True)
        assert one.best.interval[0] <= one.best.held_out <= one.best.interval[1]
        assert one.best in undecided(one)
    names = {row.name for row in verdicts[1].rows}
    assert {"sed", "mean rate of sed", "peak rate of sed"} <= names
    assert "mean rate of sed" not in {row.name for row in verdicts[0].rows}
    first, second, third = lead_sentences(verdicts, LEVELS)
    assert first.index("static") < first.index("dynamic")
    assert "distinguished" in second or "as good" in second
    assert "depth" in third


LEVELS = [
    Level("defaults", "–", "static", "ep1 at 0 mm", "0.9", "sed at 0 mm", "0.8", "0.9"),
    Level("x", "0.5", "static", "ep1 at −0.5 mm", "0.9", "sed at 0 mm", "0.8", "0.9"),
    Level("depth", "0.6", "static", "sed at 0 mm", "0.9", "ep1 at 0 mm", "0.8", "0.9"),
]


def test_a_measure_is_settled_where_it_leads_at_every_level() -> None:
    assert moved_axes(LEVELS, "static") == ["depth"]
    assert moved_axes(LEVELS[:2], "static") == []
