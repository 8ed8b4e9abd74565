"""`rig calibrate`: measure the rig with a caliper and a known mass, and print the values for the configuration."""

import io
import math
import statistics
from contextlib import closing
from dataclasses import dataclass
from typing import Annotated, Literal

import typer

from rig.bench.checks import as_table
from rig.bench.real import open_bench
from rig.cli.bench import live_line, manual_session
from rig.cli.help import PlainCommand, PlainGroup
from rig.cli.jog import way
from rig.cli.options import ConfigOption, JsonOption, WithoutForceOption, option
from rig.cli.output import busy, err, out, print_json, reporting_errors, writes_json
from rig.cli.request import takes
from rig.cli.run import ask_at_the_bench
from rig.cli.signals import at_once, interrupt_main, typed_line
from rig.clock import WallClock
from rig.data.journal import NoJournal
from rig.devices.base import Axis, ForceSensor
from rig.devices.make_drivers import open_force
from rig.engine import Engine, verbs
from rig.engine.bench_memory import BenchMemory
from rig.engine.motion import slices
from rig.engine.reference import Compliance, measure_compliance
from rig.engine.steps import MOST_MM
from rig.errors import BadInputError
from rig.plan.config import Config, load_config
from rig.protocol.check import refuse_approach, refuse_place
from rig.session.hardware_stop import key_interrupting
from rig.session.script_run import stopped_at_once
from rig.units import GWT_N
from rig_shared.number_text import read_number
from rig_shared.outputs import Output, Toml

_READINGS, _FARTHEST_MM = 20, 1000.0
# Beyond this limit a setting or a unit is wrong, not a calibration.
_LARGEST_CORRECTION = 0.2

ValidDays = Annotated[int, option("Validity of the calibration, in days.", "N", min=1, max=3650)]


CalibrationName = Literal["x_steps_per_mm", "y_steps_per_mm", "z_steps_per_mm", "force_scale", "compliance_mm_per_n"]
_UNITS: dict[CalibrationName, Literal["steps/mm", "1", "mm/N"]] = {
    "x_steps_per_mm": "steps/mm",
    "y_steps_per_mm": "steps/mm",
    "z_steps_per_mm": "steps/mm",
    "force_scale": "1",
    "compliance_mm_per_n": "mm/N",
}
_OF_AXIS: dict[Axis, CalibrationName] = {"x": "x_steps_per_mm", "y": "y_steps_per_mm", "z": "z_steps_per_mm"}


class CalibrationJson(Output):
    """A calibration; `toml` is for the configuration."""

    name: CalibrationName
    value: float
    sd: float | None
    unit: Literal["steps/mm", "1", "mm/N"]
    toml: Toml


@dataclass(frozen=True)
class StepsRequest:
    """Options of `rig calibrate steps`."""

    config: ConfigOption
    axis: Annotated[str, option("Axis to calibrate.", "x|y|z")]
    by_mm: Annotated[float, option("Signed distance to move, in mm; nonzero, up to 1000 either way.", "D")] = -20.0
    speed_mm_s: Annotated[float, option("Speed of the axis, in mm/s.", "V", min=0.1, max=10)] = 2.0
    valid_days: ValidDays = 365
    without_force: WithoutForceOption = False
    as_json: JsonOption = False


@takes(StepsRequest)
def steps(request: StepsRequest) -> None:
    """Calibrate steps/mm: home first, clear the path, and place a caliper or a dial gauge on the carriage."""
    settings = load_config(request.config)
    direction, far_mm = way(request.axis, request.by_mm, _FARTHEST_MM)
    with (
        live_line(settings) as show,
        manual_session(settings, show, without_force=request.without_force) as session,
    ):
        now_per_mm, start = session.steps_per_mm(direction.axis), session.look()
        for step_mm in slices(far_mm, MOST_MM):
            if (problem := session.step(direction, step_mm, request.speed_mm_s).ended_by) is not None:
                raise BadInputError(f"{problem}; nothing was measured, nothing was changed", problem.code)
        end = session.look()
    moved_mm = abs(getattr(end, f"{request.axis}_mm") - getattr(start, f"{request.axis}_mm"))
    measured_mm = _typed_number(
        f"the controller reports {moved_mm:.3f} mm; enter the distance that you measured, in mm"
    )
    value = now_per_mm * _ratio(moved_mm, measured_mm)
    _print_calibration(_OF_AXIS[direction.axis], value, request.valid_days)


