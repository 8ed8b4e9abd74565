"""Which of the bench's two ports could not be opened is told as data: names of ports may lie within each other."""

import io
from pathlib import Path
from typing import Any

import pytest

from rig.bench import real
from rig.bench.real import PortError, open_bench
from rig.cli.bench import _opened_bench
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.transport import TransportError
from sim.devices.clock import VirtualClock
from tests.error_codes import raises

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
    raise TransportError("/dev/no-such10: no such port", "no_port")


def test_a_missing_stage_port_is_reported_as_the_stage(config: Config) -> None:
    with raises(PortError, "no_port", port="/dev/no-such10") as caught:
        open_bench(config, NO_TIME, io.StringIO(), lambda request: "")
    assert caught.value.device == "stage"
    with raises(TransportError, "no_port", port="/dev/no-such10"):
        _opened_bench(config)


def test_a_missing_sensor_port_is_reported_as_the_sensor(
    config: Config, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("RIG_STATE_DIR", str(tmp_path))
    stage = Closed()
    monkeypatch.setattr(real, "open_stage", lambda *_: stage)
    monkeypatch.setattr(real, "open_force", _missing)
    with raises(PortError, "no_port", port="/dev/no-such10") as caught:
        open_bench(config, NO_TIME, io.StringIO(), lambda request: "")
    assert caught.value.device == "force"
    assert stage.closed == 1
    with raises(BadInputError, "not_felt", port="/dev/no-such10"):
        _opened_bench(config)
