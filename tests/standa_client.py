"""Standa's own client, libximc, at a URI: what it does and finds, one JSON object on standard output.

It is a process of its own, because a silent controller holds a call of the library for 7 s. The same moves on its
emulator (`xi-emu:`) give the same positions; the emulator has no homing, no limits and no ramps, so `all` leaves it
out of the rest.
"""

import json
import sys
import time
from collections.abc import Callable
from typing import Any

import libximc.highlevel as ximc
from libximc.highlevel import MicrostepMode, MvcmdStatus, PositionFlags, StateFlags

NOTHING_FLAGS = PositionFlags(0)


def failure(act: Any) -> str:
    """The name of the library's error."""
    try:
        act()
    except (RuntimeError, ValueError) as error:
        return type(error).__name__
    return ""


def place(axis: ximc.Axis) -> list[int]:
    """Full steps and microsteps."""
    at = axis.get_position()
    return [at.Position, at.uPosition]


def moves(axis: ximc.Axis) -> dict[str, Any]:
    """What the emulator knows, too: settings, moves, microsteps."""
    found: dict[str, Any] = {}
    engine = axis.get_engine_settings()
    engine.MicrostepMode = MicrostepMode.MICROSTEP_MODE_FRAC_256
    axis.set_engine_settings(engine)
    axis.set_position(ximc.set_position_t(0, 0, 0, NOTHING_FLAGS))
    speed = axis.get_move_settings()
    speed.Speed, speed.uSpeed, speed.Accel, speed.Decel = 2000, 0, 20000, 20000
    axis.set_move_settings(speed)
    found["speed"] = axis.get_move_settings().Speed
    for name, act in (
        ("absolute", lambda: axis.command_move(200, 128)),
        ("relative", lambda: axis.command_movr(-50, -64)),
        ("below zero", lambda: axis.command_move(-30, -200)),
    ):
        act()
        axis.command_wait_for_stop(10)
        found[name] = place(axis)
    axis.command_zero()
    found["zero"] = place(axis)
    return found


def until(holds: Callable[[], bool]) -> None:
    """Poll, for at most a minute."""
    latest_s = time.monotonic() + 60.0
    while not holds() and time.monotonic() < latest_s:
        time.sleep(0.01)


def whole(axis: ximc.Axis) -> dict[str, Any]:
    """What the emulator does not know."""
    found: dict[str, Any] = {"serial": axis.get_serial_number(), "new": int(axis.get_status().Flags)}
    axis.command_homezero()
    status = axis.get_status()
    found["homed"] = [bool(status.Flags & StateFlags.STATE_IS_HOMED), *place(axis)]
    axis.command_right()
    until(lambda: axis.get_status().CurPosition > 50)
    found["runs"] = bool(axis.get_status().MvCmdSts & MvcmdStatus.MVCMD_RUNNING)
    axis.command_sstp()
    axis.command_wait_for_stop(10)
    status = axis.get_status()
    homed = bool(status.Flags & StateFlags.STATE_IS_HOMED)
    found["soft stop"] = [int(status.MvCmdSts), homed, status.CurPosition > 50]
    axis.command_left()
    until(lambda: axis.get_status().CurPosition < 50)
    axis.command_stop()
    status = axis.get_status()
    found["hard stop"] = [int(status.MvCmdSts), bool(status.Flags & StateFlags.STATE_IS_HOMED)]
    speed = axis.get_move_settings()
    speed.Speed = 200_000
    found["too fast"] = failure(lambda: axis.set_move_settings(speed))
    found["speed now"] = axis.get_move_settings().Speed
    found["unknown"] = failure(axis.command_loft)
    found["still there"] = axis.get_serial_number()
    return found


def main() -> None:
    """Open, move, home, stop."""
    uri, *what = sys.argv[1:]
    axis = ximc.Axis(uri)
    axis.open_device()
    try:
        found = moves(axis)
        if what == ["all"]:
            found |= whole(axis)
    finally:
        axis.close_device()
    print(json.dumps(found))


if __name__ == "__main__":
    main()
