"""The finger as a script's steps see it: predictions, each solved once."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from rig.engine.records import Target
from rig.errors import around
from rig.plan.met.expected import answers, band_of
from rig.plan.met.finger_file import Met
from rig.protocol.planned import Pace, Prediction
from rig.protocol.walk import ForceTooDeepError, NoPredictionError
from sim.contact.indentor import Indentor
from sim.contact.shapes import parse_shape
from sim.errors import ForceOutOfReachError
from sim.finger_process import Finger, asked
from sim.models.fingertip import Fingertip

Predictions = dict[tuple[str, float, Target] | tuple[str, float, Target, Pace], Prediction]


class FingerModel:
    """Predictions of a fingertip; those in `kept` are taken from there, new ones are put there.

    A shape is read once, by the name that `where` makes of the script's: a file that is edited meanwhile is not seen.
    """

    def __init__(
        self, finger: Finger, kept: Predictions, where: Callable[[str], str] = str, met: Met | None = None
    ) -> None:
        """met: how well the finger is known, where the rig has met it."""
        self._finger, self._kept, self._where, self._met = finger, kept, where, met
        self._shapes: dict[str, Indentor] = {}

    def refuse_shape(self, indentor: str) -> None:
        """Raises ShapeError where this is the name of no indentor."""
        self._shape(indentor)

    def press(self, indentor: str, x_mm: float, target: Target, pace: Pace | None = None) -> Prediction:
        """What a press meets; tissue that is known to relax does so at a pace, and not at all where none is given.

        Raises ModelRangeError, and NoPredictionError where the model does not converge.
        """
        asked = indentor, x_mm, target
        if asked not in self._kept:
            self._kept[asked] = self._solved(*asked)
        if self._met is None or pace is None:
            return self._kept[asked]
        paced = *asked, pace
        if paced not in self._kept:
            self._kept[paced] = self._with_band(self._kept[asked], pace, self._met)
        return self._kept[paced]

    def touch_height_mm(self, indentor: str, x_mm: float, along_mm: float) -> float:
        """Height of the indentor at first touch, from the nominal apex."""
        return asked(self._finger, _touch_height_mm, self._shape(indentor), x_mm, along_mm)

    def _shape(self, indentor: str) -> Indentor:
        if indentor not in self._shapes:
            self._shapes[indentor] = parse_shape(self._where(indentor))
        return self._shapes[indentor]

    def _solved(self, indentor: str, x_mm: float, target: Target) -> Prediction:
        return asked(self._finger, _predicted, self._shape(indentor), Asked(indentor, x_mm, target))

    def _with_band(self, found: Prediction, pace: Pace, met: Met) -> Prediction:
        return asked(self._finger, _with_band, found, self._shape(found.indentor), pace, met)


class Asked(NamedTuple):
    """A press by the script's words."""

    indentor: str
    x_mm: float
    target: Target


def about_model(finger: Fingertip) -> dict[str, Any]:
    """What is kept of the model that a run was made with."""
    return {
        "nodes": finger.model.nodes,
        "e_epidermis_mpa": finger.e_epidermis_mpa,
        "from_cache": finger.from_cache,
    }


def _touch_height_mm(finger: Fingertip, shape: Indentor, x_mm: float, along_mm: float) -> float:
    z_mm = finger.config.receptor_plane_mm + along_mm if along_mm else None
    return finger.touch_height_mm(shape, x_mm, z_mm=z_mm) - finger.apex_height_mm


def _with_band(finger: Fingertip, found: Prediction, shape: Indentor, pace: Pace, met: Met) -> Prediction:
    """The middle and the band of the likely fingers; area and pressure as on the likeliest, at its elastic force."""
    try:
        likely = answers(finger, shape, found.x_mm, found.target, pace, met)
    except ForceOutOfReachError as error:
        sentence = "on one of the {fingers} likely fingers: {problem}"
        raise around(ForceTooDeepError, sentence, error, fingers=len(met.draw)) from None
    if not np.isfinite(likely).all():
        raise NoPredictionError(
            "the model does not converge here on one of the likely fingers", code="likely_finger_not_converged"
        )
    force_gwt, doi_mm, band = band_of(likely, met)
    return replace(found, predicted_force_gwt=force_gwt, predicted_doi_mm=doi_mm, band=band)


def _predicted(finger: Fingertip, shape: Indentor, press: Asked) -> Prediction:
    target = press.target
    try:
        found = finger.indent(shape, press.x_mm, **{target.kind: target.value})  # type: ignore[arg-type]
    except ForceOutOfReachError as error:
        raise around(ForceTooDeepError, "{problem}", error) from None
    if not found.state.converged:
        raise NoPredictionError("the model does not converge here (residual {residual:.0e})", code="not_converged",
                                residual=found.state.residual)  # fmt: skip
    return Prediction(
        *press,
        found.touch_height_mm - finger.apex_height_mm,
        found.force_gwt,
        found.doi_mm,
        found.contact_area_mm2,
        found.peak_pressure_mpa,
    )
