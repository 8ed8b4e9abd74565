"""Simulator of a finite-element fingertip, and virtual devices with the protocols of real ones.

    from sim import Fingertip
    result = Fingertip.load().indent("bar:3.0", doi_mm=1.0)

Public names are listed here and imported on first use; `docs/library.md` shows examples.

From the bottom up, each package using only those above it in this list:

- `errors`, `units`, `tables`, `workers`, `announce`; `config`: parameters of a fingertip, measured skin.
- `fem`: elements and condensation. `contact`: rigid shapes on condensed skin. `devices`: virtual instruments and
  their clock; `devices/grbl` is the board.
- `finger`: geometry and mesh of the skin and tissue.
- `measures`: receptors under the skin, their strain, the 18 measures.
- `models`: finger, section and half-space with one interface; start at `models/catalogue.py`.
- `identification`: finger parameters from a few presses. `coding`: pressure on the skin to receptors, and back.
- `carriage` and `plant`: stage and finger under the virtual devices. `serve`: the same in real time, behind ports.
- `benchmark` and `cheapest_model`: cost and error of each model, and the cheapest one for a task.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from sim import announce as _announcing

if TYPE_CHECKING:
    from sim.cheapest_model import Aim, Choice, NoModelError, choose
    from sim.config import FingertipConfig, Geometry, MeshSpec, Tissue
    from sim.contact.height_map import HeightMap, HeightMapError
    from sim.contact.indentor import Indentor, ShapeWarning
    from sim.contact.measured_profile import MeasuredProfile, ProfileError
    from sim.contact.shapes import ShapeError, parse_shape
    from sim.errors import ForceOutOfReachError, ModelRangeError
    from sim.measures.measures import MEASURES
    from sim.measures.receptors import ReceptorError
    from sim.models.catalogue import load
    from sim.models.fingertip import Fingertip
    from sim.models.many_indentations import WorkerLostError, indent_many
    from sim.models.result import IndentationResult, Indentations, PointLoadResult
    from sim.models.strain_at_points import Fields
    from sim.tables import NotInstalledError, to_pandas, to_xarray, write_csv

    __version__: str

_HOMES = {
    "sim.config": ("FingertipConfig", "Geometry", "MeshSpec", "Tissue"),
    "sim.contact.height_map": ("HeightMap", "HeightMapError"),
    "sim.contact.indentor": ("Indentor", "ShapeWarning"),
    "sim.contact.measured_profile": ("MeasuredProfile", "ProfileError"),
    "sim.contact.shapes": ("ShapeError", "parse_shape"),
    "sim.measures.measures": ("MEASURES",),
    "sim.measures.receptors": ("ReceptorError",),
    "sim.models.catalogue": ("load",),
    "sim.errors": ("ForceOutOfReachError", "ModelRangeError"),
    "sim.models.fingertip": ("Fingertip",),
    "sim.models.many_indentations": ("WorkerLostError", "indent_many"),
    "sim.models.strain_at_points": ("Fields",),
    "sim.models.result": ("IndentationResult", "Indentations", "PointLoadResult"),
    "sim.tables": ("NotInstalledError", "to_pandas", "to_xarray", "write_csv"),
    "sim.cheapest_model": ("Aim", "Choice", "NoModelError", "choose"),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "MEASURES",
    "Aim",
    "Choice",
    "Fields",
    "Fingertip",
    "FingertipConfig",
    "ForceOutOfReachError",
    "Geometry",
    "HeightMap",
    "HeightMapError",
    "IndentationResult",
    "Indentations",
    "Indentor",
    "MeasuredProfile",
    "MeshSpec",
    "ModelRangeError",
    "NoModelError",
    "NotInstalledError",
    "PointLoadResult",
    "ProfileError",
    "ReceptorError",
    "ShapeError",
    "ShapeWarning",
    "Tissue",
    "WorkerLostError",
    "__version__",
    "choose",
    "indent_many",
    "load",
    "parse_shape",
    "to_pandas",
    "to_xarray",
    "write_csv",
]


def __getattr__(name: str) -> Any:
    """Import a name on first use."""
    if name == "__version__":
        return import_module("importlib.metadata").version("indentation-rig")
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])


_announcing.announce()
