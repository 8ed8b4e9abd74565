"""A model that is not there: a half-space of half the stiffness, for an old finger."""

from dataclasses import replace

from sim.config import FingertipConfig
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import ReceptorSet
from sim.models.condensed import CondensedModel
from sim.models.halfspace import EFFECTIVE_MODULUS, build_halfspace


def build_soft(
    config: FingertipConfig, surface: FingertipSurface, receptors: ReceptorSet, slopes: tuple[int, ...]
) -> CondensedModel:
    """The patch of a finger on a half-space of half the default's modulus."""
    model = build_halfspace(config, surface, receptors, slopes, 0.5 * EFFECTIVE_MODULUS)
    return replace(model, kind="soft")
