"""Names and units of columns: what a header such as "Window (msec)" means, and what is beyond a finger.

A unit is a word in brackets at the end of a name, or a known word after an underscore, a space or "per". An unknown
word in brackets is refused, since its numbers would be taken for others.
"""

import math
import re
import unicodedata
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from rig.units import GWT_N

Factors = Mapping[str, float]


def same_name(text: str) -> str:
    """Return a name in the form in which it is compared: é is one letter, also where a file has e and an accent."""
    return unicodedata.normalize("NFC", text)


def _words(**units: tuple[float, str]) -> dict[str, float]:
    return {word: factor for name, (factor, more) in units.items() for word in (name, *more.split())}


_LENGTHS = _words(
    nm=(1e-6, "nanometer nanometers nanometre nanometres"),
    um=(1e-3, "µm μm micron microns micrometer micrometers micrometre micrometres"),
    mm=(1.0, "millimeter millimeters millimetre millimetres"),
    cm=(10.0, "centimeter centimeters centimetre centimetres"),
    m=(1000.0, "meter meters metre metres"),
    **{"in": (25.4, "inch inches")},
)
_TIMES = _words(
    us=(1e-6, "µs μs usec µsec μsec microsec microsecond microseconds"),
    ms=(1e-3, "msec msecs millisec millisecs millisecond milliseconds"),
    s=(1.0, "sec secs second seconds"),
    min=(60.0, "mins minute minutes"),
    h=(3600.0, "hr hrs hour hours"),
)
_FORCES = _words(
    gwt=(1.0, "gf gram-force grams-force g gram grams"),
    mN=(1e-3 / GWT_N, "mn millinewton millinewtons"),
    N=(1 / GWT_N, "n newton newtons"),
)
_OWN = ("a.u.", "au", "arb", "norm", "normalized", "normalised", "%")
"""Units of rates that are not rates in time: nothing is converted, and nothing is too large."""


def is_own_unit(unit: str) -> bool:
    """Return whether a unit of rates does not count in time, such as "a.u."."""
    return unit.casefold() in _OWN


_EVENT = r"(?:spikes?|spks?|sp|imp|imps|impulses?|aps?|events?|pulses?|counts?|n)"
_RATE = re.compile(
    rf"(?:(?:{_EVENT}|1)?\s*(?:/|\bper\b|\bp\b)\s*(?P<per>[\wµμ]+)|(?:{_EVENT}[\s·.*]*)?(?P<power>[\wµμ]+?)\s*(?:\^?-1|⁻¹))",
    re.IGNORECASE,
)
_COUNTED = re.compile(rf"|#|{_EVENT}", re.IGNORECASE)


def _of(words: Factors) -> Callable[[str], float | None]:
    folded = {word.casefold(): factor for word, factor in words.items()}
    return lambda unit: folded.get(unit.casefold())


def _rate(unit: str) -> float | None:
    folded = unit.casefold()
    if folded in _OWN:
        return 1.0
    if folded in ("hz", "khz", "pps", "ips"):
        return 1000.0 if folded == "khz" else 1.0
    found = _RATE.fullmatch(unit)
    time = None if found is None else _of(_TIMES)(found["per"] or found["power"])
    return None if time is None else 1 / time


class Dimension(NamedTuple):
    """Units of a column: their names for messages, the factor of each, and the program's own unit."""

    listed: tuple[str, ...]
    factor: Callable[[str], float | None]
    usual: str = ""
    most: float = math.inf
    """Largest sensible number, in the program's unit."""
    likely: str = ""
    """Unit of numbers that are too large, most likely."""
    needed: bool = False
    """Whether the unit must be stated, because several are common."""

    def known(self, unit: str) -> float | None:
        """Return the factor of a unit, None if it is unknown."""
        return self.factor(unit.strip())


MOST_MM, MOST_HOLD_S, MOST_RATE, MOST_GWT = 100.0, 100.0, 2000.0, 10_000.0
LEAST_PROFILE_MM = 0.01
"""Limits of what a finger, a press and an afferent can be; a wrong unit is a thousand times beyond."""

LENGTH = Dimension(("nm", "um", "mm", "cm", "m", "in"), _of(_LENGTHS), "mm", MOST_MM, "um", True)
TIME = Dimension(("us", "ms", "s", "min", "h"), _of(_TIMES), "s", needed=True)
WINDOW = TIME._replace(most=MOST_HOLD_S, likely="ms")
RATE = Dimension(("1/s", "Hz", "spikes/s", "imp/s", "1/ms", "1/min", "a.u."), _rate, "1/s", MOST_RATE, "1/min")
FORCE = Dimension(("gwt", "mN", "N"), _of(_FORCES), "gwt", MOST_GWT, "mN", True)
COUNT = Dimension(("spikes", "impulses"), lambda unit: 1.0 if _COUNTED.fullmatch(unit) else None)
NONE = Dimension((), lambda _: None)

_KNOWN_ELSEWHERE = (LENGTH, TIME, FORCE)
_SHORTEST = 2  # letters of a word that is taken for a unit of something else


class ColumnKind(NamedTuple):
    """A column that the program reads, or a dataset of an NWB file."""

    name: str
    """The program's own."""
    role: str = ""
    """Name in --columns; "" for a column that --columns cannot name."""
    units: Dimension = NONE
    words: tuple[str, ...] = ()
    """Names in the tables of others, without units."""
    one_for_all: bool = False
    """Whether one value may stand for all rows."""
    is_label: bool = False
    """Whether its cells are labels, such as the repeat of a press."""


