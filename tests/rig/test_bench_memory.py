"""What one command leaves to the next: the zero of the sensor, and where the homed stage stood."""

import io
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from rig.bench.virtual import bench_around, virtual_force, virtual_line
from rig.devices.base import StageReset, StageStatus
from rig.devices.make_drivers import force_driver
from rig.devices.registry import BUILT_IN
from rig.engine.bench_memory import BenchMemory, LastKnown
from rig.engine.contact import KINDS, KnownContact
from rig.engine.motion import DOWN
from rig.engine.sensing import ForceZero, Sensing
from rig.engine.steps import take_zero
from rig.manual.without_force import SessionWithoutForce
from rig.plan.config import Config
from rig.records import ContactKind
from rig.settings import RigSettings
from rig.transport import LoopbackTransport
from rig.units import GWT_N
from sim.carriage import Carriage
from sim.devices.clock import VirtualClock
from sim.devices.line import Load
from tests.rig.hand_bench import Spring

AT = StageStatus("Idle", -3.0, -2.0, -1.5)


@pytest.fixture
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BenchMemory:
    monkeypatch.setenv("RIG_STATE_DIR", str(tmp_path / "deep" / "state"))
    return BenchMemory(RigSettings())


@pytest.mark.parametrize(
    ("at", "there"),
    [
        (AT, True),
        (StageStatus("Idle", -3.0029, -2.0, -1.5), True), (StageStatus("Idle", -3.0031, -2.0, -1.5), False),
        (StageStatus("Idle", -3.0, -2.0031, -1.5), False), (StageStatus("Idle", -3.0, -2.0, -1.4969), False),
        (StageStatus("Alarm", -3.0, -2.0, -1.5), False), (StageStatus("Run", -3.0, -2.0, -1.5), False),
    ],
)  # fmt: skip
def test_a_stage_counts_as_unmoved_only_at_rest_and_within_three_micrometers(
    memory: BenchMemory, at: StageStatus, there: bool
) -> None:
    memory.left(AT)
    assert memory.read().left_at_mm == (-3.0, -2.0, -1.5)
    assert memory.read().is_where_left(at) is there


def test_a_motion_erases_the_recorded_stage_position_and_keeps_the_force_zero(memory: BenchMemory) -> None:
    memory.record_zero(ForceZero(0.25, 0.02))
    memory.left(AT)
    memory.moves()
    known = memory.read()
    assert known.zero == ForceZero(0.25, 0.02)
    assert known.zero_unix_s > 1.7e9
    assert known.left_at_mm is None


