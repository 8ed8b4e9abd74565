"""`rig home`, `rig zero` and `rig status`, and helpers shared with `rig jog`."""

import io
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from typing import Annotated

import typer
from rich.live import Live

from rig.bench.checks import PositionJson, StatusJson, in_one_line, look_and_contact, position, titled
from rig.bench.real import PortError, RealBench, open_bench
from rig.cli.options import ConfigOption, JsonOption, WithoutForceOption, option
from rig.cli.output import ExitCode, busy, complain, err, out, print_json, reporting_errors, resting, writes_json
from rig.cli.signals import at_once, interrupt_main
from rig.clock import WallClock
from rig.devices.base import ForceReading, Stage, StageError, StageStatus
from rig.devices.make_drivers import open_force, open_stage
from rig.engine.bench_memory import BenchMemory
from rig.engine.contact import KnownContact
from rig.engine.contact_words import ContactJson
from rig.engine.sensing import Sensing
from rig.engine.steps import take_zero
from rig.manual.session import ManualSession, no_force_readings, not_checked
from rig.manual.without_force import SessionWithoutForce
from rig.plan.config import Config, load_config
from rig.session.hardware_stop import key_interrupting
from rig.settings import ZERO_LIFT_MM
from rig.transport import TransportError
from rig_shared.outputs import Name, Output

Show = Callable[[StageStatus, float | None], None]
"""Display of the position and the force (gwt; None: no reading)."""


class HomedJson(PositionJson, ContactJson):
    """Position after homing, in machine coordinates, and contact."""


class ZeroedJson(Output):
    """Force sensor after zeroing."""

    identity: Name
    force_n: float


@contextmanager
def connected_stage(settings: Config) -> Iterator[tuple[Stage, WallClock]]:
    """Yield the connected stage; any interruption stops it ahead of all queued commands."""
    clock = WallClock()
    with (
        at_once(),
        key_interrupting(settings, interrupt_main),
        closing(open_stage(settings, clock)) as stage,
        _stopped_by_a_key(stage),
    ):
        stage.connect()
        yield stage, clock


@reporting_errors
def home(config: ConfigOption, without_force: WithoutForceOption = False, as_json: JsonOption = False) -> None:
    """Home all axes and print their positions; the force is monitored throughout."""
    settings = load_config(config)
    with busy("homing all axes …", quick=True):
        at, known = _home_without_force(settings) if without_force else _home(settings)
    homed: HomedJson = {**position(at), **known.as_json()}
    print_entries(homed)


def _home(settings: Config) -> tuple[StageStatus, KnownContact]:
    with at_once(), key_interrupting(settings, interrupt_main), closing(_opened_bench(settings)) as bench:
        known = ManualSession(settings, bench, bench.before).home()
        return bench.stage.status(), known


def _opened_bench(settings: Config) -> RealBench:
    """Open both ports; distinguish a missing sensor from a missing stage."""
    try:
        return open_bench(settings, WallClock(), io.StringIO(), ask=lambda request: "")
    except PortError as error:
        raise no_force_readings(error) if error.device == "force" else error from None


def _home_without_force(settings: Config) -> tuple[StageStatus, KnownContact]:
    with connected_stage(settings) as (stage, clock):
        session = SessionWithoutForce(settings, stage, clock)
        with session.begun():
            known = session.home()
        return stage.status(), known


