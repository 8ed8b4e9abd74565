"""Identifies every kind of finger that the program can serve or rehearse: docs/validation/identification.md.

.venv/bin/python -m studies.identification.every_finger [ROWS] [--only NAME] [--draws FIRST END] [--shapes S …]

The finger is that of `rig identify --dry-run` with the case as configuration, or that of `rig serve --random-finger`.
Each finger is a line of ROWS (default: study/every_finger.jsonl); a line that exists is not computed again.
"""

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rig.cli.identify_finger import possible, scope_of, usual_goals
from rig.identify.adaptive_presses import SHAPES, Identification, IdentificationOptions, with_reliable_touch
from rig.identify.identification_script import IdentificationScript
from rig.identify.random_finger import truth_of, with_parameters
from rig.plan.config import Config, load_config
from rig.plan.finger_model import remaining_shares
from rig.plan.plan import Plan
from rig.records import Pace
from rig.session.resume import commit
from rig.session.session import NewRun, Session, run_on
from sim.config import FingertipConfig, MeshSpec
from sim.identification.next_press import PressAt
from sim.identification.posterior import parameter_bands
from sim.identification.predicted_forces import PredictedForces, RampAndHold
from sim.identification.prior import Prior
from sim.models.fingertip import Fingertip
from sim.workers import one_by_one
from studies.identification.hidden import Keeper
from studies.identification.proof import Reading
from studies.identification.strangers import Stranger
from studies.registry import as_markdown

ROOT = Path(__file__).parents[2]
RELAXATION = [[0.2, 0.07], [0.2, 1.4]]
DRAWS = 21

Tables = Mapping[str, Mapping[str, Any]]
"""Keys of a configuration that a case changes, by table."""

CASES: Mapping[str, Tables] = {
    "default": {},
    "half as stiff": {"tissue": {"stiffness": 0.5}},
    "twice as stiff": {"tissue": {"stiffness": 2.0}},
    "stiffening 0.02": {"tissue": {"stiffening": 0.02}},
    "stiffening 0.3": {"tissue": {"stiffening": 0.3}},
    "stiffening 0.8": {"tissue": {"stiffening": 0.8}},
    "human-sized": {},
    "relaxing": {"virtual": {"relaxation": RELAXATION}},
    "varied moduli": {"tissue": {"e_dermis": 0.2, "e_fat": 0.06}},
    "stiffening and relaxing": {
        "tissue": {"stiffness": 0.7, "stiffening": 0.3},
        "virtual": {"relaxation": RELAXATION},
    },
}
HUMAN = "human-sized"
_ROUNDING = 1e-9


def _meshed(level: str) -> Config:
    return with_reliable_touch(Config(finger=FingertipConfig(mesh=MeshSpec.model_validate({"level": level}))))


def case(name: str, level: str) -> Stranger:
    """Return the finger of a case, or of a random finger by its seed."""
    if name not in CASES:
        seed = int(name)
        config = with_parameters(_meshed(level), truth_of(seed), seed)
        return Stranger("random finger", seed, config, exact=level != "coarse")
    human = name == HUMAN
    config = with_reliable_touch(load_config(ROOT / "examples/human_finger/finger.toml")) if human else _meshed(level)
    tissue = config.finger.tissue.model_copy(update=dict(CASES[name].get("tissue", {})))
    virtual = config.virtual.model_validate(config.virtual.model_dump() | dict(CASES[name].get("virtual", {})))
    finger = config.finger.model_copy(update={"tissue": tissue})
    return Stranger(name, 0, config.model_copy(update={"finger": finger, "virtual": virtual}), exact=True)


def identified(
    stranger: Stranger, predicted: PredictedForces, nominal: Fingertip, options: IdentificationOptions
) -> dict[str, Any]:
    """Return one row: the identification of a finger, and the truth beside it."""
    identification = Identification(stranger.config, predicted, options)
    keeper, began = Keeper(stranger), time.process_time()
    script, out = IdentificationScript(identification), Path(tempfile.mkdtemp())
    try:
        into, attendant = NewRun(out), Reading(script)
        session = Session(script.as_script(), stranger.config, nominal, Plan(), into, attendant, script.handler)
        done = run_on(session, keeper.open_bench(session.pause), virtual=True)
    finally:
        shutil.rmtree(out, ignore_errors=True)
    keeper.over()
    took_s = time.process_time() - began
    true = [held_gwt(stranger, goal) for goal in options.goals]
    widths = identification.widths
    return {
        "kind": stranger.kind,
        "seed": stranger.seed,
        "flag": identification.flag,
        "mismatch": identification.mismatch,
        "effective": identification.learned.effective,
        "presses": len(identification.reports),
        "ended": None if done.problem is None else str(done.problem),
        "truth": truth_numbers(stranger.config),
        "bench_s": done.duration_s,
        "process_s": took_s,
        "error": [w.middle / t - 1 for w, t in zip(widths, true, strict=True)],
        "half": [w.half for w in widths],
        "covered": [bool(w.low <= t <= w.high) for w, t in zip(widths, true, strict=True)],
        "parameters": parameters(identification),
        "surprises": [report.surprise.sds for report in identification.reports],
        "misfit": (identification.learned.misfit / np.maximum(identification.learned.readings, 1)).tolist(),
        "total": identification.learned.total / max(int(identification.learned.readings.sum()), 1),
    }


