"""How often an answer holds the truth, and how often it is fooled: synthetic afferents with a known answer.

    .venv/bin/python -m studies.answers.answer_coverage [DRAWS]    # default 400 a row

Prints the tables of docs/validation/comparison.md, each line as it is done. Afferents are made on the finger that is
fitted, on eight drawn within the ranges of examples/plausible_fingers/fingers.toml, and on four more, drawn by
another seed, on another mesh; every recording is answered twice, given the default finger and with the ranges stated.
"""

import argparse
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.comparison import Joint, compare
from rig.compare.intervals import limits
from rig.compare.likelihood import Form
from rig.compare.make_verdict import CandidatePool, answers, candidate_pool
from rig.compare.model_confidence_set import set_probabilities
from rig.compare.plausible_fingers import PlausibleFingers, read_plausible
from rig.compare.recordings.recording import Recording, recording
from rig.compare.recordings.synthetic import LinearAfferent, afferent_for
from rig.compare.stimuli import CONTROLS, StimulusRow
from sim.config import FingertipConfig, Tissue
from sim.measures.receptors import DEFAULT_DEPTH_MM
from sim.models.fingertip import Fingertip
from studies.source.simulated_stimuli import bars, steps

Array = NDArray[np.float64]

POSITIONS_MM = np.arange(-2.0, 2.01, 0.2)
TRUTHS = {"steps": (("ep1", -1.0), ("sed", -1.0), ("e13", -1.0), ("e22", -1.0)),
          "step 1 alone": (("ep1", -1.0), ("sed", -1.0)),
          "bars": (("ep1", 0.0), ("ep3", 0.0), ("sed", 0.0))}  # fmt: skip
SILENT = 0.4
RANGES = Path(__file__).parents[2] / "examples" / "plausible_fingers" / "fingers.toml"
INSIDE, SEED = 8, 2024
FRESH_SEED, FRESH, FRESH_MESH_MM = 1998, 4, 0.15
DRAWS_SEED = 20261122
RATES = ((60.0, 1.0), (20.0, 0.5))  # largest rate (/s) and window (s)
LEVEL = 0.05


Families = dict[str, list[StimulusRow]]


def families(config: FingertipConfig) -> Families:
    """The stimuli of both families on one finger."""
    finger = Fingertip.load(config)
    three = steps(finger, 2.33)
    return {"steps": three, "step 1 alone": three[:1], "bars": bars(finger)}


def drawn(free: int) -> Array:
    """(INSIDE, free) places drawn uniformly within the ranges; none is of the design."""
    return np.random.default_rng(SEED).uniform(-1, 1, size=(INSIDE, free))


def inside(plausible: PlausibleFingers) -> list[FingertipConfig]:
    """The fingers at the places that were drawn."""
    places = drawn(len(plausible.free))
    trees = [{name.partition(".")[2]: v for name, v in plausible.values(place).items()} for place in places]
    return [FingertipConfig(tissue=Tissue.model_validate(tree)) for tree in trees]


def with_design(default: Families, design: list[Families]) -> Families:
    """The stimuli that are fitted, with their measures on every finger of the design."""
    return {
        family: [
            replace(stimulus, on_fingers=np.stack([one[family][n].measures for one in design]))
            for n, stimulus in enumerate(found)
        ]
        for family, found in default.items()
    }


class Made(NamedTuple):
    """How afferents are recorded: on which fingers, presses at a place, dispersion, and whether counts are known."""

    title: str
    on: str
    presses: int = 5
    dispersion: float = 1.0
    counted: bool = True


ROWS = (
    Made("right finger", "right"),
    Made("right finger, dispersion 0.3", "right", dispersion=0.3),
    Made("right finger, dispersion 3", "right", dispersion=3.0),
    Made("right finger, three presses", "right", presses=3),
    Made("right finger, one press", "right", presses=1),
    Made("right finger, rates alone", "right", counted=False),
    Made("another finger", "others"),
    Made("another finger, dispersion 0.3", "others", dispersion=0.3),
    Made("another finger and mesh", "fresh"),
    Made("another finger and mesh, one press", "fresh", presses=1),
)


def spikes(rng: np.random.Generator, mean: Array, presses: int, dispersion: float) -> Array:
    """(presses, p) counts of a mean (p,) and a variance of `dispersion` times that."""
    if dispersion == 1:
        return rng.poisson(mean, size=(presses, len(mean))).astype(float)
    if dispersion < 1:
        trials = np.maximum(np.ceil(mean / (1 - dispersion)), 1)
        return rng.binomial(trials.astype(int), mean / trials, size=(presses, len(mean))).astype(float)
    shape = np.maximum(mean, 1e-9) / (dispersion - 1)
    return np.where(mean > 0, rng.negative_binomial(shape, 1 / dispersion, size=(presses, len(mean))), 0.0)


