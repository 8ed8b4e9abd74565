"""What a scene needs, read off the undeformed skin; and models without receptors."""

import numpy as np
import pytest

from sim.cheapest_model import Situation, choose
from sim.config import FingertipConfig
from sim.contact.shapes import parse_shape
from sim.errors import ModelRangeError
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import NOWHERE, ReceptorSet
from sim.models.catalogue import load
from sim.models.finger_3d import build_finger
from tests.error_codes import raises
from tests.sim.coarse_mesh import coarse_mesh


def situation(shape: str, doi_mm: float | None, x_mm: float = 0.0, z_mm: float | None = None) -> Situation:
    return Situation.of(parse_shape(shape), x_mm, z_mm, doi_mm, FingertipConfig())


def test_the_patch_grows_with_depth_and_place() -> None:
    assert [situation("cylinder:9", doi).share for doi in (0.1, 0.4, 1.2)] == [0.65, 0.65, 1.0]
    assert [situation("cylinder:9", 0.3, x).share for x in (0.0, 3.5)] == [0.65, 1.0]
    assert situation("sphere:2", 0.1).share == 0.65
    assert situation("sphere:2", 0.1, 2.2).share == 1.0
    assert situation("cylinder:9", None).share == 1.0


def test_reach_is_how_far_the_indentor_lies_below_the_skin_and_a_margin() -> None:
    shallow = situation("sphere:5", 0.2)
    assert shallow.reach_mm is not None
    # A sphere of 5 mm on a pad of some 3.6 × 3.4 mm: √(2 · 0.2 / (1/5 + 1/R)) is 0.92 mm across and 0.90 mm along.
    assert shallow.reach_mm == pytest.approx((0.9 * 0.92 + 0.3, 0.9 * 0.90 + 0.5), abs=0.25)
    assert situation("sphere:5", 1e-6).reach_mm == (0.0, 0.0)


def test_depth_counts_from_first_touch_whatever_the_reference() -> None:
    bar, config = parse_shape("cylinder:3"), FingertipConfig()
    touched = Situation.of(bar, 1.5, None, 0.9, config)
    apex = Situation.of(bar, 1.5, None, 0.9, config, "apex")
    assert touched.depth_mm == 0.9
    assert apex.depth_mm is not None
    assert 0.2 < 0.9 - apex.depth_mm < 0.4
    centred = Situation.of(bar, 0.0, None, 0.9, config, "apex").depth_mm
    assert centred == pytest.approx(0.9, abs=0.01)


def test_places_that_a_shape_cannot_have_are_refused() -> None:
    for shape, x_mm, z_mm, code in (
        ("line", 0.5, None, "meaningless_place"),
        ("bar:3.0", 0.0, 6.0, "meaningless_place"),
        ("bar:3.0", float("nan"), None, "x_outside"),
    ):
        with raises(ModelRangeError, code):
            situation(shape, 0.3, x_mm, z_mm)
    with raises(ModelRangeError, "not_one_target", doi_mm=None, force_gwt=None):
        choose("bar:3.0")
    with raises(ModelRangeError, "not_one_target", doi_mm=0.3, force_gwt=2.0):
        choose("bar:3.0", doi_mm=0.3, force_gwt=2.0)


# --- a model without receptors ---


def test_a_finger_without_receptors_presses_the_same() -> None:
    config = FingertipConfig(mesh=coarse_mesh(0.5, 0.9))
    with_ten = load("finger", config, cached=False)
    without = load("finger", config, cached=False, **NOWHERE.as_options())
    skin = FingertipSurface.fit(config.geometry)
    bare = build_finger(config, skin, ReceptorSet(np.zeros((0, 3)), np.zeros(0)))
    assert bare.columns.per_skin_force.shape[0] == 0
    one, other = (finger.indent("bar:3.0", doi_mm=0.3) for finger in (with_ten, without))
    assert one.force_n == other.force_n
    assert len(other.receptor_measures["sed"]) == 0 != len(one.receptor_measures["sed"])
    assert other.as_json()["receptors"]["sed"] == []
    assert len(other.receptor_table()["ep1"]) == 0
