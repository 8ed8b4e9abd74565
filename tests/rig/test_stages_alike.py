"""What stages with one motor at a time do alike, beyond tests/contracts/stage.py: jog, stop, overtake, lose power."""

import math
import struct
from collections.abc import Callable
from contextlib import nullcontext, suppress
from copy import copy
from dataclasses import replace
from itertools import product
from types import SimpleNamespace
from typing import Any

import pytest
from pydantic import ValidationError

from rig.devices import drive_link
from rig.devices.base import (
    MoveError,
    StageAlarm,
    StageError,
    StageHeld,
    StageOverridden,
    StageReset,
    StageTimeout,
)
from rig.devices.leadshine_drive import FEEDBACK, words
from rig.devices.make_drivers import stage_driver
from rig.devices.registry import BUILT_IN, StageKind, find, own_port
from rig.plan.config import Config
from rig.transport import LoopbackTransport, TransportError
from sim.devices.clock import VirtualClock
from sim.devices.line import SerialLine
from tests.contracts.bytes import leadshine, tmcl
from tests.contracts.counted import Bench, bench_of
from tests.contracts.stage import Replies, StageBench
from tests.contracts.tables import counted_stages, stage_table
from tests.error_codes import raises
from tests.stub_bench import raising

BYTES = {kind: stage_table(kind) for kind in counted_stages()}


def _z(bench: StageBench) -> Any:
    """The axis z of a stage."""
    return bench.stage._axes["z"]  # type: ignore[attr-defined]


every_kind = pytest.mark.parametrize("kind", BYTES)
OWN_LINK = [kind for kind, device in BYTES.items() if isinstance(_z(StageBench(device)).link, drive_link.DriveLink)]
own_link = pytest.mark.parametrize("kind", OWN_LINK)


def _bench(kind: str, **tables: Any) -> tuple[Bench, Any]:
    """A bench, homed unless that is not asked, and its devices."""
    bench = bench_of(kind, **tables)
    return bench, bench.devices


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
def test_every_configuration_homes_moves_and_reports_its_position(name: str) -> None:
    kind, own = OWN[name]
    bench, devices = _bench(kind, stage={kind: own} if own else {})
    assert bench.stage.homed
    assert kind != "standa" or (bench.stage.steps_per_mm("z") > 0) is bool(own)
    configured = Config.model_validate({"stage": {"kind": kind, **({kind: own} if own else {})}}).stage
    for axis in ("x", "z"):
        assert find(StageKind, kind).steps_per_mm(configured, axis) == bench.stage.steps_per_mm(axis)
    bench.stage.move_to(z_mm=-11.0013, speed_mm_s=5.0)
    bench.stage.move_to(x_mm=-3.5, speed_mm_s=5.0)
    now = bench.stage.status()
    within_mm = 2e-4 if kind == "standa" else 2e-3
    assert now.state == "Idle"
    assert (now.x_mm, now.z_mm) == pytest.approx((-3.5, -11.0013), abs=within_mm)
    x, _, z = devices.carriage_steps_at(bench.clock.monotonic_s())
    assert x / abs(bench.stage.steps_per_mm("x")) == pytest.approx(-3.5, abs=within_mm)
    assert z / abs(bench.stage.steps_per_mm("z")) == pytest.approx(-11.0013, abs=within_mm)


NO_MOVES: list[tuple[str, dict[str, float]]] = [
    *(("set_by_hand", {"x_mm": -1.0, "y_mm": mm}) for mm in (-14.0, -16.0, 15.0, 0.0, -15.00001)),
    *(("set_by_hand", {"y_mm": mm}) for mm in (-14.0, -16.0)),
    ("not_finite", {"y_mm": math.nan}),
    ("not_one_axis", {"x_mm": -1.0, "z_mm": -1.0}),
    ("not_one_axis", {"x_mm": -1.0, "y_mm": -15.0, "z_mm": -1.0}),
    ("not_one_axis", {}),
]


@every_kind
def test_a_move_is_of_one_axis_and_none_along_the_finger(kind: str) -> None:
    """That axis has no drive; a move to where it was set by hand is none."""
    bench = StageBench(BYTES[kind], homed=True)
    for code, move in NO_MOVES:
        with raises(MoveError, code, **({"set_mm": -15.0} if code == "set_by_hand" else {})):
            bench.stage.move_to(**move, speed_mm_s=1.0)
    bench.stage.move_to(y_mm=-15.0, speed_mm_s=1.0)
    for act in (lambda: bench.stage.jog("y", 1.0, 1.0), lambda: bench.stage.steps_per_mm("y")):
        with raises(StageError, "no_drive", axis="y"):
            act()
    assert bench.wire.writes == []
    assert bench.stage.homed


