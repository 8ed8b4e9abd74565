"""Failures of designed and adaptive sessions beside those of usual ones, and expected beside fresh confusion.

Six contrasting candidates on plausible fingers; gain, threshold, receptor and drift are unknown, dispersion 1.5.
"""

import argparse
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

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
from studies.design.adaptive_sessions import Session, simulated

SIX = ("ep1", "sed", "e12", "s22", "e11", "mean")
MINUTES = 10.0
HALF = 5.0
EACH, FRESH_EACH, QUICK_SEEDS = 40, 200, 3
WHY = {
    "one_candidate": "one candidate had 95 %",
    "nothing_to_learn": "nothing more could be learned",
    "no_time": "no time was left",
}
FINGERS = Path(__file__).parents[2] / "examples" / "plausible_fingers" / "fingers.toml"

T = TypeVar("T")
Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


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
        print(f"| {one.name} | {one.minutes:g} | {one.presses} | {_shares(one.failed, one.kept, one.right)} |")
    sessions = _adaptive(found, seed + 100)
    mean = np.mean([one.presses for one in sessions])
    print(f"| adaptive | {HALF:g} | {mean:.1f} | {_shares(*_outcome(sessions))} |")
    print()
    print("| ended because | sessions | mean minutes | mean presses | failures (%) | truth in the set (%) |")
    print("|---|---|---|---|---|---|")
    for reason, why in WHY.items():
        some = [one for one in sessions if one.ended == reason]
        if some:
            failed, kept, _ = _outcome(some)
            took, made = np.mean([(one.minutes, one.presses) for one in some], axis=0)
            print(f"| {why} | {len(some)} | {took:.1f} | {made:.1f} | {_shares(failed, kept)} |")
    print()
    print("| design | cells | beyond the error + 5 points | largest difference (points) |")
    print("|---|---|---|---|")
    for name in (DESIGNED, SOURCE):
        made = _order(found, name)
        (expected,) = expected_confusion(found.table, SIX, _model(found), [made], FRESH_EACH, 16384, seed)
        fresh = _fresh(found, made, seed + 200)
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


def _adaptive(found: Design, seed: int) -> list[Session]:
    """Return adaptive sessions of half the time, in two processes."""
    numbers = np.array_split(np.arange(EACH * len(SIX)), 2)
    sessions = partial(simulated, found.table, found.times, _model(found), SIX, HALF, EACH * len(SIX), seed)
    with ProcessPoolExecutor(2) as pool:
        return [one for some in pool.map(sessions, numbers) for one in some]


def _outcome(sessions: Sequence[Session]) -> list[Flags]:
    return [np.array([getattr(one, name) for one in sessions]) for name in ("failed", "kept", "right")]


def _shares(*flags: Flags) -> str:
    shares = map(share_and_error, flags)
    return " | ".join(f"{100 * share:.1f} ± {100 * error:.1f}" for share, error in shares)


def _fresh(found: Design, made: OrderedDesign, seed: int) -> Array:
    """Return the confusion of experiments whose counts are taken press by press, with draws of their own."""
    model, table = _model(found), found.table
    sets = FRESH_EACH * len(SIX)
    fibers = draw_fibers(sets, table, model.unknowns, seed, evenly=False)
    truth = np.arange(sets) % len(SIX)
    rates = np.stack([relative_rates(table, name, fibers) for name in SIX])[truth, np.arange(sets)]
    chance = np.random.default_rng(seed + 1)
    mean = model.window_s * model.draw_gains(sets, chance)[:, None] * rates
    phi = model.unknowns.dispersions[fibers.level]
    used = np.unique(made.order)
    known = draw_fibers(8192, table, model.unknowns, seed + 2)
    log_rate = np.stack([log_rates(relative_rates(table, name, known)[:, used]) for name in SIX])
    chosen = np.zeros((len(SIX), len(SIX)))
    for some in np.array_split(np.arange(sets), len(SIX)):
        now = CandidatePosterior.before(model, known, log_rate, MINUTES, len(some))
        for k, at_s in zip(made.order, made.time_s, strict=True):
            tau = float((at_s - 30 * MINUTES) / TEN_MINUTES_S)
            count = draw_counts(mean[some, k] * np.exp(fibers.drift[some] * tau), phi[some], chance)
            now = now.updated(int(np.searchsorted(used, k)), count, tau)
        np.add.at(chosen, (truth[some], now.probabilities.argmax(axis=1)), 1)
    return chosen / chosen.sum(axis=1, keepdims=True)


def _error(share: Array) -> Array:
    n = FRESH_EACH
    near = (share * n + 1) / (n + 2)
    return np.sqrt(near * (1 - near) / n)


if __name__ == "__main__":
    main()
