"""Two Leadshine CS2RS drives, x device 1 and z device 2, 400 pulses a turn and a mm: 2.5 mm down from home.

Frames are written without what their way adds: the CRC of RTU, computed here bit by bit, and the header of TCP.
"""

from collections.abc import Sequence
from dataclasses import replace

from rig.devices.base import StageError, StageStatus, StageTimeout
from tests.contracts.other_lengths import other_lengths
from tests.contracts.stage import SILENCE, Garbled, HomingEnd, Limit, Replies, Shown, StageBytes

X, Z = 1, 2
Y_MM = -15.0  # set by hand, as the configuration says by default


def said(text: str) -> bytes:
    """Bytes from their hex."""
    return bytes.fromhex(text)


def status(device: int, word: str) -> Replies:
    """Bit 0 fault, 1 enabled, 2 running, 4 command done, 5 path done, 6 homed."""
    return {said(f"{device:02X} 03 10 03 00 01"): said(f"{device:02X} 03 02 {word}")}


def stands(device: int, commanded: str, feedback: str) -> Replies:
    """Where it was told to be and where it is, in pulses of 32 bits."""
    return {
        said(f"{device:02X} 03 60 2C 00 02"): said(f"{device:02X} 03 04 {commanded}"),
        said(f"{device:02X} 03 10 14 00 02"): said(f"{device:02X} 03 04 {feedback}"),
    }


def shown(device: int, register: str, words: str) -> Replies:
    """What registers hold."""
    count = len(words.split()) // 2
    return {said(f"{device:02X} 03 {register} 00 {count:02X}"): said(f"{device:02X} 03 {2 * count:02X} {words}")}


def one(frame: str, state: str = "") -> Replies:
    """A write of one register is echoed."""
    return {said(frame): (said(frame), state) if state else said(frame)}


def several(frame: str, state: str = "") -> Replies:
    """A write of several registers is answered by its first six bytes."""
    answer = said(frame)[:6]
    return {said(frame): (answer, state) if state else answer}


READY, HOMED, RUNNING, FAULT, DISABLED = "00 32", "00 72", "00 46", "00 41", "00 70"
ZERO, HALF, THERE, ELSEWHERE = "00 00 00 00", "FF FF FE 0C", "FF FF FC 18", "FF FF FC 22"
CREEP, SEARCH = "00 01 00 01 01 4D 01 4D", "01 2C 00 19 01 4D 01 4D"
PATH = "00 01 FF FF FC 18 00 1E 01 4D 01 4D 00 00"  # absolute, −1000 pulses, 30 rpm, ramps of 333 ms
JOG = "00 01 FF FF FF D8 00 3C 01 4D 01 4D 00 00"  # 0.1 mm down at 1 mm/s


def usual(device: int, lowest: str, homing: str) -> Replies:
    """Sixteen paths that are null, creep for homing and jogs, and what is set before it homes."""
    d = f"{device:02X}"
    return {
        **shown(device, "00 01", "01 90"),
        **{key: reply for n in range(16) for key, reply in shown(device, f"62 {8 * n:02X}", "00 00").items()},
        **shown(device, "60 0F", CREEP),
        **shown(device, "01 E1", "00 01"),
        **shown(device, "22 03", "00 00"),
        **several(f"{d} 10 60 0A 00 01 02 00 01"),
        **shown(device, "60 0A", "00 01"),
        **several(f"{d} 10 60 0F 00 04 08 {SEARCH}", homing),
        **several(f"{d} 10 60 06 00 02 04 {ZERO}"),
        **shown(device, "60 06", ZERO),
        **several(f"{d} 10 60 08 00 02 04 {lowest}"),
        **shown(device, "60 08", lowest),
        **several(f"{d} 10 60 00 00 01 02 00 02"),
        **shown(device, "60 00", "00 02"),
        **several(f"{d} 10 62 00 00 01 02 00 00"),
        **one(f"{d} 06 18 01 11 11"),
        **status(device, HOMED),
        **stands(device, ZERO, ZERO),
        **one(f"{d} 06 60 02 00 40"),
    }


