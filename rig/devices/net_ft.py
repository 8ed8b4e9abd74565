"""Force sensor: ATI Net F/T, six axes over Ethernet (RDT over UDP, settings over HTTP).

Sources: the drivers netft-cpp, netft_utils, NetFT, ati-netft-cpp and pynetft; ATI's manual (9620-05-NET FT) was not
read. The sensor sends its records by itself once RDT was started, each with a sequence number.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from rig.clock import Clock
from rig.devices.base import (
    ForceBroken,
    ForceBusy,
    ForceError,
    ForceOverload,
    ForceReading,
    ForceTimeout,
    ForceUnderload,
)
from rig.devices.registry import Evidence, ForceKind, Opener
from rig.settings import BenchSettings, ForceSettings, Settings
from rig.transport import Transport, TransportError
from rig.transport.wire import arrived
from rig.units import GWT_N

MAX_AGE_S = 0.02
"""Longest time from the request for a reading to a new record (s)."""
LOWEST_HZ = 100
"""Lowest rate of records (1/s): two of them fit into MAX_AGE_S, and one into each sample period that is allowed."""
PAGE_S, START_S, SETTLE_S = 1.0, 0.5, 10.0
"""Longest time until the page arrives, until a started stream runs, and until a load is steady (s)."""
_PAUSE_S = 1.0  # After a longer pause without a read, records that were dropped meanwhile are not counted as lost.
_STEADY_READINGS = 3
_LONGEST_PAGE = 1 << 16

GET_PAGE = b"GET /netftapi2.xml HTTP/1.0\r\n\r\n"
START = bytes.fromhex("12 34 00 02 00 00 00 00")  # real-time records, without end
_RECORD = np.dtype([("rdt", ">u4"), ("ft", ">u4"), ("status", ">u4"), ("axes", ">i4", 6)])

_AXES = ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
_COUNTS = ("packets_lost", "packets_repeated", "packets_late")

SATURATED, MONITOR = 1 << 17, 1 << 16
_MEANINGS = {
    30: "processor or memory", 29: "digital board", 28: "analog board", 27: "link between the boards",
    26: "program memory", 25: "halted by command", 24: "invalid settings", 23: "calibration does not match",
    22: "network", 20: "RDT", 14: "watchdog", 13: "stack", 12: "EEPROM", 11: "flash memory",
}  # fmt: skip
"""Bits of errors in the status; lower ones are of the analog board: supply, gauge current, temperature."""
_CUTOFFS_HZ = (None, 838, 326, 152, 73, 35, 18, 8, 5)
"""Cutoff frequencies of the low-pass filter by its number; 0 is none."""


class NetFtSettings(Settings):
    """Settings of an ATI Net F/T sensor."""

    NEWTONS: ClassVar[dict[str, float]] = {
        "N": 1.0, "kN": 1e3, "lbf": 4.4482216152605, "klbf": 4448.2216152605, "kgf": 9.80665, "kg": 9.80665,
        "g": GWT_N,
    }  # fmt: skip
    NEWTON_METERS: ClassVar[dict[str, float]] = {
        "Nm": 1.0, "N-m": 1.0, "Nmm": 1e-3, "N-mm": 1e-3, "kNm": 1e3, "kN-m": 1e3, "lbf-in": 0.1129848290276167,
        "lbf-ft": 1.3558179483314004, "kgf-cm": 0.0980665, "kgfcm": 0.0980665, "kgf-m": 9.80665,
    }  # fmt: skip

    press: Literal["+x", "-x", "+y", "-y", "+z", "-z"] = Field(
        "-z", description="axis of the sensor along which a press acts, with the sign that its force then has"
    )
    http_port: int = Field(80, ge=1, le=65535, description="TCP port of the sensor's web page, which has its counts")
    steady_gwt: float = Field(
        1.0, gt=0, le=100, description="the load is steady if three readings lie within this range, in gwt"
    )


@dataclass(frozen=True)
class SensorPage:
    """Content of the sensor's page: name, counts, their units (N, N·m), and, if given, filter and rate (1/s)."""

    name: str
    force_counts: int
    torque_counts: int
    force_unit: str
    torque_unit: str
    filter_number: int
    rate_hz: int | None

    @property
    def newtons(self) -> NDArray[np.float64]:
        """N or N·m of one count of each axis."""
        force_n = NetFtSettings.NEWTONS[self.force_unit] / self.force_counts
        torque_nm = NetFtSettings.NEWTON_METERS[self.torque_unit] / self.torque_counts
        return np.array([force_n] * 3 + [torque_nm] * 3)

    @property
    def identity(self) -> str:
        """Name, and counts in their units."""
        return (
            f"{self.name}, {self.force_counts} counts per {self.force_unit}, "
            f"{self.torque_counts} counts per {self.torque_unit}"
        )


