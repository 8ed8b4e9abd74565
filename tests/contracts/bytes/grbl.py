"""A GRBL 1.1 board at 115200 baud: 10 mm down from home, and what it says on the way."""

import re

from rig.devices.base import StageHeld, StageStatus, StageTimeout
from tests.contracts.stage import SILENCE, Garbled, Shown, StageBytes

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
LOCKED = b"[MSG:'$H'|'$X' to unlock]\r\n"
OK = b"ok\r\n"
WHO, WHERE, RESET, HOLD, FULL_SPEED = b"$I\n", b"?", b"\x18", b"!", b"\x90\x95\x99"
SETTINGS = (
    b"$3=0\r\n$13=0\r\n$20=1\r\n$22=1\r\n$23=0\r\n$27=1.000\r\n$32=0\r\n"
    b"$100=400.000\r\n$101=400.000\r\n$102=400.000\r\n$110=600.000\r\n$111=600.000\r\n$112=600.000\r\n"
    b"$120=50.000\r\n$121=50.000\r\n$122=50.000\r\n$130=60.000\r\n$131=30.000\r\n$132=40.000\r\nok\r\n"
)
# Work zero goes to the target and is read back as WCO; the trigger is the same for every move.
TARGET, MODES, TRIGGER = b"G92X0Y0Z10G90G21G94F300\n", b"$G\n", b"G1Z0\n"
SHOWN = b"[GC:G1 G54 G17 G21 G90 G94 M5 M9 T0 F300 S0]\r\nok\r\n"
AT_HOME = b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0|WCO:-1.000,-1.000,-11.000>\r\n"
GOING = b"<Run|MPos:-1.000,-1.000,-6.000|FS:300,0>\r\n"
THERE = b"<Idle|MPos:-1.000,-1.000,-11.000|FS:0,0|Ov:100,100,100>\r\n"
JOG_TARGET = b"G92X0Y0Z0.1G90G21G94F60\n"
LISTED = {line.split(b"=")[0] for line in SETTINGS.split(b"\r\n") if line.startswith(b"$")}
OWN = re.compile(rb"\|(WCO|Ov):[-0-9.,]+|(?<=1\.1h\.)[0-9]+|(?<=^\$1[13][0-2]=)[0-9.]+", re.MULTILINE)


def alike(reply: bytes) -> bytes:
    """Without fields that come now and then, the date of the firmware, and settings that are those of each board."""
    lines = OWN.sub(b"", reply).split(b"\r\n")
    return b"\r\n".join(line for line in lines if line[:1] != b"$" or line.split(b"=")[0] in LISTED)