@pytest.mark.parametrize(("kind", "mm_s2"), [("zaber", 61.0), ("standa", 60.0), ("tmcl", 50.0), ("leadshine", 50.0)])
def test_a_move_takes_the_time_of_its_speed_and_of_its_ramp(kind: str, mm_s2: float) -> None:
    """And is looked at when it should have ended: an arrival is noticed within 0.1 s."""
    bench, _ = _bench(kind)
    begun_s = bench.clock.monotonic_s()
    bench.stage.move_to(z_mm=-10.0, speed_mm_s=2.0)
    assert bench.clock.monotonic_s() - begun_s == pytest.approx(10 / 2 + 2 / mm_s2, abs=0.1)


@every_kind
def test_a_move_is_not_looked_at_just_before_its_end(kind: str) -> None:
    """A look costs an exchange, and the arrival is looked at anyway."""
    bench, devices = _bench(kind)
    looks = bench.stage.moving(z_mm=-0.4, speed_mm_s=4.0, look_s=0.15)  # It takes about 0.18 s.
    assert not [look for look in looks if look is not None and look.state == "Run"]
    assert not devices.z.busy


def _steps(axis: str, per_mm: float) -> dict[str, Any]:
    """A measured length of a microstep."""
    return {f"{axis}_steps_per_mm": {"value": per_mm, "date": "2026-01-01", "expires": "2027-01-01"}}


def _reports(kind: str, axis: Any, change: Callable[[int], int]) -> None:
    """Let a device report other positions than those where it is."""
    if kind == "leadshine":
        shows = axis._shown
        axis._shown = lambda: {**shows(), **dict(enumerate(words(change(axis.position())), FEEDBACK))}
        return
    name = "parameter" if kind == "tmcl" else "position"
    tell = getattr(axis, name)
    setattr(axis, name, lambda *number: change(tell(*number)) if number in ((), (1,)) else tell(*number))


FINENESS = pytest.mark.parametrize(("per_mm", "within"), [(100.0, 1), (400.0, 1), (10000.0, 25)])


@every_kind
@FINENESS
def test_an_arrival_is_within_2_5_um_or_a_microstep(kind: str, per_mm: float, within: int) -> None:
    """Short of the target and beyond it."""
    for off in (within, -within, within + 1, -within - 1):
        bench, devices = _bench(kind, calibration=_steps("z", per_mm))
        looks, z = bench.stage.moving(z_mm=-2.0, speed_mm_s=2.0), devices.z
        next(looks)
        _reports(kind, z, lambda at, z=z, off=off: at if z.busy else at + off)  # type: ignore[misc]
        if abs(off) > within:
            with raises(
                StageError,
                "not_there",
                target_mm=-2.0,
                at_mm=-2.0 - off / per_mm * (-1 if kind == "leadshine" else 1),
            ):
                list(looks)
        else:
            list(looks)
            assert bench.stage.homed


@own_link
@pytest.mark.parametrize(("to_mm", "low_mm", "high_mm"), [(-2.5, -2.5, -2.0), (-1.5, -2.0, -1.5)])
def test_a_move_that_leaves_its_way_by_more_than_an_arrival_may_is_stopped(
    kind: str, to_mm: float, low_mm: float, high_mm: float
) -> None:
    """At either end of it, upwards and downwards."""
    per_mm, within = (25600, 64) if kind == "standa" else (400, 1)
    for end_mm, away in ((low_mm, 1), (high_mm, -1)):
        for off in (within, within + 1):
            bench, devices = _bench(kind)
            bench.stage.move_to(z_mm=-2.0, speed_mm_s=5.0)
            looks, begun_s = bench.stage.moving(z_mm=to_mm, speed_mm_s=0.5), bench.clock.monotonic_s()
            shown = round(-end_mm * per_mm) + away * off

            def reported(at: int, shown: int = shown, bench: Any = bench, begun_s: float = begun_s) -> int:
                return shown if 0.7 <= bench.clock.monotonic_s() - begun_s < 0.95 else at

            _reports(kind, devices.z, reported)
            if off > within:
                with raises(StageError, "not_there", axis="z", at_mm=-shown / per_mm, target_mm=to_mm):
                    list(looks)
                bench.clock.wait_s(0.3)
                assert not devices.z.busy
            else:
                list(looks)
                assert bench.stage.homed


@every_kind
@pytest.mark.parametrize("nth", range(3))
def test_one_old_position_among_the_last_is_no_wrong_arrival(kind: str, nth: int) -> None:
    """As of a reply that came late."""
    bench, devices = _bench(kind)
    looks, z, at_rest = bench.stage.moving(z_mm=-2.0, speed_mm_s=2.0), devices.z, list[int]()
    next(looks)

    def reported(at: int) -> int:
        if not z.busy:
            at_rest.append(at)
        return at // 2 if len(at_rest) == nth + 1 and not z.busy else at

    _reports(kind, z, reported)
    list(looks)
    assert bench.stage.homed
    assert at_rest


