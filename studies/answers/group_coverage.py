"""How often a verdict on several afferents holds the truth, and how often a wrong measure leads.

    .venv/bin/python -m studies.answers.group_coverage [DRAWS]    # default 40 a row

Prints the table of docs/validation/comparison.md. Each draw is a group of synthetic afferents with one measure in
common: their receptors are drawn among the inner eight, log gains with a standard deviation of 0.3, and thresholds at
40 ± 10 % of the range of the measure at x = −1 mm. Afferents whose largest mean rate is below 10 /s are drawn anew.
"""

import argparse
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.comparison import compare
from rig.compare.group import Ranked, ranked
from rig.compare.likelihood import Form
from rig.compare.make_verdict import CandidatePool, candidate_pool
from rig.compare.recordings.recording import Recording, recording
from rig.compare.stimuli import CONTROLS, StimulusRow
from sim.config import FingertipConfig, Tissue
from sim.measures.measures import MEASURES
from studies.answers.answer_coverage import Families, families, spikes

Array = NDArray[np.float64]

POSITIONS_MM = np.arange(-2.0, 2.01, 0.2)
GAIN_SD, SILENT, SILENT_SD = 0.3, 0.4, 0.1
PEAK, LEAST_PEAK, WINDOW_S = 60.0, 10.0, 1.0
SEED = 20261126
TRUTHS = ("ep1", "sed", "e22", "sp3")
OTHER_FINGER = FingertipConfig(tissue=Tissue(epidermis_mm=0.5))


class Made(NamedTuple):
    """How groups are recorded: stimuli, number of afferents, presses at a place, dispersion, on which finger."""

    family: str
    afferents: int
    presses: int = 5
    dispersion: float = 1.0
    finger: str = "the right one"
    control: bool = False  # the truth is a control


ROWS = (
    Made("steps", 3),
    Made("step 1 alone", 8, presses=1),
    Made("steps", 5, control=True),
    Made("steps", 3, finger="another epidermis"),
    Made("step 1 alone", 3, presses=1),
    Made("steps", 8),
)
HEADER = ("stimuli", "afferents", "presses", "dispersion", "finger of the afferents", "truth", "draws",
          "truth in the set (%)", "truth leads (%)", "a wrong measure leads (%)", "measures in the set",
          "mean log gain in its limits (%)", "mean threshold in its limits (%)")  # fmt: skip


class GroupDraw(NamedTuple):
    """One draw: whether the truth is in the set, leads, another measure leads, the set's size, and the limits."""

    in_set: float
    leads: float
    wrong: float
    size: float
    gain: float
    threshold: float


def profile(stimulus: StimulusRow, truth: str, receptor: int) -> Array:
    """(p,) values of the true measure or control at one receptor; NaN where the run did not go."""
    if truth in CONTROLS:
        return np.asarray(stimulus.controls_at(POSITIONS_MM)[CONTROLS.index(truth), :, receptor])
    return np.asarray(stimulus.at(POSITIONS_MM)[MEASURES.index(truth), :, receptor])


def pool(fitted: list[StimulusRow], there: list[StimulusRow], truth: str, made: Made, rng: np.random.Generator,
         population: tuple[float, float, float]) -> CandidatePool:  # fmt: skip
    """The candidates of one afferent that was drawn from a population: mean log gain, threshold, sd of this."""
    peak = 0.0
    while peak < LEAST_PEAK:  # nobody keeps an afferent without a response
        receptor = int(rng.integers(1, len(fitted[0].receptor_mm) - 1))
        k = np.exp(population[0] + GAIN_SD * rng.normal())
        eps0 = population[1] + population[2] * rng.normal()
        peak = max(float(np.nanmax(k * (profile(source, truth, receptor) - eps0))) for source in there)
    found: dict[str, Recording] = {}
    for stimulus, source in zip(fitted, there, strict=True):
        mean = np.maximum(0.0, k * (profile(source, truth, receptor) - eps0))
        covered = np.isfinite(mean)
        counts = spikes(rng, WINDOW_S * mean[covered], made.presses, made.dispersion)
        places = POSITIONS_MM[covered]
        rows = [(float(x), float(n) / WINDOW_S, np.nan) for row in counts for x, n in zip(places, row, strict=True)]
        found[stimulus.shape] = recording("synthetic", rows, WINDOW_S)
    given = candidate_pool(compare(fitted, found).overlays, Form())
    assert given is not None
    return given


def population_of(there: list[StimulusRow], truth: str) -> tuple[float, float, float]:
    """Mean log gain, mean threshold and its standard deviation."""
    receptor = int(np.argmin(np.abs(there[0].receptor_mm + 1.0)))
    values = np.concatenate([profile(stimulus, truth, receptor) for stimulus in there])
    values = values[np.isfinite(values)]
    reach = float(np.ptp(values))
    return float(np.log(PEAK / ((1 - SILENT) * reach))), float(values.min()) + SILENT * reach, SILENT_SD * reach


def judged(rows: list[Ranked], truth: str, population: tuple[float, float, float]) -> GroupDraw:
    """What a verdict says of the truth."""
    inside = [row.name for row in rows if row.in_set]
    leader = inside[0] if len(inside) == 1 and inside[0] not in CONTROLS else None
    of = next(row.fit.population for row in rows if row.name == truth)
    return GroupDraw(
        truth in inside,
        leader == truth,
        leader not in (None, truth),
        len(inside),
        of.gain_limits[0] <= np.exp(population[0]) <= of.gain_limits[1],
        of.threshold_limits[0] <= population[1] <= of.threshold_limits[1],
    )


def draws(fitted: Families, there: Families, made: Made, number: int) -> Iterator[GroupDraw]:
    """Groups, the truths in turn."""
    rng = np.random.default_rng([SEED, ROWS.index(made)] if made in ROWS else SEED)
    truths = CONTROLS[:2] if made.control else TRUTHS
    for n in range(number):
        truth = truths[n % len(truths)]
        stimuli, source = fitted[made.family], there[made.family]
        population = population_of(source, truth)
        pools = [pool(stimuli, source, truth, made, rng, population) for _ in range(made.afferents)]
        yield judged(ranked(pools), truth, population)


def line(made: Made, found: list[GroupDraw]) -> str:
    """A row of the table."""
    mean = GroupDraw(*np.mean(np.array(found, dtype=float), axis=0))
    percent = [f"{100 * value:.0f}" for value in mean]
    percent[3] = f"{mean.size:.1f}"
    truth = "a control" if made.control else "a measure"
    cells = (
        made.family,
        made.afferents,
        made.presses,
        f"{made.dispersion:g}",
        made.finger,
        truth,
        len(found),
        *percent,
    )
    return f"| {' | '.join(map(str, cells))} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("draws", type=int, nargs="?", default=40)
    number = parser.parse_args().draws
    fitted = families(FingertipConfig())
    print(f"| {' | '.join(HEADER)} |\n|{'---|' * len(HEADER)}", flush=True)
    for made in ROWS:
        there = fitted if made.finger == "the right one" else families(OTHER_FINGER)
        print(line(made, list(draws(fitted, there, made, number))), flush=True)


if __name__ == "__main__":
    main()
