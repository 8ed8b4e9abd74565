"""Three models of growing cost behind one interface: half-space, section, finger."""

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np

from sim.config.fingertip_config import FingertipConfig
from sim.contact.indentor import ALONG
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM, place_receptors
from sim.models.condensed import CondensedModel, build_model
from sim.models.fingertip import Fingertip, ModelRangeError
from sim.models.halfspace import build_halfspace
from sim.models.plane_section import build_section, prismatic

ModelName = Literal["halfspace", "section", "finger"]
MODELS: tuple[ModelName, ...] = get_args(ModelName)


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

    def build(slopes: tuple[int, ...]) -> tuple[CondensedModel, bool]:
        if name == "finger":
            return build_model(config, surface, receptors, slopes), False
        if name == "halfspace":
            return build_halfspace(config, surface, receptors, slopes), False
        if slopes != ALONG:
            raise ModelRangeError("a section takes shapes prismatic along the finger: expected --model finger")
        return build_section(config, surface, receptors), False

    model = Fingertip(config, surface, build)
    model.model_for(slopes)
    return model
