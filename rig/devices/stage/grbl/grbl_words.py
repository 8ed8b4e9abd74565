"""What GRBL's lines mean. Source: GRBL 1.1 interface wiki; grblHAL differs in a few numbers."""

import math
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass

from rig.devices.bench_settings import SLOWEST_MM_S
from rig.devices.stage.base import MoveError

ALARMS = {
    1: "hard limit",
    2: "soft limit: the target lies outside the travel",
    3: "reset while in motion: steps may be lost",
    4: "probe not in the expected state",
    5: "probe found nothing",
    6: "homing: reset during the cycle",
    7: "homing: door opened during the cycle",
    8: "homing: pull-off did not clear the switch",
    9: "homing: switch not found",
}
ERRORS = {
    1: "a word begins with no letter",
    2: "bad number",
    3: "unknown $ command or setting",
    4: "negative value",
    5: "homing is switched off ($22)",
    8: "not while the stage is busy",
    9: "locked: home or unlock first",
    10: "soft limits need homing ($22)",
    11: "line too long",
    15: "the jog target lies outside the travel",
    16: "not allowed in a jog",
    20: "unsupported command",
    22: "no feed rate",
    53: "unknown setting (grblHAL)",
}
_BANNER = re.compile(r"Grbl(HAL)? \d\S* \[")
Xyz = tuple[float, float, float]
Overrides = tuple[int, int, int]
FULL: Overrides = (100, 100, 100)
HOLD_AND_RESET, JOG_CANCEL = b"!\x18", b"\x85"
OUTPUT_WORDS = {"coolant": ("M9", "M8"), "spindle": ("M5", "M3S1000")}
STOP_PINS = {"D": "door", "H": "hold"}
OVERRIDDEN = ("feed", "rapid", "spindle")


@dataclass(frozen=True, slots=True)
class StatusFields:
    """One `<…>` line, as far as it went: mm; machine or work position, seldom the offset between them.

    Seldom the overrides too, in per cent.
    """

    state: str
    machine: Xyz | None
    work: Xyz | None
    offset: Xyz | None
    overrides: Overrides | None = None
    pins: str = ""  # letters of the inputs that are active


def is_banner(line: str) -> bool:
    """A banner, also with the half of another line before it."""
    return "Grbl" in line and _BANNER.search(line) is not None


def parse_status(line: str) -> StatusFields | None:
    """Read whichever fields come; None if the line is garbled."""
    if line[:1] != "<" or line[-1:] != ">" or "<" in line[1:]:
        return None
    state, *parts = line[1:-1].split("|")
    fields = dict(part.partition(":")[::2] for part in parts)
    try:
        machine, work, offset = (_xyz(fields.get(name)) for name in ("MPos", "WPos", "WCO"))
        return StatusFields(state, machine, work, offset, _overrides(fields.get("Ov")), fields.get("Pn", ""))
    except ValueError:
        return None


def states(printed: Iterable[str]) -> list[str]:
    """The states of the statuses among some lines."""
    return [fields.state for line in printed if (fields := parse_status(line))]


def machine_from(work: Xyz | None, offset: Xyz | None) -> Xyz:
    """A machine position from a work position and what lies between them."""
    assert work is not None
    assert offset is not None
    return (work[0] + offset[0], work[1] + offset[1], work[2] + offset[2])


def parse_setting(line: str) -> tuple[int, float] | None:
    """Read `$n=v`; None for anything else, startup lines, text and garbled numbers included."""
    match = re.match(r"\$(\d+)=(-?\d+(?:\.\d*)?)(?![\d.])", line, re.ASCII)
    return (int(match[1]), float(match[2])) if match else None


def number_after(line: str, prefix: str) -> int | None:
    """The n of `prefix:n`, None if the line is something else; a garbled number counts as 0."""
    if not line.startswith(prefix):
        return None
    digits = line[len(prefix) :].strip()
    return int(digits) if digits.isdigit() else 0


def refuse_move(target: Mapping[str, float], speed_mm_s: float) -> None:
    """Raises MoveError for a move that no line can express."""
    if not target:
        raise MoveError("a move needs at least one of x_mm, y_mm, z_mm", code="no_target")
    for name, value in (*target.items(), ("speed_mm_s", speed_mm_s)):
        if not math.isfinite(value):
            raise MoveError("{name} must be a finite number, got {value}", code="not_finite", name=name, value=value)
    if speed_mm_s < SLOWEST_MM_S:
        raise MoveError(
            "speed_mm_s must be at least {least_mm_s:.4f}, got {speed_mm_s}",
            code="too_slow",
            least_mm_s=SLOWEST_MM_S,
            speed_mm_s=speed_mm_s,
        )


def number(value: float, decimals: int = 4) -> str:
    """Return a number as a line holds it, without needless zeros."""
    text = f"{value:.{decimals}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def feed_word(speed_mm_s: float) -> str:
    """Return the F word, mm/min."""
    return f"F{number(60 * speed_mm_s, 3)}"


def parse_modes(printed: Iterable[str]) -> tuple[frozenset[str], float | None]:
    """Return the modal words of the answer to `$G` and its feed (mm/min); nothing and None where there is none."""
    for line in printed:
        if line.startswith("[GC:") and line.endswith("]"):
            words = line[4:-1].split()
            feeds = [text[1:] for text in words if text.startswith("F")]
            with suppress(ValueError):
                return frozenset(words), float(feeds[0]) if feeds else None
    return frozenset(), None


def travel_s(mm: float, speed: float, accel: float) -> float:
    """From rest to rest over a length in mm, at mm/s and mm/s²."""
    ramp_mm = speed * speed / accel
    if mm <= ramp_mm:
        return 2 * math.sqrt(mm / accel)
    return mm / speed + speed / accel


def _overrides(text: str | None) -> Overrides | None:
    if text is None:
        return None
    feed, rapid, spindle = map(int, text.split(","))
    return (feed, rapid, spindle)


def _xyz(text: str | None) -> Xyz | None:
    if text is None:
        return None
    x, y, z = map(float, text.split(",")[:3])
    if not math.isfinite(x + y + z):
        raise ValueError(text)
    return (x, y, z)