COLUMNS = {
    kind.name: kind
    for kind in (
        ColumnKind("position_mm", "position", LENGTH, (
            "position", "pos", "x", "x position", "position x", "indentor position", "probe position",
            "stimulus position")),
        ColumnKind("rate", "rate", RATE, (
            "rate", "firing rate", "discharge rate", "mean rate", "mean firing rate", "spike rate", "impulse rate",
            "fr")),
        ColumnKind("sd", "sd", RATE, ("sd", "std", "stdev", "standard deviation", "rate sd", "sd rate"), True),
        ColumnKind("repeat", "repeat", NONE, (
            "repeat", "rep", "repetition", "trial", "trial number", "trial no", "presentation", "replicate"), True,
            True),
        ColumnKind("count", "count", COUNT, (
            "count", "counts", "spike count", "spike counts", "spikecount", "spikes", "n spikes", "nspikes",
            "num spikes", "number of spikes", "impulses", "impulse count")),
        ColumnKind("window_s", "window", WINDOW, (
            "window", "count window", "counting window", "window length", "duration", "bin", "bin width"), True),
        ColumnKind("time_s", "time", TIME, (
            "time", "times", "t", "spike time", "spike times", "spiketimes", "timestamp", "timestamps")),
        ColumnKind("kind", "kind", NONE, ("kind", "type", "event", "event type", "label"), True),
        ColumnKind("unit", "unit", NONE, (
            "unit", "afferent", "neuron", "cell", "cluster", "cluster id", "unit id", "unit name", "channel"), True,
            True),
        ColumnKind("sync_pulses", "sync", TIME),
        ColumnKind("obs_intervals", "observed", TIME),
        ColumnKind("invalid_times", "invalid", TIME),
        ColumnKind("segment", "segment"),
        ColumnKind("deflection_mm", "", LENGTH, ("deflection", "displacement")),
        ColumnKind("doi_mm", "", LENGTH, ("doi", "depth", "indentation depth")),
        ColumnKind("depth_mm", "", LENGTH, ("depth", "doi", "indentation depth"), True),
        ColumnKind("force_gwt", "", FORCE, ("force",), True),
        ColumnKind("shape", words=("shape",), one_for_all=True),
        ColumnKind("afferent", words=("afferent",), one_for_all=True, is_label=True),
        ColumnKind("columns", words=("columns",), one_for_all=True),
        ColumnKind("x_mm", "", LENGTH, ("x",)),
        ColumnKind("z_mm", "", LENGTH, ("z",)),
    )
}  # fmt: skip
ROLES = {kind.role: kind for kind in COLUMNS.values() if kind.role}


def column_kind(name: str) -> ColumnKind:
    """Return a column by the program's name for it; one that has no entry has no units."""
    return COLUMNS.get(name) or ColumnKind(name, words=(name,))


@dataclass(frozen=True)
class HeaderName:
    """A name in a header: its words, and its unit, "" without.

    `bracketed`: the unit is in brackets, so it is one, known or not. `factor`: None for an unknown unit.
    """

    words: str
    unit: str
    bracketed: bool
    factor: float | None


_BRACKETS = re.compile(r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]")
_SUFFIX = re.compile(r"(.+?)(?:[_\s]+in)?(?:[_\s]+|\s*/\s*|,\s*)((?:per[_\s]+)?[^_\s/,]+)", re.IGNORECASE)


def header_name(text: str, of: Dimension) -> HeaderName:
    """Return the words and the unit of a name in a header; "impulses/sec" and "normalized rate" are rates."""
    first, _, others = _plain(text).partition(" ")
    if of is RATE and first in ("normalized", "normalised") and means(others, "rate"):
        return HeaderName(others, first, False, 1.0)
    if of is RATE and not is_own_unit(text) and (factor := of.known(text)) is not None:
        return HeaderName("rate", text, False, factor)
    if found := _BRACKETS.fullmatch(text):
        return HeaderName(_plain(found[1]), found[2].strip(), True, of.known(found[2]))
    if found := _SUFFIX.fullmatch(text):
        unit = found[2].replace("_", " ").strip()
        factor = of.known(unit) if of.usual else None
        elsewhere = len(unit) >= _SHORTEST and any(one.known(unit) is not None for one in _KNOWN_ELSEWHERE)
        if factor is not None:
            return HeaderName(_plain(found[1]), unit, False, factor)
        if elsewhere and of.usual and unit.casefold() != "in":
            return HeaderName(_plain(found[1]), unit, True, None)
    return HeaderName(_plain(text), "", False, 1.0)


def contradicts(text: str, unit: str, of: Dimension) -> str:
    """Return the unit in a name in a header if it is another one than a stated unit; "" if it is not known as one."""
    named = header_name(text, of)
    if not named.unit:
        return ""
    if named.factor is None:
        elsewhere = len(named.unit) >= _SHORTEST and any(one.known(named.unit) for one in (*_KNOWN_ELSEWHERE, RATE))
        return named.unit if elsewhere else ""
    same = math.isclose(named.factor, of.known(unit) or math.nan) and is_own_unit(named.unit) == is_own_unit(unit)
    return "" if same else named.unit


def renamed(text: str, unit: str, of: Dimension) -> str:
    """Return a name in a header with another unit, such as "x (um)" for x_mm."""
    return f"{header_name(text, of).words} ({unit})"


def names_a_rate(text: str) -> bool:
    """Return whether the name of a column means a rate, such as "FR" or "mean_rate", also without a unit."""
    return means(" ".join(word for word in header_name(text, RATE).words.split() if word not in _AVERAGES), "rate")


_AVERAGES = ("mean", "avg", "average", "median")


def _plain(words: str) -> str:
    return " ".join(re.split(r"[\s_\-]+", words.strip().casefold())).strip()


def means(words: str, name: str) -> bool:
    """Return whether the words of a header mean one of the program's columns."""
    return words in column_kind(name).words
