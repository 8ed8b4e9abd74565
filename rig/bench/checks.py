"""Checks of a bench before it is used: configuration, calibrations, subject code, what the devices report."""

import datetime
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import closing
from typing import NotRequired

import tomlkit

from rig.clock import WallClock
from rig.control.client import activity_of
from rig.devices.base import ForceError, StageError, StageStatus
from rig.devices.make_drivers import open_force, open_stage
from rig.devices.registry import stage_ports
from rig.devices.sync_line import AdapterOutput
from rig.engine.bench_memory import BenchMemory, LastKnown
from rig.engine.contact import KnownContact, contact_at
from rig.engine.contact_words import ContactJson
from rig.engine.sensing import NoReadingError, Sensing
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.protocol.check import refuse_place
from rig.transport import PortOwner, TransportError, first_owner, port_owner
from rig_shared.outputs import Code, CommandLine, Name, Output, Port, Time


class DeviceLookJson(Output):
    """A device: who owns its port, or its state, or the problem and its code."""

    kind: Name
    ports: list[Port]
    owner: NotRequired[int | None]
    """Process that owns the port; null if the system does not report it."""
    owner_text: NotRequired[str]
    does_text: NotRequired[str]
    since_utc: NotRequired[Time]
    stop: NotRequired[CommandLine]
    identity: NotRequired[Name]
    problem_text: NotRequired[str]
    code: NotRequired[Code]


class StageLookJson(DeviceLookJson):
    """State of the stage, with its position in machine coordinates."""

    state: NotRequired[Name]
    x_mm: NotRequired[float]
    y_mm: NotRequired[float]
    z_mm: NotRequired[float]


class ForceLookJson(DeviceLookJson):
    """State of the force sensor."""

    force_n: NotRequired[float]
    stable: NotRequired[bool]


class StatusJson(Output):
    """Both devices, and contact: measured now where both can be relied on, else as recorded."""

    stage: StageLookJson
    force: ForceLookJson
    contact: ContactJson


def bench_problems(config: Config) -> list[str]:
    """Return the problems of a configuration, one line each."""
    return [str(problem) for problem in _problems(config)]


def refuse_bench(config: Config) -> None:
    """Raise BadInputError for the first problem of a configuration."""
    for problem in _problems(config):
        raise problem


def _problems(config: Config) -> Iterator[BadInputError]:
    force = config.force.port
    for port in stage_ports(config.stage):
        if _same_port(port, force):
            yield BadInputError(
                f"stage.port and force.port are both {port}; give each device its own port", "same_port"
            )
    adapter = config.sync.adapter
    for device, ports in (("stage", stage_ports(config.stage)), ("force", (force,))):
        if adapter is not None and any(_same_port(adapter.port, port) for port in ports):
            yield BadInputError(
                f"sync.output: {adapter.port} is {device}.port, whose lines belong to that device; use an adapter of "
                "its own",
                "same_port",
            )
    try:
        refuse_place(0.0, 0.0, config)
    except BadInputError as error:
        yield BadInputError(f"frame: the stage cannot reach the pad at clearance: {error}", error.code)
    apex_mm, lowest_mm = config.frame.apex_z_mm, -config.stage.travel_mm[2]
    if not lowest_mm <= apex_mm <= 0:
        yield BadInputError(
            f"frame.apex_z_mm = {apex_mm:g} mm is outside the stage's travel, {lowest_mm:g} … 0 mm",
            "apex_outside_travel",
        )


def sync_problems(config: Config) -> list[str]:
    """Return why the adapter of the sync line cannot be used, in one line; its line is put at rest."""
    adapter = config.sync.adapter
    if adapter is None or port_owner(adapter.port) is not None:
        return []
    try:
        with closing(AdapterOutput(config.sync, WallClock())):
            return []
    except TransportError as error:
        return [str(error)]


def _same_port(one: str, other: str) -> bool:
    """Return whether two names are the same port; a link counts as its device."""
    return one == other or (os.path.exists(one) and os.path.exists(other) and os.path.samefile(one, other))


def today() -> datetime.date:
    """Return the local date."""
    return datetime.datetime.fromtimestamp(WallClock().unix_s()).date()


def expired_calibrations(config: Config) -> list[str]:
    """Return a line per calibration out of date: refused on hardware, a warning in a dry run."""
    return [str(problem) for problem in _expired(config)]


def refuse_expired(config: Config) -> None:
    """Raise BadInputError for a calibration out of date: expired, or of a day to come."""
    for problem in _expired(config):
        raise problem


def _expired(config: Config) -> Iterator[BadInputError]:
    for name in config.calibration.expired(today()):
        expires = getattr(config.calibration, name).expires
        key = f"calibration.{name}"
        yield BadInputError(
            f"{key} expired on {expires}; measure it again (`rig calibrate`) and update the configuration", "expired"
        )
    for name in config.calibration.to_come(today()):
        measured = getattr(config.calibration, name).date
        key = f"calibration.{name}"
        yield BadInputError(
            f"{key} was measured on {measured}, but today is {today()}; correct the date or the clock of this "
            "computer",
            "of_a_day_to_come",
        )


def as_table(name: str, value: float, valid_days: int, sd: float | None = None) -> str:
    """Return a calibration made today as lines for the configuration file."""
    date = today()
    expires = date + datetime.timedelta(days=valid_days)
    known_to = {} if sd is None else {"sd": tomlkit.value(f"{sd:.3g}")}
    table = {"value": tomlkit.value(f"{value:.6g}"), **known_to, "date": date, "expires": expires}
    return tomlkit.dumps({"calibration": {name: table}})


