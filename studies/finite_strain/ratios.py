"""Linear over finite strain, press by press, from the states that were written."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.measures.measures import MEASURES

Array = NDArray[np.float64]

LINEAR, FINITE = "linear", "neo-Hookean"
COLUMNS = (
    *("mesh", "shape", "poisson", "doi_mm", "force", "width", "peak", "sed", "ep1_linear", "ep1_finite"),
    *(f"r_{name}" for name in MEASURES),
)


class Ratio(NamedTuple):
    """Linear over finite strain; `r` is each measure's correlation over the ten receptors."""

    mesh: str
    shape: str
    poisson: float
    doi_mm: float
    force: float
    width: float
    peak: float
    sed: float  # the highest of the ten receptors
    ep1_linear: float  # the most compressive
    ep1_finite: float
    r: Mapping[str, float]

    @property
    def row(self) -> tuple[str, ...]:
        """As kept, in the order of `COLUMNS`."""
        numbers = (f"{v:.4f}" for v in (*self[4:10], *self.r.values()))
        return self.mesh, self.shape, f"{self.poisson:g}", f"{self.doi_mm:g}", *numbers

    @classmethod
    def of(cls, row: Mapping[str, str]) -> "Ratio":
        """From a kept row."""
        numbers = {name: float(row[name]) for name in COLUMNS[2:10]}
        r = {name: float(row[f"r_{name}"]) for name in MEASURES}
        return cls(mesh=row["mesh"], shape=row["shape"], r=r, **numbers)


def ratios(states: Sequence[Mapping[str, Any]]) -> Iterator[Ratio]:
    """One for each press that converged in both, in the order of the finite ones."""
    linear = {_where(row): row for row in states if row["law"] == LINEAR}
    for row in states:
        if row["law"] == FINITE and _where(row) in linear:
            yield _ratio(linear[_where(row)], row)


def _ratio(linear: Mapping[str, Any], finite: Mapping[str, Any]) -> Ratio:
    def over(name: str) -> float:
        return float(linear[name] / finite[name]) if finite[name] else np.nan

    ours, theirs = ({k: np.array(v) for k, v in row["measures"].items()} for row in (linear, finite))
    return Ratio(
        finite["mesh"], finite["shape"], finite["poisson"], finite["doi_mm"],
        over("force"), over("width_mm"), over("peak"), float(ours["sed"].max() / theirs["sed"].max()),
        float(ours["ep1"].min()), float(theirs["ep1"].min()),
        {name: correlation(ours[name], theirs[name]) for name in MEASURES},
    )  # fmt: skip


def correlation(a: Array, b: Array) -> float:
    """Pearson's; nan where one of them is constant, as e33 in plane strain."""
    a, b = a - a.mean(), b - b.mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 1e-12 * (1 + np.abs(a).max() + np.abs(b).max()) else np.nan


def _where(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return row["mesh"], row["shape"], row["x_mm"], row["poisson"], row["doi_mm"]


def envelope(found: Sequence[Ratio], mesh: str, fewest: int) -> list[dict[str, Any]]:
    """At each depth that so many shapes reached, the least and the most of force and SED, less one."""
    mine = [one for one in found if one.mesh == mesh and one.poisson == 0.48]
    rows = []
    for depth in sorted({one.doi_mm for one in mine}):
        there = [one for one in mine if one.doi_mm == depth]
        if len(there) >= fewest:
            spread = {name: [getattr(one, name) - 1 for one in there] for name in ("force", "sed")}
            ends = {name: [round(min(values), 3), round(max(values), 3)] for name, values in spread.items()}
            rows.append({"doi_mm": depth, **ends})
    return rows
