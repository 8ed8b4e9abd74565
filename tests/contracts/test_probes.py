"""What `rig init` sends to a port: questions from a list per device, all of them read only, and nothing else."""

import io
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import pytest

from rig.clock import Clock
from rig.devices import make_drivers
from rig.devices.base import ForceError, StageError
from rig.devices.make_drivers import open_force, open_stage, probe
from rig.devices.registry import BUILT_IN, KINDS, DeviceKind, KnownBench, Opener, find
from rig.errors import RigError
from rig.settings import BenchSettings
from rig.transport import Transport
from sim.devices.clock import VirtualClock
from tests.contracts.bytes.leadshine import crc
from tests.contracts.other_lengths import other_lengths
from tests.error_codes import raises

SERIAL, TCP = "/dev/ttyUSB7", "tcp://10.0.0.7:502"
SILENCE = b""
TRANSACTION = 2
"""Bytes of the number of a Modbus TCP frame, which a reply repeats."""


def _hex(pairs: Mapping[str, str]) -> dict[bytes, bytes]:
    return {bytes.fromhex(question): bytes.fromhex(reply) for question, reply in pairs.items()}


@dataclass(frozen=True)
class ReadOnly:
    """Everything that a probe may send, with the device's replies, and how its port is opened.

    usable: replies of a device that is there but cannot be used, and the code of the error.
    """

    kind: str
    port: str
    opened: tuple[int, str]
    questions: Mapping[bytes, bytes]
    identity: str
    unusable: Mapping[str, Mapping[bytes, bytes]] = field(default_factory=dict)
    elsewhere: Mapping[bytes, bytes] = field(default_factory=dict)
    opens: str = ""  # what is opened instead of the port

    @property
    def allowed(self) -> set[bytes]:
        """What may be sent, also where a reply of Modbus RTU is missing."""
        lengths = other_lengths(question[:-2] for question in self.questions)
        return {*self.questions, *(question + crc(question) for question in lengths)}


