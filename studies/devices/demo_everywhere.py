"""The demo protocol on every stage under every force sensor: whether the forces are the same.

    .venv/bin/python -m studies.devices.demo_everywhere                     # in dry runs, on the virtual clock
    .venv/bin/python -m studies.devices.demo_everywhere --wires FILE        # over wires, in real time
    .venv/bin/python -m studies.devices.demo_everywhere --table FILE        # the table of what is in the file

All stages are calibrated to the same steps per mm. `--wires` gives `rig run` the ports of `rig serve`:
pseudo-terminals, and UDP for a Net F/T. The file gets a line for each bench; benches in it are not repeated. A run
that trips is resumed by `rig resume`.

Each reading in a hold is compared with the force of the finger at the step at which the stage stood. The rig holds a
force to a tolerance that is wider than one step of the stage, so a press may end one step deeper than on the first
bench, and the stage may step within a hold: the mean force of such a hold is of two depths.
"""

import argparse
import itertools
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rig.data import Run, read_run
from rig.devices.registry import DEFAULTS, KINDS, ForceKind, StageKind, find, names
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
MOST_RESUMED, MOST_S = 40, 3600.0
HEADER = (
    "stage", "force sensor", "wires", "presses", "readings", "reading beside the finger's, gwt: worst",
    "presses at another step", "steps apart: worst", "last reading apart at the same step, gwt: worst", "resumed",
    "bytes", "bench, min",
)  # fmt: skip

Bench = tuple[str, str]
"""Kinds of stage and force sensor."""
Record = dict[str, Any]
"""A bench, its wires, its holds (x; step and force of each reading), bytes, minutes, and why it was resumed."""


def tables_of(bench: Bench) -> dict[str, Any]:
    """The configuration of a bench, with the same steps on all stages."""
    calibration = {f"{axis}_steps_per_mm": {"value": STEPS_PER_MM, **DAY} for axis in "xz"}
    return {"stage": {"kind": bench[0]}, "force": {"kind": bench[1]}, "calibration": calibration}


def pairs() -> list[Bench]:
    """Every stage and force sensor with a virtual twin, the usual ones first."""
    stages, forces = ([name for name in names(of.room) if find(of, name).twin] for of in KINDS)
    found = list(itertools.product(stages, forces))
    return sorted(found, key=lambda pair: pair != (DEFAULTS["stage"], DEFAULTS["force"]))


# --- runs ---


def pressed(bench: Bench, finger: Fingertip) -> Record:
    """The demo in a dry run."""
    config, script = Config.model_validate(tables_of(bench)), load_script(*DEMO)
    with tempfile.TemporaryDirectory() as folder:
        plan = make_plan(script, config, finger)
        done = dry_run(Session(script, config, finger, plan, NewRun(Path(folder) / "runs")))
        if not done.complete:
            raise SystemExit(f"{', '.join(bench)}: {done.problem}")
        return record_of(bench, "virtual clock", read_run(done.folder.path), ())