@reporting_errors
def zero(
    config: ConfigOption,
    anyway: Annotated[
        bool, option("Zero the sensor unchecked, even if a contact is detected.", name="--anyway")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Zero the force sensor, then check by a lift of 0.3 mm that nothing touched; the indentor stays there."""
    with at_once():
        settings = load_config(config)
        with busy("zeroing the force sensor …", quick=True):
            name, force_n = (_zero_anyway if anyway else _zero)(settings)
        if not anyway:
            err.print(f"lifted by {ZERO_LIFT_MM:g} mm to check the zero")
        zeroed: ZeroedJson = {"identity": name, "force_n": force_n}
        print_entries(zeroed)


def _zero(settings: Config) -> tuple[str, float]:
    with ExitStack() as stack:
        stack.enter_context(key_interrupting(settings, interrupt_main))
        try:
            bench = stack.enter_context(closing(open_bench(settings, WallClock(), io.StringIO(), lambda request: "")))
        except PortError as error:
            raise not_checked(error) if error.device == "stage" else error from error
        session = ManualSession(settings, bench, bench.before)
        session.sensing.connect()
        try:
            stack.enter_context(session.begun())
        except (StageError, TransportError) as error:
            raise not_checked(error) from error
        stack.enter_context(_stopped_by_a_key(bench.stage))
        return session.zero(), session.sensing.raw().force_n


def _zero_anyway(settings: Config) -> tuple[str, float]:
    clock, memory = WallClock(), BenchMemory(settings)
    with closing(open_force(settings, clock)) as force:
        sensing = Sensing(settings, clock, force)
        name, zero = take_zero(sensing, memory)
        memory.record_zero(sensing.lasting_zero or zero)
        return name, sensing.raw().force_n


@reporting_errors
def status(config: ConfigOption, as_json: JsonOption = False) -> None:
    """Print the state of both devices; skip a port that another process owns."""
    settings = load_config(config)
    with busy("asking the devices …", quick=True):
        found = look_and_contact(settings)
    print_entries(found)
    problems = [one["problem_text"] for one in (found["stage"], found["force"]) if "problem_text" in one]
    for problem in problems:
        complain(problem)
    raise typer.Exit(ExitCode.STOPPED if problems else ExitCode.DONE)


def print_entries(found: HomedJson | ZeroedJson | StatusJson) -> None:
    """Print one JSON object, or one line per entry."""
    if writes_json():
        print_json(found)
        return
    for name, value in _for_people(found).items():
        if value is None:
            continue
        if isinstance(value, dict):
            value = in_one_line(value)
        out.print(f"{titled(name):<12}{value}")


_CONTACT_KEYS = ("contact", "may_touch", "measured_unix_s", "where_text", "to_do_text")


def _for_people(found: Mapping[str, object]) -> Mapping[str, object]:
    """Replace the contact entries by one sentence and the next step for the operator."""
    if "where_text" not in found:
        return found
    rest = {name: value for name, value in found.items() if name not in _CONTACT_KEYS}
    return {**rest, "contact": found["where_text"], "next": found["to_do_text"]}


@contextmanager
def manual_session(
    settings: Config, show: Show, *, without_force: bool
) -> Iterator[ManualSession | SessionWithoutForce]:
    """Yield a session on the ports of the configuration; raise BadInputError if no force sensor answers."""
    if without_force:
        err.print("without the force sensor: nothing stops the stage when it touches a finger")
        with connected_stage(settings) as (stage, clock):
            plain = SessionWithoutForce(settings, stage, clock)
            with plain.begun():
                yield plain
        return

    def shown(at: StageStatus | None, reading: ForceReading) -> None:
        if at is not None:
            show(at, session.force_gwt)

    with (
        at_once(),
        key_interrupting(settings, interrupt_main),
        closing(_opened_bench(settings)) as bench,
        _stopped_by_a_key(bench.stage),
    ):
        session = ManualSession(settings, bench, bench.before, shown)
        with session.begun():
            yield session


@contextmanager
def _stopped_by_a_key(stage: Stage) -> Iterator[None]:
    """Stop past every queue at Ctrl-C, a stop key or `rig stop`, also while nothing moves."""
    try:
        yield
    except KeyboardInterrupt:
        stage.stop()
        raise


@contextmanager
def live_line(settings: Config) -> Iterator[Show]:
    """Show stage position and force on one line that is updated on a terminal; in a pipe, name the work."""
    if not err.is_terminal:
        with busy("asking the devices, then moving the axis …", quick=True):
            yield lambda at, force_gwt: None
        return
    with resting(), Live(console=err, transient=True, refresh_per_second=10) as live:
        yield _shown(live.update, settings)


def _shown(update: Callable[[str], None], settings: Config) -> Show:
    apex_mm = settings.frame.apex_z_mm

    def show(at: StageStatus, force_gwt: float | None) -> None:
        force = "no force" if force_gwt is None else f"{force_gwt:.2f} gwt"
        update(f"x {at.x_mm:.3f}  y {at.y_mm:.3f}  z {at.z_mm:.3f} mm (apex {apex_mm:g})  {force}  {at.state}")

    return show
