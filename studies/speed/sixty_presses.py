"""Sixty presses as a physiologist makes them, on every kind of stage and with every kind of force sensor.

.venv/bin/python -m studies.speed.sixty_presses --csv studies/results/speed/sixty_presses.csv   # about 8 minutes
.venv/bin/python -m studies.speed.sixty_presses --stage grbl --force mtsics                     # one pair

At one place, or at twelve places 0.5 mm apart in random order, five times; each press 0.5 mm under a bar, held 1 s,
with 3 s of rest from lift-off to the next touch. Times are those of the virtual bench: bytes at the baud rate,
samples at the rate of the sensor. `limit_s` is what remains if nothing waits for a reading or a reply: hold, rest,
and the way of every motion at its highest speed and acceleration, where it does not fit into the rest.
"""

import argparse
import csv
import inspect
import statistics
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from rig.data.run import Run
from rig.data.tables import spans
from rig.devices.registry import BUILT_IN, ramps
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.api import Rig
from rig.protocol.script import load_script
from rig.report.run_tables import shortest_s
from rig.session.session import NewRun, Session, dry_run
from rig.settings import StageSettings
from sim.models.fingertip import Fingertip
from tests.contracts.force import ForceBytes
from tests.contracts.tables import tables

PRESSES = 60
PLACES = {"one place": 1, "twelve places": 12}
RAMP_MM_S = {"20 Hz": 0.7, "100 Hz": 1.0}
"""Of a version that allows no such speed the row is left out."""
DOI_MM, HOLD_S, REST_S = 0.5, 1.0, 3.0
PERIODS_S = {"20 Hz": 0.05, "100 Hz": 0.01}
SCRIPT = """
import random

METADATA = {"title": "Sixty presses"}


def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    places = [0.5 * k - 0.25 * (PLACES - 1) for k in range(PLACES)] * (PRESSES // PLACES)
    random.Random(7).shuffle(places)
    for n, x_mm in enumerate(places):
        if n and REST_BEFORE_S:
            rig.rest(REST_BEFORE_S)
        rig.move_to(x_mm=x_mm)
        PRESS(doi_mm=DOI_MM, hold_s=HOLD_S, rest_s=REST_S)
"""


@dataclass(frozen=True)
class Minutes:
    """Where the time of the presses of one pair of devices goes (s), beside the errors of force and contact."""

    stage: str
    force: str
    rate: str
    places: str
    press: str
    run_s: float
    before_s: float | None
    presses_s: float
    limit_s: float
    shortest_rest_s: float
    median_rest_s: float
    approach_s: float
    touch_off_s: float
    press_s: float
    hold_s: float
    lift_s: float
    lateral_s: float
    rest_s: float
    contact_error_um: float
    largest_contact_error_um: float
    highest_gwt: float
    deepest_error_um: float


def script_text(places: int, ramp_mm_s: float | None) -> str:
    """Return the script; a program without `rest_s` of a press rests before the way to its place."""
    since = "rest_s" in inspect.signature(Rig.indent).parameters
    text = SCRIPT if since else SCRIPT.replace(", rest_s=REST_S", "")
    text = text.replace("PRESS(", "rig.indent(" if ramp_mm_s is None else f"rig.ramp(speed_mm_s={ramp_mm_s}, ")
    numbers = {"PRESSES": PRESSES, "PLACES": places, "DOI_MM": DOI_MM, "HOLD_S": HOLD_S, "REST_S": REST_S}
    numbers["REST_BEFORE_S"] = 0.0 if since else REST_S
    return "".join(f"{name} = {value}\n" for name, value in numbers.items()) + text


def run_pair(
    finger: Fingertip, stage: str, force: dict[str, Any], places: int, ramp_mm_s: float | None, out: Path
) -> tuple[Run, Config]:
    """Carry out the presses on one pair of devices."""
    config = Config.model_validate({"stage": {"kind": stage}, "force": force})
    path = out / "sixty.py"
    path.write_text(script_text(places, ramp_mm_s), encoding="utf-8")
    script = load_script(str(path))
    done = dry_run(Session(script, config, finger, make_plan(script, config, finger), NewRun(out)))
    if done.problem is not None:
        raise SystemExit(f"{stage} with {force['kind']}: {done.problem}")
    return done.run, config


def rests_s(run: Run) -> list[float]:
    """Return the times from lift-off to the next touch, or in older versions from the last reading of a touch."""
    rested = [one["rested_s"] for one in run.stream("touch") if one.get("rested_s") is not None]
    if rested:
        return rested
    touch_gwt = 0.05
    touching = [one["t_s"] for one in run.stream("sample") if one["force_gwt"] >= touch_gwt]
    starts = [one["t_s"] for one in run.stream("indentation_start")][1:]
    found = []
    for start_s in starts:
        before = [t for t in touching if t < start_s]
        after = [t for t in touching if t > start_s]
        found.append(after[0] - before[-1])
    return found


