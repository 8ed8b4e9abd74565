"""Every registered stage on its virtual twin: what the driver reports is where the carriage is."""

from typing import Any

import pytest

from rig.devices.base import StageError
from rig.devices.registry import BUILT_IN
from tests.contracts.counted import Bench, bench_of
from tests.error_codes import raises

every_kind = pytest.mark.parametrize("kind", BUILT_IN["stage"])
NEAR_MM = 0.003
"""Half a step, and what a board prints."""


def carriage_mm(bench: Bench) -> tuple[float, float]:
    """Where the carriage is, x and z."""
    x, _, z = bench.carriage_steps()
    per_mm = (abs(bench.stage.steps_per_mm(axis)) for axis in ("x", "z"))
    return tuple(steps / one for steps, one in zip((x, z), per_mm, strict=True))  # type: ignore[return-value]


def reported_mm(bench: Bench) -> tuple[float, float]:
    """Where the stage says that it is."""
    now = bench.stage.status()
    return now.x_mm, now.z_mm


@every_kind
def test_a_stage_homes_and_moves_to_where_it_reports(kind: str) -> None:
    bench = bench_of(kind)
    for move in ({"z_mm": -11.0}, {"x_mm": -3.5}, {"z_mm": -10.97}, {"x_mm": -2.5}):
        bench.stage.move_to(**move, speed_mm_s=5.0)
        assert bench.stage.homed
        assert bench.stage.status().state == "Idle"
        assert all(getattr(bench.stage.status(), name) == pytest.approx(mm, abs=NEAR_MM) for name, mm in move.items())
        assert reported_mm(bench) == pytest.approx(carriage_mm(bench), abs=NEAR_MM)


@every_kind
@pytest.mark.parametrize("axis", ["x", "z"])
@pytest.mark.parametrize("by_mm", [-0.5, 0.3])
def test_a_jog_at_an_unknown_position_goes_so_far_and_stops_by_itself(kind: str, axis: Any, by_mm: float) -> None:
    """Whatever the carriage's height: each begins at rest."""
    bench = bench_of(kind, homed=False)
    bench.stage.allow_unhomed_jogs()
    number, start_mm = ("x", "z").index(axis), carriage_mm(bench)
    if axis == "x" and by_mm > 0:
        bench.stage.jog("x", -1.0, 2.0)
        bench.clock.wait_s(2.0)
        start_mm = carriage_mm(bench)
    bench.stage.status()
    bench.stage.jog(axis, by_mm, 2.0)
    bench.clock.wait_s(0.05)
    assert bench.stage.status().state in ("Run", "Jog")
    with pytest.raises(StageError) as caught:
        bench.stage.jog(axis, by_mm, 2.0)
    assert caught.value.code in ("overridden", "line_refused", "not_idle"), repr(caught.value)
    bench.clock.wait_s(1.0)
    gone_mm = [now - before for now, before in zip(carriage_mm(bench), start_mm, strict=True)]
    assert gone_mm[number] == pytest.approx(by_mm, abs=NEAR_MM)
    assert gone_mm[1 - number] == 0.0
    assert bench.stage.status().state == "Idle"
    assert not bench.stage.homed


@every_kind
def test_a_jog_that_is_ended_stops_on_its_way(kind: str) -> None:
    bench = bench_of(kind, homed=False)
    bench.stage.allow_unhomed_jogs()
    _, start_mm = carriage_mm(bench)
    bench.stage.status()
    bench.stage.jog("z", -5.0, 2.0)
    bench.clock.wait_s(0.3)
    bench.stage.end_jog()
    assert bench.stands()
    assert -1.5 < carriage_mm(bench)[1] - start_mm < -0.3


@every_kind
@pytest.mark.parametrize("end", ["halt", "stop"])
def test_a_move_that_is_ended_stands_at_once(kind: str, end: str) -> None:
    """A halt keeps the position; a stop loses it, and homing finds it again."""
    bench = bench_of(kind)
    looks = bench.stage.moving(z_mm=-20.0, speed_mm_s=5.0)
    for _ in range(3):
        next(looks)
    getattr(bench.stage, end)()
    bench.clock.wait_s(0.1)
    assert bench.stands()
    assert bench.stage.homed is (end == "halt")
    if end == "stop":
        with raises(StageError, "needs_reset" if kind == "grbl" else "not_homed"):
            bench.stage.move_to(z_mm=-1.5, speed_mm_s=5.0)
        bench.stage.home()
    bench.stage.move_to(z_mm=-1.5, speed_mm_s=5.0)
    assert carriage_mm(bench)[1] == pytest.approx(-1.5, abs=NEAR_MM)
