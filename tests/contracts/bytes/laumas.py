"""A Laumas TLB or TLU transmitter over Modbus RTU and over Modbus TCP: transmitter 1, counts of 0.01 g.

Frames are written without what their way adds: the CRC of RTU, computed here bit by bit, and the header of TCP.
"""

from collections.abc import Mapping
from typing import Any

from rig.devices.base import ForceBroken, ForceBusy, ForceError, ForceOverload, ForceTimeout, ForceUnderload
from tests.contracts.force import SILENCE, ForceBytes, NoWeight, Weight, Zeroing
from tests.contracts.other_lengths import other_lengths

SOURCE = "Laumas TLU manual, list of registers; LCB manual, status register 1 (second-hand for TLB and TLU)"
WHO = bytes.fromhex("01 03 00 00 00 04")
ASK = bytes.fromhex("01 03 00 06 00 08")
ZERO = bytes.fromhex("01 10 00 05 00 01 02 00 08")
OBEYED = bytes.fromhex("01 10 00 05 00 01")
OTHER_LENGTHS = other_lengths([WHO, ASK])


def shown(status: str, gross: str, units: str = "01 0C") -> bytes:
    """Registers 6 … 13: status, gross, net, peak, division and unit."""
    return bytes.fromhex(f"01 03 10 {status} {gross} 00 00 00 00 00 00 00 00 {units}")


GOOD, MOVING, ZEROED = shown("08 00", "00 00 00 E9"), shown("00 00", "00 00 00 C8"), shown("18 00", "00 00 00 00")
WEIGHTS = {
    "stable": Weight(GOOD, 2.33, True),
    "moving, both words": Weight(shown("00 00", "00 01 86 A0"), 1000.0, False),
    "bit 7, the minus of gross": Weight(shown("00 80", "00 00 00 E9"), -2.33, False),
    "bit 8, the minus of net": Weight(shown("01 00", "00 00 00 E9"), 2.33, False),
    "nothing": Weight(ZEROED, 0.0, True),
}
REFUSALS = {
    "overload": NoWeight(shown("00 04", "00 00 00 E9"), ForceOverload, "over_max"),
    "underload": NoWeight(shown("00 84", "00 00 00 E9"), ForceUnderload, "over_max"),
    "bit 3": NoWeight(shown("00 08", "00 00 00 E9"), ForceOverload, "over_full_scale"),
    "bit 3, minus": NoWeight(shown("00 88", "00 00 00 E9"), ForceUnderload, "over_full_scale"),
    "bit 4": NoWeight(shown("00 10", "00 00 00 E9"), ForceOverload, "gross_out_of_range"),
    "bit 4, minus": NoWeight(shown("00 90", "00 00 00 E9"), ForceUnderload, "gross_out_of_range"),
    "bit 5": NoWeight(shown("00 20", "00 00 00 E9"), ForceOverload, "net_out_of_range"),
    "bit 5, minus": NoWeight(shown("00 A0", "00 00 00 E9"), ForceUnderload, "net_out_of_range"),
    "cell error": NoWeight(shown("00 01", "00 00 00 E9"), ForceBroken, "cell_error"),
    "cell error, stable": NoWeight(shown("08 01", "00 00 00 E9"), ForceBroken, "cell_error"),
    "converter error": NoWeight(shown("00 02", "00 00 00 E9"), ForceBroken, "converter_error"),
    "kilograms": NoWeight(shown("08 00", "00 00 00 E9", units="00 0C"), ForceError, "wrong_unit"),
    **{
        f"exception {number}": NoWeight(bytes([1, 0x83, number]), ForceError, "refused")
        for number in (1, 2, 3, 4, 7, 8)
    },
}
NOT_NOW = {
    name: NoWeight(bytes([1, 0x83, number]), ForceError, "busy")
    for name, number in {"acknowledged": 5, "busy": 6, "gateway busy": 10, "silence behind a gateway": 11}.items()
}
GARBLED = {
    "of another device": NoWeight(b"\x02" + GOOD[1:]),
    "to another function": NoWeight(b"\x01\x04" + GOOD[2:]),
    "too few registers": NoWeight(b"\x01\x03\x0e" + GOOD[3:-2]),
    "cut short": NoWeight(GOOD, ForceTimeout, "no_reply", lambda frame: frame[:9]),
}
ZEROING = {
    "at rest": Zeroing({ASK: [MOVING, GOOD, ZEROED]}),
    "a count is left": Zeroing({ASK: [GOOD, shown("08 00", "00 00 00 01")]}),
    "never at rest": Zeroing({ASK: [MOVING]}, ForceBusy, "no_stable_load", told=0),
    "overloaded": Zeroing({ASK: [REFUSALS["overload"].reply]}, ForceOverload, "over_max", told=0),
    "underloaded": Zeroing({ASK: [REFUSALS["underload"].reply]}, ForceUnderload, "over_max", told=0),
    "not obeyed": Zeroing({ASK: [GOOD]}, ForceBusy, "not_zeroed"),
    "two counts are left": Zeroing({ASK: [GOOD, shown("08 00", "00 00 00 02")]}, ForceBusy, "not_zeroed"),
    "two counts of pull are left": Zeroing({ASK: [GOOD, shown("08 80", "00 00 00 02")]}, ForceBusy, "not_zeroed"),
    "refused": Zeroing({ZERO: [bytes.fromhex("01 90 03")]}, ForceError, "refused"),
    "busy": Zeroing(
        {ZERO: [bytes.fromhex("01 90 06"), OBEYED], ASK: [bytes.fromhex("01 83 06"), GOOD, ZEROED]}, told=2
    ),
    "acknowledged": Zeroing({ZERO: [bytes.fromhex("01 90 05")]}, ForceError, "busy"),
    "silence behind a gateway": Zeroing({ZERO: [bytes.fromhex("01 90 0B")]}, ForceError, "busy"),
    "silent": Zeroing({ZERO: [SILENCE]}, ForceTimeout, "no_reply"),
    "not confirmed": Zeroing({ZERO: [bytes.fromhex("01 10 00 06 00 01")]}, ForceError, "garbled"),
}