UNHOMED_X = status(X, READY)
GOING = {**status(Z, RUNNING), **stands(Z, HALF, HALF), **one("02 06 60 02 00 40", "slowing")}
HOMED_REPLY = said(f"02 03 02 {HOMED}")
FLOOR = "FF FF D6 98"  # −26.5 mm, −10600 pulses


def fault(word: str, codes: str, number: int | None = None) -> Shown:
    """A status word under way and at rest; number: of an alarm."""
    alarm = shown(Z, "22 03", f"{(number or 0) >> 8:02X} {(number or 0) & 255:02X}")
    return Shown({**GOING, **status(Z, word), **alarm}, {**status(Z, word), **alarm}, (codes, codes, codes), number)


RTU = StageBytes(
    name="leadshine_rtu",
    kind="leadshine",
    source="CS2RS and iEM-RS user manuals; Modbus application protocol V1.1b3",
    identity="x: Leadshine drive 1, 400 pulses per turn; z: Leadshine drive 2, 400 pulses per turn",
    usual={
        **usual(X, "FF FF A2 40", "x is set"),  # −60 mm
        **usual(Z, "FF FF C1 80", "z is set"),  # −40 mm
        **several(f"02 10 62 00 00 07 0E {PATH}"),
        **shown(Z, "62 00", PATH),
        **one("02 06 60 02 00 10", "moving"),
        **several(f"02 10 60 08 00 02 04 {FLOOR}", "limited"),
        **several(f"02 10 62 00 00 07 0E {JOG}", "jog is set"),
        said("00 06 60 02 00 40"): (SILENCE, "rested"),
    },
    states={
        "new": {**UNHOMED_X, **status(Z, READY), **shown(X, "60 0F", CREEP), **shown(Z, "60 0F", CREEP)},
        "z is set": {**UNHOMED_X, **shown(Z, "60 0F", SEARCH), **one("02 06 60 02 00 20", "z homes")},
        "z homes": {**UNHOMED_X, said("02 03 10 03 00 01"): (said("02 03 02 00 06"), "z is home")},
        "z is home": UNHOMED_X,
        "x is set": {**UNHOMED_X, **shown(X, "60 0F", SEARCH), **one("01 06 60 02 00 20", "x homes")},
        "x homes": {said("01 03 10 03 00 01"): (said("01 03 02 00 06"), "home")},
        "home": {},
        "moving": GOING,
        "arrived": stands(Z, THERE, THERE),
        "elsewhere": stands(Z, THERE, ELSEWHERE),
        "held": {**GOING, **status(Z, DISABLED)},
        "alarm": {**status(Z, FAULT), **shown(Z, "22 03", "00 E0")},
        "slowing": {**GOING, said("02 03 10 03 00 01"): (said(f"02 03 02 {RUNNING}"), "rested")},
        "rested": stands(Z, HALF, HALF),
        "jog is set": {**shown(Z, "62 00", JOG), **one("02 06 60 02 00 10", "moving")},
        "limited": shown(Z, "60 08", FLOOR),
    },
    where=said("02 03 10 03 00 01"),
    move={"z_mm": -2.5, "speed_mm_s": 0.5},
    home=StageStatus("Idle", 0.0, Y_MM, 0.0),
    under_way=StageStatus("Run", 0.0, Y_MM, -1.25),
    arrived=StageStatus("Idle", 0.0, Y_MM, -2.5),
    trigger=said("02 06 60 02 00 10"),
    stop=[said("00 06 60 02 00 40")],  # a broadcast
    halt=said("02 06 60 02 00 40"),
    unlock=(said("02 06 18 01 11 11"), said("02 86 04"), "refused", 4),
    refusals={n: said(f"02 86 {n:02X}") for n in (1, 2, 3, 8)},
    alarm=0xE0,
    fault_words={
        0xE0: "over-current",
        0xC0: "over-voltage",
        0xA1: "current sensing",
        0x152: "motor phase",
        0x240: "EEPROM",
        0x123: "see its manual",
    },
    refusal_words={1: "illegal function", 2: "address", 3: "data value", 4: "failure", 8: "parity"},
    held=(StageError, "not_enabled"),
    garbled={
        "a wrong bit": Garbled(said("02 03 02 00 72"), StageError, "bad_crc", lambda f: f[:4] + b"\x62" + f[5:]),
        "of another device": Garbled(said("01 03 02 00 72"), StageError, "another_device"),
        "to another function": Garbled(said("02 06 10 03 00 72"), StageError, "does_not_fit"),
        "too many registers": Garbled(said("02 03 04 00 72 00 00"), StageError, "does_not_fit"),
        "cut short": Garbled(said("02 03 02 00 72"), StageTimeout, "incomplete", lambda f: f[:4]),
        "no such register": Garbled(said("02 83 02"), StageError, "refused"),
    },
    settings=[
        (said("02 03 00 01 00 01"), said("02 03 02 27 10"), "pulses per turn"),
        (said("01 03 00 01 00 01"), said("01 03 02 27 10"), "pulses per turn"),
    ],
    shows={
        **{f"alarm {code:X}": fault(FAULT, "alarm", code) for code in (0xE0, 0xC0, 0xA1, 0x152, 0x240, 0x123)},
        "disabled": fault(DISABLED, "not_enabled"),
        "no longer homed": fault(READY, "was_reset"),
    },
    ends={
        "homed": HomingEnd("z is home", status(Z, HOMED), True),
        **{
            name: HomingEnd("z is home", {said("02 03 10 03 00 01"): (HOMED_REPLY, "then")}, then=status(Z, word))
            for name, word in (("no longer homed", READY), ("moving again", RUNNING))
        },
    },
    alarmed=lambda devices: devices.z.fault(0xE0),
    not_on_twin=dict.fromkeys(
        (said("01 03 60 0F 00 04"), said("02 03 60 0F 00 04")), "the drive creeps before it homes: in state new"
    ),
    lacks={"search": "the status word does not show the home switch"},
    limit=Limit(
        -26.5,
        [said(f"02 10 60 08 00 02 04 {FLOOR}"), said("02 03 60 08 00 02"), said("02 03 60 00 00 01")],
        (said("02 03 60 08 00 02"), said("02 03 04 FF FF C1 80"), "not_as_configured"),
    ),
)


