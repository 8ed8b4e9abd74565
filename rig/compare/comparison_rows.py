"""A comparison as rows and as JSON: for `--json` and for the tables of the report."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NotRequired

import numpy as np
from numpy.typing import NDArray

from rig.compare.comparison import Comparison, Joint, LeftOutOfRecordingJson, Pair, left_out_rows
from rig.compare.fit import Fit, chance_correlation, compared, fit_all
from rig.compare.intervals import ConfidenceLimits
from rig.compare.make_verdict import joint_limits
from rig.compare.place_grid import PlaceJson
from rig.compare.plausible_fingers import PlausibleFingers, fit_all_with_finger
from rig.compare.profile_shape_test import THRESHOLDS, ShapeTestChanceJson, chance_rows
from rig.compare.spike_clock import ClockShiftJson, RecordingJson
from rig.compare.stimuli import CONTROL_UNITS, StimulusRow
from rig.compare.verdict import AfferentVerdict, Candidate, Outcome, PairRow, six_digits
from rig.compare.verdict_text import methods, sentence, sentences
from rig.data.run import RunWarningJson
from rig.units import unit_of_key
from rig_shared.outputs import File, Interval, Name, Output, Ratio, Shape, Unit
from sim.measures.measures import BY_NAME, MEASURES, MeasureName
from sim.models.interpolation import HOW_MADE
from sim.models.small_strain_error import SmallStrainJson

Array = NDArray[np.float64]


class StimulusJson(Output):
    """A stimulus, and the number that was commanded."""

    stimulus: Name
    shape: Shape
    condition: Name
    target: Literal["doi_mm", "force_gwt"]
    value: float
    unit: Literal["mm", "gwt"]
    run: File


class ComparisonRowJson(Output):
    """A measure at a receptor under a stimulus, R = k (ε − ε₀). unit: of ε; k is in impulses/s per unit."""

    shape: Shape
    condition: Name
    measure: MeasureName
    unit: Unit
    receptor_mm: float
    shape_test: bool | None
    r: Ratio | None
    positions: int | None
    k: float | None
    eps0: float | None
    fires_unloaded: bool | None
    run: File


class MeasuresOfGroupJson(Output):
    """Measures that pass the shape test under a group of stimuli."""

    group: Name
    measures: list[MeasureName]


class CollinearInGroupJson(Output):
    """Sets of measures that no recording of a group can distinguish."""

    group: Name
    sets: list[list[MeasureName]]


class PairOfShapesJson(Output):
    """A measure at a receptor, under several shapes."""

    shapes: list[Shape]
    condition: Name
    measure: MeasureName
    unit: Unit
    receptor_mm: float


class LineJson(Output):
    """Least-squares line, with 95 % limits of the likelihood."""

    k: float | None
    k_interval: Interval | None
    eps0: float | None
    eps0_interval: Interval | None


class JointFitJson(PairOfShapesJson, LineJson):
    """A measure fitted to several shapes, by least squares, with 95 % limits of the likelihood."""

    fires_unloaded: bool
    r2: Ratio | None


class FitValuesJson(LineJson):
    """Same fit on the run's own finger."""

    unit: Unit
    r2: Ratio | None


class NamedValueJson(Output):
    """A parameter of a finger, by its place in the configuration."""

    name: Name
    value: float
    unit: Unit


class NamedRangeJson(Output):
    """Range of a parameter of a finger."""

    name: Name
    low: float
    high: float
    unit: Unit


class FitWithFingerJson(PairOfShapesJson, LineJson):
    """A measure with its best plausible finger."""

    r2: Ratio | None
    best_finger: list[NamedValueJson]
    on_this_finger: FitValuesJson


class PlausibleFingersJson(Output):
    """Fits over plausible fingers."""

    ranges: list[NamedRangeJson]
    built: int
    interpolation_text: str | None
    joint: list[FitWithFingerJson]


