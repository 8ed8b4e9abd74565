"""Stage with two axes of Zaber X-series devices, x lateral and z vertical, on one port.

Sources: Zaber ASCII protocol manual, firmware 6 and 7; transcripts of the maker's client, zaber-motion 10.3.0.

A device counts microsteps away from its home position, and machine coordinates fall away from home, so the counts of
an axis are minus the machine coordinate. The driver writes only `limit.min` and `limit.max`, and only if they differ,
`limit.min` before the first steps of homing: a device stores its settings permanently.
"""

import math
import re
from collections.abc import Iterator
from contextlib import suppress

from rig.clock import Clock
from rig.devices.base import Stage, StageError
from rig.devices.counted_axis import AxisSpec, CountedAxis, Destination, Fault, FaultKind, Look, Setting, TwoAxisStage
from rig.devices.drive_link import READ_TRIES, both_answer
from rig.devices.registry import Evidence, Opener, StageKind
from rig.devices.zaber_link import NO_WARNING, Reply, ZaberLink
from rig.settings import BenchSettings, StageSettings, ZaberAxisSettings, ZaberSettings

# A stage that still moves so long after a stop gets an emergency stop.
ESTOP_AFTER_S = 0.3
LEAST_FIRMWARE = (7, 25)
# Way up that `limit.min` must leave to jogs before homing.
UNHOMED_ROOM_MM = 1.0

MANUAL, INTERRUPTED = "NC", "NI"
NOT_HOME = {"WR", "WH", INTERRUPTED}
FAULTS = {
    "FF": (FaultKind.ALARM, "critical system error"),
    "FN": (FaultKind.ALARM, "peripheral not supported"),
    "FZ": (FaultKind.ALARM, "peripheral inactive"),
    "FH": (FaultKind.ALARM, "hardware emergency stop"),
    "FV": (FaultKind.ALARM, "supply voltage out of range, driver off"),
    "FO": (FaultKind.ALARM, "driver disabled"),
    "FC": (FaultKind.ALARM, "current inrush error"),
    "FM": (FaultKind.ALARM, "motor temperature"),
    "FD": (FaultKind.ALARM, "driver disabled"),
    "FQ": (FaultKind.ALARM, "encoder error"),
    "FI": (FaultKind.ALARM, "index error"),
    "FA": (FaultKind.ALARM, "encoder synchronization"),
    "FR": (FaultKind.ALARM, "overdrive limit exceeded"),
    "FS": (FaultKind.ALARM, "stalled and stopped"),
    "FB": (FaultKind.ALARM, "stream bounds"),
    "FP": (FaultKind.ALARM, "path deviation"),
    "FE": (FaultKind.ALARM, "limit sensor not reached or faulty"),
    "FT": (FaultKind.ALARM, "excessive twist"),
    "WL": (FaultKind.ALARM, "unexpected limit sensor"),
    "WS": (FaultKind.ALARM, "stalled and recovered"),
    "WM": (FaultKind.DISPLACED, "moved while standing"),
    "WR": (FaultKind.LOST, "is no longer homed, probably because it was switched off"),
    "WH": (FaultKind.LOST, "is no longer homed, probably because it was switched off"),
    MANUAL: (FaultKind.HELD, ""),
    INTERRUPTED: (FaultKind.OVERRIDDEN, "another program or the device itself has interrupted the motion"),
    **dict.fromkeys(("WV", "WT", "WP", "ND", "NR", "NT", "NU", "NJ", "NB"), (FaultKind.HARMLESS, "")),
}
UNKNOWN = (FaultKind.ALARM, "unknown warning, see its manual")

_VERSION = re.compile(r"(\d+)\.(\d+)(?:\.\d+)?")


