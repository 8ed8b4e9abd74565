"""What the stages of Zaber, Standa and Trinamic do alike, on their own bytes: home, move, jog, stop, lose power."""

from collections.abc import Callable
from typing import Any

import pytest
from pydantic import ValidationError

from rig.devices.base import StageError, StageReset, StageTimeout
from rig.devices.make_drivers import stage_driver
from rig.plan.config import Config
from rig.transport import LoopbackTransport
from sim.devices.clock import VirtualClock
from sim.devices.line import SerialLine
from tests.error_codes import raises
from tests.rig import test_standa_driver, test_tmcl_driver, test_zaber_driver

BENCHES: dict[str, tuple[Callable[..., Any], str]] = {
    "zaber": (test_zaber_driver.bench_of, "chain"),
    "standa": (test_standa_driver.bench_of, "pair"),
    "tmcl": (test_tmcl_driver.bench_of, "board"),
}
every_kind = pytest.mark.parametrize("kind", BENCHES)


def _bench(kind: str, **tables: Any) -> tuple[Any, Any]:
    """A bench, homed unless that is not asked, and its devices."""
    make, devices = BENCHES[kind]
    bench = make(**tables)
    return bench, getattr(bench, devices)


OWN: dict[str, tuple[str, dict[str, Any]]] = {
    "zaber, two devices": ("zaber", {}),
    "zaber, one controller": ("zaber", {"x": {"address": 3, "axis": 2}, "z": {"address": 3, "axis": 1}}),
    "zaber, fine": (
        "zaber",
        {"x": {"address": 1, "microstep_um": 0.047625}, "z": {"address": 2, "microstep_um": 0.09525}},
    ),
    "standa, left": ("standa", {}),
    "standa, right": ("standa", {"x": {"home": "right"}, "z": {"home": "right", "step_um": 2.5, "microsteps": 8}}),
    "tmcl, one module": ("tmcl", {}),
    "tmcl, two modules": ("tmcl", {"x": {"address": 1, "motor": 0}, "z": {"address": 2, "motor": 0}}),
    "tmcl, right": ("tmcl", {"z": {"motor": 1, "home_switch": "right", "search_mode": 65}}),
    "tmcl, fine": ("tmcl", {"x": {"motor": 0, "microstep_um": 0.1}, "z": {"motor": 1, "microstep_um": 0.05}}),
    "tmcl, old units": (
        "tmcl",
        {"z": {"motor": 1, "microstep_um": 0.1}, "speed_unit": 0.0328, "acceleration_unit": 0.0022},
    ),
}


@pytest.mark.parametrize("name", OWN)
def test_it_homes_moves_and_knows_where_it_is(name: str) -> None:
    kind, own = OWN[name]
    bench, devices = _bench(kind, stage={kind: own} if own else {})
    assert bench.stage.homed
    assert kind != "standa" or (bench.stage.steps_per_mm("z") > 0) is bool(own)
    bench.stage.move_to(z_mm=-11.0013, speed_mm_s=5.0)
    bench.stage.move_to(x_mm=-3.5, speed_mm_s=5.0)
    now = bench.stage.status()
    within_mm = 2e-4 if kind == "standa" else 2e-3
    assert now.state == "Idle"
    assert (now.x_mm, now.z_mm) == pytest.approx((-3.5, -11.0013), abs=within_mm)
    x, _, z = devices.carriage_steps_at(bench.clock.monotonic_s())
    assert x / abs(bench.stage.steps_per_mm("x")) == pytest.approx(-3.5, abs=within_mm)
    assert z / abs(bench.stage.steps_per_mm("z")) == pytest.approx(-11.0013, abs=within_mm)


@every_kind
@pytest.mark.parametrize("homed", [True, False])
def test_a_jog_goes_so_far_and_stops_by_itself(kind: str, homed: bool) -> None:
    bench, _ = _bench(kind, homed=homed)
    low = bench.stage.status().z_mm
    bench.stage.jog("z", -0.5, 2.0)
    bench.clock.wait_s(0.1)
    bench.stage.jog("z", -0.5, 2.0)
    bench.clock.wait_s(2.0)
    assert bench.stage.status().z_mm - low == pytest.approx(-1.0, abs=1e-4 if kind == "standa" else 1e-6)
    bench.stage.jog("z", -5.0, 2.0)
    bench.clock.wait_s(0.2)
    bench.stage.end_jog()
    assert bench.stage.status().state == "Idle"
    assert bench.stage.homed is homed


