"""`rig init`: find the devices, ask for what cannot be found, and write a configuration file."""

import datetime
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

from pydantic import ValidationError

from rig.bench.checks import refuse_bench, today
from rig.bench.find_devices import PortFound, PortFoundJson, find_devices, serial_ports
from rig.cli.options import JsonOption, checked_file, option
from rig.cli.output import NotConfirmedError, busy, complain, err, out, print_json, writes_json
from rig.cli.request import takes
from rig.cli.signals import typed_line
from rig.clock import WallClock
from rig.data.folder import replace_text
from rig.devices.registry import DEFAULTS, Room, StageKind, find, names, with_kind_tables
from rig.errors import BadInputError, first_problem
from rig.plan.config import Config, Key, as_toml, config_from, keys
from rig.plan.finger_file import example_finger
from rig.printable import either
from rig.units import GWT_N
from rig_shared.number_text import read_number
from rig_shared.outputs import CommandLine, File, Name, Output, Port
from rig_shared.user_files import toml_of

_DEVICES, _ANSWERS = "Devices", "Answers"
WORDS: Mapping[Room, tuple[str, str, str]] = {
    "stage": ("--stage", "--stage-port", "stage"),
    "force": ("--sensor", "--sensor-port", "force sensor"),
}
"""Options of a device's kind and port, and its name in sentences."""

NOMINAL_DAYS = 30
"""Days for which steps per mm that were entered, not measured, may be used."""

Tables = dict[str, dict[str, Any]]


class DeviceWrittenJson(Output):
    """A device in the new configuration; identity is null if it did not answer."""

    kind: Name
    port: Port
    identity: Name | None


class InitJson(Output):
    """A new configuration file."""

    config: File
    ports: list[PortFoundJson]
    stage: DeviceWrittenJson
    force: DeviceWrittenJson
    next: CommandLine
    """Command to enter next."""


@dataclass(frozen=True)
class InitRequest:
    """Arguments and options of `rig init`."""

    port: Annotated[
        list[str] | None,
        option(
            "Port to search: serial or tcp://HOST:PORT. May be repeated. Default: all serial ports.", "PORT", _DEVICES
        ),
    ] = None
    stage: Annotated[
        str | None,
        option(f"Kind of stage: {either(names('stage'))}. Default: the one that is found.", "KIND", _DEVICES),
    ] = None
    stage_port: Annotated[str | None, option("Port of the stage. Default: where one is found.", "PORT", _DEVICES)] = (
        None
    )
    sensor: Annotated[
        str | None,
        option(f"Kind of force sensor: {either(names('force'))}. Default: the one that is found.", "KIND", _DEVICES),
    ] = None
    sensor_port: Annotated[
        str | None, option("Port of the force sensor. Default: where one is found.", "PORT", _DEVICES)
    ] = None
    travel_mm: Annotated[
        str | None, option("Travel of the axes from home, in mm. Default: prompted.", "X,Y,Z", _ANSWERS)
    ] = None
    steps_per_mm: Annotated[
        str | None,
        option(
            "Motor steps per mm, negative if the motor runs against the axis; none: as set in the controller. "
            "Default: prompted.",
            "X,Y,Z|none",
            _ANSWERS,
        ),
    ] = None
    range_gwt: Annotated[
        str | None, option("Largest force that the sensor measures, in gwt. Default: prompted.", "GWT", _ANSWERS)
    ] = None
    trip_n: Annotated[
        str | None, option("Force that trips a run, in N, at most 5. Default: prompted.", "N", _ANSWERS)
    ] = None
    finger: Annotated[
        str | None,
        option(
            "Simulated finger: none yet, the built-in one, or the human-sized example. Default: prompted.",
            "none|default|human",
            _ANSWERS,
        ),
    ] = None
    to: Annotated[Path, option("Configuration file to write.", "TOML", name="--to")] = Path("rig.toml")
    force: Annotated[bool, option("Replace an existing file.", name="--replace")] = False
    yes: Annotated[bool, option("Do not prompt; take all answers from options.", name="--yes")] = False
    as_json: JsonOption = False


