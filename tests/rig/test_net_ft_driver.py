"""An ATI Net F/T: sequence numbers, its page, status bits, axes, and what else comes as a datagram."""

import socket
import struct
from contextlib import closing
from typing import Any

import pytest

from rig.devices.base import ForceBroken, ForceError, ForceOverload, ForceTimeout, ForceUnderload
from rig.devices.net_ft import GET_PAGE, MAX_AGE_S, START, NetFtForce, NetFtSettings
from rig.devices.registry import ForceKind, find
from rig.plan.config import Config
from rig.transport import NotOwnedError, TransportError, UdpTransport, open_port
from rig.units import GWT_N
from sim.devices.clock import VirtualClock
from tests.contracts.bytes.net_ft import PAGE
from tests.error_codes import raises
from tests.timed_wire import TimedWire
from tests.waiting import DEADLINE_S, until

STEP_S = 0.001
TOP = 0xFFFFFFFF


def record(rdt: int, *, ft: int | None = None, status: int = 0, axes: tuple[int, ...] = (0, 0, 0, 0, 0, 0)) -> bytes:
    return struct.pack(">III6i", rdt & TOP, (5 * rdt if ft is None else ft) & TOP, status, *axes)


class Wire(TimedWire):
    """Datagrams that come at given times, and a driver that is connected."""

    def __init__(self, page: bytes = PAGE, connect: bool = True, begin: int = 0, **table: Any) -> None:
        super().__init__(VirtualClock(0.0, 100.0))
        self.sent, self.page, self.begin = list[bytes](), page, begin
        force = {"sample_period_s": 0.05, "latency_s": 0.0, "resolution_gwt": 0.01, "scale": 1.0}
        force |= {key: table.pop(key) for key in force if key in table}
        self.driver = NetFtForce(self, lambda: self, self.clock, NetFtSettings(**table), **force)
        if connect:
            self.driver.connect()

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        reply = self.page if data == GET_PAGE else record(self.begin)
        self.coming.append((self.clock.monotonic_s(), reply))

    def come(self, *datagrams: bytes, after_s: float = STEP_S) -> None:
        """One after the other, the first one after the request that follows."""
        now_s = self.clock.monotonic_s()
        self.coming += [(now_s + (n + 1) * after_s, data) for n, data in enumerate(datagrams)]

    def read_after(self, *datagrams: bytes) -> dict[str, float]:
        """What a reading says besides its force, when all but the last datagram came before its request."""
        now_s = self.clock.monotonic_s()
        self.coming = [(now_s, data) for data in datagrams[:-1]] + [(now_s + STEP_S, datagrams[-1])]
        return dict(self.driver.read().also)


# --- sequence numbers ---


@pytest.mark.parametrize(
    ("numbers", "lost", "repeated", "late"),
    [
        ([1, 2, 3, 4], 0, 0, 0),
        ([1, 2, 5], 2, 0, 0),
        ([1, 2, 2, 3], 0, 1, 0),
        ([2, 1, 3], 0, 0, 1),
        ([1, 4, 2, 3, 5], 0, 0, 2),
        ([1, 4, 2, 5], 1, 0, 1),
        ([3, 3, 3, 9], 7, 2, 0),
        ([1 << 30, (1 << 30) + 1], (1 << 30) - 1, 0, 0),
        ([1, 1 + (1 << 31), 2], 0, 0, 1),
        ([1, 2, 1, 3], 0, 0, 1),
    ],
)
@pytest.mark.parametrize("begin", [0, TOP - 2], ids=["from 0", "over the top"])
@pytest.mark.parametrize("joined", [False, True], ids=["single", "joined"])
def test_lost_repeated_and_late_packets_are_counted(
    numbers: list[int], lost: int, repeated: int, late: int, begin: int, joined: bool
) -> None:
    there = Wire(begin=begin)
    records = [record(begin + number) for number in numbers]
    found = there.read_after(b"".join(records[:-1]), records[-1]) if joined else there.read_after(*records)
    assert (found["packets_lost"], found["packets_repeated"], found["packets_late"]) == (lost, repeated, late)


