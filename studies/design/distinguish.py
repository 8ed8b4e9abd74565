"""Failures of a designed session beside those of usual ones, and expected confusion beside fresh experiments.

Six contrasting candidates on plausible fingers; gain, threshold, receptor and drift are unknown, dispersion 1.5.
"""

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from rig.compare.plausible_fingers import read_plausible
from rig.design.confusion import Confusion, OrderedDesign, expected_confusion, share_and_error
from rig.design.counts import TEN_MINUTES_S, CountModel, draw_counts
from rig.design.design import DESIGNED, Design, DesignRequest, design
from rig.design.fibers import draw_fibers, log_rates, relative_rates
from rig.design.order import ordered
from rig.design.posterior import CandidatePosterior
from rig.design.usual_designs import SOURCE, everything, usual_designs
from rig.plan.config import load_config
from sim.models.fingertip import Fingertip

SIX = ("ep1", "sed", "e12", "s22", "e11", "mean")
MINUTES = 10.0
EACH, FRESH, QUICK_SEEDS = 40, 200, 3
FINGERS = Path(__file__).parents[2] / "examples" / "plausible_fingers" / "fingers.toml"

T = TypeVar("T")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    seed = parser.parse_args().seed
    config, plausible = load_config(None), read_plausible(FINGERS)
    finger = Fingertip.load(config.finger)
    request = DesignRequest(SIX, minutes=MINUTES, seed=seed)
    found = design(request, config, finger, plausible, _counted, lambda what, done, total: None)
    print("| design | minutes | presses | failures (%) | truth in the set (%) | most probable is the truth (%) |")
    print("|---|---|---|---|---|---|")
    outcomes = _again(found, seed + 100)
    for one in outcomes:
        shares = (share_and_error(flags) for flags in (one.failed, one.kept, one.right))
        cells = " | ".join(f"{100 * share:.1f} ± {100 * error:.1f}" for share, error in shares)
        print(f"| {one.name} | {one.minutes:g} | {one.presses} | {cells} |")
    print()
    print("| design | cells | beyond the error + 5 points | largest difference (points) |")
    print("|---|---|---|---|")
    for name in (DESIGNED, SOURCE):
        expected = found.at(name, MINUTES)
        fresh = _fresh(found, _order(found, name), seed + 200)
        apart = np.abs(fresh - expected.matrix)
        allowed = np.hypot(expected.error, _error(fresh)) + 0.05
        print(f"| {name} | {apart.size} | {(apart > allowed).sum()} | {100 * apart.max():.1f} |")
    print()
    print("| design | failures (%) | information (bits) |")
    print("|---|---|---|")
    print(f"| full | {100 * outcomes[0].failed.mean():.1f} | {outcomes[0].bits:.2f} |")
    for other in range(seed, seed + QUICK_SEEDS):
        quick = replace(request, seed=other, quick=True)
        short = design(quick, config, finger, plausible, _counted, lambda what, done, total: None)
        judged = _again(short, seed + 100)[0]
        print(f"| quick, seed {other} | {100 * judged.failed.mean():.1f} | {judged.bits:.2f} |")


def _counted(answers: Iterable[T], total: int, what: str, /) -> Iterator[T]:
    yield from answers


def _model(found: Design) -> CountModel:
    return CountModel(found.request.hold_s, found.request.unknowns)


def _order(found: Design, name: str) -> OrderedDesign:
    if name == DESIGNED:
        return found.made
    return usual_designs(found.table.presses, found.times, MINUTES, found.request.seed)[0]


def _again(found: Design, seed: int) -> list[Confusion]:
    """Judge the design, the usual ones and all presses on fibers that nothing was chosen with."""
    made = ordered(DESIGNED, found.blocks, found.times, MINUTES)
    presses, times = found.table.presses, found.times
    designs = [made, *usual_designs(presses, times, MINUTES, found.request.seed), everything(presses, times, 60.0)]
    return expected_confusion(found.table, SIX, _model(found), designs, EACH, 16384, seed)


def _fresh(found: Design, made: OrderedDesign, seed: int) -> "np.ndarray[tuple[int, int], np.dtype[np.float64]]":
    """Return the confusion of experiments whose counts are taken press by press, with draws of their own."""
    model, table = _model(found), found.table
    fibers = draw_fibers(FRESH, table, model.unknowns, seed, evenly=False)
    truth = np.arange(FRESH) % len(SIX)
    rates = np.stack([relative_rates(table, name, fibers) for name in SIX])[truth, np.arange(FRESH)]
    chance = np.random.default_rng(seed + 1)
    mean = model.window_s * model.draw_gains(FRESH, chance)[:, None] * rates
    used = np.unique(made.order)
    known = draw_fibers(8192, table, model.unknowns, seed + 2)
    log_rate = np.stack([log_rates(relative_rates(table, name, known)[:, used]) for name in SIX])
    chosen = np.zeros((len(SIX), len(SIX)))
    for s in range(FRESH):
        now = CandidatePosterior.before(model, known, log_rate, MINUTES)
        for k, at_s in zip(made.order, made.time_s, strict=True):
            tau = float((at_s - 30 * MINUTES) / TEN_MINUTES_S)
            phi = model.unknowns.dispersions[fibers.level[s]]
            count = draw_counts(mean[s, [k]] * np.exp(fibers.drift[s] * tau), phi, chance)
            now = now.updated(int(np.searchsorted(used, k)), count, tau)
        chosen[truth[s], int(now.probabilities[0].argmax())] += 1
    return chosen / chosen.sum(axis=1, keepdims=True)


def _error(
    share: "np.ndarray[tuple[int, int], np.dtype[np.float64]]",
) -> "np.ndarray[tuple[int, int], np.dtype[np.float64]]":
    n = FRESH / len(SIX)
    near = (share * n + 1) / (n + 2)
    return np.sqrt(near * (1 - near) / n)


if __name__ == "__main__":
    main()
