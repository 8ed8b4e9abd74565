"""Stages with one drive an axis: what they all do alike (`rig/devices/one_axis.py`)."""

from typing import Any

import pytest

from rig.bench.virtual import stage_opener, virtual_line, virtual_stage
from rig.devices.base import Stage, StageError
from rig.devices.make_drivers import stage_driver
from rig.devices.standa import StandaAxis
from rig.devices.tmcl import TmclAxis
from rig.devices.zaber import ZaberAxis
from rig.plan.config import Config
from rig.transport import LoopbackTransport
from sim.devices.clock import VirtualClock

AXES: dict[str, type[Any]] = {"zaber": ZaberAxis, "standa": StandaAxis, "tmcl": TmclAxis}


def _homed(kind: str, **tables: Any) -> tuple[Stage, VirtualClock]:
    config, clock = Config.model_validate({"stage": {"kind": kind}, **tables}), VirtualClock(1.7e9, 50.0)
    line = virtual_line(clock, config.stage)
    virtual_stage(clock, line, config)
    opener = stage_opener(config, line, lambda one, name: LoopbackTransport(one, clock, name))
    stage = stage_driver(opener, clock, config)
    stage.connect()
    stage.home()
    return stage, clock


@pytest.mark.parametrize("kind", AXES)
def test_a_jog_that_a_stop_overtakes_moves_nothing(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The stop arrives from another thread after the jog has looked and before it sends its move."""
    stage, clock = _homed(kind)
    stage.move_to(z_mm=-2.0, speed_mm_s=5.0)
    look = AXES[kind].look

    def overtaken(axis: Any) -> Any:
        monkeypatch.undo()
        found = look(axis)
        stage.stop()
        return found

    monkeypatch.setattr(AXES[kind], "look", overtaken)
    with pytest.raises(StageError):
        stage.jog("z", -1.0, 2.0)
    clock.wait_s(2.0)
    assert stage.status().z_mm == pytest.approx(-2.0, abs=1e-6)
    assert not stage.homed


@pytest.mark.parametrize("kind", AXES)
@pytest.mark.parametrize("axis", ["x", "z"])
@pytest.mark.parametrize(
    ("backlash_mm", "to_mm", "targets"),
    [
        (0.025, -1.0, [-0.95, -1.0]),
        (0.025, -0.02, [0.0, -0.02]),  # not beyond the top
        (0.025, -3.0, [-3.0]),
        (0.0, -1.0, [-1.0]),
    ],
    ids=["up", "up to the top", "down", "none"],
)
def test_backlash_is_taken_up_by_twice_as_much_on_the_way_up_alone(
    kind: str, axis: str, backlash_mm: float, to_mm: float, targets: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    measured = {"value": backlash_mm, "date": "2026-01-05", "expires": "2126-01-05"}
    stage, _ = _homed(kind, calibration={f"{axis}_backlash_mm": measured} if backlash_mm else {})
    stage.move_to(**{f"{axis}_mm": -2.0}, speed_mm_s=10.0)
    moving, told = AXES[kind].moving, list[float]()

    def noted(one: Any, target_mm: float, *more: Any) -> Any:
        told.append(target_mm)
        return moving(one, target_mm, *more)

    monkeypatch.setattr(AXES[kind], "moving", noted)
    stage.move_to(**{f"{axis}_mm": to_mm}, speed_mm_s=10.0)
    assert told == pytest.approx(targets)
    status = stage.status()
    assert (status.x_mm if axis == "x" else status.z_mm) == pytest.approx(to_mm, abs=0.003)
