"""Models of growing cost by name, with one interface.

A new model is a module with a Builder, and a name and a line here.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, get_args

from sim.config import FingertipConfig, finger_config
from sim.contact.indentor import ALONG
from sim.errors import ArgumentError, ModelRangeError
from sim.finger.surface import FingertipSurface
from sim.measures.receptors import DEFAULT_DEPTH_MM, DEFAULT_X_MM, ReceptorPlaces, ReceptorSet, receptors_at
from sim.models.condensed import CondensedModel
from sim.models.factored_interior import Interior
from sim.models.finger_3d import build_finger
from sim.models.fingertip import Fingertip
from sim.models.halfspace import build_halfspace
from sim.models.section import build_section, prismatic
from sim.models.sources import Anew, MeshKey, Recipe, widened
from sim.models.stiffening import refuse_stiffening

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
    """Load a model by name: a finger from the cache or built, the simpler models always built (about a second).

    Parameters
    ----------
    name : {'halfspace', 'section', 'finger'}
        The model (`docs/model.md`). A section's forces are per mm of its length, in N/mm, and it takes only shapes
        that are prismatic along the finger.
    config : FingertipConfig, optional
        Default: the default finger.
    slopes : tuple of int, optional
        Axes along which the first indentor slopes. Default: across the finger.
    receptor_x_mm : sequence of float, optional
        Lateral positions of the receptors (mm). Default: the ten of Raju (1998, ch. 5).
    receptor_depth_mm : float or sequence of float, optional
        Perpendicular depths below the skin (mm). Default: 0.76.
    receptor_z_mm : float or sequence of float, optional
        Positions along the finger (mm). Default: the receptor plane.
    cached : bool, optional
        Whether to read a finger from the cache, and to store it there.

    Returns
    -------
    Fingertip
        The model.

    Raises
    ------
    ArgumentError
        If there is no model of this name.
    ModelRangeError
        If a section has receptors at another z, or the tissue stiffens under a simpler model.
    ReceptorError
        If a receptor lies outside the tissue.

    Notes
    -----
    The half-space uses the solutions of Boussinesq and Cerruti (Johnson, *Contact Mechanics*, 1985, Eq. 3.19 and
    3.75), the section plane strain.

    Examples
    --------
    >>> from sim import load
    >>> load("halfspace").indent("cylinder:9", doi_mm=0.1).model.kind
    'halfspace'
    """
    config = finger_config(config)
    if name not in MODELS:
        raise ArgumentError(f"there is no model {name!r}; choose {', '.join(MODELS)}", "unknown_model")
    locations = ReceptorPlaces.of(receptor_x_mm, receptor_depth_mm, receptor_z_mm)
    if name == "finger" and cached:
        return Fingertip.load(config, slopes=slopes, **locations.as_options())
    if name != "finger":
        refuse_stiffening(config.tissue, f"the {name}")
    surface = FingertipSurface.fit(config.geometry)
    if name == "section":
        if locations.z_mm:
            raise ModelRangeError(
                "a section contains the receptor plane only; receptors at other z require --model finger",
                "receptors_beside_section",
            )
        surface = prismatic(surface, config.receptor_plane_mm)
    receptors = receptors_at(config, surface, locations)

    def build(key: MeshKey, receptors: ReceptorSet) -> CondensedModel:
        slopes, patch = key
        return BUILDERS[name](widened(config, patch), surface, receptors, slopes)

    def whole(key: MeshKey) -> Interior:
        slopes, patch = key
        return Interior(widened(config, patch), surface, slopes)

    recipe = Recipe.of(load, name, config, slopes=slopes, cached=cached, **locations.as_options())
    model = Fingertip(config, surface, Anew(build, receptors, whole if name == "finger" else None), recipe)
    model.model_for(slopes)
    return model