def held_gwt(stranger: Stranger, goal: PressAt) -> float:
    """Return the true force of a press in its hold, as a plan predicts it (gwt)."""
    config, habits = stranger.config, stranger.config.habits
    finger = stranger.made.load(config.finger, exact=stranger.exact)
    pace = Pace(habits.press_speed_mm_s, habits.increment_mm, 1, RampAndHold(0, 0).hold_s)
    elastic = finger.indent(goal.indentor, goal.x_mm - config.virtual.finger_x_offset_mm, doi_mm=goal.doi_mm)
    return remaining_shares(config.virtual.relaxation, pace, goal.doi_mm).held * elastic.force_gwt


def truth_numbers(config: Config) -> dict[str, float]:
    """Return the true values of the parameters that are no logarithm of a Prony series."""
    tissue, virtual = config.finger.tissue, config.virtual
    by_name = {name: getattr(tissue, name) for name in ("stiffness", "e_dermis", "e_fat", "stiffening")}
    return {**by_name, "x_mm": virtual.finger_x_offset_mm, "height_mm": virtual.finger_z_offset_mm}


def parameters(identification: Identification) -> dict[str, list[float]]:
    """Return estimate, low and high of each parameter."""
    return {one.name: [one.estimate, one.low, one.high] for one in parameter_bands(identification.learned)}


def row(name: str, level: str, shapes: Sequence[str] = SHAPES) -> dict[str, Any]:
    """Return the row of a case by its name, or of a random finger by its seed."""
    stranger, began = case(name, level), time.process_time()
    options = IdentificationOptions(usual_goals(shapes), shapes=tuple(shapes))
    predicted = PredictedForces.over(stranger.config.finger, Prior(), *scope_of(options))
    refused = predicted.have(options.indentors, one_by_one)
    made_s = time.process_time() - began
    options = possible(options, predicted, refused, own_goals=True)
    found = identified(stranger, predicted, Fingertip.load(stranger.config.finger), options)
    return {
        "name": name,
        "level": level,
        **found,
        "tables_s": made_s,
        "left_out": list(refused),
        "commit": commit(Path(__file__)),
    }


def main() -> None:
    """Compute the rows that are missing."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("rows", nargs="?", type=Path, default=Path("study/every_finger.jsonl"))
    asked.add_argument("--only", action="append")
    asked.add_argument("--draws", type=int, nargs=2, default=(0, DRAWS), metavar=("FIRST", "END"))
    asked.add_argument("--shapes", nargs="+", default=SHAPES)
    asked.add_argument("--level", default="default", help="mesh of all fingers but the human-sized one")
    given = asked.parse_args()
    names: Sequence[str] = given.only or [*CASES, *map(str, range(*given.draws))]
    kept = [json.loads(line) for line in given.rows.read_text().splitlines()] if given.rows.exists() else []
    given.rows.parent.mkdir(parents=True, exist_ok=True)
    there = {one["name"] for one in kept}
    for name in names:
        if name in there:
            continue
        one = row(name, given.level, given.shapes)
        with given.rows.open("a") as file:
            file.write(json.dumps(one) + "\n")
        kept.append(one)
        print(", ".join(table([one])[1]), file=sys.stderr, flush=True)
    print(as_markdown(table(kept)))


HEADER = (
    "finger", "flag", "presses", "effective draws", "forces in their bands", "median error", "median half-width",
    "estimates in their bands", "true values in their bands",
)  # fmt: skip


def table(rows: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Return one line per finger in the order of the cases, and their sum."""
    order = {name: k for k, name in enumerate([*CASES, *map(str, range(10_000))])}
    rows = sorted(rows, key=lambda one: order[one["name"]])
    flagged = sum(one["flag"] is not None for one in rows)
    everything = {
        "name": f"all {len(rows)}",
        "flag": f"{flagged} flagged",
        "presses": max(one["presses"] for one in rows),
        "effective": min(one["effective"] for one in rows),
        **{key: [value for one in rows for value in one[key]] for key in ("covered", "error", "half")},
    }
    counts = [_held(one) for one in rows]
    inside, true = ([sum(pair) for pair in zip(*(count[k] for count in counts), strict=True)] for k in (0, 1))
    return [
        list(HEADER),
        *(_line(one, *count) for one, count in zip(rows, counts, strict=True)),
        _line(everything, tuple(inside), tuple(true)),
    ]


def _held(one: Mapping[str, Any]) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return how many estimates and how many true values lie in their bands, each with its total."""
    bands = one["parameters"]
    estimates = sum(low <= at <= high for at, low, high in bands.values())
    true = sum(bands[name][1] - _ROUNDING <= at <= bands[name][2] + _ROUNDING for name, at in one["truth"].items())
    return (estimates, len(bands)), (true, len(one["truth"]))


def _line(one: Mapping[str, Any], estimates: Sequence[int], true: Sequence[int]) -> list[str]:
    name = f"random finger {one['name']}" if one["name"].isdigit() else one["name"]
    return [
        name,
        one["flag"] or "–",
        f"{one['presses']}",
        f"{one['effective']:.0f}",
        f"{sum(one['covered'])} of {len(one['covered'])}",
        f"{100 * np.median(np.abs(one['error'])):.1f} %",
        f"± {100 * np.median(one['half']):.1f} %",
        *(f"{held} of {total}" for held, total in (estimates, true)),
    ]


if __name__ == "__main__":
    main()
