"""How often the statistics of a comparison are right: synthetic recordings with a known answer, many draws.

    .venv/bin/python -m studies.accuracy.interval_coverage [DRAWS] [--cases]    # default 100

Prints the tables of docs/comparison_quality.md.

Runs are simulated here directly, without the bench: SSRPs of steps 1, 3, 5 at 2.33 gwt and of both bars at DOI 1.0.
Recordings are made on the finger that is fitted and on others, and fitted twice: given the default finger, and with
the ranges of examples/plausible_fingers/fingers.toml stated.
"""

import itertools
import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.comparison import Joint, compare
from rig.compare.fingers import PlausibleFingers, read_plausible
from rig.compare.fit import Interval
from rig.compare.recordings.recording import Recording, recording
from rig.compare.recordings.spikes import Afferent, afferent_for, record
from rig.compare.stimuli import Stimulus
from rig.compare.with_finger import WithFinger
from rig.compare.workers import spread
from sim.config import FingertipConfig, Tissue
from sim.measures.measures import MEASURES
from sim.measures.receptors import DEFAULT_DEPTH_MM
from sim.models.fingertip import Fingertip
from studies.source.simulated_stimuli import bars, steps

Array = NDArray[np.float64]

POSITIONS_MM = np.arange(-2.0, 2.01, 0.2)
NOISES = ((60.0, 1.0, 5), (60.0, 0.5, 2), (20.0, 0.5, 2))
TRUTHS = {"steps": (("ep1", -1.0), ("sed", -1.0), ("e13", -1.0), ("e22", -1.0)),
          "step 1 alone": (("ep1", -1.0), ("sed", -1.0)),
          "bars": (("ep1", 0.0), ("ep3", 0.0), ("sed", 0.0))}  # fmt: skip
SILENT = 0.4
POSITIONS_SHARE = 0.25  # of the draws; intervals over positions take long
OUTSIDE_SHARE = 0.25  # of the draws; that it fails there needs no more

RANGES = Path(__file__).parents[2] / "examples" / "plausible_fingers" / "fingers.toml"
INSIDE, SEED = 8, 2024
_TISSUE = Tissue()
ENDS = {
    "epidermis + 25 %": Tissue(epidermis_mm=1.25 * _TISSUE.epidermis_mm),
    "bone + 20 %": Tissue(bone_fraction=1.2 * _TISSUE.bone_fraction),
}
OUTSIDE = {
    "epidermis + 40 %": Tissue(epidermis_mm=1.4 * _TISSUE.epidermis_mm),
    "dermis and fat 25 % softer": Tissue(e_dermis=0.75 * _TISSUE.e_dermis, e_fat=0.75 * _TISSUE.e_fat),
}

Families = dict[str, list[Stimulus]]


class Judged(NamedTuple):
    """One draw: whether the truth was found, and what that costs; widths over k and over the range of ε."""

    pair: float
    pairs: float
    measures: float
    k: float
    eps0: float
    k_width: float
    eps0_width: float
    k_positions: float = np.nan
    eps0_positions: float = np.nan


@dataclass(frozen=True)
class Case:
    """A truth under one family of stimuli with one noise, on some fingers: a piece of work."""

    family: str
    measure: str
    x_mm: float
    noise: tuple[float, float, int]
    made: tuple[list[Stimulus], ...]  # on each of the fingers that are recorded, in turn
    fitted: list[Stimulus]
    draws: int

    @property
    def name(self) -> str:
        """For the table of all cases."""
        return f"{self.family} | {self.measure} at {self.x_mm:g} | {', '.join(f'{v:g}' for v in self.noise)}"


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
    return [FingertipConfig(tissue=Tissue(**tree)) for tree in trees]


def with_design(default: Families, design: list[Families]) -> Families:
    """The stimuli that are fitted, with their measures on every finger of the design."""
    return {
        family: [
            replace(stimulus, on_fingers=np.stack([one[family][n].measures for one in design]))
            for n, stimulus in enumerate(found)
        ]
        for family, found in default.items()
    }


def joint(fitted: list[Stimulus], recordings: list[Recording]) -> Joint:
    """All recordings against the stimuli that are fitted."""
    (found,) = compare(fitted, {s.shape: r for s, r in zip(fitted, recordings, strict=True)}).joints
    return found


def means_only(found: Recording) -> Recording:
    """The same recording without its repeats."""
    return recording(
        found.name, [(float(x), float(r), np.nan) for x, r in zip(found.position_mm, found.rate, strict=True)]
    )


def judge(found: Joint | WithFinger, truth: Afferent, span: float) -> Judged:
    """One draw against the truth, ε of which spans so much."""
    pair = (MEASURES.index(truth.measure), truth.receptor)
    chosen, limits = found.indistinguishable, found.interval(*pair)
    assert chosen is not None
    widths = (np.inf, np.inf) if limits is None else (np.ptp(limits.k) / truth.k, np.ptp(limits.eps0) / span)
    members = float(chosen.sum()), float(chosen.any(axis=1).sum())
    return Judged(float(chosen[pair]), *members, *held(limits, truth), *map(float, widths))