@takes(InitRequest)
def init_command(request: InitRequest) -> None:
    """Find the devices on the ports, ask for the rest, and write a configuration file.

    Each port is asked with questions only: nothing moves and nothing is zeroed. Opening a port restarts many boards.
    """
    checked_file("--to", request.to, ".toml")
    if request.to.exists() and not request.force:
        raise _exists_already(request.to)
    given = {
        "stage": _DeviceOptions(request.stage, request.stage_port),
        "force": _DeviceOptions(request.sensor, request.sensor_port),
    }
    for room in WORDS:
        _refuse_unknown_kind(room, given[room].kind)
    found = _looked_at(_ports(request.port, given), quiet=writes_json() and not err.is_terminal)
    talk = _Talk(interactive=not request.yes and sys.stdin.isatty() and sys.stderr.isatty())
    draft = _Draft()
    for room in WORDS:
        _choose(room, given[room], found, draft, talk)
    for question in QUESTIONS:
        question.settle(getattr(request, question.name), draft, talk)
    talk.refuse_missing()
    config = draft.config()
    refuse_bench(config)
    write_new(request.to, _file(config, draft), replace=request.force)
    following = shlex.join(["rig", "doctor", "--config", str(request.to)])
    if writes_json():
        written: InitJson = {
            "config": str(request.to), "ports": [one.as_json() for one in found],
            "stage": draft.device("stage"), "force": draft.device("force"), "next": following,
        }  # fmt: skip
        print_json(written)
        return
    out.print(f"wrote {request.to}")
    out.print(f"next: {following}")


@dataclass(frozen=True)
class _DeviceOptions:
    """Kind and port of a device from the options."""

    kind: str | None
    port: str | None


@dataclass
class _Talk:
    """Questions at the terminal; without one, the options that are missing."""

    interactive: bool
    missing: list[str] = field(default_factory=list)

    def ask(self, option: str, what: str, default: str | None, take: Callable[[str], None]) -> None:
        """Prompt until an answer is accepted; an empty line selects the default.

        Raises NotConfirmedError at the end of input.
        """
        if not self.interactive:
            self.missing.append(option)
            return
        while True:
            err.print(f"{what}{'' if default is None else f' [{default}]'}: ", end="")
            line = typed_line()
            if not line:
                raise NotConfirmedError(f"{option} was not answered; no file was written")
            answer = line.strip() or default or ""
            try:
                take(answer)
                return
            except BadInputError as error:
                complain(str(error))

    def refuse_missing(self) -> None:
        """Raise BadInputError for prompts that have no answer in a non-interactive session."""
        if self.missing:
            raise BadInputError(
                f"init: cannot prompt without a terminal or with --yes; add {', '.join(self.missing)}",
                "answers_missing",
            )


@dataclass
class _Draft:
    """Tables of the new file; each change is validated with all of them."""

    tables: Tables = field(default_factory=dict)
    identities: dict[str, str] = field(default_factory=dict)

    def put(self, option: str, tables: Mapping[str, Mapping[str, Any]]) -> None:
        """Add keys to tables. Raises BadInputError, and adds nothing, if the configuration refuses them."""
        changed = {name: dict(table) for name, table in self.tables.items()}
        for name, table in tables.items():
            changed[name] = {**changed.get(name, {}), **table}
        try:
            Config.model_validate(changed)
        except ValidationError as error:
            raise first_problem(option, error, with_kind_tables(Config, changed)) from None
        self.tables = changed

    def config(self) -> Config:
        """Return the configuration."""
        return Config.model_validate(self.tables)

    def device(self, room: Room) -> DeviceWrittenJson:
        """Return the device of the stage or the force sensor."""
        table = self.tables[room]
        return {"kind": table["kind"], "port": table["port"], "identity": self.identities.get(room)}

    @property
    def places(self) -> set[str]:
        """Full names of the keys that were put."""
        return set(_leaves("", self.tables))


def _leaves(place: str, tables: Mapping[str, Any]) -> Iterator[str]:
    for name, value in tables.items():
        here = f"{place}.{name}".lstrip(".")
        if isinstance(value, Mapping):
            yield from _leaves(here, value)
        else:
            yield here


# --- devices ---


def _refuse_unknown_kind(room: Room, kind: str | None) -> None:
    if kind is not None and kind not in names(room):
        raise BadInputError(
            f"{WORDS[room][0]} {kind}: unknown kind of device; choose {either(names(room))}", "unknown_device"
        )


