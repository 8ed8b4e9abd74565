"""What may solve a scene: a model, its element and how fine it is."""

from dataclasses import dataclass, field

from sim.config import FingertipConfig, MeshSpec
from sim.models import ModelName

SCENE_PATCH = {"patch_x_mm": 2.4, "patch_z_mm": 2.3}
"""Enough for every scene of the study."""


@dataclass(frozen=True)
class Candidate:
    """One way to solve the scenes."""

    model: ModelName
    refinement: str
    mesh: MeshSpec = field(default_factory=MeshSpec)

    @property
    def element(self) -> str:
        """ "bbar", "full" or, for a half-space, "analytic"."""
        return "analytic" if self.model == "halfspace" else self.mesh.element

    @property
    def config(self) -> FingertipConfig:
        """The default finger on this mesh."""
        return FingertipConfig(mesh=self.mesh)


def nested(n: int, **other: float | str) -> MeshSpec:
    """A mesh of the family that is refined evenly: n elements through the epidermis, and cubes of that size."""
    spacing = 0.4 / n
    fixed = {"spacing_mm": spacing, "epidermis_elements": n, "dermis_spacing_mm": spacing, "near_spacing_mm": 1 / n}
    return MeshSpec.model_validate({**SCENE_PATCH, **fixed, **other})


def coarse(spacing_mm: float, element: str = "bbar") -> MeshSpec:
    """A mesh for seconds: lateral and axial spacing, and the default depths."""
    return MeshSpec.model_validate({**SCENE_PATCH, "spacing_mm": spacing_mm, "element": element})