class ZaberAxis(CountedAxis[Look]):
    """One axis of a chain."""

    unhomed_refuses = (*CountedAxis.unhomed_refuses, FaultKind.DISPLACED)
    halt_again_s, stop_again_s = math.inf, math.inf  # A second halt would stop harder.
    link: ZaberLink

    def __init__(
        self, link: ZaberLink, clock: Clock, spec: AxisSpec, address: ZaberAxisSettings, units: ZaberSettings
    ) -> None:
        super().__init__(link, clock, spec, speed_unit=units.speed_unit, acceleration_unit=units.acceleration_unit)
        self._address, self._version = address, ""
        self._question = "get encoder.pos" if address.encoder else "get pos"

    # --- settings, limits ---

    def identify(self) -> str:
        address, axis = self._address.address, self._address.axis
        device_id = self.link.ask(address, 0, "get deviceid").data
        self._version = self.link.ask(address, 0, "get version").data
        return f"Zaber device {address}, axis {axis}, id {device_id}, firmware {self._version}"

    def settings(self) -> Iterator[Setting]:
        found = _VERSION.fullmatch(self._version)
        if found is None or (int(found[1]), int(found[2])) < LEAST_FIRMWARE:
            yield Setting("firmware of the device", self._version, "7.25 or later")
        yield Setting("resolution of the device", self._number("get resolution"), self._address.resolution)
        yield from self.accelerations({"accel of the device": self._number("get accel")})
        yield self._longest()

    def _longest(self) -> Setting:
        longest, travel = self._number("get limit.max"), self.counts(-self.travel_mm)
        enough = longest if longest >= travel else f"at least {travel} (stage.travel_mm)"
        return Setting("limit.max of the device", longest, enough)

    def finish_homing(self) -> None:
        """Make the limits of the device those of the travel; they are written only if they differ."""
        if self._number("get limit.min") != 0:
            self._set_limit("limit.min", 0)
        longest = self._longest()
        self.compare(longest)
        if longest.found != (travel := self.counts(-self.travel_mm)):
            self._set_limit("limit.max", travel)

    def allow_unhomed_jogs(self) -> None:
        """Lower `limit.min` if it leaves no way up to an axis without a home position; homing sets it again.

        Raises StageError.
        """
        if any(fault.kind is FaultKind.LOST for fault in self.look().faults):
            room = self.counts(-UNHOMED_ROOM_MM)
            if self._number("get pos") - room < self._number("get limit.min"):
                self._set_limit("limit.min", -self.counts(-self.travel_mm))

    def _set_limit(self, name: str, value: int) -> None:
        """Set a limit and read it back; again if a message was wrong, since no motion follows. Raises StageError."""
        for left in reversed(range(READ_TRIES)):
            try:
                self._command(f"set {name} {value}")
                self.compare(Setting(f"{name} of the device", self._number(f"get {name}"), value))
                return
            except StageError:
                if not left:
                    raise

    # --- motion ---

    def go(self, target: Destination, speed: int) -> None:
        way = f"abs {target.position}" if target.by is None else f"rel {target.by}"
        self._command(f"move {way} {speed}")

    def send_stop(self, after_s: float, *, halting: bool) -> None:
        if halting:
            self._command("stop")
        else:
            self.link.send_now("estop" if after_s >= ESTOP_AFTER_S else "stop")

    def sends_again(self, after_s: float, since_s: float, *, halting: bool) -> bool:
        if not halting and after_s >= ESTOP_AFTER_S:
            return not self.rests()
        return super().sends_again(after_s, since_s, halting=halting)

    def rests(self) -> bool:
        return not self._command("").busy

    def stop_now(self) -> None:
        self.link.send_now("stop")  # to every device of the chain

    def go_home(self) -> None:
        self._command("home")

    def not_home(self, found: Look) -> str | None:
        warnings = sorted(str(fault.number) for fault in found.faults)
        if abs(found.position) <= self.tolerance and not NOT_HOME & {*warnings}:
            return None
        return f"it is at {found.position} with the warnings {' '.join(warnings) or 'none'}"

    def clear(self) -> None:
        self.link.alerts.pop((self._address.address, self._address.axis), None)
        self._command("warnings clear")

    # --- state ---

    def look(self) -> Look:
        reply = self.link.ask(self._address.address, self._address.axis, self._question)
        faults = tuple(_fault(flag, busy=reply.busy) for flag in sorted(self._warnings(reply)))
        return Look(self._whole(reply.data, self._question), reply.busy, faults)

    def _warnings(self, reply: Reply) -> set[str]:
        """Return every warning of this axis: a reply shows the highest one alone, which may hide others."""
        alerted = self.link.alerts.pop((self._address.address, self._address.axis), NO_WARNING)
        found = {reply.warning, alerted} - {NO_WARNING}
        if found and not any(FAULTS.get(flag, UNKNOWN)[0] is FaultKind.ALARM for flag in found):
            listed = self.link.ask(self._address.address, self._address.axis, "warnings").data.split()
            found |= {*listed[1:]}  # after their number
        return found

    # --- helpers ---

    def _number(self, question: str) -> int:
        return self._whole(self.link.ask(self._address.address, self._address.axis, question).data, question)

    def _whole(self, data: str, question: str) -> int:
        if not re.fullmatch(r"-?\d{1,10}", data):
            raise StageError(f"{self.label}: {data!a} is not a reply to {question!r}", "no_number")
        return int(data)

    def _command(self, words: str) -> Reply:
        return self.link.command(self._address.address, self._address.axis, words)


