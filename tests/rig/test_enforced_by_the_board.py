"""What a GRBL board enforces itself: a floor and a highest speed; and that an `ok` alone is no homing."""

import pytest

from rig.devices.base import StageError, StageRejected
from rig.devices.grbl import GrblStage
from rig.devices.grbl_link import enforced_settings, expected_settings
from rig.settings import RigSettings, StageBounds
from rig.transport import LoopbackTransport
from sim.devices import SerialLine, VirtualGrbl
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.rig.test_corrupted_grbl_lines import _instead

BOUNDS = RigSettings().bounds
HOME_STEPS = (-400, -400, -400)


class Bench:
    """A board as it is bought, and a driver with the default bounds; one line can be changed on its way."""

    def __init__(self, **settings: float) -> None:
        self.clock = VirtualClock()
        self.line = SerialLine(self.clock, 115200)
        told = {int(number.removeprefix("_")): value for number, value in settings.items()}
        self.board = VirtualGrbl(self.clock, self.line, settings=told)
        self.name, self.written, self.instead = "stage", list[bytes](), dict[bytes, bytes]()
        self._wire = LoopbackTransport(self.line, self.clock, "stage")
        self.stage = GrblStage(self, self.clock, expected=expected_settings(RigSettings()), bounds=BOUNDS)

    def write(self, data: bytes) -> None:
        self.written.append(data)
        self._wire.write(self.instead.pop(data, data))

    def read(self, timeout_s: float) -> bytes:
        return self._wire.read(timeout_s)

    def close(self) -> None:
        self._wire.close()

    def stored(self) -> list[bytes]:
        """The settings that were written."""
        return [line for line in self.written if line.startswith(b"$") and b"=" in line]

    def settings(self) -> list[str]:
        return self.board._settings.listing()


def test_the_lowest_z_of_the_stage_allows_skin_fall_search_and_deepest_press_below_the_apex() -> None:
    assert StageBounds(lowest_z_mm=-28.6, fastest_mm_s=5.0) == BOUNDS
    day = {"date": "2026-01-01", "expires": "2027-01-01"}
    given = {"calibration": {"compliance_mm_per_n": {"value": 0.1, **day}}}
    assert RigSettings.model_validate(given).bounds.lowest_z_mm == pytest.approx(-28.8)
    low = RigSettings.model_validate({"frame": {"apex_z_mm": -39.0}})
    assert low.bounds.lowest_z_mm == -40.0, "never beyond the travel"
    fast = RigSettings.model_validate({"habits": {"travel_speed_mm_s": 8.0}})
    assert fast.bounds.fastest_mm_s == 8.0


def test_connecting_writes_only_the_board_settings_that_differ() -> None:
    bench = Bench()
    bench.stage.connect()
    assert bench.stored() == [b"$110=300\n", b"$111=300\n", b"$132=28.6\n"]
    bench.written.clear()
    bench.stage.connect()
    assert bench.stored() == []


def test_an_unhomed_board_jogs_up_without_soft_limits_until_homing() -> None:
    """It believes that it is at the upper end of its travel, and would refuse."""
    bench = Bench()
    bench.stage.connect()
    from_steps = bench.board.carriage_steps_at(bench.clock.monotonic_s())[2]
    bench.stage.allow_unhomed_jogs()
    assert "$20=0" in bench.settings()
    bench.stage.jog("z", 0.05, 0.5)
    bench.clock.wait_s(1.0)
    assert bench.board.carriage_steps_at(bench.clock.monotonic_s())[2] == from_steps + 20
    bench.stage.home()
    assert "$20=1" in bench.settings()
    bench.written.clear()
    bench.stage.connect()
    bench.stage.allow_unhomed_jogs()
    assert bench.stored() == [], "where homing ends the limits leave a way up"