_CODE = re.compile(r"[A-Z]{1,3}[0-9]{2,6}")


def checked_subject(code: str | None) -> str | None:
    """Return a valid subject code, which cannot be a name. Raises BadInputError."""
    if code is None or _CODE.fullmatch(code):
        return code
    raise BadInputError(
        "--subject: not a subject code; use one to three capital letters and two to six digits, such as "
        "S07, never a name",
        "no_subject_code",
    )


_AT_REST = ("Idle", "Alarm")


def look(settings: Config, *, closely: bool = False) -> tuple[StageLookJson, ForceLookJson]:
    """Return the state of stage and force sensor: type, port, and owner, status or problem.

    closely: also identify a stage at rest, and compare its settings with the configuration.
    """
    return _look_at_stage(settings, closely=closely)[0], _look_at_force(settings)


def look_and_contact(settings: Config, *, closely: bool = False) -> StatusJson:
    """Return the state of both devices and of contact: measured now where possible, else as recorded.

    It is measured where the stage stands homed as it was left, the sensor has a zero on record, and both are free.
    Such a measurement connects the sensor, as the commands that count from this zero do.
    """
    stage, at = _look_at_stage(settings, closely=closely)
    force, record = _look_at_force(settings), BenchMemory(settings).read()
    known = _measured_contact(settings, at, record) if "force_n" in force else None
    return {"stage": stage, "force": force, "contact": contact_as_json(known or record.aged_contact(at))}


def _measured_contact(settings: Config, at: StageStatus | None, record: LastKnown) -> KnownContact | None:
    """Return contact as position and force show it now, or None where one of them cannot be relied on."""
    if at is None or record.zero is None or not record.is_where_left(at):
        return None
    clock = WallClock()
    try:
        with closing(open_force(settings, clock)) as force:
            sensing = Sensing(settings, clock, force)
            sensing.connect()
            sensing.zero = record.zero
            force_gwt = sensing.at_rest_gwt()
    except (ForceError, TransportError, NoReadingError):
        return None
    touch_gwt, now_s = sensing.touch_gwt, clock.unix_s()
    return contact_at(settings, at, placed=True, force_gwt=force_gwt, touch_gwt=touch_gwt, unix_s=now_s)


def contact_as_json(known: KnownContact | None) -> ContactJson:
    """Return the state of contact as JSON; None: nothing is on record."""
    if known is None:
        return {
            "contact": None, "may_touch": None, "force_gwt": None, "measured_unix_s": None,
            "where_text": "nothing on record", "to_do_text": None,
        }  # fmt: skip
    return known.as_json()


def in_one_line(found: Mapping[str, object]) -> str:
    """Format a state for the terminal: its sentences, or else keys and values without codes."""
    sentences = [str(found[key]) for key in ("where_text", "to_do_text") if found.get(key)]
    return "; ".join(sentences) or ", ".join(
        f"{titled(key)} {as_words(value)}" for key, value in found.items() if key != "code" and value is not None
    )


def titled(key: str) -> str:
    """Return a key of JSON as the terminal shows it."""
    return _TITLES.get(key, key.removesuffix("_text"))


_TITLES = {"ports": "port", "since_utc": "since", "stop": "stopped by"}


def as_words(value: object) -> str:
    """Format a value of JSON for the terminal."""
    return " and ".join(map(str, value)) if isinstance(value, list) else str(value)


class PositionJson(Output):
    """State of the stage, with its position in machine coordinates."""

    state: Name
    x_mm: float
    y_mm: float
    z_mm: float


def position(at: StageStatus) -> PositionJson:
    """Return a status as commands print it."""
    return {"state": at.state, "x_mm": at.x_mm, "y_mm": at.y_mm, "z_mm": at.z_mm}


def _look_at_stage(settings: Config, *, closely: bool) -> tuple[StageLookJson, StageStatus | None]:
    ports = stage_ports(settings.stage)
    found: StageLookJson = {"kind": settings.stage.kind, "ports": list(ports)}
    owner, at = first_owner(ports), None
    if owner is not None:
        _add_owner(found, owner)
        return found, None
    try:
        with closing(open_stage(settings, WallClock())) as stage:
            at = stage.look()
            found["state"], found["x_mm"], found["y_mm"], found["z_mm"] = at.state, at.x_mm, at.y_mm, at.z_mm
            if closely and at.state in _AT_REST:
                found["identity"] = stage.connect()
    except (StageError, TransportError) as error:
        found["problem_text"], found["code"] = str(error), error.code
    return found, at


def _look_at_force(settings: Config) -> ForceLookJson:
    found: ForceLookJson = {"kind": settings.force.kind, "ports": [settings.force.port]}
    owner = port_owner(settings.force.port)
    if owner is not None:
        _add_owner(found, owner)
        return found
    try:
        with closing(open_force(settings, WallClock())) as force:
            name, reading = force.identify(), force.read()
            found["identity"], found["force_n"], found["stable"] = name, reading.force_n, reading.stable
    except (ForceError, TransportError) as error:
        found["problem_text"], found["code"] = str(error), error.code
    return found


def _add_owner(found: DeviceLookJson, owner: PortOwner) -> None:
    """Add the process that owns a port, if known, and its activity."""
    found["owner"] = owner.pid
    activity = None if owner.pid is None else activity_of(owner.pid)
    if owner.pid is None:
        found["owner_text"] = str(owner)
    if activity is not None:
        found["does_text"], found["since_utc"] = activity["does_text"], activity["since_utc"]
        found["stop"] = activity["stop"]