@pytest.mark.parametrize("before", [None, "lifted", "touching"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_record_says_when_and_by_which_command_the_indentor_was_lifted_and_contact_recorded(
    memory: BenchMemory, kind: ContactKind, before: ContactKind | None
) -> None:
    """A height alone makes no clear finger doubtful, and no doubtful one clear."""
    if before is not None:
        memory.touched(KnownContact(before, 0.0, unix_s=50.0))
    memory.began_unix_s = 1000.0
    found = KnownContact(kind, 3.0, 0.5, 2.5, 2000.0)
    memory.touched(found)
    last, lifts = memory.read(), kind in ("lifted", "raised")
    assert (last.lifted_unix_s == 2000.0, last.lifted_by_unix_s == 1000.0) == (lifts, lifts)
    keeps = before == "lifted" and kind == "raised"
    assert last.contact == (KnownContact("lifted", 0.0, unix_s=50.0) if keeps else found)
    assert (last.contact_by_unix_s == 1000.0) is not keeps
    assert last.is_lifted is (keeps or kind == "lifted")


def test_each_pair_of_ports_has_its_own_bench_memory(memory: BenchMemory) -> None:
    memory.left(AT)
    for table in ("stage", "force"):
        other = BenchMemory(RigSettings.model_validate({table: {"port": "/dev/ttyX"}}))
        assert other.read() == LastKnown()
    assert BenchMemory(RigSettings()).read().is_where_left(AT)


@pytest.mark.parametrize("text", ["", "{", '{"left_at_mm": "here"}', "[]"])
def test_an_unreadable_bench_memory_counts_as_empty_and_is_rewritten(
    memory: BenchMemory, tmp_path: Path, text: str
) -> None:
    memory.left(AT)
    (path,) = (tmp_path / "deep" / "state").iterdir()
    path.write_text(text, encoding="utf-8")
    assert memory.read() == LastKnown()
    memory.left(AT)
    assert json.loads(path.read_text(encoding="utf-8"))["left_at_mm"] == [-3.0, -2.0, -1.5]
    assert [one.name for one in path.parent.iterdir()] == [path.name], "nothing else is left there"


def test_a_bench_memory_folder_that_cannot_be_written_raises_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    monkeypatch.setenv("RIG_STATE_DIR", str(tmp_path / "file"))
    memory = BenchMemory(RigSettings())
    memory.left(AT)
    assert memory.read() == LastKnown()


def _bench(kind: str) -> Any:
    """A homed stage of a kind, and the record of where it stands."""
    config = Config.model_validate({"stage": {"kind": kind}})

    def make(carriage: Carriage) -> Spring:
        return Spring(carriage, 6.0)

    bench = bench_around(make, config, VirtualClock(1.7e9), io.StringIO())
    bench.stage.connect()
    bench.stage.home()
    memory = BenchMemory(config)
    memory.left(bench.stage.status())
    return bench, config, memory


def _switched_off_and_on(stage: Any) -> None:
    """All of it; two drives have a supply each."""
    for one in (stage,) if hasattr(stage, "power_cycle") else (stage.x, stage.z):
        one.power_cycle()


@pytest.mark.parametrize("kind", BUILT_IN["stage"])
@pytest.mark.parametrize("off", [False, True], ids=["left alone", "switched off and on"])
def test_a_stage_that_was_switched_off_does_not_count_as_unmoved(kind: str, off: bool) -> None:
    """It was left at home, 0, and counts from 0 again, wherever a hand or its weight has moved the carriage to."""
    bench, _, memory = _bench(kind)
    if off:
        _switched_off_and_on(bench.board)
    bench.stage.connect()
    at = bench.stage.status()
    assert memory.read().is_where_left(at) is not off


@pytest.mark.parametrize("kind", BUILT_IN["stage"])
def test_an_aged_lift_counts_as_raised_only_if_the_stage_has_not_moved_since(kind: str) -> None:
    """The finger may have come up since, and the carriage of a stage without current may have sunk into it."""
    bench, _, memory = _bench(kind)
    memory.touched(KnownContact("lifted", 0.0, 0.0, 25.0, 1.7e9))
    bench.stage.connect()
    found = memory.read().aged_contact(bench.stage.status())
    assert found is not None
    assert (found.kind, found.may_touch, found.aged) == ("raised", True, True)
    assert "by position only; last measured at 2023-11-1" in found.words
    _switched_off_and_on(bench.board)
    bench.stage.connect()
    for at in (bench.stage.status(), None):
        found = memory.read().aged_contact(at)
        assert found is not None
        assert (found.kind, found.may_touch, found.aged) == ("unknown", True, True)


@pytest.mark.parametrize("kind", [kind for kind in BUILT_IN["stage"] if kind != "grbl"])
def test_manual_control_does_not_trust_the_height_of_a_stage_that_was_switched_off(kind: str) -> None:
    """A board with locked homing says so by itself. A step leaves the height known."""
    bench, config, memory = _bench(kind)
    bench.stage.connect()
    session = SessionWithoutForce(config, bench.stage, bench.clock)
    with session.begun():
        session.step(DOWN, 0.5, 2.0)
        assert bench.stage.homed
    assert memory.read().is_where_left(bench.stage.status())
    _switched_off_and_on(bench.board)
    with suppress(StageReset):
        session.look()
    assert not bench.stage.homed


@pytest.mark.parametrize(
    "tables",
    [
        {"force": {"kind": "laumas"}},
        {"force": {"laumas": {"weight": "net"}}},
        {"calibration": {"force_scale": {"value": 1.1, "date": "2026-05-01", "expires": "2027-05-01"}}},
    ],
    ids=["another sensor", "another weight", "another scale"],
)
def test_a_zero_recorded_with_another_sensor_or_force_scale_is_not_used(tables: dict[str, Any]) -> None:
    """From it a touch of any force may seem none. What else is on record stays."""
    memory, other = BenchMemory(Config()), BenchMemory(Config.model_validate(tables))
    memory.left(StageStatus("Idle", 1.0, 2.0, 3.0))
    memory.record_zero(ForceZero(0.4, 0.0))
    assert memory.read().zero == ForceZero(0.4, 0.0)
    assert (other.read().zero, other.read().left_at_mm) == (None, (1.0, 2.0, 3.0))
    other.record_zero(ForceZero(0.1, 0.0))
    assert (memory.read().zero, other.read().zero) == (None, ForceZero(0.1, 0.0))


@pytest.mark.parametrize("kind", BUILT_IN["force"])
def test_the_next_command_measures_force_from_the_recorded_zero(kind: str) -> None:
    """A cell that shows 40 gwt in the air. Some are zeroed by their driver, which then begins anew."""
    config = Config.model_validate({"force": {"kind": kind}})
    clock = VirtualClock(1.7e9)
    line, gwt = virtual_line(clock, config.force), 40.0
    twin = virtual_force(clock, line, config, Load(lambda t_s: gwt * GWT_N))

    def connected() -> Sensing:
        wire = LoopbackTransport(line, clock)
        found = Sensing(config, clock, force_driver(lambda port: wire, clock, config))
        found.connect()
        return found

    sensing = connected()
    take_zero(sensing, BenchMemory(config))
    assert sensing.lasting_zero is not None
    BenchMemory(config).record_zero(sensing.lasting_zero)
    gwt = 48.0
    then = connected()
    then.zero = BenchMemory(config).read().zero
    assert then.settled().force_n / GWT_N == pytest.approx(8.0, abs=0.02), twin
