"""Random fingers: of the prior, and from outside it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from rig.identify.random_finger import truth_of, with_parameters
from rig.plan.config import Config
from sim.config import MeshSpec, Tissue
from sim.models.fingertip import Fingertip
from studies.identification.ogden import OgdenFinger

COARSER = MeshSpec(level="coarse", spacing_mm=0.34, axial_spacing_mm=0.6)
"""Mesh of the random fingers, unlike that of the identification."""

AS_FINE = MeshSpec(spacing_mm=0.2, axial_spacing_mm=0.3)
"""The same beside the default mesh. On the coarser one a sphere at 0.1 to 0.2 mm has 7 to 11 % less force, which no
finger of the prior explains; on stiff fingers noise does not hide it."""


class RandomFinger(NamedTuple):
    """A finger under a bench: the bench's own configuration, and what happens to it meanwhile."""

    kind: str
    seed: int
    config: Config
    slips_mm: float = 0.0  # the mount, when the third press begins
    exact: bool = False
    made: type[Fingertip] = Fingertip  # what its finger is


def inside(known: Config, seed: int, mesh: MeshSpec = COARSER) -> RandomFinger:
    """Of the prior."""
    return RandomFinger("prior", seed, _meshed(with_parameters(known, truth_of(seed), seed), mesh))


def outside(known: Config, seed: int) -> RandomFinger:
    """Not of the prior: one of the kinds, in turn."""
    names = list(_KINDS)
    kind = names[seed % len(names)]
    told = _meshed(with_parameters(known, truth_of(10_000 + seed), seed))
    return _KINDS[kind](RandomFinger(kind, seed, told), np.random.default_rng(seed))


def _meshed(config: Config, mesh: MeshSpec = COARSER) -> Config:
    return config.model_copy(update={"finger": config.finger.model_copy(update={"mesh": mesh})})


def _of(drawn: RandomFinger, table: str, **changed: Any) -> RandomFinger:
    """With some keys of the finger changed."""
    finger = drawn.config.finger
    part = getattr(finger, table).model_copy(update=changed)
    config = drawn.config.model_copy(update={"finger": finger.model_copy(update={table: part})})
    return drawn._replace(config=config, exact=True)


def _benched(drawn: RandomFinger, **changed: Any) -> RandomFinger:
    virtual = drawn.config.virtual.model_copy(update=changed)
    return drawn._replace(config=drawn.config.model_copy(update={"virtual": virtual}))


def _rubber(drawn: RandomFinger, chance: np.random.Generator) -> RandomFinger:
    """One material throughout, on a small core."""
    return _of(drawn, "tissue", e_dermis=1.0, e_fat=1.0, bone_fraction=0.1, stiffness=float(chance.uniform(0.1, 0.5)))


def _bony(drawn: RandomFinger, chance: np.random.Generator) -> RandomFinger:
    """Bone close under the skin."""
    return _of(drawn, "tissue", bone_fraction=float(chance.uniform(0.52, 0.58)))


def _horny(drawn: RandomFinger, chance: np.random.Generator) -> RandomFinger:
    """A callus: epidermis of twice the thickness over fat far softer than any of the prior."""
    return _of(drawn, "tissue", epidermis_mm=0.8, e_fat=0.008, e_dermis=0.02)


def _narrow(drawn: RandomFinger, chance: np.random.Generator) -> RandomFinger:
    """A finger of other geometry: the nail far down, the proximal part thin."""
    return _of(drawn, "geometry", nail_depth_ratio=0.4, proximal_apex_mm=1.6, proximal_half_width_mm=2.6)


def _spongy(drawn: RandomFinger, chance: np.random.Generator) -> RandomFinger:
    """Tissue that can be compressed."""
    return _of(drawn, "tissue", poisson=float(chance.uniform(0.1, 0.25)))


def _creeping(drawn: RandomFinger, chance: np.random.Generator) -> RandomFinger:
    """It relaxes far more, and more slowly, than any of the prior."""
    return _benched(drawn, relaxation=((0.3, 0.4), (0.45, 6.0)))


def _slipping(drawn: RandomFinger, chance: np.random.Generator) -> RandomFinger:
    """The mount gives way between two presses."""
    return drawn._replace(slips_mm=float(chance.uniform(0.08, 0.2)))


def _giving(drawn: RandomFinger, chance: np.random.Generator) -> RandomFinger:
    """A rig that gives, and was not calibrated."""
    return _benched(drawn, compliance_mm_per_n=float(chance.uniform(0.8, 1.0)))


def _ogden(drawn: RandomFinger, chance: np.random.Generator) -> RandomFinger:
    """Tissue of Ogden's law, with the moduli at small strain of the finger that its references are of."""
    tissue = Tissue()
    drawn = _of(drawn, "tissue", e_dermis=tissue.e_dermis, e_fat=tissue.e_fat, strain="small", stiffening=0.0)
    return drawn._replace(made=OgdenFinger)


_KINDS: dict[str, Callable[[RandomFinger, np.random.Generator], RandomFinger]] = {
    "one material": _rubber,
    "bone under the skin": _bony,
    "callus on soft fat": _horny,
    "other geometry": _narrow,
    "compressible": _spongy,
    "creeps": _creeping,
    "mount slips": _slipping,
    "rig gives": _giving,
    "Ogden's tissue": _ogden,
}
