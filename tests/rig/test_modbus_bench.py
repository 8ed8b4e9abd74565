"""Drivers and virtual Modbus devices on one virtual clock: moves, stops, jogs, trips; the finger is a spring."""

import io
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from rig.bench.virtual import virtual_force, virtual_stage
from rig.data.events import STREAMS
from rig.devices.base import StageAlarm, StageError, StageTimeout
from rig.devices.laumas import LaumasForce
from rig.devices.leadshine import LeadshineStage
from rig.devices.make_drivers import force_driver, stage_driver
from rig.engine import Engine, Journal, Target, TripError, indent, verbs
from rig.engine.bench import NO_PAUSE, Meanwhile
from rig.engine.engine import State
from rig.engine.motion import Direction, jog
from rig.plan.config import Config
from rig.transport import LoggedTransport, LoopbackTransport
from rig.units import GWT_N
from sim.devices import Load, ModbusBus, SerialLine, VirtualDrive
from sim.devices.clock import VirtualClock
from sim.devices.leadshine import DrivePair
from tests.error_codes import raises

Make = Callable[..., "Bench"]


class Bench:
    """Two drives and a transmitter; F = k d^1.5 below contact_mm, a height above the nominal apex."""

    virtual = False

    def __init__(self, folder: Path, *, k_gwt: float = 6.0, contact_mm: float = -0.3, **tables: Any) -> None:
        stage = {"kind": "leadshine", **tables.pop("stage", {})}
        force = {"kind": "laumas", "baud": 115200, **tables.pop("force", {})}
        self.config = Config.model_validate({"stage": stage, "force": force, **tables})
        self.k_gwt, self.contact_mm = k_gwt, contact_mm
        self.clock = VirtualClock(1.7e9)
        self.stage_line, self.force_line = SerialLine(self.clock, 115200), SerialLine(self.clock, 115200)
        drives = virtual_stage(self.clock, self.stage_line, self.config)
        assert isinstance(drives, DrivePair)
        self.drives = drives
        self.load_n: Callable[[float], float] = self.force_n
        virtual_force(self.clock, self.force_line, self.config, Load(lambda t_s: self.load_n(t_s)))
        self.wire = io.StringIO()
        stage_port = LoggedTransport(LoopbackTransport(self.stage_line, self.clock, "stage"), self.clock, self.wire)
        force_port = LoopbackTransport(self.force_line, self.clock, "force")
        driver = stage_driver(lambda _: stage_port, self.clock, self.config)
        sensor = force_driver(lambda _: force_port, self.clock, self.config)
        assert isinstance(driver, LeadshineStage)
        assert isinstance(sensor, LaumasForce)
        self.stage, self.force = driver, sensor
        self.events: list[tuple[str, dict[str, Any]]] = []
        self.on_event: Callable[[str, Mapping[str, Any]], None] = lambda stream, data: None
        self.journal = Journal(folder / "events.jsonl", self.clock, STREAMS, self._watch, virtual=True)
        self.operator, self.pause = self, NO_PAUSE
        self.engine = Engine(self.config, self, self.journal)

    def mount(self, indentor: str, meanwhile: Meanwhile) -> str:
        return indentor

    def per_mm(self, axis: str) -> float:
        return abs(self.config.calibration.value(f"{axis}_steps_per_mm", 400.0))

    @property
    def carriage_mm(self) -> tuple[float, float]:
        x, _, z = self.drives.carriage_steps_at(self.clock.monotonic_s())
        return x / self.per_mm("x"), z / self.per_mm("z")

    @property
    def height_mm(self) -> float:
        return self.carriage_mm[1] - self.config.frame.apex_z_mm

    def force_n(self, t_s: float) -> float:
        height = self.drives.carriage_steps_at(t_s)[2] / self.per_mm("z") - self.config.frame.apex_z_mm
        return self.k_gwt * max(self.contact_mm - height, 0.0) ** 1.5 * GWT_N

    def ready(self) -> Engine:
        verbs.mount(self.engine, "bar:3.0")
        verbs.home(self.engine)
        verbs.zero(self.engine)
        verbs.move_to(self.engine, 0.0)
        return self.engine

    def at_first(self, phase: str, act: Callable[[], object]) -> None:
        """Do something once, when the first sample of a phase is on disk."""
        left = [act]

        def look(stream: str, data: Mapping[str, Any]) -> None:
            if left and stream == "sample" and data["phase"] == phase:
                left.pop()()

        self.on_event = look

    def _watch(self, stream: str, data: Mapping[str, Any]) -> None:
        self.events.append((stream, dict(data)))
        self.on_event(stream, data)