class ChanceJson(Output):
    """Correlation that chance alone exceeds in one of twenty cases."""

    shapes: list[Shape]
    condition: Name
    positions: int
    positions_recorded: int
    looked_at: int
    chance_r: Ratio


class PairJson(Output):
    """A measure or control at a receptor; a constant rate has none."""

    measure: Candidate
    receptor_mm: float | None


class LeftOutOfAnswerJson(Output):
    """Positions of a stimulus that are not used."""

    stimulus: Name
    position_mm: list[float]


class RecordingNoiseJson(Output):
    """Noise of a recording. dispersion: of counts and of rates with an sd relative, of rates alone (impulses/s)²."""

    kind: Literal["counts", "sd", "rates"]
    source: Literal["repeats", "sd", "neighbours"]
    dispersion: Ratio
    freedom: Ratio | None


class CeilingJson(Output):
    """Share of the variance that a model can explain."""

    share: Ratio | None
    source: Literal["repeats", "monotone"]


class SeparateFitJson(Output):
    """Maximum-likelihood pair fitted to one stimulus."""

    stimulus: Name
    unit: Unit
    k: float | None
    eps0: float | None
    left_out: Ratio | None


class TogetherJson(Output):
    """F test of separate fits against one fit of all stimuli."""

    ratio: Ratio | None
    p: Ratio | None
    separate: list[SeparateFitJson]


class MimicJson(Output):
    """Pair that imitates a control best, and the probability that it would be rejected."""

    control: PairJson
    pair: PairJson
    probability: Ratio


class PowerJson(Output):
    """Power of the fit test."""

    detectable_misfit: Ratio | None
    mimics: list[MimicJson]


class IntervalJson(Output):
    """Limits of k and ε₀ over the receptors of the set."""

    measure: MeasureName
    unit: Unit
    k: Interval
    eps0: Interval


class PairRowJson(Output):
    """A measure or control at a receptor, with its fit."""

    measure: Candidate
    control: bool
    unit: Unit
    receptor_mm: float | None
    k: float | None
    eps0: float | None
    saturation: Ratio | None
    r: Ratio | None
    r2: Ratio | None
    deviance: Ratio | None
    lack_of_fit: Ratio | None
    p_fit: Ratio | None
    p_set: Ratio | None
    left_out: Ratio | None
    k_interval: Interval
    eps0_interval: Interval
    fits: bool
    in_set: bool
    fires_unloaded: bool
    finger: list[NamedValueJson] | None


class AnswerJson(Output):
    """Verdict on one afferent; rows in order of descending likelihood."""

    stimuli: list[Name]
    recordings: list[File]
    positions: int
    positions_recorded: int
    left_out: list[LeftOutOfAnswerJson]
    noise: RecordingNoiseJson
    outcome: Outcome
    answer_text: str
    besides_text: list[str]
    set: list[PairJson]
    controls_in_set: list[PairJson]
    headline: PairJson | None
    next: PairJson | None
    next_is_worse_by: Ratio | None
    ceiling: CeilingJson
    together: TogetherJson | None
    power: PowerJson
    intervals: list[IntervalJson]
    rows: list[PairRowJson]
    fingers: int
    methods_text: str


class PhaseCandidateJson(Output):
    """Measure, rate of a measure or control at one receptor, against one phase of the example."""

    candidate: Name
    receptor_mm: float | None
    control: bool
    r: Ratio | None
    held_out: Ratio | None
    p_fit: Ratio | None
    p_set: Ratio | None
    held_out_interval: list[Ratio | None]
    in_set: bool


class PhaseJson(Output):
    """One phase of the recorded example; candidates by the share of held-out deviance they predict."""

    phase: Literal["static", "dynamic"]
    positions: int
    positions_recorded: int
    sed_r: Ratio | None
    monotone_bound: Ratio | None
    rows: list[PhaseCandidateJson]