def over_positions(judged: Judged, without_repeats: Joint | WithFinger, truth: Afferent) -> Judged:
    """The same with what intervals say of recordings without repeats."""
    k, eps0 = held(without_repeats.interval(MEASURES.index(truth.measure), truth.receptor), truth)
    return judged._replace(k_positions=k, eps0_positions=eps0)


def held(limits: Interval | None, truth: Afferent) -> tuple[float, float]:
    """Whether k and ε₀ lie in their intervals."""
    if limits is None:
        return 0.0, 0.0
    return float(limits.k[0] <= truth.k <= limits.k[1]), float(limits.eps0[0] <= truth.eps0 <= limits.eps0[1])


def measured(case: Case) -> Array:
    """(2, draws, numbers of `Judged`): given the finger that is fitted, and on all plausible ones."""
    rng = np.random.default_rng(0)
    receptor = int(np.argmin(np.abs(case.fitted[0].receptor_mm - case.x_mm)))
    peak, window_s, repeats = case.noise
    rows = []
    for number, made in zip(range(case.draws), itertools.cycle(case.made), strict=False):
        truth = afferent_for(made, case.measure, receptor, peak, SILENT)
        span = float(np.ptp(np.concatenate([stimulus.ssrp(case.measure, receptor) for stimulus in made])))
        found = [record(truth, stimulus, POSITIONS_MM, rng, repeats, window_s) for stimulus in made]
        given = joint(case.fitted, found)
        judged = judge(given, truth, span), judge(WithFinger(given), truth, span)
        if number < POSITIONS_SHARE * case.draws:
            bare = joint(case.fitted, [means_only(one) for one in found])
            judged = over_positions(judged[0], bare, truth), over_positions(judged[1], WithFinger(bare), truth)
        rows.append(judged)
    return np.moveaxis(np.array(rows), 1, 0)


def cases(made: list[Families], fitted: Families, draws: int) -> list[Case]:
    """Every truth with every noise."""
    return [
        Case(family, measure, x_mm, noise, tuple(one[family] for one in made), fitted[family], draws)
        for family, truths in TRUTHS.items()
        for measure, x_mm in truths
        for noise in NOISES
    ]


HEADER = ("recorded on", "fitted", "draws a case", "pair in the set (%)", "pairs / measures in the set",
          "k (%)", "ε₀ (%)", "width of k", "of ε₀", "k, over positions (%)", "ε₀, over positions (%)")  # fmt: skip
FITTED = ("given the default finger", "on all plausible fingers")


def row(title: str, fitted: str, found: Array) -> str:
    """A line of the table from (cases, draws, numbers): smallest case / mean, and medians of widths."""
    share = dict(zip(Judged._fields, np.nanmean(found, axis=1).T, strict=True))
    middle = Judged(*np.nanmedian(found, axis=(0, 1)))
    both = {name: f"{100 * value.min():.0f} / {100 * value.mean():.1f}" for name, value in share.items()}
    size = f"{share['pairs'].mean():.1f} / {share['measures'].mean():.1f}"
    cells = (title, fitted, str(found.shape[1]), both["pair"], size, both["k"], both["eps0"],
             f"{100 * middle.k_width:.0f} %", f"{100 * middle.eps0_width:.0f} %",
             both["k_positions"], both["eps0_positions"])  # fmt: skip
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the table, and that of every case if asked for."""
    given = [word for word in sys.argv[1:] if word != "--cases"]
    draws, each = int(given[0]) if given else 100, "--cases" in sys.argv
    plausible = read_plausible(RANGES)
    design = [one.config for one in plausible.design(FingertipConfig(), DEFAULT_DEPTH_MM)]
    others = {
        "the fitted finger": [FingertipConfig()],
        f"{INSIDE} fingers drawn within the ranges": inside(plausible),
        **{f"an end: {name}": [FingertipConfig(tissue=tissue)] for name, tissue in ENDS.items()},
        **{f"outside: {name}": [FingertipConfig(tissue=tissue)] for name, tissue in OUTSIDE.items()},
    }
    everything = [FingertipConfig(), *design, *(config for configs in others.values() for config in configs)]
    default, *simulated = spread(families, everything)
    fitted = with_design(default, simulated[: len(design)])
    made = iter(simulated[len(design) :])
    few = math.ceil(OUTSIDE_SHARE * draws)
    work = [
        cases(list(itertools.islice(made, len(configs))), fitted, few if title.startswith("outside") else draws)
        for title, configs in others.items()
    ]
    found = spread(measured, [case for some in work for case in some])
    print(f"nominal 95 %\n\n| {' | '.join(HEADER)} |\n|{'---|' * len(HEADER)}", flush=True)
    for title, some in zip(others, work, strict=True):
        told = np.array(list(itertools.islice(found, len(some))))
        rows = [(title, told)]
        rows += [(f"{title}: {case.name}", one[None]) for case, one in zip(some, told, strict=True)] if each else []
        for name, values in rows:
            for number, how in enumerate(FITTED):
                print(row(name, how, values[:, number]), flush=True)


if __name__ == "__main__":
    main()