def recorded(
    truth: LinearAfferent, stimulus: StimulusRow, made: Made, window_s: float, rng: np.random.Generator
) -> Recording:
    """What would be recorded where the stimulus went."""
    mean = truth.rate(stimulus, POSITIONS_MM)
    there = np.isfinite(mean)
    counts = spikes(rng, window_s * mean[there], made.presses, made.dispersion)
    return _as_recording(POSITIONS_MM[there], counts / window_s, window_s if made.counted else None)


def _as_recording(position_mm: Array, rates: Array, window_s: float | None) -> Recording:
    rows = [(float(x), float(r), np.nan) for row in rates for x, r in zip(position_mm, row, strict=True)]
    return recording("synthetic", rows, window_s)


class AnsweredDraw(NamedTuple):
    """One draw, answered one way: percentages when averaged, and sizes."""

    in_set: float
    fits: float
    in_confidence_set: float
    pairs: float
    measures: float
    controls: float
    k: float
    eps0: float


@dataclass(frozen=True)
class CoverageStudy:
    """The stimuli that are fitted, with their design, and those of the fingers that afferents are made on."""

    fitted: Families
    made: dict[str, list[Families]]
    plausible: PlausibleFingers


def study() -> CoverageStudy:
    """All simulated, or from the cache: some 24 fingers."""
    plausible = read_plausible(RANGES)
    design = [families(one.config) for one in plausible.design(FingertipConfig(), DEFAULT_DEPTH_MM)]
    default = families(FingertipConfig())
    made = {"right": [default], "others": list(map(families, inside(plausible))), "fresh": fresh(plausible)}
    return CoverageStudy(with_design(default, design), made, plausible)


def fresh(plausible: PlausibleFingers) -> list[Families]:
    """Fingers that nothing was tuned on, on a mesh that nothing was tuned on."""
    places = np.random.default_rng(FRESH_SEED).uniform(-1, 1, size=(FRESH, len(plausible.free)))
    mesh = {"spacing_mm": FRESH_MESH_MM}
    found = []
    for place in places:
        tissue = {name.partition(".")[2]: value for name, value in plausible.values(place).items()}
        found.append(families(FingertipConfig.model_validate({"tissue": tissue, "mesh": mesh})))
    return found


def draws(of: CoverageStudy, made: Made, number: int) -> Iterator[tuple[str, AnsweredDraw, AnsweredDraw]]:
    """Each truth and rate in turn: its name, what is said given the default finger, and on all plausible ones."""
    rng = np.random.default_rng(DRAWS_SEED)
    truths = [(family, measure, x_mm) for family, some in TRUTHS.items() for measure, x_mm in some]
    everything = itertools.cycle(itertools.product(RATES, truths, of.made[made.on]))
    for (peak, window_s), (family, measure, x_mm), there in itertools.islice(everything, number):
        receptor = int(np.argmin(np.abs(of.fitted[family][0].receptor_mm - x_mm)))
        truth = afferent_for(there[family], measure, receptor, peak, SILENT)
        found = [recorded(truth, stimulus, made, window_s, rng) for stimulus in there[family]]
        fitted = of.fitted[family]
        given = compare(fitted, {s.shape: r for s, r in zip(fitted, found, strict=True)})
        (joint,) = given.joints
        told = [judged(joint, truth, with_fingers=with_fingers) for with_fingers in (False, True)]
        yield f"{measure}, {family}, {peak:g} /s", told[0], told[1]


def judged(joint: Joint, truth: LinearAfferent, *, with_fingers: bool) -> AnsweredDraw:
    """What one answer says of the truth."""
    given = candidate_pool(joint.overlays, Form(), with_fingers=with_fingers)
    assert given is not None
    fit = given.candidates.fitted(given.observed)
    ratio, p_fit = given.candidates.tested(given.observed, fit)
    loss = fit.found.deviance / given.observed.noise.dispersion
    p_set = set_probabilities(loss, given.observed.stimulus)
    row = _row(given, truth, joint)
    chosen = (p_fit >= LEVEL) & (p_set >= LEVEL)
    control = np.array([one.control for one in given.named])
    names = {one.name for one, inside in zip(given.named, chosen & ~control, strict=True) if inside}
    region = limits(given.candidates, given.observed, fit, row, float(ratio[row]))
    return AnsweredDraw(
        float(chosen[row]),
        float(p_fit[row] >= LEVEL),
        float(p_set[row] >= LEVEL),
        float((chosen & ~control).sum()),
        float(len(names)),
        float((chosen & control).any()),
        float(region.k[0] <= truth.k <= region.k[1]),
        float(region.eps0[0] <= truth.eps0 <= region.eps0[1]),
    )