class CompareJson(Output):
    """Runs against recordings; k and ε₀ in the signs in which profiles are shown."""

    stimuli: list[StimulusJson]
    rows: list[ComparisonRowJson]
    candidates: list[MeasureName]
    candidates_by_condition: list[MeasuresOfGroupJson]
    collinear: list[CollinearInGroupJson]
    joint: list[JointFitJson]
    chance: list[ChanceJson]
    small_strain: SmallStrainJson
    report: File
    left_out: list[LeftOutOfRecordingJson]
    shape_test: list[ShapeTestChanceJson]
    answers: list[AnswerJson]
    recordings: NotRequired[list[RecordingJson]]
    clock_shift: NotRequired[ClockShiftJson | None]
    deflection_text: NotRequired[str]
    indentors_text: NotRequired[str]
    """Indentors of the runs, with what was read of them."""
    places: list[PlaceJson]
    fingers: NotRequired[PlausibleFingersJson]
    phases: NotRequired[list[PhaseJson]]
    warnings: NotRequired[list[RunWarningJson]]


def as_json(
    comparison: Comparison,
    report: str,
    verdicts: Sequence[AfferentVerdict] = (),
    places: Sequence[PlaceJson] = (),
) -> CompareJson:
    """Return the JSON of `rig compare --json`; k and ε₀ are in the signs in which profiles are shown."""
    return {
        "stimuli": [_stimulus(stimulus) for stimulus in comparison.stimuli],
        "rows": [row for stimulus in comparison.stimuli for row in _rows(comparison, stimulus)],
        "candidates": comparison.candidates(),
        "candidates_by_condition": [
            {"group": group, "measures": measures} for group, measures in comparison.candidates_by_condition()
        ],
        "collinear": [{"group": group, "sets": sets} for group, sets in comparison.collinear()],
        "joint": [row for one in comparison.joints for row in _joint_rows(one, best_pairs(one, one.explained))],
        "chance": [chance_row(joint) for joint in comparison.joints],
        "small_strain": comparison.small_strain.as_json(),
        "report": report,
        "left_out": left_out_rows(comparison),
        "shape_test": chance_rows(comparison.stimuli),
        "answers": answers_as_json(verdicts),
        "places": list(places),
    }


def measure_unit(name: str) -> str:
    """Return the unit of a measure or control; a constant rate has none."""
    return BY_NAME[name].unit if name in BY_NAME else CONTROL_UNITS.get(name, "")


def _stimulus(stimulus: StimulusRow) -> StimulusJson:
    return {
        "stimulus": stimulus.title,
        "shape": stimulus.indentor,
        "condition": stimulus.condition,
        "target": "doi_mm" if stimulus.kind == "doi_mm" else "force_gwt",
        "value": stimulus.commanded,
        "unit": "mm" if stimulus.kind == "doi_mm" else "gwt",
        "run": stimulus.run,
    }