GRBL = ReadOnly(
    "grbl", SERIAL, (115200, "8N1"),
    {
        b"?": b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n",
        b"$I\n": b"[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\nok\r\n",
    },
    "[VER:1.1h.20190825:] [OPT:V,15,128]",
    unusable={
        "old_firmware": {b"?": b"<Idle,MPos:0.000,0.000,0.000,WPos:0.000,0.000,0.000>\r\n"},
        "other_firmware": {b"$I\n": b"[VER:3.9 FluidNC v3.9.1 (esp32-wifi) :]\r\n[OPT:MPHS]\r\nok\r\n"},
    },
)  # fmt: skip
MTSICS = ReadOnly(
    "mtsics", SERIAL, (9600, "8N1"),
    {b"I4\r\n": b'I4 A "0123456789"\r\n', b"SI\r\n": b"S D      -0.01 g\r\n"},
    "MT-SICS balance 0123456789",
    unusable={
        "wrong_unit": {b"SI\r\n": b"S S 1.00 oz\r\n"},
        "no_line_end": {b"I4\r\n": b'I4 A "0123456789"\r'},
    },
)  # fmt: skip
LEADSHINE_RTU = ReadOnly(
    "leadshine", SERIAL, (115200, "8N1"),
    _hex({
        "01 03 10 03 00 01 70 CA": "01 03 02 00 02 39 85",
        "02 03 10 03 00 01 70 F9": "02 03 02 00 02 7D 85",
        "01 03 60 2C 00 02 1B C2": "01 03 04 00 00 00 00 FA 33",
        "02 03 60 2C 00 02 1B F1": "02 03 04 00 00 00 00 C9 33",
    }),
    "Leadshine drives 1 and 2",
    unusable={"one_drive": _hex({"02 03 10 03 00 01 70 F9": ""})},
)  # fmt: skip
LEADSHINE_TCP = ReadOnly(
    "leadshine", TCP, (115200, "8N1"),
    _hex({
        "00 00 00 06 01 03 10 03 00 01": "00 00 00 05 01 03 02 00 02",
        "00 00 00 06 02 03 10 03 00 01": "00 00 00 05 02 03 02 00 02",
        "00 00 00 06 01 03 60 2C 00 02": "00 00 00 07 01 03 04 00 00 00 00",
        "00 00 00 06 02 03 60 2C 00 02": "00 00 00 07 02 03 04 00 00 00 00",
    }),
    "Leadshine drives 1 and 2",
)  # fmt: skip
WEIGHTS = "00 80 00 00 00 E9 00 00 00 00 00 00 00 00 01"
LAUMAS_RTU = ReadOnly(
    "laumas", SERIAL, (9600, "8N1"),
    _hex({
        "01 03 00 00 00 04 44 09": "01 03 08 01 05 00 1E 07 E8 04 D2 AA C4",
        "01 03 00 06 00 08 A4 0D": f"01 03 10 {WEIGHTS} 0C 1C F3",
    }),
    "Laumas transmitter type 30, serial 1234 of 2024, firmware 261",
    unusable={"wrong_unit": _hex({"01 03 00 06 00 08 A4 0D": f"01 03 10 {WEIGHTS} 0D DD 33"})},
)  # fmt: skip
LAUMAS_TCP = ReadOnly(
    "laumas", TCP, (9600, "8N1"),
    _hex({
        "00 00 00 06 01 03 00 00 00 04": "00 00 00 0B 01 03 08 01 05 00 1E 07 E8 04 D2",
        "00 00 00 06 01 03 00 06 00 08": f"00 00 00 13 01 03 10 {WEIGHTS} 0C",
    }),
    "Laumas transmitter type 30, serial 1234 of 2024, firmware 261",
)  # fmt: skip
ZABER = ReadOnly(
    "zaber", SERIAL, (115200, "8N1"),
    {
        b"/1 0 00 get deviceid:42\n": b"@01 0 00 OK IDLE WR 50081:F0\r\n",
        b"/2 0 00 get deviceid:41\n": b"@02 0 00 OK IDLE WR 50081:EF\r\n",
    },
    "Zaber devices 1 (id 50081) and 2 (id 50081)",
    unusable={"one_device": {b"/2 0 00 get deviceid:41\n": b""}},
)  # fmt: skip
STANDA = ReadOnly(
    "standa", SERIAL, (115200, "8N1"),
    _hex({"67 73 65 72": "67 73 65 72 67 12 00 00 BF 55"}),
    "Standa controller 4711",
)  # fmt: skip
TMCL = ReadOnly(
    "tmcl", SERIAL, (115200, "8N1"),
    _hex({
        "01 06 01 00 00 00 00 00 08": "02 01 64 06 00 00 C7 00 34",
        "01 0D 02 00 00 00 00 00 10": "02 01 64 0D 00 00 00 00 74",
        "01 06 01 01 00 00 00 00 09": "02 01 64 06 00 00 C7 00 34",
        "01 0D 02 01 00 00 00 00 11": "02 01 64 0D 00 00 00 00 74",
    }),
    "TMCL module 1, motor 0 and module 1, motor 1",
    unusable={"one_motor": _hex({"01 06 01 01 00 00 00 00 09": ""})},
)  # fmt: skip
NET_FT = ReadOnly(
    "net_ft", "udp://10.0.0.7:49152", (9600, "8N1"),
    {
        b"GET /netftapi2.xml HTTP/1.0\r\n\r\n":
            b"HTTP/1.0 200 OK\r\n\r\n<netft><prodname>Axia</prodname><cfgcpf>1000000</cfgcpf>"
            b"<cfgcpt>1000000</cfgcpt><scfgfu>N</scfgfu><scfgtu>Nm</scfgtu></netft>"
    },
    "Axia, 1000000 counts per N, 1000000 counts per Nm",
    unusable={
        "wrong_unit": {
            b"GET /netftapi2.xml HTTP/1.0\r\n\r\n":
                b"HTTP/1.0 200 OK\r\n\r\n<netft><prodname>Axia</prodname><cfgcpf>1000000</cfgcpf>"
                b"<cfgcpt>1000000</cfgcpt><scfgfu>oz</scfgfu><scfgtu>Nm</scfgtu></netft>"
        }
    },
    opens="tcp://10.0.0.7:80",
)  # fmt: skip
TABLES = {
    "grbl": GRBL, "leadshine_rtu": LEADSHINE_RTU, "leadshine_tcp": LEADSHINE_TCP, "zaber": ZABER, "standa": STANDA,
    "tmcl": TMCL,
    "mtsics": MTSICS, "laumas_rtu": LAUMAS_RTU, "laumas_tcp": LAUMAS_TCP,
    "net_ft": NET_FT,
}  # fmt: skip