def _ports(ports: Sequence[str] | None, given: Mapping[str, _DeviceOptions]) -> list[str]:
    """Return the ports to search: those of the options, and all serial ports unless the options name enough."""
    named = [one.port for one in given.values() if one.port is not None]
    for port in (*(ports or ()), *named):
        _Draft().put("init", {"stage": {"port": port}})
    listed = [] if ports or len(named) == len(given) else serial_ports()
    return list(dict.fromkeys([*(ports or []), *named, *listed]))


def _looked_at(ports: Sequence[str], *, quiet: bool) -> list[PortFound]:
    """Probe the ports, and print each result as it arrives."""
    tell: Callable[[str], object] = str if quiet else err.print
    if not ports:
        tell("no serial port is connected; name ports with --port, such as --port tcp://192.168.0.7:502")
        return []
    tell(f"looking for devices on {', '.join(ports)}; a silent port takes about 10 s …")
    found: list[PortFound] = []
    with busy("ports asked", quick=True, total=len(ports)) as now:
        for one in find_devices(ports, WallClock()):
            tell(f"{one.port}: {one.words}")
            found.append(one)
            now.at(len(found), len(ports))
    return sorted(found, key=lambda one: ports.index(one.port))


def _choose(room: Room, given: _DeviceOptions, found: Sequence[PortFound], draft: _Draft, talk: _Talk) -> None:
    """Add a device to the draft: from the options, the only one found, or the one that the user names."""
    of_kind, of_port, device = WORDS[room]

    def take(kind: str, port: str) -> None:
        _refuse_unknown_kind(room, kind)
        there = next((one for one in found if one.port == port and one.kind is not None), None)
        own = _several_ports(room, kind, port, found)
        if there is not None and there.kind is not None and there.own and there.kind.name == kind:
            own.setdefault(there.kind.place, {}).update(there.own)
        draft.put(of_port, {room: {"kind": kind, "port": port, **own}})
        if there is not None and there.problem is not None:
            complain(f"warning: {there.problem}")
        if there is not None and there.identity is not None:
            draft.identities[room] = there.identity

    if given.port is not None:
        there = next(one for one in found if one.port == given.port)
        _refuse_another(room, given, there)
        kind = given.kind or (None if there.kind is None else there.kind.name)
        if there.kind is None:
            complain(f"warning: {given.port}: {there.words}; check it with rig doctor")
        if kind is None:
            talk.ask(of_kind, _kinds_of(room), DEFAULTS[room], lambda word: take(word, str(given.port)))
        else:
            take(kind, given.port)
        return
    fitting = [one for one in found if one.kind is not None and one.kind.room == room
               and given.kind in (None, one.kind.name)]  # fmt: skip
    if len(fitting) == 1:
        assert fitting[0].kind is not None
        take(fitting[0].kind.name, fitting[0].port)
    elif fitting:
        kinds = {one.port: one.kind.name for one in fitting if one.kind is not None}
        what = f"port of the {device}; there is one on each of {', '.join(kinds)}"
        talk.ask(
            of_port, what, fitting[0].port, lambda word: take(given.kind or kinds.get(word, DEFAULTS[room]), word)
        )
    else:
        kind = given.kind
        if kind is None:
            chosen: list[str] = []

            def choose(word: str) -> None:
                _refuse_unknown_kind(room, word)
                chosen.append(word)

            talk.ask(of_kind, f"no {device} was found; {_kinds_of(room)}", DEFAULTS[room], choose)
            kind = chosen[0] if chosen else None
        silent = [one.port for one in found if one.kind is None]
        usual = silent[0] if silent else str(getattr(Config(), room).port)
        talk.ask(of_port, f"port of the {device}", usual, lambda word: take(kind or DEFAULTS[room], word))