def limit_s(run: Run, config: Config) -> float:
    """Return what physics leaves of the presses: all ways at the highest speeds allowed, holds and rests."""
    habits, a = config.habits, config.stage.acceleration_mm_s2
    down_mm = habits.clearance_mm
    total_s = 0.0
    places = [one["x_mm"] for one in run.stream("indentation_start")]
    lift_s = shortest_s(down_mm + DOI_MM, habits.travel_speed_mm_s, a)
    press_s = shortest_s(DOI_MM, habits.press_speed_mm_s, a)
    down_s = shortest_s(down_mm, config.limits.max_press_speed_mm_s, a)
    for before, after in pairwise(places):
        total_s += max(REST_S, lift_s + shortest_s(abs(after - before), habits.travel_speed_mm_s, a) + down_s)
    return total_s + len(places) * (press_s + HOLD_S)


def minutes(run: Run, config: Config, rate: str, places: str, ramp_mm_s: float | None) -> Minutes:
    """Return the times and errors of a run."""
    rests = rests_s(run)
    errors_um = [1000 * abs(one["true_doi_mm"] - one["doi_mm"]) for one in run.stream("hold_end")]
    depth_um = [1000 * abs(one["true_doi_mm"] - DOI_MM) for one in run.stream("hold_end")]
    starts, ends = run.stream("indentation_start"), run.stream("indentation_end")
    booked = dict.fromkeys((span.what for span in spans(run)), 0.0)
    for span in spans(run):
        booked[span.what] += max(span.end_s - max(span.begin_s, starts[0]["t_s"]), 0.0)
    each = {key: round(booked.get(name, 0.0) / len(starts), 3) for key, name in {
        "approach_s": "approach", "touch_off_s": "touch-off", "press_s": "press and seek", "hold_s": "hold",
        "lift_s": "lift", "lateral_s": "lateral moves", "rest_s": "rest"}.items()}  # fmt: skip
    return Minutes(
        stage=config.stage.kind,
        force=config.force.kind,
        rate=rate,
        places=places,
        press="by increments" if ramp_mm_s is None else f"ramp {ramp_mm_s:g} mm/s",
        run_s=round(run.duration_s, 1),
        before_s=None,
        presses_s=round(ends[-1]["t_s"] - starts[0]["t_s"], 1),
        limit_s=round(limit_s(run, config), 1),
        shortest_rest_s=round(min(rests), 2),
        median_rest_s=round(statistics.median(rests), 2),
        **each,
        contact_error_um=round(statistics.median(errors_um), 2),
        largest_contact_error_um=round(max(errors_um), 2),
        highest_gwt=round(max(one["force_gwt"] for one in run.stream("sample")), 3),
        deepest_error_um=round(max(depth_um), 2),
    )


def pairs(stage: str | None, force: str | None) -> Iterator[tuple[str, dict[str, Any], str, str, float | None]]:
    """Yield the pairs of devices, each sensor at each rate, the places, and the speed of a ramp.

    Every stage beside the first kind of sensor, and every sensor beside the first kind of stage.
    """
    sensors = {one.kind: one.table for one in tables(ForceBytes)}
    for one in BUILT_IN["stage"] if stage is None else (stage,):
        for kind in BUILT_IN["force"] if force is None else (force,):
            for rate, period_s in PERIODS_S.items():
                settings = {"kind": kind, **sensors[kind], "sample_period_s": period_s}
                if one == BUILT_IN["stage"][0] or kind == BUILT_IN["force"][0]:
                    yield one, settings, rate, "one place", None
                if kind == BUILT_IN["force"][0]:
                    yield one, settings, rate, "twelve places", None
                    if ramps(StageSettings(kind=one)):
                        yield one, settings, rate, "one place", RAMP_MM_S[rate]


def _key(row: dict[str, Any]) -> tuple[str, ...]:
    return tuple(str(row[name]) for name in ("stage", "force", "rate", "places", "press"))


def _before(path: Path | None) -> dict[tuple[str, ...], float]:
    """Return the times of a file of another version."""
    if path is None:
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {_key(row): float(row["presses_s"]) for row in csv.DictReader(file)}


def main() -> None:
    """Print the table, and write it if asked."""
    parser = argparse.ArgumentParser(prog="python -m studies.speed.sixty_presses")
    parser.add_argument("--stage", choices=BUILT_IN["stage"], help="this stage alone")
    parser.add_argument("--force", choices=BUILT_IN["force"], help="this force sensor alone")
    parser.add_argument("--rate", choices=list(PERIODS_S), help="this rate alone")
    parser.add_argument("--csv", type=Path, help="file to write")
    parser.add_argument("--before", type=Path, help="such a file of another version, whose presses_s are before_s")
    options = parser.parse_args()
    finger, rows, before = Fingertip.load(), list[Minutes](), _before(options.before)
    for stage, force, rate, places, ramp_mm_s in pairs(options.stage, options.force):
        if options.rate not in (None, rate):
            continue
        with tempfile.TemporaryDirectory() as folder:
            try:
                done = run_pair(finger, stage, force, PLACES[places], ramp_mm_s, Path(folder))
            except BadInputError as refused:
                print(refused, file=sys.stderr)
                continue
            found = minutes(*done, rate, places, ramp_mm_s)
            rows.append(replace(found, before_s=before.get(_key(asdict(found)))))
        print(*asdict(rows[-1]).items(), sep="\n  ", file=sys.stderr, flush=True)
    if options.csv is not None:
        with options.csv.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(asdict(rows[0])), lineterminator="\n")
            writer.writeheader()
            writer.writerows(map(asdict, rows))


if __name__ == "__main__":
    main()