@pytest.mark.parametrize(
    ("numbers", "lost", "repeated"), [([2, 3], 0, 1), ([2, 3, 4], 0, 2), ([3, 4], 1, 1), ([3, 6, 7], 3, 2)]
)
@pytest.mark.parametrize("joined", [False, True], ids=["single", "joined"])
def test_records_of_one_sample_are_repeated_and_not_lost(
    numbers: list[int], lost: int, repeated: int, joined: bool
) -> None:
    """All but the last have the sample of record 1."""
    there = Wire()
    records = [record(1), *(record(number, ft=5) for number in numbers[:-1]), record(numbers[-1])]
    found = there.read_after(b"".join(records[:-1]), records[-1]) if joined else there.read_after(*records)
    assert (found["packets_lost"], found["packets_repeated"], found["packets_late"]) == (lost, repeated, 0)


def test_a_sample_that_stands_still_is_no_new_one() -> None:
    there = Wire()
    there.come(*(record(n, ft=0) for n in range(1, 40)))
    with raises(ForceTimeout, "no_reply", port="wire", timeout_s=MAX_AGE_S):
        there.driver.read()


def test_the_newest_record_counts() -> None:
    there = Wire()
    records = [record(n, axes=(0, 0, -1000 * n, 0, 0, 0)) for n in range(1, 6)]
    there.come(b"".join(records))
    assert there.driver.read().force_n == pytest.approx(5e-3)


def test_what_came_before_the_request_is_not_used() -> None:
    there = Wire()
    there.coming = [(there.clock.monotonic_s(), record(1, axes=(0, 0, -9, 0, 0, 0)))]
    there.come(record(2, axes=(0, 0, -5, 0, 0, 0)))
    assert there.driver.read().force_n == pytest.approx(5e-6)


def test_a_record_from_before_the_start_does_not_start_a_stream() -> None:
    there = Wire(connect=False)
    there.write = there.sent.append  # type: ignore[method-assign]
    there.come(PAGE, record(1), after_s=0.0)
    with raises(ForceTimeout, "no_reply", port="wire", timeout_s=0.5):
        there.driver.connect()
    assert there.sent == [GET_PAGE, START]


def test_the_status_of_the_record_that_starts_a_stream_counts() -> None:
    there = Wire()
    with raises(ForceTimeout, "no_reply"):
        there.driver.read()
    there.write = there.sent.append  # type: ignore[method-assign]
    there.come(record(1, status=0x80020000), record(2))
    with raises(ForceOverload, "saturated", status="80020000"):
        there.driver.read()


def test_a_reading_before_a_connection_reads_the_page_and_starts_the_stream() -> None:
    there = Wire(connect=False)
    there.write = there.sent.append  # type: ignore[method-assign]
    there.come(PAGE, *(record(n, axes=(0, 0, -5, 0, 0, 0)) for n in range(40)))
    assert there.driver.read().force_n == pytest.approx(5e-6)
    assert there.sent == [GET_PAGE, START]
    there.driver.read()
    assert there.sent == [GET_PAGE, START]


def test_the_stream_is_started_again_after_silence() -> None:
    there = Wire()
    assert there.sent == [GET_PAGE, START]
    with raises(ForceTimeout, "no_reply", port="wire"):
        there.driver.read()
    there.come(record(900), record(901))
    there.driver.read()
    assert there.sent == [GET_PAGE, START, START]


# --- the page ---


def _page(**changed: str | None) -> bytes:
    page = PAGE.decode()
    for tag, value in changed.items():
        begin, _, rest = page.partition(f"<{tag}>")
        end = rest.partition(f"</{tag}>")[2]
        page = begin + ("" if value is None else f"<{tag}>{value}</{tag}>") + end
    return page.encode()


