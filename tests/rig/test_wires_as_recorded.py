"""What the drivers say on the wire, and when, as it was when somebody last looked at it (test_as_recorded.py)."""

import io
import json
import math
import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from rig.bench.virtual import virtual_force, virtual_stage
from rig.devices.base import ForceError, Stage, StageError
from rig.devices.make_drivers import force_driver, stage_driver
from rig.plan.config import Config
from rig.transport import LoopbackTransport
from rig.transport.wire import LoggedTransport
from sim.devices import SerialLine
from sim.devices.clock import VirtualClock
from sim.devices.line import Load

Recorded = Callable[[str, Any], None]
DAY = {"date": "2026-01-01", "expires": "2027-01-01"}
DRIVE = {"sync": {"output": "drive", "register_address": 0x0415, "on_word": 3, "off_word": 2}}


NUMBER = re.compile(r"-?\d+\.\d{6,}(e-?\d+)?")


class Wire:
    """A line to a virtual device that can be cut: then nothing comes back."""

    def __init__(self, clock: VirtualClock, line: SerialLine, *, framing: str | None) -> None:
        self.counted = 2 if framing == "tcp" else 0  # bytes of the transaction's number
        self.clock, self.log, self.cut, self.noise = clock, io.StringIO(), False, b""
        self.transport = LoggedTransport(LoopbackTransport(line, clock, "wire"), clock, self.log)
        self.name = self.transport.name

    def write(self, data: bytes) -> None:
        self.transport.write(data)

    def read(self, timeout_s: float) -> bytes:
        heard = self.transport.read(timeout_s)
        if heard and self.noise:
            heard, self.noise = self.noise, b""
        return b"" if self.cut else heard

    def close(self) -> None:
        self.transport.close()

    def sent(self) -> list[list[Any]]:
        """What was written, with the time; the same again and again as how often and until when."""
        chunks = [json.loads(line) for line in self.log.getvalue().splitlines()]
        found: list[list[Any]] = []
        for chunk in (c for c in chunks if c["dir"] == "tx"):
            said = bytes.fromhex(chunk["hex"])
            text = said.decode() if said.isascii() and b"\x00" not in said else said[self.counted :].hex(" ")
            if found and found[-1][0] == text:
                found[-1][2:] = [round(chunk["t_s"], 6), found[-1][3] + 1]
            else:
                found.append([text, round(chunk["t_s"], 6), round(chunk["t_s"], 6), 1])
        return found


class Diary:
    """What was asked of a driver, what it answered or how it failed, and when that was over."""

    def __init__(self, clock: VirtualClock) -> None:
        self.clock, self.entries = clock, list[list[Any]]()

    def __call__(self, what: str, action: Callable[[], Any]) -> Any:
        answer = None
        try:
            answer = action()
            said = str(answer)
        except (StageError, ForceError, ValueError) as error:
            said = f"{type(error).__name__}: {error}"
        self.entries.append(
            [what, NUMBER.sub(lambda found: f"{float(found.group()):.5f}", said), round(self.clock.monotonic_s(), 6)]
        )
        return answer


def _interrupted(looks: Iterator[Any], after: int, action: Callable[[], Any]) -> list[str]:
    """Look so often, then do something else to the stage."""
    seen = [str(next(looks)) for _ in range(after)]
    action()
    return seen


def _a_day_of(stage: Any, diary: Diary, wire: Wire) -> None:
    diary("connect", stage.connect)
    diary("a look", stage.look)
    diary("a move before homing", lambda: stage.move_to(z_mm=-5.0, speed_mm_s=2.0))
    diary("home", stage.home)
    diary("homed", lambda: stage.homed)
    diary("steps", lambda: [stage.steps_per_mm(axis) for axis in "xz"])
    diary("down", lambda: stage.move_to(z_mm=-5.0, speed_mm_s=2.0))
    diary("along", lambda: stage.move_to(x_mm=-30.0, speed_mm_s=8.0))
    diary("back", lambda: stage.move_to(x_mm=-29.5, speed_mm_s=8.0))
    diary("a step", lambda: stage.move_to(z_mm=-5.0025, speed_mm_s=0.5))
    diary("nowhere", lambda: stage.move_to(z_mm=-5.0025, speed_mm_s=0.5))
    diary("too far", lambda: stage.move_to(z_mm=-41.0, speed_mm_s=1.0))
    diary("up too far", lambda: stage.move_to(z_mm=0.5, speed_mm_s=1.0))
    diary("unlock after it", stage.unlock)
    diary("home after it", stage.home)
    diary("too slow", lambda: stage.move_to(z_mm=-5.0, speed_mm_s=0.0))
    diary("looks", lambda: [str(s) for s in stage.moving(z_mm=-6.0, speed_mm_s=1.0, look_s=0.3)])
    diary("halted", lambda: _interrupted(stage.moving(z_mm=-9.0, speed_mm_s=1.0, look_s=0.2), 3, stage.halt))
    diary("status", stage.status)
    diary("homed after a halt", lambda: stage.homed)
    diary("on", lambda: stage.move_to(z_mm=-9.0, speed_mm_s=1.0))
    diary("jog", lambda: stage.jog("z", 0.3, 1.0))
    diary("end of jog", stage.end_jog)
    diary("jog x", lambda: stage.jog("x", -0.3, 1.0))
    diary("end of jog x", stage.end_jog)
    diary("output on", lambda: stage.set_output(True))
    diary("output off", lambda: stage.set_output(False))
    wire.noise = b"\xffnoise\xff\r\n"
    diary("a garbled status", stage.status)
    diary("stopped", lambda: _interrupted(stage.moving(z_mm=-12.0, speed_mm_s=1.0, look_s=0.2), 2, stage.stop))
    diary("homed after a stop", lambda: stage.homed)
    diary("a move after a stop", lambda: stage.move_to(z_mm=-5.0, speed_mm_s=2.0))
    diary("unlock", stage.unlock)
    diary("status after it", stage.status)
    diary("home again", stage.home)
    looks = stage.moving(z_mm=-8.0, speed_mm_s=1.0, look_s=0.2)
    next(looks)
    wire.cut = True
    diary("no answer in a move", lambda: list(looks))
    diary("homed after no answer", lambda: stage.homed)
    diary("no answer", stage.status)
    diary("no answer to a move", lambda: stage.move_to(z_mm=-5.0, speed_mm_s=2.0))
    diary("no answer to homing", stage.home)
    diary("no answer to a jog", lambda: stage.jog("z", 0.3, 1.0))
    diary("no answer to a stop", stage.stop)
    wire.cut = False
    diary("a look after it", stage.look)
    diary("unlock after it", stage.unlock)
    diary("home at last", stage.home)


