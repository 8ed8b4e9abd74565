"""Another finger than the published one: larger, mirrored, off-centre, of other layers. All of it synthetic."""

import dataclasses

import numpy as np
import pytest

from sim.config import FingertipConfig, Geometry, MeshSpec, Tissue
from sim.contact.profiles import IndentorProfile
from sim.contact.shapes import parse_shape
from sim.finger.mesh import MeshError, build_mesh, mesh_quality
from sim.finger.surface import FingertipSurface, published_points
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM
from sim.models.fingertip import Fingertip
from tests.error_codes import raises
from tests.sim.coarse_mesh import coarse_mesh

COARSE = coarse_mesh(0.4, 0.4, patch_x_mm=2.0, patch_z_mm=2.0, dermis_fine_depth_mm=0.8, near_spacing_mm=1.0)
NARROW = COARSE.model_copy(update={"patch_x_mm": 1.5, "patch_z_mm": 1.5})
"""As wide as contact is at 0.15 mm."""
SCENES = [("cylinder:3", -0.7), ("cylinder:3", 0.4), ("bar:1.5", -0.7), ("bar:1.5", 0.4)]


@pytest.fixture(scope="module", autouse=True)
def _models(tmp_path_factory: pytest.TempPathFactory) -> object:
    """A cache of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RIG_CACHE_DIR", str(tmp_path_factory.mktemp("models")))
        yield


def published(factor: float = 1.0, mirror: int = 1, shift_mm: float = 0.0) -> list[list[float]]:
    return (mirror * np.array([1, mirror, mirror]) * (factor * published_points()[1] + [shift_mm, 0, 0])).tolist()


def scaled_config(factor: float, mirror: int = 1) -> FingertipConfig:
    """The published points, free numbers, layers and mesh, every length multiplied; mirror = −1 negates x."""
    tables = FingertipConfig(mesh=COARSE).model_dump()
    for table in (tables["geometry"], tables["tissue"], tables["mesh"], tables):
        table.update({name: factor * value for name, value in table.items() if name.endswith("_mm") and value})
    geometry = tables["geometry"]
    geometry["proximal_lean_mm"] *= mirror
    geometry["stiffness_of_fit"] *= factor**1.5  # of the square root of mm times mm: √dz · d²/dz² stays a length
    geometry["points"] = published(factor, mirror)
    return FingertipConfig.model_validate(tables)


def load_scaled(factor: float, mirror: int = 1) -> Fingertip:
    return Fingertip.load(
        scaled_config(factor, mirror),
        receptor_x_mm=[factor * mirror * x for x in DEFAULT_X_MM],
        receptor_depth_mm=factor * DEFAULT_DEPTH_MM,
    )


@pytest.fixture(scope="module")
def small() -> Fingertip:
    """The published finger on the coarse mesh."""
    return load_scaled(1.0)


def enlarged(shape: str, factor: float) -> IndentorProfile:
    profile = parse_shape(shape).profile
    lengths = {
        f.name: factor * getattr(profile, f.name) for f in dataclasses.fields(profile) if f.name.endswith("_mm")
    }
    assert lengths
    return dataclasses.replace(profile, **lengths)


def test_a_larger_finger_gives_the_same_dimensionless_answers(small: Fingertip) -> None:
    # Linear elasticity has no length of its own: all lengths × s (finger, layers, mesh, indentor, depth) leave strain
    # and stress as they are and multiply forces by s². Measured 2e-8 in force, 8e-8 in SED: the height of first touch
    # rests on a table of the ridge every 0.02 mm, whatever the size, and is right to 1e-8 mm or so.
    s = 1.2
    large = load_scaled(s)
    assert large.model.nodes == small.model.nodes
    for shape, x in SCENES:
        one, other = small.indent(shape, x, doi_mm=0.3), large.indent(enlarged(shape, s), s * x, doi_mm=0.3 * s)
        assert max(one.state.residual, other.state.residual) < 1e-10
        assert other.force_n == pytest.approx(s**2 * one.force_n, rel=1e-6)
        np.testing.assert_allclose(other.receptor_strain, one.receptor_strain, rtol=0, atol=1e-7)
        np.testing.assert_allclose(other.receptor_measures["sed"], one.receptor_measures["sed"], rtol=1e-6)
        assert other.peak_pressure_pseudo == pytest.approx(one.peak_pressure_pseudo, rel=1e-6)


def test_a_mirrored_finger_gives_mirrored_answers(small: Fingertip) -> None:
    # Measured 4e-9 in force, 6e-9 in SED.
    mirrored = load_scaled(1.0, mirror=-1)
    assert not np.allclose(mirrored.model.surface.apex.position_mm, small.model.surface.apex.position_mm, atol=0.1)
    for shape, x in SCENES:
        one, other = small.indent(shape, x, doi_mm=0.3), mirrored.indent(shape, -x, doi_mm=0.3)
        assert other.force_n == pytest.approx(one.force_n, rel=1e-6)
        for measure, sign in (("sed", 1), ("e22", 1), ("e12", -1), ("e13", -1), ("e23", 1)):
            a, b = one.receptor_measures[measure], other.receptor_measures[measure]
            np.testing.assert_allclose(b, sign * a, rtol=1e-6, atol=1e-7 * np.abs(a).max(), err_msg=measure)


@pytest.mark.parametrize("shift", [1.0, 1.5])
def test_contact_is_found_on_a_finger_off_center(shift: float) -> None:
    """The pulp 1 and 1.5 mm beside the bone's axis: the points are followed, contact is found where the pulp is."""

    def load(mirror: int) -> Fingertip:
        geometry = Geometry(proximal_lean_mm=mirror * (shift - 0.6), points=published(1.0, mirror, shift))
        x = [mirror * x for x in DEFAULT_X_MM]
        return Fingertip.load(FingertipConfig(geometry=geometry, mesh=COARSE), receptor_x_mm=x)

    right, left = load(1), load(-1)
    surface = right.model.surface
    assert surface.residuals_mm().max() < 0.05  # as for the published points where they are; measured 0.026
    assert surface.apex.position_mm[0] == pytest.approx(shift - 0.14, abs=0.3)
    mesh = build_mesh(right.config, surface)
    assert mesh_quality(mesh.nodes, mesh.hexes).scaled_jacobian.min() > 0.4  # measured 0.58 and 0.44
    forces = []
    for x in (-0.5, 0.0, 0.5, 1.2):
        for shape in ("cylinder:3", "bar:1.5"):
            one, other = right.indent(shape, x, doi_mm=0.4), left.indent(shape, -x, doi_mm=0.4)
            assert max(one.state.residual, other.state.residual) < 1e-10, (shape, x)
            assert other.force_n == pytest.approx(one.force_n, rel=1e-6), (shape, x)
        forces.append(one.force_n)
        touched = one.state.held.on(one.model.patch).interpolate(one.model.patch.x)
        assert touched.min() > x - 0.75 - 0.2, x  # half a bar and half an element
        assert touched.max() < x + 0.75 + 0.2, x
    # The nearer the bar to the apex, the more of it touches; the two farthest differ by less than this mesh tells.
    assert max(forces[:2]) < forces[2] < forces[3]


