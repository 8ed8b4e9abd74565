"""What may solve a scene: a model, its element and how fine it is."""

from dataclasses import dataclass, field

from sim.config.fingertip_config import FingertipConfig, MeshSpec
from sim.contact.indentor import ALONG
from sim.models.catalogue import ModelName

SCENE_PATCH = {"patch_x_mm": 2.4, "patch_z_mm": 2.3}
"""Enough for every scene."""

_TO_NAIL_MM = 6.893 - 5.0 - 1e-6
_ROWS = {1: 3, 2: 5, 3: 7, 4: 9, 5: 9, 8: 9}

LEVELS = ("coarse", "default", "fine")
"""Of the finger's mesh, from cheap to dear."""

SHARES = (0.65, 1.0)
"""How much of the default patch's half-widths a patch may have: a few, so that scenes share models."""

_EVEN = {
    "coarse": {"axial_spacing_mm": 0.27},
    "default": {},
    "fine": {"spacing_mm": 0.125, "axial_spacing_mm": 0.126},
}
"""Of a level under shapes that slope along the finger, too: as far apart along it as across."""


@dataclass(frozen=True)
class Candidate:
    """One way to solve the scenes."""

    model: ModelName
    refinement: str
    mesh: MeshSpec = field(default_factory=MeshSpec)

    @property
    def element(self) -> str:
        """Of the mesh; for a half-space "analytic"."""
        return "analytic" if self.model == "halfspace" else self.mesh.element

    @property
    def config(self) -> FingertipConfig:
        """The default finger on this mesh."""
        return FingertipConfig(mesh=self.mesh)


def of_level(model: ModelName, level: str, axes: tuple[int, ...], share: float) -> Candidate:
    """A level's mesh for shapes that slope along some axes, on a share of the default patch."""
    usual = MeshSpec()
    sizes = {name: share * getattr(usual, name) for name in ("patch_x_mm", "patch_z_mm", "round_patch_mm")}
    given = {"level": level, **({} if axes == ALONG else _EVEN[level]), **sizes}
    return Candidate(model, level, MeshSpec.model_validate(given))


def nested(n: int, **other: float | str | bool) -> MeshSpec:
    """A mesh of the family that is refined evenly everywhere, with n elements through the epidermis.

    Lateral spacing and depths are those elements' size, axial spacing about twice that: _ROWS[n] rows of nodes from
    the receptor plane to the nail's edge, so that the skin is held at the same places on every mesh.
    """
    spacing = 0.4 / n
    evenly = {
        "spacing_mm": spacing,
        "axial_spacing_mm": _TO_NAIL_MM / _ROWS[n],
        "epidermis_elements": n,
        "dermis_spacing_mm": spacing,
        "growth": 1.2 ** (2 / n),
        "far_growth": 1.5 ** (2 / n),
        "near_spacing_mm": 1 / n,
        "far_spacing_mm": 3 / n,
    }
    return MeshSpec.model_validate({**SCENE_PATCH, **evenly, **other})


def coarse(spacing_mm: float, element: str = "bbar") -> MeshSpec:
    """A mesh for seconds: lateral spacing, twice that along the finger, and the default depths."""
    given = {"spacing_mm": spacing_mm, "axial_spacing_mm": 2 * spacing_mm, "element": element}
    return MeshSpec.model_validate({**SCENE_PATCH, **given})


QUADRATIC = MeshSpec.model_validate(
    {
        **SCENE_PATCH,
        "element": "quadratic",
        "spacing_mm": 0.34,
        "epidermis_elements": 1,
        "dermis_spacing_mm": 0.4,
        "growth": 1.2**2,
        "far_growth": 1.5**2,
        "near_spacing_mm": 1.0,
        "far_spacing_mm": 3.0,
    }
)
"""Elements of twice the default's size: nodes as far apart as the default's."""
