"""Parameters of the fingertip model: every number that the source leaves free, with its default and unit.

Values marked [free] are not in Raju (1998); `docs/model.md` explains each default.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from sim.errors import ArgumentError
from sim.tables import Row, read_columns

# --- measured skin ---

Array = NDArray[np.float64]

POINT_COLUMNS = ("x_mm", "y_mm", "z_mm")
SECTION_COLUMNS = ("z_mm", "half_width_mm", "height_mm", "lean_mm")

FEWEST_POINTS = 12
MOST_POINTS = 10_000
FEWEST_SECTIONS = 5

_NARROWEST_MM, _WIDEST_MM = 2.0, 60.0
_WIDEST_SHAPE = 1.8  # half-width over height above the bone's axis
_LEAST_SPREAD = 0.5  # of the finger's length, along z; the published points span 0.58
_WIDEST_GAP = 0.25  # of the finger's length, along z; the published points leave 0.14
_LEAST_SIDE = 0.05  # of the finger's length, to either side of x = 0


def rows_from(value: object, columns: Sequence[str], folder: Path) -> object:
    """Read the rows of a CSV file if the value is a path, relative to a folder; return other values unchanged."""
    return read_columns(folder / value, columns) if isinstance(value, str) else value


def check_points(points: Sequence[Row], length_mm: float) -> None:
    """Raise ValueError when (x, y, z) rows in mm do not describe the pulp of a finger."""
    if not FEWEST_POINTS <= len(points) <= MOST_POINTS:
        raise ValueError(f"{len(points)} points; must be {FEWEST_POINTS} to {MOST_POINTS}")
    xyz = np.array(points)
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    spans = " × ".join(f"{span:.3g}" for span in high - low)
    if not _NARROWEST_MM <= (high - low).max() <= _WIDEST_MM:
        raise ValueError(
            f"the points span {spans} mm; the largest span must be {_NARROWEST_MM:g} to "
            f"{_WIDEST_MM:g} mm; check the unit"
        )
    if low[2] < 0 or high[2] > length_mm:
        raise ValueError(
            f"z spans {low[2]:.2f} to {high[2]:.2f} mm; it must lie between 0, the proximal edge, and "
            f"length_mm = {length_mm:g} mm"
        )
    z = np.sort(xyz[:, 2])
    if z[-1] - z[0] < _LEAST_SPREAD * length_mm:
        raise ValueError(
            f"z spans {z[0]:.2f} to {z[-1]:.2f} mm; points must cover at least "
            f"{_LEAST_SPREAD * length_mm:.2f} mm of z, half of length_mm = {length_mm:g} mm"
        )
    gap = int(np.argmax(np.diff(z)))
    if z[gap + 1] - z[gap] > _WIDEST_GAP * length_mm:
        raise ValueError(
            f"no points from z = {z[gap]:.2f} to {z[gap + 1]:.2f} mm; gaps must not exceed "
            f"{_WIDEST_GAP * length_mm:.2f} mm, a quarter of length_mm = {length_mm:g} mm"
        )
    side = _LEAST_SIDE * length_mm
    if low[0] > -side or high[0] < side:
        raise ValueError(
            f"x spans {low[0]:.2f} to {high[0]:.2f} mm; points must lie on both sides of the midline x = 0, "
            f"to at least {side:.2f} mm from it"
        )
    if high[1] < _NARROWEST_MM / 2:
        raise ValueError(f"highest y = {high[1]:.2f} mm; y must point from the bone's axis to the skin of the pulp")


def check_sections(sections: Sequence[Row], length_mm: float) -> None:
    """Raise ValueError when (z, half-width, height, lean) rows in mm do not describe a finger."""
    if len(sections) < FEWEST_SECTIONS:
        raise ValueError(f"{len(sections)} sections; at least {FEWEST_SECTIONS} are required")
    z, half_width, height, _ = np.array(sections).T
    back = np.flatnonzero(np.diff(z) <= 0)
    if len(back):
        raise ValueError(f"z_mm = {z[back[0] + 1]:g} after {z[back[0]]:g}: z_mm must rise from row to row")
    if z[-1] < _NARROWEST_MM:
        raise ValueError(f"z_mm ends at {z[-1]:g} mm; it must be in millimeters; check the unit")
    if abs(z[0]) > 1e-6 * length_mm or abs(z[-1] - length_mm) > 1e-6 * length_mm:
        raise ValueError(
            f"z_mm spans {z[0]:g} to {z[-1]:g} mm; it must span 0, the proximal edge, to length_mm = {length_mm:g} mm"
        )
    for name, values in (("half_width_mm", half_width), ("height_mm", height)):
        if (values <= 0).any():
            k = int(np.argmax(values <= 0))
            raise ValueError(f"{name} = {values[k]:g} at z_mm = {z[k]:g}: must be more than 0 mm")
    if np.median(half_width / height) > _WIDEST_SHAPE:
        raise ValueError(
            f"half_width_mm is {np.median(half_width / height):.2f} times height_mm (median); a finger's is at most "
            f"{_WIDEST_SHAPE:g} times: check that it is half of the width"
        )


# --- stiffness ---
#
# One number converts pseudo-units to MPa.

E_EPIDERMIS_MPA = 0.186266
"""Young's modulus of the epidermis (MPa).

