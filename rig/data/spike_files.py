"""Spikes of simulated afferents beside a run: CSV files that are read back, and NIX (extra `neo`).

They are not data: the names of all files begin with "synthetic". `rig/data/export.py` writes them as NWB.
"""

import csv
import io
import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.data.folder import RunFolder, replace_bytes, replace_table
from rig.data.run import Run, RunError
from rig_shared.user_files import read_bytes, read_text

Array = NDArray[np.float64]

SPIKES, AFFERENTS = "synthetic_spikes", "synthetic_afferents"
"""Names of the files without their endings."""
SYNTHETIC = "Synthetic spikes of simulated afferents, not recorded"
"""Title of every file that has room for one."""

_ABOUT = {
    "afferent": "class and number of the afferent",
    "class": "class: SA1, RA, PC, or the name of one's own",
    "x_mm": "place of the receptor across the finger, mm",
    "along_mm": "place of the receptor along the finger from the receptor plane, mm",
    "depth_mm": "depth of the receptor below the skin, mm",
    "sensitivity": "factor of the receptor's signal",
    "delay_s": "time between a spike at the receptor and the same spike at the electrode, s",
}
"""Columns of the table of afferents."""


@dataclass(frozen=True)
class SpikeTrain:
    """Spikes of one afferent at the electrode, in s since the start of the run, with the columns of `_ABOUT`."""

    afferent: str
    model: str
    x_mm: float
    along_mm: float
    depth_mm: float
    sensitivity: float
    delay_s: float
    spike_s: Array


@dataclass(frozen=True)
class SpikeRecord:
    """Spikes of a run up to `until_s` on its clock. Electrode: on the nerve, at a distance from the fingertip."""

    trains: tuple[SpikeTrain, ...]
    seed: int
    path_m: float
    until_s: float = math.inf

    resolution_s: float = 1e-4
    """Step of the simulation; times lie between its steps."""

    @property
    def electrode(self) -> str:
        """Position of the electrode, in words."""
        return f"on the nerve, {self.path_m:g} m from the fingertip"


def values_of(train: SpikeTrain) -> dict[str, Any]:
    """Return the values of a row of the table of afferents."""
    return {name: getattr(train, "model" if name == "class" else name) for name in _ABOUT}


def about_columns() -> Mapping[str, str]:
    """Return the meaning of each column of the table of afferents."""
    return _ABOUT


def write_csv(folder: RunFolder, record: SpikeRecord) -> list[Path]:
    """Write both tables. Times have all of their digits."""
    spikes = [(one.afferent, repr(float(t))) for one in record.trains for t in one.spike_s]
    rows = [
        [*values_of(one).values(), len(one.spike_s), record.seed, record.path_m, record.until_s]
        for one in record.trains
    ]
    written = [folder.path / f"{name}.csv" for name in (SPIKES, AFFERENTS)]
    replace_table(written[0], ("afferent", "time_s"), spikes)
    replace_table(written[1], (*_ABOUT, "spikes", "seed", "path_m", "until_s"), rows)
    return written


def read_spikes(folder: RunFolder) -> SpikeRecord | None:
    """Return the spikes beside a run, or None if there are none. Raises RunError."""
    paths = [folder.path / f"{name}.csv" for name in (AFFERENTS, SPIKES)]
    if not all(path.is_file() for path in paths):
        return None
    try:
        afferents, spikes = (list(csv.DictReader(io.StringIO(read_text(path)))) for path in paths)
        times: dict[str, list[float]] = {row["afferent"]: [] for row in afferents}
        for row in spikes:
            times[row["afferent"]].append(float(row["time_s"]))
        trains = tuple(
            SpikeTrain(
                row["afferent"],
                row["class"],
                float(row["x_mm"]),
                float(row["along_mm"]),
                float(row["depth_mm"]),
                float(row["sensitivity"]),
                float(row["delay_s"]),
                _finite(times[row["afferent"]]),
            )
            for row in afferents
        )
        first = afferents[0]
        return SpikeRecord(
            trains, int(first["seed"]), float(first["path_m"]), float(first.get("until_s") or math.inf)
        )
    except (OSError, ValueError, KeyError, TypeError, IndexError, csv.Error) as error:
        reason = str(error) or type(error).__name__
        file = f"{SPIKES}.csv"
        raise RunError(
            f"run folder {folder.path}: {file} cannot be read: {reason}; repeat rig nerve", "bad_spikes"
        ) from None


def _finite(times: list[float]) -> Array:
    if not all(map(math.isfinite, times)):
        raise ValueError("a time is not a number")
    return np.array(times, dtype=float)


def write_nix(run: Run, record: SpikeRecord) -> Path | None:
    """Write a block with spike trains and sync pulses as NIX, or return None without neo and nixio."""
    try:
        import neo
        from neo.io import NixIO
    except ImportError:
        return None
    segment = neo.Segment(name=SYNTHETIC)
    stop_s = max([run.end_s, *(float(one.spike_s[-1]) for one in record.trains if len(one.spike_s))])
    for one in record.trains:
        train = neo.SpikeTrain(one.spike_s, units="s", t_start=0.0, t_stop=stop_s, name=one.afferent)
        train.annotate(**values_of(one), electrode=record.electrode)
        segment.spiketrains.append(train)
    pulses = [float(event["rise_s"]) for event in run.stream("sync")]
    segment.events.append(neo.Event(np.array(pulses), labels=["sync"] * len(pulses), units="s", name="sync_pulses"))
    block = neo.Block(name=SYNTHETIC)
    block.segments.append(segment)
    path = run.folder.path / f"{SPIKES}.nix"
    with tempfile.TemporaryDirectory() as place:  # on a full disk HDF5 itself ends the program
        made = Path(place) / path.name
        with NixIO(str(made), mode="ow") as file:
            file.write_block(block)
        replace_bytes(path, read_bytes(made))
    return path
