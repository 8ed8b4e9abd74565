"""`rig init`: which devices it takes, what it asks and refuses, and the file that it writes."""

import io
import os
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rig.bench import find_devices as finding
from rig.bench.checks import bench_problems
from rig.bench.find_devices import PortFound, look_at_port, stable_name
from rig.cli import init
from rig.cli.init import FINGERS, QUESTIONS
from rig.clock import WallClock
from rig.devices.base import ForceError, StageError
from rig.devices.registry import BUILT_IN, ForceKind, StageKind, find
from rig.errors import BadInputError
from rig.plan.config import Config, load_config
from rig.settings import StandaSettings
from rig.transport import PortOwner, TransportError
from rig.transport.ownership import PortOwnership
from tests.error_codes import raises
from tests.program import Ended, Program

STAGE, SENSOR, SILENT = "/dev/ttyUSB0", "/dev/ttyUSB1", "/dev/ttyUSB2"
GRBL = find(StageKind, "grbl")
STANDA = find(StageKind, "standa")
MTSICS = find(ForceKind, "mtsics")
ANSWERS = {
    "--travel-mm": "60,30,40", "--steps-per-mm": "none", "--range-gwt": "200", "--trip-n": "1.5", "--finger": "none",
}  # fmt: skip
BOTH = (PortFound(STAGE, GRBL, "a board"), PortFound(SENSOR, MTSICS, "a balance"))
Init = Callable[..., Ended]