class Port:
    """A port that replies by a table; whatever is not in the table of the probe fails the test."""

    def __init__(self, asks: ReadOnly, clock: VirtualClock, replies: Mapping[bytes, bytes]) -> None:
        self.name, self._asks, self._clock = asks.port, asks, clock
        self._replies = replies
        self.sent: list[bytes] = []
        self.closed, self.chatter = False, b""
        self.deaf_until_s, self.reply_s = 0.0, 0.0
        self._coming, self._due_s = b"", 0.0

    def write(self, data: bytes) -> None:
        modbus_tcp = self._asks.port == TCP
        number, question = (data[:TRANSACTION], data[TRANSACTION:]) if modbus_tcp else (b"", data)
        assert question in self._asks.allowed, f"{question.hex(' ')} is not a question that a probe may send"
        self.sent.append(data)
        if self._clock.monotonic_s() < self.deaf_until_s:
            return
        reply = self._replies.get(question, SILENCE)
        self._coming += number + reply if reply else b""
        self._due_s = self._clock.monotonic_s() + self.reply_s

    def read(self, timeout_s: float) -> bytes:
        if self.chatter:
            self._clock.wait_s(0.005)
            return self.chatter
        left_s = max(self._due_s - self._clock.monotonic_s(), 0.0)
        if not self._coming or left_s > timeout_s:
            self._clock.wait_s(timeout_s)
            return b""
        self._clock.wait_s(left_s)
        data, self._coming = self._coming, b""
        return data

    def close(self) -> None:
        self.closed = True


Ask = Any


@pytest.fixture
def ask(monkeypatch: pytest.MonkeyPatch) -> Ask:
    """Probe a port of a table; return the port, the seconds that it took, and the answer."""

    def asked(
        table: ReadOnly,
        replies: Mapping[bytes, bytes],
        chatter: bytes = b"",
        *,
        deaf_s: float = 0.0,
        reply_s: float = 0.0,
    ) -> tuple[Port, float, str | None]:
        clock = VirtualClock(0.0, 100.0)
        port = Port(table, clock, replies)
        port.chatter, port.deaf_until_s, port.reply_s = chatter, 100.0 + deaf_s, reply_s

        def open_port(name: str, baud: int, *, character: str, dtr: bool, owned: bool) -> Port:
            assert (name, (baud, character), owned) == (table.opens or table.port, table.opened, True)
            return port

        monkeypatch.setattr(make_drivers, "open_port", open_port)
        try:
            identity = probe(_kind(table), table.port, clock)
            return port, clock.monotonic_s() - 100.0, identity
        finally:
            assert port.closed
            assert clock.monotonic_s() - 100.0 <= 6.5

    return asked


def _kind(table: ReadOnly) -> DeviceKind:
    return next(find(of, table.kind) for of in KINDS if table.kind in BUILT_IN[of.room])


def test_every_built_in_kind_with_a_probe_has_its_list() -> None:
    with_probe = {name for of in KINDS for name in BUILT_IN[of.room] if find(of, name).probe is not None}
    assert {table.kind for table in TABLES.values()} == with_probe


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_a_device_names_itself_and_every_question_of_the_list_is_used(table: ReadOnly, ask: Ask) -> None:
    port, _, identity = ask(table, table.questions)
    assert identity == table.identity
    start = TRANSACTION if table.port == TCP else 0
    assert {data[start:] for data in port.sent} == set(table.questions)


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_a_silent_port_is_no_device_and_takes_a_bounded_time(table: ReadOnly, ask: Ask) -> None:
    port, lasts_s, identity = ask(table, {})
    assert identity is None
    assert port.sent
    assert 0.5 < lasts_s < 3.0


@pytest.mark.parametrize(("deaf_s", "reply_s"), [(0.5, 0.0), (2.0, 0.0), (2.3, 0.2)])
def test_a_board_that_restarts_as_its_port_is_opened_is_found(deaf_s: float, reply_s: float, ask: Ask) -> None:
    """It hears nothing for two seconds; what it says at the end of the wait counts."""
    _, _, identity = ask(GRBL, GRBL.questions, deaf_s=deaf_s, reply_s=reply_s)
    assert identity == GRBL.identity


@pytest.mark.parametrize("state", ["Run", "Jog", "Hold:0", "Door:1", "Home", "Check", "Sleep"])
def test_a_board_that_may_not_read_a_line_is_asked_for_its_state_alone(state: str, ask: Ask) -> None:
    status = GRBL.questions[b"?"].replace(b"Alarm", state.encode())
    port, _, identity = ask(GRBL, {**GRBL.questions, b"?": status})
    assert identity == f"GRBL board in state {state}"
    assert port.sent == [b"?"]


@pytest.mark.parametrize("chatter", [b"\x00", b"S D 0.01 g\r\n", b"\xff\xfe", b"<\r\n"], ids=repr)
@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_a_port_that_never_stops_talking_takes_a_bounded_time(table: ReadOnly, chatter: bytes, ask: Ask) -> None:
    _, _, identity = ask(table, {}, chatter)
    assert identity is None