STAGE_SCENES: dict[str, dict[str, Any]] = {
    "grbl": {"sync": {"output": "coolant"}},
    "grbl with backlash, another way round": {
        "sync": {"output": "spindle"},
        "calibration": {"z_backlash_mm": {"value": 0.05, **DAY}, "x_backlash_mm": {"value": 0.1, **DAY},
                        "x_steps_per_mm": {"value": -396.0, **DAY}},
    },
    "leadshine": {"stage": {"kind": "leadshine"}, **DRIVE},
    "leadshine over tcp, with backlash": {
        "stage": {"kind": "leadshine", "framing": "tcp"}, "sync": {**DRIVE["sync"], "drive": "x"},
        "calibration": {"z_backlash_mm": {"value": 0.05, **DAY}, "x_steps_per_mm": {"value": -396.0, **DAY}},
    },
    "leadshine, fine and slow": {
        "stage": {"kind": "leadshine", "baud": 9600, "drives": {
            "x": {"device_id": 3, "pulses_per_rev": 1600, "ramp_ms": 100},
            "z": {"device_id": 4, "pulses_per_rev": 4000, "homing_high_rpm": 120}}},
    },
}  # fmt: skip


@pytest.mark.parametrize("name", STAGE_SCENES)
def test_a_stage(recorded: Recorded, name: str) -> None:
    config, clock = Config.model_validate(STAGE_SCENES[name]), VirtualClock()
    line = SerialLine(clock, config.stage.baud)
    virtual_stage(clock, line, config)
    wire = Wire(clock, line, framing=config.stage.framing)
    stage: Stage = stage_driver(lambda _: wire, clock, config)
    diary = Diary(clock)
    _a_day_of(stage, diary, wire)
    recorded(f"wire of {name}", {"diary": diary.entries, "sent": wire.sent()})


def test_a_drive_that_reports_faults(recorded: Recorded) -> None:
    config, clock = Config.model_validate({"stage": {"kind": "leadshine"}}), VirtualClock()
    line = SerialLine(clock, config.stage.baud)
    pair: Any = virtual_stage(clock, line, config)
    wire = Wire(clock, line, framing=None)
    stage: Any = stage_driver(lambda _: wire, clock, config)
    diary = Diary(clock)
    diary("home", stage.home)
    for code in (0xE0, 0xC0, 0xA1, 0x152, 0x240, 0x111):
        looks = stage.moving(z_mm=-8.0, speed_mm_s=1.0, look_s=0.2)
        next(looks, None)
        pair.z.fault(code)
        diary(f"fault {code:x}", lambda looks=looks: list(looks))
        diary("status", stage.status)
        diary("a move", lambda: stage.move_to(z_mm=-1.0, speed_mm_s=1.0))
        diary("unlock", stage.unlock)
        diary("home", stage.home)
    recorded("wire of a drive with faults", {"diary": diary.entries, "sent": wire.sent()})


FORCE_SCENES: dict[str, dict[str, Any]] = {
    "mtsics": {},
    "laumas": {"force": {"kind": "laumas"}},
    "laumas, net and signed": {
        "force": {"kind": "laumas", "framing": "tcp", "resolution_gwt": 0.1,
                  "laumas": {"weight": "net", "signs": "registers", "count_g": 0.1, "filter_samples": 4}},
        "calibration": {"force_scale": {"value": 1.02, **DAY}},
    },
}  # fmt: skip


@pytest.mark.parametrize("name", FORCE_SCENES)
def test_a_force_sensor(recorded: Recorded, name: str) -> None:
    config, clock = Config.model_validate(FORCE_SCENES[name]), VirtualClock()
    line = SerialLine(clock, config.force.baud)
    load_n = [0.05]
    virtual_force(clock, line, config, Load(lambda t_s: load_n[0] * (1 + math.exp(-t_s))))
    wire, diary = Wire(clock, line, framing=config.force.framing), Diary(clock)
    force: Any = force_driver(lambda _: wire, clock, config)
    for what in ("connect", "identify", "read", "zero", "read", "tare", "show_gross"):
        if hasattr(force, what):
            diary(what, getattr(force, what))
    for newton in (0.2, -0.2, 4.0, -4.0, 1e3, -1e3):
        load_n[0] = newton
        clock.wait_s(1.0)
        diary(f"{newton} N", force.read)
    load_n[0] = 0.01
    clock.wait_s(1.0)
    wire.noise = b"\xffnoise\xff\r\n"
    diary("garbled", force.read)
    diary("after it", force.read)
    wire.cut = True
    for what in ("read", "zero", "connect"):
        diary(f"no answer: {what}", getattr(force, what))
    wire.cut = False
    diary("again", force.read)
    recorded(f"wire of {name}", {"diary": diary.entries, "sent": wire.sent()})