def _fault(flag: str, *, busy: bool) -> Fault:
    kind, words = FAULTS.get(flag, UNKNOWN)
    if flag == MANUAL and not busy:
        kind, words = FaultKind.OVERRIDDEN, "somebody has moved it at its knob"
    return Fault(kind, flag, words)


class ZaberStage(TwoAxisStage[ZaberAxis]):
    """Stage with two axes of a Zaber chain."""

    def allow_unhomed_jogs(self) -> None:
        """Let the z axis jog up and down before homing. Raises StageError."""
        self._axes["z"].allow_unhomed_jogs()

    def _send_stop(self) -> None:
        self._axes["z"].stop_now()  # to every device of the chain


def steps_per_mm(stage: StageSettings, axis: str) -> float:
    """Return the microsteps per mm that the configuration gives; y has no motor."""
    own = stage.own(ZaberSettings)
    return -1e3 / (own.x if axis == "x" else own.z).microstep_um


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    stage = settings.stage
    link, own = ZaberLink(opener(stage.port), clock), stage.own(ZaberSettings)
    x, z = (
        ZaberAxis(link, clock, AxisSpec.of(settings, name, steps_per_mm(stage, name)), address, own)
        for name, address in (("x", own.x), ("z", own.z))
    )
    return ZaberStage(x, z, settings)


def _probe(opener: Opener, clock: Clock, settings: BenchSettings) -> str | None:
    """Ask both devices for their device id."""
    own = settings.stage.own(ZaberSettings)
    transport = opener(settings.stage.port)
    found: dict[int, str] = {}
    # The first command may follow bytes of another probe without a line end, and is then not understood.
    for address in 2 * list(dict.fromkeys((own.x.address, own.z.address))):
        if address in found:
            continue
        with suppress(StageError):
            found[address] = ZaberLink(transport, clock).command(address, 0, "get deviceid").data
    answers = {f"Zaber device {one}": one in found for one in (own.x.address, own.z.address)}
    if not both_answer(transport.name, answers, "one_device", "set the addresses under [stage.zaber]"):
        return None
    return "Zaber devices " + " and ".join(f"{address} (id {device_id})" for address, device_id in found.items())


DEVICE = StageKind(
    name="zaber",
    device="two axes of Zaber X-series devices (ASCII protocol)",
    driver=_driver,
    settings=ZaberSettings,
    axes="xz",
    steps_per_mm=steps_per_mm,
    twin="sim.devices.zaber:zaber_twin",
    ramps=True,
    probe=_probe,
    tests=("tests/rig/test_zaber_driver.py", "tests/rig/test_makers_clients.py"),
    evidence=Evidence(
        manual="ASCII protocol manual, firmware 6 and 7",
        client="zaber-motion 10.3.0",
    ),
)
