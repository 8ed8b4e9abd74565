"""Which of the bench's two ports could not be opened is told as data: names of ports may lie within each other."""

import io
from pathlib import Path
from typing import Any

import pytest

from rig.cli.at_the_bench import _bench_at_hand
from rig.plan.config import Config
from rig.protocol.errors import BadInputError
from rig.session import real_bench
from rig.session.real_bench import PortError, open_bench
from rig.transport import TransportError
from sim.devices.clock import VirtualClock

NO_TIME: Any = VirtualClock()


@pytest.fixture
def config() -> Config:
    """The force sensor's port is the beginning of the stage's."""
    return Config.model_validate({"stage": {"port": "/dev/no-such10"}, "force": {"port": "/dev/no-such1"}})


class Closed:
    """A stage that only has to be closed."""

    def __init__(self) -> None:
        self.closed = 0

    def close(self) -> None:
        self.closed += 1


def _missing(*_: Any) -> Any:
    raise TransportError("/dev/no-such10: no such port")


def test_a_stage_that_is_not_there_is_not_taken_for_the_sensor(config: Config) -> None:
    with pytest.raises(PortError, match="no-such10") as told:
        open_bench(config, NO_TIME, io.StringIO(), lambda request: "")
    assert told.value.device == "stage"
    with pytest.raises(TransportError, match="no-such10"):
        _bench_at_hand(config)


def test_a_sensor_that_is_not_there_is_told_as_one(
    config: Config, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("RIG_STATE_DIR", str(tmp_path))
    stage = Closed()
    monkeypatch.setattr(real_bench, "open_stage", lambda *_: stage)
    monkeypatch.setattr(real_bench, "open_force", _missing)
    with pytest.raises(PortError, match=r"^/dev/no-such10: no such port$") as told:
        open_bench(config, NO_TIME, io.StringIO(), lambda request: "")
    assert (told.value.device, stage.closed) == ("force", 1)
    with pytest.raises(BadInputError, match=r"no-such10.*; nothing was moved: .*--without-force"):
        _bench_at_hand(config)