class Typed(io.StringIO):
    """A terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def rig_init(program: Program, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Init:
    """Run it in a folder of its own, where ports answer so; typed=None: there is no terminal."""
    monkeypatch.chdir(tmp_path)

    def run(*words: str, found: tuple[PortFound, ...] = BOTH, typed: str | None = None) -> Ended:
        def find_devices(ports: list[str], clock: Any) -> Iterator[PortFound]:
            known = {one.port: one for one in found}
            yield from (known.get(port, PortFound(port)) for port in reversed(ports))

        monkeypatch.setattr(init, "find_devices", find_devices)
        monkeypatch.setattr(init, "serial_ports", lambda: [one.port for one in found])
        if typed is None:
            return program("init", *words)
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
        return program("init", *words, typed=Typed(typed))

    return run


def _options(**changed: str | None) -> list[str]:
    answers = {**ANSWERS, **{f"--{name.replace('_', '-')}": value for name, value in changed.items()}}
    return [word for option, value in answers.items() if value is not None for word in (option, value)]


# --- the file ---


def test_init_writes_a_commented_configuration_and_names_the_next_command(rig_init: Init) -> None:
    ended = rig_init("--yes", *_options())
    assert ended.code == 0, ended.err
    assert ended.out.splitlines()[-1] == "next: rig doctor --config rig.toml"
    text = Path("rig.toml").read_text(encoding="utf-8")
    config = load_config(Path("rig.toml"))
    assert (config.stage.kind, config.stage.port) == ("grbl", STAGE)
    assert (config.force.kind, config.force.port) == ("mtsics", SENSOR)
    assert (config.limits.soft_trip_n, config.limits.hard_trip_n) == (1.5, 1.961)
    assert bench_problems(config) == []
    assert StageKind.room in tomllib.loads(text)
    lines = text.splitlines()
    settings = [n for n, line in enumerate(lines) if " = " in line and not line.startswith("#")]
    assert settings
    assert all(lines[n - 1].startswith("# ") for n in settings), "each key has its comment"
    described = type(config.stage).model_fields["travel_mm"].description
    assert described is not None
    assert described in text, "the words of the configuration itself"
    assert os.listdir() == ["rig.toml"]
    Path("plain").touch()
    assert Path("rig.toml").stat().st_mode == Path("plain").stat().st_mode, "readable as any new file"


@pytest.mark.parametrize("finger", FINGERS)
@pytest.mark.parametrize(
    ("travel", "steps"), [("60,30,40", "none"), ("200,100,80", "400,400,-400"), ("20,20,12", "250,250,800")]
)
def test_every_allowed_answer_of_init_gives_a_configuration_without_problems(
    rig_init: Init, travel: str, steps: str, finger: str
) -> None:
    """Also of a small stage: the frame lies within its travel."""
    ended = rig_init("--yes", *_options(travel_mm=travel, steps_per_mm=steps, finger=finger))
    assert ended.code == 0, ended.err
    config = load_config(Path("rig.toml"))
    assert bench_problems(config) == []
    assert config.finger.geometry.length_mm == (26.0 if finger == "human" else Config().finger.geometry.length_mm)
    assert len(list(config.calibration.measured())) == (0 if steps == "none" else 3)


@pytest.mark.parametrize("words", [("--stage-port", SILENT), ("--stage", "standa", "--stage-port", SILENT)])
def test_init_writes_the_serial_number_of_each_standa_controller(rig_init: Init, words: tuple[str, ...]) -> None:
    """Of ports whose names may change, the driver refuses those without."""
    z, x = (PortFound(port, STANDA, f"controller {n}", serial=n) for port, n in ((SILENT, 12), (STAGE, 34)))
    ended = rig_init("--yes", *words, *_options(), found=(x, z, BOTH[1]))
    assert ended.code == 0, ended.err
    own = load_config(Path("rig.toml")).stage.own(StandaSettings)
    assert (own.x_port, own.z.serial, own.x.serial) == (STAGE, 12, 34)
    ended = rig_init("--yes", "--replace", *words, *_options(), found=(z, BOTH[1]))
    assert ended.code == 0, ended.err
    own = load_config(Path("rig.toml")).stage.own(StandaSettings)
    assert (own.z.serial, own.x.serial) == (12, None)


def test_init_replaces_an_existing_file_only_with_replace(rig_init: Init) -> None:
    Path("rig.toml").write_text("mine", encoding="utf-8")
    ended = rig_init("--yes", "--json", *_options())
    assert (ended.code, ended.error_code) == (2, "exists_already")
    assert Path("rig.toml").read_text(encoding="utf-8") == "mine"
    assert rig_init("--yes", "--replace", *_options()).code == 0
    assert load_config(Path("rig.toml")).stage.port == STAGE


def test_init_keeps_a_file_that_appears_meanwhile(tmp_path: Path) -> None:
    there = tmp_path / "rig.toml"
    there.write_text("mine", encoding="utf-8")
    with raises(BadInputError, "exists_already"):
        init.write_new(there, "[stage]\n", replace=False)
    assert (there.read_text(encoding="utf-8"), os.listdir(tmp_path)) == ("mine", ["rig.toml"])


# --- what is missing and what is wrong ---


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda question: question.name)
def test_init_without_a_terminal_names_the_missing_answer(rig_init: Init, question: Any) -> None:
    for words in ((), ("--yes",)):
        ended = rig_init("--json", *words, *_options(**{question.name: None}))
        assert (ended.code, ended.error_code) == (2, "answers_missing")
        assert question.option in ended.complaint
    assert os.listdir() == []


@pytest.mark.parametrize(
    ("changed", "code"),
    [
        ({"travel_mm": "60,30"}, "not_three"),
        ({"travel_mm": "nan,1,1"}, "invalid_value"),
        ({"travel_mm": "far"}, "not_numbers"),
        ({"steps_per_mm": "0,400,400"}, "impossible_value"),
        ({"range_gwt": "0"}, "invalid_value"),
        ({"trip_n": "5.5"}, "invalid_value"),
        ({"trip_n": "1.97"}, "invalid_table"),  # above what the sensor measures
        ({"finger": "thumb"}, "unknown_finger"),
    ],
)
def test_init_refuses_an_answer_that_the_configuration_forbids(
    rig_init: Init, changed: dict[str, str], code: str
) -> None:
    ended = rig_init("--yes", "--json", *_options(**changed))
    assert (ended.code, ended.error_code) == (2, code)
    assert os.listdir() == []


@pytest.mark.parametrize(
    ("words", "found", "code"),
    [
        (("--stage-port", SENSOR), BOTH, "swapped_ports"),
        (("--stage-port", SENSOR, "--sensor-port", STAGE), BOTH, "swapped_ports"),
        (("--stage", "leadshine", "--stage-port", STAGE), BOTH, "another_device"),
        (("--sensor", "laumas", "--sensor-port", SENSOR), BOTH, "another_device"),
        (("--sensor", "scale"), BOTH, "unknown_device"),
        (("--sensor", "mtsics", "--sensor-port", STAGE), (PortFound(STAGE),), "answers_missing"),
        (("--stage", "grbl", "--stage-port", SILENT, "--sensor", "mtsics", "--sensor-port", SILENT), (), "same_port"),
        (("--port", "tcp://no"), BOTH, "no_port_name"),
    ],
)
def test_init_refuses_swapped_or_wrong_devices_and_writes_nothing(
    rig_init: Init, words: tuple[str, ...], found: tuple[PortFound, ...], code: str
) -> None:
    ended = rig_init("--yes", "--json", *words, *_options(), found=found)
    assert (ended.code, ended.json["code"]) == (2, code)
    assert os.listdir() == []


def test_init_accepts_a_port_that_does_not_answer_with_a_warning(rig_init: Init) -> None:
    words = ("--stage", "leadshine", "--stage-port", STAGE, "--sensor", "laumas", "--sensor-port", SENSOR)
    problem = PortFound(STAGE, problem=TransportError("no permission", "no_permission"))
    ended = rig_init("--yes", *words, *_options(), found=(problem,))
    assert ended.code == 0
    assert ended.err.count("rig: warning: ") == 2
    assert load_config(Path("rig.toml")).stage.kind == "leadshine"


@pytest.mark.parametrize(
    ("found", "shown"),
    [
        ((BOTH[0], PortFound(SENSOR, MTSICS, problem=ForceError("set it to g", "wrong_unit"))), "set it to g"),
        ((PortFound(STAGE, GRBL, problem=StageError("older than 1.1", "old_firmware")), BOTH[1]), "older than 1.1"),
    ],
)
def test_init_accepts_a_device_that_cannot_be_used_yet_with_a_warning(
    rig_init: Init, found: tuple[PortFound, ...], shown: str
) -> None:
    """It may be set right later."""
    for words in ([], ["--json"]):
        ended = rig_init("--yes", "--replace", *words, *_options(), found=found)
        assert ended.code == 0
        assert ended.err.count(f"rig: warning: {shown}") == 1


# --- questions at a terminal ---


def test_init_takes_the_default_for_an_empty_line_and_repeats_a_question(rig_init: Init) -> None:
    ended = rig_init(typed="60,30\n\n\n\n\n\n")
    assert ended.code == 0, ended.err
    config = load_config(Path("rig.toml"))
    assert (config.stage, config.limits, config.frame) == (
        config.stage.model_copy(update={"travel_mm": (60.0, 30.0, 40.0)}), Config().limits, Config().frame,
    )  # fmt: skip
    assert ended.err.count("rig: ") == 1


def test_init_writes_nothing_when_the_input_ends(rig_init: Init) -> None:
    ended = rig_init(typed="60,30,40\n")
    assert (ended.code, os.listdir()) == (130, [])


# --- ports ---


def test_probing_a_port_in_use_sends_nothing_and_names_its_owner(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    port = tmp_path / "port"
    port.touch()

    def probe(*words: Any) -> None:
        raise AssertionError("asked")

    monkeypatch.setattr(finding, "probe", probe)
    owned = PortOwnership(str(port))
    try:
        found = look_at_port(str(port), WallClock())
    finally:
        owned.release()
    assert (found.kind, found.owner) == (None, PortOwner(os.getpid()))
    assert str(os.getpid()) in found.words
    assert (found.as_json()["owner"], found.as_json()["code"]) == (os.getpid(), "in_use")


def test_probing_a_port_tries_device_kinds_in_order_until_one_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Boards first: they act on single bytes. What cannot be opened is asked no more."""
    asked: list[str] = []

    def probe(kind: Any, port: str, clock: Any, *, own: Any) -> str | None:
        asked.append(kind.name)
        return "it" if kind.name == "mtsics" else None

    monkeypatch.setattr(finding, "probe", probe)
    assert look_at_port(SILENT, WallClock()) == PortFound(SILENT, MTSICS, "it")
    assert asked == [*(kind for kind in BUILT_IN["stage"] if find(StageKind, kind).probe), "mtsics"]

    def closed(kind: Any, port: str, clock: Any, *, own: Any) -> str | None:
        asked.append(kind.name)
        raise TransportError("no", "no_permission")

    asked.clear()
    monkeypatch.setattr(finding, "probe", closed)
    problem = look_at_port(SILENT, WallClock()).problem
    assert (asked, problem is not None and problem.code) == (["grbl"], "no_permission")


def test_a_serial_port_is_named_by_its_stable_link(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    device, links = tmp_path / "ttyUSB3", tmp_path / "by-id"
    device.touch()
    monkeypatch.setattr(finding, "BY_ID", links)
    assert stable_name(str(device)) == str(device)
    links.mkdir()
    (links / "usb-board").symlink_to(device)
    assert stable_name(str(device)) == str(links / "usb-board")
    assert stable_name(SILENT) == SILENT