def _row(given: CandidatePool, truth: LinearAfferent, joint: Joint) -> int:
    x_mm = float(joint.overlays[0].stimulus.receptor_mm[truth.receptor])
    return next(n for n, one in enumerate(given.named) if (one.name, one.receptor_mm) == (truth.measure, x_mm))


HEADER = ("made on", "answered", "draws", "truth in the set, smallest / mean (%)", "fits (%)", "in the MCS (%)",
          "pairs / measures in the set", "a control, too (%)", "k (%)", "ε₀ (%)")  # fmt: skip
ANSWERED = ("given the default finger", "on all plausible fingers")


def lines(made: Made, names: Sequence[str], found: Array) -> Iterator[str]:
    """Of (draws, 2, numbers): two lines of the table; the smallest is of a truth under its stimuli."""
    truths = np.array([name.rpartition(",")[0] for name in names])
    for n, how in enumerate(ANSWERED):
        mean = AnsweredDraw(*found[:, n].mean(axis=0))
        least = min(found[truths == one, n, 0].mean() for one in np.unique(truths))
        cells = (made.title, how, str(len(found)), f"{100 * least:.0f} / {100 * mean.in_set:.1f}",
                 f"{100 * mean.fits:.1f}", f"{100 * mean.in_confidence_set:.1f}",
                 f"{mean.pairs:.1f} / {mean.measures:.1f}", f"{100 * mean.controls:.0f}",
                 f"{100 * mean.k:.1f}", f"{100 * mean.eps0:.1f}")  # fmt: skip
        yield f"| {' | '.join(cells)} |"


POWER_HEADER = ("rates made by", "at (mm)", "stimuli", "draws", "explained by none of the 18 (%)",
                "not told from it (%)", "it is in the set (%)", "power that is printed")  # fmt: skip
POWER_NOISE, POWER_PRESSES = 0.1, 5


def fooled(of: CoverageStudy, control: int, x_mm: float, stimuli: Sequence[StimulusRow], number: int) -> str:
    """A line of what is said of rates that a control made, linearly from the least of it on, with an sd of 10 %."""
    rng = np.random.default_rng(DRAWS_SEED)
    receptor = int(np.argmin(np.abs(stimuli[0].receptor_mm - x_mm)))
    drive = [s.controls_at(POSITIONS_MM)[control, :, receptor] for s in stimuli]
    least, most = np.nanmin(np.concatenate(drive)), np.nanmax(np.concatenate(drive))
    rows = []
    for _ in range(number):
        recordings = {}
        for stimulus, values in zip(stimuli, drive, strict=True):
            there = np.isfinite(values)
            mean = 60 * (values[there] - least) / (most - least)
            rates = np.maximum(mean * (1 + POWER_NOISE * rng.normal(size=(POWER_PRESSES, there.sum()))), 0)
            recordings[stimulus.shape] = _as_recording(POSITIONS_MM[there], rates, None)
        (answer,) = answers(compare(list(stimuli), recordings))
        itself = [row for row in answer.controls_in_set if row.name == CONTROLS[control]]
        power = next(m.probability for m in answer.power.mimics if m.control.startswith(CONTROLS[control]))
        rows.append((not answer.set, bool(answer.set) and bool(itself), bool(itself), power))
    none, both, itself_in, power = np.mean(np.array(rows, dtype=float), axis=0)
    cells = (CONTROLS[control], f"{x_mm:g}", ", ".join(s.indentor for s in stimuli), str(number), f"{100 * none:.0f}",
             f"{100 * both:.0f}", f"{100 * itself_in:.0f}", f"{power:.2f}")  # fmt: skip
    return f"| {' | '.join(cells)} |"


def print_rows(of: CoverageStudy, number: int) -> None:
    """Print the table of coverage."""
    print(f"| {' | '.join(HEADER)} |\n|{'---|' * len(HEADER)}", flush=True)
    for made in ROWS:
        found = list(draws(of, made, number))
        for line in lines(made, [name for name, *_ in found], np.array([told for _, *told in found])):
            print(line, flush=True)


def print_power(of: CoverageStudy, number: int) -> None:
    """The table of controls that are the truth."""
    print(f"\n| {' | '.join(POWER_HEADER)} |\n|{'---|' * len(POWER_HEADER)}", flush=True)
    steps, bars = of.fitted["steps"], of.fitted["bars"]
    for control in range(len(CONTROLS)):
        for x_mm, stimuli in ((-1.0, steps), (-1.0, steps[:1]), (0.0, bars), (-1.0, [*steps, *bars])):
            print(fooled(of, control, x_mm, stimuli, number), flush=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("draws", type=int, nargs="?", default=400)
    number = parser.parse_args().draws
    of = study()
    print_rows(of, number)
    print_power(of, max(number // 4, 1))


if __name__ == "__main__":
    main()
