"""Ridge and crest of the skin, which indentors touch first: kept with the models, since to find them takes 0.1 s."""

import numpy as np
from scipy.interpolate import CubicSpline

from sim.finger.surface import FingertipSurface
from sim.models.cache import Arrays, cached_arrays, content_key

_TOPS = ("ridge", "crest")


def keep_tops(surface: FingertipSurface) -> None:
    """Give a surface its ridge and crest as they are in the cache, or put them there; the same to the last bit."""

    def find() -> Arrays:
        splines = {name: getattr(surface, name) for name in _TOPS}
        return {f"{name}_{part}": getattr(spline, part) for name, spline in splines.items() for part in "cx"}

    found, _ = cached_arrays(content_key(["tops", surface.geometry.model_dump(mode="json")]), find, "skin")
    for name in _TOPS:
        c, x = (np.asarray(found[f"{name}_{part}"]) for part in "cx")
        vars(surface)[name] = CubicSpline.construct_fast(c, x, extrapolate=False)  # where cached_property looks
