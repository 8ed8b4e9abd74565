"""Outlines that a page draws: the finger where it is cut, and the indentor in front of it. Lists of [x, z] in mm."""

import math

import numpy as np
from numpy.typing import NDArray

from sim.config import FingertipConfig
from sim.contact.indentor import Indentor
from sim.contact.patch import X, Z
from sim.finger.mesh import nodes_on_rays, order_of
from sim.finger.surface import FingertipSurface

Array = NDArray[np.float64]
Line = list[list[float]]

HIGHEST_MM = 2.0
"""Above its lowest point no more of an indentor is drawn."""
_REACH_MM, _STEP_MM = 8.0, 0.02
_ANGLES = 181
_DIGITS = 4


def finger_outlines(
    config: FingertipConfig, surface: FingertipSurface, z_mm: float, apex_mm: float
) -> dict[str, Line | list[Line]]:
    """Skin, layers below it, bone and nail of the section at z; heights from the nominal apex, at `apex_mm`."""
    phi = np.linspace(-math.pi, math.pi, _ANGLES)
    nodes, layer = nodes_on_rays(config, surface, phi, np.array([z_mm]))
    changes = np.flatnonzero(np.diff(layer)) + 1
    ends = order_of(config.mesh) * np.append(changes, len(layer))
    rings = [points(nodes[0, :, end, 0], nodes[0, :, end, 1] - apex_mm) for end in ends[:3]]
    skin = points(nodes[0, :, 0, 0], nodes[0, :, 0, 1] - apex_mm)
    return {"skin": skin, "layers": rings[:2], "bone": rings[2], "nail": _nail(config, surface, z_mm, apex_mm)}


def _nail(config: FingertipConfig, surface: FingertipSurface, z_mm: float, apex_mm: float) -> Line:
    """Where the skin is held still; nothing where the section has no nail."""
    if z_mm < config.tissue.nail_from_z_mm or config.tissue.nail_arc_deg <= 0:
        return []
    half = math.radians(0.5 * config.tissue.nail_arc_deg)
    x, y = surface.section(np.linspace(-0.5 * math.pi - half, -0.5 * math.pi + half, _ANGLES), z_mm)
    return points(x, y - apex_mm)


def indentor_outline(indentor: Indentor) -> Line:
    """The indentor cut through its reference point, across the finger; its lowest point is at height 0."""
    s = np.arange(-_REACH_MM, _REACH_MM + 0.5 * _STEP_MM, _STEP_MM)
    offset = {X: s, Z: np.zeros_like(s)}
    height = indentor.evaluate(np.stack([offset[axis] for axis in indentor.axes])).height_mm
    height = np.minimum(height - min(float(height.min()), 0.0), HIGHEST_MM)
    low = np.flatnonzero(height < HIGHEST_MM)
    if not len(low):
        return []
    cut = slice(max(low[0] - 1, 0), low[-1] + 2)
    s, height = s[cut], height[cut]
    bent = np.ones(len(s), dtype=bool)
    bent[1:-1] = np.abs(np.diff(height, 2)) > 1e-9
    return points(s[bent], height[bent])


def points(x: Array, z: Array) -> Line:
    """As a page takes them."""
    return np.round(np.stack([x, z], axis=1), _DIGITS).tolist()
