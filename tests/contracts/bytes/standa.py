"""Two Standa controllers, z on the port of the stage and x on its own, full steps of 10 µm in 256: 2.5 mm down.

Frames are written as the port, the letters and the numbers; `sealed` and `content` add and check the CRC. Where home
is left, counts grow away from it, so 250 full steps are 2.5 mm down.
"""

import struct
from collections.abc import Sequence

from rig.devices.base import StageError, StageHeld, StageStatus, StageTimeout
from tests.contracts.stage import Garbled, HomingEnd, Replies, Shown, StageBytes

Y_MM = -15.0  # set by hand, as the configuration says by default
RUNS, MOVE, LEFT, STOP, HOME, SSTP = 0x80, 1, 3, 5, 6, 8
HOMED, ALARM = 0x20, 0x40
POWER_OFF, POWERED = 1, 3


def crc(data: bytes) -> bytes:
    """CRC-16 of Modbus, computed bit by bit."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0xA001 if value & 1 else value >> 1
    return struct.pack("<H", value)


def status(command: int, steps: int, flags: int, part: int = 0) -> bytes:
    """Payload of `gets`: offsets as in the manual, without the four letters."""
    found = bytearray(48)
    found[0] = command >> 7
    found[1], found[2] = command, POWERED
    found[5:11] = struct.pack("<ih", steps, part)
    found[35:39] = struct.pack("<I", flags)
    return b"gets" + bytes(found)


def changed(found: bytes, *, power: int = POWERED, inputs: int = 0) -> bytes:
    """A status with a power state and inputs."""
    return found[:6] + bytes([power]) + found[7:43] + bytes([inputs]) + found[44:]


def alike(reply: bytes) -> bytes:
    """Without the serial number, voltages, currents and microsteps on the way, and the speeds of homing."""
    parts = {
        b"gets": [slice(7), slice(9, 15 if reply[4:5] == b"\0" else 13), slice(39, 44)],
        b"gser": [slice(4)],
        b"ghom": [slice(4), slice(20, 22)],
        b"gpwr": [slice(4), slice(11, 12)],
    }
    return b" ".join(reply[part] for part in parts.get(reply[:4], [slice(None)]))


def shows(axis: str, command: int, steps: int, flags: int = HOMED, power: int = POWERED) -> Replies:
    """An axis in a state."""
    return {f"{axis} gets".encode(): changed(status(command, steps, flags), power=power)}


def usual(axis: str, serial: int) -> Replies:
    """Identity, settings, and what is obeyed at once."""
    a = f"{axis} ".encode()
    return {
        **shows(axis, HOME, 0),
        a + b"gser": b"gser" + struct.pack("<I", serial),
        a + b"gfwv": b"gfwv" + struct.pack("<BBH", 4, 7, 12),
        a + b"geng": b"geng" + struct.pack("<HHIBHhBH12x", 0, 500, 5000, 0, 0x10, 0, 9, 200),
        a + b"geds": b"geds" + bytes([6]) + bytes(19),
        a + b"ghom": b"ghom" + bytes(16) + b"\x30" + bytes(10),
        a + b"gpwr": b"gpwr" + bytes(14),
        a + b"gmov": b"gmov" + struct.pack("<IBHHIBB9x", 200, 0, 6000, 6000, 0, 0, 0),
        a + b"sstp": b"sstp",
        a + b"stop": b"stop",
        a + b"zero": b"zero",
        a + b"zeros": bytes(64),
    }


def content(frame: bytes) -> bytes:
    """The command and its numbers; its CRC is right, and what is reserved is CC."""
    if not any(frame):
        assert len(frame) == 64
        return b"zeros"
    letters, payload, seal = frame[:4], frame[4:-2], frame[-2:]
    if len(frame) == 4:
        return letters
    assert crc(payload) == seal, frame.hex(" ")
    if letters in (b"move", b"movr"):
        assert payload[6:] == b"\xcc" * 6
        numbers: Sequence[int] = struct.unpack("<ih", payload[:6])
    else:
        assert letters == b"smov"
        assert payload[15:] == b"\xcc" * 9
        numbers = struct.unpack("<IBHHIBB", payload[:15])
    return b" ".join([letters, *(b"%d" % number for number in numbers)])


def framed(words: bytes) -> bytes:
    """The frame of a command and its numbers, without the port."""
    letters, *numbers = words.split(b" ")
    if letters == b"zeros":
        return bytes(64)
    if not numbers:
        return letters
    layout, reserved = ("<IBHHIBB", 9) if letters == b"smov" else ("<ih", 6)
    payload = struct.pack(layout, *map(int, numbers)) + b"\xcc" * reserved
    return letters + payload + crc(payload)


def sealed(frame: bytes, reply: bytes) -> bytes:
    """The reply with the CRC of its payload."""
    return reply if len(reply) == 4 or not any(reply) else reply + crc(reply[4:])


REST = status(HOME, 0, HOMED)
ALARMS = {  # protocol.xi, flags of a status
    0x40: "ALARM", 0x80: "CTP_ERROR", 0x100: "POWER_OVERHEAT", 0x200: "CONTROLLER_OVERHEAT",
    0x400: "OVERLOAD_POWER_VOLTAGE", 0x800: "OVERLOAD_POWER_CURRENT", 0x1000: "OVERLOAD_USB_VOLTAGE",
    0x2000: "LOW_USB_VOLTAGE", 0x4000: "OVERLOAD_USB_CURRENT", 0x8000: "BORDERS_SWAP_MISSET",
    0x10000: "LOW_POWER_VOLTAGE", 0x20000: "H_BRIDGE_FAULT", 0x100000: "WINDING_RES_MISMATCH",
    0x200000: "ENCODER_FAULT", 0x800000: "ENGINE_RESPONSE_ERROR", 0x1000000: "EXTIO_ALARM",
    0x8: "8 hex", 0x40000: "40000 hex", 0x80000000: "80000000 hex",
}  # fmt: skip


def shown(codes: tuple[str, str, str], number: str | None = None, *, flags: int = HOMED, **change: int) -> Shown:
    """What `gets` shows under way and at rest."""
    return Shown(
        {b"z gets": changed(status(RUNS | MOVE, 125, flags), **change)},
        {b"z gets": changed(status(HOME, 0, flags), **change)},
        codes,
        number,
    )


def ends(state: str, said: bytes) -> HomingEnd:
    """A status that ends homing."""
    return HomingEnd(state, {b"z gets": said})


def search(z_mm: float, v_mm_s: float, switch: str) -> Replies:
    """What `gets` shows of a search for home."""
    found = status(RUNS | HOME, round(-100 * z_mm), 0)
    return {b"z gets": changed(found, inputs={"home": 2, "far": 1}.get(switch, 0))}


def engine(flags: int, mode: int) -> bytes:
    """Reply to `geng`."""
    return b"geng" + struct.pack("<HHIBHhBH12x", 0, 500, 5000, 0, flags, 0, mode, 200)


def ramps(up: int, down: int) -> bytes:
    """Reply to `gmov`."""
    return b"gmov" + struct.pack("<IBHHIBB9x", 200, 0, up, down, 0, 0, 0)


ANY_ALARM: tuple[str, str, str] = ("alarm", "alarm", "alarm")
RESET: tuple[str, str, str] = ("was_reset", "was_reset", "was_reset")

DEVICE = StageBytes(
    name="standa",
    kind="standa",
    source="Standa 8SMC5-USB manual, communication protocol; protocol.xi of libximc, version 20.8",
    identity="x: Standa controller 4712, firmware 4.7.12; z: Standa controller 4711, firmware 4.7.12",
    ports={"/dev/ttyUSB0": b"z ", "/dev/ttyACM1": b"x "},
    usual={
        **usual("z", 4711),
        **usual("x", 4712),
        b"z home": (b"home", "z homes"),
        b"x home": (b"home", "x homes"),
        b"z smov 50 0 6000 6000 0 0 0": b"smov",
        b"z move 250 0": (b"move", "moving"),
        b"z smov 100 0 6000 6000 0 0 0": b"smov",
        b"z move 10 0": (b"move", "moving"),  # a jog, 0.1 mm at 1 mm/s
        b"z movr 10 0": (b"movr", "moving"),  # the same, not homed
        b"z stop": (b"stop", "rested"),
    },
    states={
        "new": {**shows("x", 0, 0, 0, POWER_OFF), **shows("z", 0, 0, 0, POWER_OFF)},
        "z homes": {**shows("x", 0, 30, 0), b"z gets": (status(RUNS | HOME, 40, 0), "z is home")},
        "z is home": {**shows("x", 0, 30, 0), **shows("z", HOME, 50), b"z zero": (b"zero", "z is zero")},
        "z is zero": shows("x", 0, 30, 0),
        "x homes": {b"x gets": (status(RUNS | HOME, 30, 0), "x is home")},
        "x is home": {b"x zero": (b"zero", "home"), **shows("x", HOME, 50)},
        "home": {},
        "moving": {**shows("z", RUNS | MOVE, 125), b"z sstp": (b"sstp", "slowing")},
        "arrived": shows("z", MOVE, 250),
        "elsewhere": shows("z", MOVE, 247),
        "held": shows("z", RUNS | LEFT, 125),
        "alarm": shows("z", MOVE, 125, HOMED | ALARM | 0x800, POWER_OFF),
        "slowing": {b"z gets": (status(RUNS | SSTP, 126, HOMED), "rested")},
        "rested": shows("z", SSTP, 127),
    },
    where=b"z gets",
    move={"z_mm": -2.5, "speed_mm_s": 0.5},
    home=StageStatus("Idle", 0.0, Y_MM, 0.0),
    under_way=StageStatus("Run", 0.0, Y_MM, -1.25),
    arrived=StageStatus("Idle", 0.0, Y_MM, -2.5),
    trigger=b"z move 250 0",
    stop=[b"z stop"],
    halt=b"z sstp",
    unlock=(b"z stop", b"errc", "line_refused", "errc"),
    refusals={"errd": b"errd", "errv": b"errv"},
    fault_words=dict.fromkeys(
        (*ALARMS.values(), "ALARM CTP_ERROR", "ALARM OVERLOAD_POWER_CURRENT", "RIGHT_EDGE"), ""
    ),
    refusal_words={"errc": "unknown command", "errd": "checksum", "errv": "value"},
    alarm="ALARM OVERLOAD_POWER_CURRENT",
    held=(StageHeld, "held"),
    garbled={
        "a wrong bit": Garbled(REST, StageError, "garbled", lambda f: f[:20] + b"\1" + f[21:]),
        "a wrong checksum": Garbled(REST, StageError, "garbled", lambda f: f[:-1] + bytes([f[-1] ^ 1])),
        "of another command": Garbled(b"geds" + bytes(20), StageError, "garbled"),
        "cut short": Garbled(REST, StageError, "garbled", lambda f: f[:30]),
        "without its letters": Garbled(REST, StageError, "garbled", lambda f: f[2:]),
        "zero bytes": Garbled(REST, StageTimeout, "no_reply", lambda f: bytes(54)),
        "wrong checksum there": Garbled(b"errd", StageError, "line_refused"),
        "unknown there": Garbled(b"errc", StageError, "line_refused"),
    },
    settings=[
        (b"z geng", engine(0x10, 8), "MicrostepMode"),
        (b"z geng", engine(0x10, 10), "MicrostepMode"),
        (b"z geng", engine(0xFFEF, 9), "ENGINE_ACCEL_ON"),
        (b"z geng", engine(0x18, 9), "ENGINE_ANTIPLAY"),
        *((b"z geds", b"geds" + bytes([bits]) + bytes(19), "BORDER_STOP_LEFT and _RIGHT") for bits in (2, 4, 0xF8)),
        (b"z geds", b"geds" + bytes([7]) + bytes(19), "BORDER_IS_ENCODER"),
        (b"z ghom", b"ghom" + bytes(16) + b"\x31" + bytes(10), "HOME_DIR_FIRST"),
        *(
            (b"z ghom", b"ghom" + bytes(16) + bits.to_bytes(2, "little") + bytes(9), "HOME_STOP_FIRST_BITS")
            for bits in (0x10, 0x20, 0xFFCE)
        ),
        (b"z gpwr", b"gpwr" + bytes(7) + b"\x02" + bytes(6), "POWER_OFF_ENABLED"),
        (b"z gmov", ramps(4999, 6000), "Accel"),
        (b"z gmov", ramps(6000, 4999), "Decel"),
    ],
    shows={
        **{name: shown(ANY_ALARM, name, flags=HOMED | bit) for bit, name in ALARMS.items()},
        "two alarms": shown(ANY_ALARM, "ALARM CTP_ERROR", flags=HOMED | 0xC0),
        **{f"harmless {bit:X}": shown(("", "", ""), flags=HOMED | bit) for bit in (1, 2, 4, 0x10)},
        "power off": shown(RESET, power=1),
        "another power": shown(("", "", ""), power=2),
        "not homed": shown(RESET, flags=0),
        "not homed, with all else": shown(RESET, flags=0x17),
        "far switch": shown(ANY_ALARM, "RIGHT_EDGE", inputs=1),
        "home switch": shown(("", "", ""), inputs=2),
        "right button": shown(("held", "", "held"), inputs=4),
        "left button": shown(("held", "", "held"), inputs=8),
        "another input": shown(("", "", ""), inputs=0xF0),
        "a soft stop": Shown({b"z gets": status(RUNS | SSTP, 125, HOMED)}, {b"z gets": REST}, ("overridden", "", "")),
        **{
            f"moved by a button, command {command:X}": Shown(
                {b"z gets": status(command, 125, HOMED)}, {b"z gets": status(command, 0, HOMED)}, (code, "", before)
            )
            for command, code, before in (
                (3, "overridden", ""),
                (4, "overridden", ""),
                (0x83, "held", "held"),
                (0x84, "held", "held"),
            )
        },
    },
    ends={
        "moving again": HomingEnd(
            "z is home",
            {b"z gets": (status(HOME, 50, HOMED), "then")},
            then={b"z gets": b"gets\x01" + status(HOME, 50, HOMED)[5:]},
        ),
        "failed": ends("z is home", status(HOME | 0x40, 50, HOMED)),
        "ended by another command": ends("z is home", status(SSTP, 50, HOMED)),
        "without its flag": ends("z is home", status(HOME, 50, 0)),
        "with all flags but its own": ends("z is home", status(HOME, 50, 0x17)),
        "a step from the zero": ends("z is zero", status(HOME, 1, HOMED)),
        "a microstep from the zero": ends("z is zero", status(HOME, 0, HOMED, 1)),
        "without its flag after the zero": ends("z is zero", status(HOME, 0, 0x17)),
    },
    search=search,
    lacks={"limit": "borders at positions would replace the limit switches"},
    heard=content,
    alike=alike,
    framed=framed,
    alarmed=lambda devices: devices.z.fail(0x800),
    said=sealed,
)