Raju (1998) states only ratios of E. His step 1 at x = −1.63 mm, pressed 0.73 mm deep, corresponds to 8 gwt; on the
default mesh E(epidermis) follows from that. Other geometries and meshes use the same value.
"""


class _Many(int):
    """Number of rows in a repr."""

    def __repr__(self) -> str:
        return f"<{int(self)} rows>"


def _as_tuples(value: object) -> object:
    """Return a value with tuples in place of lists, also within rows."""
    return tuple(map(_as_tuples, value)) if isinstance(value, list) else value


class _Settings(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    @field_validator("*", mode="before")
    @classmethod
    def _rows(cls, value: object) -> object:
        return _as_tuples(value)

    def __repr_args__(self) -> Iterator[tuple[str | None, object]]:
        """Yield fields that differ from their defaults; many rows as their number."""
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            if value != field.default:
                yield name, _Many(len(value)) if isinstance(value, tuple) else value


class Geometry(_Settings):
    """Shape of the finger; lengths in mm.

    These numbers are free: the 24 published points of the source say nothing about them (`docs/model.md`). `points`
    or `sections` replace the published points. Each is a list of rows, or the path of a CSV file relative to the
    validation context's `folder`; only the numbers are stored.

    Notes
    -----
    Published points: Raju (1998, Figure 6-3).

    Examples
    --------
    >>> from sim import Geometry
    >>> Geometry(length_mm=14.0)
    Geometry(length_mm=14.0)
    """

    length_mm: float = Field(
        default=12.75, gt=10, lt=30, description="length of the fingertip from its proximal edge to the tip"
    )
    proximal_apex_mm: float = Field(default=2.6, gt=0.5, lt=8, description="height of the top profile at z = 0")
    proximal_half_width_mm: float = Field(
        default=3.4, gt=0.5, lt=10, description="half-width of the section at z = 0"
    )
    proximal_lean_mm: float = Field(default=-0.6, gt=-3, lt=3, description="lateral shift of the pulp at z = 0")
    tip_radius_mm: float = Field(
        default=1.0, gt=0.2, lt=4, description="radius of the blunt section at the distal tip"
    )
    nail_depth_ratio: float = Field(
        default=0.75, gt=0.2, lt=2, description="depth of the nail side relative to the height of the pulp"
    )
    stiffness_of_fit: float = Field(
        default=0.06, gt=0, lt=10, description="weight of the surface's second derivatives in its fit to points"
    )
    points: tuple[tuple[float, float, float], ...] = Field(
        default=(),
        description=(
            "x, y, z of points on the skin of the pulp, instead of the published points: rows or a CSV file"
        ),
    )
    sections: tuple[tuple[float, float, float, float], ...] = Field(
        default=(), description="z, half-width, height and lean of sections, instead of points: rows or a CSV file"
    )

    @field_validator("points", "sections", mode="before")
    @classmethod
    def _numbers(cls, value: object, info: ValidationInfo) -> object:
        folder = Path((info.context or {}).get("folder", "."))
        return rows_from(value, POINT_COLUMNS if info.field_name == "points" else SECTION_COLUMNS, folder)

    @field_validator("points", "sections")
    @classmethod
    def _usable(cls, rows: tuple[Any, ...], info: ValidationInfo) -> tuple[Any, ...]:
        if rows and info.data.get("points"):
            raise ValueError("points and sections cannot be combined; keep one")
        if rows and "length_mm" in info.data:
            (check_points if info.field_name == "points" else check_sections)(rows, info.data["length_mm"])
        return rows


class Tissue(_Settings):
    """Layers of the finger, from the outside in.

    Notes
    -----
    Ratios of Young's moduli and Poisson's ratio: Raju (1998, ch. 3). Thicknesses are free.

    Examples
    --------
    >>> from sim import Tissue
    >>> Tissue(e_fat=0.05)
    Tissue(e_fat=0.05)
    >>> round(Tissue(stiffness=2.0).e_epidermis_mpa, 6)
    0.372532
    """

    epidermis_mm: float = Field(default=0.4, gt=0.05, lt=1.0, description="thickness of the outermost layer")
    dermis_mm: float = Field(
        default=0.8, gt=0.1, lt=2.0, description="thickness of the layer below the epidermis; fat fills the rest"
    )
    bone_fraction: float = Field(
        default=0.32, gt=0.05, lt=0.6, description=("radius of the bone relative to the radius of the section")
    )
    e_dermis: float = Field(
        default=0.1, gt=1e-6, le=10, description=("Young's modulus of the dermis relative to the epidermis")
    )
    e_fat: float = Field(default=0.1, gt=1e-6, le=10, description="Young's modulus of fat relative to the epidermis")
    e_bone: float = Field(
        default=1.0e4, ge=1, le=1e10, description="Young's modulus of an elastic bone relative to the epidermis"
    )
    poisson: float = Field(default=0.48, ge=0, lt=0.5, description="Poisson's ratio of all layers")
    bone: Literal["rigid", "elastic"] = Field(default="rigid", description="rigid: fixed; elastic: meshed")
    nail_arc_deg: float = Field(default=140.0, ge=0, le=200, description="dorsal arc of skin that is fixed")
    nail_from_z_mm: float = Field(
        default=5.0, ge=0, le=20, description="distance of the nail's proximal end from the proximal edge"
    )
    stiffness: float = Field(
        default=1.0, gt=0, le=100, description="Young's modulus of all layers relative to the calibrated one"
    )
    strain: Literal["small", "finite"] = Field(
        default="small", description="small: linear model; finite: force and energy at finite strain"
    )
    stiffening: float = Field(
        default=0.0, ge=0, le=10, description="increase of stiffness with strain; requires finite strain"
    )

    @model_validator(mode="before")
    @classmethod
    def _strain_of(cls, values: Any) -> Any:
        """Set the strain that a stiffening implies; 0 implies none, unless an earlier version wrote every key."""
        if not isinstance(values, dict) or "strain" in values or "stiffening" not in values:
            return values
        if values["stiffening"] != 0:
            return {"strain": "finite", **values}
        if cls.model_fields.keys() - values.keys() != {"strain"}:
            raise ValueError(
                'stiffening = 0 requires strain: "finite" is the limit of small stiffening, "small" the linear '
                "model, which is also the default and what 0 alone meant before"
            )
        return values

    @model_validator(mode="after")
    def _stiffens_at_finite_strain(self) -> Self:
        if self.strain == "small" and self.stiffening > 0:
            raise ValueError(f'stiffening = {self.stiffening:g} requires strain = "finite"')
        return self

    @property
    def finite_stiffening(self) -> float | None:
        """Stiffening of the model at finite strain; None at small strain."""
        return self.stiffening if self.strain == "finite" or self.stiffening > 0 else None

    @property
    def e_epidermis_mpa(self) -> float:
        """Young's modulus of the epidermis (MPa)."""
        return E_EPIDERMIS_MPA * self.stiffness