@reporting_errors
def force(
    config: ConfigOption,
    mass_g: Annotated[float, option("Known mass on the sensor, in g.", "M", min=0.1, max=500)],
    valid_days: ValidDays = 180,
    as_json: JsonOption = False,
) -> None:
    """Calibrate the force scale; the sensor must lie so that a mass on it presses as the indentor will."""
    with at_once():
        settings, clock = load_config(config), WallClock()
        with closing(open_force(settings, clock)) as sensor:
            with busy("zeroing the force sensor …", quick=True):
                sensor.connect()
                sensor.zero()
                BenchMemory(settings).record_zero(None)  # Readings now have a new zero.
            _wait_for_enter(f"put {mass_g:g} g on the sensor, then press Enter")
            with busy("reading the force sensor …", quick=True):
                read_n = _mean_n(sensor, clock)
        before = settings.calibration.value("force_scale", 1.0)
        _print_calibration("force_scale", before * _ratio(mass_g * GWT_N, read_n), valid_days)


@reporting_errors
def compliance(
    config: ConfigOption,
    to_gwt: Annotated[float, option("Largest force on the block, in gwt.", "F", min=10, max=200)] = 100.0,
    valid_days: ValidDays = 365,
    as_json: JsonOption = False,
) -> None:
    """Calibrate compliance with a flat indentor on a rigid block in the finger's place, top at frame.apex_z_mm."""
    with at_once():
        settings = load_config(config)
        refuse_place(0.0, 0.0, settings)
        refuse_approach("calibrate compliance", 0.0, settings)
        found = _on_a_block(settings, to_gwt)
        _print_calibration("compliance_mm_per_n", found.mm_per_n, valid_days, sd=found.sd_mm_per_n)


def _on_a_block(settings: Config, to_gwt: float) -> Compliance:
    with (
        key_interrupting(settings, interrupt_main),
        closing(open_bench(settings, WallClock(), io.StringIO(), ask_at_the_bench)) as bench,
    ):
        engine = Engine(settings, bench, NoJournal(), memory=bench)
        with bench.monitor(engine.heartbeat), stopped_at_once(engine):
            bench.confirm(f"put a rigid block under a flat indentor; the rig presses it to {to_gwt:g} gwt")
            verbs.leave_finger(engine, bench.before, resumed=False)
            verbs.mount(engine, "flat")
            with busy("homing, zeroing, then pressing the block …", quick=True):
                verbs.home(engine)
                verbs.zero(engine)
                verbs.move_to(engine, 0.0)
                return measure_compliance(engine, to_gwt)


def _mean_n(sensor: ForceSensor, clock: WallClock) -> float:
    readings = []
    for _ in range(_READINGS):
        clock.wait_s(sensor.sample_period_s)
        readings.append(sensor.read().force_n)
    return statistics.fmean(readings)


def _ratio(expected: float, found: float) -> float:
    if not abs(found) > 0 or abs(expected / found - 1) > _LARGEST_CORRECTION:
        raise BadInputError(
            f"measured {found:g}, expected {expected:g}: the difference must not exceed 20 %; nothing was "
            "changed; check the setup and repeat",
            "correction_too_large",
        )
    return expected / found


def _wait_for_enter(question: str) -> str:
    err.print(question)
    answer = typed_line()
    if not answer:
        raise BadInputError("no answer was entered; nothing was changed", "nobody_answered")
    return answer.strip()


def _typed_number(question: str) -> float:
    answer = _wait_for_enter(question)
    try:
        value = read_number(answer)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise BadInputError(f"{answer!r}: must be a number; nothing was changed", "not_a_number")
    return value


def _print_calibration(name: CalibrationName, value: float, valid_days: int, *, sd: float | None = None) -> None:
    table = as_table(name, value, valid_days, sd)
    if writes_json():
        found: CalibrationJson = {
            "name": name, "value": value, "sd": sd, "unit": _UNITS[name], "toml": table,
        }  # fmt: skip
        print_json(found)
    else:
        out.print(
            f"add this to the configuration, and set it on the controller if the controller stores it:\n\n{table}"
        )


calibrate = typer.Typer(no_args_is_help=True, cls=PlainGroup)
calibrate.command("steps", cls=PlainCommand, help="Calibrate the steps/mm of an axis with a caliper.")(steps)
calibrate.command("force", cls=PlainCommand, help="Calibrate the force scale with a known mass.")(force)
calibrate.command("compliance", cls=PlainCommand, help="Calibrate the compliance of the rig on a rigid block.")(
    compliance
)
