"""Two Zaber X-series devices, x device 1 and z device 2, 400 microsteps in a mm: 2.5 mm down from home.

Frames are written without what their way adds: the message id, the checksum and the end of the line.
"""

from rig.devices.base import StageError, StageHeld, StageStatus, StageTimeout
from tests.contracts.stage import SILENCE, Garbled, HomingEnd, Replies, Shown, StageBytes

Y_MM = -15.0  # set by hand, as the configuration says by default


def axis(address: int, state: str, position: int) -> Replies:
    """What an axis says in a state, such as `IDLE --`; of a warning also the list of all."""
    flag = state.split()[1].encode("ascii")
    listed = b"00" if flag == b"--" else b"01 " + flag
    said = b"@%02d 1 OK %s " % (address, state.encode("ascii"))
    return {
        b"%d 1" % address: said + b"0",
        b"%d 1 get pos" % address: said + b"%d" % position,
        b"%d 1 warnings" % address: said + listed,
        b"%d 1 stop" % address: said + b"0",
    }


def usual(address: int, longest: int) -> Replies:
    """Identity, settings, and what is obeyed at once."""
    a = b"%d" % address
    ok = b"@%02d 1 OK IDLE -- " % address
    of_device = b"@%02d 0 OK IDLE -- " % address
    return {
        **axis(address, "IDLE --", 0),
        a + b" 0 get deviceid": of_device + b"50081",
        a + b" 0 get version": of_device + b"7.38",
        a + b" 1 get resolution": ok + b"64",
        a + b" 1 get accel": ok + b"4",
        a + b" 1 get limit.min": ok + b"0",
        a + b" 1 get limit.max": ok + b"%d" % longest,
        a + b" 1 warnings clear": ok + b"00",
    }


BUSY = b"@02 1 OK BUSY -- 0"


def content(frame: bytes) -> bytes:
    """The command without its id; its checksum is right: the sum of all bytes is a multiple of 256."""
    body, _, seal = frame[1:-1].rpartition(b":")
    assert frame[:1] == b"/", frame
    assert (sum(body) + int(seal, 16)) % 256 == 0, frame
    device, number, ident, *words = body.split(b" ")
    assert len(ident) == 2, frame
    return b" ".join([device, number, *words])


def framed(words: bytes) -> bytes:
    """The command with the id 07, a checksum and the end of the line."""
    device, number, *rest = words.split(b" ")
    body = b" ".join([device, number, b"07", *rest])
    return b"/%s:%02X\n" % (body, -sum(body) & 0xFF)


def sealed(frame: bytes, reply: bytes) -> bytes:
    """The reply with the id of the command, a checksum and the end of the line."""
    _, _, ident, *_ = frame[1:].split(b":")[0].split(b" ")
    device, number, *words = reply.split(b" ")
    body = b" ".join([device, number, ident, *words])
    return body + b":%02X\r\n" % (-sum(body[1:]) & 0xFF)


def shown(flag: str, *codes: str, number: str | None = None) -> Shown:
    """A warning, under way and at rest."""
    return Shown(axis(2, f"BUSY {flag}", 500), axis(2, f"IDLE {flag}", 0), (codes[0], codes[1], codes[2]), number)


FAULTS = (
    "FF", "FN", "FZ", "FH", "FV", "FO", "FC", "FM", "FD", "FQ", "FI", "FA", "FR", "FS", "FB", "FP", "FE", "FT", "WL",
    "WS", "WM", "ZZ",
)  # fmt: skip
"""WM: moved while standing; ZZ is unknown."""