@pytest.mark.parametrize(("kind", "least_mm_s"), [("zaber", 1 / (20 * 1.6384)), ("standa", 0.05), ("tmcl", 0.05)])
def test_the_slowest_speed_is_one_of_the_device(kind: str, least_mm_s: float) -> None:
    bench, devices = _bench(kind, calibration=_steps("z", 20.0))
    with raises(MoveError, "too_slow", least_mm_s=least_mm_s):
        bench.stage.move_to(z_mm=-0.1, speed_mm_s=0.99 * least_mm_s)
    assert not bench.sent
    bench.stage.move_to(z_mm=-0.1, speed_mm_s=least_mm_s)
    assert devices.z.position() == 2


def _accelerates(kind: str, axis: Any, number: int) -> None:
    if kind == "zaber":
        axis.settings["accel"] = number
    elif kind == "tmcl":
        axis.parameters[5] = number
    else:
        speed = list(struct.unpack("<IBHHIBB9x", axis.settings["mov"]))
        speed[2:4] = number, number
        axis.settings["mov"] = struct.pack("<IBHHIBB9x", *speed)


OTHER_UNITS: dict[str, Any] = {"speed_unit": 0.0328, "acceleration_unit": 0.0022}


@pytest.mark.parametrize(
    ("kind", "own", "least"),
    [
        ("zaber", {}, 4),
        ("zaber", {"acceleration_unit": 0.0022}, 44),
        ("standa", {"z": {"step_um": 2.5}}, 20000),
        ("tmcl", {}, 20000),
        ("tmcl", OTHER_UNITS, 44),
    ],
)
def test_z_needs_50_mm_s2_in_the_units_of_the_device(kind: str, own: dict[str, Any], least: int) -> None:
    bench, devices = _bench(kind, homed=False, stage={kind: own} if own else {})
    _accelerates(kind, devices.z, least)
    assert bench.stage.connect()
    _accelerates(kind, devices.z, least - 1)
    with raises(StageError, "not_as_configured", axis="z", found=least - 1):
        bench.stage.connect()


@pytest.mark.parametrize("kind", ["zaber", "standa"])
def test_an_acceleration_of_0_is_as_fast_as_a_zaber_axis_can_and_none_of_a_standa_axis(kind: str) -> None:
    bench, devices = _bench(kind, homed=False)
    _accelerates(kind, devices.z, 0)
    with raises(StageError, "not_as_configured", axis="z", found=0) if kind == "standa" else nullcontext():
        bench.stage.connect()


# --- bounds in time, on bytes ---


def _staying(kind: str, state: str, *, coarse: float = 1.0, homed: bool = False) -> StageBench:
    """A stage that stays in a state whatever it is told; coarse: factor of every wait, for less polls."""
    device = BYTES[kind]
    stay = {asked: said for asked, said in (device.usual | device.states[state]).items() if isinstance(said, tuple)}
    bench = StageBench(device, homed=homed)
    bench.wire.device = replace(
        device,
        states={**device.states, state: {**device.states[state], **{asked: said[0] for asked, said in stay.items()}}},
    )
    wait_s = bench.clock.wait_s
    bench.clock.wait_s = lambda seconds: wait_s(coarse * seconds)  # type: ignore[method-assign]
    return bench


@pytest.mark.parametrize("kind", [kind for kind, device in BYTES.items() if device.search])
@pytest.mark.parametrize(
    ("up_mm", "switch", "most_mm", "v_mm_s"),
    [
        (0.08, "", 1.0, 2.0),
        (0.0, "far", 1.0, 2.0),
        (0.4, "", 10.0, 20.0),
        (0.0, "home", 10.0, 20.0),
    ],
)
def test_a_search_may_go_a_millimeter_away_from_home_and_ten_after_it_went_towards_it(
    kind: str, up_mm: float, switch: str, most_mm: float, v_mm_s: float
) -> None:
    """First upwards and then downwards: by 0.1 mm upwards, or by the switch, it has begun."""
    bench, search = _staying(kind, "z homes"), BYTES[kind].search
    assert search is not None
    write, clock = bench.wire.write, bench.clock
    start_mm = bench.stage.status().z_mm
    begun_s, turns_s = clock.monotonic_s(), up_mm / v_mm_s + 1e-6

    def writing(data: bytes, port: bytes = b"") -> None:
        t_s = clock.monotonic_s() - begun_s
        up = t_s <= turns_s
        z_mm = start_mm + v_mm_s * (t_s if up else 2 * turns_s - t_s)
        if bench.wire.state == "z homes":
            bench.wire.instead.update(search(z_mm, v_mm_s if up else -v_mm_s, switch))
        write(data, port)

    bench.wire.write = writing  # type: ignore[method-assign]
    with raises(StageError, "homes_the_wrong_way", axis="z"):
        bench.stage.home()
    assert clock.monotonic_s() - begun_s == pytest.approx((up_mm + most_mm) / v_mm_s + 0.015, abs=0.02)
    assert bench.wire.asked[-1] == OWN_STOPS.get(kind, BYTES[kind].stop)[-1]
    assert not bench.stage.homed


