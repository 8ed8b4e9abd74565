"""`rig finger` and `rig export-deck`: the mesh of a configuration, and a scene as a CalculiX deck."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NotRequired

import numpy as np

from rig.cli.options import FingertipOption, JsonOption, checked_file, option
from rig.cli.output import THE_FINGER, busy, complain, err, out, print_json, reporting_errors, writes_json
from rig.cli.request import takes
from rig.errors import BadInputError
from rig.plan.config import load_config
from rig_shared.outputs import Output, Ratio, listed
from sim.config import Contact, FingertipConfig
from sim.contact.indentor import Indentor, Prismatic
from sim.contact.shapes import parse_shape
from sim.finger.mesh import LAYERS, POOR_SCALED_JACOBIAN, FingerMesh, MeshQuality, build_mesh, mesh_quality
from sim.finger.surface import FingertipSurface
from sim.finger.vtk import write_vtk
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM, place_receptors
from sim.models.condensed import young_ratios
from sim.models.fingertip import Fingertip
from sim.models.full_mesh import MeshedFinger, write_contact_deck, write_load_deck


class SkinJson(Output):
    """Fitted skin."""

    source: Literal["points", "published points", "sections"]
    count: int
    residual_rms_mm: float
    residual_max_mm: float
    worst_point_mm: NotRequired[list[float]]


class ApexJson(Output):
    """Highest point of the skin."""

    position_mm: list[float]
    lateral_radius_mm: float
    axial_radius_mm: float | None


class LayerJson(Output):
    """A layer under the apex; E over that of the epidermis."""

    name: Annotated[str, listed(LAYERS)]
    thickness_mm: float
    elements: int
    e_ratio: Ratio


class MeshQualityJson(Output):
    """Quality of the mesh and where it is worst."""

    folded: int
    poor: int
    smallest_scaled_jacobian: Ratio
    smallest_scaled_jacobian_at_mm: list[float]
    largest_aspect_ratio: Ratio
    largest_aspect_ratio_at_mm: list[float]


class MeshJson(Output):
    """Mesh of a finger."""

    layers: list[LayerJson]
    nodes: int
    elements: int
    patch_nodes: int
    receptor_plane_mm: float


class FingerJson(MeshJson):
    """Finger of a configuration."""

    skin: SkinJson
    apex: ApexJson
    quality: MeshQualityJson


@reporting_errors
def finger_command(
    config: FingertipOption = None,
    vtk: Annotated[Path | None, option("Write the mesh to a new VTK file.", "FILE.vtk")] = None,
    as_json: JsonOption = False,
) -> None:
    """Print fit, apex, layers and mesh quality; reject a finger without a valid mesh."""
    if vtk is not None and vtk.exists():
        raise BadInputError(f"--vtk {vtk}: the file already exists; choose another name", "exists_already")
    settings = load_config(config).finger
    with busy("fitting the skin and building the mesh …", quick=True):
        surface = FingertipSurface.fit(settings.geometry)
        place_receptors(surface, np.array(DEFAULT_X_MM), DEFAULT_DEPTH_MM, settings.receptor_plane_mm)
        mesh = build_mesh(settings, surface)
        quality = mesh_quality(mesh.nodes, mesh.hexes)
    if vtk is not None:
        with busy("writing the mesh …", quick=True):
            write_vtk(vtk, mesh, quality)
    found: FingerJson = {
        "skin": _skin(surface),
        "apex": _apex(surface),
        **_mesh(settings, mesh),
        "quality": _quality(quality),
    }
    if writes_json():
        print_json(found)
    else:
        _print(found)
    for doubt in _doubts(found, settings):
        complain(doubt)


def _skin(surface: FingertipSurface) -> SkinJson:
    geometry, points = surface.geometry, surface.points_mm
    if not len(points):
        return {"source": "sections", "count": len(geometry.sections), "residual_rms_mm": 0.0, "residual_max_mm": 0.0}
    residual = surface.residuals_mm()
    return {
        "source": "points" if geometry.points else "published points",
        "count": len(points),
        "residual_rms_mm": float(np.sqrt((residual**2).mean())),
        "residual_max_mm": float(residual.max()),
        "worst_point_mm": points[np.argmax(residual)].tolist(),
    }


def _apex(surface: FingertipSurface) -> ApexJson:
    apex = surface.apex
    radius = apex.axial_radius_mm
    return {
        "position_mm": list(apex.position_mm),
        "lateral_radius_mm": apex.lateral_radius_mm,
        "axial_radius_mm": radius if apex.inside and 0 < radius < np.inf else None,
    }


def _mesh(config: FingertipConfig, mesh: FingerMesh) -> MeshJson:
    column = mesh.column_at(np.pi / 2, config.receptor_plane_mm)
    layer = mesh.layer.reshape(mesh.element_grid.shape)[0, 0]
    thickness = np.bincount(layer, np.linalg.norm(np.diff(column, axis=0), axis=1), len(LAYERS))
    ratio = young_ratios(config.tissue)
    return {
        "layers": [
            {"name": name, "thickness_mm": thickness[k], "elements": int((layer == k).sum()), "e_ratio": ratio[k]}
            for k, name in enumerate(LAYERS)
            if (layer == k).any()
        ],
        "nodes": len(mesh.nodes),
        "elements": len(mesh.hexes),
        "patch_nodes": len(mesh.patch_nodes),
        "receptor_plane_mm": config.receptor_plane_mm,
    }


def _quality(quality: MeshQuality) -> MeshQualityJson:
    flattest, longest = int(np.argmin(quality.scaled_jacobian)), int(np.argmax(quality.aspect_ratio))
    return {
        "folded": 0,
        "poor": int((quality.scaled_jacobian < POOR_SCALED_JACOBIAN).sum()),
        "smallest_scaled_jacobian": quality.scaled_jacobian[flattest],
        "smallest_scaled_jacobian_at_mm": quality.centroid_mm[flattest].tolist(),
        "largest_aspect_ratio": quality.aspect_ratio[longest],
        "largest_aspect_ratio_at_mm": quality.centroid_mm[longest].tolist(),
    }


def _print(found: FingerJson) -> None:
    skin, apex, quality = found["skin"], found["apex"], found["quality"]
    out.print(f"skin     {skin['count']} {skin['source']}")
    if "worst_point_mm" in skin:
        out.print(
            f"  residuals       rms {skin['residual_rms_mm']:.3f} mm, largest {skin['residual_max_mm']:.3f} mm "
            f"at {_place(skin['worst_point_mm'])}"
        )
    axial = apex["axial_radius_mm"]
    out.print(f"  apex            {_place(apex['position_mm'])}")
    out.print(
        f"  apex radii      {apex['lateral_radius_mm']:.2f} mm laterally, "
        f"{'none' if axial is None else f'{axial:.2f} mm'} axially"
    )
    out.print("layers   under the apex, along the ray to the bone's axis")
    for layer in found["layers"]:
        out.print(
            f"  {layer['name']:<16}{layer['thickness_mm']:.2f} mm, {layer['elements']} elements, "
            f"E ratio {layer['e_ratio']:g}"
        )
    out.print(f"mesh     {found['nodes']} nodes, {found['elements']} elements, {found['patch_nodes']} patch nodes")
    for name, value, at_mm in (
        (
            "scaled Jacobian",
            f"smallest {quality['smallest_scaled_jacobian']:.2f}",
            quality["smallest_scaled_jacobian_at_mm"],
        ),
        ("aspect ratio", f"largest {quality['largest_aspect_ratio']:.2f}", quality["largest_aspect_ratio_at_mm"]),
    ):
        out.print(f"  {name:<16}{value} at {_place(at_mm)}")
    out.print("  folded          none")


def _place(position_mm: list[float]) -> str:
    x, y, z = position_mm
    return f"({x:.2f}, {y:.2f}, {z:.2f}) mm"


def _doubts(found: FingerJson, config: FingertipConfig) -> Iterator[str]:
    """Yield warnings, which are no errors but worth a check."""
    skin, quality, spacing = found["skin"], found["quality"], config.mesh.spacing_mm
    if skin["residual_max_mm"] > spacing:
        yield (
            f"the point {_place(skin['worst_point_mm'])} lies {skin['residual_max_mm']:.2f} mm from the fitted skin, "
            f"more than the node spacing, {spacing:g} mm; check the point"
        )
    if found["apex"]["axial_radius_mm"] is None:
        yield f"the skin is highest at {_place(found['apex']['position_mm'])}; it must fall towards both ends"
    if quality["poor"]:
        yield (
            f"{quality['poor']} elements have a scaled Jacobian below {POOR_SCALED_JACOBIAN}; the worst is "
            f"at {_place(quality['smallest_scaled_jacobian_at_mm'])}"
        )


@dataclass(frozen=True)
class ExportDeckRequest:
    """Options of `rig export-deck`."""

    shape: Annotated[str, option("Indentor along the finger, as in rig indent.", "S")]
    x_mm: Annotated[float, option("x of the indentor from the pad center, in mm.", "X")]
    doi_mm: Annotated[float, option("Depth of indentation (DOI), in mm.", "D")]
    out_file: Annotated[Path, option("CalculiX deck to write, a new file.", "FILE.inp", name="--out")]
    loads: Annotated[bool, option("Write the contact forces as loads instead of contact.", name="--loads")] = False
    config: FingertipOption = None


@takes(ExportDeckRequest)
def export_deck_command(request: ExportDeckRequest) -> None:
    """Solve the scene, write it for CalculiX, and print the expected result."""
    out_file = request.out_file
    if out_file.exists():
        raise BadInputError(f"--out {out_file}: the file already exists; choose another name", "exists_already")
    checked_file("--out", out_file, ".inp")
    indentor = parse_shape(request.shape)
    if not (isinstance(indentor, Prismatic) and indentor == Indentor.along(indentor.profile)):
        raise BadInputError(
            f"--shape {request.shape}: a deck supports only shapes that lie along the finger; choose one of them",
            "not_along",
        )
    settings = load_config(request.config).finger
    settings = settings.model_copy(update={"contact": Contact(between_nodes=False, patch_gb=0)})
    with busy(THE_FINGER):
        finger = Fingertip.load(settings)
    with busy(f"pressing {request.shape} …", quick=True):
        result = finger.indent(indentor, request.x_mm, doi_mm=request.doi_mm)
    meshed = MeshedFinger(settings, build_mesh(settings, finger.model.surface), finger.e_epidermis_mpa)
    with busy("writing the deck …", quick=True):
        if request.loads:
            active = result.state.active
            force = np.zeros((int(active.sum()), 3))
            force[:, :2] = result.state.force[:, active].T * finger.e_epidermis_mpa
            write_load_deck(out_file, meshed, meshed.mesh.patch_nodes[active], force)
        else:
            touch_mm = result.touch_height_mm
            write_contact_deck(out_file, meshed, indentor.profile, request.x_mm, touch_mm, request.doi_mm)
    if settings.mesh.element != "full":
        err.print('rig: CalculiX\'s C3D8 is fully integrated; to compare, set mesh.element = "full"')
    out.print(
        f"{out_file}: the expected total reaction is {-result.force_n:.6g} N along y; {result.small_strain.note}"
    )
