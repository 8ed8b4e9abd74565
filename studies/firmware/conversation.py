"""A fixed conversation with a GRBL board, for a comparison line by line."""

import re
from collections.abc import Iterator

from rig.clock import Clock
from rig.transport import LineReader, Transport

ANSWER_S = 5.0
QUIET_S = 0.3
RESET, JOG_CANCEL = b"\x18", b"\x85"
OVERRIDES = (b"\x90", b"\x95", b"\x99")
# What the rig's stage has, without switches to home on.
SETTINGS = (
    *("$13=0", "$20=0", "$21=0", "$22=0", "$27=1", "$32=0"),
    *("$100=400", "$101=400", "$102=400", "$110=600", "$111=600", "$112=300"),
    *("$120=50", "$121=50", "$122=50", "$130=60", "$131=30", "$132=40"),
)
HEADER = (
    "G17 G21 G90 G94", "G40", "G49", "G80", "G61", "G18", "G19", "G17", "G91.1", "G54", "G55", "$G", "G54", "X1",
    "G10 L2 P1 X1", "G92 X0", "G43.1 Z1", "G0",
)  # fmt: skip
OFFSETS = (
    "G10 L2 P1 X1 Y2 Z3", "$#", "?", "?", "G10 L20 P2 X0 Y0 Z0", "G92 X0.5", "$#", "G92.1", "G10 L2 P1 X0 Y0 Z0",
    "G28.1", "G30.1", "$#", "G43.1 Z1.5", "$#", "?", "G49", "G59", "$G", "M2", "M30", "$G", "M0", "~",
)  # fmt: skip
WORDS = (
    "G90.1", "G41", "G43", "G61.1", "G93", "G94", "G1.5", "G4", "G4 P0.01", "G4 P-1", "M7", "M1", "M3 S1000", "M5",
    "M8", "M9", "M8 M9", "M1.5", "M6", "T1", "T255", "T256", "T-1", "N1", "N10000000", "N10000001", "N-1", "S-1",
    "F-1", "F60", "G0 G1", "G1 G28", "G10 G92 X1", "G28 G0 X1", "G28 X1 G1", "G10 L3 P1 X1", "G10 L2 P9 X1",
    "G10 P1 X1", "G10 L2 P1", "G10 L2 P1 R1 X1", "G92", "G43.1 X1", "G2 X1", "G2 X1 Y1 R1 F60", "G80", "X1", "G0",
    "G1 F0", "G1 X1 F0", "G1 X-0.1 X-0.1", "F", "G", "GX", "=", "1", "X1-", "G38.2 X1", "P1", "G53 X1", "G80",
    "G53 G0 X0 Y0", "H1", "L1", "G20", "$G", "G21", "$J=X1", "$J=G91 F100", "$J=G91 G1 X1 F100", "$J=G91 X1 F100 M8",
    "$JX", "$J=G91 X0 F0", "G91 G0 X0", "G90", "G1 F600",
)  # fmt: skip
SYSTEM = (
    "$", "$I", "$I=rig", "$I", "$I=", "$N", "$N0=", "$N0=G90", "$N", "$N0=", "$N0=G1X", "$N5=", "$C", "$G", "G1 X1",
    "?", "G1 X1 F100", "X2 Y", "$C", "$X", "$13=1", "$13=1.5", "$13=2", "?", "?", "$#", "$G", "G21 G1 F100", "$G",
    "M3 S500", "?", "M5", "$J=G91 X0.5 F300", "?", "?", "G4 P0.2", "$13=0", "?", "$999=1", "$100", "$100=x", "$100=",
    "$-1=1", "$110=-1", "$0=1", "$20=1", "$foo", "$$x", "$Gx", "$Hx", "$H", "$Ix", "$#x", "$RST=x", "$SL", "$1.5=2",
    "$1=25", "(a comment)", "", "/G90", "g90 ; lower case", "G90" + "N1".ljust(76, "0"), "G90" + "N1".ljust(77, "0"),
    "G90" + "N1".ljust(90, "0"), "x" * 300,
)  # fmt: skip
OVERRIDDEN = (
    "?", "?", b"\x91", "?", "?", b"\x92", b"\x92", "?", "?", b"\x93", "?", b"\x94", b"\x94", "?", b"\x90", "?",
    *(b"\x91",) * 11, "?", "?", *(b"\x92",) * 20, "?", "?", b"\x90", "?", b"\x96", "?", b"\x97", "?", b"\x95", "?",
    b"\x9a", "?", b"\x9b", b"\x9b", "?", b"\x9c", "?", b"\x9d", b"\x9d", "?", "M3 S1000", b"\x9a", "?", "?", b"\x9e",
    "?", "M5", b"\x99", "?", "?", b"\xa0", "?", "?", b"\xa0", "?", "?", b"\x91\x96\x9a", "?", "?", "M2", "?", "?",
    b"\x91", RESET, "?", "?",
)  # fmt: skip
LIMITS = (
    "$22=1", "$20=1", "?", "$J=G91 X-5000 F100", "G53 G1 X-5000 F100", *("?",) * 4, RESET, "?", "G90",
    "$J=G91 X-1 F100", "$X", "?", "$20=0", "$22=0", "$20=0", "?",
)  # fmt: skip
CONVERSATION: tuple[str | bytes, ...] = tuple(
    sent for part in (HEADER, OFFSETS, WORDS, SYSTEM, OVERRIDDEN, LIMITS) for sent in (RESET, "$X", "G0", *part)
)
FLOOD = 50


def exchanges(transport: Transport, clock: Clock) -> Iterator[tuple[str, list[str]]]:
    """What was sent, and the lines that came of it until it was quiet: a line has its answer, a byte need not."""
    reader = LineReader(transport, clock)
    for sent in CONVERSATION:
        ends = isinstance(sent, str) and sent not in ("?", "~")
        transport.write(sent if isinstance(sent, bytes) else (sent + "\n" if ends else sent).encode("ascii"))
        heard = listen(reader, clock, until_answered=ends)
        yield (sent if isinstance(sent, str) else sent.hex(" ")), heard


def listen(reader: LineReader, clock: Clock, *, until_answered: bool) -> list[str]:
    heard: list[str] = []
    deadline_s = clock.monotonic_s() + (ANSWER_S if until_answered else QUIET_S)
    while (line := reader.read_line(deadline_s)) is not None:
        heard.append(line)
        deadline_s = clock.monotonic_s() + QUIET_S
    return heard


def set_up(transport: Transport, clock: Clock) -> list[str]:
    """At rest, at zero, unlocked, with SETTINGS; returns the `$$` that the board then has."""
    reader = LineReader(transport, clock)
    for sent in (*OVERRIDES, RESET):
        transport.write(sent)
    listen(reader, clock, until_answered=False)
    for line in ("$X", *SETTINGS, "G10 L2 P1 X0 Y0 Z0", "G92.1"):
        transport.write(line.encode("ascii") + b"\n")
        listen(reader, clock, until_answered=True)
    transport.write(b"$$\n")
    return listen(reader, clock, until_answered=True)


def reports_of_a_flood(transport: Transport, clock: Clock) -> int:
    """How many of FLOOD status requests in one write are answered."""
    reader = LineReader(transport, clock)
    transport.write(b"?" * FLOOD)
    return sum(line.startswith("<") for line in listen(reader, clock, until_answered=False))


def comparable(line: str) -> str:
    """Without what hangs on how a firmware was built: pins of a host without switches."""
    return re.sub(r"\|Pn:\w+", "", line)
