"""Zaber's own client at a port, in native units: what it does and finds, one JSON object on standard output.

It is a process of its own, because the library ends its process on a malformed answer of the device database. No
database is used: the devices are not identified, and its address is a closed port of this machine.
"""

import json
import sys
import threading
from typing import Any

from zaber_motion import DeviceDbSourceType, Library, MotionLibException, Units
from zaber_motion.ascii import Axis, Connection

NATIVE = Units.NATIVE


def failure(act: Any) -> str:
    """The name of the library's error."""
    try:
        act()
    except MotionLibException as error:
        return type(error).__name__
    return ""


def interrupted(axis: Axis) -> str:
    """How a move ends that another one interrupts."""
    found: list[str] = []
    move = threading.Thread(
        target=lambda: found.append(
            failure(lambda: axis.move_absolute(6000, NATIVE, velocity=3276, velocity_unit=NATIVE))
        )
    )
    move.start()
    while not axis.is_busy():
        pass
    axis.move_absolute(400, NATIVE)
    move.join()
    return found[0]


def main() -> None:
    """Detect, home, move, stop."""
    Library.disable_device_db_store()
    Library.set_device_db_source(DeviceDbSourceType.WEB_SERVICE, "http://127.0.0.1:9/")
    port = sys.argv[1]
    host, _, number = port.removeprefix("tcp://").partition(":")
    opened = Connection.open_tcp(host, int(number)) if "://" in port else Connection.open_serial_port(port)
    with opened as connection:
        devices = connection.detect_devices(identify_devices=False)
        axis = devices[1].get_axis(1)
        found: dict[str, Any] = {
            "devices": [device.device_address for device in devices],
            "device_id": devices[0].generic_command("get deviceid").data,
            "new": sorted(axis.warnings.get_flags()),
        }
        axis.home()
        found["homed"] = [axis.is_homed(), axis.get_position()]
        axis.move_absolute(1000, NATIVE)
        found["absolute"] = axis.get_position()
        axis.move_absolute(2000, NATIVE, velocity=3276, velocity_unit=NATIVE)
        found["with_speed"] = axis.get_position()
        axis.move_relative(-500, NATIVE)
        found["relative"] = axis.get_position()
        axis.move_velocity(1310, NATIVE)
        found["at_a_speed"] = axis.is_busy()
        axis.stop()
        found["stopped"] = not axis.is_busy()
        axis.move_absolute(1500, NATIVE)
        found["too_far"] = failure(lambda: axis.move_absolute(999_999, NATIVE))
        found["unknown"] = failure(lambda: axis.generic_command("frobnicate"))
        found["interrupted"] = interrupted(axis)
        connection.enable_alerts()
        axis.move_absolute(800, NATIVE)
        found["with_alerts"] = axis.get_position()
    print(json.dumps(found))


if __name__ == "__main__":
    main()