def test_a_probe_without_an_end_has_six_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a package, say."""
    clock = VirtualClock(0.0, 100.0)
    port = Port(MTSICS, clock, {})
    monkeypatch.setattr(make_drivers, "open_port", lambda *_, **__: port)

    def endless(opener: Opener, clock: Clock, settings: BenchSettings) -> str | None:
        wire = opener(settings.force.port)
        while True:
            wire.read(0.1)

    assert probe(replace(_kind(MTSICS), probe=endless), SERIAL, clock) is None
    assert clock.monotonic_s() == pytest.approx(106.0, abs=0.1)
    assert port.closed
    assert probe(replace(_kind(MTSICS), probe=None), SERIAL, clock) is None
    assert port.sent == []


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_another_answer_to_every_question_is_no_device(table: ReadOnly, ask: Ask) -> None:
    """An echo, the refusal of a balance, the error of a board."""
    for reply in (None, b"ES\r\n", b"error:1\r\n"):
        _, _, identity = ask(table, {question: reply or question for question in table.questions})
        assert identity is None


@pytest.mark.parametrize(
    ("table", "code"),
    [pytest.param(t, code, id=f"{name}-{code}") for name, t in TABLES.items() for code in t.unusable],
)
def test_a_device_that_cannot_be_used_is_there_and_says_why(table: ReadOnly, code: str, ask: Ask) -> None:
    kind: type[RigError] = StageError if table.kind in BUILT_IN["stage"] else ForceError
    with raises(kind, code):
        ask(table, {**table.questions, **table.unusable[code]})


@pytest.mark.parametrize(
    ("table", "question", "reply", "identity"),
    [
        *((MTSICS, b"SI\r\n", reply, MTSICS.identity) for reply in (b"S I\r\n", b"S +\r\n", b"x\r\n", SILENCE)),
        *((GRBL, b"$I\n", reply, "GRBL board") for reply in (b"error:9\r\n", SILENCE, b"ALARM:1\r\n")),
    ],
)
def test_a_device_that_has_named_its_kind_is_found_though_it_refuses_the_rest(
    table: ReadOnly, question: bytes, reply: bytes, identity: str, ask: Ask
) -> None:
    """An overloaded balance, a board that is locked."""
    _, _, found = ask(table, {**table.questions, question: reply})
    assert found == identity


class Wire:
    """A port that is opened, not yet asked."""

    name = "wire"

    def __init__(self) -> None:
        self.sent, self.closed = list[bytes](), False

    def write(self, data: bytes) -> None:
        self.sent.append(data)

    def read(self, timeout_s: float) -> bytes:
        return b""

    def close(self) -> None:
        self.closed = True


def test_devices_are_opened_as_they_are_configured(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stage's wire may be guarded, and is the program's own unless it is opened for a mere stop."""
    opened, wires, guarded, log = list[Any](), list[Wire](), list[Any](), io.StringIO()

    def open_port(name: str, baud: int, *, character: str, dtr: bool, owned: bool) -> Wire:
        opened.append((name, baud, character, dtr, owned))
        wires.append(Wire())
        return wires[-1]

    def guard(wire: Transport) -> Transport:
        guarded.append(wire)
        return wire

    monkeypatch.setattr(make_drivers, "open_port", open_port)
    stage = {"port": "/dev/a", "baud": 19200, "character": "7E1", "dtr": False}
    bench = KnownBench.model_validate({"stage": stage, "force": {"port": "/dev/b", "baud": 300, "character": "8E1"}})
    open_stage(bench, VirtualClock(), log, guard).stop()
    open_stage(bench, VirtualClock(), owned=False).stop()
    open_force(bench, VirtualClock(), log).close()
    assert opened == [("/dev/a", 19200, "7E1", False, owned) for owned in (True, False)] + [
        ("/dev/b", 300, "8E1", True, True)
    ]
    assert len(guarded) == 1
    assert [wire.sent for wire in wires] == [[b"!\x18"], [b"!\x18"], []]
    assert [wire.closed for wire in wires] == [False, False, True]
    assert log.getvalue().count("2118") == 1


CONTINUES, SWITCHES = b"~\x81", bytes([*range(0x90, 0x9E), 0xA0, 0xA1])
"""Single bytes on which a GRBL or grblHAL board continues a held motion; overrides and outputs."""


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_no_question_holds_a_byte_on_which_a_board_acts(table: ReadOnly) -> None:
    """A board that restarts and is slow to answer hears the questions to other devices, too."""
    for question in table.questions:
        assert not set(question) & set(CONTINUES + SWITCHES), question.hex(" ")
