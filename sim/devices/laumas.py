"""Virtual Laumas TLB / TLU load-cell transmitter: registers, samples, filter and status word.

Source: Laumas TLU manual, list of registers (identity in 0–4); LCB manual, status register 1 and weights as unsigned
numbers. The command numbers and the coding of register 13 come from secondary sources and so are parameters.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from sim.devices.clock import Scheduler
from sim.devices.line import Load, Samples, SerialLine, VirtualForceSpec
from sim.devices.modbus import ILLEGAL_ADDRESS, ILLEGAL_VALUE, ModbusBus, RegisterFault, words

COMMAND = 5  # the only writable register
CELL, ADC, OVER_MAX, OVER_SCALE, GROSS_OUT, NET_OUT = (1 << bit for bit in range(6))
GROSS_MINUS, NET_MINUS, PEAK_MINUS, NET_SHOWN, STABLE, ZERO = (1 << bit for bit in range(7, 13))
MOST_REGISTERS = 32
USUAL_IDS = (1, 2)  # alone on its port, it also answers to the ids that clients assume
_WIDEST = 999_999
_STABLE_SAMPLES = 3


@dataclass(frozen=True)
class TransmitterMenu:
    """Settings made on the transmitter itself.

    A weight is the mean of the last filter_samples samples, rounded to division_g and reported in counts of count_g,
    which units_word encodes. max_g is the maximum weight, full_scale_g the cell's, set_point_g the relay's.
    """

    sample_period_s: float = 0.0125
    filter_samples: int = 4
    count_g: float = 0.01
    division_g: float = 0.01
    max_g: float = 200.0
    full_scale_g: float = 300.0
    units_word: int = 0x010C
    set_point_g: float | None = None


@dataclass(frozen=True)
class TransmitterFirmware:
    """Differences between transmitters: identity in registers 0–4, location of signs, command numbers.

    signs: in the status word, or in the registers too.
    """

    identity: tuple[int, ...] = (0x0105, 30, 2024, 1234, 1)
    signs: Literal["status", "registers"] = "status"
    tare_command: int = 7
    zero_command: int = 8
    gross_command: int = 9


class VirtualLaumas:
    """Transmitter with a load. A weight is stable when at least three fresh samples lie within a division.

    `broken` holds the status bits of a cut wire or a dead converter.
    """

    functions = frozenset({0x03, 0x10})

    def __init__(
        self,
        scheduler: Scheduler,
        load: Load,
        menu: TransmitterMenu | None = None,
        firmware: TransmitterFirmware | None = None,
    ) -> None:
        self._menu, self._firmware = menu or TransmitterMenu(), firmware or TransmitterFirmware()
        self._scheduler = scheduler
        self._samples = Samples(scheduler, load, self._menu.sample_period_s)
        self._commands = {
            self._firmware.tare_command: self._tare,
            self._firmware.zero_command: self._zero,
            self._firmware.gross_command: self._show_gross,
        }
        self._zero_g = self._tare_g = self._peak_g = 0.0
        self._net_shown = False
        self.broken = 0

    def wire(self, switch: Callable[[bool], None]) -> None:
        """Connect the relay: from now on it switches at samples, without the host."""
        closed = False

        def check() -> None:
            nonlocal closed
            grams, _ = self._filtered()
            over = self._menu.set_point_g is not None and grams - self._zero_g >= self._menu.set_point_g
            if over != closed:
                closed = over
                switch(closed)
            self._scheduler.call_at(self._scheduler.monotonic_s() + self._menu.sample_period_s, check)

        check()

    def read(self, address: int, count: int) -> list[int]:
        """Return registers of the last sample, at most 32. Raises RegisterFault."""
        if count > MOST_REGISTERS:
            raise RegisterFault(ILLEGAL_VALUE)
        shown = self._shown()
        if address + count > len(shown):
            raise RegisterFault(ILLEGAL_ADDRESS)
        return shown[address : address + count]

    def write(self, address: int, values: Sequence[int]) -> None:
        """Execute a command. Raises RegisterFault."""
        if address != COMMAND or len(values) != 1:
            raise RegisterFault(ILLEGAL_ADDRESS)
        if values[0] not in self._commands:
            raise RegisterFault(ILLEGAL_VALUE)
        self._commands[values[0]]()

    def _shown(self) -> list[int]:
        grams, stable = self._filtered()
        broken = self.broken | CELL * math.isnan(grams)
        if broken:
            grams, stable = self._zero_g, False
        gross = self._rounded(grams - self._zero_g)
        net = self._rounded(grams - self._zero_g - self._tare_g)
        self._peak_g = max(self._peak_g, gross)
        weights = (gross, net, self._peak_g)
        status = broken | self._status(gross, net) | STABLE * stable
        pairs = [self._pair(weight) for weight in weights]
        return [
            *self._firmware.identity,
            0,
            status,
            *(word for pair in pairs for word in pair),
            self._menu.units_word,
            *self._set_point(),
        ]

    def _set_point(self) -> list[int]:
        """Return the sensitivity, which no client reads, and the relay's set-point in counts."""
        set_point_g = self._menu.set_point_g
        return [] if set_point_g is None else [0, 0, *words(round(set_point_g / self._menu.count_g))]

    def _status(self, gross: float, net: float) -> int:
        widest_g = _WIDEST * self._menu.count_g
        return (
            OVER_MAX * (gross > self._menu.max_g + 9 * self._menu.division_g)
            | OVER_SCALE * (gross > 1.1 * self._menu.full_scale_g)
            | GROSS_OUT * (abs(gross) > widest_g)
            | NET_OUT * (abs(net) > widest_g)
            | GROSS_MINUS * (gross < 0)
            | NET_MINUS * (net < 0)
            | NET_SHOWN * self._net_shown
            | ZERO * (abs(gross) < 0.25 * self._menu.division_g)
        )

    def _pair(self, grams: float) -> list[int]:
        counts = min(max(round(grams / self._menu.count_g), -_WIDEST), _WIDEST)
        return words(counts if self._firmware.signs == "registers" else abs(counts))

    def _rounded(self, grams: float) -> float:
        return round(grams / self._menu.division_g) * self._menu.division_g

    # --- samples ---

    def _filtered(self) -> tuple[float, bool]:
        """Return the mean of the last samples in g, NaN with a dead cell, and whether they lie within a division."""
        newest, averaged = self._samples.newest(), self._menu.filter_samples
        recent = [self._samples.grams(newest - k) for k in range(averaged)]
        stable = self._samples.steady(newest, max(averaged, _STABLE_SAMPLES), self._menu.division_g)
        return sum(recent) / averaged, stable

    # --- commands ---

    def _tare(self) -> None:
        self._tare_g, self._net_shown = self._filtered()[0] - self._zero_g, True

    def _zero(self) -> None:
        self._zero_g, self._tare_g, self._net_shown = self._filtered()[0], 0.0, False

    def _show_gross(self) -> None:
        self._tare_g, self._net_shown = 0.0, False


def laumas_twin(scheduler: Scheduler, line: SerialLine, spec: VirtualForceSpec, load: Load) -> VirtualLaumas:
    """Return a transmitter alone on its line."""
    own = spec.own
    menu = TransmitterMenu(
        sample_period_s=spec.sample_period_s,
        filter_samples=own["filter_samples"],
        count_g=own["count_g"],
        division_g=spec.resolution_g,
        units_word=own["units_word"],
        set_point_g=spec.set_point_g,
    )
    firmware = TransmitterFirmware(
        signs=own["signs"],
        tare_command=own["tare_command"],
        zero_command=own["zero_command"],
        gross_command=own["gross_command"],
    )
    transmitter = VirtualLaumas(scheduler, load, menu, firmware)
    ModbusBus(scheduler, line, dict.fromkeys((*USUAL_IDS, own["device_id"]), transmitter), framing=spec.framing)
    return transmitter