@pytest.mark.parametrize(
    "name", ["tmcl, one module", "tmcl, right", "tmcl, old units", "standa, left", "standa, right"]
)
@pytest.mark.parametrize(
    ("start_mm", "far"), [(-5.0, False), (-0.2, False), (-5.0, True)], ids=["", "near home", "at the other switch"]
)
def test_a_search_the_wrong_way_is_stopped_after_a_millimeter_a_look_and_the_brakes(
    name: str, start_mm: float, far: bool
) -> None:
    kind, own = OWN[name]
    bench, devices = _bench(kind, stage={kind: own} if own else {})
    bench.stage.move_to(z_mm=start_mm, speed_mm_s=5.0)
    z, per_mm = devices.z, abs(bench.stage.steps_per_mm("z"))
    go, parameter = z._go, getattr(z, "parameter", None)
    z._go = lambda legs, up, down: go([(z._lowest, 5.0 * per_mm)], up, down)
    if far and kind == "standa":
        z.inputs = 2 if z._sign > 0 else 1
    elif far:
        z.parameter = lambda number: 1 if number == z._far else parameter(number)
    before = z.carriage_at(bench.clock.monotonic_s())
    with raises(StageError, "homes_the_wrong_way", axis="z"):
        bench.stage.home()
    bench.clock.wait_s(1.0)
    most_mm = 1.3 if kind == "standa" else 1.7
    assert 1.0 < (before - z.carriage_at(bench.clock.monotonic_s())) / per_mm < most_mm
    assert not bench.stage.homed


WAITS: dict[str, Replies] = {
    "tmcl": tmcl.axis("z", most=2000),
    "leadshine": {**leadshine.UNHOMED_X, **leadshine.status(leadshine.Z, leadshine.HOMED)},
}
"""A drive that stands at 0 after the command to home: it was just switched on, or is homed."""


@pytest.mark.parametrize("late_s", [0.97, 1.03, 1e6])
@pytest.mark.parametrize("kind", WAITS)
def test_a_search_that_does_not_begin_within_a_second_is_no_homing(kind: str, late_s: float) -> None:
    device = BYTES[kind]
    said = {**device.usual, **device.states["z is set"]} if kind == "leadshine" else device.usual
    trigger = next(asked for asked, reply in said.items() if isinstance(reply, tuple) and reply[1] == "z homes")
    states = {**device.states, "z waits": WAITS[kind]}
    bench = StageBench(replace(device, states=states))
    bench.wire.instead[trigger] = said[trigger][0], "z waits"  # type: ignore[assignment, index]
    looks = bench.stage.homing()
    next(looks)
    sent_s = next(t_s for t_s, frames in bench.wire.writes if trigger in frames)
    bench.clock.call_at(sent_s + late_s, lambda: setattr(bench.wire, "state", "z homes"))
    with nullcontext() if late_s < 1.0 else raises(StageError, "did_not_home", axis="z"):
        list(looks)
    assert bench.stage.homed is (late_s < 1.0)
    assert bench.stage.homed or bench.clock.monotonic_s() - sent_s < 1.1


OWN_STOPS = {"standa": [b"z stop", b"x stop"], "tmcl": [b"z MST 0", b"x MST 0"]}
"""Where a stop of the table is one of z alone."""
REPEATED = leadshine.said("01 06 60 02 00 40")
"""Stop of the other Leadshine drive, which is confirmed."""


@every_kind
def test_homing_that_fails_sends_a_stop_to_both_axes(kind: str) -> None:
    """A wrong address may have sent the other one home instead."""
    bench = _staying(kind, "z homes")
    looks = bench.stage.homing()
    next(looks)
    bench.wire.silent = True
    with raises(StageTimeout, "no_reply"):
        list(looks)
    asked = [one for one in bench.wire.asked if kind != "leadshine" or one != REPEATED]
    stops = OWN_STOPS.get(kind, [*BYTES[kind].stop])
    assert asked[-len(stops) :] == stops
    assert (bench.wire.asked[-1] == REPEATED) is (kind == "leadshine")
    assert not bench.stage.homed


@every_kind
@pytest.mark.parametrize("name", ["z", "x"])
@pytest.mark.parametrize("error", [StageAlarm("", "a fault at which the axis moves on"), TransportError("noise")])
def test_homing_that_fails_leaves_no_axis_in_motion(kind: str, name: str, error: StageError | TransportError) -> None:
    """Not even where a stop does not end a search."""
    bench = bench_of(kind, homed=False)
    axis: Any = bench.stage._axes[name]  # type: ignore[attr-defined]
    looks = bench.stage.homing()
    while not getattr(bench.devices, name).busy:
        next(looks)
    axis.refuse = raising(error)
    with pytest.raises(type(error)):
        list(looks)
    bench.clock.wait_s(0.3)
    assert bench.stands()
    assert not bench.stage.homed