def record_of(bench: Bench, wires: str, run: Run, resumed: Sequence[str]) -> Record:
    """What is kept of a run."""
    with run.folder.bytes_log.open(encoding="ascii") as chunks:
        sent = sum(len(json.loads(chunk)["hex"]) // 2 for chunk in chunks)
    readings: dict[int, list[tuple[int, float]]] = {}
    for sample in run.stream("sample"):
        if sample["phase"] == "hold":
            step = round(sample["height_mm"] * STEPS_PER_MM)
            readings.setdefault(sample["index"], []).append((step, sample["force_gwt"]))
    holds = [{"x_mm": hold["x_mm"], "readings": readings[hold["index"]]} for hold in run.stream("hold_end")]
    about = {"stage": bench[0], "force": bench[1], "wires": wires, "resumed": list(resumed)}
    return {**about, "holds": holds, "bytes": sent, "minutes": run.duration_s / 60}


# --- over wires ---


def over_wires(bench: Bench) -> Record:
    """The demo by `rig run`, in real time."""
    with tempfile.TemporaryDirectory() as name, served(bench, Path(name)) as (config, wires):
        folder, resumed = Path(name), list[str]()
        shared = ["--yes", "--mounted", SHAPE]
        told = _rig(folder, "run", DEMO[0], *DEMO[1], *shared, "--config", str(config), "--out", str(folder / "runs"))
        while True:
            runs = list((folder / "runs").glob("*/events.jsonl"))
            if len(runs) != 1:
                raise RuntimeError(f"{', '.join(bench)}: {told}")
            run = read_run(runs[0].parent)
            if not run.missing:
                return record_of(bench, wires, run, resumed)
            resumed.append(str((run.stop or {}).get("reason") or told))
            if len(resumed) > MOST_RESUMED:
                raise RuntimeError(f"{', '.join(bench)}: {run.missing} presses are missing after {resumed}")
            told = _rig(folder, "resume", str(runs[0].parent), *shared)


@contextmanager
def served(bench: Bench, folder: Path) -> Iterator[tuple[Path, str]]:
    """Serve a bench; yield the configuration with its ports, and the names of its wires."""
    tables = tables_of(bench)
    virtual, real = folder / "virtual.toml", folder / "rig.toml"
    virtual.write_text(Config.model_validate(tables).as_toml(), encoding="utf-8")
    command = [*_RIG, "serve", "--config", str(virtual), "--indentor", SHAPE]
    with subprocess.Popen(command, env=_env(folder), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as serving:
        try:
            assert serving.stdout is not None
            ports = json.loads(serving.stdout.readline())
            stage, force = find(StageKind, bench[0]), find(ForceKind, bench[1])
            for kind, keys in ((stage, stage.further_ports), (force, (force.page_port,))):
                tables[kind.room] |= {"port": ports[kind.room]}
                if own := {key: ports[key] for key in keys if key}:
                    tables[kind.room][kind.place] = own
            real.write_text(Config.model_validate(tables).as_toml(), encoding="utf-8")
            yield real, " and ".join(dict.fromkeys(wire_of(ports[room]) for room in ("stage", "force")))
        finally:
            serving.send_signal(signal.SIGINT)


def wire_of(port: str) -> str:
    """The name of a wire, by its port."""
    scheme, found, _ = port.partition("://")
    return scheme.upper() if found else "pseudo-terminal"


_RIG = (sys.executable, "-m", "rig")


def _rig(folder: Path, *words: str) -> str:
    """Give a command, and return the last line that it printed."""
    ended = subprocess.run(
        [*_RIG, *words], env=_env(folder), capture_output=True, text=True, timeout=MOST_S, check=False
    )
    return next(reversed((ended.stdout + ended.stderr).strip().splitlines()), "")


def _env(folder: Path) -> dict[str, str]:
    return {**os.environ, "OMP_NUM_THREADS": "1", "RIG_STATE_DIR": str(folder), "RIG_RUNTIME_DIR": str(folder)}


def carry_out(benches: Sequence[Bench], file: Path, at_once: int) -> None:
    """Play the demo on benches that are not in the file, so many at a time."""
    file.parent.mkdir(parents=True, exist_ok=True)
    known = {(one["stage"], one["force"]) for one in records(file)}
    left, began_s = [bench for bench in benches if bench not in known], time.monotonic()

    def one(bench: Bench) -> str:
        try:
            record = over_wires(bench)
        except Exception as error:
            return f"{', '.join(bench)}: {type(error).__name__}: {error}"
        with file.open("a", encoding="ascii") as lines:
            lines.write(json.dumps(record) + "\n")
        return f"{', '.join(bench)}: {record['minutes']:.1f} min, resumed {len(record['resumed'])} times"

    with ThreadPoolExecutor(at_once) as pool:
        for number, said in enumerate(pool.map(one, left), 1):
            print(f"{number} of {len(left)}, {time.monotonic() - began_s:.0f} s: {said}", file=sys.stderr, flush=True)


def records(file: Path) -> list[Record]:
    """What is in a file, in the order of the benches; nothing of one that is not there."""
    found = [json.loads(line) for line in file.read_text(encoding="ascii").splitlines()] if file.exists() else []
    order = pairs()
    return sorted(found, key=lambda one: order.index((one["stage"], one["force"])))


# --- table ---


def row(here: Record, first: Record, finger: Fingertip) -> tuple[list[str], float]:
    """The cells of a bench, and how far its readings are from the finger's forces at most (gwt)."""
    forces: dict[tuple[float, int], float] = {}

    def of_finger(x_mm: float, step: int) -> float:
        if (x_mm, step) not in forces:
            doi_mm = finger.touch_height_mm(SHAPE, x_mm) - finger.apex_height_mm - step / STEPS_PER_MM
            forces[x_mm, step] = finger.indent(SHAPE, x_mm, doi_mm=doi_mm).force_gwt
        return forces[x_mm, step]

    errors, steps, apart = list[float](), list[int](), list[float]()
    for ours, theirs in zip(here["holds"], first["holds"], strict=True):
        errors += [abs(force_gwt - of_finger(ours["x_mm"], step)) for step, force_gwt in ours["readings"]]
        (at, force_gwt), (at_first, first_gwt) = ours["readings"][-1], theirs["readings"][-1]
        steps.append(abs(at - at_first))
        apart += [abs(force_gwt - first_gwt)] if at == at_first else []
    cells = [
        *(here["stage"], here["force"], here["wires"], f"{len(steps)}", f"{len(errors)}", f"{max(errors):.4f}"),
        *(f"{sum(n > 0 for n in steps)}", f"{max(steps)}", f"{max(apart):.4f}"),
        *(f"{len(here['resumed'])}", f"{here['bytes']}", f"{here['minutes']:.1f}"),
    ]
    return cells, max(errors)


def main() -> None:
    """Print the table, and the benches on which a reading is further from the finger's force than the resolution."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--wires", type=Path, metavar="FILE", help="over wires, in real time; results are added to FILE"
    )
    parser.add_argument("--table", type=Path, metavar="FILE", help="print the table of the results in FILE only")
    parser.add_argument("--at-once", type=int, default=2, help="with --wires: so many benches at a time")
    parser.add_argument("--bench", action="append", metavar="STAGE,SENSOR", help="these benches only")
    asked = parser.parse_args()
    benches = [pair for pair in pairs() if asked.bench is None or ",".join(pair) in asked.bench]
    if asked.wires is not None:
        carry_out(benches, asked.wires, asked.at_once)
    finger, bad, resolution_gwt = Fingertip.load(), list[str](), Config().force.resolution_gwt
    file: Path | None = asked.table or asked.wires
    found: Iterable[Record] = records(file) if file is not None else (pressed(pair, finger) for pair in benches)

    def rows() -> Iterator[list[str]]:
        first: Record = {}
        for here in found:
            first = first or here
            cells, error_gwt = row(here, first, finger)
            bad.extend([f"{here['stage']}, {here['force']}"] * (error_gwt > resolution_gwt))
            yield cells

    show(HEADER, rows())
    if bad:
        print(f"more than the resolution: {', '.join(bad)}", file=sys.stderr)


if __name__ == "__main__":
    main()
