"""Scenes drawn at random: the mix of `studies/accuracy/random_poses.py`, some of it turned."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from sim.cheapest_model import DEPTHS_MM, FAMILIES, PLACES_MM, Cell, Situation, cell_of, family_of
from sim.config import FingertipConfig
from sim.contact.indentor import Indentor
from sim.contact.patch import X
from studies.accuracy import random_poses

CONFIG = FingertipConfig()
PLANE_MM = CONFIG.receptor_plane_mm

_ACROSS, _TURNED = 0.2, 0.3
_AWAY_MM = 1.5
_SHALLOWEST_MM = 0.1
_MOST_DRAWS = 2000


@dataclass(frozen=True)
class DrawnScene:
    """An indentor at a place, to a depth or a force."""

    indentor: Indentor
    x_mm: float
    z_mm: float | None
    doi_mm: float | None
    force_gwt: float | None

    @property
    def situation(self) -> Situation:
        """By the undeformed skin."""
        return Situation.of(self.indentor, self.x_mm, self.z_mm, self.doi_mm, CONFIG)


def drawn(rng: np.random.Generator) -> DrawnScene:
    """One scene; a fifth of what lies along the finger is turned across it, a tenth to any angle."""
    pose = random_poses.draw(rng)
    turn, z_mm = float(rng.random()), PLANE_MM + float(rng.uniform(-_AWAY_MM, _AWAY_MM))
    indentor, x_mm, z = pose.indentor, pose.x_mm, pose.z_mm
    if pose.family in random_poses.PRISMATIC and turn < _TURNED:
        across = turn < _ACROSS
        indentor, z = indentor.turned(90.0 if across else float(rng.uniform(15, 75))), z_mm
        x_mm = 0.0 if across else float(rng.uniform(-_AWAY_MM, _AWAY_MM))
    elif z is not None and X in indentor.axes:
        x_mm, z = float(rng.uniform(-_AWAY_MM, _AWAY_MM)), z_mm
    return DrawnScene(indentor, x_mm, z, pose.doi_mm, None)


def stratified(each: int, seed: int) -> list[DrawnScene]:
    """So many scenes in every cell of the table, their depths drawn evenly within its band."""
    rng, found = np.random.default_rng(seed), []
    for family, depth, place in product(FAMILIES, range(len(DEPTHS_MM)), PLACES_MM):
        cell, missing = Cell(family, DEPTHS_MM[depth], place), each
        shallowest = DEPTHS_MM[depth - 1] if depth else _SHALLOWEST_MM
        for _ in range(_MOST_DRAWS):
            scene = drawn(rng)
            if family_of(scene.indentor) == family:
                scene = replace(scene, doi_mm=float(rng.uniform(shallowest, cell.depth_mm)))
                if cell_of(scene.situation) == cell:
                    found.append(scene)
                    missing -= 1
            if not missing:
                break
    return found
