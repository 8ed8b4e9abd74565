"""Indentations that are repeats of one another: one indentor, one place, one target."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.data import Run
from rig.report.style import signed

Array = NDArray[np.float64]
Samples = dict[int, list[dict[str, Any]]]

_UNITS = {"doi_mm": "mm", "force_gwt": "gwt"}
_LOADING = ("press", "hold")
_DEPTHS = 60


@dataclass(frozen=True)
class Condition:
    """What was pressed alike: the indentor, its x, the target of the last hold, and the indices of the repeats."""

    indentor: str
    x_mm: float
    target: str  # doi_mm or force_gwt
    value: float
    indices: tuple[int, ...]

    @property
    def group(self) -> str:
        """What it shares with other places, e.g. "step:1 to 2.33 gwt"."""
        return f"{self.indentor} to {self.value:g} {_UNITS[self.target]}"

    @property
    def place(self) -> str:
        """For example "x = −1.63"."""
        return f"x = {signed(self.x_mm)}"


@dataclass(frozen=True)
class Loading:
    """Force against depth of a condition's repeats: (n,) mm, the mean and its sd in gwt (NaN of one repeat)."""

    doi_mm: Array
    mean_gwt: Array
    sd_gwt: Array


def conditions(run: Run) -> list[Condition]:
    """Those of the finished indentations, by indentor, target and place."""
    begun = [event for event in run.stream("indentation_start") if event["index"] in run.done]
    ordered = sorted(begun, key=_alike)
    return [Condition(*alike, tuple(e["index"] for e in same)) for alike, same in _runs_of(ordered)]


def by_target(found: Sequence[Condition]) -> dict[str, list[Condition]]:
    """The conditions that differ in place alone, under what they share."""
    return {name: list(members) for name, members in groupby(found, key=lambda condition: condition.group)}


def loading(condition: Condition, samples: Samples) -> Loading | None:
    """Its repeats on the depths that all of them reached; None where there is no such depth."""
    curves = [_curve(samples[index]) for index in condition.indices]
    low, high = max(doi[0] for doi, _ in curves), min(doi[-1] for doi, _ in curves)
    if not low < high:
        return None
    at = np.linspace(low, high, _DEPTHS)
    force = np.stack([np.interp(at, *curve) for curve in curves])
    sd = force.std(axis=0, ddof=1) if len(curves) > 1 else np.full(_DEPTHS, np.nan)
    return Loading(at, force.mean(axis=0), sd)


def _curve(samples: Sequence[Mapping[str, Any]]) -> tuple[Array, Array]:
    """(n,) depths ascending and forces; readings at one depth, as in a hold, are one."""
    mine = [s for s in samples if s["doi_mm"] is not None and s["phase"] in _LOADING]
    doi, back = np.unique([s["doi_mm"] for s in mine], return_inverse=True)
    return doi, np.bincount(back, [s["force_gwt"] for s in mine]) / np.bincount(back)


def samples_of(run: Run) -> Samples:
    """The readings of each indentation by its index, in order of time."""
    found: Samples = {}
    for sample in run.stream("sample"):
        found.setdefault(sample["index"], []).append(sample)
    return found


def _alike(start: dict[str, Any]) -> tuple[str, float, str, float]:
    return start["indentor"], start["x_mm"], start["target"], start["value"]


def _runs_of(ordered: list[dict[str, Any]]) -> "groupby[tuple[str, float, str, float], dict[str, Any]]":
    return groupby(ordered, key=_alike)
