"""Finger model for the steps of a protocol: predictions, each solved once, and responses of a run."""

import hashlib
import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.data import Run
from rig.data.folder import SHAPE_COPY, replace_bytes
from rig.engine.limits import CONTACT_EXPONENT
from rig.plan.finger_file import IdentifiedFinger, fingers_of
from rig.protocol.check import ForceTooDeepError, NoPredictionError
from rig.records import Pace, Prediction, PredictionBand, Target
from rig_shared.natural_order import natural_order
from rig_shared.user_files import read_bytes
from sim.config import FingertipConfig
from sim.contact import shapes
from sim.contact.indentor import Indentor
from sim.contact.shapes import parse_shape
from sim.errors import ForceOutOfReachError
from sim.finger_process import Finger, asked
from sim.identification.uncertainty_bands import band
from sim.models.relaxation import Moves

if TYPE_CHECKING:  # a run whose finger is in another process never solves
    from sim.models.fingertip import Fingertip
    from sim.models.result import IndentationResult

# Share of the elastic force that remains in relaxing tissue, during the ramp and in the last hold.
#
# The depth grows evenly up to each hold, and f(t) = ∫ G(t − s) dF(s), with F ∝ d^1.5 as in the engine.

Array = NDArray[np.float64]

_MODELS = logging.getLogger("sim")  # whose records the process of the finger forwards
_STEPS = 32  # of a ramp, and of a hold
_MOST_LOST = 0.25  # share of the likely fingers that a band may leave out


class RemainingShares(NamedTuple):
    """Shares of the elastic force at the target."""

    held: float  # mean of the last hold
    highest: float  # on a ramp that nothing interrupts


def remaining_shares(series: tuple[tuple[float, float], ...], pace: Pace, doi_mm: float) -> RemainingShares:
    """Return the remaining shares for a Prony series of (share, time constant in s)."""
    if not series:
        return RemainingShares(1.0, 1.0)
    each_s, quick_s = pace.ramp_s(doi_mm) / pace.ramps, doi_mm / pace.speed_mm_s
    since_s = pace.hold_s * (np.arange(_STEPS) + 0.5) / _STEPS
    return RemainingShares(
        _mean_share(series, pace.ramps, each_s, pace.hold_s, since_s),
        _mean_share(series, 1, quick_s, 0.0, np.zeros(1)),
    )


def _mean_share(
    series: tuple[tuple[float, float], ...], ramps: int, ramp_s: float, hold_s: float, since_s: Array
) -> float:
    """Return the mean force after the last ramp, relative to the elastic force at the target."""
    ramp, part_of_one = np.arange(ramps)[:, None], np.arange(1, _STEPS + 1) / _STEPS
    ended_s = (ramp * (ramp_s + hold_s) + ramp_s * part_of_one).ravel()
    elastic = ((ramp + part_of_one).ravel() / ramps) ** CONTACT_EXPONENT
    moves, asked_s = Moves(ended_s, np.full(len(ended_s), ramp_s / _STEPS)), ended_s[-1] + since_s
    last = np.full(len(asked_s), len(ended_s) - 1)
    relaxing = sum(part * moves.fading(tau_s, asked_s, last) @ elastic for part, tau_s in series)
    return float(np.mean((1 - sum(part for part, _ in series)) * elastic[-1] + relaxing))


class Answers(NamedTuple):
    """Responses of the likely fingers to one press, (draws,) each."""

    held_gwt: Array  # mean force in the last hold
    doi_mm: Array
    highest_gwt: Array


def answers(
    finger: "Fingertip", shape: Indentor, x_mm: float, target: Target, pace: Pace, identified: IdentifiedFinger
) -> Answers:
    """Return the responses; NaN where the model does not converge. Raises ModelRangeError."""
    return Answers(
        *np.array(
            [
                _answer(one, shape, x_mm, target, pace, draw.relaxation)
                for one, draw in zip(_likely(finger.config, identified), identified.draw, strict=True)
            ]
        ).T
    )


