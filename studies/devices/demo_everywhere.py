"""The demo protocol on every stage under every force sensor: whether the forces are the same.

    .venv/bin/python -m studies.devices.demo_everywhere

Real drivers and bytes on virtual wires and a virtual clock, as in `rig dry-run`. All stages are calibrated to the
same steps per mm. Each force at the end of a hold is compared with the force of the finger at the true place of the
indentor, and this depth with that of the first stage and sensor: the rig holds a force to a tolerance that is wider
than one step of the stage, so a press may end one step deeper.
"""

import argparse
import itertools
import json
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.data import read_run
from rig.devices.registry import DEFAULTS, KINDS, find, names
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.session import NewRun, Session, dry_run
from sim.models.fingertip import Fingertip
from studies.registry import show

DEMO = ("steps", ["step=1", "force_gwt=2.33"])
DAY = {"date": "2026-01-01", "expires": "2027-01-01"}
STEPS_PER_MM = 400.0
SHAPE = "step:1"
HEADER = (
    "stage", "force sensor", "presses", "force beside the finger's, gwt: worst", "resolution, gwt",
    "presses at another step", "steps apart: worst", "force apart, gwt: worst", "bytes", "bench, min",
)  # fmt: skip


@dataclass(frozen=True)
class Pressed:
    """The holds of a run, the bytes on the wires, and how long the bench was busy (min)."""

    holds: list[Mapping[str, float]]
    sent: int
    minutes: float


def config_of(stage: str, force: str) -> Config:
    """The configuration of a stage and a force sensor, with the same steps on all stages."""
    calibration = {f"{axis}_steps_per_mm": {"value": STEPS_PER_MM, **DAY} for axis in "xz"}
    tables: dict[str, Any] = {"stage": {"kind": stage}, "force": {"kind": force}, "calibration": calibration}
    return Config.model_validate(tables)


def pressed(config: Config, finger: Fingertip) -> Pressed:
    """The demo protocol on a bench."""
    script = load_script(*DEMO)
    with tempfile.TemporaryDirectory() as folder:
        plan = make_plan(script, config, finger)
        done = dry_run(Session(script, config, finger, plan, NewRun(Path(folder) / "runs")))
        if not done.complete:
            raise SystemExit(f"{config.stage.kind}, {config.force.kind}: {done.problem}")
        run = read_run(done.folder.path)
        with run.folder.bytes_log.open(encoding="ascii") as chunks:
            last_s, sent = 0.0, 0
            for chunk in map(json.loads, chunks):
                last_s, sent = chunk["t_s"], sent + len(chunk["hex"]) // 2
        return Pressed(list(run.stream("hold_end")), sent, last_s / 60)


def pairs() -> list[tuple[str, str]]:
    """Every stage and force sensor with a virtual twin, the usual ones first."""
    stages, forces = ([name for name in names(of.room) if find(of, name).twin] for of in KINDS)
    found = list(itertools.product(stages, forces))
    return sorted(found, key=lambda pair: pair != (DEFAULTS["stage"], DEFAULTS["force"]))


def row(here: Pressed, first: Pressed, finger: Fingertip) -> tuple[float, list[float], float]:
    """The worst error of a force (gwt), the steps between both benches at each press, the worst difference (gwt)."""
    errors, steps, apart = list[float](), list[float](), list[float]()
    for ours, theirs in zip(here.holds, first.holds, strict=True):
        model = finger.indent(SHAPE, ours["true_x_mm"], doi_mm=ours["true_doi_mm"])
        errors.append(abs(ours["force_gwt"] - model.force_gwt))
        steps.append(abs(ours["true_doi_mm"] - theirs["true_doi_mm"]) * STEPS_PER_MM)
        apart.append(abs(ours["force_gwt"] - theirs["force_gwt"]))
    return max(errors), steps, max(apart)


def main() -> None:
    """Print the table, and the benches on which a force is further from the finger's than the resolution."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    finger, first, bad = Fingertip.load(), list[Pressed](), list[str]()

    def rows() -> Iterator[list[str]]:
        for stage, force in pairs():
            config = config_of(stage, force)
            here = pressed(config, finger)
            first.append(here)
            error, steps, apart = row(here, first[0], finger)
            resolution = config.force.resolution_gwt
            bad.extend([f"{stage}, {force}"] * (error > resolution))
            yield [
                *(stage, force, f"{len(here.holds)}", f"{error:.4f}", f"{resolution:g}"),
                *(f"{sum(n > 0.5 for n in steps)}", f"{max(steps):.0f}", f"{apart:.4f}"),
                *(f"{here.sent}", f"{here.minutes:.1f}"),
            ]

    show(HEADER, rows())
    if bad:
        print(f"more than the resolution: {', '.join(bad)}", file=sys.stderr)


if __name__ == "__main__":
    main()