def force_n(spec: MeshSpec = COARSE, doi_mm: float = 0.3, **tissue: float) -> float:
    """A cylinder of 9 mm on a finger of other layers."""
    finger = Fingertip.load(FingertipConfig(tissue=Tissue(**tissue), mesh=spec))  # type: ignore[arg-type]
    result = finger.indent("cylinder:9", 0.0, doi_mm=doi_mm)
    assert result.state.residual < 1e-10
    return result.force_n


@pytest.mark.parametrize(
    ("parameter", "values"),
    [
        ("epidermis_mm", (0.06, 0.9)),  # the stiffest layer, thicker
        ("bone_fraction", (0.1, 0.55)),  # less tissue over the bone
        ("e_dermis", (1e-4, 10.0)),
        ("e_fat", (2e-6, 10.0)),
        ("nail_arc_deg", (0.0, 200.0)),  # more of the skin held
    ],
)
def test_more_of_a_stiffer_layer_makes_a_stiffer_finger(parameter: str, values: tuple[float, ...]) -> None:
    coarser = NARROW.model_copy(update={"spacing_mm": 0.5, "growth": 2.0})
    forces = [force_n(coarser, doi_mm=0.15, **{parameter: value}) for value in values]
    assert np.diff(forces).min() > 0, forces


def test_layers_of_one_stiffness_are_one_layer() -> None:
    # With e_dermis = e_fat = 1 nothing distinguishes the layers: their thickness moves elements only. Measured
    # within 1.1 %; the same change of the epidermis moves the layered finger from 0.013 to 0.031 N.
    alike = {"e_dermis": 1.0, "e_fat": 1.0}
    forces = [force_n(**alike, epidermis_mm=h) for h in (0.2, 0.4, 0.9)] + [force_n(**alike, dermis_mm=1.5)]
    np.testing.assert_allclose(forces, forces[1], rtol=0.02)
    assert forces[1] > 3 * force_n()  # dermis and fat ten times softer; measured 5.8 times


