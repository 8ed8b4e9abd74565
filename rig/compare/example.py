"""Example of a comparison: one recorded SA-I afferent under a 3 mm bar, against a rehearsal on the simulated finger.

The recording is read from a figure of Phillips and Johnson (J. Neurophysiol. 46, 1204, 1981); its file names the
source and the reading errors. Nothing is fitted to it beforehand: finger, receptors and rate model are the defaults.

The bar is pressed 1 mm in one continuous ramp at each position. The ramp gives the dynamic phase: means and largest
values of the rates at which strain and stress change while the bar goes in, in tissue that relaxes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from rig.compare.candidate_measures import Candidates, by_monotone
from rig.compare.comparison import Comparison, compare
from rig.compare.fit import by_pair, compared, correlation
from rig.compare.likelihood import Form, observed
from rig.compare.model_confidence_set import Predicted, predicted_left_out, set_probabilities
from rig.compare.recordings.columns import column_map
from rig.compare.recordings.presses_table import read_srp
from rig.compare.recordings.recording import Recording
from rig.compare.stimuli import CONTROLS, StimulusRow, answers_key, contact_regions, controls, on_widest_skin
from rig.compare.verdict import A_CONSTANT, LEVEL, titled
from sim.contact.shapes import parse_shape
from sim.errors import ModelRangeError
from sim.measures.measures import (
    BY_NAME,
    MEASURES,
    Elastic,
    measures_in_layers,
    shown,
    strain_energy_density,
    stress_from_strain,
)
from sim.models.cache import Arrays, cached_arrays
from sim.models.default_finger import is_default_finger
from sim.models.fingertip import Fingertip
from sim.models.relaxation import Moves
from sim.models.result import IndentationResult
from sim.units import PSEUDO_E_EPIDERMIS

Array = NDArray[np.float64]

RECORDED = Path(__file__).parent / "data" / "recorded_bar3_rates.csv"
"""Discharge rates of one SA-I afferent at 36 positions of a 3 mm bar."""

SHAPE, DOI_MM = "bar:3.0", 1.0
SPACING_MM = 0.2
"""Spacing of the recorded positions, and of the rehearsal (mm)."""

RECORDED_TO_MM = 3.5
FARTHEST_MM = 5.1
"""The rehearsal goes from 5.1 to −5.1 mm, as far as the planner accepts the bar on the default finger."""

SPEED_MM_S = 10.0
"""Speed of the ramp. The source of the numbers does not state it."""

RELAXATION = ((0.2, 0.07), (0.2, 1.4))
"""Prony series of the relaxing finger, as in `docs/model.md`: share, time constant (s)."""

_RAMP_STEPS = 10

ExamplePhase = Literal["static", "dynamic"]
PHASES: tuple[ExamplePhase, ...] = ("static", "dynamic")
RATES = ("mean rate of", "peak rate of")
"""Rates of change of a measure during the ramp: mean magnitude, and the largest increase per second."""


def recorded(phase: str) -> Recording:
    """Return the recorded rates of a phase."""
    return read_srp(RECORDED, column_map([f"rate={phase}_rate_per_s"]))


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """Simulated bar at every position: measures during the hold, and their rates of change during the ramp.

    `stimulus` has the measures at the end of the ramp. `rates` (2 × 18, n, receptors) in the order of `RATES`, and of
    `MEASURES` in each.
    """

    stimulus: StimulusRow
    rates: Array
    speed_mm_s: float

    def at(self, position_mm: Array) -> tuple[list[str], Array]:
        """Return names and values (names, p, receptors) of measures, rates and controls at recorded positions."""
        names = [*MEASURES, *(f"{rate} {name}" for rate in RATES for name in MEASURES), *CONTROLS]
        s = self.stimulus
        parts = [s.at(position_mm), s._interpolated(self.rates, position_mm), s.controls_at(position_mm)]
        values = np.concatenate(parts)
        return names[: len(values)], values


def positions(spacing_mm: float = SPACING_MM, farthest_mm: float = FARTHEST_MM) -> Array:
    """Return positions x (mm), ascending; the recorded ones of a receptor at x = 0 are among them."""
    n = int(np.floor((farthest_mm - RECORDED_TO_MM) / spacing_mm + 1e-9))
    return np.round(RECORDED_TO_MM + spacing_mm * np.arange(-n - round(2 * RECORDED_TO_MM / spacing_mm), n + 1), 6)


def rehearse(
    finger: Fingertip,
    x_mm: Array,
    speed_mm_s: float = SPEED_MM_S,
    on_position: Callable[[int, int], None] = lambda done, total: None,
) -> Rehearsal:
    """Press the bar in a continuous ramp at each position.

    Positions that the finger model does not accept are skipped. The elastic path is solved once and cached.

    Parameters
    ----------
    finger : Fingertip
    x_mm : ndarray, shape (n,)
    speed_mm_s : float
    on_position : callable
        Called with the number of positions pressed, and of all.

    Returns
    -------
    Rehearsal

    Notes
    -----
    Strain follows the elastic path of the ramp. Stress follows σ(t) = ∫ G(t − s) dσₑ(s), with one Prony series for
    all layers.
    """
    key = answers_key(finger, ["example", SHAPE, DOI_MM, _RAMP_STEPS, x_mm.tolist()])
    arrays, _ = cached_arrays(key, lambda: _as_arrays(ramps(finger, x_mm, on_position)), kind="answers")
    return _rehearsal(finger, cast(dict[str, Array], arrays), speed_mm_s)


def ramps(
    finger: Fingertip, x_mm: Array, on_position: Callable[[int, int], None] = lambda done, total: None
) -> list[list[IndentationResult]]:
    """Press the bar step by step at each position that the finger model accepts."""
    shape, paths = parse_shape(SHAPE), []
    for done, x in enumerate(x_mm):
        on_position(done, len(x_mm))
        path: list[IndentationResult] = []
        try:
            for depth in DOI_MM * np.arange(1, _RAMP_STEPS + 1) / _RAMP_STEPS:
                start = path[-1].state if path else None
                path.append(finger.indent(shape, float(x), doi_mm=float(depth), start=start))
        except ModelRangeError:
            continue
        paths.append(path)
    return paths


def _as_arrays(paths: Sequence[Sequence[IndentationResult]]) -> Arrays:
    results = [path[-1] for path in paths]
    found = np.array([[_strain_and_stress(result) for result in path] for path in paths])
    skin_mm, pressure = on_widest_skin([result.pressure_profile_kpa for result in results])
    return {
        "x_mm": np.array([result.x_mm for result in results]),
        "strain": found[:, :, 0],
        "stress": found[:, :, 1],
        "receptor_e": results[0].model.receptor_e,
        "measures": np.array([[shown(name, r.receptor_measures[name]) for name in MEASURES] for r in results]),
        "force_gwt": np.array([result.force_gwt for result in results]),
        "controls": np.array([controls(result) for result in results]),
        "pressure": pressure,
        "skin_mm": skin_mm,
        "regions_mm": contact_regions(results),
    }


def _strain_and_stress(result: IndentationResult) -> Array:
    """Return (2, receptors, 6) strain, and the strain that gives linear tissue the same stress."""
    strain, receptors = result.receptor_strain, result.receptor_measures
    linear = measures_in_layers(strain, result.model.receptor_e, result.model.poisson)
    with np.errstate(divide="ignore", invalid="ignore"):
        factors = [np.nan_to_num(receptors[name] / linear[name], nan=1.0) for name in ("ep1", "sp1")]
    return np.array([strain * factor[:, None] for factor in factors])


def _rehearsal(finger: Fingertip, arrays: dict[str, Array], speed_mm_s: float) -> Rehearsal:
    n = len(arrays["x_mm"])
    receptors = finger.model.receptors.position_mm[:, 0].round(6) + 0.0
    doi_mm = np.full(n, DOI_MM)
    stimulus = StimulusRow(
        "rehearsal", SHAPE, "doi_mm", DOI_MM, arrays["x_mm"], doi_mm, arrays["force_gwt"],
        np.moveaxis(arrays["measures"], 1, 0), receptors, arrays["skin_mm"], arrays["pressure"],
        arrays["regions_mm"], controls=np.moveaxis(arrays["controls"], 1, 0),
        stiffening=finger.config.tissue.finite_stiffening, default_finger=is_default_finger(finger.config),
    )  # fmt: skip
    return Rehearsal(stimulus, _rates(arrays, finger.config.tissue.poisson, speed_mm_s), speed_mm_s)


def _rates(arrays: dict[str, Array], poisson: float, speed_mm_s: float) -> Array:
    """Return (2 × 18, n, receptors) rates of change from strain (n, steps, receptors, 6) along the ramp."""
    strain, steps = arrays["strain"], arrays["strain"].shape[1]
    step_s = DOI_MM / speed_mm_s / steps
    at_s = step_s * np.arange(1, steps + 1)
    moves, last = Moves(at_s, np.full(steps, step_s)), np.arange(steps)
    remaining: Array = (1 - sum(share for share, _ in RELAXATION)) * np.eye(steps)
    remaining += sum(share * moves.fading(tau_s, at_s, last) for share, tau_s in RELAXATION)
    relaxed = np.einsum("ts,nsrk->ntrk", remaining, arrays["stress"])
    value = _measures(strain, relaxed, arrays["receptor_e"], poisson)
    value = np.concatenate([np.zeros_like(value[:, :, :1]), value], axis=2)
    change = np.diff(value, axis=2) / step_s
    return np.concatenate([np.abs(change).mean(axis=2), np.maximum(change, 0).max(axis=2)])


def _measures(strain: Array, relaxed: Array, young: Array, poisson: float) -> Array:
    """Return (18, n, steps, receptors) measures in the signs of profiles; stress follows the relaxed strain."""
    n, steps, receptors, _ = strain.shape
    ratio = np.tile(young, n * steps)
    of_strain = measures_in_layers(strain.reshape(-1, 6), ratio, poisson)
    of_stress = measures_in_layers(relaxed.reshape(-1, 6), ratio, poisson)
    stress = stress_from_strain(relaxed.reshape(-1, 6), Elastic(1.0, poisson)) * (PSEUDO_E_EPIDERMIS * ratio)[:, None]
    of_stress["sed"] = strain_energy_density(stress, strain.reshape(-1, 6))
    signed = [
        shown(name, of_stress[name] if measure.kind.stress_power else of_strain[name])
        for name, measure in BY_NAME.items()
    ]
    return np.array(signed).reshape(len(MEASURES), n, steps, receptors)


class PhaseCandidate(NamedTuple):
    """Measure, rate or control at one receptor, with its fit, its prediction of held-out positions, and r."""

    name: str
    receptor_mm: float | None
    control: bool
    r: float
    held_out: float
    interval: tuple[float, float]
    p_fit: float
    p_set: float

    @property
    def title(self) -> str:
        """Title, e.g. "sed at 0 mm"."""
        return titled(self.name, self.receptor_mm)

    @property
    def in_set(self) -> bool:
        """Whether the fit is not rejected and no other candidate is significantly better."""
        return self.p_fit >= LEVEL and self.p_set >= LEVEL


@dataclass(frozen=True)
class PhaseVerdict:
    """Candidates of one phase, best prediction first."""

    phase: ExamplePhase
    rows: tuple[PhaseCandidate, ...]
    positions: int
    recorded: int
    bound: float  # share of variance that the best monotone function of any candidate predicts
    sed_r: float  # Pearson's r of SED at receptor 0 over all recorded positions

    @property
    def best(self) -> PhaseCandidate:
        """PhaseCandidate, not a control, that predicts the largest share of the held-out deviance."""
        return next(row for row in self.rows if not row.control)

    def leader(self, names: Sequence[str] = ()) -> PhaseCandidate:
        """Return the best candidate among some names; all measures by default."""
        return next(row for row in self.rows if not row.control and (not names or row.name in names))

    @property
    def kept(self) -> list[PhaseCandidate]:
        """Candidates in the model confidence set, controls among them."""
        return [row for row in self.rows if row.in_set]


BLOCK, DRAWS = 3, 2000


def judge_phase(rehearsal: Rehearsal, recording: Recording, phase: ExamplePhase) -> PhaseVerdict:
    """Return the candidates' fits to one phase, all over the same positions.

    The static phase has the measures at the end of the ramp as candidates, the dynamic phase their rates of change
    too.
    """
    names, eps = rehearsal.at(recording.position_mm)
    if phase == "static":
        chosen = [n for n, name in enumerate(names) if name in MEASURES or name in CONTROLS]
        names, eps = [names[n] for n in chosen], eps[chosen]
    which = compared(eps)
    assert which is not None, "the rehearsal covers the recording"
    receptors, used = which
    at_mm = rehearsal.stimulus.receptor_mm[receptors]
    pairs = by_pair(eps[:, used][..., receptors])
    pairs = np.concatenate([pairs, np.zeros((1, int(used.sum())))])
    named: list[tuple[str, float | None]] = [(name, float(x)) for name in names for x in at_mm]
    named.append((A_CONSTANT, None))
    data = observed([recording], used)
    candidates = Candidates(pairs[None], Form())
    fit = candidates.fitted(data)
    _, p_fit = candidates.tested(data, fit)
    p_set = set_probabilities(fit.found.deviance / data.noise.dispersion, data.stimulus)
    held_out = predicted_left_out(candidates, data)
    share, limits = held_out.share(), intervals(held_out)
    r = correlation(pairs[:, :, None], data.rate)[:, 0]
    is_control = [name in CONTROLS or name == A_CONSTANT for name, _ in named]
    order = np.argsort(-np.nan_to_num(share, nan=-np.inf), kind="stable")
    rows = tuple(
        PhaseCandidate(named[n][0], named[n][1], is_control[n], float(r[n]), float(share[n]),
                  (float(limits[n][0]), float(limits[n][1])), float(p_fit[n]), float(p_set[n]))
        for n in order
    )  # fmt: skip
    return PhaseVerdict(
        phase, rows, int(used.sum()), len(used), by_monotone(pairs, data), sed_correlation(rehearsal, recording)
    )


def sed_correlation(rehearsal: Rehearsal, recording: Recording, receptor_mm: float = 0.0) -> float:
    """Return Pearson's r of SED at a receptor with the rates, over the recorded positions that are covered."""
    number = int(np.argmin(np.abs(rehearsal.stimulus.receptor_mm - receptor_mm)))
    eps = rehearsal.stimulus.at(recording.position_mm)
    return float(correlation(eps, recording.rate)[MEASURES.index("sed"), number])


def intervals(predicted: Predicted) -> Array:
    """Return (N, 2) 95 % intervals of the predicted shares, over draws of blocks of neighboring positions."""
    n = predicted.deviance.shape[1]
    draws = np.random.default_rng(0).integers(0, n, (DRAWS, -(-n // BLOCK)))
    at = ((draws[..., None] + np.arange(BLOCK)) % n).reshape(DRAWS, -1)[:, :n]
    counts = np.array([np.bincount(row, minlength=n) for row in at])
    with np.errstate(divide="ignore", invalid="ignore"):
        share = 1 - predicted.deviance @ counts.T / (predicted.of_mean @ counts.T)
    return np.asarray(np.nanquantile(share, [0.025, 0.975], axis=1).T)


def static_comparison(rehearsal: Rehearsal) -> Comparison:
    """Return the comparison of the static phase, for the figures of the page."""
    return compare([rehearsal.stimulus], {rehearsal.stimulus.shape: recorded("static")})
