"""Pressure as a formula of depth and curvature, fitted to bars and cylinders on the whole patch: Eq. 4.1 and 4.2."""

from functools import cache

import numpy as np
from scipy.stats import spearmanr

from rig.compare.pressure_formula import BootstrapConstants, ContactSamples, places, refitted, together
from studies.source.answers import FingerAnswers, deep

DEPTHS_MM = (0.33, 0.67, 1.0, 1.33)
CENTERED = {"bar:3.0": DEPTHS_MM, "bar:1.5": DEPTHS_MM[:2], "cylinder:3": DEPTHS_MM, "cylinder:9": DEPTHS_MM}


@cache
def _off_edges(answers: FingerAnswers, shape: str) -> list[ContactSamples]:
    """Return the places in contact, away from the indentor's edges, of each depth."""
    results = [answers.press(deep(shape, doi_mm)) for doi_mm in CENTERED[shape]]
    return [places(result, answers.finger.surface, "patch").off_edges for result in results]


@cache
def _spread(answers: FingerAnswers) -> BootstrapConstants:
    return refitted([one for shape in CENTERED for one in _off_edges(answers, shape)])


def least(answers: FingerAnswers, k: int) -> float:
    """Return the low end of a constant's interval."""
    return _spread(answers).intervals[k][0]


def least_k2_over_k1(answers: FingerAnswers) -> float:
    """Return the low end of the interval of K2 − K1."""
    return _spread(answers).k2_over_k1[0]


def k2_with_curvature(answers: FingerAnswers) -> float:
    """Return the rank correlation of the slope within contacts with the curvature, over bars and cylinders."""
    each = [_off_edges(answers, shape) for shape in CENTERED]
    curvature = [float(np.median(together(parts).curvature_per_mm)) for parts in each]
    return float(spearmanr(curvature, [_k2_alone(parts) for parts in each]).statistic)


def _k2_alone(parts: list[ContactSamples]) -> float:
    """Return the slope of pressure against displacement within contacts, each with an intercept of its own."""
    inside = [at for at in parts if len(at.pressure) > 2]
    d = np.concatenate([at.displacement_mm - at.displacement_mm.mean() for at in inside])
    p = np.concatenate([at.pressure - at.pressure.mean() for at in inside])
    return float(d @ p / (d @ d))