class Sequence:
    """Counts of records that are lost, repeated or late, by their number modulo 2³²."""

    def __init__(self) -> None:
        self.lost = self.repeated = self.late = 0
        self._last: tuple[int, int] | None = None

    def forget(self) -> None:
        """Begin again with the next record, and keep the counts."""
        self._last = None

    def newest(self, rdt: NDArray[np.uint32], ft: NDArray[np.uint32]) -> int | None:
        """Count the records, and return the index of the newest one; None if none is newer than the last."""
        found = None
        if self._last is not None and len(rdt) and self._in_step(rdt, ft, *self._last):
            found = len(rdt) - 1
            self._last = int(rdt[found]), int(ft[found])
            return found
        for at, (number, sample) in enumerate(zip(rdt.tolist(), ft.tolist(), strict=True)):
            if self._last is None:
                ahead = 1
            else:
                ahead = number - self._last[0] & 0xFFFFFFFF
                if ahead >= 1 << 31:
                    self.late += 1
                    self.lost = max(self.lost - 1, 0)  # It was counted as lost.
                    continue
                if ahead == 0 or sample == self._last[1]:
                    self.repeated += 1
                    self._last = number, sample
                    self.lost += max(ahead - 1, 0)
                    continue
            self.lost += ahead - 1
            self._last, found = (number, sample), at
        return found

    @staticmethod
    def _in_step(rdt: NDArray[np.uint32], ft: NDArray[np.uint32], last: int, sample: int) -> bool:
        """Return whether each record follows the one before it and has a sample of its own."""
        numbers, samples = rdt.astype(np.uint32), ft.astype(np.uint32)
        steps = np.diff(numbers, prepend=np.uint32(last))
        moves = np.diff(samples, prepend=np.uint32(sample))
        return bool((steps == 1).all() and (moves != 0).all())


