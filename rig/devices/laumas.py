"""Force sensor: Laumas TLB or TLU load-cell transmitter over Modbus.

Source: Laumas TLU manual, list of registers; LCB manual, status register 1. LaumasSettings names other sources.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from rig.clock import Clock
from rig.devices.base import (
    ForceBroken,
    ForceBusy,
    ForceError,
    ForceOverload,
    ForceReading,
    ForceSensor,
    ForceTimeout,
    ForceUnderload,
)
from rig.devices.registry import Evidence, ForceKind, Opener
from rig.settings import BenchSettings, LaumasSettings
from rig.transport.modbus import REPLY_S, ModbusError, ModbusMaster, ModbusRefused, ModbusTimeout
from rig.units import GWT_N

# Registers by their 0-based address; weights are two registers, high word first.
IDENTITY, COMMAND, STATUS, GROSS, NET, UNITS = 0, 5, 6, 7, 9, 13
SETTLE_S = 10.0


class LaumasForce:
    """ForceSensor with a Laumas transmitter.

    sample_period_s and resolution_gwt are settings of the instrument; scale is true force divided by its reading.
    """

    def __init__(
        self,
        bus: ModbusMaster,
        clock: Clock,
        settings: LaumasSettings,
        *,
        sample_period_s: float = 0.05,
        resolution_gwt: float = 0.01,
        scale: float = 1.0,
    ) -> None:
        self.sample_period_s = settings.filter_samples * sample_period_s
        self.resolution_gwt = scale * resolution_gwt
        self._bus, self._clock, self._settings = bus, clock, settings
        self._count_n = scale * settings.count_g * GWT_N

    def connect(self) -> str:
        """Check the division and unit, and return type and serial number. Raises ForceError."""
        firmware, kind, year, serial = self._read(IDENTITY, 4, silent="no_device")
        self._snapshot()
        return f"Laumas transmitter type {kind}, serial {serial} of {year}, firmware {firmware}"

    def identify(self) -> str:
        return self.connect()

    def read(self) -> ForceReading:
        """Return the latest weight as a force (N). Raises ForceError, or the subclass that the status indicates."""
        return self._reading(self._snapshot())

    def zero(self) -> None:
        """Zero at the next stable load, or tare if the net weight is read. Raises ForceError."""
        settings = self._settings
        deadline_s = self._clock.monotonic_s() + SETTLE_S
        while not self.read().stable:
            if self._clock.monotonic_s() >= deadline_s:
                raise ForceBusy(
                    f"{self._label}: no stable load within {SETTLE_S:g} s; let the load settle and zero again",
                    "no_stable_load",
                )
            self._clock.wait_s(self.sample_period_s)
        number = settings.zero_command if settings.weight == "gross" else settings.tare_command
        with self._errors():
            self._bus.write(settings.device_id, COMMAND, [number])
        self._clock.wait_s(self.sample_period_s)
        left_gwt = self.read().force_n / GWT_N
        if abs(left_gwt) > self.resolution_gwt:
            raise ForceBusy(
                f"{self._label}: the weight is {left_gwt:.3g} gwt after zeroing; zero again", "not_zeroed"
            )

    def set_point_gwt(self, register: int) -> float:
        """Return the force at which the instrument's relay switches, from two registers. Raises ForceError."""
        high, low = self._read(register, 2)
        return (high << 16 | low) * self._count_n / GWT_N

    def close(self) -> None:
        self._bus.close()

    def _snapshot(self) -> list[int]:
        """Return registers 6 … 13 of one instant, in the expected unit."""
        registers = self._read(STATUS, UNITS - STATUS + 1)
        units = registers[UNITS - STATUS]
        if units != self._settings.units_word:
            raise ForceError(
                f"{self._label}: division and unit (register {UNITS}) are 0x{units:04X}, but force.laumas.units_word "
                f"is 0x{self._settings.units_word:04X}; make them equal",
                "wrong_unit",
            )
        return registers

    def _reading(self, registers: list[int]) -> ForceReading:
        status, bits = registers[0], self._settings.bits
        gross = self._settings.weight == "gross"
        first = (GROSS if gross else NET) - STATUS
        counts = registers[first] << 16 | registers[first + 1]
        if self._settings.signs == "registers":
            negative = counts >> 31 == 1
            counts = (1 << 32) - counts if negative else counts
        else:
            negative = _bit(status, bits.gross_negative if gross else bits.net_negative)
        self._refuse(status, negative=negative)
        force_n = (-counts if negative else counts) * self._count_n
        return ForceReading(force_n, _bit(status, bits.stable), self._clock.monotonic_s())

    def _refuse(self, status: int, *, negative: bool) -> None:
        bits = self._settings.bits
        if _bit(status, bits.cell_error):
            raise ForceBroken(f"{self._label}: load cell error; check the cable of the cell", "cell_error")
        if _bit(status, bits.converter_error):
            raise ForceBroken(
                f"{self._label}: the analog-to-digital converter has failed; see the manual of the transmitter",
                "converter_error",
            )
        for bit, code, problem in (
            (bits.over_max, "over_max", "the weight exceeds the maximum set in the transmitter"),
            (bits.over_full_scale, "over_full_scale", "the weight exceeds 110 % of full scale"),
            (bits.gross_out_of_range, "gross_out_of_range", "the gross weight is out of range"),
            (bits.net_out_of_range, "net_out_of_range", "the net weight is out of range"),
        ):
            if _bit(status, bit):
                kind = ForceUnderload if negative else ForceOverload
                raise kind(f"{self._label}: {problem}", code)

    def _read(self, address: int, count: int, *, silent: str = "no_reply") -> list[int]:
        with self._errors(silent):
            return self._bus.read(self._settings.device_id, address, count)

    @contextmanager
    def _errors(self, silent: str = "no_reply") -> Iterator[None]:
        """Convert Modbus errors to force errors. silent: error code for a missing reply."""
        try:
            yield
        except ModbusTimeout as error:
            raise ForceTimeout(str(error), silent) from error
        except ModbusError as error:
            code = error.code if isinstance(error, ModbusRefused) else "garbled"
            raise ForceError(str(error), code) from error

    @property
    def _label(self) -> str:
        return f"{self._bus.name}: transmitter {self._settings.device_id}"


def _bit(word: int, bit: int) -> bool:
    return bool(word >> bit & 1)


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> ForceSensor:
    force = settings.force
    return LaumasForce(
        ModbusMaster.on_port(opener(force.port), clock, force.port, framing=force.framing, baud=force.baud),
        clock,
        force.laumas,
        sample_period_s=force.sample_period_s,
        resolution_gwt=force.resolution_gwt,
        scale=settings.calibration.value("force_scale", 1.0),
    )


def _probe(opener: Opener, clock: Clock, settings: BenchSettings) -> str | None:
    """Read identity, weights and unit."""
    try:
        return _driver(opener, clock, settings).identify()
    except ForceError as error:
        if error.code == "wrong_unit":
            raise
        return None


DEVICE = ForceKind(
    name="laumas",
    device="Laumas TLB or TLU load-cell transmitter",
    driver=_driver,
    settings=LaumasSettings,
    twin="sim.devices.laumas:laumas_twin",
    probe=_probe,
    max_age_s=lambda force: 2 * REPLY_S,  # a request may first wait for the bus
    tests=("tests/rig/test_laumas_driver.py", "tests/rig/test_modbus_counterparties.py"),
    evidence=Evidence(
        manual="TLU manual, LCB protocols manual",
        client="minimalmodbus 2.1.1, modbus-tk 1.1.5, mbpoll 1.4.11",
    ),
)