@pytest.mark.parametrize(
    ("page", "code"),
    [
        *(pytest.param(_page(**{tag: None}), "no_counts", id=f"no {tag}")
          for tag in ("prodname", "cfgcpf", "cfgcpt", "scfgfu", "scfgtu")),
        *(pytest.param(_page(cfgcpf=value), "no_counts", id=f"counts {value}") for value in ("0", "-5", "1e6", "x")),
        pytest.param(_page(cfgcpt="0"), "no_counts", id="torque counts 0"),
        pytest.param(_page(scfgfu="oz"), "wrong_unit", id="oz"),
        pytest.param(_page(scfgtu="oz-in"), "wrong_unit", id="oz-in"),
        pytest.param(_page(comrdtrate="99"), "slow_records", id="99 records a second"),
        pytest.param(_page(setuserfilter="8"), "slow_filter", id="5 Hz"),
        pytest.param(_page(setuserfilter="9"), "slow_filter", id="no such filter"),
        pytest.param(PAGE.replace(b"200 OK", b"404 Not Found"), "no_counts", id="404"),
        pytest.param(PAGE.replace(b"HTTP/1.0 200 OK", b""), "no_counts", id="no status"),
        pytest.param(PAGE[:-20], "no_counts", id="no end"),
        pytest.param(b"", "no_device", id="nothing"),
    ],
)  # fmt: skip
def test_without_its_counts_and_units_it_does_not_run(page: bytes, code: str) -> None:
    there = Wire(page, connect=False)
    for ask in (there.driver.connect, there.driver.identify, there.driver.read):
        with raises(ForceTimeout if code == "no_device" else ForceError, code, port="wire"):
            ask()
    assert START not in there.sent


@pytest.mark.parametrize(("number", "cutoff_hz"), [(1, 838), (4, 73), (8, 5)])
def test_a_filter_must_be_covered_by_the_latency(number: int, cutoff_hz: int) -> None:
    """Else a reading at rest would show the force before it."""
    lag_s, sample_s = 1 / cutoff_hz, 0.001
    page = _page(setuserfilter=str(number), comrdtrate=None)
    Wire(page, latency_s=lag_s - sample_s + 1e-9, sample_period_s=sample_s)
    with raises(ForceError, "slow_filter", cutoff_hz=cutoff_hz, latency_s=lag_s):
        Wire(page, latency_s=lag_s - sample_s - 1e-6, sample_period_s=sample_s)


@pytest.mark.parametrize(("latency_s", "fine"), [(0.02, True), (0.018, False)])
def test_the_latency_is_that_of_the_configuration(latency_s: float, fine: bool) -> None:
    """A filter of 35 Hz takes 0.0286 s, and a sample 0.01 s."""
    force = {"kind": "net_ft", "port": "udp://10.0.0.7:49152", "sample_period_s": 0.01, "latency_s": latency_s}
    there = Wire(_page(setuserfilter="5"), connect=False)
    config = Config.model_validate({"force": force})
    driver = find(ForceKind, "net_ft").driver(lambda port: there, there.clock, config)
    if fine:
        driver.identify()
    else:
        with raises(ForceError, "slow_filter", cutoff_hz=35):
            driver.identify()


@pytest.mark.parametrize(("rate", "fine"), [("100", True), ("99", False), ("0", True), (None, True)])
def test_records_come_at_100_a_second_at_least_whatever_the_sample_period(rate: str | None, fine: bool) -> None:
    """So that two of them come within the maximum age; a sensor that does not tell its rate is taken at its word."""
    for period_s in (0.01, 0.05, 1.0):
        if fine:
            Wire(_page(comrdtrate=rate), sample_period_s=period_s)
        else:
            with raises(ForceError, "slow_records", rate_hz=99, lowest_hz=100):
                Wire(_page(comrdtrate=rate), sample_period_s=period_s)


def test_a_page_has_a_second_and_a_stream_half_of_one_to_come() -> None:
    for page, code, lasts_s in ((b"", "no_device", 1.0), (PAGE, "no_reply", 0.5)):
        there = Wire(page, connect=False)
        write = there.write
        there.write = lambda data, write=write: write(data) if data == GET_PAGE else None  # type: ignore[method-assign]
        begun_s = there.clock.monotonic_s()
        with raises(ForceTimeout, code, port="wire", timeout_s=lasts_s):
            there.driver.connect()
        assert there.clock.monotonic_s() - begun_s == pytest.approx(lasts_s)


KGF, LBF, INCH_M = 9.80665, 0.45359237 * 9.80665, 0.0254
FORCES_N = {"N": 1.0, "kN": 1e3, "lbf": LBF, "klbf": 1e3 * LBF, "kgf": KGF, "kg": KGF, "g": 1e-3 * KGF}
TORQUES_NM = {
    "Nm": 1.0, "N-m": 1.0, "Nmm": 1e-3, "N-mm": 1e-3, "kNm": 1e3, "kN-m": 1e3, "lbf-in": LBF * INCH_M,
    "lbf-ft": 12 * LBF * INCH_M, "kgf-cm": 0.01 * KGF, "kgfcm": 0.01 * KGF, "kgf-m": KGF,
}  # fmt: skip