class NetFtForce:
    """ForceSensor with an ATI Net F/T.

    A reading is the newest of the records that arrive after its request; earlier ones are counted and dropped. scale
    is true force divided by its reading.
    """

    def __init__(
        self,
        records: Transport,
        page: Callable[[], Transport],
        clock: Clock,
        settings: NetFtSettings,
        *,
        sample_period_s: float,
        latency_s: float,
        resolution_gwt: float,
        scale: float,
    ) -> None:
        self.sample_period_s, self.resolution_gwt = sample_period_s, scale * resolution_gwt
        self._records, self._open_page, self._clock, self._settings = records, page, clock, settings
        self._latency_s, self._scale = latency_s, scale
        self._axis = "xyz".index(settings.press[1])
        self._sign = -1.0 if settings.press[0] == "-" else 1.0
        self._sequence = Sequence()
        self._page: SensorPage | None = None
        self._runs, self._read_s, self._offset_n = False, 0.0, 0.0
        self._bits, self._reported, self._odd = 0, False, 0

    def connect(self) -> str:
        """Read counts and units from the sensor's page, check them, and start the stream. Raises ForceError."""
        found = self.identify()
        self._start()
        return found

    def identify(self) -> str:
        """Read the sensor's page; the stream stays as it is. Raises ForceError."""
        self._page = self._checked(self._fetched())
        return self._page.identity

    def read(self) -> ForceReading:
        """Return the newest record that arrives after this request. Raises ForceError."""
        axes, status = self._newest()
        force_n = float(self._sign * axes[self._axis])
        self._refuse(status, force_n)
        counts = (self._sequence.lost, self._sequence.repeated, self._sequence.late)
        also = dict(zip((*_AXES, *_COUNTS), (*(round(float(one), 9) for one in axes), *counts), strict=True))
        return ForceReading(self._scale * force_n - self._offset_n, False, self._clock.monotonic_s(), also)

    def zero(self) -> None:
        """Subtract the present load until the program ends, once it is steady. Raises ForceError.

        The sensor's own bias stays as it is, and the axes in the journal are not zeroed.
        """
        deadline_s, last = self._clock.monotonic_s() + SETTLE_S, list[float]()
        while len(last) < _STEADY_READINGS or max(last) - min(last) > self._settings.steady_gwt * GWT_N:
            if self._clock.monotonic_s() >= deadline_s:
                raise ForceBusy(
                    f"{self._records.name}: no steady load within {SETTLE_S:g} s; let it settle and zero again",
                    "no_stable_load",
                )
            if last:
                self._clock.wait_s(self.sample_period_s)
            last = [*last, self.read().force_n + self._offset_n][-_STEADY_READINGS:]
        self._offset_n = sum(last) / len(last)

    @property
    def subtracted_n(self) -> float:
        """Load that the driver subtracts."""
        return self._offset_n

    def close(self) -> None:
        self._records.close()

    # --- page ---

    def _fetched(self) -> str:
        """Return the page netftapi2.xml."""
        wire = self._open_page()
        try:
            wire.write(GET_PAGE)
            deadline_s, data = self._clock.monotonic_s() + PAGE_S, b""
            while b"</netft" not in data.lower() and len(data) < _LONGEST_PAGE:
                left_s = deadline_s - self._clock.monotonic_s()
                if left_s <= 0:
                    raise self._no_page(data)
                try:
                    data += wire.read(left_s)
                except TransportError as error:
                    if error.code != "hung_up":
                        raise
                    raise self._no_page(data) from error
        finally:
            if wire is self._records:  # A virtual bench has one wire for both.
                self._sequence.forget()
            else:
                wire.close()
        return data.decode("latin-1")

    def _no_page(self, data: bytes) -> ForceError:
        if b"HTTP/" in data:
            return self._bad_page("no end")
        return ForceTimeout(
            f"{self._records.name}: no page netftapi2.xml within {PAGE_S:g} s; check the power, the cable, "
            "force.port and force.net_ft.http_port",
            "no_device",
        )

    def _bad_page(self, what: str) -> ForceError:
        return ForceError(
            f"{self._records.name}: the page netftapi2.xml of the sensor cannot be used ({what}); it has the counts",
            "no_counts",
        )

    def _checked(self, text: str) -> SensorPage:
        """Return the content of the page. Raises ForceError if counts are missing, or settings do not fit the rig."""
        status = re.search(r"HTTP/1\.\d (\d{3})", text)
        if status is None or status[1] != "200":
            raise self._bad_page("no HTTP status" if status is None else f"HTTP status {status[1]}")
        page = SensorPage(
            self._word(text, "prodname"),
            self._number(text, "cfgcpf"),
            self._number(text, "cfgcpt"),
            self._word(text, "scfgfu"),
            self._word(text, "scfgtu"),
            self._number(text, "setuserfilter", 0),
            self._number(text, "comrdtrate", 0) or None,
        )
        if page.force_counts < 1 or page.torque_counts < 1:
            raise self._bad_page("no counts")
        units = (NetFtSettings.NEWTONS, page.force_unit), (NetFtSettings.NEWTON_METERS, page.torque_unit)
        for known, unit in units:
            if unit not in known:
                raise ForceError(
                    f"{self._records.name}: the sensor reports the unit {unit}; set it to one of {', '.join(known)}",
                    "wrong_unit",
                )
        self._refuse_slow(page)
        return page

    def _refuse_slow(self, page: SensorPage) -> None:
        if page.rate_hz is not None and page.rate_hz < LOWEST_HZ:
            raise ForceError(
                f"{self._records.name}: the sensor sends {page.rate_hz} records/s; set its RDT output rate to at "
                f"least {LOWEST_HZ}",
                "slow_records",
            )
        cutoff_hz = _CUTOFFS_HZ[page.filter_number] if page.filter_number in range(len(_CUTOFFS_HZ)) else 1
        if cutoff_hz is not None and 1 / cutoff_hz > self.sample_period_s + self._latency_s:
            raise ForceError(
                f"{self._records.name}: the low-pass filter of the sensor ({cutoff_hz} Hz) delays readings; use a "
                f"faster one, or set force.latency_s to at least {1 / cutoff_hz:.3g}",
                "slow_filter",
            )

    def _word(self, text: str, tag: str) -> str:
        found = re.search(rf"<{tag}>\s*([^<>]{{1,80}}?)\s*</{tag}>", text)
        if found is None:
            raise self._bad_page(f"no {tag}")
        return found[1]

    def _number(self, text: str, tag: str, otherwise: int | None = None) -> int:
        if otherwise is not None and f"<{tag}>" not in text:
            return otherwise
        word = self._word(text, tag)
        if not re.fullmatch(r"\d{1,10}", word, re.ASCII):
            raise self._bad_page(f"{tag} = {word!r}")
        return int(word)

    # --- records ---

    def _start(self) -> None:
        """Start the stream, and wait for its first record, which may have been under way before."""
        self._drain()
        self._sequence = Sequence()
        self._bits, self._reported = 0, False
        self._records.write(START)
        self._record(START_S)
        self._runs, self._read_s = True, self._clock.monotonic_s()

    def _newest(self) -> tuple[NDArray[np.float64], int]:
        """Return axes (N, N·m) of the next new record, and the status of all records since the last reading."""
        if self._page is None:
            self.identify()
        assert self._page is not None
        if not self._runs:
            self._start()
        now_s = self._clock.monotonic_s()
        if now_s - self._read_s > _PAUSE_S:
            self._sequence.forget()
        self._drain()
        self._bits = 0 if self._reported else self._bits  # What was reported once may be over.
        try:
            record = self._record(MAX_AGE_S)
        except ForceTimeout:
            self._runs = False  # The sensor may have been switched off; the next reading starts the stream again.
            raise
        self._read_s = self._clock.monotonic_s()
        status, self._bits = self._bits, 0
        return record["axes"] * self._page.newtons, status

    def _drain(self) -> None:
        """Count the records that have arrived."""
        for data in arrived(self._records):
            self._take(data)

    def _record(self, within_s: float) -> NDArray[Any]:
        """Return the next new record."""
        deadline_s, self._odd = self._clock.monotonic_s() + within_s, 0
        while (left_s := deadline_s - self._clock.monotonic_s()) > 0:
            found = self._take(self._records.read(left_s))
            if found is not None:
                return found
        if self._odd:
            raise ForceError(
                f"{self._records.name}: {self._odd} datagrams are not records of {_RECORD.itemsize} bytes; check "
                "force.port",
                "garbled",
            )
        raise ForceTimeout(
            f"{self._records.name}: no new record within {within_s:g} s; check the power and the cable", "no_reply"
        )

    def _take(self, data: bytes) -> NDArray[Any] | None:
        """Count records, collect their status bits, and return the newest; a datagram of another length is none."""
        if len(data) % _RECORD.itemsize:
            self._odd += 1
            return None
        records = np.frombuffer(data, _RECORD)
        if len(records):
            self._bits |= int(np.bitwise_or.reduce(records["status"]))
        at = self._sequence.newest(records["rdt"], records["ft"])
        return None if at is None else records[at]

    def _refuse(self, status: int, force_n: float) -> None:
        """Raise an error if any record since the last reading had a status other than 0."""
        self._reported = status != 0
        if not status:
            return
        port = self._records.name
        errors = status & ~(1 << 31 | SATURATED | MONITOR)
        if errors:
            meaning = ", ".join(word for bit, word in _MEANINGS.items() if errors >> bit & 1) or "analog board"
            raise ForceBroken(f"{port}: the sensor reports an error: {meaning} (status {status:08X})", "sensor_error")
        if status & SATURATED:
            kind = ForceUnderload if force_n < 0 else ForceOverload
            raise kind(f"{port}: the sensor is saturated (status {status:08X}); remove the load", "saturated")
        raise ForceError(
            f"{port}: a monitor condition of the sensor is active (status {status:08X}); see its threshold page",
            "monitor_condition",
        )


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> NetFtForce:
    force = settings.force
    return _sensor(opener(force.port), lambda: opener(page_port(force)), clock, settings)