DEVICE = StageBytes(
    name="grbl",
    kind="grbl",
    source="GRBL 1.1 interface wiki; recorded from the 1.1h firmware (tests/data/firmware)",
    identity="[VER:1.1h.20190825:] [OPT:V,15,128]",
    usual={
        WHO: b"[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\nok\r\n",
        FULL_SPEED: SILENCE,
        b"$$\n": SETTINGS,
        WHERE: AT_HOME,
        b"$H\n": (SILENCE, "homing"),
        b"$X\n": OK,
        JOG_TARGET: OK,
        TARGET: OK,
        MODES: SHOWN,
        TRIGGER: (OK, "moving"),
        HOLD: (SILENCE, "slowing"),
        RESET: (BANNER, "new"),
        HOLD + RESET: (b"ALARM:3\r\n" + BANNER, "new"),
    },
    states={
        "new": {WHERE: b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n"},
        "homing": {WHERE: (b"<Home|MPos:-1.000,-1.000,-1.000|FS:0,0>\r\nok\r\n", "home")},
        "home": {},
        "moving": {WHERE: GOING, HOLD + RESET: (b"ALARM:3\r\n" + BANNER + LOCKED, "new")},
        "arrived": {WHERE: THERE, MODES: SHOWN},
        "elsewhere": {WHERE: b"<Idle|MPos:-1.000,-1.000,-10.900|FS:0,0>\r\n"},
        "held": {
            WHERE: b"<Hold:0|MPos:-1.000,-1.000,-6.000|FS:0,0>\r\n",
            TARGET: SILENCE,
            RESET: (BANNER, "rested"),
        },
        "alarm": {WHERE: b"ALARM:1\r\n[MSG:Reset to continue]\r\n"},
        "slowing": {WHERE: (b"<Hold:1|MPos:-1.000,-1.000,-6.000|FS:300,0>\r\n", "held")},
        "rested": {WHERE: b"<Idle|MPos:-1.000,-1.000,-6.500|FS:0,0>\r\n"},
    },
    where=WHERE,
    move={"z_mm": -11.0, "speed_mm_s": 5.0},
    home=StageStatus("Idle", -1.0, -1.0, -1.0),
    under_way=StageStatus("Run", -1.0, -1.0, -6.0),
    arrived=StageStatus("Idle", -1.0, -1.0, -11.0),
    trigger=TRIGGER,
    stop=[HOLD + RESET],
    halt=HOLD,
    unlock=(b"$X\n", b"error:9\r\n", "line_refused", 9),
    refusals={n: b"error:%d\r\n" % n for n in (1, 2, 3, 4, 8, 20, 22, 23, 24, 27, 38, 53)},
    alarm=1,
    fault_words={1: "hard limit"},
    refusal_words={
        1: "letter",
        2: "number",
        3: "unknown $",
        4: "negative",
        8: "busy",
        9: "locked",
        20: "unsupported",
        22: "feed rate",
        **dict.fromkeys((23, 24, 27, 38, 53), ""),
    },
    held=(StageHeld, "held"),
    garbled={
        "a byte that is none of ASCII": Garbled(b"<Idle|MPos:-1.0\xf3,-2\r\n", StageTimeout, "no_status"),
        "cut short": Garbled(b"<Idle|MPos:-1.000,-1\r\n", StageTimeout, "no_status"),
        "two in one": Garbled(b"<Idle|MPos:-1.0<Idle|MPos:-1.000,-1.000,-1.000>\r\n", StageTimeout, "no_status"),
        "no number": Garbled(b"<Idle|MPos:nan,-1.000,-1.000>\r\n", StageTimeout, "no_status"),
        "infinity": Garbled(b"<Idle|MPos:-1.000,inf,-1.000>\r\n", StageTimeout, "no_status"),
        "another line": Garbled(b"[MSG:hm]\r\n", StageTimeout, "no_status"),
        "half a line": Garbled(b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0>", StageTimeout, "no_status"),
    },
    settings=[
        (b"$$\n", SETTINGS.replace(b"$13=0", b"$13=1"), "$13=0"),
        (b"$$\n", SETTINGS.replace(b"$22=1", b"$22=0"), "$22=1"),
        (b"$$\n", SETTINGS.replace(b"$32=0", b"$32=1"), "$32=0"),
        (b"$$\n", SETTINGS.replace(b"$130=60", b"$130=59"), "$130=60"),
        (b"$$\n", SETTINGS.replace(b"$23=0", b"$23=4"), "$23=0"),
    ],
    shows={
        **{
            state: Shown({WHERE: GOING.replace(b"Run", text)}, {WHERE: AT_HOME.replace(b"Idle", text)}, codes)
            for state, text, codes in (
                ("a hold", b"Hold:0", ("held", "", "held")),
                ("a door", b"Door:1", ("held", "", "held")),
            )
        },
        **{
            f"override {text.decode()}": Shown(
                {WHERE: GOING.replace(b"|FS", b"|Ov:" + text + b"|FS")},
                {WHERE: AT_HOME.replace(b"|FS", b"|Ov:" + text + b"|FS")},
                ("overridden", "", "overridden"),
            )
            for text in (b"90,100,100", b"100,50,100", b"100,100,90")
        },
    },
    alike=alike,
    not_on_twin={
        MODES: "G1 is modal after the first move: in state arrived",
        HOLD + RESET: "the alarm is that of a reset under way: in state moving",
        "alarm": "the board has no limit switches that stop it ($21=0)",
    },
    lacks={
        "limit": "soft limits are stored in a memory that wears out: they are written once, by connect()",
        "checksum": "lines of GRBL have none",
        "search": "the board itself ends a search that finds no switch",
        "ends": "the board reports a homing that fails as an alarm",
    },
)
