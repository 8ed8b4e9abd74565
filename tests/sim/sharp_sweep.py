"""Scenes under sharp shapes: every position of step 1, bars down to zero edge radius, gratings, wedges, hollows."""

from collections.abc import Iterator
from itertools import product

import numpy as np

from sim.contact.measured_profile import MeasuredProfile
from sim.contact.profiles import Bar, Grating, IndentorProfile, SinusoidalStep, Wedge
from sim.errors import ModelRangeError
from sim.models.fingertip import Fingertip
from sim.models.result import IndentationResult

Scene = tuple[IndentorProfile, float, float]  # profile, x and DOI in mm

STEP_POSITIONS_MM = np.append(np.arange(2.0, -3.7, -0.17), -3.7).round(2).tolist()
DOIS_MM = (0.05, 0.1, 0.2, 0.4, 0.73, 1.0)
OFFSETS_MM = (0.0, 0.06, -0.7)  # over the apex, a third of an element beside it, on the pad's flank
EDGE_RADII_MM = (0.2, 0.1, 0.05, 0.02, 0.01, 0.001, 0.0)
GROOVE = MeasuredProfile("two ridges", (-1.2, -0.6, 0.0, 0.6, 1.2), (0.4, 0.0, 0.25, 0.0, 0.4))
BOWL = MeasuredProfile("bowl", (-1.8, -1.2, 0.0, 1.2, 1.8), (0.0, 0.15, 0.4, 0.15, 0.0))
KINKS = (
    MeasuredProfile("ridge kink", (-1.5, 0.0, 1.5), (0.6, 0.0, 0.9), linear=True),
    MeasuredProfile("hollow kink", (-1.5, 0.0, 1.5), (0.0, 0.5, 0.1), linear=True),
    MeasuredProfile("zigzag", (-1.6, -0.8, 0.0, 0.8, 1.6), (0.3, 0.0, 0.3, 0.0, 0.3), linear=True),
)


def groups() -> dict[str, list[Scene]]:
    """Scenes by what makes them hard."""
    return {
        "step 1, x = 2 … −3.7": list(product([SinusoidalStep("1")], STEP_POSITIONS_MM, DOIS_MM)),
        **{f"bars, edge radius {r:g}": _over([Bar(w, r) for w in (3.0, 1.5)]) for r in EDGE_RADII_MM},
        "gratings": _over([Grating(0.3, 0.6), Grating(0.5, 1.2), Grating(0.5, 2.5), Grating(0.5, 1.2, 0.0)]),
        "wedges": _over([Wedge(a, r) for a, r in product((15.0, 45.0, 75.0), (0.05, 0.0))]),
        "concave": _over([GROOVE, BOWL]),
        "kinks": _over(KINKS),
    }


def _over(profiles: list[IndentorProfile] | tuple[IndentorProfile, ...]) -> list[Scene]:
    return list(product(profiles, OFFSETS_MM, DOIS_MM))


def solved(finger: Fingertip, scenes: list[Scene]) -> Iterator[tuple[Scene, IndentationResult]]:
    """Scenes that lie within the patch, each pressed from rest."""
    for profile, x, doi in scenes:
        try:
            yield (profile, x, doi), finger.indent(profile, x, doi_mm=doi)
        except ModelRangeError:
            continue