def test_connecting_switches_on_soft_limits_that_a_killed_program_left_off() -> None:
    bench = Bench()
    bench.stage.connect()
    bench.stage.allow_unhomed_jogs()
    stage = GrblStage(bench, bench.clock, expected=expected_settings(RigSettings()), bounds=BOUNDS)
    stage.connect()
    assert "$20=1" in bench.settings()


def test_connecting_never_raises_the_highest_speed_of_a_board() -> None:
    """Its motors may not be able to: they would lose steps, and say nothing."""
    board = {110: 120.0, 111: 300.0, 112: 301.0}
    assert enforced_settings(board, BOUNDS) == {112: 300.0, 20: 1, 132: 28.6}


def test_the_board_refuses_motion_below_the_lowest_z_and_accepts_motion_to_it() -> None:
    bench = Bench()
    bench.stage.connect()
    bench.stage.home()
    bench.stage.move_to(z_mm=-28.55, speed_mm_s=5.0)
    with raises(StageRejected, "line_refused", number=15):
        bench.stage.jog("z", -0.1, 1.0)
    bench.stage.end_jog()
    bench.stage.move_to(z_mm=-28.6, speed_mm_s=0.5)
    assert bench.board.carriage_steps_at(bench.clock.monotonic_s())[2] == pytest.approx(-28.6 * 400)


def test_a_board_with_its_origin_where_homing_ends_moves_to_the_same_places() -> None:
    """Built with the option Z; its carriage is where it is told to be, from 1 mm below the switch."""
    bench = Bench()
    bench.board.homes_to_origin = True
    assert "[OPT:VZ," in bench.stage.connect()
    bench.stage.home()
    at_home = bench.stage.status()
    assert (at_home.x_mm, at_home.y_mm, at_home.z_mm) == (0.0, 0.0, 0.0)
    for x_mm, z_mm in ((-10.0, -20.0), (-0.5, 0.0), (0.0, -28.6)):
        bench.stage.move_to(z_mm=z_mm, speed_mm_s=5.0)
        bench.stage.move_to(x_mm=x_mm, speed_mm_s=5.0)
        steps = bench.board.carriage_steps_at(bench.clock.monotonic_s())
        assert steps == pytest.approx((x_mm * 400 - 400, -400, z_mm * 400 - 400), abs=0.5)
    with raises(StageRejected, "line_refused", number=15):
        bench.stage.jog("z", -0.1, 1.0)


def test_a_board_whose_z_homes_downwards_is_refused() -> None:
    with raises(StageError, "not_as_configured", wanted="$23=1", found="found 5"):
        Bench(_23=5).stage.connect()


def test_no_corrupted_setting_line_changes_a_board_setting_that_is_not_enforced() -> None:
    """Every bit and byte of each; a line that changes another setting is found out, and that one put back."""

    def steps(stage: GrblStage) -> None:
        stage.connect()
        stage.allow_unhomed_jogs()
        stage.home()

    faultless = Bench()
    steps(faultless.stage)
    wanted = faultless.settings()
    assert {b"$20=0\n", b"$20=1\n"} <= {*faultless.stored()}
    for line in faultless.stored():
        for instead in _instead(line):
            bench = Bench()
            bench.instead[line] = instead
            try:
                steps(bench.stage)
            except StageError:
                continue
            assert bench.settings() == wanted, instead


def test_a_corrupted_homing_line_never_makes_a_stage_count_as_homed() -> None:
    """`$X`, which unlocks, is one bit from `$H`, and `$I` another: each is answered with `ok`."""
    homed, not_homed = 0, 0
    for instead in _instead(b"$H\n"):
        bench = Bench()
        bench.stage.connect()
        bench.instead[b"$H\n"] = instead
        try:
            bench.stage.home()
            homed += 1
        except StageError:
            not_homed += 1
        at_home = bench.board.carriage_steps_at(bench.clock.monotonic_s()) == HOME_STEPS
        assert bench.stage.homed <= at_home, instead
        assert bench.clock.monotonic_s() < 60.0, "it does not wait for a homing that never began"
    assert (homed, not_homed) == (2, 33)
