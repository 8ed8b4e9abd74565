"""`rig config --devices`: every kind of device, the evidence of its tests, and the speed of its virtual twin."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from typing import Literal

from rig.devices import registry
from rig.devices.measured import DeviceTimes, Spread, measured
from rig.devices.registry import Evidence, KindError, find
from rig_shared.outputs import Name, Output

TESTED = {
    "manual": "bytes from the manual",
    "client": "other programs",
    "firmware": "firmware of the maker",
    "hardware": "real hardware",
}
"""What a kind can be tested with, by the field of its evidence."""
NOT_MEASURED = "not measured"
_HEAD = ("kind", *TESTED, "1/s", "age, ms", "stop, ms")
_NOTES = """
manual, client, firmware, hardware: what driver and virtual twin were tested with
1/s: readings or positions a second
age: of a reading at a trip decision, or of a position (median / p99 / worst)
stop: worst time from its call to its bytes, and to rest from 5 mm/s
Times are those of the virtual device. Details: --markdown, --json.
"""


class DeviceKindJson(Output):
    """A kind of device. package: where it comes from; null if built in."""

    kind: Name
    role: Literal["stage", "force"]
    package: Name | None


class SpreadJson(Output):
    """Median, 99th percentile and worst of several times."""

    median_s: float
    p99_s: float
    worst_s: float


class MeasuredJson(Output):
    """Measurements of one kind of device on one wire of its virtual twin."""

    wire: Name
    samples: int
    rate_hz: float
    age: SpreadJson
    """Age of a reading when the program decides about a trip, or largest age of a position."""
    stops: int
    to_bytes: SpreadJson | None
    """Time from the call of a stop to its bytes; null for a force sensor."""
    to_rest: SpreadJson | None


class CataloguedDeviceJson(DeviceKindJson):
    """Kind of device and the evidence of its tests; a text without evidence is null."""

    device_text: str
    manual_text: str | None
    client_text: str | None
    firmware_text: str | None
    hardware_text: str | None
    measured: list[MeasuredJson]


class DeviceCatalogueJson(Output):
    """Every kind of device, with --devices."""

    devices: list[CataloguedDeviceJson]


def kinds() -> list[DeviceKindJson]:
    """Return the kinds of devices, with the packages that add them."""
    added = registry.third_party()
    return [
        {
            "kind": name,
            "role": kind.room,
            "package": None if name in registry.BUILT_IN[kind.room] else added[f"{kind.room}.{name}"],
        }
        for kind in registry.KINDS
        for name in registry.names(kind.room)
    ]


def as_json() -> list[CataloguedDeviceJson]:
    """Return the catalogue with its numbers."""
    return [
        {
            **one,
            "device_text": device,
            "manual_text": evidence.manual or None,
            "client_text": evidence.client or None,
            "firmware_text": evidence.firmware or None,
            "hardware_text": evidence.hardware or None,
            "measured": [_measured(row) for row in rows],
        }
        for one, device, evidence, rows in _entries()
    ]


def _measured(row: DeviceTimes) -> MeasuredJson:
    return {
        "wire": row.wire,
        "samples": row.samples,
        "rate_hz": row.rate_hz,
        "age": _spread(row.age),
        "stops": row.stops,
        "to_bytes": None if row.to_bytes is None else _spread(row.to_bytes),
        "to_rest": None if row.to_rest is None else _spread(row.to_rest),
    }


def _spread(of: Spread) -> SpreadJson:
    return {"median_s": of.median_s, "p99_s": of.p99_s, "worst_s": of.worst_s}


def as_markdown() -> str:
    """Return the catalogue as a Markdown table."""
    head = [
        "kind", "device", *TESTED.values(), "rate, 1/s", "age, ms: median / p99 / worst",
        "stop, ms: to bytes, to rest (worst)",
    ]  # fmt: skip
    rows = [
        [
            f"`{one['role']}.{one['kind']}`",
            device,
            *(text or "–" for text in asdict(evidence).values()),
            *_numbers(rows),
        ]
        for one, device, evidence, rows in _entries()
    ]
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, ["---"] * len(head), *rows))


def as_text() -> str:
    """Return the catalogue for a terminal."""
    rows = [
        [
            f"{one['role']}.{one['kind']}",
            *("yes" if text else "–" for text in asdict(evidence).values()),
            *_numbers(rows),
        ]
        for one, _, evidence, rows in _entries()
    ]
    widths = [max(map(len, column)) for column in zip(_HEAD, *rows, strict=True)]
    lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in (_HEAD, *rows))
    return "".join(f"{line}\n" for line in lines) + _NOTES


Entry = tuple[DeviceKindJson, str, Evidence, Sequence[DeviceTimes]]


def _entries() -> Iterator[Entry]:
    """Yield each kind of device with its entry; for a package that cannot be used, with the problem instead."""
    by_room = {of.room: of for of in registry.KINDS}
    for one in kinds():
        try:
            entry = find(by_room[one["role"]], one["kind"])
        except KindError as problem:
            yield one, str(problem), Evidence(), ()
        else:
            yield one, entry.device, entry.evidence, measured(one["role"], one["kind"])


def _numbers(rows: Sequence[DeviceTimes]) -> list[str]:
    """Return rate, age and stop of the slower wire."""
    if not rows:
        return [NOT_MEASURED, "", ""]
    ages = [row.age for row in rows]
    to_bytes = [row.to_bytes for row in rows if row.to_bytes is not None]
    to_rest = [row.to_rest for row in rows if row.to_rest is not None]
    age = " / ".join(_ms(ages, pick) for pick in (lambda s: s.median_s, lambda s: s.p99_s, lambda s: s.worst_s))
    stop = ", ".join(_ms(them, lambda s: s.worst_s) for them in (to_bytes, to_rest) if them)
    return [f"{min(row.rate_hz for row in rows):.0f}", age, stop or "–"]


def _ms(spreads: Sequence[Spread], pick: Callable[[Spread], float]) -> str:
    """Return the longest of some times in ms, with two significant digits."""
    found_ms = 1e3 * max(map(pick, spreads))
    return f"{found_ms:.0f}" if found_ms >= 10 else f"{found_ms:.1f}"