@every_kind
@pytest.mark.parametrize("name", ["z", "x"])
def test_devices_that_are_switched_off_while_they_home_are_not_home(kind: str, name: str) -> None:
    """They count from 0 where they stand."""
    bench = bench_of(kind, homed=False)
    looks = bench.stage.homing()
    while not getattr(bench.devices, name).busy:
        next(looks)
    next(looks)
    bench.devices.power_cycle()
    with raises(StageError, "not_over" if kind == "leadshine" else "did_not_home", axis=name):
        list(looks)
    assert not bench.stage.homed


@every_kind
@pytest.mark.parametrize(
    ("verb", "least_s", "coarse"), [("stop", 1.0, 1.0), ("halt", 2.0, 1.0), ("home", 180.0, 100.0)]
)
def test_a_stage_that_never_comes_to_rest_says_so_in_time(
    kind: str, verb: str, least_s: float, coarse: float
) -> None:
    """A stop is confirmed for 1 s, a halt for 2 s, and homing has three minutes."""
    homes = verb == "home"
    bench = _staying(kind, "z homes" if homes else "moving", coarse=coarse, homed=not homes)
    if not homes:
        bench.under_way()
    begun_s = bench.clock.monotonic_s()
    with raises(StageTimeout, "not_over" if homes else "still_runs", axis="z", timeout_s=least_s):
        getattr(bench.stage, verb)()
    assert least_s <= bench.clock.monotonic_s() - begun_s < least_s + 0.1 * coarse
    assert bench.stage.homed is (verb == "halt")


@every_kind
@pytest.mark.parametrize(("verb", "lost_s"), [("stop", 0.5), ("halt", 1.5), ("stop", 10.0), ("halt", 10.0)])
def test_a_stop_outlasts_a_port_that_is_silent_for_a_while(kind: str, verb: str, lost_s: float) -> None:
    """A port that stays silent is an error."""
    bench = StageBench(BYTES[kind], homed=True)
    bench.under_way()
    bench.wire.silent = True
    bench.clock.call_at(bench.clock.monotonic_s() + lost_s, lambda: setattr(bench.wire, "silent", False))
    with nullcontext() if lost_s < 2.0 else raises(StageTimeout, "no_reply"):
        getattr(bench.stage, verb)()
    assert bench.wire.state == ("rested" if lost_s < 2.0 else "moving")


def _leading_to(kind: str, *states: str) -> set[bytes]:
    """The commands of a table upon which one of these states begins."""
    rows = [BYTES[kind].usual, *BYTES[kind].states.values()]
    return {asked for row in rows for asked, said in row.items() if isinstance(said, tuple) and said[1] in states}


def _starts(kind: str) -> set[bytes]:
    """Commands that begin a search for home, or call the place where an axis stands home."""
    return _leading_to(kind, "z homes", "x homes") | {b"z zero", b"x zero"}


