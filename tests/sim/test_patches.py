"""A patch that grows to what a scene needs, within the memory."""

from copy import copy

import numpy as np
import pytest

from sim.config import Contact, FingertipConfig, Geometry, MeshSpec
from sim.contact.indentor import ALONG, BOTH
from sim.errors import ModelRangeError
from sim.finger.surface import FingertipSurface
from sim.models.catalogue import load
from sim.models.fingertip import Fingertip
from sim.models.full_mesh import mesh_of
from sim.models.pressing import RimError
from sim.models.sources import larger
from tests.error_codes import printed, raises

OWN = (2.5, 2.5)


def within(finger: Fingertip, gb: float) -> Fingertip:
    """The same finger, its models shared, with another bound on memory."""
    other = copy(finger)
    other.config = finger.config.model_copy(update={"contact": Contact(patch_gb=gb)})
    return other


def met(x: float, z: float, *others: tuple[float, float]) -> RimError:
    """The rim, met at a place, other places lying below the indentor."""
    return RimError("it reaches the rim", (x, z), np.array(others).reshape(-1, 2))


ONCE, TWICE, PLANE = 2.5 * 1.25, 2.5 * 1.25**2, 6.893


@pytest.mark.parametrize(
    ("at", "others", "expected"),
    [
        # skin at the rim and a little beyond it: the next size there
        ((2.5, PLANE), [(2.6, PLANE)], (ONCE, 2.5)),
        ((0.0, 9.393), [(0.0, 9.5)], (2.5, ONCE)),
        ((2.1, 4.7), [(2.1, 4.7)], (ONCE, ONCE)),
        ((1.0, 6.0), [(1.0, 6.0)], (ONCE, ONCE)),  # nowhere near: everywhere
        # of how far the indentor would lie below the skin contact goes 0.85
        ((2.5, PLANE), [(-0.5, PLANE), (-3.6, PLANE)], (ONCE, 2.5)),
        ((2.5, PLANE), [(3.7, PLANE), (0.0, 3.1)], (TWICE, TWICE)),
        # a first touch: room of 1.5 mm around it
        ((0.0, 9.393), [], (2.5, 2.5 * 1.25**3)),
        ((0.0, 11.0), [], (2.5, 0.3 * 17)),  # no farther than the finger goes: to 0.5 mm of its end
    ],
)
def test_a_patch_grows_to_the_next_size_that_holds_the_contact(
    coarse_finger: Fingertip,
    at: tuple[float, float],
    others: list[tuple[float, float]],
    expected: tuple[float, float],
) -> None:
    found = larger(coarse_finger.config, coarse_finger.surface, BOTH, OWN, met(*at, *others))
    assert found == pytest.approx(expected, abs=1e-9)


def test_a_larger_patch_is_refused_if_it_exceeds_the_memory_limit(coarse_finger: Fingertip) -> None:
    """10 × 8 bytes × (2 or 3 directions × nodes)²: of 3.125 × 3.125 mm at 0.3 mm some 23 × 23 nodes."""
    surface = coarse_finger.surface
    for slopes, gb in ((ALONG, 0.14), (BOTH, 0.3)):
        error = met(2.5, 9.393, (2.6, 9.4))
        larger(within(coarse_finger, gb).config, surface, slopes, OWN, error)
        size = {"patch_x_mm": ONCE, "patch_z_mm": ONCE, "patch_gb": gb / 3}
        with raises(ModelRangeError, "patch_too_large", problem="it reaches the rim", **size) as caught:
            larger(within(coarse_finger, gb / 3).config, surface, slopes, OWN, error)
        assert gb / 3 < printed(caught.value, "would take ", " GB") <= gb


