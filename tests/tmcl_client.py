"""Trinamic's own client at a port: what it does and finds, one JSON object on standard output.

It runs in an environment of its own, with pytrinamic and without this project.
"""

import json
import sys
import time
from typing import Any

from pytrinamic.connections import ConnectionManager
from pytrinamic.modules import TMCM3110
from pytrinamic.tmcl import TMCLReplyStatusError

LATEST_S = 60.0


def refused(act: Any) -> int:
    """The status with which the module refuses."""
    try:
        act()
    except TMCLReplyStatusError as error:
        return int(error.reply.status)
    return 100


def until(holds: Any) -> bool:
    """Poll, as the library's examples do."""
    latest_s = time.monotonic() + LATEST_S
    while not holds():
        if time.monotonic() > latest_s:
            return False
        time.sleep(0.02)
    return True


def main() -> None:
    """Identify, home, move, stop."""
    port = sys.argv[1]
    kind, port = ("socket_serial_tmcl", port.removeprefix("tcp://")) if "://" in port else ("serial_tmcl", port)
    manager = ConnectionManager(f"--interface {kind} --port {port} --data-rate 115200 --timeout 10")
    with manager.connect() as line:
        module = TMCM3110(line)
        motor = module.motors[1]
        found: dict[str, Any] = {"version": line.get_version_string()}
        module.start_reference_search(1)
        found["searching"] = module.get_reference_search_status(1) != 0
        found["homed"] = until(lambda: module.get_reference_search_status(1) == 0)
        found["home"] = [motor.actual_position, motor.get_axis_parameter(motor.AP.LeftEndstop)]
        motor.move_to(1000, 2000)
        found["absolute"] = [until(motor.get_position_reached), motor.actual_position, motor.linear_ramp.max_velocity]
        motor.move_by(-256)
        found["relative"] = [until(motor.get_position_reached), motor.actual_position]
        motor.rotate(1000)
        found["rotates"] = until(lambda: motor.actual_velocity == 1000)
        motor.stop()
        found["stopped"] = until(lambda: motor.actual_velocity == 0)
        motor.linear_ramp.max_acceleration = 30000
        found["acceleration"] = motor.linear_ramp.max_acceleration
        found["no parameter"] = refused(lambda: motor.get_axis_parameter(255))
        found["no motor"] = refused(lambda: module.motors[2].stop())
        found["no value"] = refused(lambda: motor.set_axis_parameter(4, 0x7FFFFFFF))
        found["no command"] = refused(lambda: line.send(99, 0, 0, 0))
        found["other axis"] = module.motors[0].actual_position
    print(json.dumps(found))


if __name__ == "__main__":
    main()
