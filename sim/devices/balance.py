"""A virtual balance that speaks MT-SICS level 0 and 1. Source: MT-SICS reference manual.

Not from a manual: the serial number as the answer to `@`, the stability band and times, the underload limit.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

from sim.config.units import GWT_N
from sim.devices.clock import Handle, Scheduler
from sim.devices.line import SerialLine

_CACHE = 64


@dataclass
class _Pending:
    """A command that waits for a stable load, which `done` then gets in g."""

    key: str
    done: Callable[[float], None]
    until_s: float


class VirtualBalance:
    """Samples force_n (N at a time in s) on a fixed grid, and only those instants that somebody asks about.

    range_g and resolution_g of the display; a load is stable when the last stable_samples samples lie within
    stable_band_g and are fresh, which is whether the force of that instant is known and not just the last one before
    it; S, Z and T give up after patience_s; below underload_g the answer is underload.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        line: SerialLine,
        force_n: Callable[[float], float],
        *,
        range_g: float = 200.0,
        resolution_g: float = 0.01,
        sample_period_s: float = 0.05,
        stable_samples: int = 3,
        stable_band_g: float = 0.02,
        patience_s: float = 3.0,
        underload_g: float = -20.0,
        serial_number: str = "0123456789",
        fresh: Callable[[float], bool] = lambda t_s: True,
    ) -> None:
        self._scheduler, self._wire, self._force_n = scheduler, line, force_n
        self._range_g, self._resolution_g, self._underload_g = range_g, resolution_g, underload_g
        self._period_s, self._patience_s = sample_period_s, patience_s
        self._stable_samples, self._stable_band_g = stable_samples, stable_band_g
        self._serial_number, self._fresh = serial_number, fresh
        self._decimals = max(0, round(-math.log10(resolution_g)))
        self._zero_g = self._tare_g = 0.0
        self._samples: dict[int, float] = {}
        self._text = b""
        self._pending: _Pending | None = None
        self._timer: Handle | None = None
        self.mute = False
        line.connect(self._on_bytes)

    # --- samples ---

    def _index(self) -> int:
        return math.floor(self._scheduler.monotonic_s() / self._period_s + 1e-6)

    def _gross_g(self, index: int) -> float:
        grams = self._samples.get(index)
        if grams is None:
            if len(self._samples) >= _CACHE:
                self._samples.clear()
            grams = self._force_n(max(index, 0) * self._period_s) / GWT_N
            self._samples[index] = grams
        return grams

    def _stable(self, index: int) -> bool:
        indices = range(index - self._stable_samples + 1, index + 1)
        if not all(self._fresh(max(k, 0) * self._period_s) for k in indices):
            return False
        recent = [self._gross_g(k) for k in indices]
        return max(recent) - min(recent) <= self._stable_band_g

    def _load(self, index: int) -> float | str:
        """Net grams, or the sign of an overload or underload; a broken cell is neither."""
        grams = self._gross_g(index)
        if math.isnan(grams):
            return "I"
        if grams > self._range_g:
            return "+"
        return "-" if grams < self._underload_g else grams - self._zero_g - self._tare_g

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
        act = self._commands().get(command)
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

    def _commands(self) -> dict[str, Callable[[], None]]:
        return {
            "S": lambda: self._when_stable("S", lambda grams: self._send(f"S S {self._shown(grams)}")),
            "SI": self._answer_now,
            "SIR": self._repeat,
            "Z": lambda: self._when_stable("Z", lambda _: self._set_zero("Z", "A")),
            "ZI": lambda: self._set_zero("ZI", "S" if self._stable(self._index()) else "D"),
            "T": lambda: self._when_stable("T", lambda _: self._set_tare("T", "S")),
            "TI": lambda: self._set_tare("TI", "S" if self._stable(self._index()) else "D"),
            "TA": lambda: self._send(f"TA A {self._shown(self._tare_g)}"),
            "TAC": self._clear_tare,
            "I4": self._identify,
            "@": self._cancel,
        }

    def _send(self, line: str) -> None:
        if not self.mute:
            self._wire.device_write(f"{line}\r\n".encode("ascii"))

    def _shown(self, grams: float) -> str:
        steps = round(grams / self._resolution_g)
        return f"{steps * self._resolution_g:10.{self._decimals}f} g"

    # --- commands ---

    def _answer_now(self) -> None:
        index = self._index()
        load = self._load(index)
        if isinstance(load, str):
            self._send(f"S {load}")
        else:
            self._send(f"S {'S' if self._stable(index) else 'D'} {self._shown(load)}")

    def _repeat(self) -> None:
        self._answer_now()
        self._at_next_sample(self._repeat)

    def _set_zero(self, key: str, done: str) -> None:
        load = self._load(self._index())
        if isinstance(load, str):
            self._send(f"{key} {load}")
            return
        self._zero_g, self._tare_g = self._gross_g(self._index()), 0.0
        self._send(f"{key} {done}")

    def _set_tare(self, key: str, done: str) -> None:
        load = self._load(self._index())
        if isinstance(load, str):
            self._send(f"{key} {load}")
            return
        self._tare_g += load
        self._send(f"{key} {done} {self._shown(self._tare_g)}")

    def _preset_tare(self, rest: list[str]) -> None:
        if len(rest) != 2 or rest[1] != "g" or not re.fullmatch(r"\d+(\.\d*)?", rest[0]):
            self._send("EL")
            return
        self._tare_g = float(rest[0])
        self._send(f"TA A {self._shown(self._tare_g)}")

    def _clear_tare(self) -> None:
        self._tare_g = 0.0
        self._send("TAC A")

    def _identify(self) -> None:
        self._send(f'I4 A "{self._serial_number}"')

    def _cancel(self) -> None:
        self._pending, self._tare_g = None, 0.0
        self._identify()

    # --- waiting ---

    def _when_stable(self, key: str, done: Callable[[float], None]) -> None:
        pending = _Pending(key, done, self._scheduler.monotonic_s() + self._patience_s)
        self._pending = pending
        self._look(pending)

    def _look(self, pending: _Pending) -> None:
        index = self._index()
        load = self._load(index)
        late = self._scheduler.monotonic_s() >= pending.until_s
        if load in ("+", "-") or late:
            self._pending = None
            self._send(f"{pending.key} {load if load in ('+', '-') else 'I'}")
        elif not isinstance(load, str) and self._stable(index):
            self._pending = None
            pending.done(load)
        else:
            self._at_next_sample(lambda: self._look(pending))

    def _at_next_sample(self, action: Callable[[], None]) -> None:
        self._timer = self._scheduler.call_at((self._index() + 1) * self._period_s, action)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