@pytest.mark.parametrize(("unit", "newton"), FORCES_N.items())
def test_counts_become_newtons_by_the_page(unit: str, newton: float) -> None:
    there = Wire(_page(cfgcpf="2000", scfgfu=unit))
    there.come(record(1, axes=(0, 0, -500, 0, 0, 0)))
    assert there.driver.read().force_n == pytest.approx(0.25 * newton, rel=1e-9)


@pytest.mark.parametrize(("unit", "newton_meters"), TORQUES_NM.items())
def test_counts_become_newton_meters_by_the_page(unit: str, newton_meters: float) -> None:
    there = Wire(_page(cfgcpt="2000", scfgtu=unit))
    there.come(record(1, axes=(0, 0, 0, 500, -500, 1000)))
    also = there.driver.read().also
    torques = [also[axis] for axis in ("tx_nm", "ty_nm", "tz_nm")]
    assert torques == pytest.approx([factor * newton_meters for factor in (0.25, -0.25, 0.5)], rel=1e-5, abs=1e-9)


def test_every_unit_that_is_accepted_is_in_these_tables() -> None:
    assert set(NetFtSettings.NEWTONS) == set(FORCES_N)
    assert set(NetFtSettings.NEWTON_METERS) == set(TORQUES_NM)


def test_of_a_page_that_never_ends_64_kib_are_read() -> None:
    there = Wire(b"", connect=False)
    there.coming = [(there.clock.monotonic_s(), bytes(1024))] * 200
    with raises(ForceError, "no_counts"):
        there.driver.identify()
    assert sum(len(data) for _, data in there.coming) == (200 - 64) * 1024


# --- axes and status ---


@pytest.mark.parametrize("press", ["+x", "-x", "+y", "-y", "+z", "-z"])
def test_the_axis_of_a_press_and_all_six_beside_it(press: str) -> None:
    there = Wire(press=press)
    there.come(record(1, axes=(1000, -2000, 3000, 40, -50, 60)))
    reading = there.driver.read()
    force_n = {"x": 1e-3, "y": -2e-3, "z": 3e-3}[press[1]]
    assert reading.force_n == pytest.approx(-force_n if press[0] == "-" else force_n)
    axes = {"fx_n": 1e-3, "fy_n": -2e-3, "fz_n": 3e-3, "tx_nm": 4e-5, "ty_nm": -5e-5, "tz_nm": 6e-5}
    counts = dict.fromkeys(("packets_lost", "packets_repeated", "packets_late"), 0)
    assert dict(reading.also) == pytest.approx({**axes, **counts})
    assert set(reading.also) == set(find(ForceKind, "net_ft").also)


def test_the_mean_of_three_readings_within_the_range_is_subtracted() -> None:
    """A sample period apart."""
    there = Wire(steady_gwt=1.0, sample_period_s=0.1)
    there.coming, begun_s = [], there.clock.monotonic_s()
    for n, gwt in enumerate((20.0, 5.0, 5.4, 5.9, 7.0)):
        counts = round(-gwt * GWT_N * 1e6)
        there.coming.append((begun_s + 0.101 * n + STEP_S, record(n + 1, axes=(0, 0, counts, 0, 0, 0))))
    there.driver.zero()
    assert there.clock.monotonic_s() - begun_s == pytest.approx(3 * 0.101 + STEP_S)
    assert there.driver.subtracted_n == pytest.approx((5.0 + 5.4 + 5.9) / 3 * GWT_N, rel=1e-3)
    there.clock.wait_s(0.1)
    assert there.driver.read().force_n == pytest.approx((7.0 - 16.3 / 3) * GWT_N, rel=1e-3)