def band_of(found: Answers, identified: IdentifiedFinger) -> tuple[float, float, PredictionBand]:
    """Return median force and depth and their bands: log-normal, widened by the error of the simulator."""
    error, coverage = identified.band.model_error, identified.band.coverage
    controlled = float(np.ptp(np.log(found.held_gwt))) < 1e-9  # a commanded force
    force = band(found.held_gwt, 0.0 if controlled else error, coverage)
    depth = band(found.doi_mm, error / CONTACT_EXPONENT if controlled else 0.0, coverage)
    most = float(found.held_gwt[0]) if controlled else band(found.highest_gwt, error, coverage).high
    return force.middle, depth.middle, PredictionBand((force.low, force.high), (depth.low, depth.high), most)


@lru_cache(maxsize=1)
def _likely(config: FingertipConfig, identified: IdentifiedFinger) -> "list[Fingertip]":
    from sim.models.fingertip import Fingertip

    return [Fingertip.load(one, exact=False).keeping_ways() for one in fingers_of(config, identified)]


def _answer(
    finger: "Fingertip",
    shape: Indentor,
    x_mm: float,
    target: Target,
    pace: Pace,
    series: tuple[tuple[float, float], ...],
) -> tuple[float, float, float]:
    """Return the force during the hold (gwt), the depth (mm) and the highest force (gwt)."""
    if target.kind == "doi_mm":
        left = remaining_shares(series, pace, target.value)
        found = finger.indent(shape, x_mm, doi_mm=target.value)
        force = found.force_gwt if found.state.converged else math.nan
        return left.held * force, found.doi_mm, left.highest * force
    left = _shares_at_force(finger, shape, x_mm, target.value, pace, series)
    found = finger.indent(shape, x_mm, force_gwt=target.value / left.held)
    return target.value, found.doi_mm if found.state.converged else math.nan, target.value


def _shares_at_force(
    finger: "Fingertip",
    shape: Indentor,
    x_mm: float,
    force_gwt: float,
    pace: Pace,
    series: tuple[tuple[float, float], ...],
) -> RemainingShares:
    """Return the remaining shares for a commanded force, with the ramp of elastic tissue."""
    return (
        remaining_shares(series, pace, finger.indent(shape, x_mm, force_gwt=force_gwt).doi_mm)
        if series
        else RemainingShares(1.0, 1.0)
    )


Predictions = dict[tuple[str, float, Target] | tuple[str, float, Target, Pace], Prediction]


class FingerModel:
    """Predictions of a fingertip, cached in `kept`.

    A shape is read once, from the path that `where` returns for its name in the protocol; later edits of its file
    have no effect.
    """

    def __init__(
        self,
        finger: Finger,
        kept: Predictions,
        where: Callable[[str], str] = str,
        identified: IdentifiedFinger | None = None,
    ) -> None:
        """Prepare predictions. identified: result of the identification, if the finger was identified."""
        self.finger, self._kept, self._where, self._identified = finger, kept, where, identified
        self._shapes: dict[str, Indentor] = {}

    def learn(self, predictions: Predictions) -> None:
        """Take over predictions, which are not solved again."""
        self._kept.update(predictions)

    def refuse_shape(self, indentor: str) -> None:
        """Raise ShapeError if this is not the name of an indentor."""
        self._shape(indentor)

    def press(self, indentor: str, x_mm: float, target: Target, pace: Pace | None = None) -> Prediction:
        """Predict a press; relaxation is included only with a pace.

        Raises ModelRangeError, and NoPredictionError if the model does not converge.
        """
        asked = indentor, x_mm, target
        if asked not in self._kept:
            self._kept[asked] = self._solved(*asked)
        if self._identified is None or pace is None:
            return self._kept[asked]
        paced = *asked, pace
        if paced not in self._kept:
            self._kept[paced] = self._with_band(self._kept[asked], pace, self._identified)
        return self._kept[paced]

    def touch_height_mm(self, indentor: str, x_mm: float, along_mm: float) -> float:
        """Return the height of the indentor at first touch above the nominal apex (mm)."""
        return asked(self.finger, _touch_height_mm, self._shape(indentor), x_mm, along_mm)

    def _shape(self, indentor: str) -> Indentor:
        if indentor not in self._shapes:
            self._shapes[indentor] = parse_shape(self._where(indentor))
        return self._shapes[indentor]

    def _solved(self, indentor: str, x_mm: float, target: Target) -> Prediction:
        return asked(self.finger, _predicted, self._shape(indentor), RequestedPress(indentor, x_mm, target))

    def _with_band(self, found: Prediction, pace: Pace, identified: IdentifiedFinger) -> Prediction:
        return asked(self.finger, _with_band, found, self._shape(found.indentor), pace, identified)


