"""Bands over presses drawn at random: each draw has its own place, depth and noise.

    .venv/bin/python -m studies.coding.drawn_presses [DRAWS] [wider] [choosing]

A band is of all presses that there may be: over noise on one press alone it need not hold its share. Drawn are the
shapes reported, beside their place and depth there; with `wider`, bars, cylinders and steps of any size. With
`choosing`: by the seeds on which the decoder is chosen, which are none of those reported.
"""

import sys
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.coding.operators import centred
from sim.coding.pressure import frictionless
from sim.coding.section import SPACING_MM
from studies.coding.profiles_read_back import (
    OURS,
    SAMPLES,
    SCENES,
    SNRS_DB,
    Decode,
    ProfilePress,
    ProfileRow,
    decoders,
    default_section,
    finer_section,
    pressed,
    read_back,
)

Press = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Pressures, and SED without noise."""

Draw = Callable[[int, int], ProfilePress]
"""Of a kind's number and a seed."""

CHOOSING_SEED, SEED, WIDER_SEED = 20_000, 61_000, 83_000
DRAWS, LEAST = 40, 0.8
ASIDE_MM, DEEPER_MM = 0.5, 0.2
FAR_MM, DEEP_MM = 0.7, (0.4, 0.9)
BARS_MM, CYLINDERS_MM, STEPS, STEPS_AT_MM = (1.2, 3.2), (2.5, 12.0), (1, 3, 5), -1.4
CLASSES = ("bar", "cylinder", "step")


class Population(NamedTuple):
    """Kinds of presses by name, and how one is drawn."""

    kinds: tuple[str, ...]
    draw: Draw
    ranges: str
    seed: int  # of the presses reported


def near(kind: int, seed: int) -> ProfilePress:
    """One of the presses reported, moved aside and deeper."""
    rng = np.random.default_rng((seed, kind))
    scene = SCENES[kind]
    aside, deeper = rng.uniform(-ASIDE_MM, ASIDE_MM), rng.uniform(-DEEPER_MM, DEEPER_MM)
    return scene._replace(x_mm=scene.x_mm + aside, doi_mm=scene.doi_mm + deeper)


def anywhere(kind: int, seed: int) -> ProfilePress:
    """A bar, a cylinder or a step of any size; a bar need not touch with both edges."""
    rng = np.random.default_rng((seed, kind))
    aside, doi = rng.uniform(-FAR_MM, FAR_MM), rng.uniform(*DEEP_MM)
    if CLASSES[kind] == "bar":
        return ProfilePress(f"bar:{rng.uniform(*BARS_MM):.3f}", aside, doi)
    if CLASSES[kind] == "cylinder":
        return ProfilePress(f"cylinder:{np.exp(rng.uniform(*np.log(CYLINDERS_MM))):.3f}", aside, doi)
    return ProfilePress(f"step:{rng.choice(STEPS)}", STEPS_AT_MM + aside, doi)


NEAR = Population(
    tuple(scene.shape for scene in SCENES),
    near,
    f"at places within ± {ASIDE_MM:g} mm and depths within ± {DEEPER_MM:g} mm of the fixed ones",
    SEED,
)
WIDER = Population(
    CLASSES,
    anywhere,
    f"bars of {BARS_MM[0]:g} to {BARS_MM[1]:g} mm, cylinders of {CYLINDERS_MM[0]:g} to {CYLINDERS_MM[1]:g} mm, steps "
    f"{STEPS[0]}, {STEPS[1]} and {STEPS[2]}, within ± {FAR_MM:g} mm of 0 (steps: {STEPS_AT_MM:g}), "
    f"{DEEP_MM[0]:g} to {DEEP_MM[1]:g} mm deep",
    WIDER_SEED,
)


def main(draws: int, population: Population, seed: int) -> None:
    """Print relative L2, coverage, its median width over the peak and ms of each cell; pooled, and the least cell."""
    print(f"{population.ranges}; {draws} presses a row, each with its own noise, seeds {seed} … {seed + draws - 1}")
    print("| shape | " + " | ".join(f"{snr:g} dB" for snr in SNRS_DB) + f" |\n|{'---|' * (1 + len(SNRS_DB))}")
    operator, finer = frictionless(default_section(), centred(SAMPLES + 1, SPACING_MM), "finite"), finer_section()
    found = []
    for kind, name in enumerate(population.kinds):
        presses = [pressed(finer, scene) for scene in drawn(population, kind, draws, seed)]
        found.append(with_noise(decoders(operator)[OURS], presses, seed))
        print("| " + " | ".join([name, *map(cell, found[-1])]) + " |", flush=True)
    print(f"\n{held(found)}")


def drawn(population: Population, kind: int, draws: int, seed: int) -> list[ProfilePress]:
    """As many of one kind."""
    return [population.draw(kind, seed + k) for k in range(draws)]


def with_noise(decode: Decode, presses: Sequence[Press], seed: int) -> list[ProfileRow]:
    """At each SNR, over presses: one draw of noise for each."""
    return [
        ProfileRow.of([read_back(decode, *press, snr_db, seed + k) for k, press in enumerate(presses)])
        for snr_db in SNRS_DB
    ]


def cell(row: ProfileRow) -> str:
    """Relative L2, coverage, median width over the peak, ms."""
    mean = row.mean
    return f"{mean.relative_l2:.0%}, {mean.held:.0%}, {mean.width:.2f}, {mean.spent_ms:.0f}"


def held(found: Sequence[Sequence[ProfileRow]]) -> str:
    """By the bands of all cells, and of the least one."""
    each = np.array([[row.mean.held for row in by_snr] for by_snr in found])
    by_snr = ", ".join(f"{share:.1%}" for share in each.mean(axis=0))
    return (
        f"Coverage pooled {each.mean():.1%} ({by_snr} by SNR); of {each.size} cells the least {each.min():.1%}, "
        f"{(each < LEAST).sum()} below {LEAST:.0%}."
    )


if __name__ == "__main__":
    of = WIDER if "wider" in sys.argv else NEAR
    meant = CHOOSING_SEED if "choosing" in sys.argv else of.seed
    main(next((int(word) for word in sys.argv[1:] if word.isdigit()), DRAWS), of, meant)
