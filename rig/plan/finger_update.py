"""Update of an identified finger from the reference presses of a run.

The mean of ln force over the references at a position is assimilated into the ensemble of likely fingers: the mean
moves by the Kalman gain and the spread shrinks (deterministic update, Anderson 2003, Mon. Weather Rev. 131, 634).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.data import Run
from rig.plan.config import Config, load_config
from rig.plan.finger_file import Draw, FingerFile, IdentifiedFinger, Posterior
from rig.plan.finger_model import answers
from rig.records import Pace, Target, grouped
from rig_shared.user_files import sha256_of
from sim.contact.shapes import parse_shape
from sim.identification.prior import LEAST_STIFFENING, strain_of
from sim.models.fingertip import Fingertip
from sim.models.interpolation_weights import DERMIS, FAT

Array = NDArray[np.float64]

NAMES = ("ln_stiffness", "ln_e_dermis", "ln_e_fat", "stiffening")
_LEAST_SPREAD = 1e-9  # of ln force over the likely fingers; below it an observation has no information


@dataclass(frozen=True)
class ReferenceForce:
    """References at one position to one target: mean of ln force, and its variance."""

    indentor: str
    x_mm: float
    target: Target
    pace: Pace
    ln_force: float
    variance: float


def learned(run: Run, finger: Fingertip) -> FingerFile | None:
    """Return the finger file after a run; None without an identified finger or references."""
    config = load_config(run.folder.config)
    seen = [] if config.identified is None else references(run, config)
    if config.identified is None or not seen:
        return None
    identified = config.identified
    for one in seen:
        predicted = answers(finger, parse_shape(one.indentor), one.x_mm, one.target, one.pace, identified)
        if np.isfinite(predicted).all():  # else a likely finger has no answer that could be updated
            identified = updated_by(identified, np.log(predicted.held_gwt), one)
    tissue = config.finger.tissue.model_copy(update=_middle(identified.draw))
    sha256 = sha256_of(run.folder.events)
    about = {
        "runs": (*identified.runs, run.folder.path.name),
        "journals_sha256": (*identified.journals_sha256, sha256),
    }
    return FingerFile(
        finger=config.finger.model_copy(update={"tissue": tissue}),
        relaxation=config.virtual.relaxation,
        identified=identified.model_copy(update=about),
    ).sealed()


def references(run: Run, config: Config) -> list[ReferenceForce]:
    """Return the references of a run to a depth; equal ones are averaged."""
    begun = {e["index"]: e for e in run.stream("reference_indentation_start")}
    last = {e["index"]: e for e in run.stream("reference_hold_end")}
    found = []
    for index, hold in last.items():
        start = begun[index]
        if start["target"] == "doi_mm" and hold["hold"] == start["increments"] and hold["force_gwt"] > 0:
            habits = config.habits
            pace = Pace(habits.press_speed_mm_s, habits.increment_mm, start["increments"], hold["asked_s"])
            press = (start["indentor"], start["x_mm"], Target("doi_mm", start["value"]), pace)
            noise = hold["force_sd_gwt"] / hold["force_gwt"] / math.sqrt(hold["readings"])
            found.append((press, math.log(hold["force_gwt"]), noise**2))
    return [
        _together(press, [one[1:] for one in alike]) for press, alike in grouped(found, lambda one: one[0]).items()
    ]


def _together(press: tuple[str, float, Target, Pace], alike: Sequence[tuple[float, float]]) -> ReferenceForce:
    logs, variances = np.array(alike).T
    return ReferenceForce(*press, float(logs.mean()), float(variances.mean() / len(logs)))


def updated_by(identified: IdentifiedFinger, ln_predicted: Array, seen: ReferenceForce) -> IdentifiedFinger:
    """Return the identification after one observation, given the predictions (draws,)."""
    spread = float(ln_predicted.var(ddof=1))
    if spread < _LEAST_SPREAD:
        return identified
    noise = identified.band.model_error**2 + seen.variance
    moved = spread / (spread + noise) * (seen.ln_force - ln_predicted.mean())
    drawn = math.sqrt(noise / (spread + noise)) - 1
    change = moved + drawn * (ln_predicted - ln_predicted.mean())
    z = np.array([_logs(draw) for draw in identified.draw])
    slope = (z - z.mean(axis=0)).T @ (ln_predicted - ln_predicted.mean()) / (spread * (len(z) - 1))
    draws = tuple(_draw(draw, row) for draw, row in zip(identified.draw, z + change[:, None] * slope, strict=True))
    return identified.model_copy(
        update={"draw": draws, "posterior": _posterior(identified, slope, moved, spread, noise)}
    )


def _posterior(identified: IdentifiedFinger, slope: Array, moved: float, spread: float, noise: float) -> Posterior:
    """Return the posterior of the updated names; the others stay."""
    before = identified.posterior
    by_name = dict(zip(NAMES, slope, strict=True))
    along = np.array([by_name.get(name, 0.0) for name in before.names])
    mean = np.array(before.mean) + along * moved
    covariance = np.array(before.covariance) - np.outer(along, along) * spread**2 / (spread + noise)
    covariance[np.diag_indices_from(covariance)] = np.maximum(covariance.diagonal(), 0.0)
    return Posterior(names=before.names, mean=tuple(mean), covariance=tuple(map(tuple, covariance)))


def _logs(draw: Draw) -> list[float]:
    return [math.log(draw.stiffness), math.log(draw.e_dermis), math.log(draw.e_fat), draw.stiffening]


def _draw(draw: Draw, row: Array) -> Draw:
    """Return an updated draw, with moduli clipped to the range of the model."""
    stiffness, e_dermis, e_fat = np.exp(row[:3])
    return draw.model_copy(
        update={
            "stiffness": float(stiffness),
            "e_dermis": float(np.clip(e_dermis, DERMIS.low, DERMIS.high)),
            "e_fat": float(np.clip(e_fat, FAT.low, FAT.high)),
            "stiffening": max(float(row[3]), LEAST_STIFFENING) if draw.stiffening else 0.0,
        }
    )


def _middle(draws: Sequence[Draw]) -> dict[str, float | str]:
    stiffness, e_dermis, e_fat = np.exp(np.mean([_logs(draw)[:3] for draw in draws], axis=0))
    stiffening = float(np.mean([draw.stiffening for draw in draws]))
    return {
        "stiffness": float(stiffness),
        "e_dermis": float(e_dermis),
        "e_fat": float(e_fat),
        "strain": strain_of(stiffening),
        "stiffening": stiffening,
    }
