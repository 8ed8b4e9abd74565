"""Virtual balance that speaks MT-SICS level 0 and 1. Source: MT-SICS reference manual.

Assumed, not from a manual: the serial number as the answer to `@`, the stability band and times, the underload limit.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from sim.devices.clock import Handle, Scheduler
from sim.devices.line import Load, Samples, SerialLine, VirtualForceSpec

MODEL, SOFTWARE = "virtual-balance", "1.00"


@dataclass
class _Pending:
    """Command that waits for a stable load, which `done` then gets in g."""

    key: str
    done: Callable[[float], None]
    until_s: float


@dataclass(frozen=True)
class BalanceMenu:
    """Settings made on the balance itself.

    range_g and resolution_g are of the display; a load is stable when the last stable_samples samples lie within
    stable_band_g; S, Z and T give up after patience_s; below underload_g the answer is underload.
    """

    range_g: float = 200.0
    resolution_g: float = 0.01
    sample_period_s: float = 0.05
    stable_samples: int = 3
    stable_band_g: float = 0.02
    patience_s: float = 3.0
    underload_g: float = -20.0
    serial_number: str = "0123456789"


class VirtualBalance:
    """Balance with a load, at the end of a serial line. A load that is not fresh is never stable."""

    def __init__(self, scheduler: Scheduler, line: SerialLine, load: Load, menu: BalanceMenu | None = None) -> None:
        self._scheduler, self._wire, self._menu = scheduler, line, menu or BalanceMenu()
        self._samples = Samples(scheduler, load, self._menu.sample_period_s)
        self._decimals = max(0, round(-math.log10(self._menu.resolution_g)))
        self._zero_g = self._tare_g = 0.0
        self._text = b""
        self._pending: _Pending | None = None
        self._timer: Handle | None = None
        self.mute = False
        line.connect(self._on_bytes)

    # --- samples ---

    def _stable(self, number: int) -> bool:
        return self._samples.steady(number, self._menu.stable_samples, self._menu.stable_band_g)

    def _steady(self) -> str:
        return "S" if self._stable(self._samples.newest()) else "D"

    def _load(self, number: int) -> float | str:
        """Return net grams, or the sign of an overload or underload; "I" for a broken cell."""
        grams = self._samples.grams(number)
        if math.isnan(grams):
            return "I"
        if grams > self._menu.range_g:
            return "+"
        return "-" if grams < self._menu.underload_g else grams - self._zero_g - self._tare_g

    # --- bytes ---

    def _on_bytes(self, data: bytes) -> None:
        *lines, self._text = (self._text + data).split(b"\n")
        for line in lines:
            self._obey(line.strip(b"\r"))

    def _obey(self, line: bytes) -> None:
        if not line.isascii():
            self._send("ET")
            return
        command, *rest = line.decode("ascii").split() or [""]
        _, act = self._commands.get(command, (0, None))
        if act is None:
            self._send("ES")
        elif command == "TA" and rest:
            self._preset_tare(rest)
        elif rest:
            self._send("EL")
        elif self._pending is not None and command != "@":
            self._send(f"{command[0]} I")
        else:
            self._stop_timer()
            act()

    @cached_property
    def _commands(self) -> dict[str, tuple[int, Callable[[], None]]]:
        """Level of each command, and what executes it."""
        return {
            "S": (0, lambda: self._when_stable("S", lambda grams: self._send(f"S S {self._shown(grams)}"))),
            "SI": (0, self._answer_now),
            "SIR": (0, self._repeat),
            "Z": (0, lambda: self._when_stable("Z", lambda _: self._set_zero("Z", "A"))),
            "ZI": (0, lambda: self._set_zero("ZI", self._steady())),
            "T": (1, lambda: self._when_stable("T", lambda _: self._set_tare("T", "S"))),
            "TI": (1, lambda: self._set_tare("TI", self._steady())),
            "TA": (1, lambda: self._send(f"TA A {self._shown(self._tare_g)}")),
            "TAC": (1, self._clear_tare),
            "I0": (0, self._list_commands),
            "I1": (0, lambda: self._send('I1 A "01" "2.30" "2.20" "" ""')),
            "I2": (0, lambda: self._send(f'I2 A "{MODEL} {self._menu.range_g:.{self._decimals}f} g"')),
            "I3": (0, lambda: self._send(f'I3 A "{SOFTWARE}"')),
            "I4": (0, lambda: self._send(f'I4 A "{self._menu.serial_number}"')),
            "@": (0, self._cancel),
        }

    def _send(self, line: str) -> None:
        if not self.mute:
            self._wire.device_write(f"{line}\r\n".encode("ascii"))

    def _shown(self, grams: float) -> str:
        steps = round(grams / self._menu.resolution_g)
        return f"{steps * self._menu.resolution_g:10.{self._decimals}f} g"

    # --- commands ---

    def _answer_now(self) -> None:
        number = self._samples.newest()
        load = self._load(number)
        if isinstance(load, str):
            self._send(f"S {load}")
        else:
            self._send(f"S {'S' if self._stable(number) else 'D'} {self._shown(load)}")

    def _repeat(self) -> None:
        self._answer_now()
        self._at_next_sample(self._repeat)

    def _set_zero(self, key: str, done: str) -> None:
        load = self._load(self._samples.newest())
        if not isinstance(load, str):
            self._zero_g, self._tare_g = self._samples.grams(self._samples.newest()), 0.0
            load = done
        self._send(f"{key} {load}")

    def _set_tare(self, key: str, done: str) -> None:
        load = self._load(self._samples.newest())
        if not isinstance(load, str):
            self._tare_g += load
            load = f"{done} {self._shown(self._tare_g)}"
        self._send(f"{key} {load}")

    def _preset_tare(self, rest: list[str]) -> None:
        if len(rest) != 2 or rest[1] != "g" or not re.fullmatch(r"\d+(\.\d*)?", rest[0]):
            self._send("EL")
            return
        self._tare_g = float(rest[0])
        self._send(f"TA A {self._shown(self._tare_g)}")

    def _clear_tare(self) -> None:
        self._tare_g = 0.0
        self._send("TAC A")

    def _list_commands(self) -> None:
        """List commands, one line each with its level; all but the last announce more (B)."""
        *names, last = sorted(self._commands)
        for name in (*names, last):
            self._send(f'I0 {"A" if name == last else "B"} {self._commands[name][0]} "{name}"')

    def _cancel(self) -> None:
        self._pending, self._tare_g = None, 0.0
        self._commands["I4"][1]()

    # --- waiting ---

    def _when_stable(self, key: str, done: Callable[[float], None]) -> None:
        pending = _Pending(key, done, self._scheduler.monotonic_s() + self._menu.patience_s)
        self._pending = pending
        self._check_stable(pending)

    def _check_stable(self, pending: _Pending) -> None:
        number = self._samples.newest()
        load = self._load(number)
        late = self._scheduler.monotonic_s() >= pending.until_s
        if load in ("+", "-") or late:
            self._pending = None
            self._send(f"{pending.key} {load if load in ('+', '-') else 'I'}")
        elif not isinstance(load, str) and self._stable(number):
            self._pending = None
            pending.done(load)
        else:
            self._at_next_sample(lambda: self._check_stable(pending))

    def _at_next_sample(self, action: Callable[[], None]) -> None:
        self._timer = self._scheduler.call_at(self._samples.next_s(), action)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def balance_twin(scheduler: Scheduler, line: SerialLine, spec: VirtualForceSpec, load: Load) -> VirtualBalance:
    """Return a balance with a load."""
    menu = BalanceMenu(resolution_g=spec.resolution_g, sample_period_s=spec.sample_period_s)
    return VirtualBalance(scheduler, line, load, menu)