def test_flat_elements_of_high_aspect_ratio_change_the_force_by_under_one_percent() -> None:
    """Flat elements under the contact, one stiffness: the answer of a mesh of well-shaped ones."""
    # Epidermis of 0.06 mm in four elements, 0.25 mm wide: aspect ratio 23 in the patch, 310 at the tip. Against two
    # elements of 0.2 mm: measured 0.1 % in force; 1 % is what the meshes of different sizes above differ by.
    alike = {"e_dermis": 1.0, "e_fat": 1.0}
    fine = NARROW.model_copy(update={"spacing_mm": 0.25, "near_spacing_mm": 0.6})
    flat = fine.model_copy(update={"epidermis_elements": 4})
    config = FingertipConfig(tissue=Tissue(epidermis_mm=0.06, **alike), mesh=flat)
    mesh = build_mesh(config, FingertipSurface.fit(config.geometry))
    under = np.isin(mesh.hexes, mesh.patch_nodes).any(axis=1)
    quality = mesh_quality(mesh.nodes, mesh.hexes)
    assert quality.aspect_ratio[under].max() > 15
    assert quality.aspect_ratio.max() > 200
    cubes = force_n(fine.model_copy(update={"epidermis_elements": 2}), 0.15, **alike)
    assert force_n(flat, 0.15, epidermis_mm=0.06, **alike) == pytest.approx(cubes, rel=0.01)


@pytest.mark.parametrize(
    ("tissue", "skin_mm", "bone_mm", "most_mm"),
    [
        ({"epidermis_mm": 0.99, "dermis_mm": 1.9}, 2.89, 3.31, 2.31),
        ({"bone_fraction": 0.59, "dermis_mm": 1.2}, None, 1.99, 1.39),
    ],
)
def test_layers_that_leave_no_room_for_fat_are_refused(
    tissue: dict[str, float], skin_mm: float | None, bone_mm: float, most_mm: float
) -> None:
    config = FingertipConfig(tissue=Tissue(**tissue), mesh=COARSE)  # type: ignore[arg-type]
    skin_mm = config.tissue.epidermis_mm + config.tissue.dermis_mm if skin_mm is None else skin_mm
    with raises(MeshError, "no_fat", skin_mm=skin_mm, bone_mm=bone_mm, most_mm=most_mm):
        build_mesh(config, FingertipSurface.fit(config.geometry))


def test_a_patch_wider_than_the_finger_is_refused() -> None:
    narrow = [[z, 2.8, 4.0, 0.0] for z in np.linspace(0, 12.75, 6)]
    config = FingertipConfig(geometry=Geometry(sections=narrow))
    width = {"low_mm": pytest.approx(-2.8, abs=0.005), "high_mm": pytest.approx(2.8, abs=0.005)}
    with raises(MeshError, "patch_leaves_pulp", patch_x_mm=3.3, **width):
        build_mesh(config, FingertipSurface.fit(config.geometry))
