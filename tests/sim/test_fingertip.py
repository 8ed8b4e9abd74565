"""The default fingertip: refusals, answers that repeat to the bit, depth, pressure and stiffness."""

import math
from typing import Any

import numpy as np
import pytest

from sim.config import E_EPIDERMIS_MPA, Contact, FingertipConfig
from sim.errors import ModelRangeError
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.pressing import RimError
from tests.error_codes import raises
from tests.sim.coarse_mesh import coarse_mesh


def test_a_cached_model_answers_as_the_one_just_made(coarse_config: FingertipConfig, tmp_path_factory: Any) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RIG_CACHE_DIR", str(tmp_path_factory.mktemp("models")))
        made, read = (Fingertip.load(coarse_config) for _ in range(2))
    assert not made.from_cache
    assert read.from_cache
    one, two = (f.indent("cylinder:3", 0.1, doi_mm=0.2) for f in (made, read))
    np.testing.assert_array_equal(one.state.force, two.state.force)
    np.testing.assert_array_equal(one.receptor_strain, two.receptor_strain)
    assert one.force_n == two.force_n


@pytest.mark.parametrize(
    ("shape", "x", "target", "code", "fields"),
    [
        *(
            ("bar:3", 0.0, {"doi_mm": doi}, "doi_outside", {"doi_mm": f"DOI {doi:g} mm", "deepest_mm": 2.0})
            for doi in (0.0, 2.001, math.nan)
        ),
        ("bar:3", math.nan, {"doi_mm": 0.5}, "x_outside", {"x_mm": "nan"}),
        ("bar:3", 0.0, {}, "not_one_target", {}),
        ("bar:3", 0.0, {"doi_mm": 0.5, "force_gwt": 2.0}, "not_one_target", {}),
        *(
            ("bar:3", 0.0, {"force_gwt": force}, "force_not_positive", {"force_gwt": f"force {force:g} gwt"})
            for force in (0.0, math.nan)
        ),
        ("bar:3", 1.5, {"force_gwt": 500.0}, "at_rim", {"indentor": "bar:3", "at_x_mm": 1.5}),
        ("sphere:1", 0.0, {"force_gwt": 500.0}, "force_out_of_reach", {"force_gwt": 500.0, "deepest_mm": 2.0}),
        ("bar:3", 3.0, {"doi_mm": 2.0}, "at_rim", {"indentor": "bar:3", "at_x_mm": 3.0}),
        (
            *("bar:1.5", 5.0, {"doi_mm": 0.2}, "touch_beside_patch"),
            {"indentor": "bar:1.5", "at_x_mm": 5.0, "axis": "x"},
        ),
    ],
)
def test_presses_outside_the_range_of_the_model_are_refused(
    unwidened: Fingertip, shape: str, x: float, target: dict[str, Any], code: str, fields: dict[str, Any]
) -> None:
    with raises(ModelRangeError, code, **fields):
        unwidened.indent(shape, x, **target)


def test_contact_at_the_ends_of_the_patch_is_refused() -> None:
    # A 3 mm bar reaches the end rows of a short patch: an answer would be too soft, so there is none.
    short = FingertipConfig(
        mesh=coarse_mesh(0.4, 0.4, patch_x_mm=2.5, patch_z_mm=1.2),
        contact=Contact(patch_gb=0),
    )
    finger = load("finger", short, cached=False)
    finger.indent("bar:3.0", 0.0, doi_mm=0.1)
    with raises(RimError, "at_rim", size="mesh.patch_x_mm / patch_z_mm"):
        finger.indent("bar:3.0", 0.0, doi_mm=1.0)


def test_depth_from_the_apex_exceeds_depth_from_first_touch_by_the_fall_of_the_skin(finger: Fingertip) -> None:
    # Raju (1998) measures depth from the topmost point: off centre that is deeper by what the skin has fallen.
    x = 1.5
    fallen = finger.apex_height_mm - finger.touch_height_mm("bar:1.5", x)
    assert 0.02 < fallen < 0.5
    source = finger.indent("bar:1.5", x, doi_mm=0.6 + fallen, reference="apex")
    ours = finger.indent("bar:1.5", x, doi_mm=0.6)
    assert source.force_n == pytest.approx(ours.force_n, rel=1e-6)


def test_nodal_pressures_sum_to_the_force(finger: Fingertip) -> None:
    # Σ p A over the patch is the sum of the normal forces; on a flat shape that is the force itself, in pseudo-units
    # E(epidermis) = 10 000.
    result = finger.indent("bar:3.0", 0.0, doi_mm=0.33)
    patch = result.model.patch
    carried = (result.nodal_pressure_pseudo * patch.area_mm2).sum() / 10_000 * result.e_epidermis_mpa
    assert carried == pytest.approx(result.force_n, rel=1e-12)
    x, p = result.pressure_profile
    assert (np.diff(x) > 0).all()
    assert p.max() <= result.peak_pressure_pseudo
    (region,) = result.contact_regions_mm
    touching, _ = result.touching_mm
    assert region == (touching.min(), touching.max())
    assert x[p > 0].min() <= region[0] < region[1] <= x[p > 0].max()


@pytest.mark.parametrize(("shape", "doi"), [("cylinder:9", 0.4), ("cylinder:9", 0.67), ("cylinder:3", 0.67)])
def test_the_width_of_smooth_contact_does_not_jump_by_nodes(finger: Fingertip, shape: str, doi: float) -> None:
    # Moved by less than an element (0.17 mm), nodes alone jump by up to 0.17 mm; measured 0.02 to 0.04 mm.
    widths = []
    for x in np.arange(8) * 0.17 / 8:
        ((low, high),) = finger.indent(shape, float(x), doi_mm=doi).contact_regions_mm
        widths.append(high - low)
    assert np.ptp(widths) < 0.05, widths


def test_the_stored_stiffness_is_that_of_the_calibration(finger: Fingertip) -> None:
    # Raju (1998): step 1 at x = −1.63 mm, DOI 0.73 mm stands for 8 gwt; stored to six decimals.
    force = finger.indent("step:1", -1.63, doi_mm=0.73).state.normal_force
    assert pytest.approx(8 * 9.80665e-3 / force, abs=1e-6) == E_EPIDERMIS_MPA


def test_far_from_the_finger_an_indentor_touches_at_the_edge_of_the_pulp(finger: Fingertip) -> None:
    # Where a stage is homed no part of a bar is over the pad: its flank, not its face, would touch, far below.
    assert finger.touch_height_mm("bar:3.0", 29.0) < -1000