DEVICE = StageBytes(
    name="zaber",
    kind="zaber",
    source="Zaber ASCII protocol manual, firmware 6 and 7; transcripts of zaber-motion 10.3.0",
    identity=(
        "x: Zaber device 1, axis 1, id 50081, firmware 7.38; z: Zaber device 2, axis 1, id 50081, firmware 7.38"
    ),
    usual={
        **usual(1, 24000),
        **usual(2, 16000),
        b"2 1 home": (b"@02 1 OK BUSY WR 0", "z homes"),
        b"1 1 home": (b"@01 1 OK BUSY WR 0", "x homes"),
        b"2 1 move abs 1000 327": (BUSY, "moving"),
        b"2 1 move abs 40 655": (BUSY, "moving"),  # a jog, 0.1 mm at 1 mm/s
        b"2 1 move rel 40 655": (BUSY, "moving"),  # the same, not homed
        b"0 0 stop": (SILENCE, "rested"),
        b"0 0 estop": (SILENCE, "rested"),
    },
    states={
        "new": {
            **axis(1, "IDLE WR", 0),
            **axis(2, "IDLE WR", 0),
            b"2 1 home": (b"@02 1 OK BUSY WR 0", "z homes"),
            b"1 1 home": (b"@01 1 OK BUSY WR 0", "x homes"),
        },
        "z homes": {
            **axis(1, "IDLE WR", 0),
            **axis(2, "BUSY WR", 0),
            b"2 1 get pos": (b"@02 1 OK BUSY WR 4000", "z is home"),
        },
        "z is home": axis(1, "IDLE WR", 0),
        "x homes": {**axis(1, "BUSY WR", 0), b"1 1 get pos": (b"@01 1 OK BUSY WR 4000", "home")},
        "home": {},
        "moving": {**axis(2, "BUSY --", 500), b"2 1 stop": (b"@02 1 OK BUSY NI 0", "slowing")},
        "arrived": axis(2, "IDLE --", 1000),
        "elsewhere": axis(2, "IDLE --", 990),
        "held": axis(2, "BUSY NC", 500),
        "alarm": axis(2, "IDLE FS", 500),
        "slowing": {**axis(2, "BUSY NI", 510), b"2 1": (b"@02 1 OK BUSY NI 0", "rested")},
        "rested": axis(2, "IDLE NI", 520),
    },
    where=b"2 1 get pos",
    move={"z_mm": -2.5, "speed_mm_s": 0.5},
    home=StageStatus("Idle", 0.0, Y_MM, 0.0),
    under_way=StageStatus("Run", 0.0, Y_MM, -1.25),
    arrived=StageStatus("Idle", 0.0, Y_MM, -2.5),
    trigger=b"2 1 move abs 1000 327",
    stop=[b"0 0 stop"],
    halt=b"2 1 stop",
    unlock=(b"2 1 warnings clear", b"@02 1 RJ IDLE FS BADCOMMAND", "line_refused", "BADCOMMAND"),
    refusals={
        word: f"@02 1 RJ IDLE FS {word}".encode()
        for word in ("AGAIN", "BADAXIS", "BADDATA", "DEVICEONLY", "DRIVERDISABLED", "FULL", "NOACCESS", "REMOTE")
    },
    alarm="FS",
    fault_words={
        "FF": "critical system error",
        "FN": "not supported",
        "FZ": "inactive",
        "FH": "emergency stop",
        "FV": "voltage",
        "FO": "driver disabled",
        "FC": "inrush",
        "FM": "temperature",
        "FD": "driver disabled",
        "FQ": "encoder error",
        "FI": "index",
        "FA": "synchronization",
        "FR": "overdrive",
        "FS": "stalled and stopped",
        "FB": "stream bounds",
        "FP": "path deviation",
        "FE": "limit sensor not reached",
        "FT": "twist",
        "WL": "unexpected limit",
        "WS": "stalled and recovered",
        "WM": "moved while standing",
        "ZZ": "unknown",
    },
    refusal_words={
        "BADCOMMAND": "unknown command",
        "AGAIN": "possible",
        "BADAXIS": "no such axis",
        "BADDATA": "out of range",
        "DEVICEONLY": "of the device",
        "DRIVERDISABLED": "disabled",
        "FULL": "storage",
        "NOACCESS": "access level",
        "REMOTE": "mode",
    },
    held=(StageHeld, "held"),
    garbled={
        "a wrong bit": Garbled(b"@02 1 OK IDLE -- 0", StageError, "garbled", lambda f: f.replace(b"IDLE", b"IDLD")),
        "no checksum": Garbled(b"@02 1 OK IDLE -- 0", StageError, "no_checksum", lambda f: f[:-5] + f[-2:]),
        "of another device": Garbled(b"@03 1 OK IDLE -- 0", StageTimeout, "no_reply"),
        "of another axis": Garbled(b"@02 2 OK IDLE -- 0", StageTimeout, "no_reply"),
        "cut short": Garbled(b"@02 1 OK IDLE -- 0", StageError, "garbled", lambda f: f[:9] + b"\r\n"),
        "half a line": Garbled(b"@02 1 OK IDLE -- 0", StageTimeout, "no_reply", lambda f: f[:9]),
        "no number": Garbled(b"@02 1 OK IDLE -- nan", StageError, "no_number"),
        "an alert": Garbled(b"@02 1 OK IDLE -- 0", StageTimeout, "no_reply", lambda f: b"!02 1 IDLE --:95\r\n"),
        "a byte that is none of ASCII": Garbled(
            b"@02 1 OK IDLE -- 0", StageError, "garbled", lambda f: f.replace(b"OK", b"O\xcb")
        ),
    },
    settings=[
        (b"2 1 get resolution", b"@02 1 OK IDLE -- 128", "resolution"),
        (b"2 1 get accel", b"@02 1 OK IDLE -- 3", "accel"),
        (b"1 1 get limit.max", b"@01 1 OK IDLE -- 23999", "limit.max"),
        (b"2 1 get limit.max", b"@02 1 OK IDLE -- 15999", "limit.max"),
        *(
            (b"1 0 get version", b"@01 0 OK IDLE -- " + version, "firmware")
            for version in (b"7.24", b"6.28", b"beta")
        ),
    ],
    shows={
        **{flag: shown(flag, "alarm", "alarm", "alarm", number=flag) for flag in FAULTS},
        **{flag: shown(flag, "was_reset", "was_reset", "was_reset") for flag in ("WR", "WH")},
        "somebody at the knob": shown("NC", "held", "", ""),
        "interrupted": shown("NI", "overridden", "", ""),
        **{flag: shown(flag, "", "", "") for flag in ("WV", "WT", "WP", "ND", "NR", "NT", "NU", "NJ", "NB")},
    },
    ends={
        **{flag: HomingEnd("z is home", axis(2, f"IDLE {flag}", 0)) for flag in ("NI", "WR", "WH")},
        **{f"at {at}": HomingEnd("z is home", axis(2, "IDLE --", at), abs(at) < 2) for at in (-2, -1, 1, 2)},
        **{flag: HomingEnd("z is home", axis(2, f"IDLE {flag}", 0), True) for flag in ("WV", "NC")},
    },
    lacks={
        "limit": "limits are stored permanently: they are written once, at homing, if they differ",
        "search": "a reply does not show the home sensor",
    },
    frames=lambda data: data.splitlines(keepends=True),
    heard=content,
    framed=framed,
    alarmed=lambda devices: devices.z.stall(),
    said=sealed,
    not_on_twin={
        **dict.fromkeys(
            (b"1 1 home", b"2 1 home"), "the warning WR is that of an axis that is not homed: in state new"
        ),
        **dict.fromkeys((b"0 0 stop", b"0 0 estop"), "every device replies to a broadcast, and nobody waits for it"),
    },
)
