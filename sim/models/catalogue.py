"""The door to the simulator: models of growing cost by name, all indented the same way.

A new model is a module with a Builder, and a name and a line here.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, get_args

from sim.config import FingertipConfig
from sim.contact.indentor import ALONG
from sim.errors import ModelRangeError
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM, ReceptorPlaces, ReceptorSet, receptors_at
from sim.models.condensed import CondensedModel
from sim.models.finger import build_finger
from sim.models.fingertip import Fingertip
from sim.models.halfspace import build_halfspace
from sim.models.section import build_section, prismatic
from sim.models.sources import Anew, MeshKey, Recipe, widened
from sim.models.stiffening import refuse_stiffening
from sim.models.strain_field import Interior

ModelName = Literal["halfspace", "section", "finger"]
MODELS: tuple[ModelName, ...] = get_args(ModelName)

Builder = Callable[[FingertipConfig, FingertipSurface, ReceptorSet, tuple[int, ...]], CondensedModel]
"""Builds a model with receptors for indentors that slope along given axes."""

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
    receptor_depth_mm: float | Sequence[float] = DEFAULT_DEPTH_MM,
    receptor_z_mm: float | Sequence[float] | None = None,
    cached: bool = True,
) -> Fingertip:
    """A model to be indented; the finger's from the cache or built, the others always built (about a second).

    A section's forces are per millimetre of its length, in N/mm, and it takes only shapes prismatic along the finger.
    """
    config = FingertipConfig() if config is None else config
    places = ReceptorPlaces.of(receptor_x_mm, receptor_depth_mm, receptor_z_mm)
    if name == "finger" and cached:
        return Fingertip.load(config, slopes=slopes, **places.as_options())
    if name != "finger":
        refuse_stiffening(config.tissue, f"the {name}")
    surface = FingertipSurface.fit(config.geometry)
    if name == "section":
        if places.z_mm:
            raise ModelRangeError(
                "a section contains the receptor plane only; receptors at other z require --model finger",
                code="receptors_beside_section",
                z_mm=places.z_mm,
            )
        surface = prismatic(surface, config.receptor_plane_mm)
    receptors = receptors_at(config, surface, places)

    def build(key: MeshKey, receptors: ReceptorSet) -> CondensedModel:
        slopes, patch = key
        return BUILDERS[name](widened(config, patch), surface, receptors, slopes)

    def whole(key: MeshKey) -> Interior:
        slopes, patch = key
        return Interior(widened(config, patch), surface, slopes)

    recipe = Recipe.of(load, name, config, slopes=slopes, cached=cached, **places.as_options())
    model = Fingertip(config, surface, Anew(build, receptors, whole if name == "finger" else None), recipe)
    model.model_for(slopes)
    return model
