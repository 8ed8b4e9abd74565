"""What the parameters of a prior are in a configuration: logarithms as what they are of, tissue, relaxation."""

import math
from collections.abc import Mapping

from sim.config.fingertip_config import Tissue
from sim.models.meeting.prior import TAU_FAST_S

_LOGARITHM = "ln_"


def named(name: str) -> str:
    """What a parameter is of."""
    return name.removeprefix(_LOGARITHM)


def plain(name: str, value: float) -> float:
    """A parameter's value as what it is of."""
    return math.exp(value) if name.startswith(_LOGARITHM) else float(value)


def in_numbers(values: Mapping[str, float]) -> dict[str, float]:
    """Parameters by what they are of."""
    return {named(name): plain(name, value) for name, value in values.items()}


def tissue_of(values: Mapping[str, float]) -> dict[str, float]:
    """Those of the parameters that are keys of `finger.tissue`."""
    return {name: value for name, value in in_numbers(values).items() if name in Tissue.model_fields}


def series_of(values: Mapping[str, float]) -> tuple[tuple[float, float], tuple[float, float]]:
    """How a finger relaxes: shares and times, s."""
    numbers = in_numbers(values)
    return (numbers["share_fast"], TAU_FAST_S), (numbers["share_slow"], numbers["tau_slow_s"])