def test_a_status_between_two_readings_is_reported_once() -> None:
    """A saturation of milliseconds is not missed, and an old one does not hide that the indentor is clear."""
    there = Wire()
    there.come(record(1))
    there.driver.read()
    there.coming = [(there.clock.monotonic_s(), record(2, status=0x80020000))]
    there.come(record(3))
    with raises(ForceOverload, "saturated", port="wire", status="80020000"):
        there.driver.read()
    there.coming = [(there.clock.monotonic_s(), record(4, status=0x80020000))]
    there.come(record(5))
    assert there.driver.read().force_n == 0


@pytest.mark.parametrize("bit", [bit for bit in range(31) if bit not in (16, 17)])
@pytest.mark.parametrize("beside", [0, 1 << 17, 1 << 16], ids=["alone", "saturated", "monitored"])
def test_each_bit_of_an_error_is_a_broken_sensor_whatever_else_is_set(bit: int, beside: int) -> None:
    there, status = Wire(), 1 << 31 | 1 << bit | beside
    there.come(record(1, status=status))
    with raises(ForceBroken, "sensor_error", port="wire", status=f"{status:08X}"):
        there.driver.read()


@pytest.mark.parametrize(("axis", "kind"), [(-1, ForceOverload), (0, ForceOverload), (1, ForceUnderload)])
def test_a_saturated_sensor_is_over_or_underloaded_by_the_sign_of_its_force(
    axis: int, kind: type[ForceError]
) -> None:
    there = Wire(press="-z")
    there.come(record(1, status=1 << 17 | 1 << 16, axes=(0, 0, axis, 0, 0, 0)))
    with raises(kind, "saturated", status="00030000") as caught:
        there.driver.read()
    assert type(caught.value) is kind


# --- datagrams of the system ---


@pytest.fixture
def far() -> Any:
    with closing(socket.socket(type=socket.SOCK_DGRAM)) as there:
        there.bind(("127.0.0.1", 0))
        there.settimeout(DEADLINE_S)
        yield there


def _gathered(wire: Any, size: int) -> list[bytes]:
    found = list[bytes]()

    def whole() -> bool:
        found.append(wire.read(0.1))
        return sum(map(len, found)) >= size

    until(whole)
    return [one for one in found if one]


def test_records_come_joined_and_another_datagram_alone(far: socket.socket) -> None:
    port = f"udp://127.0.0.1:{far.getsockname()[1]}"
    with closing(open_port(port, 9600)) as wire:
        assert isinstance(wire, UdpTransport)
        wire.write(START)
        data, peer = far.recvfrom(64)
        assert data == START
        with pytest.raises(NotOwnedError):
            open_port(port, 9600)
        sent = [record(1), record(2), bytes(18), bytes(18), record(3)]
        for one in sent:
            far.sendto(one, peer)
        found = _gathered(wire, sum(map(len, sent)))
        assert b"".join(found) == b"".join(sent)
        assert found.count(bytes(18)) == 2
        assert wire.read(0.01) == b""
        with closing(socket.socket(type=socket.SOCK_DGRAM)) as stranger:
            stranger.sendto(record(4), peer)
            assert wire.read(0.2) == b""
    open_port(port, 9600).close()


def test_where_nothing_listens_it_is_an_error_and_then_goes_on() -> None:
    with closing(socket.socket(type=socket.SOCK_DGRAM)) as gone:
        gone.bind(("127.0.0.1", 0))
        number = gone.getsockname()[1]
    with closing(UdpTransport(f"udp://127.0.0.1:{number}")) as wire:
        wire.write(START)
        with pytest.raises(TransportError):
            until(lambda: wire.read(0.5) and False)
        with closing(socket.socket(type=socket.SOCK_DGRAM)) as again:
            again.bind(("127.0.0.1", number))
            again.settimeout(DEADLINE_S)
            wire.write(START)
            _, peer = again.recvfrom(64)
            again.sendto(record(1), peer)
            assert _gathered(wire, 36) == [record(1)]


def test_the_page_is_at_the_host_of_the_records() -> None:
    opened = list[str]()

    def opener(port: str) -> Any:
        opened.append(port)
        return Wire(connect=False)

    config = Config.model_validate({"force": {"kind": "net_ft", "port": "udp://10.0.0.7:49152"}})
    find(ForceKind, "net_ft").driver(opener, VirtualClock(), config).identify()
    assert opened == ["udp://10.0.0.7:49152", "tcp://10.0.0.7:80"]