class RequestedPress(NamedTuple):
    """Press as requested by the protocol."""

    indentor: str
    x_mm: float
    target: Target


def about_model(finger: "Fingertip") -> dict[str, Any]:
    """Return the facts of the model that a run records."""
    return {
        "nodes": finger.model.nodes,
        "e_epidermis_mpa": finger.e_epidermis_mpa,
        "from_cache": finger.from_cache,
    }


def _touch_height_mm(finger: "Fingertip", shape: Indentor, x_mm: float, along_mm: float) -> float:
    from sim.models.pressing import refuse_meaningless  # imports the solver

    refuse_meaningless(shape, x_mm, along_mm or None, "along_mm")
    z_mm = finger.config.receptor_plane_mm + along_mm if along_mm else None
    return finger.touch_height_mm(shape, x_mm, z_mm=z_mm) - finger.apex_height_mm


def _with_band(
    finger: "Fingertip", found: Prediction, shape: Indentor, pace: Pace, identified: IdentifiedFinger
) -> Prediction:
    """Return the prediction with the band of the likely fingers; area and pressure are of the most likely one."""
    try:
        likely = answers(finger, shape, found.x_mm, found.target, pace, identified)
    except ForceOutOfReachError as error:
        sentence = f"for one of the {len(identified.draw)} likely fingers: {error}"
        raise ForceTooDeepError(sentence, error.code) from None
    converged = np.asarray(np.isfinite(likely).all(axis=0))
    lost, fingers = int((~converged).sum()), len(converged)
    if lost > _MOST_LOST * fingers:
        raise NoPredictionError(
            f"{found.indentor} at x = {found.x_mm:g} mm to {found.target.kind} = {found.target.value:g}: the "
            f"model does not converge for {lost} of the {fingers} likely fingers; choose another depth or "
            "position, e.g. 0.1 mm from it",
            "likely_finger_not_converged",
        )
    if lost:
        _MODELS.warning(
            "%s at x = %g mm to %s = %g: the band leaves out %d of the %d likely fingers, for which the model does "
            "not converge; another depth or position, e.g. 0.1 mm from it, may have them all",
            found.indentor, found.x_mm, found.target.kind, found.target.value, lost, fingers,
        )  # fmt: skip
    force_gwt, doi_mm, band = band_of(Answers(*np.array(likely)[:, converged]), identified)
    return replace(found, predicted_force_gwt=force_gwt, predicted_doi_mm=doi_mm, band=band)


def _predicted(finger: "Fingertip", shape: Indentor, press: RequestedPress) -> Prediction:
    target = press.target
    try:
        found = finger.indent(shape, press.x_mm, **{target.kind: target.value})  # type: ignore[arg-type]
    except ForceOutOfReachError as error:
        raise ForceTooDeepError(str(error), error.code) from None
    if not found.state.converged:
        raise NoPredictionError(
            f"the model does not converge here (residual {found.state.residual:.0e})", "not_converged"
        )
    return Prediction(
        *press,
        found.touch_height_mm - finger.apex_height_mm,
        found.force_gwt,
        found.doi_mm,
        found.contact_area_mm2,
        found.peak_pressure_mpa,
    )