MESH_LEVELS: dict[str, dict[str, float]] = {
    "coarse": {"spacing_mm": 0.28, "axial_spacing_mm": 0.473},
    "default": {},
    "fine": {
        "spacing_mm": 0.1,
        "axial_spacing_mm": 0.236,
        "epidermis_elements": 3,
        "dermis_spacing_mm": 0.133,
    },
}
"""Keys that a level sets unless the configuration does. Error against time: docs/validation/performance.md."""

EVEN_LEVELS: dict[str, dict[str, float]] = {
    "coarse": {"spacing_mm": 0.28, "axial_spacing_mm": 0.27},
    "fine": {"spacing_mm": 0.125, "axial_spacing_mm": 0.126},
}
"""Spacings of a level under shapes that slope along the finger: the same along it as across."""


AXIAL_STRETCH = 1.855
"""Axial over lateral spacing, chosen by error and time; at the default spacing a row lies at the start of the
nail."""


class MeshSpec(_Settings):
    """Sizes of elements in mm; `patch_*` limits the skin that an indentor may touch.

    A quadratic element has nodes half way too.

    Examples
    --------
    >>> from sim import MeshSpec
    >>> MeshSpec(level="coarse").spacing_mm
    0.28
    """

    level: Literal["coarse", "default", "fine"] = Field(
        default="default", description="coarse: fast; fine: for sharp shapes; sets the spacings that are not given"
    )
    spacing_mm: float = Field(
        default=0.17, gt=0.02, le=1.0, description="size of elements across the finger, on the pulp"
    )
    axial_spacing_mm: float | None = Field(
        default=None, gt=0.02, le=1.0, description="size of elements along the finger; default: 1.855 × spacing_mm"
    )
    patch_x_mm: float = Field(
        default=3.3,
        gt=0.5,
        le=4.0,
        description="half-width, across the finger, of the skin that an indentor can touch; grows as needed",
    )
    patch_z_mm: float = Field(
        default=3.5, gt=0.5, le=4.5, description="half-width along the finger, from the receptor plane"
    )
    round_patch_mm: float = Field(
        default=2.5,
        gt=0.3,
        le=4.5,
        description="half-width of the area that a sphere, a cone or a round punch can touch",
    )
    epidermis_elements: int = Field(default=2, ge=1, le=8, description="number of elements through the epidermis")
    dermis_spacing_mm: float = Field(
        default=0.2,
        gt=0.02,
        le=1.0,
        description=("size of elements in depth, from the epidermis to dermis_fine_depth_mm"),
    )
    dermis_fine_depth_mm: float = Field(
        default=1.2, gt=0.2, le=3.0, description="depth below the skin from which elements grow"
    )
    growth: float = Field(
        default=1.2, gt=1.0, le=2.0, description="growth from one element to the next, near the patch and in depth"
    )
    far_growth: float = Field(
        default=1.5, gt=1.0, le=3.0, description=("growth from one element to the next, farther from the patch")
    )
    near_spacing_mm: float = Field(
        default=0.5, gt=0.05, le=2.0, description=("largest element just outside the patch")
    )
    near_width_mm: float = Field(
        default=1.5, gt=0, le=5.0, description=("distance from the patch within which near_spacing_mm applies")
    )
    far_spacing_mm: float = Field(default=1.5, gt=0.05, le=3.0, description="largest element farther from the patch")
    nail_on_nodes: bool = Field(default=True, description="add a row of nodes along each edge of the nail")
    element: Literal["bbar", "full", "incompatible", "quadratic"] = Field(
        default="bbar",
        description="bbar: as in the source; full and incompatible: for comparison; quadratic: with mid-edge nodes",
    )

    @model_validator(mode="before")
    @classmethod
    def _levelled(cls, values: Any) -> Any:
        return {**MESH_LEVELS.get(str(values.get("level")), {}), **values} if isinstance(values, dict) else values

    @property
    def axial_mm(self) -> float:
        """Spacing along the finger on the pulp (mm), under shapes that are prismatic along it."""
        return AXIAL_STRETCH * self.spacing_mm if self.axial_spacing_mm is None else self.axial_spacing_mm


