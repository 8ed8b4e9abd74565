"""Identify fingers whose truth only the bench knows, and compare: docs/validation/identification.md.

.venv/bin/python -m studies.identification [ROWS] [--inside N] [--outside N]    # 200 and 40 of each set

Each finger is identified over the bytes of a virtual bench on a virtual clock, with the coarse mesh; the bench has
another mesh. The force sensor has 0.02 gwt of noise. Each finger that is done is a line of ROWS (default:
study/identification.jsonl) and is not identified again.
"""

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rig.data import RunFolder
from rig.identify.adaptive_presses import (
    SHAPES,
    Identification,
    IdentificationOptions,
    PressReport,
    with_reliable_touch,
)
from rig.identify.identification_script import IdentificationScript
from rig.plan.config import Config
from rig.plan.plan import Plan
from rig.session.resume import commit
from rig.session.session import NewRun, NoAttendant, Session, run_on
from rig.units import GWT_N
from sim.config import FingertipConfig, MeshSpec
from sim.identification.next_press import PressAt
from sim.identification.predicted_forces import MeasuredPress, PredictedForces
from sim.identification.prior import REAL_KINDS, Prior
from sim.models.fingertip import Fingertip
from sim.workers import in_processes, one_by_one
from studies.identification.hidden import Keeper
from studies.identification.random_fingers import RandomFinger, inside, outside
from studies.identification.tables import demands, kinds
from studies.registry import as_markdown

KNOWN = with_reliable_touch(Config(finger=FingertipConfig(mesh=MeshSpec(level="coarse"))))
"""Configuration of the identification: nothing of the finger but a mesh."""

SETS = {"first": 0, "second": 3000, "third": 6000}
"""First seed of each set of fingers."""

GOALS = (
    PressAt("cylinder:9", 0.0, 0.67),
    PressAt("cylinder:9", 0.8, 0.5),
    PressAt("sphere:3", -0.5, 0.5),
    PressAt("bar:1.5", 0.3, 0.5),
    PressAt("flat:1.5", 0.0, 0.5),
)
"""Of shapes that no identification presses."""


class Reading(NoAttendant):
    """Knows where the journal is."""

    def __init__(self, script: IdentificationScript) -> None:
        self._script = script

    def begins(self, folder: RunFolder) -> None:
        self._script.begins(folder)


class Timed(Identification):
    """Knows how long each update took, s of processor time."""

    took_s: tuple[float, ...] = ()

    def take(self, press: PressAt, measured: MeasuredPress) -> PressReport:
        """Learn from a press."""
        began = time.process_time()
        report = super().take(press, measured)
        self.took_s += (time.process_time() - began,)
        return report


def identified(
    drawn: RandomFinger,
    foreseen: PredictedForces,
    configured: Fingertip,
    known: Config = KNOWN,
    goals: Sequence[PressAt] = GOALS,
) -> dict[str, Any]:
    """Return a record of an identification with the truth beside it; `known` is all that it begins with."""
    keeper, began = Keeper(drawn), time.process_time()
    identification = Timed(known, foreseen, IdentificationOptions(tuple(goals)), seed=drawn.seed)
    script, out = IdentificationScript(identification), Path(tempfile.mkdtemp())
    try:
        into, attendant = NewRun(out), Reading(script)
        session = Session(script.as_script(), known, configured, Plan(), into, attendant)
        done = run_on(session, keeper.open_bench(session.pause), virtual=True)
    finally:
        shutil.rmtree(out, ignore_errors=True)
    keeper.over()
    pace, widths = identification.chooser.pace, identification.widths
    true = [keeper.held_gwt(goal, pace) for goal in goals]
    before = [configured.indent(g.indentor, g.x_mm, doi_mm=g.doi_mm).force_gwt for g in goals]
    return {
        "kind": drawn.kind,
        "seed": drawn.seed,
        "presses": len(identification.reports),
        "bench_s": done.duration_s,
        "process_s": time.process_time() - began,
        "ended": None if done.problem is None else str(done.problem),
        "mismatch": identification.mismatch,
        "error": [w.middle / t - 1 for w, t in zip(widths, true, strict=True)],
        "half": [w.half for w in widths],
        "covered": [bool(w.low <= t <= w.high) for w, t in zip(widths, true, strict=True)],
        "configured_error": [b / t - 1 for b, t in zip(before, true, strict=True)],
        "of_trip": [report.surprise.measured_gwt / report.trip_gwt for report in identification.reports],
        "highest_gwt": max((report.surprise.measured_gwt for report in identification.reports), default=0.0),
        "update_s": list(identification.took_s),
        "surprises": [report.surprise.sds for report in identification.reports],
        "misfit": (identification.learned.misfit / np.maximum(identification.learned.readings, 1)).tolist(),
        "off": foreseen.prior.off(identification.learned.most_likely[None])[0].tolist(),
        "readings": int(identification.learned.readings.sum()),
        "total": identification.learned.total / max(int(identification.learned.readings.sum()), 1),
        "limit_gwt": known.limits.soft_trip_n / GWT_N,
    }


@cache
def thinking() -> tuple[PredictedForces, Fingertip]:
    """Return the forces that an identification expects, and the configured finger."""
    return PredictedForces.over(KNOWN.finger, Prior(kinds=REAL_KINDS), 1.8, 1.1), Fingertip.load(KNOWN.finger)


def one(job: tuple[str, int]) -> dict[str, Any]:
    """The line of a finger from inside or outside the prior, by its seed."""
    of, seed = job
    drawn = (inside if of == "inside" else outside)(KNOWN, seed)
    goals = [list(vars(goal).values()) for goal in GOALS]
    return {"of": of, **identified(drawn, *thinking()), "commit": commit(Path(__file__)), "goals": goals}


def main() -> None:
    """Identify the fingers that the rows lack, then print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", nargs="?", type=Path, default=Path("study/identification.jsonl"))
    parser.add_argument("--inside", type=int, default=200)
    parser.add_argument("--outside", type=int, default=40)
    options = parser.parse_args()
    done = [json.loads(line) for line in options.rows.read_text().splitlines()] if options.rows.exists() else []
    options.rows.parent.mkdir(parents=True, exist_ok=True)
    counts = {"inside": options.inside, "outside": options.outside}
    jobs = {name: [(of, first + k) for of, n in counts.items() for k in range(n)] for name, first in SETS.items()}
    there = {(row["of"], row["seed"]) for row in done}
    missing = [job for of_set in jobs.values() for job in of_set if job not in there]
    if missing:
        print("tables of the shapes …", file=sys.stderr, flush=True)
        thinking()[0].have([*SHAPES, *(goal.indentor for goal in GOALS)], one_by_one)
    for n, row in enumerate(in_processes(one, missing), 1):
        done.append(row)
        with options.rows.open("a") as file:
            file.write(json.dumps(row) + "\n")
        print(f"{n} of {len(missing)}: {row['kind']} {row['seed']}", file=sys.stderr, flush=True)
    sets = {name: [row for row in done if (row["of"], row["seed"]) in of_set] for name, of_set in jobs.items()}
    print(as_markdown(demands(sets)), as_markdown(kinds(sets)), sep="\n")
