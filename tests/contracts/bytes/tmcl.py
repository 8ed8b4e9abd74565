"""A Trinamic module in binary TMCL, x motor 0 and z motor 1, 400 microsteps in a mm: 0.4 mm down from home.

Frames are written as words: axis, command, type and value; replies as status and value. The left switches are at
home, so the module counts upwards away from home. A frame that lost its end is filled up by a byte, here `filler`.
"""

import struct

from rig.devices.base import StageError, StageOverridden, StageStatus, StageTimeout
from tests.contracts.stage import SILENCE, Garbled, HomingEnd, Replies, Shown, StageBytes

Y_MM = -15.0  # set by hand, as the configuration says by default
NAMES = {3: "MST", 4: "MVP", 5: "SAP", 6: "GAP", 13: "RFS", 136: "version"}
COMMANDS = {name: number for number, name in NAMES.items()}
LENGTH = 9


def axis(name: str, *, target: int = 0, at: int = 0, speed: int = 0, most: int = 0, search: int = 0) -> Replies:
    """What an axis reports."""
    values = {0: target, 1: at, 3: speed, 4: most}
    found = {f"{name} GAP {number}": f"100 {value}" for number, value in values.items()}
    found[f"{name} RFS 2"] = f"100 {search}"
    return {asked.encode(): said.encode() for asked, said in found.items()}


def usual(name: str) -> Replies:
    """Identity, settings, and what is obeyed at once."""
    a = name.encode()
    return {
        **axis(name),
        a + b" version 0": b"1161V146",
        a + b" GAP 140": b"100 8",
        a + b" GAP 193": b"100 1",
        a + b" GAP 5": b"100 20000",
        **{a + b" GAP %d" % number: b"100 0" for number in (10, 11, 207, 208)},
        a + b" SAP 4 0": b"100 0",
        a + b" MST 0": b"100 0",
    }


def heard(frame: bytes) -> bytes:
    """The words of a frame, whose checksum is right."""
    if frame == b"\0":
        return b"filler"
    assert len(frame) == LENGTH, frame
    assert sum(frame[:-1]) & 0xFF == frame[-1], frame
    address, command, kind, motor, value = struct.unpack(">BBBBi", frame[:-1])
    assert address == 1, frame
    assert command in (4, 5) or not value, frame
    words = ["xz"[motor], NAMES[command], str(kind)]
    return " ".join([*words, str(value)] if command in (4, 5) else words).encode()


def framed(words: bytes) -> bytes:
    """The frame of these words."""
    if words == b"filler":
        return b"\0"
    motor, name, kind, *value = words.decode().split()
    body = struct.pack(">BBBBi", 1, COMMANDS[name], int(kind), "xz".index(motor), int(value[0]) if value else 0)
    return body + bytes([sum(body) & 0xFF])


def said(frame: bytes, reply: bytes) -> bytes:
    """The reply of the module to the host."""
    if frame[1] == COMMANDS["version"]:
        return b"\x02" + reply
    status, value = map(int, reply.split())
    body = struct.pack(">BBBBi", 2, frame[0], status, frame[1], value)
    return body + bytes([sum(body) & 0xFF])


def frames(data: bytes) -> list[bytes]:
    """Nine bytes each."""
    return [data[n : n + LENGTH] for n in range(0, len(data), LENGTH)]


HOMING = b"100 0"
ANY_ALARM: tuple[str, str, str] = ("alarm", "alarm", "alarm")
RESET: tuple[str, str, str] = ("was_reset", "was_reset", "was_reset")
GOING = axis("z", target=160, at=8, speed=200, most=200)


def shown(parameter: int, value: int, codes: tuple[str, str, str], number: int | None = None, at: int = 0) -> Shown:
    """A parameter that has another value, under way, and at rest at a count."""
    other = {f"z GAP {parameter}".encode(): b"100 %d" % value}
    return Shown({**GOING, **other}, {b"z GAP 1": b"100 %d" % at, **other}, codes, number)


def search(z_mm: float, v_mm_s: float, switch: str) -> Replies:
    """A search for home."""
    return {
        **axis("z", at=round(-400 * z_mm), speed=round(-400 * v_mm_s), most=2000, search=1),
        b"z GAP 11": b"100 1" if switch == "home" else b"100 0",
        b"z GAP 10": b"100 1" if switch == "far" else b"100 0",
    }


def home_switch(at: int) -> Shown:
    """The home switch is active, 400 counts in a mm from home."""
    near = abs(at) <= 400
    codes = ("", "", "") if near else ("", "alarm", "alarm")
    return shown(11, 1, codes, None if near else 11, at)


