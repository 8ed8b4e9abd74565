"""Recordings named on the command line."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rig.compare.errors import RecordingError
from rig.compare.recordings.recorded import Recording, csv_header, read_srp
from rig.compare.recordings.spikes import NWB, rates_in_run, read_spike_times
from rig.data import Run
from sim.contact.shapes import shape_name


@dataclass(frozen=True)
class SpikeReading:
    """How spike times become rates: the window from the start of a hold, and where the receptive field lies."""

    window_s: tuple[float, float] = (0.0, 1.0)
    field_centre_mm: float = 0.0


def read_recordings(
    recorded: Sequence[str], mirror: Sequence[str], runs: Sequence[Run], spikes: SpikeReading
) -> dict[str, Recording]:
    """Recordings by canonical shape from "SHAPE=CSV" and the shapes to be mirrored.

    A CSV with a column `time_s`, or an NWB file, holds spike times of the one run with that shape. Raises
    RecordingError, ShapeError.
    """
    found: dict[str, Recording] = {}
    for text in recorded:
        shape, equals, file = text.partition("=")
        if not (equals and file):
            raise RecordingError(f"--recorded {text!r}: expected SHAPE=CSV")
        name = shape_name(shape)
        if name in found:
            raise RecordingError(f"--recorded {text!r}: {shape} is given twice")
        path, unit = _file_and_unit(file)
        found[name] = replace(_read(path, unit, shape, runs, spikes), sha256=sha256(path))
    for shape in mirror:
        name = shape_name(shape)
        if name not in found:
            raise RecordingError(f"--mirror {shape}: nothing recorded for it, expected --recorded {shape}=CSV")
        found[name] = found[name].mirrored()
    return found


def _file_and_unit(text: str) -> tuple[Path, str]:
    """A file, and of an NWB file the unit that is named after it: "afferent.nwb#3"."""
    file, mark, unit = text.rpartition(f"{NWB}#")
    return (Path(file + NWB), unit) if mark else (Path(text), "")


def _read(path: Path, unit: str, shape: str, runs: Sequence[Run], spikes: SpikeReading) -> Recording:
    if path.suffix != NWB and "time_s" not in csv_header(path):
        return read_srp(path)
    name = shape_name(shape)
    holding = [run for run in runs if any(shape_name(e["indentor"]) == name for e in run.stream("mount"))]
    if len(holding) != 1:
        raise RecordingError(f"{path}: spike times belong to one run with {shape}, {len(holding)} are given")
    (run,) = holding
    times = read_spike_times(path, run, unit)
    return rates_in_run(run, shape, times, path.name, spikes.window_s, spikes.field_centre_mm)


def sha256(path: Path) -> str:
    """Of a file, for provenance."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
