"""How often the statistics of a comparison are right: synthetic recordings with a known answer, many draws.

    .venv/bin/python bench/coverage.py [DRAWS]    # default 200; the tables of docs/comparison.md, about ten minutes

Runs are simulated here directly, without the bench: SSRPs of steps 1, 3, 5 at 2.33 gwt and of both bars at DOI 1.0.
The later tables fit recordings that were made on other fingers than the one that is fitted.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rig.compare.comparison import Comparison, Joint, compare
from rig.compare.recorded import Recording, recording
from rig.compare.stimuli import Stimulus
from rig.compare.synthetic import Afferent, afferent_for, record
from sim.config import FingertipConfig, Tissue
from sim.fingertip import Fingertip
from sim.measures.measures import MEASURES
from simulated import bars, steps

POSITIONS_MM = np.arange(-2.0, 2.01, 0.2)
NOISES = ((60.0, 1.0, 5), (60.0, 0.5, 2), (20.0, 0.5, 2))
TRUTHS = {"steps": (("ep1", -1.0), ("sed", -1.0), ("e13", -1.0), ("e22", -1.0)),
          "step 1 alone": (("ep1", -1.0), ("sed", -1.0)),
          "bars": (("ep1", 0.0), ("ep3", 0.0), ("sed", 0.0))}  # fmt: skip

OTHERS = {
    "epidermis + 25 %": Tissue(epidermis_mm=1.25 * Tissue().epidermis_mm),
    "bone + 20 %": Tissue(bone_fraction=1.2 * Tissue().bone_fraction),
}


def families(finger: Fingertip) -> dict[str, list[Stimulus]]:
    """The stimuli of both families."""
    three = steps(finger, 2.33)
    return {"steps": three, "step 1 alone": three[:1], "bars": bars(finger)}


@dataclass
class Tally:
    """How many draws were right."""

    in_set: int = 0
    k: int = 0
    eps0: int = 0
    k_positions: int = 0
    eps0_positions: int = 0
    members: int = 0
    measures: int = 0
    measure_in_set: int = 0

    def add(self, joint: Joint, without_repeats: Joint, truth: Afferent) -> None:
        """Judge one draw."""
        pair = (MEASURES.index(truth.measure), truth.receptor)
        chosen = joint.indistinguishable
        assert chosen is not None
        self.in_set += int(chosen[pair])
        self.measure_in_set += int(chosen[pair[0]].any())
        self.members += int(chosen.sum())
        self.measures += int(chosen.any(axis=1).sum())
        for found, names in ((joint, ("k", "eps0")), (without_repeats, ("k_positions", "eps0_positions"))):
            limits = found.interval(*pair)
            if limits is not None:
                for name, value, (low, high) in zip(names, (truth.k, truth.eps0), limits[:2], strict=True):
                    setattr(self, name, getattr(self, name) + int(low <= value <= high))


def joint(fitted: list[Stimulus], recordings: list[Recording]) -> Joint:
    """All recordings against the stimuli that are fitted."""
    found: Comparison = compare(fitted, {s.shape: r for s, r in zip(fitted, recordings, strict=True)})
    assert len(found.joints) == 1
    return found.joints[0]


def means_only(found: Recording) -> Recording:
    """The same recording without its repeats."""
    return recording(
        found.name, [(float(x), float(r), np.nan) for x, r in zip(found.position_mm, found.rate, strict=True)]
    )


def cases(made: dict[str, list[Stimulus]], fitted: dict[str, list[Stimulus]], draws: int) -> Iterator[str]:
    """A line of the table for each family, truth and noise."""
    rng = np.random.default_rng(0)
    for family, truths in TRUTHS.items():
        for measure, x_mm in truths:
            receptor = int(np.argmin(np.abs(made[family][0].receptor_mm - x_mm)))
            for peak, window_s, repeats in NOISES:
                truth = afferent_for(made[family], measure, receptor, peak, 0.4)
                tally = Tally()
                for _ in range(draws):
                    found = [record(truth, s, POSITIONS_MM, rng, repeats, window_s) for s in made[family]]
                    tally.add(
                        joint(fitted[family], found), joint(fitted[family], [means_only(r) for r in found]), truth
                    )
                parts = [
                    tally.in_set,
                    tally.measure_in_set,
                    tally.k,
                    tally.eps0,
                    tally.k_positions,
                    tally.eps0_positions,
                ]
                shares = " | ".join(f"{100 * n / draws:.0f}" for n in parts)
                yield (
                    f"| {family} | {measure} at {x_mm:g} | {peak:g}, {window_s:g}, {repeats} | {shares} | "
                    f"{tally.members / draws:.1f} / {tally.measures / draws:.1f} |"
                )


def table(title: str, lines: Iterator[str]) -> None:
    """Print as it comes."""
    columns = ("family", "truth", "peak rate (/s), window (s), repeats", "pair in the set (%)", "measure (%)",
               "k (%)", "ε₀ (%)", "k, over positions (%)", "ε₀, over positions (%)",
               "pairs / measures in the set")  # fmt: skip
    print(f"\n{title}\n\n| {' | '.join(columns)} |\n|{'---|' * len(columns)}", flush=True)
    for line in lines:
        print(line, flush=True)


def main() -> None:
    """Print the tables."""
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    default = families(Fingertip.load())
    print(f"{draws} draws a line, nominal 95 %")
    table("The finger that is fitted:", cases(default, default, draws))
    for name, tissue in OTHERS.items():
        other = families(Fingertip.load(FingertipConfig(tissue=tissue)))
        table(f"Recorded on another finger ({name}):", cases(other, default, draws))


if __name__ == "__main__":
    main()