def _overtaken(bench: StageBench, kind: str, nth: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stop arrives from another thread after look number nth, and what was asked until then is forgotten."""
    axis_class = type(_z(bench))
    look, left = axis_class.look, [nth]

    def overtaken(axis: Any) -> Any:
        found = look(axis)
        left[0] -= 1
        if left[0] == -1:
            state = bench.wire.state
            bench.stage.stop()
            bench.wire.state = state if state in ("new", "home") else "rested"
            bench.wire.forget()
        return found

    monkeypatch.setattr(axis_class, "look", overtaken)


@every_kind
@pytest.mark.parametrize("nth", range(8))
def test_a_stop_that_overtakes_homing_starts_nothing(kind: str, nth: int, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = StageBench(BYTES[kind])
    _overtaken(bench, kind, nth, monkeypatch)
    with raises(StageError, "stopped") if kind == "tmcl" and nth < 7 else suppress(StageError):
        bench.stage.home()
    assert not bench.stage.homed
    assert not _starts(kind) & {*bench.wire.asked}


@every_kind
def test_a_stop_at_the_very_end_of_homing_leaves_the_stage_untrusted(kind: str) -> None:
    bench = StageBench(BYTES[kind])
    x: Any = bench.stage._axes["x"]  # type: ignore[attr-defined]
    finish = x.finish_homing
    x.finish_homing = lambda: (finish(), bench.stage.stop())
    bench.stage.home()
    assert not bench.stage.homed


@every_kind
def test_a_motion_that_an_earlier_program_left_is_ended_before_homing_begins(kind: str) -> None:
    bench = StageBench(BYTES[kind])
    bench.wire.state = "moving"
    with suppress(StageError):
        bench.stage.home()
    asked = bench.wire.asked
    assert bench.device.halt in asked
    assert not _starts(kind) & {*asked[: asked.index(bench.device.halt)]}
    assert _starts(kind) & {*asked}


@every_kind
@pytest.mark.parametrize(
    ("verb", "nth"), [*(("move", nth) for nth in range(5)), *product(["jog", "jog unhomed"], range(1))]
)
def test_a_stop_that_overtakes_a_move_moves_nothing(
    kind: str, verb: str, nth: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = StageBench(BYTES[kind], homed=verb != "jog unhomed")
    _overtaken(bench, kind, nth, monkeypatch)
    with raises(StageError, "stopped", axis="z"):
        bench.move() if verb == "move" else bench.stage.jog("z", -0.1, 1.0)
    assert not bench.stage.homed
    moves = _leading_to(kind, "moving", "jogs")
    assert not {*bench.wire.asked} & moves
    if verb == "move":
        return
    free = StageBench(BYTES[kind], homed=verb == "jog")
    free.stage.jog("z", -0.1, 1.0)
    assert {*free.wire.asked} & moves, (
        f"tests/contracts/bytes/{kind}.py: no command of a jog leads to 'moving' or 'jogs'"
    )


# --- one thread at a time ---


class HangingLock:
    """A lock that another thread never gives up."""

    def __init__(self, waited_s: list[float]) -> None:
        self._waited_s = waited_s

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        self._waited_s.append(timeout)
        return False


@own_link
def test_a_command_waits_for_another_thread_but_not_for_one_that_hangs(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For the time of two replies; then it goes out all the same."""
    waited_s = list[float]()
    monkeypatch.setattr(drive_link, "threading", SimpleNamespace(Lock=lambda: HangingLock(waited_s)))
    bench, _ = _bench(kind)
    bench.stage.move_to(z_mm=-1.0, speed_mm_s=2.0)
    assert set(waited_s) == {0.4}


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
    for verb in (
        lambda stage: stage.status(),
        lambda stage: stage.move_to(z_mm=-1.0, speed_mm_s=5.0),
        lambda stage: stage.jog("z", -0.5, 2.0),
    ):
        bench, devices = _bench(kind)
        devices.power_cycle()
        with raises(StageReset, "was_reset", **({"expected": 0} if kind == "tmcl" else {})):
            verb(bench.stage)
        assert not devices.z.busy
        assert not bench.stage.homed


@every_kind
def test_a_status_says_whether_the_devices_count_from_home(kind: str) -> None:
    """Also where the program does not trust the position, since another one may have homed them."""
    bench, devices = _bench(kind)
    assert bench.stage.status().referenced
    bench.stage.connect()
    assert bench.stage.status().referenced
    devices.power_cycle()
    assert not bench.stage.status().referenced
    bench.stage.home()
    assert bench.stage.status().referenced


FAULTS: dict[str, Callable[[Any], object]] = {
    "leadshine": lambda z: z.fault(0xE0),
    "zaber": lambda z: z.fail("FH"),
    "standa": lambda z: z.fail(0x200, lasting=True),
    "tmcl": lambda z: z.fail(2),
}
"""How a twin fails so that it lasts, where that is not fail() with the alarm of the byte table."""


def _fails(kind: str, axis: Any) -> None:
    FAULTS.get(kind, lambda z: z.fail(BYTES[kind].alarm))(axis)


@every_kind
@pytest.mark.parametrize("homed", [True, False])
@pytest.mark.parametrize("name", ["z", "x"])
def test_a_fault_is_refused_before_a_jog(kind: str, homed: bool, name: Any) -> None:
    bench, devices = _bench(kind, homed=homed)
    _fails(kind, getattr(devices, name))
    with raises(StageAlarm, "alarm", axis=name):
        bench.stage.jog(name, -0.5, 2.0)
    assert not getattr(devices, name).busy
    assert not bench.stage.homed


ELSEWHERE: list[tuple[str, bool, Callable[[Any], object], type[StageError]]] = [
    ("zaber", True, lambda z: z.warn("WM"), StageAlarm),
    ("zaber", False, lambda z: z.warn("WM"), StageAlarm),
    ("tmcl", True, lambda z: z.pressed.add(10), StageAlarm),
    ("standa", True, lambda z: setattr(z, "inputs", 1), StageAlarm),
    ("standa", True, lambda z: setattr(z, "inputs", 8), StageHeld),
    ("standa", False, lambda z: setattr(z, "inputs", 8), StageHeld),
]
"""What shows that an axis is held or not where it is counted; a switch does only where the position is trusted."""


@pytest.mark.parametrize(("kind", "homed", "happens", "error"), ELSEWHERE)
def test_an_axis_that_is_elsewhere_or_held_does_not_jog(
    kind: str, homed: bool, happens: Callable[[Any], object], error: type[StageError]
) -> None:
    bench, devices = _bench(kind, homed=homed)
    happens(devices.z)
    with raises(error, "held" if error is StageHeld else "alarm"):
        bench.stage.jog("z", -0.5, 2.0)
    assert not devices.z.busy


@every_kind
@pytest.mark.parametrize("name", ["z", "x"])
def test_a_fault_ends_homing_and_its_error_says_how_to_clear_it(kind: str, name: str) -> None:
    """No command of this program does."""
    bench, devices = _bench(kind, homed=False)
    axis = getattr(devices, name)
    with raises(StageAlarm, "alarm", axis=name, remedy="switch its controller off and on"):
        for _ in bench.stage.homing():
            if axis.busy:
                _fails(kind, axis)
    assert not bench.stage.homed


@pytest.mark.parametrize("kind", [kind for kind in OWN_LINK if kind in FAULTS])
def test_a_fault_that_lasts_is_not_unlocked(kind: str) -> None:
    bench, devices = _bench(kind)
    _fails(kind, devices.z)
    with raises(StageAlarm, "alarm", axis="z"):
        bench.stage.unlock()
    with raises(StageAlarm, "alarm", axis="z"):
        bench.stage.home()


@pytest.mark.parametrize(
    ("kind", "z_per_mm", "x_per_mm"),
    [
        ("zaber", 500.0, -400.0),
        ("standa", 51200.0, -25600.0),
        ("tmcl", 500.0, -400.0),
    ],
)
def test_a_calibration_replaces_the_length_of_a_microstep(kind: str, z_per_mm: float, x_per_mm: float) -> None:
    measured = {"value": z_per_mm, "date": "2026-01-01", "expires": "2027-01-01"}
    bench, devices = _bench(kind, calibration={"z_steps_per_mm": measured})
    assert bench.stage.steps_per_mm("z") == -z_per_mm
    assert bench.stage.steps_per_mm("x") == x_per_mm
    bench.stage.move_to(z_mm=-2.0, speed_mm_s=5.0)
    assert devices.z.position() == 2 * z_per_mm


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


def test_a_port_that_does_not_open_leaves_none_of_the_others_open() -> None:
    config, clock = Config.model_validate({"stage": {"kind": "standa"}}), VirtualClock()
    line, closed = SerialLine(clock, 9600), list[str]()

    def opened(port: str) -> LoopbackTransport:
        if port != config.stage.port:
            raise TransportError("no such port")
        wire = LoopbackTransport(line, clock, port)
        wire.close = lambda: closed.append(port)  # type: ignore[method-assign]
        return wire

    with pytest.raises(TransportError):
        stage_driver(opened, clock, config)
    assert closed == [config.stage.port]


def _moved_then_halted(bench: Bench) -> None:
    looks = bench.stage.moving(z_mm=-12.0, speed_mm_s=2.0)
    next(looks)
    bench.devices.power_cycle()
    bench.stage.halt()


def _jogged_then_halted(bench: Bench) -> None:
    bench.stage.jog("z", -3.0, 2.0)
    bench.clock.wait_s(0.1)
    bench.devices.power_cycle()
    bench.stage.end_jog()


def _moved_at_the_speed_of_power_on(bench: Bench) -> None:
    looks = bench.stage.moving(z_mm=-12.0, speed_mm_s=10.0)
    next(looks)
    bench.devices.power_cycle()
    with pytest.raises((StageReset, StageOverridden)):
        list(looks)
    bench.stage.halt()


def _moved_to_0(bench: Bench) -> None:
    """The target is the count at power-on; x is on another supply."""
    looks = bench.stage.moving(z_mm=0.0, speed_mm_s=2.0)
    next(looks)
    bench.devices.z.power_cycle()
    list(looks)


def _all_moved_to_0(bench: Bench) -> None:
    looks = bench.stage.moving(z_mm=0.0, speed_mm_s=2.0)
    next(looks)
    bench.devices.power_cycle()
    list(looks)


OFF_UNDER_WAY = [
    _moved_then_halted,
    _jogged_then_halted,
    _moved_at_the_speed_of_power_on,
    _moved_to_0,
    _all_moved_to_0,
]


@every_kind
@pytest.mark.parametrize("act", OFF_UNDER_WAY)
def test_devices_that_were_switched_off_under_way_are_not_trusted(kind: str, act: Callable[[Bench], None]) -> None:
    """They count from 0 where they stand; a halt may come before any poll, as after a force."""
    bench = bench_of(kind)
    bench.stage.move_to(z_mm=-5.0, speed_mm_s=5.0)
    with suppress(StageError):
        act(bench)
    with raises(StageReset, "was_reset") if bench.stage.homed else nullcontext():
        assert not bench.stage.status().referenced
    assert not bench.stage.homed
    bench.stage.home()
    assert bench.stage.status().referenced


def test_a_target_that_another_program_left_in_a_module_does_not_start_when_homing_arms_it() -> None:
    """Not even while the replies of the module are lost."""
    bench = bench_of("tmcl", homed=False)
    z, line = bench.devices.z, bench.lines[0]
    z.parameters[4] = 0
    z.move_to(z.position() + 8000)
    start, write = z.position(), line.host_write

    def writing(data: bytes) -> None:
        write(data)
        if data[1:3] == b"\x05\x04" and any(data[4:8]):  # The speed is set.
            line.device_write = lambda data: None  # type: ignore[method-assign]

    line.host_write = writing  # type: ignore[method-assign]
    with pytest.raises(StageTimeout):
        bench.stage.home()
    assert z.position() == start


TWO_PORTS = [kind for kind in BUILT_IN["stage"] if find(StageKind, kind).ports is not own_port]


@pytest.mark.parametrize("kind", TWO_PORTS)
@pytest.mark.parametrize("dead", ["x", "z"])
@pytest.mark.parametrize("how", ["cut", "silent"])
@pytest.mark.parametrize("verb", ["stop", "halt", "end_jog"])
@pytest.mark.parametrize("jogs", [True, False])
def test_a_dead_port_keeps_no_stop_from_the_other_axis(kind: str, dead: str, how: str, verb: str, jogs: bool) -> None:
    """It stops within the time of its own ramp, whatever the dead one takes."""
    bench = bench_of(kind)
    x, z = (bench.stage._axes[name] for name in ("x", "z"))  # type: ignore[attr-defined]
    if x.link is z.link:  # The twin has both drives on one line.
        x.link = copy(z.link)
        x.link._transport = copy(z.link._transport)
    moves: Any = "z" if dead == "x" else "x"
    if jogs:
        bench.stage.jog(moves, -8.0, 2.0)
        bench.clock.wait_s(0.1)
    else:
        next(bench.stage.moving(**{f"{moves}_mm": -8.0}, speed_mm_s=2.0))
    axis, link = getattr(bench.devices, moves), bench.stage._axes[dead].link  # type: ignore[attr-defined]
    assert axis.busy
    if how == "cut":
        link._transport.write = raising(TransportError("cut"))
    else:
        link._transport.write = lambda data: None
    stopped_s = list[float]()

    def polled() -> None:
        if axis.busy:
            bench.clock.call_at(bench.clock.monotonic_s() + 0.01, polled)
        else:
            stopped_s.append(bench.clock.monotonic_s())

    begun_s = bench.clock.monotonic_s()
    polled()
    with pytest.raises((StageError, TransportError)):
        getattr(bench.stage, verb)()
    bench.clock.wait_s(0.3)
    assert stopped_s[0] - begun_s < 0.3
    assert bench.stage.homed is (verb != "stop")


@every_kind
def test_a_port_that_fails_under_way_costs_the_trust_in_the_position(kind: str) -> None:
    bench = StageBench(BYTES[kind], homed=True)
    looks = bench.under_way()
    bench.wire.cut = True
    with pytest.raises(TransportError):
        list(looks)
    assert not bench.stage.homed


@pytest.mark.parametrize("kind", ["zaber", "standa"])
def test_a_halt_that_the_controller_confirmed_is_not_sent_again_after_a_garbled_poll(kind: str) -> None:
    """A second one stops a Zaber device harder, so that it may lose steps."""
    bench = StageBench(BYTES[kind], homed=True)
    bench.under_way()
    hear, polls = bench.wire._hear, list[bytes]()

    def garbling(frame: bytes, port: bytes) -> None:
        polls.append(frame)
        bench.wire.mangled = (lambda reply: reply[:-3] + b"zzz") if len(polls) == 2 else (lambda reply: reply)
        hear(frame, port)

    bench.wire._hear = garbling  # type: ignore[method-assign]
    bench.stage.halt()
    assert bench.wire.asked.count(BYTES[kind].halt) == 1
    assert bench.stage.homed


INTERRUPTED: dict[str, Callable[[Any], object]] = {
    "zaber": lambda z: z._warnings.add("NI"),
    "standa": lambda z: setattr(z, "_command", 2),
}
"""Another program commands z."""


@pytest.mark.parametrize("kind", INTERRUPTED)
def test_a_move_that_another_program_interrupts_is_halted_by_its_caller_and_can_be_lifted(kind: str) -> None:
    """A stop at full speed would cost the position, and with it the lift of a finger that is pressed."""
    bench = bench_of(kind)
    going = bench.stage.moving(z_mm=-30.0, speed_mm_s=8.0)
    for _ in range(6):
        next(going)
    INTERRUPTED[kind](bench.devices.z)
    bench.sent.clear()
    with pytest.raises(StageOverridden):
        for _ in going:
            pass
    assert not [data for _, _, data in bench.sent if b"stop" in data or b"sstp" in data]
    bench.stage.halt()
    assert bench.stage.status().state == "Idle"
    assert bench.stage.homed
    bench.stage.move_to(z_mm=-1.0, speed_mm_s=5.0)
    assert bench.stage.status().z_mm == pytest.approx(-1.0, abs=0.01)