@pytest.fixture
def make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Make]:
    monkeypatch.setattr("rig.data.journal.os.fsync", lambda fd: None)
    made: list[Bench] = []

    def bench(**options: Any) -> Bench:
        folder = tmp_path / f"bench{len(made)}"
        folder.mkdir()
        made.append(Bench(folder, **options))
        return made[-1]

    yield bench
    for one in made:
        one.journal.close()


# --- motion ---


def test_the_drive_stops_at_its_soft_limit_and_the_driver_reports_the_missed_target(make: Make) -> None:
    """40 mm of travel: told to go to −41, the drive stops at −40, and the driver says so in bounded time."""
    bench = make()
    bench.stage.connect()
    bench.stage.home()
    start_s = bench.clock.monotonic_s()
    with raises(StageTimeout, "not_over", axis="z", drive=2, what="the move to -41 mm"):
        bench.stage.move_to(z_mm=-41.0, speed_mm_s=5.0)
    assert bench.carriage_mm[1] == -40.0
    assert bench.clock.monotonic_s() - start_s < 1.5 * 41 / 5 + 6
    assert not bench.stage.homed


def test_no_setting_is_saved_to_the_eeprom_of_a_drive(make: Make) -> None:
    bench = make()
    indent(bench.ready(), Target("force_gwt", 2.33), hold_s=0.2)
    assert bench.drives.x.eeprom_saves == bench.drives.z.eeprom_saves == 0


def test_a_drive_output_pulses_at_contact_hold_start_and_hold_end(make: Make) -> None:
    """At contact, hold start and hold end; each rise within the round trip that the journal gives."""
    sync = {"output": "drive", "register_address": 0x0157, "on_word": 0x80, "off_word": 0, "width_s": 0.02}
    bench = make(sync=sync)
    indent(bench.ready(), Target("force_gwt", 2.0), hold_s=0.2)
    pulses = [data for name, data in bench.events if name == "sync"]
    assert [pulse["at"] for pulse in pulses] == ["touch", "hold_start", "hold_end"]
    switched = list(bench.drives.z.outputs)
    assert [word for _, word in switched] == [0x80, 0] * 3
    assert not bench.drives.x.outputs
    for pulse, (rise_s, _), (fall_s, _) in zip(pulses, switched[::2], switched[1::2], strict=True):
        assert pulse["rise_s"] - pulse["uncertainty_s"] <= rise_s <= pulse["rise_s"]
        assert pulse["uncertainty_s"] < 0.01
        assert fall_s - rise_s == pytest.approx(0.02, abs=0.01)


# --- stopping ---


def test_a_drive_alarm_in_contact_stops_the_run_until_an_unlock(make: Make) -> None:
    bench = make()
    engine = bench.ready()
    bench.at_first("press", lambda: bench.drives.z.fault(0xE0))
    with raises(StageAlarm, "alarm", number=0xE0, axis="z", drive=2):
        indent(engine, Target("force_gwt", 2.33))
    assert engine.state is State.UNHOMED
    with raises(StageAlarm, "alarm", number=0xE0):
        verbs.home(engine)
    bench.stage.unlock()
    verbs.home(engine)


def test_a_drive_that_was_switched_off_stops_the_other_drive_too(make: Make) -> None:
    """A look asks both; the motion under way is given up within it."""
    bench = make()
    engine = bench.ready()
    bench.drives.z.power_cycle()
    start_mm = bench.carriage_mm[0]
    with pytest.raises((StageError, TripError)):
        verbs.move_to(engine, 5.0)
    assert abs(bench.carriage_mm[0] - start_mm) < 1.5
    assert engine.state is State.UNHOMED