class Contact(_Settings):
    """Where contact is enforced."""

    between_nodes: bool = Field(
        default=True, description="enforce contact between the nodes too, under sharp corners"
    )
    patch_gb: float = Field(
        default=6.0,
        ge=0,
        le=1000,
        description="memory for a patch larger than the mesh's own; 0: an indentor that leaves the patch is refused",
    )


class FingertipConfig(_Settings):
    """A fingertip: geometry, tissue, mesh and contact.

    Every number has a default, and a repr shows what differs.

    Examples
    --------
    >>> from sim import FingertipConfig, Tissue
    >>> FingertipConfig(tissue=Tissue(e_fat=0.05))
    FingertipConfig(tissue=Tissue(e_fat=0.05))
    """

    geometry: Geometry = Geometry()
    tissue: Tissue = Tissue()
    mesh: MeshSpec = MeshSpec()
    contact: Contact = Contact()
    receptor_plane_from_tip_mm: float = Field(
        default=5.857, gt=1, lt=12, description="distance of the receptor plane from the tip; Raju (1998): 5.86 mm"
    )

    @property
    def receptor_plane_mm(self) -> float:
        """Position of the receptor plane along the finger (mm from the proximal edge, 6.893 by default)."""
        return self.geometry.length_mm - self.receptor_plane_from_tip_mm


def finger_config(config: FingertipConfig | None) -> FingertipConfig:
    """Return a configuration, by default that of the default finger. Raises ArgumentError."""
    if config is None:
        return FingertipConfig()
    if not isinstance(config, FingertipConfig):
        raise ArgumentError(
            f"config: must be a FingertipConfig, not {type(config).__name__}; "
            "rig.plan.config.load_config(Path(FILE)).finger is that of a configuration file",
            "no_finger_config",
        )
    return config
