"""The door to the simulator: models of growing cost by name, all indented the same way.

A new model is a module with a Builder, and a name and a line here.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, get_args

import numpy as np

from sim.config.fingertip_config import FingertipConfig
from sim.contact.indentor import ALONG
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM, ReceptorSet, place_receptors
from sim.models.condensed import CondensedModel
from sim.models.fingertip import Fingertip
from sim.models.halfspace import build_halfspace
from sim.models.patches import HalfWidths, widened
from sim.models.plane_section import build_section, prismatic
from sim.models.processes.recipe import Recipe
from sim.models.whole_finger import build_finger

ModelName = Literal["halfspace", "section", "finger"]
MODELS: tuple[ModelName, ...] = get_args(ModelName)

Builder = Callable[[FingertipConfig, FingertipSurface, ReceptorSet, tuple[int, ...]], CondensedModel]
"""Makes a model of a skin, with receptors under it, for indentors that slope along some axes."""

BUILDERS: Mapping[ModelName, Builder] = {
    "halfspace": build_halfspace,
    "section": build_section,
    "finger": build_finger,
}


def load(
    name: ModelName,
    config: FingertipConfig | None = None,
    *,
    slopes: tuple[int, ...] = ALONG,
    receptor_x_mm: Sequence[float] = DEFAULT_X_MM,
    receptor_depth_mm: float = DEFAULT_DEPTH_MM,
    cached: bool = True,
) -> Fingertip:
    """A model to be indented; the finger's from the cache or built, the others always built (about a second).

    A section's forces are per millimetre of its length, in N/mm, and it takes only shapes prismatic along the finger.
    """
    config = FingertipConfig() if config is None else config
    if name == "finger" and cached:
        return Fingertip.load(config, slopes=slopes, receptor_x_mm=receptor_x_mm, receptor_depth_mm=receptor_depth_mm)
    surface = FingertipSurface.fit(config.geometry)
    if name == "section":
        surface = prismatic(surface, config.receptor_plane_mm)
    receptors = place_receptors(surface, np.array(receptor_x_mm), receptor_depth_mm, config.receptor_plane_mm)

    def build(slopes: tuple[int, ...], patch: HalfWidths | None) -> tuple[CondensedModel, bool]:
        return BUILDERS[name](widened(config, patch), surface, receptors, slopes), False

    places = {"receptor_x_mm": tuple(receptor_x_mm), "receptor_depth_mm": receptor_depth_mm}
    recipe = Recipe.of(load, name, config, slopes=slopes, cached=cached, **places)
    model = Fingertip(config, surface, build, recipe)
    model.model_for(slopes)
    return model
