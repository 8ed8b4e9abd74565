"""The page of `rig bench`."""

import re
from collections.abc import Iterator

import numpy as np
import pytest
from matplotlib.figure import Figure

from rig.report.benchmark_page import exponent, page
from rig.report.style import Plot
from sim.benchmark import FAMILIES, QUANTITIES, QUICK_SCENES, Candidate, coarse, measure, rows, stored


@pytest.fixture(scope="module")
def html() -> Iterator[str]:
    """With figures that are empty: what is in them is tested beside them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Plot, "_laid_out", property(lambda plot: Figure((1, 1))))
        yield _page()


def _page() -> str:
    candidates = (Candidate("halfspace", "0.5 mm", coarse(0.5)), Candidate("section", "0.5 mm", coarse(0.5)))
    reference = stored()
    scenes = [next(scene for scene in QUICK_SCENES if scene.family == family) for family in FAMILIES]
    return page(
        list(rows(measure(candidates, scenes), reference)),
        machine="a machine",
        wall_s=1.0,
        quick=True,
        quantities=QUANTITIES,
        reference=reference,
        reference_s=0.3,
        steps=("mesh",),
        breakdown=[{"name": "one", "timing": {"mesh": 1.5}, "factor_s": None, "contact_s": 0.01, "limit_s": 0.001}],
        calculix=None,
        no_calculix="Left out.",
    )


def test_it_needs_nothing_else(html: str) -> None:
    sources = re.findall(r"(?:src|href)=\"(?!#)([^\"]{0,30})", html)
    assert len(sources) == 3
    assert all(source.startswith("data:image/svg+xml;base64,") for source in sources)


def test_exponent_of_a_power_law() -> None:
    nodes = np.array([1e3, 3e3, 1e4])
    assert exponent(nodes, 2e-7 * nodes**1.7) == pytest.approx(1.7, abs=1e-12)