# --- adapters that hear themselves ---


def test_an_echoing_adapter_changes_no_measured_force(make: Make) -> None:
    """Homing, a press to a force and a lift; the same readings."""
    ends = []
    for echoes in (False, True):
        bench = make()
        bench.stage_line.echoes = bench.force_line.echoes = echoes
        ends.append(indent(bench.ready(), Target("force_gwt", 2.33)).holds[0].force_gwt)
    assert ends[1] == pytest.approx(ends[0], abs=0.02)


def test_a_dead_drive_behind_an_echoing_adapter_is_detected(make: Make) -> None:
    bench = make()
    bench.stage_line.echoes = True
    engine = bench.ready()
    hear = bench.stage_line._on_bytes
    bench.at_first("press", lambda: bench.stage_line.connect(lambda data: None))
    with raises(StageTimeout, "only_echo"):
        indent(engine, Target("force_gwt", 2.33))
    assert engine.state is State.UNHOMED
    bench.stage_line.connect(hear)


# --- jog ---


def test_a_jog_whose_wire_is_cut_ends_at_its_distance(make: Make) -> None:
    bench = make()
    bench.stage.connect()
    cut_s = bench.clock.monotonic_s() + 0.3
    bench.clock.call_at(cut_s, lambda: bench.stage_line.connect(lambda data: None))
    start_mm = bench.carriage_mm[1]
    with raises(StageTimeout, "no_reply"):
        jog(bench.stage, bench.clock, Direction("z", 1), 2.0, 1.0)
    bench.clock.wait_s(5.0)
    assert bench.carriage_mm[1] - start_mm == pytest.approx(2.0, abs=0.003)


# --- force ---


def test_a_reading_waits_for_the_filter_of_the_transmitter_to_settle(make: Make) -> None:
    """Four samples of 50 ms in the mean: a reading right after a move would hold half of the way."""
    bench = make(force={"laumas": {"filter_samples": 4}})
    done = indent(bench.ready(), Target("doi_mm", 0.5), hold_s=0.1)
    assert done.holds[0].doi_mm == pytest.approx(0.5, abs=0.0025)
    pressed = [data for stream, data in bench.events if stream == "sample" and data["phase"] in ("press", "hold")]
    for sample in pressed:
        depth = -0.3 - sample["height_mm"]
        assert sample["force_gwt"] == pytest.approx(6.0 * max(depth, 0.0) ** 1.5, abs=0.02)


# --- a port for each drive ---


def test_two_drives_on_two_ports_are_stopped_at_the_same_instant(clock: VirtualClock) -> None:
    """Both are device 1; each port gets its own frame at the same instant."""
    drives = {"x": {"device_id": 1, "port": "/dev/x"}, "z": {"device_id": 1, "port": "/dev/z"}}
    config = Config.model_validate({"stage": {"kind": "leadshine", "drives": drives}})
    wire = io.StringIO()
    virtual = {port: VirtualDrive(clock) for port in ("/dev/x", "/dev/z")}

    def opener(port: str) -> LoggedTransport:
        line = SerialLine(clock, 115200)
        ModbusBus(clock, line, {1: virtual[port]})
        return LoggedTransport(LoopbackTransport(line, clock, port), clock, wire)

    stage = stage_driver(opener, clock, config)
    stage.connect()
    stage.home()
    stage.move_to(z_mm=-1.0, speed_mm_s=5.0)
    assert [drive.carriage_at(clock.monotonic_s()) for drive in virtual.values()] == [0, -400]
    before = len(wire.getvalue().splitlines())
    now_s = clock.monotonic_s()
    stage.stop()
    sent = [json.loads(line) for line in wire.getvalue().splitlines()[before:]]
    first = [(c["port"], c["hex"][:12]) for c in sent if c["t_s"] == pytest.approx(now_s, abs=1e-6)]
    assert first == [("/dev/z", "010660020040"), ("/dev/x", "010660020040")]
