"""ATI Net F/T: the page netftapi2.xml, and RDT records of 36 bytes that come by themselves."""

import itertools
import struct
from collections.abc import Sequence

from rig.devices.base import ForceBroken, ForceBusy, ForceError, ForceOverload, ForceTimeout, ForceUnderload
from tests.contracts.force import SILENCE, UNASKED, ForceBytes, NoWeight, Weight, Zeroing

GET = b"GET /netftapi2.xml HTTP/1.0\r\n\r\n"
START = bytes.fromhex("1234 0002 00000000")
COUNTS_PER_N, GRAMS_PER_N = 1_000_000, 1 / 9.80665e-3
PAGE = (
    b"HTTP/1.0 200 OK\r\nContent-Type: text/xml\r\n\r\n<?xml version='1.0'?>\r\n<netft>\r\n"
    b"<prodname>Ethernet Axia</prodname><setuserfilter>0</setuserfilter><cfgcpf>1000000</cfgcpf>"
    b"<cfgcpt>1000000</cfgcpt><scfgfu>N</scfgfu><scfgtu>Nm</scfgtu><comrdtrate>7000</comrdtrate></netft>"
)
TAGS = (b"netft", b"prodname", b"setuserfilter", b"cfgcpf", b"cfgcpt", b"scfgfu", b"scfgtu", b"comrdtrate")
_number = itertools.count(1)


def record(counts: int, status: int = 0) -> bytes:
    """A record with this Fz; its numbers are stamped as it is sent."""
    return struct.pack(">III6i", 0, 0, status, 1000, -2000, counts, 10, -20, 30)


def stamped(question: bytes, reply: bytes) -> bytes:
    """A reply as it is sent: a record gets the next numbers of the stream."""
    if question != UNASKED or len(reply) < 8:
        return reply
    number = next(_number)
    return struct.pack(">II", number, 8 * number) + reply[8:]


def alike(reply: bytes) -> bytes:
    """The status of a record, and which values a page has."""
    if len(reply) == 36:
        return reply[8:12]
    return b" ".join([reply[:15], *(tag for tag in TAGS if b"<%s>" % tag in reply)])


def _weight(counts: int) -> Weight:
    return Weight(record(counts), -counts / COUNTS_PER_N * GRAMS_PER_N, False)


def _records(*counts: int, status: int = 0) -> list[bytes]:
    return [record(one, status) for one in counts]


def _zeroing(*replies: bytes) -> dict[bytes, Sequence[bytes]]:
    return {UNASKED: list(replies)}


_NOT_STEADY = [record(-6_000 * (n % 5)) for n in range(4000)]  # three of them by 1.2 gwt at least, and 2.4 at most

NET_FT = ForceBytes(
    name="net_ft",
    kind="net_ft",
    table={"sample_period_s": 0.03},
    source="netft-cpp, netft_utils, CameronDevine/NetFT, ati-netft-cpp, pynetft",
    identity="Ethernet Axia, 1000000 counts per N, 1000000 counts per Nm",
    usual={GET: PAGE, START: SILENCE, UNASKED: record(-121_014)},
    on_connect=[GET, START],
    on_identify=[GET],
    max_age_s=0.02,
    reading=UNASKED,
    zero=b"no command",
    weights={
        "usual": _weight(-121_014),
        "negative": _weight(4_903),
        "nothing": _weight(0),
        "one count": _weight(-1),
        "the largest": _weight(-(2**31)),
    },
    refusals={
        "overload": NoWeight(record(-90_000_000, 0x80020000), ForceOverload, "saturated"),
        "underload": NoWeight(record(90_000_000, 0x80020000), ForceUnderload, "saturated"),
        "cell error": NoWeight(record(0, 0x80000008), ForceBroken, "sensor_error"),
        "monitor condition": NoWeight(record(0, 0x80010000), ForceError, "monitor_condition"),
        "summary alone": NoWeight(record(0, 0x80000000), ForceError, "monitor_condition"),
        **{
            f"bit {bit}": NoWeight(record(0, 1 << 31 | 1 << bit), ForceBroken, "sensor_error")
            for bit in (*range(2, 15), 18, 19, *range(20, 31))
        },
    },
    garbled={
        "half a record": NoWeight(record(0)[:18]),
        "a byte too many": NoWeight(record(0) + b"\0"),
        "text": NoWeight(b"not a record"),
    },
    zeroing={
        "at rest": Zeroing(_zeroing(*_records(3, 4, 5)), told=0),
        "never at rest": Zeroing(_zeroing(*_NOT_STEADY), ForceBusy, "no_stable_load", told=0),
        "overloaded": Zeroing(_zeroing(record(-9, 0x80020000)), ForceOverload, "saturated", told=0),
        "silent": Zeroing(_zeroing(SILENCE), ForceTimeout, "no_reply", told=0),
        "not confirmed": Zeroing(_zeroing(b"not a record"), ForceError, "garbled", told=0),
    },
    lacks={
        "busy": "a record is always that of a sample",
        "nan": "counts are whole numbers",
        "stable": "a record has no such bit",
    },
    said=stamped,
    alike=alike,
    not_on_twin={
        START: "records follow, which are what it sends unasked",
        "cell error": "many bits mean this, and the virtual sensor shows another one",
    },
    stream_s=0.005,
)