def named_file(indentor: str) -> str | None:
    """Return the file in an indentor's name, as the protocol wrote it."""
    return shapes.named_file(indentor) if isinstance(indentor, str) else None


def copy_name(file: str) -> str:
    """Return the name of a file's copy in a run folder, unique by its path."""
    return f"{SHAPE_COPY}{hashlib.sha256(file.encode()).hexdigest()[:8]}_{Path(file).name}"


def from_copy(folder: Path, indentor: str) -> str:
    """Return the shape with the run's own copy of its file, if there is one."""
    file = named_file(indentor)
    if file is None or not (folder / copy_name(file)).is_file():
        return indentor
    return shapes.with_file(shapes.with_raised_side(indentor), str(folder / copy_name(file)))


def with_stored_file(folder: Path, indentor: str) -> str:
    """Return the shape with the run's copy of its file, copying it if needed. Raises OSError."""
    file = named_file(indentor)
    if file is not None and Path(file).is_file() and not (folder / copy_name(file)).is_file():
        replace_bytes(folder / copy_name(file), read_bytes(file))
    return from_copy(folder, indentor)


@dataclass(frozen=True)
class PredictedHold:
    """Hold and the response of the model."""

    index: int
    indentor: str
    kind: str  # commanded quantity: doi_mm or force_gwt
    commanded: float
    last: bool  # of its indentation
    hold: dict[str, Any]
    touch: dict[str, Any]
    result: "IndentationResult"

    @property
    def group(self) -> str:
        """Group that is comparable over positions, e.g. "step:1 at 2.33 gwt"."""
        unit = {"doi_mm": "mm", "force_gwt": "gwt"}[self.kind]
        return f"{self.indentor} at {self.commanded:g} {unit}"


def responses(run: Run, finger: "Fingertip", *, last_only: bool = False) -> list[PredictedHold]:
    """Return a response for each hold, or each last hold, of each finished indentation, in order.

    A virtual run is evaluated at the true x and DOI, a real run at the recorded force.
    """
    starts = {event["index"]: event for event in run.stream("indentation_start")}
    touches = {event["index"]: event for event in run.stream("touch")}
    asked = {(event["index"], event["hold"]): event for event in run.stream("hold_start")}
    found = []
    shapes: dict[str, Indentor] = {}
    for hold in run.stream("hold_end"):
        index = hold["index"]
        last = hold["hold"] == starts[index]["increments"]
        if index not in run.done or (last_only and not last):
            continue
        indentor, start = starts[index]["indentor"], asked[index, hold["hold"]]
        if indentor not in shapes:
            shapes[indentor] = parse_shape(from_copy(run.folder.path, indentor))
        shape = shapes[indentor]
        if hold.get("true_doi_mm") is not None:
            result = finger.indent(shape, shape.lateral_mm(hold["true_x_mm"]), doi_mm=hold["true_doi_mm"])
        else:
            result = finger.indent(shape, shape.lateral_mm(hold["x_mm"]), force_gwt=hold["force_gwt"])
        found.append(
            PredictedHold(index, indentor, start["target"], start["commanded"], last, hold, touches[index], result)
        )
    return found


def by_group(found: list[PredictedHold]) -> dict[str, list[PredictedHold]]:
    """Return the responses that differ only in position, ordered by x."""
    ordered = sorted(found, key=lambda r: (natural_order(r.indentor), r.kind, r.commanded, r.hold["x_mm"]))
    return {name: list(members) for name, members in groupby(ordered, key=lambda r: r.group)}


def measured(found: list[PredictedHold], measure: str) -> tuple[Array, Array]:
    """Return the indentor positions (n,) in mm and the raw measure (n, receptors).

    Rows are population responses, columns are SSRPs.
    """
    x = np.array([response.hold["x_mm"] for response in found])
    return x, np.array([response.result.receptor_measures[measure] for response in found])