@pytest.mark.parametrize(
    ("shape", "place", "target", "grown"),
    [
        ("flat", {}, {"doi_mm": 2.0}, (True, True)),
        ("sphere:2", {"z_mm": 10.893}, {"doi_mm": 0.5}, (False, True)),
        ("sphere:2", {"z_mm": 2.893}, {"doi_mm": 0.5}, (False, True)),
        ("bar:3", {"x_mm": 1.9}, {"force_gwt": 25.0}, (False, True)),
    ],
)
def test_a_press_that_leaves_the_patch_is_solved_on_a_larger_one(
    coarse_finger: Fingertip,
    shape: str,
    place: dict[str, float],
    target: dict[str, float],
    grown: tuple[bool, bool],
) -> None:
    with pytest.raises(RimError):
        within(coarse_finger, 0).indent(shape, **place, **target)
    result = coarse_finger.indent(shape, **place, **target)
    assert result.state.residual <= 1e-10
    patch = result.model.widened_mm
    assert patch is not None
    assert tuple(now > own for now, own in zip(patch, OWN, strict=True)) == grown
    assert not (result.state.active & result.model.patch.rim).any()
    kept = coarse_finger.model_for(result.indentor.axes, patch)
    np.testing.assert_array_equal(kept.patch.position_mm, result.model.patch.position_mm)
    again = coarse_finger.indent(shape, **place, **target)
    assert again.force_n == result.force_n
    assert again.model is result.model
    mesh = mesh_of(coarse_finger.config, result)
    np.testing.assert_array_equal(mesh.nodes[mesh.patch_nodes], result.model.patch.position_mm)


def test_a_small_press_uses_the_own_patch_even_after_a_larger_one(coarse_finger: Fingertip) -> None:
    """Also once a larger patch is there: answers do not hang on what was asked before."""
    before = coarse_finger.indent("flat", doi_mm=0.3)
    coarse_finger.indent("flat", doi_mm=2.0)
    after = coarse_finger.indent("flat", doi_mm=0.3)
    assert before.model.widened_mm is None
    assert after.model is before.model
    assert after.force_n == before.force_n


def test_a_start_state_of_another_patch_is_ignored(coarse_finger: Fingertip) -> None:
    shallow, deep = (coarse_finger.indent("flat", doi_mm=doi) for doi in (0.3, 2.0))
    again = coarse_finger.indent("flat", doi_mm=0.3, start=deep.state)
    assert again.force_n == shallow.force_n
    onward = coarse_finger.indent("flat", doi_mm=2.0, start=shallow.state)
    assert onward.force_n == pytest.approx(deep.force_n, rel=1e-9)


def test_a_plate_on_a_flat_pad_touches_nearly_its_whole_width() -> None:
    """Radii of 6.4 and 6 mm at its apex: pressed to 2 mm, touched nearly as wide as it is."""
    geometry = Geometry(sections=tuple((z, 5.5, 4.2 - (z - 6.9) ** 2 / 12, 0.0) for z in np.linspace(0, 12.75, 8)))
    mesh = MeshSpec(spacing_mm=0.6, axial_spacing_mm=0.8, patch_x_mm=2.0, patch_z_mm=2.0, epidermis_elements=1,
                    dermis_spacing_mm=0.4, dermis_fine_depth_mm=0.5, near_spacing_mm=1.0)  # fmt: skip
    finger = load("finger", FingertipConfig(geometry=geometry, mesh=mesh), cached=False)
    result = finger.indent("flat", doi_mm=2.0)
    assert result.state.residual <= 1e-10
    assert result.model.widened_mm is not None
    touching, _ = result.touching_mm
    assert touching.max() - touching.min() > 6.0


def test_a_cached_finger_keeps_its_larger_patches(
    coarse_config: FingertipConfig, tmp_path: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RIG_CACHE_DIR", str(tmp_path))
    first = Fingertip.load(coarse_config).indent("flat", doi_mm=0.8)
    again = Fingertip.load(coarse_config)
    result = again.indent("flat", doi_mm=0.8)
    assert result.model.widened_mm == first.model.widened_mm is not None
    assert again.from_cache
    assert result.force_n == pytest.approx(first.force_n, rel=1e-12)
    assert isinstance(again.surface, FingertipSurface)
