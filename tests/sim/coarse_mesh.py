"""Meshes of few nodes for tests, coarse below the skin; how fine they are at the skin each test says."""

from typing import Any

import tomlkit

from sim.config import MeshSpec

_BELOW_THE_SKIN = {
    "epidermis_elements": 1,
    "dermis_spacing_mm": 0.4,
    "dermis_fine_depth_mm": 0.5,
    "growth": 1.5,
    "far_growth": 2.0,
    "near_spacing_mm": 1.5,
    "near_width_mm": 0.5,
    "far_spacing_mm": 2.0,
}


def coarse_mesh(spacing_mm: float, axial_spacing_mm: float, **patch: float) -> MeshSpec:
    """Nodes so far apart at the skin, across and along the finger; the patch is the default's unless it is given."""
    told: dict[str, Any] = {**_BELOW_THE_SKIN, **patch}
    return MeshSpec(spacing_mm=spacing_mm, axial_spacing_mm=axial_spacing_mm, **told)


def as_toml(mesh: MeshSpec) -> str:
    """The table of a configuration file that gives it."""
    usual = MeshSpec().model_dump()
    keys = {name: value for name, value in mesh.model_dump().items() if value != usual[name]}
    return tomlkit.dumps({"finger": {"mesh": keys}})