def _alike(frame: bytes) -> bytes:
    """Status, gross weight and unit; of one that cannot be weighed its reason, and of an identity its length.

    Without the sign of the net weight, which has that of the gross weight where there is no tare.
    """
    for words, length in ((bytes.fromhex("01 03 10"), 19), (bytes.fromhex("01 03 08"), 3)):
        start = frame.find(words)
        if start >= 0:
            frame = frame[start : start + length]
            break
    if len(frame) < 19:
        return frame
    status = int.from_bytes(frame[3:5], "big") & ~0x0100
    reason = status & 0x0005
    return b"%04X " % (status & 0x0085) if reason else b"%04X " % status + frame[5:9] + frame[17:]


def _crc(data: bytes) -> bytes:
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc.to_bytes(2, "little")


def _rtu_question(frame: bytes) -> bytes:
    assert _crc(frame[:-2]) == frame[-2:]
    return frame[:-2]


def _tcp_question(frame: bytes) -> bytes:
    assert frame[2:6] == (len(frame) - 6).to_bytes(4, "big")
    return frame[6:]


def _tcp_reply(question: bytes, reply: bytes) -> bytes:
    """It has the number of its question."""
    return question[:2] + len(reply).to_bytes(4, "big") + reply


def _device(name: str, table: Mapping[str, Any], garbled: Mapping[str, NoWeight], **way: Any) -> Any:
    return ForceBytes(
        name=name,
        kind="laumas",
        table={"baud": 115200, **table},
        source=SOURCE,
        identity="Laumas transmitter type 30, serial 1234 of 2024, firmware 261",
        usual={
            WHO: bytes.fromhex("01 03 08 01 05 00 1E 07 E8 04 D2"),
            ASK: GOOD,
            ZERO: OBEYED,
            **OTHER_LENGTHS,
        },
        on_connect=[WHO, ASK],
        on_identify=[WHO, ASK],
        again=() if table else list(OTHER_LENGTHS),
        max_age_s=0.4,
        reading=ASK,
        zero=ZERO,
        weights=WEIGHTS,
        refusals=REFUSALS,
        garbled={**GARBLED, **garbled},
        zeroing=ZEROING,
        not_now=NOT_NOW,
        alike=_alike,
        not_on_twin={
            **dict.fromkeys(OTHER_LENGTHS, "the program uses no register of the reply"),
            "bit 8, the minus of net": "without a tare the net weight has the sign of the gross weight",
            "underload": "the virtual transmitter shows such a pull as a gross weight out of range, bit 4",
            "moving, both words": "1000 g is more than the virtual transmitter weighs",
        },
        lacks={"nan": "a weight is a whole number of counts"},
        **way,
    )


RTU = _device(
    "laumas_rtu",
    {},
    {"bad CRC": NoWeight(GOOD, mangled=lambda frame: frame[:-1] + bytes([frame[-1] ^ 1]))},
    heard=_rtu_question,
    framed=lambda question: question + _crc(question),
    said=lambda question, reply: reply + _crc(reply),
)
TCP = _device(
    "laumas_tcp",
    {"framing": "tcp"},
    {"to another question": NoWeight(GOOD, ForceTimeout, "no_reply", lambda frame: b"\x00\x01" + frame[2:])},
    heard=_tcp_question,
    framed=lambda question: b"\x80\x01\x00\x00" + len(question).to_bytes(2, "big") + question,
    said=_tcp_reply,
)