def crc(data: bytes) -> bytes:
    """CRC-16 of Modbus, low byte first."""
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0xA001 if register & 1 else 0)
    return register.to_bytes(2, "little")


def without_crc(frame: bytes) -> bytes:
    """The question in a frame of RTU."""
    assert crc(frame[:-2]) == frame[-2:], frame.hex(" ")
    return frame[:-2]


def frames_of_tcp(data: bytes) -> Sequence[bytes]:
    """Each with the header: its number, protocol 0, the length of what follows."""
    found = []
    while data:
        assert data[2:4] == b"\x00\x00", data.hex(" ")
        length = 6 + int.from_bytes(data[4:6], "big")
        found.append(data[:length])
        data = data[length:]
    return found


def with_header(frame: bytes, reply: bytes) -> bytes:
    """The reply in a frame of TCP, of the same number."""
    return frame[:4] + len(reply).to_bytes(2, "big") + reply


TCP = replace(
    RTU,
    name="leadshine_tcp",
    table={"framing": "tcp"},
    lacks={**RTU.lacks, "checksum": "frames of Modbus TCP have none"},
    stop=[said("02 06 60 02 00 40"), said("01 06 60 02 00 40")],
    garbled={name: one for name, one in RTU.garbled.items() if name != "a wrong bit"},  # nothing shows it
    frames=frames_of_tcp,
    heard=lambda frame: frame[6:],
    framed=lambda words: b"\x80\x01\x00\x00" + len(words).to_bytes(2, "big") + words,
    said=with_header,
)
OTHER_LENGTHS = other_lengths(RTU.usual)
RTU = replace(
    RTU,
    usual={**RTU.usual, **OTHER_LENGTHS},
    not_on_twin={**RTU.not_on_twin, **dict.fromkeys(OTHER_LENGTHS, "the program uses no register of the reply")},
    heard=without_crc,
    framed=lambda words: words + crc(words),
    said=lambda frame, reply: reply + crc(reply),
)
