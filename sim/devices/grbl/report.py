"""What a GRBL 1.1h board says of itself. Source: GRBL 1.1 interface wiki."""

from dataclasses import dataclass

from sim.devices.grbl.gcode import MM_PER_INCH, Modal
from sim.devices.grbl.motion import Vec
from sim.devices.grbl.offsets import Offsets
from sim.devices.grbl.overrides import FULL, Overrides
from sim.devices.grbl.settings import GrblSettings

BANNER = "\r\nGrbl 1.1h ['$' for help]"
HELP = "[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]"
ENABLED, DISABLED, PROGRAM_END = "[MSG:Enabled]", "[MSG:Disabled]", "[MSG:Pgm End]"
UNLOCK = "[MSG:'$H'|'$X' to unlock]"
RX_BYTES = 128

_WCO_EVERY = {True: 30, False: 10}
_OV_EVERY = {True: 20, False: 10}
_SPINDLE_LETTER = {3: "S", 4: "C", 5: ""}


@dataclass
class Snapshot:
    """The board at the instant of a `?`: mm, mm/min, planner blocks and receive bytes free, limit pins."""

    state: str
    machine_mm: Vec
    feed: float
    blocks_free: int
    bytes_free: int
    pins: str
    modal: Modal
    offset_mm: Vec
    overrides: Overrides


class StatusReports:
    """Formats `<…>` lines; WCO and Ov come only now and then, less often while busy."""

    def __init__(self, settings: GrblSettings) -> None:
        self._settings = settings
        self._wco_in = 0
        self._ov_in = 0

    def start_over(self) -> None:
        self._wco_in = self._ov_in = 0

    def show_offset(self) -> None:
        """Work coordinates, or what they are printed in, have changed."""
        self._wco_in = 0

    def show_overrides(self) -> None:
        """Outputs were switched, or an override: Ov, and with it A, comes as soon as it can."""
        self._ov_in = 0

    def line(self, at: Snapshot) -> str:
        mask = int(self._settings[10])
        inches = self._settings.flag(13)
        parts = [at.state, self._position(at, bool(mask & 1), inches)]
        if mask & 2:
            parts.append(f"Bf:{at.blocks_free},{at.bytes_free}")
        parts.append(f"FS:{rate(at.feed, inches)},{self._rpm(at):.0f}")
        if at.pins:
            parts.append(f"Pn:{at.pins}")
        return f"<{'|'.join(parts + self._now_and_then(at, inches))}>"

    def _rpm(self, at: Snapshot) -> float:
        asked = 0.0 if at.modal.spindle == 5 else at.modal.speed * at.overrides.spindle / FULL
        return min(max(asked, self._settings[31]), self._settings[30]) if asked else 0.0

    def _position(self, at: Snapshot, as_machine: bool, inches: bool) -> str:
        if as_machine:
            return "MPos:" + coordinates(at.machine_mm, inches)
        (x, y, z), (i, j, k) = at.machine_mm, at.offset_mm
        return "WPos:" + coordinates((x - i, y - j, z - k), inches)

    def _now_and_then(self, at: Snapshot, inches: bool) -> list[str]:
        busy = at.state not in ("Idle", "Alarm", "Check", "Sleep")
        parts = []
        if self._wco_in > 0:
            self._wco_in -= 1
        else:
            self._wco_in = _WCO_EVERY[busy] - 1
            # The firmware never sends both in one line: Ov follows in the next.
            self._ov_in = max(self._ov_in, 1)
            parts.append("WCO:" + coordinates(at.offset_mm, inches))
        if self._ov_in > 0:
            self._ov_in -= 1
        else:
            self._ov_in = _OV_EVERY[busy] - 1
            parts.append(f"Ov:{at.overrides}")
            accessories = _SPINDLE_LETTER[at.modal.spindle] + ("F" if at.modal.coolant == 8 else "")
            parts += [f"A:{accessories}"] if accessories else []
        return parts


def coordinates(mm: Vec, inches: bool = False) -> str:
    x, y, z = mm
    if inches:
        return f"{x / MM_PER_INCH:.4f},{y / MM_PER_INCH:.4f},{z / MM_PER_INCH:.4f}"
    return f"{x:.3f},{y:.3f},{z:.3f}"


def build(info: str) -> list[str]:
    """The answer to `$I`."""
    return [f"[VER:1.1h.20190830:{info}]", "[OPT:V,15,128]"]


def rate(mm_min: float, inches: bool) -> str:
    return f"{mm_min / MM_PER_INCH:.1f}" if inches else f"{mm_min:.0f}"


def parser_state(modal: Modal, inches: bool) -> str:
    """The answer to `$G`; the tool is that of the line before, so nearly always 0."""
    units, distance, mode = 21 if modal.metric else 20, 90 if modal.absolute else 91, 93 if modal.inverse_time else 94
    places = f"G{modal.motion} G{54 + modal.system} G{modal.plane} G{units} G{distance} G{mode}"
    outputs = f"M{modal.spindle} M{modal.coolant}"
    return f"[GC:{places} {outputs} T0 F{rate(modal.feed, inches)} S{modal.speed:.0f}]"


def parameters(offsets: Offsets, inches: bool) -> list[str]:
    """The answer to `$#`; nothing was ever probed."""
    stored = [*offsets.systems, offsets.g28, offsets.g30, offsets.g92]
    names = ("G54", "G55", "G56", "G57", "G58", "G59", "G28", "G30", "G92")
    places = [f"[{name}:{coordinates(mm, inches)}]" for name, mm in zip(names, stored, strict=True)]
    length = coordinates((offsets.length_mm, 0.0, 0.0), inches).split(",")[0]
    return [*places, f"[TLO:{length}]", f"[PRB:{coordinates((0.0, 0.0, 0.0), inches)}:0]"]
