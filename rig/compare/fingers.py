"""Plausible fingers: how well the finger under the rig is known, as ranges of its parameters.

The file is TOML; each key is given the lowest and the highest value that is plausible:

    receptor_depth_mm = [0.70, 0.82]
    [finger.tissue]                     # or finger.geometry, keys as in a configuration
    epidermis_mm = [0.3, 0.5]

The file of a finger that `rig meet` met is one, too (`docs/meet.md`). SSRPs are computed on a design, every
combination of the lowest, middle and highest value of each parameter, and are interpolated between its fingers
(`rig/compare/fingers/finger_fit.py`).
"""

import hashlib
import itertools
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from rig.compare.errors import FingersError
from rig.plan.met.finger_file import TISSUE, FingerFile, finger_file_of
from rig.plan.toml_file import told_of
from rig.transport.port_settings import Settings
from sim.config import FingertipConfig

Array = NDArray[np.float64]

MOST_FREE = 3
"""Parameters that may have a range: each triples the number of fingers that are built."""

_DEPTH = "receptor_depth_mm"


def _ascending(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[0] > limits[1]:
        raise ValueError(f"{list(limits)}, expected the lowest value first")
    return limits


Range = Annotated[tuple[float, float], AfterValidator(_ascending)]


class _Parts(Settings):
    geometry: dict[str, Range] = Field(default_factory=dict)
    tissue: dict[str, Range] = Field(default_factory=dict)


class _File(Settings):
    receptor_depth_mm: Range | None = None
    finger: _Parts = _Parts()

    @property
    def ranges(self) -> dict[str, Range]:
        """By dotted name, in one order whatever the file's."""
        found = {f"geometry.{key}": limits for key, limits in sorted(self.finger.geometry.items())}
        found |= {f"tissue.{key}": limits for key, limits in sorted(self.finger.tissue.items())}
        return found | ({} if self.receptor_depth_mm is None else {_DEPTH: self.receptor_depth_mm})


@dataclass(frozen=True)
class DesignFinger:
    """A finger with the depth of its receptors, and the parameters that set it apart."""

    config: FingertipConfig
    receptor_depth_mm: float
    name: str


@dataclass(frozen=True)
class PlausibleFingers:
    """Ranges (lowest, highest) of parameters by dotted name, e.g. "tissue.epidermis_mm"."""

    source: str
    ranges: dict[str, Range]
    sha256: str = ""  # of the file

    @property
    def free(self) -> list[str]:
        """The parameters that are not known exactly."""
        return [name for name, (low, high) in self.ranges.items() if low < high]

    def values(self, place: Array) -> dict[str, float]:
        """Of every parameter at a place (free,) in units of the ranges, −1 the lowest and 1 the highest."""
        middle = {name: (low + high) / 2 for name, (low, high) in self.ranges.items()}
        half = {name: (self.ranges[name][1] - self.ranges[name][0]) / 2 for name in self.free}
        return middle | {name: middle[name] + half[name] * float(u) for name, u in zip(half, place, strict=True)}

    def design(self, config: FingertipConfig, receptor_depth_mm: float) -> list[DesignFinger]:
        """The fingers of `design_places`, alike in all but the ranges. Raises FingersError.

        The ranges must hold the finger itself: what is said of it is compared with what is said of all of them.
        """
        self._refuse_others_only(config, receptor_depth_mm)
        places = design_places(len(self.free))
        return [self._finger(self.values(place), config, receptor_depth_mm) for place in places]

    def _finger(self, values: dict[str, float], config: FingertipConfig, depth_mm: float) -> DesignFinger:
        tree = config.model_dump(exclude_defaults=True)
        for name, value in values.items():
            table, _, key = name.rpartition(".")
            if table:
                tree[table] = {**tree.get(table, {}), key: value}
        with told_of(self.source, FingersError):
            changed = FingertipConfig.model_validate(tree)
        named = ", ".join(f"{name} = {value:g}" for name, value in values.items())
        return DesignFinger(changed, values.get(_DEPTH, depth_mm), named)

    def _refuse_others_only(self, config: FingertipConfig, depth_mm: float) -> None:
        for name, (low, high) in self.ranges.items():
            own = depth_mm if name == _DEPTH else _number(config, name, self.source)
            if not low <= own <= high:
                raise FingersError(
                    "{where}: {key}: [{low:g}, {high:g}], expected a range that holds the run's own {own:g}",
                    code="without_the_own",
                    where=self.source,
                    key=name,
                    low=low,
                    high=high,
                    own=own,
                )


def design_places(free: int) -> Array:
    """(3^free, free) places of the design's fingers, in units of the ranges; the last parameter varies fastest."""
    return places((-1.0, 0.0, 1.0), free)


def places(along: Sequence[float], free: int) -> Array:
    """(len(along)^free, free) every combination, the last parameter fastest; one place of no coordinates for none."""
    return np.array(list(itertools.product(along, repeat=free)))


def read_plausible(path: Path) -> PlausibleFingers:
    """Read a file of ranges. Raises FingersError."""
    source = f"--fingers {path}"
    with told_of(source, FingersError):
        content = path.read_bytes()
        tables = tomllib.loads(content.decode("utf-8-sig"))
        met = "met" in tables
        ranges = {} if met else _File.model_validate(tables).ranges
    if met:
        ranges = _ranges_of(finger_file_of(source, tables, path.parent))
    found = PlausibleFingers(source, ranges, hashlib.sha256(content).hexdigest())
    if not ranges:
        raise FingersError(
            "{where}: expected a range in finger.tissue, finger.geometry or {depth}",
            code="no_range",
            where=source,
            depth=_DEPTH,
        )
    if len(found.free) > MOST_FREE:
        raise FingersError(
            "{where}: {ranges} ranges, expected {most} or fewer",
            code="many_ranges",
            where=source,
            ranges=len(found.free),
            most=MOST_FREE,
        )
    return found


def _ranges_of(file: FingerFile) -> dict[str, Range]:
    """Of a finger that was met: nine tenths of its likely fingers and the likeliest, in what they differ in most."""
    own = file.finger.tissue
    values = {name: np.array([getattr(draw, name) for draw in file.met.draw]) for name in TISSUE}
    spread = {
        name: float(np.ptp(found) / np.abs(found).max()) if found.any() else 0.0 for name, found in values.items()
    }
    widest = sorted((name for name in TISSUE if spread[name]), key=spread.__getitem__, reverse=True)[:MOST_FREE]
    ends = {name: (*np.quantile(values[name], [0.05, 0.95]), getattr(own, name)) for name in sorted(widest)}
    return {f"tissue.{name}": (float(min(each)), float(max(each))) for name, each in ends.items()}


def _number(config: FingertipConfig, name: str, source: str) -> float:
    table, _, key = name.partition(".")
    value = getattr(getattr(config, table), key, None)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise FingersError(
            "{where}: finger.{key}: expected a number of a configuration's finger.{table}",
            code="no_number",
            where=source,
            key=name,
            table=table,
        )
    return float(value)
