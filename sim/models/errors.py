"""What a model refuses."""

import math

from sim.errors import SimError


class ModelRangeError(SimError, ValueError):
    """What is asked for lies outside what the model can answer."""


class ForceOutOfReachError(ModelRangeError):
    """The force is not reached at the deepest indentation that the model answers."""


def positive(force_gwt: float) -> float:
    """A force that can be asked for. Raises ModelRangeError."""
    if not (math.isfinite(force_gwt) and force_gwt > 0):
        raise ModelRangeError(f"force {force_gwt:g} gwt: expected a positive number")
    return force_gwt