@every_kind
def test_switched_off_and_on_it_is_no_longer_homed(kind: str) -> None:
    """Under way and at rest; what a Standa controller says under way: tests/rig/test_standa_driver.py."""
    fields: dict[str, Any] = {"expected": 800, "found": 4000} if kind == "tmcl" else {}
    if kind != "standa":
        bench, devices = _bench(kind)
        looks = bench.stage.moving(z_mm=-10.0, speed_mm_s=2.0)
        next(looks)
        devices.power_cycle()
        with raises(StageReset, "was_reset", axis="z", **fields):
            list(looks)
        assert not bench.stage.homed
    bench, devices = _bench(kind)
    devices.power_cycle()
    with raises(StageReset, "was_reset", **({"expected": 0} if kind == "tmcl" else {})):
        bench.stage.status()
    assert not bench.stage.homed


def _no_stop(kind: str, z: Any) -> None:
    """A device of z that takes every stop and goes on."""
    if kind == "zaber":
        obey = z.obey
        z.obey = lambda words: "0" if list(words) in (["stop"], ["estop"]) else obey(words)
    elif kind == "standa":
        z._end = lambda letters: None
    else:
        z.stop = lambda: None


@every_kind
def test_a_stage_that_cannot_be_stopped_says_so_within_a_second_per_axis(kind: str) -> None:
    bench, devices = _bench(kind)
    next(bench.stage.moving(z_mm=-30.0, speed_mm_s=1.0))
    _no_stop(kind, devices.z)
    asked_s = bench.clock.monotonic_s()
    with raises(StageTimeout, "still_runs", axis="z"):
        bench.stage.stop()
    assert bench.clock.monotonic_s() - asked_s < 1.3


@pytest.mark.parametrize(
    ("kind", "z_per_mm", "x_per_mm"),
    [("zaber", 500.0, -400.0), ("standa", 51200.0, -25600.0), ("tmcl", 500.0, -400.0)],
)
def test_a_calibration_replaces_the_length_of_a_microstep(kind: str, z_per_mm: float, x_per_mm: float) -> None:
    measured = {"value": z_per_mm, "date": "2026-01-01", "expires": "2027-01-01"}
    bench, devices = _bench(kind, calibration={"z_steps_per_mm": measured})
    assert bench.stage.steps_per_mm("z") == -z_per_mm
    assert bench.stage.steps_per_mm("x") == x_per_mm
    bench.stage.move_to(z_mm=-2.0, speed_mm_s=5.0)
    assert devices.z.position() == 2 * z_per_mm


REFUSED: dict[str, tuple[dict[str, Any], list[tuple[str, object]]]] = {
    "zaber": (
        {"address": 2},
        [("address", 0), ("address", 100), ("axis", 0), ("axis", 10), ("microstep_um", 0.0), ("microstep_um", 10.1),
         ("microstep_um", float("nan")), ("resolution", 0), ("resolution", 257), ("encoder", 2), ("adress", 1)],
    ),
    "standa": (
        {},
        [("step_um", 0.0), ("step_um", 100.1), ("step_um", float("nan")), ("microsteps", 3), ("microsteps", 512),
         ("home", "up"), ("steps", 1)],
    ),
    "tmcl": (
        {"motor": 1},
        [("address", 0), ("address", 256), ("motor", -1), ("motor", 6), ("microstep_um", 0.0), ("microstep_um", 10.1),
         ("microstep_um", float("nan")), ("resolution", 9), ("home_switch", "up"), ("far_switch", 1),
         ("search_mode", 0), ("home_speed_mm_s", 0.0), ("home_speed_mm_s", 21.0), ("adress", 1)],
    ),
}  # fmt: skip


@every_kind
def test_a_value_out_of_its_bounds_is_refused(kind: str) -> None:
    needed, bad = REFUSED[kind]
    for key, value in bad:
        with pytest.raises(ValidationError) as caught:
            Config.model_validate({"stage": {"kind": kind, kind: {"z": {**needed, key: value}}}})
        assert [problem["loc"] for problem in caught.value.errors()] == [("stage", kind, "z", key)], (key, value)


@pytest.mark.parametrize(
    ("kind", "axis", "told"),
    [("zaber", {"address": 2}, "same address and axis"), ("tmcl", {"motor": 1}, "same address and motor")],
)
def test_two_axes_need_two_places(kind: str, axis: dict[str, int], told: str) -> None:
    with pytest.raises(ValidationError, match=told):
        Config.model_validate({"stage": {"kind": kind, kind: {"x": axis}}})


def test_two_controllers_of_standa_need_two_ports() -> None:
    config = Config.model_validate({"stage": {"kind": "standa", "port": "/dev/a", "standa": {"x_port": "/dev/a"}}})
    clock = VirtualClock()
    with raises(StageError, "one_port_for_two", port="/dev/a"):
        stage_driver(lambda port: LoopbackTransport(SerialLine(clock, 9600), clock), clock, config)
