"""The 24 places at which the source loads its finger, and what it fitted there (Raju 1998, Fig. 6-3, Table 6.1)."""

from importlib.resources import as_file, files
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.config.csv_table import read_columns
from sim.finger.surface import published_points

Array = NDArray[np.float64]


class Site(NamedTuple):
    """A place on the pulp's skin."""

    number: int
    x_mm: float
    z_mm: float
    on_pulp: bool  # and not on the distal tip


class Published(NamedTuple):
    """Table 6.1: SED = A / r^m; the load's size is not printed."""

    number: int
    a: float
    m: float
    r2: float


def published_sites() -> tuple[Site, ...]:
    """Figure 6-3's, in its order."""
    numbers, xyz, regions = published_points()
    rows = zip(numbers.tolist(), xyz.tolist(), regions, strict=True)
    return tuple(Site(number, x, z, region == "top") for number, (x, _, z), region in rows)


def published_table() -> tuple[Published, ...]:
    """Table 6.1, in its order."""
    with as_file(files("sim") / "data" / "table_6_1.csv") as path:
        rows = read_columns(path, ("site", "a", "m", "r2"))
    return tuple(Published(int(number), a, m, r2) for number, a, m, r2 in rows)


def spread_over_mean(values: Array) -> float:
    """Standard deviation (n − 1, as the source's) over the mean."""
    return float(values.std(ddof=1) / values.mean())