DEVICE = StageBytes(
    name="tmcl",
    kind="tmcl",
    source="Trinamic TMCL firmware manuals; bytes exchanged with pytrinamic 0.2.26",
    identity=("x: TMCL module 1, motor 0, firmware 1161V146; z: TMCL module 1, motor 1, firmware 1161V146"),
    usual={
        **usual("x"),
        **usual("z"),
        b"filler": SILENCE,
        b"z SAP 4 2000": (b"100 2000", "z is ready"),
        b"z RFS 0": (HOMING, "z homes"),
        b"x SAP 4 2000": (b"100 2000", "x is ready"),
        b"x RFS 0": (HOMING, "x homes"),
        b"z MVP 0 160": (b"100 160", "aimed"),
        b"z SAP 4 200": (b"100 200", "moving"),
        b"z MVP 0 40": (b"100 40", "jog aimed"),  # 0.1 mm at 1 mm/s
        b"z SAP 4 400": (b"100 400", "jogs"),
        b"x RFS 1": b"100 0",
        b"z RFS 1": b"100 0",
    },
    states={
        "new": {**axis("z", most=4000), **axis("x", most=4000), b"z SAP 4 0": (b"100 0", "z disarmed")},
        "z disarmed": {b"x SAP 4 0": (b"100 0", "home")},
        "z is ready": axis("z", most=2000, at=4000),
        "z homes": {**axis("z", most=2000, at=2000, speed=-2000), b"z RFS 2": (b"100 1", "z is home")},
        "z is home": {**axis("z", most=2000), b"z GAP 11": b"100 1", b"z SAP 4 0": (b"100 0", "home")},
        "x is ready": axis("x", most=2000, at=4000),
        "x homes": {**axis("x", most=2000, at=2000, speed=-2000), b"x RFS 2": (b"100 1", "x is home")},
        "x is home": {**axis("x", most=2000), b"x SAP 4 0": (b"100 0", "home")},
        "home": {b"x GAP 11": b"100 1", b"z GAP 11": b"100 1"},
        "aimed": axis("z", target=160),
        "moving": {
            **axis("z", target=160, at=8, speed=200, most=200),
            b"z MST 0": (b"100 0", "slowing"),
        },
        "arrived": {**axis("z", target=160, at=160, most=200), b"z SAP 4 0": (b"100 0", "stands")},
        "stands": axis("z", target=160, at=160),
        "elsewhere": axis("z", target=160, at=20, most=200),
        "held": axis("z", target=777, at=8, speed=200, most=200),
        "alarm": {**axis("z", target=160, at=8, most=200), b"z GAP 10": b"100 1"},
        "slowing": {
            **axis("z", target=160, at=10, speed=50, most=200),
            b"z MST 0": (b"100 0", "rested"),
        },
        "rested": axis("z", target=160, at=11),
        "jog aimed": axis("z", target=40),
        "jogs": axis("z", target=40, most=400),
    },
    where=b"z GAP 1",
    move={"z_mm": -0.4, "speed_mm_s": 0.5},
    home=StageStatus("Idle", 0.0, Y_MM, 0.0),
    under_way=StageStatus("Run", 0.0, Y_MM, -0.02),
    arrived=StageStatus("Idle", 0.0, Y_MM, -0.4),
    trigger=b"z SAP 4 200",
    stop=[b"z MST 0"],
    halt=b"z MST 0",
    unlock=(b"z GAP 207", b"6 0", "line_refused", 6),
    refusals={n: b"%d 0" % n for n in range(1, 6)},
    alarm=10,
    fault_words={207: "steps lost", 208: "motor driver", 10: "right limit", 11: "left limit"},
    refusal_words={
        1: "checksum",
        2: "unknown command",
        3: "type",
        4: "out of range",
        5: "EEPROM",
        6: "not available",
    },
    held=(StageOverridden, "overridden"),
    garbled={
        "a wrong bit": Garbled(b"100 0", StageError, "garbled", lambda f: f[:5] + b"\x01" + f[6:]),
        "a status that is none": Garbled(b"99 0", StageError, "garbled"),
        "to another host": Garbled(b"100 0", StageError, "garbled", lambda f: b"\x03" + f[1:-1] + bytes([f[-1] + 1])),
        "of another module": Garbled(
            b"100 0", StageTimeout, "no_reply", lambda f: f[:1] + b"\x02" + f[2:-1] + bytes([f[-1] + 1])
        ),
        "to another command": Garbled(
            b"100 0", StageTimeout, "no_reply", lambda f: f[:3] + bytes([f[3] + 1]) + f[4:-1] + bytes([f[-1] + 1])
        ),
        "cut short": Garbled(b"100 0", StageError, "garbled", lambda f: f[:-1]),
        "refused": Garbled(b"1 0", StageError, "line_refused"),
    },
    settings=[
        (b"z GAP 140", b"100 4", "microstep resolution of the module (parameter 140)"),
        (b"z GAP 193", b"100 2", "reference search mode of the module (parameter 193)"),
        (b"z GAP 5", b"100 19999", "acceleration of the module (parameter 5)"),
    ],
    shows={
        **{
            f"steps lost, flags {flags:X}": shown(207, flags, ANY_ALARM, 207)
            for flags in (1, 1 << 15, 1 << 30, -(1 << 31))
        },
        **{f"fault of the driver, flags {flags:X}": shown(208, flags, ANY_ALARM, 208) for flags in (2, 8, 16)},
        **{f"harmless flags {flags:X}": shown(208, flags, ("", "", "")) for flags in (1, 4, 0x20, 1 << 30)},
        "the far switch": shown(10, 1, ANY_ALARM, 10),
        **{f"the home switch at {at}": home_switch(at) for at in (-401, -400, 400, 401)},
        "another maximum speed": shown(4, 300, RESET),
        "another target": shown(0, 777, ("overridden", "", "not_as_configured")),
    },
    ends={
        **{
            f"at {at}": HomingEnd("z is home", axis("z", most=2000, at=at), abs(at) <= 200)
            for at in (-201, -200, 200, 201)
        },
        "turning again": HomingEnd(
            "z is home",
            {**axis("z", most=2000), b"z RFS 2": (b"100 0", "then")},
            then={**axis("z", most=2000, speed=100), b"z RFS 2": b"100 0"},
        ),
    },
    search=search,
    lacks={"limit": "modules have no limit of the travel besides their switches"},
    frames=frames,
    heard=heard,
    framed=framed,
    alarmed=lambda devices: devices.z.press("right"),
    said=said,
)
