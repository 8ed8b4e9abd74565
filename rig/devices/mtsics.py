"""Force sensor: balance with MT-SICS level 0 and 1.

Source: MT-SICS reference manual. Replies are split at white space, not at columns. The manual does not say that `@`
returns the serial number, so I4 is sent as well.
"""

import re

from rig.clock import Clock
from rig.devices.base import (
    ForceBusy,
    ForceError,
    ForceOverload,
    ForceReading,
    ForceSensor,
    ForceTimeout,
    ForceUnderload,
    no_line,
)
from rig.devices.registry import Evidence, ForceKind, Opener
from rig.settings import BenchSettings
from rig.transport import LineReader, Transport
from rig.units import GWT_N

REPLY_S = 0.5
# A busy balance is asked again at this interval, longer than a reply takes, until REPLY_S after the first request.
ASK_AGAIN_S = 0.05
# Zero waits in the balance for a stable load.
SETTLE_S = 10.0

_NUMBERED = "I4 A"
_VALUE = re.compile(r"[+-]?\d+(\.\d*)?")
_SYNTAX = {
    "ES": ("unknown_command", "does not know the command"),
    "ET": ("garbled_command", "received a garbled command"),
    "EL": ("not_possible", "cannot carry out the command"),
}


class MtSicsForce:
    """ForceSensor with an MT-SICS balance set to grams.

    sample_period_s and resolution_gwt are those of the instrument; scale is true force divided by its reading.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        *,
        sample_period_s: float = 0.05,
        resolution_gwt: float = 0.01,
        scale: float = 1.0,
    ) -> None:
        self.sample_period_s, self.resolution_gwt = sample_period_s, scale * resolution_gwt
        self._scale = scale
        self._transport = transport
        self._clock = clock
        self._reader = LineReader(transport, clock)
        self._in_step = False

    def connect(self) -> str:
        """Reset the balance, including its tare, and return its serial number. Raises ForceError."""
        return f"MT-SICS balance {self._hello('@', 'I4')}"

    def identify(self) -> str:
        """Return the serial number without a reset, which would clear the tare. Raises ForceError."""
        return f"MT-SICS balance {self._hello('I4')}"

    def read(self) -> ForceReading:
        """Ask for a weight, and again while the balance is busy. Raises ForceError."""
        until_s = self._clock.monotonic_s() + REPLY_S
        while True:
            try:
                words = self._ask("SI", until_s - self._clock.monotonic_s())
                return ForceReading(self._newton(words), words[1] == "S", self._clock.monotonic_s())
            except ForceBusy:
                # The last request needs time for its reply: a late one would put the balance out of step.
                if self._clock.monotonic_s() + 2 * ASK_AGAIN_S > until_s:
                    raise
                self._clock.wait_s(ASK_AGAIN_S)

    def zero(self) -> None:
        """Zero at the next stable load. Raises ForceError."""
        if self._ask("Z", SETTLE_S)[1] != "A":
            raise self._garbled("Z")

    def close(self) -> None:
        self._transport.close()

    def _newton(self, words: list[str]) -> float:
        if len(words) != 4 or words[1] not in ("S", "D") or not _VALUE.fullmatch(words[2]):
            raise self._garbled(" ".join(words))
        if words[3] != "g":
            raise ForceError(
                f"{self._transport.name}: the balance reports the unit {words[3]}; set it to g", "wrong_unit"
            )
        return float(words[2]) * GWT_N * self._scale

    def _ask(self, command: str, timeout_s: float) -> list[str]:
        if not self._in_step:
            self._hello("@", "I4")
        self._reader.discard()
        self._send(command)
        line = self._reader.read_line(self._clock.monotonic_s() + timeout_s)
        if line is None:
            # A late reply must not count as the reply to the next command.
            self._in_step = False
            raise no_line(
                self._transport.name,
                self._reader.unended,
                f"the balance did not answer {command} within {timeout_s:.2g} s; check the power and the cable",
                "no_reply",
            )
        words = line.split()
        self._check(words, command)
        return words

    def _check(self, words: list[str], command: str) -> None:
        port = self._transport.name
        if words[0] in _SYNTAX:
            code, problem = _SYNTAX[words[0]]
            raise ForceError(f"{port}: the balance {problem} ({words[0]} to {command})", code)
        if len(words) < 2 or words[0] != command[:1]:
            raise self._garbled(" ".join(words))
        if words[1] == "+":
            raise ForceOverload(f"{port}: the balance is overloaded; remove the load", "overload")
        if words[1] == "-":
            raise ForceUnderload(
                f"{port}: the balance is underloaded; check that nothing lifts it off its support", "underload"
            )
        if words[1] == "I":
            raise ForceBusy(f"{port}: the balance is busy or found no stable value ({command}); try again", "busy")

    def _hello(self, *commands: str) -> str:
        self._in_step = False
        self._reader.discard()
        for command in commands:
            self._send(command)
            deadline_s = self._clock.monotonic_s() + REPLY_S
            while (line := self._reader.read_line(deadline_s)) is not None:
                if line.startswith(_NUMBERED):
                    self._in_step = True
                    return line.removeprefix(_NUMBERED).strip(' "')
        raise no_line(
            self._transport.name,
            self._reader.unended,
            "no balance answers; check the power, the cable and force.baud",
            "no_device",
        )

    def _send(self, command: str) -> None:
        self._transport.write(command.encode("ascii") + b"\r\n")

    def _garbled(self, answer: str) -> ForceError:
        self._in_step = False
        return ForceError(
            f"{self._transport.name}: the balance sent a garbled answer, {answer!r}; check the cable and force.baud",
            "garbled",
        )


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> ForceSensor:
    return MtSicsForce(
        opener(settings.force.port),
        clock,
        sample_period_s=settings.force.sample_period_s,
        resolution_gwt=settings.force.resolution_gwt,
        scale=settings.calibration.value("force_scale", 1.0),
    )


def _probe(opener: Opener, clock: Clock, settings: BenchSettings) -> str | None:
    """Ask for the serial number (I4), twice since bytes for other devices may precede it, and for a weight (SI)."""
    balance = MtSicsForce(opener(settings.force.port), clock)
    try:
        identity = f"MT-SICS balance {balance._hello('I4', 'I4')}"
    except ForceTimeout:
        if _NUMBERED.encode() in balance._reader.unended:
            raise
        return None
    try:
        balance.read()
    except ForceError as error:
        if error.code == "wrong_unit":
            raise
    return identity


DEVICE = ForceKind(
    name="mtsics",
    device="MT-SICS balance",
    driver=_driver,
    twin="sim.devices.mtsics:balance_twin",
    probe=_probe,
    max_age_s=lambda force: REPLY_S,
    tests=("tests/rig/test_mtsics_driver.py",),
    evidence=Evidence(manual="MT-SICS reference manual, levels 0 and 1"),
)
