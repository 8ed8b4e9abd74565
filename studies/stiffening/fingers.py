"""The fingers that are pressed at finite strain, on coarse meshes whose patch holds the deepest press."""

import tomllib
from pathlib import Path
from typing import Any, NamedTuple

from sim.config import Contact, FingertipConfig
from sim.models.sources import HalfWidths, widened

HUMAN = Path(__file__).parents[2] / "examples" / "human_finger" / "finger.toml"

_FEW: dict[str, Any] = {
    "epidermis_elements": 1,
    "growth": 1.5,
    "far_growth": 2.0,
    "near_width_mm": 0.5,
    "near_spacing_mm": 0.8,
}


class StudyFinger(NamedTuple):
    """A finger of the study: what its mesh sets, the patch that holds its presses, and how deep it is pressed."""

    told: dict[str, Any]
    mesh: dict[str, Any]
    patch_mm: HalfWidths | None
    deepest_mm: float


def _human() -> dict[str, Any]:
    told: dict[str, Any] = tomllib.loads(HUMAN.read_text("utf-8"))["finger"]
    return {name: values for name, values in told.items() if name != "mesh"}


_DEFAULT = StudyFinger(
    {}, {"spacing_mm": 0.35, "axial_spacing_mm": 0.6, **_FEW, "dermis_spacing_mm": 0.4}, (3.75, 4.8), 2.0
)
_HUMAN = StudyFinger(
    _human(),
    {"spacing_mm": 0.7, "axial_spacing_mm": 1.0, **_FEW, "near_spacing_mm": 1.4}
    | {"far_spacing_mm": 2.5, "dermis_spacing_mm": 0.6},
    (6.0, 9.0),
    3.0,
)


def _layered(pressed: StudyFinger, e_dermis: float, e_fat: float) -> StudyFinger:
    tissue = {**pressed.told.get("tissue", {}), "e_dermis": e_dermis, "e_fat": e_fat}
    return pressed._replace(told={**pressed.told, "tissue": tissue})


FINGERS: dict[str, StudyFinger] = {
    "default": _DEFAULT,
    "human": _HUMAN,
    "other moduli": _layered(_DEFAULT, 0.2, 0.05),
    "soft skin": _layered(_DEFAULT, 0.08, 0.15),
    "stiff skin": _layered(_DEFAULT, 0.3, 0.04),
    "firm throughout": _layered(_DEFAULT, 0.3, 0.2),
    "soft throughout": _layered(_DEFAULT, 0.07, 0.04),
    "human, soft fat": _layered(_HUMAN, 0.2, 0.05),
}
"""Moduli as the meeting's prior holds them: the skin's and the fat's together and against one another."""


def finger(name: str, **tissue: Any) -> FingertipConfig:
    """One of them; its tissue changed."""
    pressed = FINGERS[name]
    if "stiffening" in tissue:
        tissue = {"strain": "finite", **tissue}
    told = {**pressed.told, "mesh": pressed.mesh, "tissue": {**pressed.told.get("tissue", {}), **tissue}}
    config = FingertipConfig.model_validate(told, context={"folder": HUMAN.parent})
    unsharp = config.model_copy(update={"contact": Contact(between_nodes=False)})
    return widened(unsharp, pressed.patch_mm)


def deepest_mm(name: str) -> float:
    """As far as a finger is to be pressed."""
    return FINGERS[name].deepest_mm
