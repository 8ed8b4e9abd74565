"""A comparison as rows and as JSON: for `--json` and for the tables of the report."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rig.compare.comparison import Comparison, Joint
from rig.compare.fit import chance_correlation, compared, fit_all
from rig.compare.shape_test import THRESHOLDS
from rig.compare.stimuli import Stimulus
from rig.compare.verdict import Answer, Limits, PairRow, Together
from rig.compare.verdict_text import methods, sentence, sentences
from sim.measures.measures import MEASURES

Pair = tuple[int, int]  # measure, receptor


def as_json(comparison: Comparison, report: str) -> dict[str, Any]:
    """What `rig compare --json` prints. k and ε₀ are in the signs in which profiles are shown."""
    return {
        "rows": [row for stimulus in comparison.stimuli for row in _rows(comparison, stimulus)],
        "candidates": comparison.candidates(),
        "candidates_by_condition": dict(comparison.candidates_by_condition()),
        "collinear": dict(comparison.collinear()),
        "joint": [row for joint in comparison.joints for row in _joint_rows(joint)],
        "chance": [chance_row(joint) for joint in comparison.joints],
        "small_strain": comparison.small_strain.as_json(),
        "report": report,
    }


def _rows(comparison: Comparison, stimulus: Stimulus) -> list[dict[str, Any]]:
    """One for each measure and receptor; what is not defined is None."""
    passed = comparison.passes(stimulus)
    overlay = next((p for p in comparison.overlays if p.stimulus is stimulus), None)
    fit = fit_all(overlay.eps, overlay.recording.rate) if overlay else None
    return [
        {
            "shape": stimulus.indentor,
            "condition": stimulus.condition,
            "measure": measure,
            "receptor_mm": round(float(x), 6),
            "shape_test": None if passed is None else bool(passed[m, k]),
            "r": number(overlay.r[m, k]) if overlay else None,
            "positions": int(np.isfinite(overlay.eps[m, :, k]).sum()) if overlay else None,
            "k": number(fit.k[m, k]) if fit else None,
            "eps0": number(fit.eps0[m, k]) if fit else None,
            "fires_unloaded": bool(fit.fires_unloaded[m, k]) if fit else None,
            "run": stimulus.run,
        }
        for m, measure in enumerate(MEASURES)
        for k, x in enumerate(stimulus.receptor_mm)
    ]


def _joint_rows(joint: Joint) -> list[dict[str, Any]]:
    """The best receptor of each measure, with its limits."""
    return [joint_row(joint, (m, k)) for m in range(len(MEASURES)) if (k := best_receptor(joint, m)) is not None]


def joint_row(joint: Joint, pair: Pair) -> dict[str, Any]:
    """One measure at one receptor over all shapes of a joint fit."""
    limits = joint.interval(*pair)
    return {
        "shapes": [overlay.stimulus.indentor for overlay in joint.overlays],
        "condition": joint.overlays[0].stimulus.condition,
        "measure": MEASURES[pair[0]],
        "receptor_mm": round(float(joint.overlays[0].stimulus.receptor_mm[pair[1]]), 6),
        "k": number(joint.fit.k[pair]),
        "k_interval": [number(v) for v in limits.k] if limits else None,
        "eps0": number(joint.fit.eps0[pair]),
        "eps0_interval": [number(v) for v in limits.eps0] if limits else None,
        "resampled": limits.over if limits else None,
        "fires_unloaded": bool(joint.fit.fires_unloaded[pair]),
        "r2": number(joint.explained[pair]),
    }


def best_receptor(joint: Joint, measure: int) -> int | None:
    """The receptor whose joint fit explains most, among those in play; None where nothing fits."""
    explained = np.where(joint.in_play, joint.explained[measure], np.nan)
    return None if np.isnan(explained).all() else int(np.nanargmax(explained))


def chance_row(joint: Joint) -> dict[str, Any]:
    """The |r| that the largest of so many unrelated correlations exceeds, over the positions that all pairs share."""
    stimulus = joint.overlays[0].stimulus
    which = compared(joint.eps)
    positions = len(joint.rate) if which is None else int(which[1].sum())
    looked_at = len(MEASURES) * len(stimulus.receptor_mm)
    return {
        "shapes": [overlay.stimulus.indentor for overlay in joint.overlays],
        "condition": stimulus.condition,
        "positions": positions,
        "positions_recorded": len(joint.rate),
        "looked_at": looked_at,
        "chance_r": round(chance_correlation(positions, looked_at), 3),
    }


def threshold_rows(comparison: Comparison) -> list[dict[str, Any]]:
    """For each threshold how many of the 18 × receptors pass under each stimulus, and the candidates."""
    judged = [stimulus for stimulus in comparison.stimuli if comparison.passes(stimulus) is not None]
    return [
        {
            "threshold": threshold,
            "counts": [_count(comparison, stimulus, threshold) for stimulus in judged],
            "candidates": comparison.candidates(threshold),
        }
        for threshold in THRESHOLDS
    ]


def _count(comparison: Comparison, stimulus: Stimulus, threshold: float) -> int:
    passed = comparison.passes(stimulus, threshold)
    return 0 if passed is None else int(passed.sum())


def number(value: float) -> float | None:
    """NaN and infinities as None."""
    return float(value) if math.isfinite(value) else None


_DIGITS = 6


def answers_as_json(found: Sequence[Answer]) -> list[dict[str, Any]]:
    """One for each afferent; the same rows as on the page, likeliest first."""
    return [_as_json(answer) for answer in found]


def _as_json(answer: Answer) -> dict[str, Any]:
    headline, following = answer.headline, answer.next
    return {
        "stimuli": list(answer.stimuli),
        "recordings": list(answer.recordings),
        "positions": len(answer.places.rate),
        "positions_recorded": answer.recorded,
        "left_out": [{"stimulus": one.stimulus, "position_mm": list(one.position_mm)} for one in answer.left_out],
        "noise": answer.noise._asdict() | {"freedom": _number(answer.noise.freedom)},
        "outcome": answer.outcome,
        "answer": sentence(answer),
        "besides": sentences(answer),
        "set": [row.title for row in answer.set],
        "controls_in_set": [row.title for row in answer.controls_in_set],
        "headline": headline.title if headline else None,
        "next": following.title if following else None,
        "next_is_worse_by": _number(answer.worse_by),
        "ceiling": {"share": _number(answer.ceiling), "from": answer.ceiling_from},
        "together": _together(answer.together),
        "power": {
            "detectable_misfit": _number(answer.power.detectable),
            "mimics": [one._asdict() for one in answer.power.mimics],
        },
        "intervals": {name: _intervals(answer, name) for name in dict.fromkeys(row.name for row in answer.set)},
        "rows": [_row(row) for row in answer.rows],
        "fingers": answer.fingers,
        "methods": methods(answer),
    }


def _row(row: PairRow) -> dict[str, Any]:
    numbers = ("k", "eps0", "saturation", "r", "r2", "deviance", "lack_of_fit", "p_fit", "p_set", "left_out")
    return {
        "name": row.name,
        "control": row.control,
        "receptor_mm": row.receptor_mm,
        **{name: _number(getattr(row, name)) for name in numbers},
        "k_interval": _limits(row.k_interval),
        "eps0_interval": _limits(row.eps0_interval),
        "fits": row.fits,
        "in_set": row.in_set,
        "fires_unloaded": row.fires_unloaded,
        "finger": row.finger,
    }


def _intervals(answer: Answer, name: str) -> dict[str, Any]:
    return {"k": _limits(answer.interval(name, "k")), "eps0": _limits(answer.interval(name, "eps0"))}


def _together(found: Together | None) -> dict[str, Any] | None:
    if found is None:
        return None
    separate = [
        {"stimulus": one.stimulus, **{name: _number(getattr(one, name)) for name in ("k", "eps0", "left_out")}}
        for one in found.separate
    ]
    return {"ratio": _number(found.ratio), "p": _number(found.p), "separate": separate}


def _limits(found: Limits) -> list[float | None]:
    return [_number(value) for value in found]


def _number(value: float) -> float | None:
    """Six digits; NaN and infinities as None."""
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
