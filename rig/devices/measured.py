"""Rates, ages and stop latencies of virtual devices, as `python -m studies.devices.latencies` measured them."""

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path

COLUMNS = (
    "kind", "wire", "samples", "rate, 1/s", "age, ms: median", "age: p99", "age: worst",
    "stops", "bytes, ms: median", "bytes: p99", "bytes: worst", "rest, ms: median", "rest: p99", "rest: worst",
)  # fmt: skip
"""Header of the table. The three last groups are in ms; a force sensor has no stops."""


@dataclass(frozen=True)
class Spread:
    """Median, 99th percentile and worst of several times (s)."""

    median_s: float
    p99_s: float
    worst_s: float

    @classmethod
    def read(cls, cells: list[str]) -> "Spread | None":
        """Return the spread in cells in ms; None if they are empty."""
        return cls(*(float(cell) / 1e3 for cell in cells)) if all(cells) else None


@dataclass(frozen=True)
class DeviceTimes:
    """Measurements of one kind of device on one wire of the virtual device.

    `rate_hz` counts readings with a new sample, or positions; `age` is that of a reading when the program decides
    about a trip, or the longest of a position. From the call of a stop, `to_bytes` lasts until its bytes are written,
    and `to_rest` until the virtual stage is at rest, with its braking from 5 mm/s.
    """

    wire: str
    samples: int
    rate_hz: float
    age: Spread
    stops: int = 0
    to_bytes: Spread | None = None
    to_rest: Spread | None = None


def table() -> Path:
    """Return the file of the table: in the package, or among the results of the studies."""
    installed = Path(__file__).with_name("measured.csv")
    return installed if installed.is_file() else Path(__file__).parents[2] / "studies/results/devices/measured.csv"


@cache
def measured(room: str, name: str) -> tuple[DeviceTimes, ...]:
    """Return the measured times of a kind of device, one item per wire; empty if it was not measured."""
    with table().open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.reader(file) if row[0] == f"{room}.{name}"]
    return tuple(
        DeviceTimes(
            wire,
            int(samples),
            float(rate),
            Spread(*(float(cell) / 1e3 for cell in spreads[:3])),
            int(spreads[3] or 0),
            Spread.read(spreads[4:7]),
            Spread.read(spreads[7:10]),
        )
        for _, wire, samples, rate, *spreads in rows
    )