def _rows(comparison: Comparison, stimulus: StimulusRow) -> list[ComparisonRowJson]:
    """Return a row per measure and receptor; undefined values are None."""
    passed = comparison.passes(stimulus)
    overlay = next((p for p in comparison.overlays if p.stimulus is stimulus), None)
    fit = fit_all(overlay.eps, overlay.recording.rate) if overlay else None
    return [
        {
            "shape": stimulus.indentor,
            "condition": stimulus.condition,
            "measure": measure,
            "unit": BY_NAME[measure].unit,
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


def fingers_as_json(comparison: Comparison) -> PlausibleFingersJson | None:
    """Return the JSON for plausible fingers; nothing without ranges."""
    plausible = comparison.plausible
    if plausible is None:
        return None
    return {
        "ranges": [
            {"name": name, "low": low, "high": high, "unit": unit_of_key(name) or "1"}
            for name, (low, high) in plausible.ranges.items()
        ],
        "built": 3 ** len(plausible.free),
        "interpolation_text": HOW_MADE if comparison.interpolated else None,
        "joint": [row for joint in comparison.joints for row in _rows_with_finger(joint, plausible)],
    }


def _joint_rows(joint: Joint, pairs: Sequence[Pair]) -> list[JointFitJson]:
    """Return the least-squares fit of pairs over all shapes of a joint fit, with likelihood limits."""
    return [
        {
            **_named(joint, pair),
            **_line(joint.fit, pair, limits),
            "fires_unloaded": bool(joint.fit.fires_unloaded[pair]),
            "r2": number(joint.explained[pair]),
        }
        for pair, limits in zip(pairs, joint_limits(joint, pairs), strict=True)
    ]


def _rows_with_finger(joint: Joint, plausible: PlausibleFingers) -> list[FitWithFingerJson]:
    """Return joint fits of pairs on their best plausible finger, beside those on the run's own finger."""
    place, fit = fit_all_with_finger(joint.eps_on_fingers, joint.rate)
    explained = joint.explained_by(fit)
    pairs = best_pairs(joint, explained)
    limits = joint_limits(joint, pairs, with_fingers=True)
    return [
        {
            **_named(joint, pair),
            "r2": number(explained[pair]),
            "best_finger": named_values(plausible.values(place[pair])),
            **_line(fit, pair, on_all),
            "on_this_finger": {
                "unit": single["unit"],
                "k": single["k"],
                "k_interval": single["k_interval"],
                "eps0": single["eps0"],
                "eps0_interval": single["eps0_interval"],
                "r2": single["r2"],
            },
        }
        for pair, on_all, single in zip(pairs, limits, _joint_rows(joint, pairs), strict=True)
    ]


def _named(joint: Joint, pair: Pair) -> PairOfShapesJson:
    stimulus = joint.overlays[0].stimulus
    return {
        "shapes": [overlay.stimulus.indentor for overlay in joint.overlays],
        "condition": stimulus.condition,
        "measure": MEASURES[pair[0]],
        "unit": BY_NAME[MEASURES[pair[0]]].unit,
        "receptor_mm": round(float(stimulus.receptor_mm[pair[1]]), 6),
    }


def named_values(values: Mapping[str, float]) -> list[NamedValueJson]:
    """Return the parameters of a finger with their configuration keys."""
    return [
        {"name": name, "value": round(value, 6), "unit": unit_of_key(name) or "1"} for name, value in values.items()
    ]


def _line(fit: Fit, pair: Pair, limits: ConfidenceLimits | None) -> LineJson:
    k, eps0 = (None, None) if limits is None else ((number(low), number(high)) for low, high in limits)
    return {"k": number(fit.k[pair]), "k_interval": k, "eps0": number(fit.eps0[pair]), "eps0_interval": eps0}


def best_pairs(joint: Joint, explained: Array) -> list[Pair]:
    """Return each fitted measure at its receptor in play with the largest `explained` (18, receptors)."""
    share = np.where(joint.in_play & np.isfinite(explained), explained, -np.inf)
    return [(m, int(np.argmax(row))) for m, row in enumerate(share) if np.isfinite(row).any()]


def chance_row(joint: Joint) -> ChanceJson:
    """Return the |r| that the largest of that many unrelated correlations exceeds, over shared positions."""
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
    """Return, for each threshold, the number of passing receptors under each stimulus, and the candidates."""
    judged = [stimulus for stimulus in comparison.stimuli if comparison.passes(stimulus) is not None]
    return [
        {
            "threshold": threshold,
            "counts": [_count(comparison, stimulus, threshold) for stimulus in judged],
            "candidates": comparison.candidates(threshold),
        }
        for threshold in THRESHOLDS
    ]


def _count(comparison: Comparison, stimulus: StimulusRow, threshold: float) -> int:
    passed = comparison.passes(stimulus, threshold)
    return 0 if passed is None else int(passed.sum())


def number(value: float) -> float | None:
    """Return None for NaN and infinities."""
    return float(value) if math.isfinite(value) else None


def answers_as_json(found: Sequence[AfferentVerdict]) -> list[AnswerJson]:
    """Return a verdict per afferent, with the rows of the page in order of likelihood."""
    return [_as_json(answer) for answer in found]


def _as_json(answer: AfferentVerdict) -> AnswerJson:
    headline, following = answer.headline, answer.next
    by_title = {row.title: row for row in answer.rows}
    return {
        "stimuli": list(answer.stimuli),
        "recordings": list(answer.recordings),
        "positions": len(answer.places.rate),
        "positions_recorded": answer.recorded,
        "left_out": [{"stimulus": one.stimulus, "position_mm": list(one.position_mm)} for one in answer.left_out],
        "noise": {
            "kind": answer.noise.kind,
            "source": answer.noise.source,
            "dispersion": answer.noise.dispersion,
            "freedom": six_digits(answer.noise.freedom),
        },
        "outcome": answer.outcome,
        "answer_text": sentence(answer),
        "besides_text": sentences(answer),
        "set": [_pair(row) for row in answer.set],
        "controls_in_set": [_pair(row) for row in answer.controls_in_set],
        "headline": _pair(headline) if headline else None,
        "next": _pair(following) if following else None,
        "next_is_worse_by": six_digits(answer.worse_by),
        "ceiling": {"share": six_digits(answer.ceiling), "source": answer.ceiling_from},
        "together": _together(answer),
        "power": {
            "detectable_misfit": six_digits(answer.power.detectable),
            "mimics": [
                {
                    "control": _pair(by_title[one.control]),
                    "pair": _pair(by_title[one.pair]),
                    "probability": one.probability,
                }
                for one in answer.power.mimics
            ],
        },
        "intervals": [_intervals(answer, name) for name in dict.fromkeys(row.name for row in answer.set)],
        "rows": [_row(row) for row in answer.rows],
        "fingers": answer.fingers,
        "methods_text": methods(answer),
    }


def _pair(row: PairRow) -> PairJson:
    return {"measure": row.name, "receptor_mm": row.receptor_mm}


def _row(row: PairRow) -> PairRowJson:
    return {
        "measure": row.name,
        "control": row.control,
        "unit": measure_unit(row.name),
        "receptor_mm": row.receptor_mm,
        "k": six_digits(row.k),
        "eps0": six_digits(row.eps0),
        "saturation": six_digits(row.saturation),
        "r": six_digits(row.r),
        "r2": six_digits(row.r2),
        "deviance": six_digits(row.deviance),
        "lack_of_fit": six_digits(row.lack_of_fit),
        "p_fit": six_digits(row.p_fit),
        "p_set": six_digits(row.p_set),
        "left_out": six_digits(row.left_out),
        "k_interval": _limits(row.k_interval),
        "eps0_interval": _limits(row.eps0_interval),
        "fits": row.fits,
        "in_set": row.in_set,
        "fires_unloaded": row.fires_unloaded,
        "finger": None if row.finger is None else named_values(row.finger),
    }


def _intervals(answer: AfferentVerdict, name: str) -> IntervalJson:
    k, eps0 = _limits(answer.interval(name, "k")), _limits(answer.interval(name, "eps0"))
    return {"measure": name, "unit": measure_unit(name), "k": k, "eps0": eps0}


def _together(answer: AfferentVerdict) -> TogetherJson | None:
    found = answer.together
    if found is None:
        return None
    unit = measure_unit(answer.closest.name)
    separate: list[SeparateFitJson] = [
        {
            "stimulus": one.stimulus,
            "unit": unit,
            "k": six_digits(one.k),
            "eps0": six_digits(one.eps0),
            "left_out": six_digits(one.left_out),
        }
        for one in found.separate
    ]
    return {"ratio": six_digits(found.ratio), "p": six_digits(found.p), "separate": separate}


def _limits(found: tuple[float, float]) -> Interval:
    low, high = found
    return six_digits(low), six_digits(high)