def _sensor(records: Transport, page: Callable[[], Transport], clock: Clock, settings: BenchSettings) -> NetFtForce:
    force = settings.force
    return NetFtForce(
        records,
        page,
        clock,
        force.own(NetFtSettings),
        sample_period_s=force.sample_period_s,
        latency_s=force.latency_s,
        resolution_gwt=force.resolution_gwt,
        scale=settings.calibration.value("force_scale", 1.0),
    )


def page_port(force: ForceSettings) -> str:
    """Return the port of the sensor's web page."""
    host = force.port.removeprefix("udp://").rpartition(":")[0]
    return f"tcp://{host or 'localhost'}:{force.own(NetFtSettings).http_port}"


def _probe(opener: Opener, clock: Clock, settings: BenchSettings) -> str | None:
    """Read the page of a sensor at a udp:// port."""
    force = settings.force
    if not force.port.startswith("udp://"):
        return None
    page = opener(page_port(force))
    try:
        return _sensor(page, lambda: page, clock, settings).identify()
    except ForceTimeout:
        return None
    except ForceError as error:
        if error.code in ("no_counts", "garbled"):
            return None
        raise


DEVICE = ForceKind(
    name="net_ft",
    device="ATI Net F/T six-axis sensor",
    driver=_driver,
    settings=NetFtSettings,
    twin="sim.devices.net_ft:net_ft_twin",
    probe=_probe,
    datagrams=True,
    page_port="http_port",
    max_age_s=lambda force: MAX_AGE_S,
    also=(*_AXES, *_COUNTS),
    tests=("tests/rig/test_net_ft_driver.py", "tests/rig/test_net_ft_clients.py"),
    evidence=Evidence(manual="netft-cpp, netft_utils, ati-netft-cpp", client="pynetft 2.1.3"),
)
