"""What one command leaves to the next: the zero of the sensor, and where the homed stage stood."""

import json
from pathlib import Path

import pytest

from rig.devices.base import StageStatus
from rig.engine.bench_memory import BenchMemory, LastKnown
from rig.engine.sensing import ForceZero
from rig.settings import RigSettings

AT = StageStatus("Idle", -3.0, -2.0, -1.5)


@pytest.fixture
def memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BenchMemory:
    monkeypatch.setenv("RIG_STATE_DIR", str(tmp_path / "deep" / "state"))
    return BenchMemory(RigSettings())


def test_of_a_bench_that_nobody_used_nothing_is_known(memory: BenchMemory) -> None:
    known = memory.read()
    assert known == LastKnown()
    assert known.zero is None
    assert not known.is_where_left(AT)


@pytest.mark.parametrize(
    ("at", "there"),
    [
        (AT, True),
        (StageStatus("Idle", -3.0029, -2.0, -1.5), True), (StageStatus("Idle", -3.0031, -2.0, -1.5), False),
        (StageStatus("Idle", -3.0, -2.0031, -1.5), False), (StageStatus("Idle", -3.0, -2.0, -1.4969), False),
        (StageStatus("Alarm", -3.0, -2.0, -1.5), False), (StageStatus("Run", -3.0, -2.0, -1.5), False),
    ],
)  # fmt: skip
def test_a_stage_stands_where_it_was_left_only_at_rest_and_to_three_micrometres(
    memory: BenchMemory, at: StageStatus, there: bool
) -> None:
    memory.left(AT)
    assert memory.read().left_at_mm == (-3.0, -2.0, -1.5)
    assert memory.read().is_where_left(at) is there


def test_as_soon_as_something_moves_its_place_is_not_known_and_the_zero_still_is(memory: BenchMemory) -> None:
    memory.zeroed(ForceZero(0.25, 0.02))
    memory.left(AT)
    memory.moves()
    known = memory.read()
    assert known.zero == ForceZero(0.25, 0.02)
    assert known.zero_unix_s > 1.7e9
    assert known.left_at_mm is None


def test_benches_are_told_apart_by_both_ports(memory: BenchMemory) -> None:
    memory.left(AT)
    for table in ("stage", "force"):
        other = BenchMemory(RigSettings.model_validate({table: {"port": "/dev/ttyX"}}))
        assert other.read() == LastKnown()
    assert BenchMemory(RigSettings()).read().is_where_left(AT)


@pytest.mark.parametrize("text", ["", "{", '{"left_at_mm": "here"}', "[]"])
def test_a_file_that_cannot_be_read_is_nothing_known(memory: BenchMemory, tmp_path: Path, text: str) -> None:
    memory.left(AT)
    (path,) = (tmp_path / "deep" / "state").iterdir()
    path.write_text(text, encoding="utf-8")
    assert memory.read() == LastKnown()
    memory.left(AT)
    assert json.loads(path.read_text(encoding="utf-8"))["left_at_mm"] == [-3.0, -2.0, -1.5]
    assert [one.name for one in path.parent.iterdir()] == [path.name], "nothing else is left there"


def test_a_folder_that_cannot_be_written_stops_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    monkeypatch.setenv("RIG_STATE_DIR", str(tmp_path / "file"))
    memory = BenchMemory(RigSettings())
    memory.left(AT)
    assert memory.read() == LastKnown()
