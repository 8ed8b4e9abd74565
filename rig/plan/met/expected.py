"""What a finger that was met is expected to answer: the middle and a band of its likely fingers, pressed alike."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.engine.pressing.touch_fit import CONTACT_EXPONENT
from rig.engine.records import Target
from rig.plan.met.finger_file import Met, fingers_of
from rig.plan.met.left import Left, left_of
from rig.protocol.planned import Band, Pace
from sim.config import FingertipConfig
from sim.contact.indentor import Indentor
from sim.identification.bands import band
from sim.models.fingertip import Fingertip

Array = NDArray[np.float64]


class Answers(NamedTuple):
    """Of each likely finger, (draws,), to one press."""

    held_gwt: Array  # mean force in the last hold
    doi_mm: Array
    highest_gwt: Array


def answers(finger: Fingertip, shape: Indentor, x_mm: float, target: Target, pace: Pace, met: Met) -> Answers:
    """Raises ModelRangeError; not a number where the model does not converge."""
    return Answers(
        *np.array(
            [
                _answer(one, shape, x_mm, target, pace, draw.relaxation)
                for one, draw in zip(_likely(finger.config, met), met.draw, strict=True)
            ]
        ).T
    )


def band_of(found: Answers, met: Met) -> tuple[float, float, Band]:
    """Force and depth in the middle, and their band: log-normal, widened by what the simulator leaves."""
    error, coverage = met.band.model_error, met.band.coverage
    controlled = float(np.ptp(np.log(found.held_gwt))) < 1e-9  # a force that was asked for
    force = band(found.held_gwt, 0.0 if controlled else error, coverage)
    depth = band(found.doi_mm, error / CONTACT_EXPONENT if controlled else 0.0, coverage)
    most = float(found.held_gwt[0]) if controlled else band(found.highest_gwt, error, coverage).high
    return force.middle, depth.middle, Band((force.low, force.high), (depth.low, depth.high), most)


@lru_cache(maxsize=1)
def _likely(config: FingertipConfig, met: Met) -> list[Fingertip]:
    return [Fingertip.load(one, exact=False).keeping_ways() for one in fingers_of(config, met)]


def _answer(
    finger: Fingertip,
    shape: Indentor,
    x_mm: float,
    target: Target,
    pace: Pace,
    series: tuple[tuple[float, float], ...],
) -> tuple[float, float, float]:
    """Held force, depth and highest force."""
    if target.kind == "doi_mm":
        left = left_of(series, pace, target.value)
        found = finger.indent(shape, x_mm, doi_mm=target.value)
        force = found.force_gwt if found.state.converged else math.nan
        return left.held * force, found.doi_mm, left.highest * force
    left = _left_at_force(finger, shape, x_mm, target.value, pace, series)
    found = finger.indent(shape, x_mm, force_gwt=target.value / left.held)
    return target.value, found.doi_mm if found.state.converged else math.nan, target.value


def _left_at_force(
    finger: Fingertip,
    shape: Indentor,
    x_mm: float,
    force_gwt: float,
    pace: Pace,
    series: tuple[tuple[float, float], ...],
) -> Left:
    """With a ramp as long as elastic tissue would take; relaxed it is a little longer, and as much is left."""
    return left_of(series, pace, finger.indent(shape, x_mm, force_gwt=force_gwt).doi_mm) if series else Left(1.0, 1.0)