def _several_ports(room: Room, kind: str, port: str, found: Sequence[PortFound]) -> Tables:
    """Return the table with the further ports of a stage, if as many others have its kind, and its serial numbers."""
    entry = find(StageKind, kind) if room == "stage" else None
    if entry is None:
        return {}
    mine = {one.port: one for one in found if one.kind is not None and one.kind.name == kind}
    others = [one for one in mine if one != port] if entry.further_ports else []
    if len(others) != len(entry.further_ports):
        keys = " and ".join(f"{room}.{entry.place}.{key}" for key in entry.further_ports)
        complain(f"warning: the stage has further ports; set {keys} in the file")
        others = []
    own: dict[str, Any] = dict(zip(entry.further_ports, others, strict=False))
    for key, name in zip(entry.serial_keys, [port, *others], strict=False):
        if name in mine and mine[name].serial is not None:
            axis, _, number = key.partition(".")
            own[axis] = {number: mine[name].serial}
    return {entry.place: own} if own else {}


def _kinds_of(room: Room) -> str:
    return f"kind of {WORDS[room][2]} ({' | '.join(names(room))})"


def _refuse_another(room: Room, given: _DeviceOptions, there: PortFound) -> None:
    """Raise BadInputError if another device answers on the port of a device."""
    if there.kind is None or (there.kind.room == room and given.kind in (None, there.kind.name)):
        return
    option, port_option, device = WORDS[room]
    swapped = there.kind.room != room
    other = WORDS[there.kind.room][2] if swapped else there.kind.name
    advice = f"give the port to {WORDS[there.kind.room][1]}" if swapped else f"correct {option}"
    raise BadInputError(
        f"{port_option} {given.port}: a {other} answers there, not a {device} ({there.words}); {advice}",
        "swapped_ports" if swapped else "another_device",
    )


# --- questions ---


@dataclass(frozen=True)
class Question:
    """Question about the rig.

    name: parameter of the command. key: key of the configuration that describes it, or empty. what: its words
    otherwise. default: answer to an empty line, from the tables so far. tables: what an answer puts into the
    configuration, which validates it.
    """

    name: str
    key: str
    what: str
    default: Callable[[Config], str]
    tables: Callable[[str, Config], Mapping[str, Mapping[str, Any]]]

    @property
    def option(self) -> str:
        """Option that answers the question."""
        return f"--{self.name.replace('_', '-')}"

    def settle(self, answer: str | None, draft: _Draft, talk: _Talk) -> None:
        """Add the value of the option to the draft, or prompt for one."""
        so_far = draft.config()

        def take(text: str) -> None:
            draft.put(self.option, self.tables(text, so_far))

        if answer is not None:
            take(answer)
        else:
            talk.ask(self.option, self._words(so_far), self.default(so_far), take)

    def _words(self, so_far: Config) -> str:
        if not self.key:
            return self.what
        described = next(one for one in keys(so_far) if one.place == self.key)
        return f"{described.what} ({described.allowed_in_words})"


def _numbers(option: str, text: str) -> list[float]:
    try:
        return [read_number(part) for part in text.split(",")]
    except ValueError:
        raise BadInputError(f"{option} {text!r}: must be numbers separated by commas", "not_numbers") from None


def _three(option: str, text: str) -> list[float]:
    found = _numbers(option, text)
    if len(found) != 3:
        raise BadInputError(f"{option} {text!r}: must be three numbers, for x, y and z", "not_three")
    return found


def _number(option: str, text: str) -> float:
    found = _numbers(option, text)
    if len(found) != 1:
        raise BadInputError(f"{option} {text!r}: must be one number", "not_numbers")
    return found[0]


def _travel(text: str, so_far: Config) -> Tables:
    """Return the travel, and a frame inside it in the proportions of the default one."""
    travel = _three("--travel-mm", text)
    usual = Config()
    frame = {
        key: round(travel[axis] * getattr(usual.frame, key) / usual.stage.travel_mm[axis], 3)
        for axis, key in enumerate(("pad_centre_x_mm", "pad_y_mm", "apex_z_mm"))
    }
    return {"stage": {"travel_mm": travel}, "frame": frame}


def _steps(text: str, so_far: Config) -> Tables:
    """Return steps per mm as calibrations that were not measured and expire soon."""
    if text == "none":
        return {}
    steps = _three("--steps-per-mm", text)
    dates = {"date": today(), "expires": today() + datetime.timedelta(days=NOMINAL_DAYS)}
    return {
        "calibration": {f"{axis}_steps_per_mm": {"value": n, **dates} for axis, n in zip("xyz", steps, strict=True)}
    }


