"""Messages of every kind of device: what ends one, its numbers, what changes in it although nothing is said anew.

`LANGUAGES` has an entry for each kind that speaks otherwise than in lines of text.
"""

import re
import string
from collections.abc import Callable
from dataclasses import dataclass, replace

from rig.devices.registry import Room
from rig.settings import DeviceSettings


@dataclass(frozen=True)
class Language:
    """How a kind of device and its driver speak.

    shape: what a message is besides its numbers. content: a message with what changes although nothing is said anew,
    as its transaction and its checksum, set to zero. is_command: whether a message to a stage tells it something, and
    does not only ask. messages: one by one what comes at once. sealed: a checksum notices what changes on the way, so
    that a change is the same whatever the values are. Bytes that change places, which a sum does not notice, are not
    tried: no known cable exchanges two of them.
    """

    shape: Callable[[bytes], str]
    content: Callable[[bytes], bytes]
    is_command: Callable[[bytes], bool]
    messages: Callable[[bytes], list[bytes]]
    sealed: bool = False


def _as_it_is(data: bytes) -> bytes:
    return data


def _alone(data: bytes) -> list[bytes]:
    return [data]


def _never(data: bytes) -> bool:
    return False


# --- lines of text ---


def _masked(data: bytes) -> str:
    return re.sub(r"[0-9]", "#", data.decode("latin-1"))


def _tells(data: bytes) -> bool:
    return data.endswith((b"\r", b"\n")) and not data.startswith(b"?")


def _lines(data: bytes) -> list[bytes]:
    return data.splitlines(keepends=True)


LINES = Language(_masked, _as_it_is, _tells, _lines)
"""A line that begins with ? asks. GRBL's bytes in real time have no line end: they ask, or they stop."""

_CHAIN = re.compile(rb"([/@]\d+ \d+ )\d\d((?: .*)?:)[0-9A-F]{2}(\r?\n)", re.S)
_TELLS = re.compile(rb" \d\d (home|move|stop|estop|set|warnings clear)")


def _of_a_chain(data: bytes) -> bytes:
    """A line of a Zaber chain without its id and its checksum."""
    found = _CHAIN.fullmatch(data)
    return data if found is None else b"00".join(found.groups())


ZABER = replace(
    LINES,
    shape=lambda data: _masked(_of_a_chain(data)),
    content=_of_a_chain,
    is_command=lambda data: _TELLS.search(data) is not None,
    sealed=True,
)


# --- Modbus ---

_READ = 3


def _frame(body: bytes) -> str:
    """Device, function and place of a frame; of the answer to a reading, its length."""
    answers = body[1:2] == bytes([_READ]) and len(body) > 2 and body[2] == len(body) - 3
    return f"{body[: 3 if answers else 6].hex()} {len(body)}"


def _mbap(data: bytes) -> list[bytes]:
    """Frames of Modbus TCP."""
    found = list[bytes]()
    while data:
        length = 6 + int.from_bytes(data[4:6], "big") if len(data) >= 6 else len(data)
        found.append(data[:length])
        data = data[length:]
    return found


MODBUS = Language(
    shape=lambda data: _frame(data[:-2]),
    content=lambda data: data[:-2] + b"\0\0",
    is_command=lambda data: data[1:2] != bytes([_READ]),
    messages=_alone,
    sealed=True,
)
MODBUS_TCP = Language(
    shape=lambda data: _frame(data[6:]),
    content=lambda data: b"\0\0" + data[2:],
    is_command=lambda data: data[7:8] != bytes([_READ]),
    messages=_mbap,
)


# --- frames ---


def _letters(data: bytes) -> str:
    return f"{data[:4].hex()} {len(data)}"


XIMC = Language(
    shape=_letters,
    content=lambda data: data if len(data) == 4 else data[:-2] + b"\0\0",
    is_command=lambda data: data[:1] not in b"g\0",
    messages=_alone,
    sealed=True,
)
"""Four letters, which begin with g in a question, and perhaps a payload with its checksum; zero bytes realign it."""

_GET, _VERSION, _FIND = 6, 136, 13
TMCL = Language(
    shape=_letters,
    content=_as_it_is,
    is_command=lambda data: data[1] not in (_GET, _VERSION) and (data[1], data[2]) != (_FIND, 2),
    messages=_alone,
    sealed=True,
)
"""Nine bytes, the last of which is their sum."""

_TEXT, _RECORD_BYTES = set(string.printable.encode("ascii")), 36


def _is_page(data: bytes) -> bool:
    return set(data) <= _TEXT


NET_FT = Language(
    shape=lambda data: _masked(data) if _is_page(data) else f"record {len(data)}",
    content=lambda data: bytes(8) + data[8:] if len(data) == _RECORD_BYTES else data,
    is_command=_never,
    messages=lambda data: _lines(data) if _is_page(data) else [data],
    sealed=True,
)
"""Requests, records, which begin with two numbers that count on, and the lines of a page."""


LANGUAGES: dict[Room, dict[str, Language]] = {
    "stage": {"leadshine": MODBUS, "zaber": ZABER, "standa": XIMC, "tmcl": TMCL},
    "force": {"laumas": MODBUS, "net_ft": NET_FT},
}
"""The language of each kind, where that is not LINES; Modbus as RTU."""


def language(device: DeviceSettings) -> Language:
    """The language of a device in its framing."""
    found = LANGUAGES[device.room].get(device.kind, LINES)
    return MODBUS_TCP if found is MODBUS and getattr(device, "framing", None) == "tcp" else found