def _range(text: str, so_far: Config) -> Tables:
    """Return limits that the sensor can measure."""
    most_gwt = _number("--range-gwt", text)
    usual = Config().limits
    hard_n = min(usual.hard_trip_n, round(most_gwt * GWT_N, 3))
    return {
        "limits": {
            "max_force_gwt": min(usual.max_force_gwt, most_gwt),
            "soft_trip_n": min(usual.soft_trip_n, hard_n),
            "hard_trip_n": hard_n,
        }
    }


def _trip(text: str, so_far: Config) -> Tables:
    return {"limits": {"soft_trip_n": _number("--trip-n", text)}}


FINGERS: Mapping[str, Callable[[], Mapping[str, Any]]] = {
    "none": dict,
    "default": lambda: {"geometry": {"length_mm": Config().finger.geometry.length_mm}},
    "human": example_finger,
}
"""The table [finger] by the answer."""


def _finger(text: str, so_far: Config) -> Tables:
    if text not in FINGERS:
        raise BadInputError(f"--finger {text!r}: must be {either([*FINGERS])}", "unknown_finger")
    table = dict(FINGERS[text]())
    return {"finger": table} if table else {}


QUESTIONS = (
    Question("travel_mm", "stage.travel_mm", "", lambda config: _words(config.stage.travel_mm), _travel),
    Question(
        "steps_per_mm", "",
        "motor steps per mm of x, y and z, negative if the motor runs against the axis; none: as set in the "
        "controller (steps/mm, three numbers or none)",
        lambda config: "none", _steps,
    ),
    Question(
        "range_gwt", "", "largest force that the sensor measures, at which the limits end (gwt, number > 0)",
        lambda config: "510", _range,
    ),
    Question("trip_n", "limits.soft_trip_n", "", lambda config: f"{config.limits.soft_trip_n:g}", _trip),
    Question(
        "finger", "",
        "simulated finger: none yet, default (a monkey's, built in) or human (the human-sized example) "
        f"({' | '.join(FINGERS)})",
        lambda config: "none", _finger,
    ),
)  # fmt: skip
"""The questions, in the order in which they are asked."""


def _words(numbers: Sequence[float]) -> str:
    return ",".join(f"{one:g}" for one in numbers)


# --- the file ---

NOTES = {
    "frame": "where the finger lies; placeholders in the middle of the travel until you measure them",
    "calibration": "entered, not measured: calibrate the rig before these expire",
}
"""Comments above tables."""


def _file(config: Config, draft: _Draft) -> str:
    """Return the file: the keys that were found or answered, each with its description."""
    head = (
        f"# Configuration of the rig, written by `rig init` on {today().isoformat()}.\n"
        "# Keys that are not here have their defaults; `rig config` prints all of them with units and ranges.\n"
    )
    places = draft.places
    kept = [one for one in keys(config) if one.place in places]
    notes = {**NOTES, **{room: f"found: {identity}" for room, identity in draft.identities.items()}}
    parts = [head]
    for table, members in groupby(kept, lambda one: one.table):
        note = notes.pop(table.partition(".")[0], None)  # above the first table of its name
        parts.append("\n" + (f"# {note}\n" if note else "") + f"[{table}]\n" + "".join(map(_lines, members)))
    return "".join(parts)


def _lines(key: Key) -> str:
    """Return the lines of a key; a long list of rows without repeating its default."""
    if isinstance(key.value, tuple) and key.value and isinstance(key.value[0], tuple):
        rows = "".join(f"    {as_toml(row)},\n" for row in key.value)
        return f"# {key.what} ({key.allowed_in_words})\n{key.name} = [\n{rows}]\n"
    return key.lines


def write_new(path: Path, text: str, *, replace: bool) -> None:
    """Write a configuration file in one step, after validating it as a command would.

    A file that appeared meanwhile is left unless `replace`. Raises BadInputError, UnwritableError.
    """
    config_from(f"config {path}", toml_of(text), path.parent)
    try:
        replace_text(path, text, new=not replace)
    except FileExistsError:
        raise _exists_already(path) from None


def _exists_already(path: Path) -> BadInputError:
    return BadInputError(
        f"--to {path}: the file already exists; choose another name, or add --replace", "exists_already"
    )
