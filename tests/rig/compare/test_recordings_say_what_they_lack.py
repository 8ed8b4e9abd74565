"""No data is not zero, and what is not understood is not absent: each row is an input, and what is right for it.

All files are synthetic: one afferent under eight presses at four places. A row has the right rates and the number
of presses that were not observed, or the code of the refusal and the words that it must contain.
"""

import shutil
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import neo
import numpy as np
import pytest
import quantities as pq
import scipy.io
import scipy.sparse
from numpy.typing import NDArray

from rig.cli.compare import _without_copies
from rig.compare.exceptions import RecordingError
from rig.compare.recordings.afferents_table import read_afferents
from rig.compare.recordings.columns import column_map
from rig.compare.recordings.deflection import read_skin_deflection
from rig.compare.recordings.reading import Reading, read_recordings, read_srp
from rig.compare.recordings.spikes import read_spike_times
from rig.compare.spike_clock import clock_shift, recording_sentences
from rig.data import Run, read_run
from rig.data.index import listed
from rig.design.presses import PossiblePress
from rig.design.recorded_counts import read_counts
from rig.report.recording_sections import read_deflections
from tests.error_codes import raises
from tests.rig.compare.test_every_kind_of_recording import STARTS, TIMES, WINDOW_S, journal

Array = NDArray[np.float64]

RISES = [start - before for start, before in zip(STARTS, (0.5, 0.7, 0.45, 0.9, 0.6, 0.8, 0.55, 0.75), strict=True)]
"""Of the pulses of the run, at uneven intervals, one before each press."""

ALL = [6.0, 24.0, 12.0, 1.0]
"""Rates (1/s) at −0.5, 0, 0.25 and 1 mm: means of counts (2, 4), (10, 14), (6, 6), (0, 1) in half a second."""

LOST_S, BEGAN_S = 65.0, 15.0
UNTIL_LOST = [t for t in TIMES if t < LOST_S]


def amplifier(run_s: Sequence[float] | Array) -> Array:
    """The clock of the amplifier started 12.5 s earlier and runs 20 ppm fast."""
    return np.asarray(12.5 + np.asarray(run_s) * (1 + 20e-6))


def run_with_pulses(folder: Path, width_s: float = 0.01) -> Run:
    run = journal(folder)
    pulses = [{"t_s": t + width_s, "rise_s": t, "width_s": width_s} for t in RISES]
    return replace(run, events={**run.events, "sync": pulses})


def nwb(**datasets: Any) -> Callable[[Path], str]:
    """A file with one unit, unless `datasets` say otherwise; "__" in a name is a slash."""

    def write(folder: Path) -> str:
        path = folder / "synthetic.nwb"
        with h5py.File(path, "w") as file:
            usual = {"units__id": [0], "units__spike_times": TIMES}
            given = usual | datasets
            if "units__spike_times_index" not in given:
                given["units__spike_times_index"] = [len(given["units__spike_times"])]
            for name, values in given.items():
                if values is None:
                    continue
                place, dot, attribute = name.replace("__", "/").partition(".")
                if dot:
                    file[place].attrs[attribute] = values
                else:
                    file[place] = values
        return str(path)

    return write


def of_amplifier(spikes: Sequence[float] = TIMES, **datasets: Any) -> Callable[[Path], str]:
    return nwb(units__spike_times=amplifier(spikes), **datasets)


def observed(*spans: tuple[float, float]) -> dict[str, Any]:
    return {"units__obs_intervals": amplifier(np.array(spans)), "units__obs_intervals_index": [len(spans)]}


PULSES = {"intervals__sync_pulses__start_time": amplifier(RISES)}
SAMPLES_HZ = 2000.0


def line(edges: Array, volts: float = 5.0, width_s: float = 0.01, *, inverted: bool = False) -> NDArray[np.float32]:
    """A sampled line that is high for 10 ms from each rise, or low if it is inverted."""
    values = np.zeros(int(110 * SAMPLES_HZ), dtype=np.float32)
    for rise in edges:
        values[int(np.ceil(rise * SAMPLES_HZ)) : int((rise + width_s) * SAMPLES_HZ)] = volts
    return volts - values if inverted else values


def sampled(place: str, width_s: float = 0.01, *, inverted: bool = False) -> dict[str, Any]:
    return {
        f"{place}__data": line(amplifier(RISES), width_s=width_s, inverted=inverted),
        f"{place}__starting_time": 0.0,
        f"{place}__starting_time.rate": SAMPLES_HZ,
    }


def both_edges() -> dict[str, Any]:
    rises = amplifier(RISES)
    return {
        "acquisition__sync_pulses__timestamps": np.sort(np.concatenate([rises, rises + 0.0105])),
        "acquisition__sync_pulses__data": np.tile([1, 0], len(rises)),
    }


def pulses_at(times: Array) -> dict[str, Any]:
    return {"intervals__sync_pulses__start_time": times}


def nix(
    start: float = 0.0, stop: float = 200.0, spikes: Sequence[float] = TIMES, line_v: bool = False, name: str = "ttl",
    epoch: tuple[str, ...] = (), rises: Sequence[float] = RISES, **of_line: Any,
) -> Any:  # fmt: skip
    def write(folder: Path) -> str:
        path = folder / "synthetic.nix"
        segment = neo.Segment()
        times = np.array([t for t in spikes if start <= t <= stop])
        segment.spiketrains.append(neo.SpikeTrain(times, units="s", t_start=start, t_stop=stop, name="u"))
        if line_v:
            segment.analogsignals.append(
                neo.AnalogSignal(
                    line(np.array(rises), **of_line), units="V", sampling_rate=SAMPLES_HZ * pq.Hz, name=name
                )
            )
        if epoch:
            times, durations = np.array([45.0]) * pq.s, np.array([20.0]) * pq.s
            segment.epochs.append(neo.Epoch(times, durations, labels=np.array(epoch[1:]), name=epoch[0]))
        block = neo.Block()
        block.segments.append(segment)
        with neo.NixIO(str(path), mode="ow") as file:
            file.write_block(block)
        return str(path)

    return write


def text(content: str, name: str = "synthetic.csv", encoding: str = "utf-8") -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        path = folder / name
        path.write_bytes(content.encode(encoding))
        return str(path)

    return write


def spikes_csv(*more: tuple[float, str], spikes: Sequence[float] = TIMES, header: str = "time_s,kind") -> Any:
    rows = [*((float(t), "spike") for t in spikes), *more]
    return text(f"{header}\n" + "".join(f"{t:.6f},{kind}\n" for t, kind in rows))


def syncs(times: Array) -> list[tuple[float, str]]:
    return [(float(t), "sync") for t in times]


@dataclass(frozen=True)
class Case:
    """An input, and what is right: rates and presses that were not observed, or a refusal and its words; and why."""

    why: str
    write: Callable[[Path], str]
    columns: tuple[str, ...] = ()
    rates: Sequence[float] | None = None
    lost: int = 0
    code: str = ""
    says: tuple[str, ...] = ()
    pulses: bool = True
    window_s: float = WINDOW_S
    width_s: float = 0.01
    read_as: str = ""
    """Words of the sentences on the recording."""
    silent: str | None = None
    """Words that must not be among them."""
    run: Callable[[Run], Run] = lambda run: run
    """What is different in the run."""


def gap(begin: float, end: float) -> dict[str, Any]:
    return {"intervals__invalid_times__start_time": [begin], "intervals__invalid_times__stop_time": [end]}


def units_csv(unit: str, *rows: str) -> Callable[[Path], str]:
    """A table of a unit a, or 1.0, and of a unit b after 25 s, with more rows, of which `unit` is chosen."""
    a = "1.0" if unit == "1" else "a"
    spikes = [f"{t},spike,{a}" for t in TIMES] + [f"{t},spike,b" for t in TIMES if t > 25]
    return lambda folder: (
        text("\n".join(["time_s,kind,unit", *rows, *spikes]) + "\n")(folder) + f"#{unit}" * bool(unit)
    )


def two_units(kind: str) -> Callable[[Path], str]:
    """A file of a unit a, which fires at each press, and of a unit b, which has no spikes after 65 s."""
    each = {"a": TIMES, "b": UNTIL_LOST}

    def in_nix(folder: Path) -> str:
        path, block, segment = folder / "synthetic.nix", neo.Block(), neo.Segment()
        segment.spiketrains += [neo.SpikeTrain(s, units="s", t_stop=max(s), name=name) for name, s in each.items()]
        block.segments.append(segment)
        with neo.NixIO(str(path), mode="ow") as file:
            file.write_block(block)
        return f"{path}#b"

    def in_mat(folder: Path) -> str:
        path = folder / "synthetic.mat"
        units = np.array([[name] for name, spikes in each.items() for _ in spikes], dtype=object)
        scipy.io.savemat(path, {"time_s": np.array([*TIMES, *UNTIL_LOST]), "unit": units})
        return f"{path}#b"

    ends = [len(TIMES), len(TIMES) + len(UNTIL_LOST)]
    in_nwb = nwb(units__spike_times=[*TIMES, *UNTIL_LOST], units__spike_times_index=ends, units__id=[0, 1])
    in_csv = text("time_s,unit\n" + "".join(f"{t},{name}\n" for name, spikes in each.items() for t in spikes))
    return {
        "NWB": lambda folder: in_nwb(folder) + "#1", "CSV": lambda folder: in_csv(folder) + "#b", "NIX": in_nix,
        "MAT": in_mat,
    }[kind]  # fmt: skip


SINCE_15_S = [t for t in TIMES if t > BEGAN_S]

UNOBSERVED = {
    "NIX, t_stop at the last spike": Case(
        "the pulses show that the amplifier was on; the end that is not believed is said",
        nix(stop=max(UNTIL_LOST), line_v=True), ("sync=ttl",), rates=[*ALL[:3], 0],
        read_as="u ends at its last spike (60.1 s)",
    ),
    "NIX, t_stop at the last spike, t_start before the first": Case(
        "the beginning is stated", nix(BEGAN_S, max(UNTIL_LOST), line_v=True), ("sync=ttl",), rates=[8, 24, 12, 0],
        lost=1, read_as="u ends at its last spike (60.1 s)",
    ),
    **{
        f"NIX, t_start at the first spike{what}": Case(
            "the presses before are as it says, and that is said",
            nix(first, stop, line_v=True, spikes=[t for t in UNTIL_LOST if t > BEGAN_S]), ("sync=ttl", *columns),
            rates=rates, lost=lost, read_as=f"u begins at its first spike ({first:.1f} s)",
        )
        for first in [next(t for t in TIMES if t > BEGAN_S)]
        for what, stop, columns, rates, lost in (
            (" and t_stop at the last", max(UNTIL_LOST), (), [24, 12, 0], 2),
            (", t_stop later", 100.0, (), [24, 12, 0], 2),
            (", observed throughout", max(UNTIL_LOST), ("observed=throughout",), [4, 24, 12, 0], 0),
        )
    },
    **{
        f"NWB, a unit with {column} = {values[0]}": Case(
            "it may not count, and that is said", of_amplifier(**PULSES, **{f"units__{column}": values}), rates=ALL,
            read_as=f"Columns of the unit that are not read: {column} = {shown}. If they say that it does not count",
        )
        for column, values, shown in (
            ("quality", ["noise"], "noise"), ("valid", np.array([False]), "False"), ("KSLabel", ["mua"], "mua"),
            ("good", [0], "0"), ("isi_violations", [0.75], "0.75"),
        )
    },
    "NWB, a unit without other columns": Case(
        "nothing is said", of_amplifier(**PULSES, **observed((0, 100))), rates=ALL, silent="Columns of the unit",
    ),
    "NIX, t_stop after the last spike": Case(
        "it is believed", nix(stop=LOST_S, line_v=True), ("sync=ttl",), rates=ALL[:3], lost=2,
        silent="ends at its last spike",
    ),
    "NWB, obs_intervals end": Case(
        "presses at 70 and 80 s are after the unit was lost at 65 s",
        of_amplifier(UNTIL_LOST, **PULSES, **observed((0, LOST_S))), rates=ALL[:3], lost=2,
    ),
    "NWB, obs_intervals with a gap": Case(
        "the press at 30 s is in the gap; that at 40 s has 14 spikes in half a second",
        of_amplifier([t for t in TIMES if not 25 < t < 35], **PULSES, **observed((0, 25), (35, 100))),
        rates=[6, 28, 12, 1], lost=1,
    ),
    "NWB, obs_intervals end within a window": Case(
        "a window that is partly observed has no rate: the press at 80 s was cut at 80.2 s",
        of_amplifier(**PULSES, **observed((0, 80.2))), rates=[6, 24, 12, 0], lost=1,
    ),
    "NWB, obs_intervals in another unit of time": Case(
        "no spike lies in the intervals, so one of the two has another unit",
        nwb(units__spike_times=TIMES, units__obs_intervals=[[0.0, 200_000.0]], units__obs_intervals_index=[1],
            units__id=[0], intervals__trials__start_time=None),
        ("sync=none", "observed=obs_intervals:ms"), rates=ALL,
    ),
    "NWB, obs_intervals without spikes in them": Case(
        "spikes in s, intervals in ms, said nowhere",
        nwb(units__obs_intervals=[[500.0, 2000.0]], units__obs_intervals_index=[1]), ("sync=none",),
        code="spikes_outside_observed", says=("obs_intervals", "observed=obs_intervals:ms"),
    ),
    "NWB, spikes beside obs_intervals": Case(
        "the spike at 80 s has no press that counts, and it is said",
        of_amplifier(**PULSES, **observed((0, LOST_S))), rates=ALL[:3], lost=2,
        read_as="1 of 43 spikes lies outside of the times at which the unit was observed",
    ),
    "NWB, malformed obs_intervals": Case(
        "what is there and not understood is no absence",
        nwb(units__obs_intervals=[[0.0, 50.0]]), ("sync=none",), code="bad_obs_intervals", says=("obs_intervals",),
    ),
    **{
        f"NWB, the index {what}": Case(
            "spikes of no unit are not absent spikes", lambda folder, index=index: of_amplifier(
                [*TIMES, *TIMES], **{"units__id": [0, 1], "units__spike_times_index": index} | PULSES
            )(folder) + "#0", code="wrong_index",
            says=("units/spike_times_index", f"{2 * len(TIMES)}", f"ends at {index[-1]}"),
        )
        for what, index in {
            "ends before the times": [20, 2 * len(TIMES) - 2], "ends after the times": [20, 2 * len(TIMES) + 1],
            "falls": [2 * len(TIMES) + 1, 2 * len(TIMES)],
        }.items()
    },
    "NWB, the index of obs_intervals ends before them": Case(
        "the interval at the press at 80 s is of no unit", of_amplifier(
            **PULSES, units__obs_intervals=amplifier([[0, 65], [75, 100]]), units__obs_intervals_index=[1]),
        code="wrong_index", says=("units/obs_intervals_index", "ends at 1"),
    ),
    **{
        f"NWB, {place} in another file": Case(
            "what is there and not read is no absence", of_amplifier(
                **PULSES, **{f"{place}__{name}": h5py.ExternalLink("other.h5", "/x") for name in names}),
            code="elsewhere", says=("another file",),
        )
        for place, names in {
            "units": ("obs_intervals", "obs_intervals_index"), "intervals": ("invalid_times",),
        }.items()
    },
    "NWB, an index of obs_intervals alone": Case(
        "the intervals are missing", of_amplifier(**PULSES, units__obs_intervals_index=[1]),
        code="bad_obs_intervals", says=("obs_intervals",),
    ),
    "NWB, invalid_times": Case(
        "the press at 60 s is invalid; the other at 0.25 mm has 6 spikes in half a second",
        of_amplifier(**PULSES, intervals__invalid_times__start_time=amplifier([55.0]),
                     intervals__invalid_times__stop_time=amplifier([65.0])), rates=ALL, lost=1,
    ),
    **{
        f"NWB, invalid_times in {unit}": Case(
            "intervals that end a hundred times later than all spikes are in another unit",
            of_amplifier(**PULSES, intervals__invalid_times__start_time=[factor * amplifier([55.0])[0]],
                         intervals__invalid_times__stop_time=[factor * amplifier([65.0])[0]]),
            code="beyond_a_finger", says=("invalid_times", "write them in s"),
        )
        for unit, factor in {"ms": 1e3, "us": 1e6, "samples": 3e4}.items()
    },
    **{
        f"NWB, obs_intervals of more than the pulses{what}": Case(
            "it was switched on after the press at 10 s and off before that at 80 s, whatever the file states",
            of_amplifier([t for t in UNTIL_LOST if t > BEGAN_S], **pulses_at(amplifier(RISES[1:7])),
                         **observed((0, 100))), columns, **right,
        )
        for what, columns, right in (
            ("", (), {"rates": [8, 24, 12], "lost": 3, "read_as": "sync pulses are not in it"}),
            (", observed throughout", ("observed=throughout",), {"rates": [4, 24, 12, 0], "silent": "are not in it"}),
        )
    },
    "NWB, obs_intervals as far as the pulses": Case(
        "it was silent at 70 s and off before the pulse of the press at 80 s, as the file states",
        of_amplifier(UNTIL_LOST, **pulses_at(amplifier(RISES[:7])), **observed((0, 75))), rates=[*ALL[:3], 0], lost=1,
        silent="are not in it",
    ),
    "NWB, a pulse in the middle is missing": Case(
        "it was on from the first pulse to the last, and silent at 70 and 80 s",
        of_amplifier(UNTIL_LOST, **pulses_at(amplifier(RISES[:3] + RISES[4:]))), rates=[*ALL[:3], 0],
    ),
    "NIX, t_start and t_stop": Case(
        "presses at 10, 70 and 80 s are outside of the spike train's span",
        nix(BEGAN_S, LOST_S), ("sync=none",), rates=[8, 24, 12], lost=3,
    ),
    "CSV, start and stop": Case(
        "rows of kind start and stop are the span", spikes_csv((0.0, "start"), (LOST_S, "stop"), spikes=UNTIL_LOST),
        rates=ALL[:3], lost=2, pulses=False,
    ),
    "CSV, on for longer than it fired": Case(
        "the file says that it recorded until 100 s, so no spike at 70 and 80 s is a rate of 0",
        spikes_csv((0.0, "start"), (100.0, "stop"), spikes=UNTIL_LOST), rates=[*ALL[:3], 0], pulses=False,
    ),
    "CSV, ends before the run": Case(
        "nothing says that the amplifier was on after the last spike",
        spikes_csv(spikes=UNTIL_LOST), rates=ALL[:3], lost=2, pulses=False,
    ),
    "CSV, observed throughout": Case(
        "the user says that it recorded to the end", spikes_csv(spikes=UNTIL_LOST), ("observed=throughout",),
        rates=[*ALL[:3], 0], pulses=False,
    ),
    "NWB, observed throughout": Case(
        "stated, and the file says otherwise", of_amplifier(UNTIL_LOST, **PULSES, **observed((0, LOST_S))),
        ("observed=throughout",), code="no_observed", says=("states when",),
    ),
    "CSV, all pulses": Case(
        "the amplifier was on to the end, and the afferent silent",
        spikes_csv(*syncs(amplifier(RISES)), spikes=amplifier(UNTIL_LOST).tolist()), rates=[*ALL[:3], 0],
    ),
    "CSV, the last pulses are missing": Case(
        "nothing shows that it was on to the end of the press at 60 s",
        spikes_csv(*syncs(amplifier(RISES[:6])), spikes=amplifier(UNTIL_LOST).tolist()), rates=ALL[:3], lost=3,
    ),
    **{
        f"{source}, {what}": Case(
            "what the file states holds; where it states nothing, it is known to have recorded from its first event "
            "(10.01 s) to its last (60.06 s), and the press that has it counts", write, pulses=False, **right,
        )
        for what, right, sources in (
            ("start alone", {"rates": [8, 24, 12], "lost": 3, "read_as": "from 15.0 s to 60.1 s, as its intervals"}, {
                "CSV": spikes_csv((BEGAN_S, "start"), spikes=UNTIL_LOST),
            }),
            ("stop alone", {"rates": ALL[:3], "lost": 2}, {
                "CSV": spikes_csv((LOST_S, "stop"), spikes=UNTIL_LOST),
            }),
            ("stop alone, late", {"rates": [8, 24, 12, 1], "lost": 1}, {
                "CSV": spikes_csv((100.0, "stop"), spikes=SINCE_15_S),
            }),
            ("a gap alone", {"rates": [6, 28, 12], "lost": 3}, {
                "NWB": nwb(units__spike_times=[t for t in UNTIL_LOST if not 25 < t < 35], **gap(25, 35)),
                "CSV": spikes_csv((25.0, "stop"), (35.0, "start"), spikes=[t for t in UNTIL_LOST if not 25 < t < 35]),
            }),
            ("a gap before all events", {"rates": [8, 24, 12], "lost": 3}, {
                "NWB": nwb(units__spike_times=[t for t in UNTIL_LOST if t > BEGAN_S], **gap(0, 2)),
            }),
            ("nothing", {"rates": ALL[:3], "lost": 2}, {
                "NWB": nwb(units__spike_times=UNTIL_LOST), "CSV": spikes_csv(spikes=UNTIL_LOST),
                "NIX": nix(stop=max(UNTIL_LOST)),
            }),
            ("a gap, else throughout", {"rates": [6, 28, 12, 0], "lost": 1, "columns": ("observed=throughout",)}, {
                "NWB": nwb(units__spike_times=[t for t in UNTIL_LOST if not 25 < t < 35], **gap(25, 35)),
                "CSV": spikes_csv((25.0, "stop"), (35.0, "start"), spikes=[t for t in UNTIL_LOST if not 25 < t < 35]),
            }),
        )
        for source, write in sources.items()
    },
    **{
        f"CSV, {what}": Case(why, units_csv(unit, *rows), rates=rates, lost=lost, pulses=False)
        for what, why, unit, rates, lost, rows in (
            ("fibers in turn, the first", "b's time is not a's", "a", ALL[:3], 2, (
                "0,start,a", f"{LOST_S},stop,a", f"{LOST_S + 1},start,b", "100,stop,b")),
            ("fibers in turn, the second", "a's time is not b's", "b", ALL[1:], 2, (
                "0,start,a", "25,stop,a", "26,start,b", "100,stop,b")),
            ("fibers at once", "each has its own time", "a", ALL, 0, (
                "0,start,a", "0,start,b", f"{LOST_S},stop,b", "100,stop,a")),
            ("a start of the file, a stop of a fiber", "both hold", "a", ALL[:3], 2, (
                "0,start,", f"{LOST_S},stop,a", "100,stop,")),
            ("a start of 1, a unit 1.0", "one number", "1", ALL, 0, ("0,start,1.0", "100,stop,1.0")),
        )
    },
    **{
        f"{kind}, a unit that is silent while another fires": Case(
            "the other unit's spikes show that the file recorded at 70 and 80 s, where this one has a rate of 0",
            two_units(kind), rates=[*ALL[:3], 0], pulses=False,
        )
        for kind in ("NWB", "CSV", "NIX", "MAT")
    },
    **{
        f"{kind}, a single spike": Case(
            "the file recorded at its spike, and says no more", write, code="few_positions", pulses=False,
            says=("7 of 8 presses are not observed: the file has events at 60.1 s, and does not state",),
        )
        for kind, write in {
            "NWB": nwb(units__spike_times=[60.06]), "CSV": spikes_csv(spikes=[60.06]),
            "NIX": nix(stop=60.06, spikes=[60.06]),
        }.items()
    },
    "CSV, a start of a unit without spikes beside a unit with its own": Case(
        "the unit that is read has its own rows, so the others are not its", units_csv(
            "a", "0,start,a", "100,stop,a", "0,start,c"), rates=ALL, pulses=False,
    ),
    "CSV, a fiber without spikes": Case(
        "its time is stated, so it is there", units_csv("c", "0,start,c", "100,stop,c"), code="no_spikes",
        pulses=False,
    ),
    **{
        f"CSV, a stop of a unit without spikes, and {which}": Case(
            "the name may be that of the unit which was lost, written in another way",
            units_csv(unit, f"{LOST_S},stop,unit 1"), code="unclear_name", pulses=False,
            says=("row 2, column unit: 'unit 1' must be a unit with spikes (a, b)", "delete the row"),
        )
        for which, unit in (("another chosen", "a"), ("none chosen", ""), ("one that is not there", "d"))
    },
    "nothing observed": Case(
        "no press is left", of_amplifier([0.5], **PULSES, **observed((0, 1))), code="few_positions",
        says=("8 of 8 presses are not observed",),
    ),
}  # fmt: skip

PRESENT = {
    "NWB, a sampled line": Case("its rises are the pulses", of_amplifier(**sampled("acquisition__sync_pulses")),
                                rates=ALL),
    "NWB, both edges": Case("the rises are those where the data are high", of_amplifier(**both_edges()), rates=ALL),
    "NWB, a pulse at switch-on": Case(
        "the other eight are the run's", of_amplifier(**pulses_at(np.append(0.001, amplifier(RISES)))), rates=ALL,
    ),
    "NWB, a pulse is missing": Case(
        "the other seven tell the clock", of_amplifier(**pulses_at(np.delete(amplifier(RISES), 3))), rates=ALL,
    ),
    "NWB, half of the pulses are missing": Case(
        "what is there may be other events", of_amplifier(**pulses_at(amplifier(RISES[:4]))),
        ("observed=throughout",), rates=ALL,
        read_as="These are 4 of the 8 pulses of the run: they may be other events",
    ),
    "NWB, one too many and one missing": Case(
        "as many as the run's, and still not the run's",
        of_amplifier(**pulses_at(np.append(0.001, np.delete(amplifier(RISES), 3)))), rates=ALL,
    ),
    "NWB, pulses that could be any": Case(
        "three of many equal intervals fit at several places",
        of_amplifier(**pulses_at(np.array([0.0, 0.001, 0.002]))), code="number_of_pulses", says=("3", "8"),
    ),
    "NWB, pulses under another name": Case(
        "they are there", of_amplifier(intervals__ttl__start_time=amplifier(RISES)), code="unknown_pulses",
        says=("ttl (8 intervals)", "--columns sync=", "sync=none"),
    ),
    "NWB, the other name": Case(
        "named", of_amplifier(intervals__ttl__start_time=amplifier(RISES)), ("sync=ttl",), rates=ALL
    ),
    "NWB, a line under another name": Case(
        "it is there", of_amplifier(**sampled("stimulus__presentation__digital_in")), code="unknown_pulses",
        says=("digital_in",),
    ),
    "NWB, that line": Case(
        "named", of_amplifier(**sampled("stimulus__presentation__digital_in")), ("sync=digital_in",), rates=ALL,
    ),
    "NWB, events of a processing module": Case(
        "they are there", of_amplifier(processing__behavior__TTL__timestamps=amplifier(RISES),
                                       processing__behavior__TTL__data=np.ones(8)),
        code="unknown_pulses", says=("processing/behavior/TTL",),
    ),
    "NWB, a table of events": Case(
        "times in a column", of_amplifier(events__ttl__timestamp=amplifier(RISES)), ("sync=ttl",), rates=ALL,
    ),
    "NWB, events with labels": Case(
        "1 is the number of another line, not a level", of_amplifier(
            acquisition__sync_pulses__timestamps=np.sort(np.concatenate([amplifier(RISES), [30.0, 50.0]])),
            acquisition__sync_pulses__data=np.searchsorted([1, 3], np.arange(10)) == 1,
            **{"acquisition__sync_pulses__data.labels": ["sync", "reward"]},
        ), rates=ALL,
    ),
    "NWB, trials": Case(
        "the trials are on the amplifier's clock, and no pulse leads to the run's",
        of_amplifier(intervals__trials__start_time=amplifier(STARTS)), code="unknown_pulses",
        says=("trials (8 intervals)",),
    ),
    "NWB, pulses elsewhere": Case(
        "a name that is not there lists what is",
        of_amplifier(intervals__ttl__start_time=amplifier(RISES)), ("sync=pulses",), code="no_pulses",
        says=("ttl (8 intervals)",),
    ),
    "NIX, a sampled line": Case(
        "a signal called ttl may be the pulses", nix(line_v=True), code="several_channels", says=("ttl",)
    ),
    "NIX, a line under another name": Case(
        "a measured signal is no pulse until it is named", nix(line_v=True, name="Stim monitor"),
        code="no_pulses_in_file",
    ),
    "NIX, that other name": Case("named", nix(line_v=True, name="Stim monitor"), ("sync=Stim monitor",), rates=ALL),
    "NIX, an epoch": Case(
        "it may mark presses that do not count", nix(line_v=True, epoch=("bad", "artifact")), ("sync=ttl",),
        rates=ALL, read_as="The file's bad (1 interval) are not used",
    ),
    "NWB, trials with a column of rejections": Case(
        "it is not used, and said", of_amplifier(
            **PULSES, intervals__trials__start_time=amplifier(STARTS), intervals__trials__rejected=[0] * 8),
        rates=ALL, read_as="trials (8 intervals, column rejected) are not used",
    ),
    "NWB, epochs with tags": Case(
        "they are not used, and said", of_amplifier(
            **PULSES, intervals__epochs__start_time=[45.0], intervals__epochs__tags=["artifact"]),
        rates=ALL, read_as="epochs (1 interval, artifact) are not used",
    ),
    "NWB, epochs and no pulses": Case(
        "said, whatever the clock", nwb(intervals__epochs__start_time=[45.0]), ("sync=none",), rates=ALL,
        pulses=False, read_as="epochs (1 interval) are not used",
    ),
    "NIX, that line": Case("named", nix(line_v=True), ("sync=ttl",), rates=ALL),
    "CSV, a column of pulses beside": Case(
        "--columns names the times, and the pulses are there", text(
            "t_s,ttl\n" + "".join(f"{t},0\n" for t in TIMES)
        ), ("time=t_s",), code="unknown_pulses", says=("'ttl'", "kind"), pulses=False,
    ),
    "CSV, several units": Case(
        "spikes of two units are not one afferent's",
        text("unit,t_s\n" + "".join(f"a,{t}\nb,{t + 0.1}\n" for t in TIMES)), ("time=t_s",), code="several_units",
        says=("one of a, b",), pulses=False,
    ),
    **{
        f"CSV, units {one} and {other}": Case(
            "spikes of one would be lost", lambda folder, one=one, other=other: text("unit,t_s\n" + "".join(
                f"{one},{t}\n{other},{t + 0.1}\n" for t in TIMES))(folder) + f"#{one}",
            ("time=t_s",), code="unclear_name", says=(f"'{one}'", f"'{other}'", "one way"), pulses=False,
        )
        for one, other in (("1", "1.0"), ("01", "1"), ("a", "A"), ("a b", "a  b"))
    },
    "CSV, unit 1.0 called 1": Case(
        "one number", lambda folder: text("unit,t_s\n" + "".join(f"1.0,{t}\n2.0,{t + 0.1}\n" for t in TIMES))(folder)
        + "#1", ("time=t_s",), rates=ALL, pulses=False,
    ),
    "CSV, one of several units": Case(
        "chosen", lambda folder: text("unit,t_s\n" + "".join(f"a,{t}\nb,{t + 0.1}\n" for t in TIMES))(folder) + "#a",
        ("time=t_s",), rates=ALL, pulses=False,
    ),
}  # fmt: skip


def table(header: str, *rows: str, sep: str = ",") -> Callable[[Path], str]:
    return text("\n".join((header, *rows)).replace("|", sep) + "\n")


COUNTS_250MS = ("-0.5|3|250", "0|12|250", "0.25|6|250", "1|1|250")
IN_QUARTER = [12, 48, 24, 4]
"""Rates of these counts in 0.25 s."""

UNITS = {
    "window (msec)": Case("a synonym of ms", table("position_mm|count|window (msec)", *COUNTS_250MS),
                          rates=IN_QUARTER),
    "window [milliseconds]": Case("a synonym of ms", table("position_mm|count|window [milliseconds]", *COUNTS_250MS),
                                  rates=IN_QUARTER),
    "window_msec": Case("a synonym of ms", table("position_mm|count|window_msec", *COUNTS_250MS), rates=IN_QUARTER),
    "window (fortnights)": Case("unknown", table("position_mm|count|window (fortnights)", *COUNTS_250MS),
                                code="unknown_unit", says=("window (fortnights)", "fortnights", "ms")),
    "window (mm)": Case("a length is no time", table("position_mm|count|window (mm)", *COUNTS_250MS),
                        code="unknown_unit", says=("'mm'",)),
    "position (mm)": Case("mm", table("position (mm)|rate", "-0.5|6", "0|24", "0.25|12", "1|1"), rates=ALL),
    "Position [MM]": Case("mm", table("Position [MM]|Rate", "-0.5|6", "0|24", "0.25|12", "1|1"), rates=ALL),
    "position (micron)": Case("µm", table("position (micron)|rate", "-500|6", "0|24", "250|12", "1000|1"), rates=ALL),
    "rate (imp/min)": Case("a minute has 60 s", table("position_mm|rate (imp/min)", "-0.5|360", "0|1440", "0.25|720",
                                                      "1|60"), rates=ALL),
    "rate_per_min": Case("a minute has 60 s", table("position_mm|rate_per_min", "-0.5|360", "0|1440", "0.25|720",
                                                    "1|60"), rates=ALL),
    "rate (spikes per second)": Case("1/s", table("position_mm|rate (spikes per second)", "-0.5|6", "0|24", "0.25|12",
                                                  "1|1"), rates=ALL),
    **{
        header: Case(why, table(f"position_mm|{header}", "-0.5|6", "0|24", "0.25|12", "1|1"), rates=ALL, read_as=said)
        for header, why, said in (
            ("impulses/sec", "a unit of rates alone", "impulses/sec as rate in impulses/sec"),
            ("spikes per second", "a unit of rates alone", "spikes per second as rate in spikes per second"),
            ("Hz", "a unit of rates alone", "Hz as rate in Hz"),
            ("normalized rate", "in units of their own", "normalized rate as rate in normalized"),
        )
    },
    "imp/min": Case("a minute has 60 s", table("position_mm|imp/min", "-0.5|360", "0|1440", "0.25|720", "1|60"),
                    rates=ALL),
    "a unit of rates beside rates": Case("which of the two?", table("position_mm|rate|Hz", "-0.5|6|6", "0|24|24"),
                                         code="extra_column", says=("'Hz'",)),
    "rate (kHz)": Case("1000/s", table("position_mm|rate (kHz)", "-0.5|.006", "0|.024", "0.25|.012", "1|.001"),
                       rates=ALL),
    "sd with the rates": Case("an sd without a unit has that of the rates, so its rates are read",
                              table("position_mm|rate (1/ms)|sd", "-0.5|.006|.001", "0|.024|.001", "0.25|.012|.001",
                                    "1|.001|.001"), rates=ALL),
    "rate (V)": Case("unknown", table("position_mm|rate (V)", "-0.5|6", "0|24", "0.25|12"), code="unknown_unit",
                     says=("'V'",)),
    "--columns x (in)": Case("an inch has 25.4 mm", table("x (in)|rate", "-.02|6", "0|24", ".01|12", ".04|1"),
                             ("position=x (in)",), rates=ALL),
    "--columns x:inch": Case("an inch has 25.4 mm", table("x|rate", "-.02|6", "0|24", ".01|12", ".04|1"),
                             ("position=x:inch",), rates=ALL),
    "--columns x (parsec)": Case("unknown", table("x (parsec)|rate", "1|6", "2|24", "3|12"), ("position=x (parsec)",),
                                 code="unknown_unit", says=("parsec",)),
    "--columns x (parsec):mm": Case("stated", table("x (parsec)|rate", "1|6", "2|24", "3|12", "4|1"),
                                    ("position=x (parsec):mm",), rates=ALL),
    "count (spikes)": Case("counts may say what they count", table("position_mm|count (spikes)|window_ms",
                                                                   *COUNTS_250MS), rates=IN_QUARTER),
    "count (kHz)": Case("a rate is no count", table("position_mm|count (kHz)|window_ms", *COUNTS_250MS),
                        code="unknown_unit", says=("kHz",)),
    "time (msec)": Case("a synonym of ms", text("time (msec)\n" + "".join(f"{1e3 * t}\n" for t in TIMES)), rates=ALL,
                        pulses=False),
    "no unit": Case("mm or µm?", table("position|rate", "-0.5|6", "0|24", "0.25|12"), code="no_unit",
                    says=("--columns position=position:mm",)),
    "two columns": Case("which of the two?", table("position (mm)|x (um)|rate", "1|1000|6", "2|2000|24", "3|3000|12"),
                        code="two_columns", says=("position (mm)", "x (um)")),
    "µm called mm": Case("no finger is 2 m wide", table("position_mm|rate", "-2000|6", "0|24", "2000|12"),
                         code="beyond_a_finger", says=("row 2", "-2000", "'position (um)'")),
    "µm called mm by --columns": Case("no finger is 2 m wide", table("x|rate", "-2000|6", "0|24", "2000|12"),
                                      ("position=x:mm",), code="beyond_a_finger", says=("row 2", "position=x:um")),
    "mm called cm": Case("no finger is 20 cm wide", table("position_cm|rate", "-20|6", "0|24", "20|12"),
                         code="beyond_a_finger", says=("row 2", "'position (mm)'")),
    "mm called µm": Case("no profile lies within 10 µm", table("position_um|rate", "-.5|6", "0|24", "1|12"),
                         code="beyond_a_finger", says=("'position (mm)'",)),
    "s called min": Case("no hold lasts 15 min", table("position_mm|count|window_min", "-0.5|3|15", "0|12|15"),
                         code="beyond_a_finger", says=("'window (s)'",)),
    "1/s called 1/ms": Case("a rate of 24/ms is none, 24/s is", table("position_mm|rate_per_ms", "-0.5|6", "0|24"),
                            code="beyond_a_finger", says=("'rate (1/s)'",)),
    "1/s called 1/ms in --columns": Case(
        "a rate of 24/ms is none, 24/s is", table("position_mm|rate_per_ms", "-0.5|6", "0|24"),
        ("rate=rate_per_ms",), code="beyond_a_finger", says=("'rate (1/s)'",)),
    "m called mm": Case("no profile lies within 10 µm", table("position_mm|rate", "-.002|6", "0|24", ".002|12"),
                        code="beyond_a_finger", says=("0.004", "'position (m)'")),
    "ms called s": Case("no hold lasts 16 min", table("position_mm|count|window_s", "-0.5|3|1000", "0|12|1000"),
                        code="beyond_a_finger", says=("1000", "'window (ms)'")),
    "spikes too dense": Case(
        "no afferent fires 2000 spikes in 20 ms", text("time (s)\n" + "".join(
            f"{start + 1e-5 * k}\n" for start in STARTS for k in range(2000))), pulses=False,
        code="spikes_twice", says=("0.5 ms", "unit of time"),
    ),
    "window=500": Case("no hold lasts 8 min", table("position_mm|count", "-0.5|3", "0|12", "0.25|6"),
                       ("window=500",), code="beyond_a_finger", says=("500", ":ms")),
    "counts called rates per min": Case("no afferent fires 3600 times a second",
                                        table("position_mm|rate", "-0.5|360", "0|3600", "0.25|72"),
                                        code="beyond_a_finger", says=("3600", ":1/min")),
    "rates in units of their own": Case("stated", table("position_mm|rate", "-0.5|3600", "0|4800", "0.25|7200"),
                                        ("rate=rate:a.u.",), rates=[3600, 4800, 7200]),
    "trials": Case(
        "a table of trials: presses at one place are told apart by the number of the trial",
        table("trial|position (mm)|spike_count|duration_ms", "1|-0.5|2|500", "2|0|10|500", "3|0|14|500",
              "4|-0.5|4|500", "5|0.25|6|500", "6|0.25|6|500", "7|1|0|500", "8|1|1|500"), rates=ALL,
    ),
    "trials without a unit": Case(
        "one line says all that is missing",
        table("trial|position|spike_count|duration_ms", "1|-0.5|2|500", "2|0|10|500", "3|0.25|6|500"), code="no_unit",
        says=("--columns position=position:mm",),
    ),
    "trials with another column": Case(
        "one line says how to go on",
        table("subject|trial|position (mm)|spike_count|duration_ms", "S1|1|-0.5|2|500", "S1|2|0|10|500"),
        code="extra_column",
        says=("'subject'", "position=position (mm),count=spike_count,window=duration_ms,repeat=trial"),
    ),
    "CSV, kinds in a column of another name": Case(
        "pulses are no spikes",
        spikes_csv(*syncs(amplifier(RISES)), spikes=amplifier(TIMES).tolist(), header="t_s,type"), ("time=t_s",),
        rates=ALL,
    ),
}  # fmt: skip

NUMBERS = {
    "thousands of µm": Case("−2 mm or −0.002 mm?", table('x (um);rate', "-2,000;6", "-800;24", "0;12", "1,000;1"),
                            code="ambiguous_number", says=("row 2", "'-2,000'", "2000")),
    "thousands, quoted": Case("−2 mm or −0.002 mm?", table("x (um),rate", '"-2,000",6', "-800,24", "0,12"),
                              code="ambiguous_number", says=("row 2", "'-2,000'")),
    "thousands of counts": Case("1449 or 1.449?", table("position_mm,count,window_s", "-0.5,935,20", '0,"1,449",20',
                                                        "0.25,537,20"),
                                code="ambiguous_number", says=("row 3", "'1,449'")),
    "thousands with a point": Case("−2000 or −2.000 µm?", table("x (um);rate", "-2.000;6", "-800;24", "0;12"),
                                   code="ambiguous_number", says=("row 2", "'-2.000'")),
    "points with three digits in every cell, semicolons": Case(
        "1120/min or 1.12/min?", table("position_mm;rate per min", "-1;1.120", "0;4.300", "1;2.500"),
        code="ambiguous_number", says=("row 2", "'1.120'", "1120"),
    ),
    "points with three digits, semicolons, and a decimal point": Case(
        "-0.5 is no thousand, so the point is decimal",
        table("position_mm;rate", "-0.5;6.000", "0;24.000", "0.25;12.000", "1;1.000"), rates=ALL,
    ),
    "points with three digits, commas": Case(
        "where commas separate columns, the point is decimal",
        table("position_mm,rate", "-1,6.000", "0,24.000", "2,12.000", "3,1.000"), rates=ALL,
    ),
    "a decimal comma in a text among numbers": Case(
        "both cells are named, since either may be wrong", table("position_mm;rate", "-1;5", "-0.5;12", "0;40,5"),
        code="no_number", says=("row 3", "'-0.5'", "as '40,5', or that cell with a point"),
    ),
    "millions": Case("two separators", table("x (um);rate", "-2,000,000;6", "-800;24", "0;12"),
                     code="ambiguous_number", says=("'-2,000,000'",)),
    "decimal commas with three digits": Case("0,250 is no thousand, so the comma is decimal",
                                             table("position_mm;rate", "-0,500;6", "0;24", "0,250;12", "1,000;1"),
                                             rates=ALL),
    "decimal points with three digits": Case("all cells have a point and three digits", table(
        "position_mm;rate", "-0.500;6", "0.000;24", "0.250;12", "1.000;1"), rates=ALL),
    "decimal points, without zeros": Case("1.125 beside 2 is decimal",
                                          table("position_mm,rate", "1.125,6", "2,24", "3,12", "4,1"), rates=ALL),
    "a space between thousands": Case("no number", table("position_mm;count;window_s", "0;1 449;20", "1;2;20",
                                                         "2;3;20"), code="no_number", says=("row 2", "'1 449'")),
}  # fmt: skip

TWICE = [(x, y + d, n) for n, d in ((1, -1), (2, 1)) for x, y in zip((-0.5, 0, 0.25, 1), ALL, strict=True)]
"""Two repeats at each position, whose means are the rates."""


def twice(*last: str, shift_mm: float = 0.0, header: str = "position_mm,rate,repeat") -> Callable[[Path], str]:
    """A table of repeats, the second ones at shifted positions, with more rows below."""
    return table(header, *(f"{x + shift_mm * (n - 1)!r},{y},{n}" for x, y, n in TWICE), *last)


def three_repeats(*labels: str, third: Sequence[str]) -> Callable[[Path], str]:
    """Rates of two presses at each of four positions, and a third row."""
    places = {-0.5: ("2.33", "4"), 0.0: ("10", "14"), 0.25: ("6", "7"), 1.0: ("0", "1")}
    rows = [(x, one, label) for x, pair in places.items() for one, label in zip(pair, labels[:2], strict=True)]
    rows += [(x, one, labels[2]) for x, one in zip(places, third, strict=True)]
    return table("position_mm,rate,repeat", *(f"{x:g},{one},{label}" for x, one, label in rows))


def four_repeats(of: Callable[[tuple[int, ...]], Any], places: int) -> Callable[[Path], str]:
    """Three presses at some positions, and a fourth repeat that is what these are together."""
    presses = ((10, 11, 13), (30, 33, 31), (25, 22, 29), (8, 9, 9), (17, 12, 13), (4, 9, 6), (2, 3, 7))[:places]
    rows = [(x, y, n) for x, some in enumerate(presses) for n, y in enumerate((of(some), *some))]
    return table("position_mm,rate,repeat", *(f"{x},{y},{n}" for x, y, n in rows))


def _sd(some: Any) -> float:
    return float(np.std(some, ddof=1))


def _beside(of: Sequence[Callable[[Any], Any]], before: bool, *, repeats: bool = True) -> list[str]:
    """Presses at uneven positions, and rows of what these are together in each column."""
    presses = [(x, y + d, n) for n, d in ((1, -1), (2, 1)) for x, y in zip((-0.6, 0.1, 0.4, 1), ALL, strict=True)]
    columns = np.array(presses if repeats else presses[:4])[:, : 3 if repeats else 2].T
    rows = [",".join(map(repr, row)) for row in columns.T.tolist()]
    totals = [",".join(f"{float(one(column))!r}" for column in columns) for one in of]
    return [*totals, *rows] if before else [*rows, *totals]


ROWS = {
    **{
        f"a repeat {label} that is {what}": Case(
            "no press is what the others are together", three_repeats("1", "2", label, third=third),
            code="totals",
            says=(f"'{label}'", word, "each of 4 positions"),
        )
        for label, what, word, third in (
            ("0", "the mean", "mean", ("3.165", "12", "6.5", "0.5")),
            ("9", "the sum", "sum", ("6.33", "24", "13", "1")),
            ("3", "the rounded mean", "mean", ("3.2", "12.0", "6.5", "0.5")),
        )
    },
    **{
        f"a repeat that is {what} of the others{where}": Case(
            "no press is what the others are together", four_repeats(of, places), code="totals",
            says=("'0'", word, f"each of {places} positions"),
        )
        for what, word, of, where, places in (
            ("the median", "median", np.median, "", 7),
            ("the minimum", "minimum", np.min, "", 7),
            ("the maximum", "maximum", np.max, "", 7),
            ("the sd", "sd", lambda others: round(float(np.std(others, ddof=1)), 2), "", 4),
            ("the sd of n", "sd", lambda others: round(float(np.std(others)), 2), "", 4),
            ("the standard error", "standard error",
             lambda others: round(float(np.std(others, ddof=1)) / 3**0.5, 3), "", 4),
            ("the mean as a whole number", "mean", lambda others: round(float(np.mean(others))), "", 7),
            ("the mean as a whole number, with a point", "mean", lambda others: float(round(np.mean(others))), "", 7),
            ("the median as a whole number", "median", lambda others: float(np.median(others)), "", 7),
            ("the sd as a whole number", "sd", lambda others: float(round(np.std(others, ddof=1))), "", 7),
            ("the mean, with zeros", "mean", lambda others: f"{np.mean(others):.1f}000", "", 7),
        )
    },
    "a repeat that is the minimum of the others at four positions": Case(
        "as the smallest of equal presses may be: said", four_repeats(np.min, 4),
        rates=[11.0, 31.0, 24.5, 8.5], read_as="The repeat 0 is counted as a press, but it has the minimum of the",
    ),
    "repeats of few spikes": Case(
        "one is as the others by chance: said", table("position_mm,rate,repeat", *(
            f"{x},{y},{n}" for x, some in enumerate(((0, 0, 0, 1), (1, 1, 2, 0), (0, 0, 1, 0), (2, 2, 1, 3)))
            for n, y in enumerate(some))), rates=[0.25, 1, 0.25, 2], read_as="The repeat 0 is counted as a press, but"
    ),
    "a repeat that is the mean at some positions": Case(
        "by chance", three_repeats("1", "2", "3", third=("3.165", "12", "6.5", "0")), rates=[3.165, 12, 6.5, 1 / 3],
    ),
    "positions that differ by a rounding error": Case("they are one position", twice(shift_mm=4e-16), rates=ALL),
    "positions that differ by 0.1 µm": Case("they are one position", twice(shift_mm=1e-4), rates=ALL),
    "positions that differ by 2 µm": Case("readings of a stage; four positions or eight?", twice(shift_mm=2e-3),
                                          code="close_positions", says=("row 6", "-0.498", "row 2", "round")),
    "positions 2 µm apart in one repeat": Case(
        "two positions, and it is said", table("position_mm,rate", "-0.5,6", "-0.498,24", "0.25,12", "1,1"),
        rates=ALL, read_as="-0.5 and -0.498 mm lie within 0.01 mm",
    ),
    "an sd is missing": Case("the others would not count either", table("position_mm,rate,sd", "-0.5,6,1", "0,24,",
                                                                        "0.25,12,1"),
                             code="no_number", says=("row 3", "sd", "0 or more")),
    **{
        f"an sd {missing!r}": Case("its row need not go", table("position_mm,rate,sd", "-0.5,6,1", f"0,24,{missing}"),
                                   code="no_number", says=("row 3", "sd", "fill it in, or delete the column"))
        for missing in ("", "-", "n/a", "NaN")
    },
    "a rate n/a": Case("its row says nothing", table("position_mm,rate,sd", "-0.5,6,1", "0,n/a,1"), code="no_number",
                       says=("row 3", "rate", "delete rows")),
    "an sd of no row": Case("there is none", table("position_mm,rate,sd", "-0.5,6,", "0,24,", "0.25,12,", "1,1,"),
                            rates=ALL),
    "an sd and repeats": Case("which of the two?", table("position_mm,rate,repeat,sd", *(
        f"{x},{y},{n},9" for x, y, n in TWICE)), code="sd_and_repeats", says=("column sd", "delete")),
    **{
        f"a row with repeat {word!r}": Case("a summary is no press", twice(f"0,99,{word}"), code="no_repeat",
                                            says=("row 10", repr(word), "delete"))
        for word in ("", "Mean", "sum", "Mittelwert", "mean (n=2)", "AVG(1:2)", "mean2", "n = 2")
    },
    **{
        f"repeat {again!r} after {first!r}": Case(
            "one repeat", table("position_mm,rate,repeat", f"0,6,{first}", f"0,24,{again}", f"0.25,12,{more}"),
            code="place_twice", says=("row 3", "first in row 2", f"both have {again!r} in the column repeat"),
        )
        for first, again, more in (("1", "1.0", "2"), ("01", "1", "2"), ("1e1", "10", "2"), ("a1", "A1", "a2"),
                                   ("a 1", "a  1", "a 2"), ("a 1", "a\u00a01", "a 2"))
    },
    **{
        f"a repeat {word!r} beside numbers": Case(
            "what is no number may be a mean", twice(f"0,99,{word}"), code="no_repeat", says=("row 10", repr(word))
        )
        for word in ("M", "M1", "moyenne 1-2", "Mittel", "gesamt", "promedio", "trial 3", "1-2", "1+2")
    },
    **{
        f"a repeat {word!r} beside names": Case("a summary is no press", table(
            "position_mm,rate,repeat", "0,1,a", "0,3,b", f"0,2,{word}"), code="no_repeat", says=(repr(word),))
        for word in ("moyenne", "Mittelwert 1", "Durchschnitt", "gesamt", "Promedio", "media", "somme", "Summe n=2")
    },
    "repeats with numbers and letters": Case("names", table("position_mm,rate,repeat", *(
        f"{x},{y},{('r1', 'M2')[n - 1]}" for x, y, n in TWICE)), rates=ALL),
    "repeats A1 and A01": Case("two labels", table("position_mm,rate,repeat", *(
        f"{x},{y},{('A1', 'A01')[n - 1]}" for x, y, n in TWICE)), rates=ALL),
    "one repeat, written in two ways": Case("a position of it and one nearby are two positions", table(
        "position_mm,rate,repeat", "-0.5,6,1", "-0.498,24,1.0", "0.25,12,01", "1,1,1"), rates=ALL,
        read_as="-0.5 and -0.498 mm lie within 0.01 mm"),
    "repeats with names, and a mean": Case("a summary is no press", table("position_mm,rate,repeat", "0,1,a", "0,3,b",
                                                                          "0,2,mean"), code="no_repeat"),
    "repeats with names": Case("allowed, and said", table("position_mm,rate,repeat", *(
        f"{x},{y},{'ab'[n - 1]}" for x, y, n in TWICE)), rates=ALL,
        read_as="The repeats a, b are counted as presses: delete rows of sums and means."),
    **{
        f"repeats with names, and {word!r}": Case("no list has all words for a mean, so the numbers tell", table(
            "position_mm,rate,repeat", *(f"{x},{y},{'ab'[n - 1]}" for x, y, n in TWICE),
            *(f"{x},{y},{word}" for x, y in zip((-0.5, 0, 0.25, 1), ALL, strict=True))), code="totals",
            says=(repr(word), "mean"))
        for word in ("alle", "gemiddelde", "\u03a3", "\u00d8")
    },
    "a row of sums": Case("no press", table("position_mm,rate", "-0.6,6", "0.1,24", "0.4,12", "1,1", "0.9,43"),
                          code="totals", says=("row 6", "'43'", "sums")),
    "a row of sums of counts": Case("no press", table("position_mm,count,window_s", "-1,6,1", "-.5,24,1", "1.5,12,1",
                                                      "0,42,3"), ("window=1",), code="totals", says=("sums",)),
    "a row of means": Case("no press", table("position_mm,rate", "-0.5,6", "0.1,24", "0.4,12", "1,1", "0.25,10.75"),
                           code="totals", says=("means",)),
    **{
        f"{what} of pandas {where}": Case(
            "no press", table("position_mm,rate,repeat", *_beside(of, before)), code=code, says=says)
        for what, of, code, says in (
            ("mean and sd", (np.mean, _sd), "no_repeat", ("'1.5'", "a whole number")),
            ("an sd", (_sd,), "no_repeat", ("a whole number",)),
            ("an sd of n", (np.std,), "no_repeat", ("'0.5'",)),
        )
        for where, before in (("below", False), ("above", True))
    },
    **{
        f"{what}, without repeats, {where}": Case(
            "no press", table("position_mm,rate", *_beside(of, before, repeats=False)), code="totals",
            says=(word, "the rows below" if before else "the rows above"))
        for what, of, word in (
            ("mean and sd", (np.mean, _sd), "means"), ("sd and mean", (_sd, np.mean), "means"),
            ("an sd", (_sd,), "sds"),
            ("a variance", (lambda some: np.var(some, ddof=1),), "variances"), ("a sum", (np.sum,), "sums"),
            ("count, mean and sd", (len, np.mean, _sd), "means"),
        )
        for where, before in (("below", False), ("above", True))
    },
    **{
        f"a row called {label!r} in a column that is not read": Case(
            "pandas writes it as the index", table("name,position_mm,rate", *(
                f"{n},{x},{y}" for n, (x, y, _) in enumerate(TWICE[:4])), f"{label},0.8,3"),
            ("position=position_mm", "rate=rate"), code="totals", says=("row 6, column name", repr(label)))
        for label in (
            "mean", "std", "sd", "sum", "median", "var", "count", "Total", "75%", "95% CI", "variance", "n=4",
        )
    },
    "a row called mean beside spike times": Case(
        "it is no spike", text("index,t_s\n" + "".join(f"{n},{t}\n" for n, t in enumerate(TIMES)) + "mean,47.5\n"),
        ("time=t_s",), code="totals", says=(f"row {len(TIMES) + 2}, column index", "'mean'"), pulses=False),
    "levels that are called min and max": Case(
        "conditions, not summaries", table("level,position_mm,rate", *(
            f"{level},{x},{y}" for level, x, y in zip(("min", "max") * 2, (-0.5, 0, 0.25, 1), ALL, strict=True))),
        ("position=position_mm", "rate=rate"), rates=ALL),
    "means, called so in every row": Case(
        "they are what was recorded", table("statistic,position_mm,rate", *(
            f"mean,{x},{y}" for x, y in zip((-0.5, 0, 0.25, 1), ALL, strict=True))),
        ("position=position_mm", "rate=rate"), rates=ALL),
    **{
        f"a repeat called {word!r}": Case("a summary is no press", twice(f"0,99,{word}"), code="no_repeat",
                                          says=(repr(word),))
        for word in ("var", "variance", "25%", "q25 quantile", "range", "CI", "95% CI", "stdev", "sem", "quartile 1")
    },
    **{
        f"{value} among {what}": Case("no data", table(header, *(row.replace("no", value) for row in rows)), columns,
                                      code="no_number", says=(f"row 3, column {column}", value, "no data"))
        for value, what, header, column, columns, rows in (
            ("999", "rates", "position_mm,rate", "rate", (), ("-1,6", "0,no", "1,12", "2,1")),
            ("999.0", "rates", "position_mm,rate", "rate", (), ("-1,6", "0,no", "1,12", "2,no")),
            ("999", "counts", "position_mm,count", "count", ("window=1",), ("-1,6", "0,no", "1,12", "2,1")),
            ("9999", "rates in a unit of their own", "position_mm,rate (a.u.)", "rate (a.u.)", (),
             ("-1,6", "0,no", "1,12", "2,1")),
            ("99", "positions", "position_mm,rate", "position_mm", (), ("-1,6", "no,24", "1,12", "2,1")),
            ("-99", "positions", "position_mm,rate", "position_mm", (), ("-1,6", "no,24", "1,12", "2,1")),
        )
    },
    "a rate of 99 among lower ones": Case("it may be one", table("position_mm,rate", "-1,6", "0,99", "1,12"),
                                          rates=[6, 99, 12]),
    "a rate of 999 among high ones": Case("it may be one", table("position_mm,rate", "-1,600", "0,999", "1,12"),
                                          rates=[600, 999, 12]),
    "a last press at the mean position": Case("its rate is not the mean's", table(
        "position_mm,rate", "-0.5,6", "0,24", "0.25,12", "0.75,1", "0.125,11"), rates=[6, 24, 11, 12, 1]),
    "the same rate everywhere": Case("a last press at 0 is no mean", table(
        "position_mm,rate", "-1,6", "1,6", "-.5,6", ".5,6", "0,6"), rates=[6] * 5),
}  # fmt: skip

MS_PULSES = {"intervals__sync_pulses__start_time": 1e3 * amplifier(RISES)}
MS_SPIKES = {"units__spike_times": 1e3 * amplifier(TIMES)}


def recorder_that_lost(press: int | None, *pulses: int) -> Callable[[Path], str]:
    """Its clock is half a second late from one pulse and press on, or up to the first."""
    spikes, rises = np.array(TIMES), np.array(RISES)
    if press is not None:
        rises[list(pulses)] -= 0.5
        mine = (spikes > STARTS[press] - 1) & (spikes < STARTS[press] + 1)
        spikes[mine] -= 0.5
    return of_amplifier(spikes.tolist(), **pulses_at(amplifier(rises)))


def of_presses(run: Run) -> Run:
    """The run has three pulses a press, and its journal says of which press they are."""
    pulses = [{"t_s": t + 0.01, "rise_s": t, "width_s": 0.01, "index": n, "at": at} for n, at, t in EDGES]
    return replace(run, events={**run.events, "sync": pulses})


def of_one_pulse(run: Run) -> Run:
    pulses = [{**pulse, "index": n, "at": "touch"} for n, pulse in enumerate(run.events["sync"])]
    return replace(run, events={**run.events, "sync": pulses})


EDGES = [
    (n, at, float(t))
    for n, (touch, start) in enumerate(zip(RISES, STARTS, strict=True))
    for at, t in (("touch", touch), ("hold_start", start - 0.01), ("hold_end", start + 0.59))
]


def paused(
    kind: str, *lost: int, off_s: float = 0.0, beside: Sequence[float] = (), **more: Any
) -> Callable[[Path], str]:
    """Of three pulses a press, those of these numbers are lost, or late, with the spikes of their presses.

    Spikes `beside` those of the presses are there.
    """
    presses_lost = {EDGES[n][0] for n in lost} if len(lost) > 1 else set()
    mine = [any(abs(t - STARTS[n]) < 1 for n in presses_lost) for t in TIMES]
    spikes = sorted([*(t + off_s * own for t, own in zip(TIMES, mine, strict=True) if off_s or not own), *beside])
    rises = [t + off_s * (n in lost) for n, (*_, t) in enumerate(EDGES) if off_s or n not in lost]
    if kind == "CSV":
        return spikes_csv(*syncs(amplifier(rises)), spikes=amplifier(spikes).tolist())
    if kind == "NIX":
        return nix(spikes=spikes, line_v=True, rises=rises)
    return of_amplifier(spikes, **pulses_at(amplifier(rises)) | more)


ALTHOUGH = ", although it states that the unit was observed"
FEWER = "Between 20.6 and 49.4 s of the run, the file has fewer pulses than the run"
GAPS = {
    **{
        f"{kind}, a recorder that paused during two presses": Case(
            "presses 2 and 3, at 0 mm, have no pulse and no spike", paused(kind, *range(6, 12)), ("sync=ttl",)
            * (kind == "NIX"), rates=[6.0, 12.0, 1.0], lost=2, run=of_presses, read_as=FEWER,
        )
        for kind in ("CSV", "NWB", "NIX")
    },
    "a pause, stated as observed": Case(
        "the pulses contradict it, and it is said", paused("NWB", *range(6, 12), **observed((0, 100))),
        rates=[6.0, 12.0, 1.0], lost=2, run=of_presses, read_as="although it states that the unit was observed",
    ),
    **{
        f"a pause, observed throughout{what}": Case(
            "the user says so, and the contradiction is said", paused("NWB", *range(6, 12), **more),
            ("observed=throughout",), rates=[6.0, 0.0, 12.0, 1.0], run=of_presses,
            read_as="The file has fewer pulses than the run, but presses count as observed",
        )
        for what, more in (("", {}), (", with intervals", observed((0, 100))))
    },
    **{
        f"{kind}, a recorder that paused during the {which} two presses{what}": Case(
            "it ran before the first press and after the last, and these have no pulse", paused(
                kind, *lost, beside=(1.0, 80.58), **more), ("sync=ttl",) * (kind == "NIX"), rates=rates, lost=2,
            run=of_presses,
            read_as=f"{where} of the run, the file has fewer pulses than the run, as if the recorder had paused"
            f"{although}: presses there count as not observed",
            silent="before its first or after its last event",
        )
        for which, lost, rates, where in (
            ("first", range(6), ALL[1:], f"Before {EDGES[6][2]:.1f} s"),
            ("last", range(18, 24), ALL[:3], f"After {EDGES[17][2]:.1f} s"),
        )
        for kind, what, more, although in (
            ("CSV", "", {}, ""), ("NWB", "", {}, ""), ("NIX", "", {}, ALTHOUGH),
            ("NWB", ", stated as observed", observed((0, 100)), ALTHOUGH),
        )
    },
    **{
        f"a recorder that paused during the {which} press": Case(
            "all its pulses are lost", paused("CSV", *lost, beside=(1.0, 80.58)), rates=rates, lost=1, run=of_presses,
            read_as="fewer pulses than the run",
        )
        for which, lost, rates in (("first", range(3), [8.0, *ALL[1:]]), ("last", range(21, 24), [*ALL[:3], 0.0]))
    },
    **{
        f"the only pulse of the {which} press lost": Case(
            "nothing shows that it was on up to the next pulse", of_amplifier(
                [1.0, *TIMES, 80.58], **pulses_at(amplifier(rises))), rates=rates, lost=lost, run=of_one_pulse,
            read_as="fewer pulses than the run",
        )
        for which, rises, rates, lost in (
            ("first", RISES[1:], [8.0, *ALL[1:]], 1), ("last", RISES[:-1], ALL[:3], 2),
        )
    },
    **{
        f"a recorder that paused at both ends, {what}": Case(
            why, paused("NWB", *range(3), *range(21, 24), beside=(1.0, 80.58), **more), columns, run=of_presses,
            **right,
        )
        for what, why, more, columns, right in (
            ("observed throughout", "the user says so, as where the cable of the pulses was plugged in late", {},
             ("observed=throughout",), {"rates": [4.0, 24.0, 12.0, 0.0], "read_as": "but presses count as observed"}),
            ("as it states", "no pulse is missing while it was observed", observed((0, 2), (15, 75), (80.6, 100)), (),
             {"rates": [8.0, 24.0, 12.0, 0.0], "lost": 2, "silent": "fewer pulses than the run"}),
            ("and lost one pulse more", "two at the end of a press are no lost edge",
             {"intervals__sync_pulses__start_time": amplifier([t for *_, t in EDGES[4:20]])}, (),
             {"rates": [8.0, 24.0, 12.0], "lost": 3, "read_as": "and after"}),
        )
    },
    "a pause of one press": Case(
        "its pulses are lost", paused("CSV", 6, 7, 8), rates=[6.0, 28.0, 12.0, 1.0], lost=1, run=of_presses,
        read_as="Between 20.6 and 39.1 s of the run, the file has fewer pulses",
    ),
    "a pause from one hold into the next": Case(
        "the first press was not observed to its end, nor the second from its beginning", paused("CSV", 8, 9, 10),
        rates=[6.0, 12.0, 1.0], lost=2, run=of_presses,
    ),
    "a recorder that was switched off in a hold": Case(
        "half of the press at 60 s is no rate", spikes_csv(
            *syncs(amplifier([t for *_, t in EDGES[:17]])), spikes=amplifier([t for t in TIMES if t < 60.035])),
        rates=[6.0, 24.0, 12.0], lost=3, run=of_presses, read_as="fewer pulses than the run",
    ),
    "a recorder that was switched on in a hold": Case(
        "half of the press at 20 s is no rate", spikes_csv(
            *syncs(amplifier([t for *_, t in EDGES[5:]])), spikes=amplifier([t for t in TIMES if t > 20.025])),
        rates=[24.0, 12.0, 1.0], lost=2, run=of_presses, read_as="fewer pulses than the run",
    ),
    "the last edge lost": Case(
        "the press has its other pulses", spikes_csv(
            *syncs(amplifier([t for *_, t in EDGES[:-1]])), spikes=amplifier(TIMES)), rates=ALL, run=of_presses,
        silent="fewer pulses than the run",
    ),
    "one edge lost": Case(
        "the other pulses of the press are there", paused("CSV", 7), rates=ALL, run=of_presses,
        silent="fewer pulses than the run",
    ),
    "one kind of pulse recorded": Case(
        "it was at its press each time", spikes_csv(
            *syncs(amplifier([t for *_, t in EDGES[::3]])), spikes=amplifier(TIMES).tolist()), rates=ALL,
        run=of_presses, silent="fewer pulses than the run",
    ),
    "the only pulse of a press lost": Case(
        "nothing shows that it was on, from the pulse before to that after", of_amplifier(
            [t for t in TIMES if not 30 < t < 31], **pulses_at(amplifier([*RISES[:2], *RISES[3:]]))),
        rates=[4.0, 28.0, 12.0, 1.0], lost=2, run=of_one_pulse, read_as="fewer pulses than the run",
    ),
    "two pulses in a row lost": Case(
        "no press is named, and two are no lost edge", of_amplifier(
            [t for t in TIMES if not 30 < t < 41], **pulses_at(amplifier([*RISES[:2], *RISES[4:]]))),
        rates=[4.0, 12.0, 1.0], lost=3, read_as="fewer pulses than the run",
    ),
    "a clock that wandered during a press": Case(
        "the line of the other pulses is not its clock there", paused("CSV", 7, 8, off_s=0.3),
        rates=[6.0, 28.0, 12.0, 1.0], lost=1, run=of_presses, read_as="or its clock had wandered",
    ),
    "a clock that wandered, observed throughout": Case(
        "the user does not know its clock either", paused("CSV", 7, 8, off_s=0.3), ("observed=throughout",),
        rates=[6.0, 28.0, 12.0, 1.0], lost=1, run=of_presses, read_as="or its clock had wandered",
    ),
}  # fmt: skip

CLOCKED = {
    **{
        f"a recorder that lost half a second {when}": Case(
            "the line of the other pulses is not its clock there", recorder_that_lost(of_presses, *pulses), **right
        )
        for when, of_presses, pulses, right in (
            ("before the last pulse", 7, (7,), {
                "rates": ALL[:3], "lost": 2, "read_as": "After 69.5 s of the run, its pulses and those of",
            }),
            ("after the first pulse", 0, (0,), {
                "rates": [8, *ALL[1:]], "lost": 1, "read_as": "Before 19.3 s of the run, its pulses and those of",
            }),
            ("never", None, (), {"rates": ALL, "silent": "do not fit one another"}),
        )
    },
    **GAPS,
    "a pulse too many at switch-on, and the last one missing": Case(
        "each has an explanation of its own, at another end",
        of_amplifier(**pulses_at(np.append(0.001, amplifier(RISES[:-1])))), rates=ALL,
        silent="do not fit one another",
    ),
    "NWB, spikes in ms and pulses in s": Case(
        "each input has its own unit", nwb(**MS_SPIKES, **PULSES), ("time=spike_times:ms",), rates=ALL,
    ),
    "NWB, spikes in ms, said nowhere": Case(
        "spikes a thousand times later than any pulse", nwb(**MS_SPIKES, **PULSES), code="outside_run",
        says=("--columns time=COLUMN:ms", "same unit of time as the pulses"),
    ),
    "NWB, both in ms": Case(
        "each input has its own unit", nwb(**MS_SPIKES, **MS_PULSES), ("time=spike_times:ms", "sync=sync_pulses:ms"),
        rates=ALL,
    ),
    "NWB, both in ms, said of one": Case(
        "a clock does not run a thousand times as fast", nwb(**MS_SPIKES, **MS_PULSES), ("time=spike_times:ms",),
        code="no_clock", says=("0.00099", "sync=NAME:ms"),
    ),
    "NWB, both in ms, said nowhere": Case(
        "a clock does not run a thousand times as fast", nwb(**MS_SPIKES, **MS_PULSES), code="no_clock",
        says=("sync=NAME:ms",),
    ),
    "NWB, another sampling rate": Case(
        "2 % are no drift", of_amplifier(**pulses_at(1.02 * amplifier(RISES))), code="no_clock",
        says=("at most 1 %",),
    ),
    "NWB, intervals in ms": Case(
        "each input has its own unit", of_amplifier(
            UNTIL_LOST, **PULSES, units__obs_intervals=1e3 * amplifier([[0.0, LOST_S]]),
            units__obs_intervals_index=[1],
        ), ("observed=obs_intervals:ms",), rates=ALL[:3], lost=2,
    ),
    "NWB, intervals in ms, said nowhere": Case(
        "no unit is observed for a day", of_amplifier(
            UNTIL_LOST, **PULSES, units__obs_intervals=1e3 * amplifier([[0.0, 400.0]]),
            units__obs_intervals_index=[1],
        ), code="beyond_a_finger", says=("observed=obs_intervals:ms",),
    ),
    "CSV in ms": Case(
        "one column, one unit",
        spikes_csv(*syncs(1e3 * amplifier(RISES)), spikes=(1e3 * amplifier(TIMES)).tolist(), header="t,kind"),
        ("time=t:ms",), rates=ALL,
    ),
    "CSV in ms, said nowhere": Case(
        "a clock does not run a thousand times as fast",
        spikes_csv(*syncs(1e3 * amplifier(RISES)), spikes=(1e3 * amplifier(TIMES)).tolist()), code="no_clock",
        says=("time=COLUMN:ms",),
    ),
    "NIX, a unit for pulses": Case(
        "the file has units of its own", nix(line_v=True), ("sync=ttl:ms",), code="no_unit_here", says=("ttl:ms",),
    ),
}  # fmt: skip


def units(ids: Sequence[int], choice: str = "", **more: Any) -> Callable[[Path], str]:
    """Several units; the first has the spikes, the others one spike each."""
    others = [[t + 0.001] for t in RISES[: len(ids) - 1]]
    times = [TIMES, *others]
    strings = {key: np.array(value, dtype=h5py.string_dtype()) for key, value in more.items()}
    write = nwb(
        units__id=list(ids), units__spike_times=np.concatenate([amplifier(one) for one in times]),
        units__spike_times_index=np.cumsum([len(one) for one in times]),
        units__obs_intervals=np.tile([[0.0, 500.0]], (len(ids), 1)),
        units__obs_intervals_index=np.arange(1, len(ids) + 1), **PULSES, **strings,
    )  # fmt: skip
    return lambda folder: write(folder) + choice


RATES_CSV = "position_mm,rate\n" + "".join(f"{x},{y:g}\n" for x, y in zip((-0.5, 0, 0.25, 1), ALL, strict=True))
RATES_ROWS = [["position_mm", "rate"], *([x, y] for x, y in zip((-0.5, 0, 0.25, 1), ALL, strict=True))]
_XML = '<?xml version="1.0"?>'
_MAIN = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
_RELATIONS = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"


def xlsx(
    sheets: dict[str, list[list[Any]]],
    choice: str = "",
    *,
    dates: bool = False,
    inline: bool = False,
    hidden: str = "",
) -> Any:
    """A workbook as Excel writes it: texts are shared, numbers are plain; `dates`: numbers have a date's format."""

    def write(folder: Path) -> str:
        path, shared = folder / "synthetic.xlsx", list[str]()

        def cell(value: Any, at: str) -> str:
            if value is None:
                return ""
            if not isinstance(value, str):
                return f'<c r="{at}" s="{int(dates)}"><v>{value}</v></c>'
            if inline:
                return f'<c r="{at}" t="inlineStr"><is><t>{value}</t></is></c>'
            shared.append(value)
            return f'<c r="{at}" t="s"><v>{len(shared) - 1}</v></c>'

        made = {}
        for number, rows in enumerate(sheets.values(), 1):
            cells = ("".join(cell(value, f"{chr(65 + k)}{n}") for k, value in enumerate(row))
                     for n, row in enumerate(rows, 1))  # fmt: skip
            each = (f'<row r="{n}">{one}</row>' for n, one in enumerate(cells, 1))
            made[f"xl/worksheets/sheet{number}.xml"] = (
                f"{_XML}<worksheet {_MAIN}><sheetData>{''.join(each)}</sheetData></worksheet>"
            )
        names = "".join(
            f'<sheet name="{name}" sheetId="{n}" r:id="rId{n}"' + ' state="hidden"' * (name == hidden) + "/>"
            for n, name in enumerate(sheets, 1)
        )
        book = f'<workbook {_MAIN} xmlns:r="{_RELATIONS}"><sheets>{names}</sheets></workbook>'
        made["xl/workbook.xml"] = f"{_XML}{book}"
        targets = "".join(
            f'<Relationship Id="rId{n}" Target="worksheets/sheet{n}.xml" Type="x"/>'
            for n in range(1, len(sheets) + 1)
        )
        made["xl/_rels/workbook.xml.rels"] = (
            f'{_XML}<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">{targets}'
            "</Relationships>"
        )
        texts = "".join(f"<si><t>{text}</t></si>" for text in shared)
        made["xl/sharedStrings.xml"] = f"{_XML}<sst {_MAIN}>{texts}</sst>"
        made["xl/styles.xml"] = (
            f'{_XML}<styleSheet {_MAIN}><cellXfs><xf numFmtId="0"/><xf numFmtId="14"/></cellXfs></styleSheet>'
        )
        with zipfile.ZipFile(path, "w") as file:
            for name, content in made.items():
                file.writestr(name, content)
        return f"{path}{choice}"

    return write


E_ACUTE = ["\u00e9", "e\u0301"]
NAMED = {"units__unit_name": ["A0", "A1", "B0", "B1"], "units__probe": ["A", "A", "B", "B"]}


def spikes_with(columns: str, *values: str, unit: str = "") -> Callable[[Path], str]:
    """A table of spikes with further columns, whose cells take these values in turn."""
    rows = [f"{t},{values[n % len(values)]}" for n, t in enumerate(TIMES)]
    return lambda folder: text("\n".join([f"time_s,{columns}", *rows]) + "\n")(folder) + f"#{unit}" * bool(unit)


IDENTITIES = {
    **{
        f"a table with a column {name}": Case(
            "unit 1 of one channel is not unit 1 of another", spikes_with(f"unit,{name}", "1,3", "1,5", unit="1"),
            ("time=time_s,unit=unit",), code="several_channels",
            says=(name, "(3, 5)", "3-1", "--columns unit=COLUMN"),
        )
        for name in ("Channel", "chan", "electrode", "Tetrode_ID", "shank 2", "probe", "ch1")
    },
    "a table with channels, and no unit": Case(
        "each has a unit", spikes_with("electrode", "3", "5"), ("time=time_s",), code="several_channels",
        says=("(3, 5)",),
    ),
    "a table with one channel": Case(
        "one unit", spikes_with("unit,channel", "1,3", unit="1"), ("time=time_s,unit=unit",), rates=ALL, pulses=False,
        read_as="Not read: channel.",
    ),
    "a table with channels of other units": Case(
        "one unit", lambda folder: text(
            "time_s,unit,channel\n" + "".join(f"{t},1,3\n{t},2,4\n" for t in TIMES))(folder) + "#1",
        ("time=time_s,unit=unit",), rates=ALL, pulses=False,
    ),
    "a table with amplitudes": Case(
        "no label", spikes_with("amplitude", "3", "5"), ("time=time_s",), rates=ALL, pulses=False,
    ),
    "an id that occurs once": Case("one unit", units([0, 1], "#0"), rates=ALL),
    "an id that occurs twice": Case(
        "two probes whose ids start at 0", units([0, 1, 0, 1], "#0", **NAMED), code="unit_twice",
        says=("unit_name A0", "unit_name B0", "#unit_name=A0"),
    ),
    "an id that occurs twice, without names": Case(
        "chosen by row", units([0, 1, 0, 1], "#0"), code="unit_twice", says=("#row=1", "#row=3"),
    ),
    "a name": Case("chosen by name", units([0, 1, 0, 1], "#A0", **NAMED), rates=ALL),
    "a column and a name": Case("chosen by name", units([0, 1, 0, 1], "#unit_name=A0", **NAMED), rates=ALL,
                                read_as="in s, unit 0, row 1 of 4."),
    "a row": Case("chosen by row", units([0, 1, 0, 1], "#row=1"), rates=ALL),
    "a text that two units share": Case(
        "probe A has two", units([0, 1, 0, 1], "#A", **NAMED), code="unit_twice", says=("A0", "A1"),
    ),
    "the id of one and the name of another": Case(
        "which of the two?", units([0, 1], "#1", units__unit_name=["1", "0"]), code="unit_twice",
        says=("0 (unit_name 1): #id=0", "1 (unit_name 0): #id=1"),
    ),
    "an id by its column": Case("chosen by id", units([0, 1], "#id=0", units__unit_name=["1", "0"]), rates=ALL),
    "no choice": Case(
        "the error lists the names", units([0, 1, 0, 1], **NAMED), code="several_units", says=("unit_name A0", "B1"),
    ),
    **{
        f"a name with an accent, written {how}": Case("é is é, one letter or two", units(
            [0, 1, 0, 1], f"#{choice}", units__unit_name=[stored, "A1", "B0", "B1"]), rates=ALL)
        for how, stored, choice in (("apart", *E_ACUTE[::-1]), ("as one", *E_ACUTE))
    },
    **{
        f"{kind}, columns with accents, {how} in --columns": Case(
            "é is é, one letter or two", write(stored),
            (f"position=Position {said}l{said}vation (mm),rate=D{said}charge:Hz",), rates=ALL,
        )
        for how, stored, said in (("apart", *E_ACUTE), ("as one", *E_ACUTE[::-1]))
        for kind, write in (
            ("CSV", lambda e: text(RATES_CSV.replace("position_mm,rate", f"Position {e}l{e}vation (mm),D{e}charge"))),
            ("xlsx", lambda e: xlsx({"A": [[f"Position {e}l{e}vation (mm)", f"D{e}charge"], *RATES_ROWS[1:]]})),
        )
    },
    **{
        f"NWB, a column with an accent, {how} in --columns": Case(
            "é is é, one letter or two", nwb(**{
                f"units__d{stored}charges": amplifier(TIMES), f"units__d{stored}charges_index": [len(TIMES)],
                "units__spike_times": [1.0], f"intervals__impulsions_{stored}__start_time": amplifier(RISES),
            }), (f"time=d{said}charges", f"sync=impulsions_{said}", "observed=throughout"), rates=ALL,
        )
        for how, stored, said in (("apart", *E_ACUTE), ("as one", *E_ACUTE[::-1]))
    },
    "CSV, one unit written in two ways": Case(
        "all its spikes are its spikes", lambda folder: text("unit,t_s\n" + "".join(
            f"{name},{t}\nb,{t + 0.1}\n" for name, t in zip(E_ACUTE * len(TIMES), TIMES, strict=False)
        ))(folder) + "#" + E_ACUTE[0], ("time=t_s",), rates=ALL, pulses=False,
    ),
    "no such unit": Case("the error lists the names", units([0, 1, 0, 1], "#C0", **NAMED), code="no_unit",
                         says=("unit_name A0",)),
    "a column of MATLAB": Case(
        "MatNWB writes (N, 1)",
        nwb(units__spike_times=amplifier(TIMES)[:, None], units__spike_times_index=[len(TIMES)], **PULSES),
        rates=ALL,
    ),
}  # fmt: skip


def mat(**variables: Any) -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        path = folder / "synthetic.mat"
        scipy.io.savemat(path, variables, do_compression=True)
        return str(path)

    return write


def content(data: bytes, name: str) -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        (folder / name).write_bytes(data)
        return str(folder / name)

    return write


def truncated(folder: Path) -> str:
    path = Path(of_amplifier(**PULSES)(folder))
    path.write_bytes(path.read_bytes()[:-500])
    return str(path)


def filtered(folder: Path) -> str:
    """Compressed by a filter that h5py does not have: the number of Zstandard, put where gzip's was."""
    path = folder / "synthetic.nwb"
    with h5py.File(path, "w") as file:
        file["units/id"] = [0]
        file["units/spike_times_index"] = [len(TIMES)]
        made = file.create_dataset("units/spike_times", (len(TIMES),), dtype="f8", chunks=True, compression="lzf")
        made.id.write_direct_chunk((0,), b"no compressed data", 0)
    path.write_bytes(path.read_bytes().replace((32000).to_bytes(2, "little"), (32015).to_bytes(2, "little")))
    return str(path)


def capitals(folder: Path) -> str:
    return str(Path(of_amplifier(**PULSES)(folder)).rename(folder / "SYNTHETIC.NWB"))


POSITIONS, THESE = np.array([-0.5, 0, 0.25, 1]), np.array(ALL)


def cells(values: Sequence[Any], *, row: bool = False) -> NDArray[Any]:
    """A cell array of MATLAB, as a column or a row."""
    made = np.empty((len(values), 1), dtype=object)
    made[:, 0] = values
    return made.T if row else made


SPIKES_IN_MAT = [(t, "spike", "1") for t in TIMES] + [(t + 0.1, "spike", "2") for t in TIMES]
MAT_TIMES = np.array([t for t, *_ in SPIKES_IN_MAT])
MAT_UNITS = [unit for *_, unit in SPIKES_IN_MAT]


def mat_spikes(choice: str = "", **more: Any) -> Callable[[Path], str]:
    """Spikes of two units, with the columns `more`."""
    return lambda folder: mat(time_s=MAT_TIMES, **more)(folder) + choice


def mat_object(folder: Path) -> str:
    """Positions, rates, and a variable `unit` of MATLAB's class string, which has no public format."""
    path = Path(mat(position_mm=POSITIONS, rate=THESE)(folder))

    def element(kind: int, data: bytes) -> bytes:
        return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)

    parts = element(6, struct.pack("<II", 17, 0)) + b"".join(element(1, one) for one in (b"note", b"MCOS", b"string"))
    workspace = element(6, struct.pack("<II", 9, 0)) + element(5, struct.pack("<ii", 1, 8)) + element(1, b"")
    workspace += element(2, bytes(8))
    path.write_bytes(path.read_bytes() + element(14, parts) + element(14, workspace))
    return str(path)


KINDS = {
    "UTF-16, tabs": Case("Excel's Unicode text", text(RATES_CSV.replace(",", "\t"), encoding="utf-16"), rates=ALL),
    "UTF-16, no mark": Case("it says what it is", content(RATES_CSV.encode("utf-16-le"), "a.csv"), code="no_csv",
                            says=("UTF-16", "CSV UTF-8")),
    "Latin-1": Case("it says what it is and how to save it", content("Höhe,rate\n0,1\n".encode("latin-1"), "a.csv"),
                    code="no_csv", says=("UTF-8", "Latin-1", "row 1")),
    "a title above the header": Case("it is no name of a column", text(f"Unit 3\n{RATES_CSV}"), code="no_column",
                                     says=("read Unit 3", "must begin with #")),
    "no header": Case("numbers are no names", text("-0.5,6\n0,24\n0.25,12\n"), code="no_header",
                      says=("row 1", "position_mm,rate")),
    "xlsx": Case("a table is a table", xlsx({"Sheet1": RATES_ROWS}), rates=ALL),
    "xlsx, texts in the cells": Case("a table is a table", xlsx({"Sheet1": RATES_ROWS}, inline=True), rates=ALL),
    "xlsx, units and an empty row": Case("as in a CSV", xlsx({"Sheet1": [
        [], ["Position (um)", "Rate (imp/s)", None], *([1000 * x, y] for x, y in RATES_ROWS[1:]), [None, None]
    ]}), rates=ALL),
    "xlsx, a line feed in a name": Case("Excel breaks long names", xlsx({"A": [
        ["Position\n(um)", "Rate"], *([1000 * x, y] for x, y in RATES_ROWS[1:])]}), rates=ALL),
    "xlsx, empty sheets": Case("only one has rows", xlsx({"A": [], "B": RATES_ROWS, "C": []}), rates=ALL),
    "xlsx, several sheets": Case("which of them?", xlsx({"A": RATES_ROWS, "B": RATES_ROWS}), code="several_sheets",
                                 says=("#A", "B")),
    "xlsx, a sheet": Case("chosen", xlsx({"A": RATES_ROWS[:3], "B": RATES_ROWS}, "#B"), rates=ALL),
    "xlsx, no such sheet": Case("listed", xlsx({"A": RATES_ROWS}, "#C"), code="no_sheet", says=("A",)),
    "xlsx, a cell that is no number": Case("named", xlsx({"A": [*RATES_ROWS[:2], [0, "x"]]}), code="no_number",
                                           says=("row 3", "rate", "'x'")),
    "xlsx, an empty cell": Case("named", xlsx({"A": [*RATES_ROWS[:2], [0.1], [0.2, 3]]}), code="no_number",
                                says=("row 3", "rate", "delete rows without data")),
    "xlsx, dates": Case("Excel made a date of 1.5", xlsx({"A": RATES_ROWS}, dates=True), code="no_number",
                        says=("a date",)),
    "xlsx, spikes of several units": Case(
        "a unit of a sheet", xlsx({"A": [["unit", "t (ms)"], *([u, 1e3 * t] for t in TIMES for u in "ab")]}, "#A#b"),
        rates=ALL, pulses=False,
    ),
    "xlsx, spikes of several units, none chosen": Case(
        "the error says how", xlsx({"A": [["unit", "t (ms)"], *([u, 1e3 * t] for t in TIMES for u in "ab")]}),
        code="several_units", says=("synthetic.xlsx#SHEET#UNIT", "a, b"), pulses=False,
    ),
    "xls": Case("it says what it is and how to save it",
                content(bytes.fromhex("d0cf11e0a1b11ae1") + 600 * b"\0", "a.xls"), code="no_csv",
                says=(".xls", "save")),
    "a zip that is no workbook": Case("it says what it is", content(b"PK\x03\x04" + 60 * b"\0", "a.xlsx"),
                                      code="no_csv", says=("ZIP",)),
    "mat": Case("vectors of one length are columns", mat(position_mm=POSITIONS, rate=THESE), rates=ALL),
    "mat, columns and a scalar": Case(
        "a scalar is the same in all rows",
        mat(x_um=1000 * POSITIONS[:, None], n=np.array([3, 12, 6, 1])[:, None], window_ms=250.0),
        ("position=x_um,count=n",), rates=IN_QUARTER,
    ),
    **{
        f"mat, a scalar {name}": Case("a rate or a position is measured for each row", mat(
            **{"position_mm": POSITIONS, "rate": THESE, "sd": 1.0} | {name: 6.0}), code="same_in_all_rows",
            says=(name, "6", "vector"))
        for name in ("position_mm", "rate")
    },
    "mat, a scalar count": Case("a count is of one press", mat(position_mm=POSITIONS, count=6.0, window_s=1.0),
                                code="same_in_all_rows"),
    "mat, a scalar sd": Case("one sd for all", mat(position_mm=POSITIONS, rate=THESE, sd=1.0, repeat=1.0), rates=ALL),
    "mat, spike times": Case("a vector of times", mat(spike_times=1e3 * np.array(TIMES)), ("time=spike_times:ms",),
                             rates=ALL, pulses=False),
    **{
        f"mat, units in {what}": Case("the spikes of one of two units", mat_spikes("#1", unit=unit), ("sync=none",),
                                      rates=ALL, pulses=False, read_as="unit")
        for what, unit in {
            "a cell array of texts": cells(MAT_UNITS), "a row of cells": cells(MAT_UNITS, row=True),
            "cells of numbers": cells([float(one) for one in MAT_UNITS]), "rows of letters": np.array(MAT_UNITS),
            "numbers": np.array(MAT_UNITS, dtype=float),
        }.items()
    },
    "mat, units in a cell array, none chosen": Case("two units are not one", mat_spikes(unit=cells(MAT_UNITS)), (
        "sync=none",), code="several_units", says=("2 units", "1, 2"), pulses=False),
    "mat, one unit as a text": Case("it is that of all rows", lambda folder: mat(time_s=TIMES, unit="a1")(folder)
                                    + "#a1", ("sync=none",), rates=ALL, pulses=False),
    **{
        f"mat, {name} in a row of letters": Case("one name, or one for each row?", mat_spikes(
            **{name: "ab" * len(TIMES)}), ("sync=none",), code="not_understood",
            says=(f"column {name}", "a row of 86 letters", "N × 1", "cell array"), pulses=False)
        for name in ("unit", "kind")
    },
    "mat, repeats in a row of letters": Case("one name, or one for each row?", mat(
        position_mm=[x for x, *_ in TWICE], rate=[y for _, y, _ in TWICE], rep="11112222"), code="not_understood",
        says=("column rep", "a row of 8 letters", "N × 1")),
    **{
        f"mat, one repeat {said!r} for eight presses": Case("the column is there", mat(
            position_mm=[x for x, *_ in TWICE], rate=[y for _, y, _ in TWICE], rep=one), code="place_twice",
            says=("row 6", "first in row 2", "the column rep is there", f"one value for all rows, {said!r}"))
        for one, said in (("abc", "abc"), (1.0, "1"))
    },
    **{
        f"mat, units in {what}": Case("there, and not understood", mat_spikes(unit=unit), ("sync=none",),
                                      code="not_understood", says=("column unit", what, "one for each row"),
                                      pulses=False)
        for what, unit in {
            "a struct": {"a": 1.0}, "a sparse matrix": scipy.sparse.csc_matrix(MAT_TIMES[:, None]),
            "a complex vector": MAT_TIMES + 1j, "a logical vector": MAT_TIMES > 1, "an array of 86 × 2":
            np.ones((86, 2)), "a cell array of cells": cells([cells([1.0])] * 86),
        }.items()
    },
    "mat, kinds in cells": Case(
        "rows of kind start and stop limit the time, as in a CSV",
        mat(time_s=[0.0, *TIMES, LOST_S], kind=cells(["start", *["spike"] * len(TIMES), "stop"])),
        rates=ALL[:3], lost=2, pulses=False,
    ),
    "mat, pulses in cells": Case(
        "rows of kind sync are pulses", mat(time_s=np.concatenate([amplifier(TIMES), amplifier(RISES)]),
                                            kind=cells(["spike"] * len(TIMES) + ["sync"] * len(RISES))), rates=ALL,
    ),
    "mat, rates in cells": Case("a number in each", mat(position_mm=POSITIONS, rate=cells(ALL)), rates=ALL),
    "mat, a rate is an empty cell": Case("no data is not zero", mat(
        position_mm=POSITIONS, rate=cells([*ALL[:3], np.empty((0, 0))])), code="no_number",
        says=("row 5", "delete rows without data")),
    "mat, repeats and sd in cells": Case("which of the two?", mat(
        position_mm=[x for x, *_ in TWICE], rate=[y for _, y, _ in TWICE], sd=cells([9.0] * 8),
        repeat=cells([str(n) for *_, n in TWICE])), code="sd_and_repeats", says=("column sd",)),
    "mat, rates in a sparse matrix": Case("there, and not understood", mat(
        position_mm=POSITIONS, rate=scipy.sparse.csc_matrix(THESE)), code="not_understood",
        says=("column rate", "sparse", "full")),
    "mat, rejected presses in letters": Case("which of the presses?", mat(
        position_mm=POSITIONS, rate=THESE, rejected=np.array(["no", "no", "no", "yes"])), code="extra_column",
        says=("'rejected'",)),
    "mat, a struct beside, ignored": Case("said", mat(position_mm=POSITIONS, rate=THESE, info={"a": 1.0}), (
        "position=position_mm",), rates=ALL, read_as="Not read: info."),
    "mat, an object beside, ignored": Case("said", mat_object, ("position=position_mm",), rates=ALL,
                                           read_as="Not read: note."),
    "mat, an object beside": Case("said", mat_object, code="extra_column", says=("'note'",)),
    "mat, one column": Case("MATLAB has no lines", mat(position_mm=POSITIONS), code="no_column",
                            says=("rate is missing", "read position_mm;")),
    "mat, other lengths": Case("listed", mat(position_mm=POSITIONS, rate=THESE[:3]), code="no_mat_table",
                               says=("position_mm (4)", "rate (3)")),
    "mat, a struct": Case("listed", mat(s={"position_mm": POSITIONS, "rate": THESE}), code="no_mat_table",
                          says=("s (struct)", "-struct")),
    "mat 7.3": Case("it says what it is and how to save it", content(b"MATLAB 7.3 MAT-file" + 600 * b" ", "a.mat"),
                    code="no_csv", says=("7.3", "-v7")),
    "NWB called CSV": Case("it says what it is", lambda folder: str(
        Path(nwb()(folder)).rename(folder / "a.csv")), code="no_csv", says=("HDF5", ".nwb")),
    "CSV called NWB": Case("it says what it is", content(RATES_CSV.encode(), "a.nwb"), code="no_hdf5",
                           says=("text",)),
    "an empty NWB": Case("it says what it is", content(b"", "a.nwb"), code="no_hdf5", says=("empty",)),
    "a pointer of Git LFS": Case("it says what it is", content(
        b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", "a.nwb"), code="no_hdf5",
        says=("Git LFS",)),
    "NWB, truncated": Case("it is an NWB file, cut short", truncated, code="truncated_hdf5",
                           says=("truncated", "copy")),
    "NWB, an unknown filter": Case("it is an NWB file, compressed", filtered, code="unknown_filter",
                                   says=("units/spike_times", "32015", "h5repack")),
    ".NWB": Case("a capital is a letter", capitals, rates=ALL),
    "a unit of a table of rates": Case("nothing to choose from", lambda folder: text(RATES_CSV)(folder) + "#3",
                                       code="no_unit_here", says=("#3",)),
}  # fmt: skip

LEVELS = {
    f"{kind}, {'inverted' if inverted else 'high during pulses'}, {width_s:g} s": Case(
        "a pulse begins where the line leaves the level at which it rests; 0.4 s later, nearly all spikes are missed",
        nix(line_v=True, width_s=width_s, inverted=inverted) if kind == "NIX"
        else of_amplifier(**sampled("acquisition__ttl", width_s, inverted=inverted)),
        ("sync=ttl",), rates=ALL, width_s=width_s, read_as="rest: a pulse begins where it falls" * inverted,
    )
    for kind in ("NWB", "NIX") for inverted in (False, True) for width_s in (0.01, 0.4)
}  # fmt: skip


def states(rest: int, width_s: float) -> dict[str, Any]:
    """Events at both edges, with the level after each."""
    rises = amplifier(RISES)
    return {
        "acquisition__ttl__timestamps": np.sort(np.concatenate([rises, rises + width_s])),
        "acquisition__ttl__data": np.tile([1 - rest, rest], len(rises)),
    }


def edges_csv(width_s: float, *, lost: int = 0) -> Any:
    """All edges in one list, without the first ones."""
    rises = amplifier(RISES)
    every = np.sort(np.concatenate([rises, rises + width_s]))[lost:]
    return spikes_csv(*syncs(every), spikes=amplifier(TIMES).tolist())


LEVELS |= {
    "NWB, states of a line at rest at 0": Case("the rises", of_amplifier(**states(0, 0.4)), ("sync=ttl",), rates=ALL,
                                               width_s=0.4),
    "NWB, states of a line at rest at 1": Case("the falls", of_amplifier(**states(1, 0.4)), ("sync=ttl",), rates=ALL,
                                               width_s=0.4, read_as="a pulse begins where it falls"),
    "NWB, intervals between the pulses": Case(
        "as long as no pulse, and the gaps between them are", of_amplifier(
            intervals__ttl__start_time=np.concatenate([[0.1], amplifier(RISES) + 0.4]),
            intervals__ttl__stop_time=np.append(amplifier(RISES), 105.0)),
        ("sync=ttl",), rates=ALL, width_s=0.4,
    ),
    "NWB, trials as pulses": Case(
        "an interval that is longer than a pulse is no inverted line", of_amplifier(
            intervals__ttl__start_time=amplifier(RISES), intervals__ttl__stop_time=amplifier(RISES) + 6.0),
        ("sync=ttl",), rates=ALL,
    ),
    **{
        f"CSV, both edges, {width_s:g} s wide for {planned:g} s, {lost} lost": Case(
            "the first of two edges is the pulse, also if the recording began within the first",
            edges_csv(width_s, lost=lost), ("observed=throughout",), rates=ALL, width_s=planned,
            read_as="Both edges",
        )
        for width_s, planned in ((0.01, 0.01), (0.4, 0.4), (0.4, 0.01)) for lost in (0, 1)
    },
}  # fmt: skip


def later(least_s: float, most_s: float, seed: int = 0) -> Array:
    """Times after the spikes, at delays that vary."""
    return np.asarray(np.add(TIMES, np.random.default_rng(seed).uniform(least_s, most_s, len(TIMES))))


EARLY = [-1.0, *TIMES[1:]]
"""The first spike has a negative time, as some programs write one without a value."""
ORDER = [*TIMES[20:], *TIMES[:20]]
ORDERS = {
    f"{name}, {what}": Case(why, write(times), ("sync=none", "observed=throughout") if name == "NWB" else columns,
                            rates=rates, read_as=says, pulses=False)
    for name, write, columns in (
        ("NWB", lambda times: nwb(units__spike_times=times), ()),
        ("CSV", lambda times: spikes_csv(spikes=times), ("observed=throughout",)),
        ("NIX", lambda times: nix(start=-5.0, spikes=times), ("sync=none",)),
        ("MATLAB", lambda times: mat(time_s=times), ("observed=throughout",)),
    )
    for what, why, times, rates, says in (
        ("a negative time", "said", EARLY, [5.0, *ALL[1:]],
         "1 of 43 spikes lies before or after the run, or at a negative time of the file (-1 s)"),
        ("times that fall", "sorted, and said", ORDER, ALL, "not in ascending order"),
    )
} | {
    "NWB, spikes before and after the run": Case(
        "said also with pulses", of_amplifier([-3.0, *TIMES, 500.0], **PULSES), rates=ALL,
        read_as="2 of 45 spikes lie before or after the run",
    ),
}  # fmt: skip

WRITTEN_TWICE = {
    "NWB": of_amplifier(np.sort([*TIMES, *TIMES]), **PULSES),
    "CSV": spikes_csv(*syncs(amplifier(RISES)), spikes=amplifier([*TIMES, *TIMES]).tolist()),
    "NIX": nix(spikes=sorted([*TIMES, *TIMES]), line_v=True),
    "CSV, 0.2 ms apart": spikes_csv(*syncs(amplifier(RISES)), spikes=amplifier([*TIMES, *np.add(TIMES, 2e-4)])),
    "CSV, rounded to 0.1 s": spikes_csv(*syncs(amplifier(RISES)), spikes=np.round(amplifier(TIMES), 1)),
}
DOUBLES = {
    f"{name}, spikes twice": Case("no neuron fires twice within 0.5 ms", write, ("sync=ttl",) * (name == "NIX"),
                                  code="spikes_twice", says=(
                                      "0.5 ms", "delete the copies", "more decimals", "anew in each trial"))
    for name, write in WRITTEN_TWICE.items()
} | {
    f"each spike again {ms:g} ms later": Case(
        "a detector triggered on both of its phases",
        of_amplifier(np.sort([*TIMES, *np.add(TIMES, 1e-3 * ms)]), **PULSES),
        code="spikes_twice",
        says=(f"{ms:.2f} ms", "both phases"),
    )
    for ms in (0.7, 1.2)
} | {
    "pulses in a list": Case(
        "a list does not tell rises from falls, so it is said", of_amplifier(TIMES, **PULSES), rates=ALL,
        read_as="taken as the beginnings of those of the run",
    ),
    "each spike again 1 to 1.2 ms later": Case(
        "the noise moves the second crossing of the threshold",
        of_amplifier(np.sort([*TIMES, *later(0.0010, 0.0012)]), **PULSES),
        code="spikes_twice", says=("43 of 86 spikes", "1.1", "both phases"),
    ),
    "each spike again 0.6 to 1.9 ms later": Case(
        "a detector or a neuron that fires in pairs: said",
        of_amplifier(np.sort([*TIMES, *later(0.0006, 0.0019)]), **PULSES),
        rates=[2 * rate for rate in ALL], read_as="43 of 85 intervals between spikes (51 %) are shorter than 2 ms",
    ),
    "bursts of three": Case(
        "a neuron fires so", of_amplifier(np.sort([*TIMES, *later(0.0012, 0.0018), *later(0.0025, 0.0035, 1)]),
                                          **PULSES), rates=[3 * rate for rate in ALL],
        read_as="echoes of a threshold, of a detector that triggers several times on a spike, or bursts",
    ),
    "two echoes after each spike": Case(
        "no pairs, and said", of_amplifier(np.sort([*TIMES, *later(0.0007, 0.0013), *later(0.0019, 0.0024, 1)]),
                                           **PULSES), rates=[3 * rate for rate in ALL],
        read_as="of 128 intervals between spikes (67 %) are shorter than 2 ms",
    ),
    "40 % of the spikes again 0.6 to 1.9 ms later": Case(
        "said", of_amplifier(np.sort([*TIMES, *later(0.0006, 0.0019)[:17]]), **PULSES),
        rates=[12.0, 35.0, *ALL[2:]], read_as="17 of 59 intervals between spikes (29 %) are shorter than 2 ms",
    ),
    "one short interval of 43": Case(
        "few", of_amplifier(np.sort([*TIMES, TIMES[-1] + 0.0012]), **PULSES), rates=[*ALL[:3], 2.0],
        silent="shorter than 2 ms",
    ),
    "one spike twice": Case(
        "one in 43 is a fault of a sorter, and is said", of_amplifier([*TIMES, TIMES[0]], **PULSES),
        rates=[7.0, *ALL[1:]], read_as="1 spike comes less than 0.5 ms after another",
    ),
    "equal repeats": Case(
        "copies say nothing of the noise", table("position_mm,rate,repeat", *(
            f"{x},{y},{n}" for x, y in zip((-0.5, 0, 0.25, 1), ALL, strict=True) for n in (1, 2))), rates=ALL,
        read_as="each position counts once",
    ),
}  # fmt: skip

OTHER_UNITS = {
    "position": ("position_steps", "pos_thou", "x mils", "angle deg", "x_px", "position_deg", "index", "x"),
    "window": ("window_frames", "window_samples", "bins", "window"),
    "rate": ("rate_spm", "rate_per_trial", "rate_zscore", "spikes per trial", "norm rate", "dF/F", "response", "z"),
    "time": ("t", "time_ticks", "frames"),
}


def named(role: str, column: str) -> Callable[[Path], str]:
    if role == "time":
        return text(f"{column}\n" + "".join(f"{t}\n" for t in TIMES))
    if role == "window":
        return table(f"position_mm,count,{column}", *(one.replace("|250", "|60") for one in COUNTS_250MS))
    header = {"position": f"{column},rate", "rate": f"position_mm,{column}"}[role]
    return table(header, *(f"{x},{y}" for x, y in zip((-0.5, 0, 0.25, 1), ALL, strict=True)))


UNKNOWN_UNITS = {
    f"{role}={column}": Case(
        "a unit that is not known is not mm, s or 1/s", named(role, column), (f"{role}={column}",), code="no_unit",
        says=(repr(column), f"{role}={column}:"), pulses=False,
    )
    for role, columns in OTHER_UNITS.items() for column in columns
} | {
    "position=pos_thou:um": Case("stated", table("pos_thou,rate", "-500,6", "0,24", "250,12", "1000,1"),
                                 ("position=pos_thou:um",), rates=ALL, read_as="pos_thou as position in um"),
    "rate_mean": Case("a mean is no unit", named("rate", "rate_mean"), ("rate=rate_mean",), rates=ALL,
                      read_as="rate_mean as rate in 1/s"),
    "mean FR": Case("also of another name", named("rate", "mean FR"), ("rate=mean FR",), rates=ALL,
                    read_as="mean FR as rate in 1/s"),
    "rate=response:1/s": Case("stated", named("rate", "response"), ("rate=response:1/s",), rates=ALL,
                              read_as="response as rate in 1/s"),
    "unit in brackets": Case(
        "the remedy has no unit that would be wrong", table("position (mil),rate", "1,6", "2,24", "3,12"),
        code="unknown_unit", says=("convert the numbers", "position=position (mil):UNIT"),
    ),
    "a comma in a name": Case(
        "it is a part of the name", table('"x, left",rate', "-500,6", "0,24", "250,12", "1000,1"),
        ("position=x, left:um,rate=rate",), rates=ALL,
    ),
    "a colon in a name": Case(
        "a unit follows after another colon", text("Time (h:mm:ss)\n" + "".join(f"{t}\n" for t in TIMES)),
        ("time=Time (h:mm:ss)",), code="unknown_unit", says=("after another",), pulses=False,
    ),
    "a colon in a name, with a unit": Case(
        "it is a part of the name", text("Time (h:mm:ss)\n" + "".join(f"{t}\n" for t in TIMES)),
        ("time=Time (h:mm:ss):s",), rates=ALL, pulses=False,
    ),
    "conditions": Case(
        "two forces are no repeats", table("position_mm,rate,repeat,force_gwt", "0,6,1,1", "0,24,2,2", "1,3,1,1"),
        code="extra_column", says=("'force_gwt'", "file of their own", "count as repeats"),
    ),
    "conditions, ignored": Case(
        "it is said what differs", table("position_mm,rate,repeat,force_gwt", *(
            f"{x},{y + d},{d},{d + 2}" for x, y in zip((-0.5, 0, 0.25, 1), ALL, strict=True) for d in (-1, 1))),
        ("position=position_mm,repeat=repeat",), rates=ALL,
        read_as="force_gwt differs between presses at one position",
    ),
}  # fmt: skip

NO_PULSES_THERE = {
    name: Case("the run made pulses, and the clock is unknown without", write, code="no_pulses_in_file",
               says=("8", "sync=none"))
    for name, write in {"NWB": nwb(), "NIX": nix(), "CSV": spikes_csv()}.items()
} | {
    f"{name}, stated": Case("the user says that times are the run's", write, ("sync=none", "observed=throughout"),
                            rates=ALL, read_as="as sync=none states")
    for name, write in {"NWB": nwb(), "CSV": spikes_csv()}.items()
} | {
    "NWB, epochs": Case("as trials: on the amplifier's clock", of_amplifier(
        intervals__epochs__start_time=amplifier(STARTS)), code="unknown_pulses", says=("epochs (8 intervals)",)),
    "CSV, a channel of pulses": Case("a table has rows of kind sync", spikes_csv(), ("sync=ttl",), code="no_pulses",
                                     says=("kind=COLUMN",)),
}  # fmt: skip


COMPUTE = '<calcPr calcId="124519" fullCalcOnLoad="1"/>'


def styled(
    style: str = "", row: str = "", after: str = "", before: str = "", value: str = "<v>{y}</v>", kind: str = "",
    ink: str = "", fill: str = "", number: int = 200, header: str = "rate", pattern: str = "",
    dxf: str = "", calculation: str = "",
) -> Any:  # fmt: skip
    """A workbook whose rates have a style, whose third row has an attribute, with more after its cells."""
    write = xlsx({"A": [["position_mm", header], *RATES_ROWS[1:]]}, inline=True)

    def change(folder: Path) -> str:
        path = Path(write(folder))
        with zipfile.ZipFile(path) as file:
            parts = {name: file.read(name).decode() for name in file.namelist()}
        sheet = parts["xl/worksheets/sheet1.xml"]
        for n, (_, y) in enumerate(RATES_ROWS[1:], 2):
            cell = f'<c r="B{n}" s="1"{kind}>{value.format(y=y)}</c>'
            sheet = sheet.replace(f'<c r="B{n}" s="0"><v>{y}</v></c>', cell)
        sheet = sheet.replace('<row r="3">', f'<row r="3" {row}>').replace("</sheetData>", f"</sheetData>{after}")
        sheet = sheet.replace("<sheetData>", f"{before}<sheetData>")
        parts["xl/worksheets/sheet1.xml"] = sheet
        parts["xl/workbook.xml"] = parts["xl/workbook.xml"].replace("</workbook>", f"{calculation}</workbook>")
        xfs = '<cellXfs><xf numFmtId="0" fontId="0"/><xf numFmtId="FORMAT" fontId="1" fillId="1"/></cellXfs>'.replace(
            "FORMAT", str(number)
        )
        code = "0.0" if style in ("", "struck") else style
        formats = f'<numFmts><numFmt numFmtId="200" formatCode="{code}"/></numFmts>'
        fonts = (
            "<fonts><font/><font>" + "<strike/>" * (style == "struck") + f"{ink and f'<color {ink}/>'}</font></fonts>"
        )
        solid = fill and f'<patternFill patternType="solid"><fgColor {fill}/></patternFill>'
        fills = f"<fills><fill/><fill>{solid or pattern}</fill></fills>"
        parts["xl/styles.xml"] = (
            f"{_XML}<styleSheet {_MAIN}>{formats}{fonts}{fills}{xfs}<dxfs>{dxf}</dxfs></styleSheet>"
        )
        with zipfile.ZipFile(path, "w") as file:
            for name, content in parts.items():
                file.writestr(name, content)
        return str(path)

    return change


def conditional(dxf: str, cells: str = "B3 B5:B9", rule: str = "", **cell: str) -> Any:
    """A workbook with a conditional format, whose rule is here that the value is above 10."""
    rule = (
        rule or '<cfRule type="cellIs" dxfId="0" priority="1" operator="greaterThan"><formula>10</formula></cfRule>'
    )
    after = f'<conditionalFormatting sqref="{cells}">{rule}</conditionalFormatting>'
    return styled(after=after, dxf=f"<dxf>{dxf}</dxf>", **cell)


X14 = 'xmlns:x14="http://schemas.microsoft.com/office/spreadsheetml/2009/9/main"'
XM = 'xmlns:xm="http://schemas.microsoft.com/office/excel/2006/main"'
RED_ON_PINK = '<font><color rgb="FF9C0006"/></font><fill><patternFill><bgColor rgb="FFFFC7CE"/></patternFill></fill>'
WHITE_TEXT = '<font><color rgb="FFFFFFFF"/></font>'


def commented(target: str, comment: str) -> Callable[[Path], str]:
    """A workbook with a comment on the second rate."""

    def write(folder: Path) -> str:
        path = styled()(folder)
        place = "xl/comments1.xml" if target.startswith("..") else target.lstrip("/")
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr(
                "xl/worksheets/_rels/sheet1.xml.rels",
                f'{_XML}<Relationships><Relationship Id="c" Type="{_RELATIONS}/comments" Target="{target}"/>'
                "</Relationships>",
            )
            archive.writestr(
                place,
                f'{_XML}<comments {_MAIN}><commentList><comment ref="B3" authorId="0"><text><r><t>{comment}</t></r>'
                "</text></comment></commentList></comments>",
            )
        return path

    return write


SHOWN = {
    "plain": Case("numbers", styled(), rates=ALL),
    "thousands separators": Case("the same numbers", styled("#,##0.0"), rates=ALL),
    "percent": Case("0.8 is shown as 80 %", styled("0%"), code="no_number", says=("a percentage",)),
    "scaled": Case("2000 is shown as 2", styled("0.0,"), code="no_number", says=("in thousands",)),
    "a unit in the format": Case("shown in another unit than the header's", styled("0.0&quot; 1/min&quot;"),
                                 code="no_number", says=("1/min", "header")),
    **{
        f"a unit in the format {code}": Case(
            "shown in another unit than the header's", styled(code), code="no_number", says=(unit, "header")
        )
        for code, unit in (("0.0[$/min]", "/min"), ("0.0[$ µm]", "µm"), ("0.0\\ \\k", "k"), ("0[$%-409]", "%"))
    },
    "the header's unit in the format": Case("the same numbers", styled("0.0&quot; Hz&quot;"), rates=ALL),
    "a language in the format": Case("the same numbers", styled("[$-409]0.0"), rates=ALL),
    **{
        f"a digit {said}": Case("a reader sees another number", styled(
            value=f"<is><r><t>{{y}}</t></r><r><rPr>{style}</rPr><t>1</t></r></is>", kind=' t="inlineStr"'),
            code="no_number", says=("row 2", "'6.01", said))
        for said, style in (("superscript", '<vertAlign val="superscript"/>'), ("struck out", "<strike/>"),
                            ("subscript", '<vertAlign val="subscript"/>'))
    },
    "a digit in bold": Case("the same number", styled(
        value='<is><r><t>{y}</t></r><r><rPr><b/><strike val="0"/><vertAlign val="baseline"/></rPr><t>0</t></r></is>',
        kind=' t="inlineStr"'), rates=ALL),
    **{
        f"a row with {hidden}": Case("a reader does not see it", styled(row=hidden), code="unclear_rows",
                                     says=("hidden", "(3)", "visible rows"))
        for hidden in ('hidden="1"', 'ht="0"', 'ht="0.0" customHeight="1"')
    },
    **{
        f"a column with {hidden}": Case(
            "a reader does not see it", styled(before=f'<cols><col min="2" max="3" {hidden}/></cols>'),
            code="unclear_rows", says=("hidden", "(2)", "visible columns"),
        )
        for hidden in ('hidden="1"', 'width="0"')
    },
    "a narrow column": Case("a reader sees it", styled(before='<cols><col min="2" max="3" width="4.5"/></cols>'),
                            rates=ALL),
    "a hidden column, empty": Case("nothing to see", styled(before='<cols><col min="3" max="9" hidden="1"/></cols>'),
                                   rates=ALL),
    "a hidden sheet": Case("a reader does not see it", xlsx({"A": [], "old": RATES_ROWS}, hidden="old"),
                           code="hidden_sheet", says=("with rows, old, is hidden", "synthetic.xlsx#old")),
    "a hidden sheet, named": Case("chosen", xlsx({"A": [], "old": RATES_ROWS}, "#old", hidden="old"), rates=ALL),
    "struck out": Case("a reader takes it for deleted", styled("struck"), code="unclear_rows", says=("struck out",)),
    **{
        f"text {ink} on {fill or 'no fill'}": Case("a reader sees nothing", styled(ink=ink, fill=fill),
                                                   code="unclear_rows", says=("do not show", "(2, 3, 4, 5)"))
        for ink, fill in (
            ('rgb="FFFFFFFF"', ""), ('rgb="FFFAFAFA"', ""), ('theme="0"', ""), ('indexed="9"', ""),
            ('indexed="65"', ""),
            ('rgb="FFFF0000"', 'rgb="FFFF0000"'), ('theme="0"', 'theme="0" tint="-0.05"'), ("", 'indexed="64"'),
            ("", 'rgb="FF000000"'),
        )
    },
    **{
        f"text {ink} on {pattern}": Case("openpyxl writes no fill so", styled(ink=ink, pattern=pattern),
                                         code="unclear_rows", says=("do not show", "(2, 3, 4, 5)"))
        for ink in ('rgb="FFFFFFFF"', 'theme="0"', 'indexed="9"') for pattern in (
            "<patternFill/>", '<patternFill><fgColor rgb="FF4472C4"/></patternFill>',
            '<patternFill patternType="none"/>')
    },
    "white text on a gradient": Case("a reader sees it", styled(
        ink='rgb="FFFFFFFF"', pattern='<gradientFill><stop position="0"><color theme="4"/></stop></gradientFill>'),
        rates=ALL),
    **{
        f"text {ink} on {fill}": Case("a reader sees it", styled(ink=ink, fill=fill), rates=ALL)
        for ink, fill in (
            ('rgb="FFFFFFFF"', 'rgb="FF4472C4"'), ('theme="0"', 'theme="4"'), ('theme="1"', 'theme="0"'),
            ('auto="1"', 'indexed="65"'), ('theme="0" tint="-0.5"', 'theme="0"'),
        )
    },
    **{
        f"shown by {code}": Case("a reader sees nothing", styled(code), code="unclear_rows",
                                 says=("do not show", "(2, 3, 4, 5)"))
        for code in (";;;", ";;", ";-0.0", "\\-;-0.0", "&quot;+&quot;")
    },
    **{
        f"shown by {code}": Case("a reader sees it", styled(code), rates=ALL)
        for code in (
            "0.0;", "0.0;;", "0.0;-0.0;;@", "0.0;[Red]-0.0",
            "_-* #,##0.0_-;\\-* #,##0.0_-;_-* &quot;-&quot;??_-;_-@_-",
            "#,##0.0_);(#,##0.0)", "0.0;[Red]0.0", "0.00E-00", "0.0&quot; s-1&quot;", "+0.0;-0.0;0.0",
        )
    },
    **{
        f"negative rates shown by {code}": Case("a reader sees other numbers", styled(code, value="<v>-1</v>"),
                                                code="no_number", says=("'-1 (shown without its sign in Excel)'",))
        for code in ("0.0;0.0", "0.0;0.0;0", "0.0_-;0.0_-", "0.0;&quot;+&quot;0.0")
    },
    **{
        f"rates shown by {code}": Case("a reader sees other numbers", styled(code), code="no_number", says=(what,))
        for code, what in (
            ("-0.0", "with another sign in Excel"), ("(0.0);-0.0", "with another sign in Excel"),
            ("0.0-", "with another sign in Excel"), ("\\-0.0", "with another sign in Excel"),
            ("&quot;1&quot;0.0", "shown as 1 in Excel"), ("[&lt;10]0.0;0", "by conditions"),
            ("#,##0.00 [$€-407]", "€"), ("&quot;£&quot;0.0", "£"), ("$0.0", "$"), ("0.0\\ ¥", "¥"),
        )
    },
    "rates shown as a currency": Case("a format that Excel has built in", styled(number=44), code="no_number",
                                      says=("a currency",)),
    "percent, with the header's unit": Case(
        "40 % are stored as 0.4", styled("0%", header="rate (%)"), code="no_number",
        says=("a percentage in Excel", "cell format General"),
    ),
    "a zero that is not shown": Case(
        "nothing, or zero?", styled("0.0;-0.0;;@", value="<v>0</v>"), code="unclear_rows", says=("do not show",)
    ),
    "merged cells": Case("one cell in two rows", styled(after='<mergeCells><mergeCell ref="A2:A3"/></mergeCells>'),
                         code="merged_cells", says=("A2:A3", "unmerge")),
    "a merged title": Case("in one row", styled(after='<mergeCells><mergeCell ref="A1:B1"/></mergeCells>'),
                           rates=ALL),
    **{
        f"on a condition, {what}": Case("a reader may see nothing, or another number", write, code="unclear_rows",
                                        says=("conditional format", f"({rows})", "remove"))
        for what, rows, write in (
            ("white text", "3, 5", conditional(WHITE_TEXT)),
            ("text like its own fill", "3, 5", conditional('<font><color theme="0"/></font>', fill='theme="0"')),
            ("a fill like its own text", "3, 5", conditional(
                '<fill><patternFill><bgColor rgb="FF010101"/></patternFill></fill>')),
            ("no digits", "1, 2, 3, 4, 5", conditional('<numFmt numFmtId="201" formatCode=";;;"/>', "A1:XFD1048576")),
            ("no digits for 0", "2, 3, 4, 5", conditional('<numFmt numFmtId="201" formatCode="0;-0;"/>', "B2:B9")),
            ("a unit", "3", conditional('<numFmt numFmtId="201" formatCode="0.0&quot; kHz&quot;"/>', "B3")),
            ("percent", "3", conditional('<numFmt numFmtId="9" formatCode="0%"/>', "B3")),
            ("struck out", "3", conditional("<font><strike/></font>", "3:3")),
            ("a bar alone", "3", conditional("", "B3", '<cfRule type="dataBar"><dataBar showValue="0"/></cfRule>')),
            ("an icon alone", "3, 4", styled(after=(
                f'<extLst><ext {X14} {XM}><x14:conditionalFormattings><x14:conditionalFormatting><x14:cfRule '
                'type="iconSet"><x14:iconSet showValue="0"/></x14:cfRule><xm:sqref>B3:B4</xm:sqref>'
                "</x14:conditionalFormatting></x14:conditionalFormattings></ext></extLst>"))),
            ("white text by another sheet", "3", styled(after=(
                f'<extLst><ext {X14} {XM}><x14:conditionalFormattings><x14:conditionalFormatting><x14:cfRule '
                f'type="expression"><xm:f>other!A1</xm:f><x14:dxf>{WHITE_TEXT}</x14:dxf></x14:cfRule><xm:sqref>B3'
                "</xm:sqref></x14:conditionalFormatting></x14:conditionalFormattings></ext></extLst>"))),
        )
    },
    **{
        f"on a condition, {what}": Case("a reader sees it", write, rates=ALL)
        for what, write in (
            ("red on pink", conditional(RED_ON_PINK)),
            ("bold", conditional("<font><b/><strike val='0'/></font>")),
            ("white on blue", conditional(WHITE_TEXT, fill='rgb="FF4472C4"')),
            ("more digits", conditional('<numFmt numFmtId="201" formatCode="0.000"/>')),
            ("a bar", conditional("", "B3", '<cfRule type="dataBar"><dataBar><cfvo type="min"/></dataBar></cfRule>')),
            ("a number format of an empty cell", conditional('<numFmt numFmtId="200" formatCode="0%"/>', "C2")),
            ("white text in empty cells", conditional(WHITE_TEXT, "C1:C9 B6:B9")),
        )
    },
    **{
        f"formulas {what}": Case("0 is no value of theirs", styled(value=value, kind=kind, calculation=calculation),
                                 code="no_number", says=("a formula that was not computed", "save it"))
        for what, value, kind, calculation in (
            ("without values", "<f>A2</f>", "", ""),
            ("whose values are 0 until Excel computes them", "<f>A2</f><v>0</v>", "", COMPUTE),
            ("of one group, with 0 for each", '<f t="shared" si="0"/><v>0</v>', "", COMPUTE),
            ("with an empty text for each", "<f>A2</f><v></v>", ' t="str"', COMPUTE),
        )
    },
    "formulas with values": Case("computed", styled(value="<f>A2</f><v>{y}</v>"), rates=ALL),
    "numbers beside such formulas": Case("no formula", styled(calculation=COMPUTE), rates=ALL),
    "logical": Case("TRUE is no rate", styled(value="<v>1</v>", kind=' t="b"'), code="no_number", says=("TRUE",)),
    **{
        f"cell comments, as {by} writes them": Case(
            "they may reject a press, and are said", commented(target, "exclude: electrode moved"), rates=ALL,
            read_as="Cell comments are not read: B3: exclude: electrode moved.",
        )
        for by, target in (("Excel", "../comments1.xml"), ("openpyxl", "/xl/comments/comment1.xml"))
    },
    "comments that are damaged": Case(
        "they are there", commented("../comments1.xml", "<"), rates=ALL,
        read_as="Cell comments are there, and cannot be read.",
    ),
    "no cell comments": Case("nothing is said", styled(), rates=ALL, silent="comments"),
    "a table from B3": Case("empty rows and columns before it", xlsx({"A": [
        [], [], *([None, *row] for row in RATES_ROWS)]}), rates=ALL),
    "MATLAB, logical": Case("true is no rate", mat(position_mm=POSITIONS, rate=THESE > 5), code="not_understood",
                            says=("column rate", "logical")),
    "MATLAB, a matrix": Case("its shape is said", mat(position_mm=POSITIONS, rate=np.ones((4, 2))),
                             code="not_understood", says=("4 × 2",)),
    "MATLAB, complex": Case("said", mat(position_mm=POSITIONS, rate=THESE + 1j), code="not_understood",
                            says=("complex",)),
    "MATLAB, version 4": Case("it says what it is", lambda folder: (
        scipy.io.savemat(folder / "a.mat", {"position_mm": POSITIONS, "rate": THESE}, format="4"),
        str(folder / "a.mat"))[1], code="no_csv", says=("version 4", "-v7")),
    "#row=0": Case("rows count from 1", units([0, 1, 0, 1], "#row=0"), code="no_unit", says=("from 1 to 4",)),
    "#cluster=7": Case("a column of whole numbers", lambda folder: nwb(
        units__id=[0, 1], units__cluster=[7, 8], units__spike_times=[*amplifier(TIMES), 1.0],
        units__spike_times_index=[len(TIMES), len(TIMES) + 1], **PULSES)(folder) + "#cluster=7",
        ("observed=throughout",), rates=ALL),
}  # fmt: skip


def asked(**differently: tuple[Any, Any]) -> Callable[[Run], Run]:
    """A run in which these were asked of the even presses, and of the odd ones."""

    def changed(run: Run) -> Run:
        starts = [
            {**start, **{name: values[start["index"] % 2] for name, values in differently.items()}}
            for start in run.stream("indentation_start")
        ]
        return replace(run, events={**run.events, "indentation_start": starts})

    return changed


def _labelled_by_place(run: Run) -> Run:
    """As the schedules of the program are: the condition of a press is its position."""
    starts = [{**start, "condition": f"{start['x_mm']:g}"} for start in run.stream("indentation_start")]
    return replace(run, events={**run.events, "indentation_start": starts})


def _moved_along(run: Run) -> Run:
    moves = [{"t_s": start - 3, "along_mm": float(n % 2)} for n, start in enumerate(STARTS)]
    return replace(run, events={**run.events, "move": moves})


def _without_the_last_lift(run: Run) -> Run:
    return replace(run, events={**run.events, "indentation_end": run.stream("indentation_end")[:-1]})


OF_AMPLIFIER = of_amplifier(**PULSES)

PRESSES_OF_A_RUN = {
    "killed after the last hold": Case(
        "a press whose last hold ended is finished", OF_AMPLIFIER, rates=ALL, run=_without_the_last_lift,
        read_as="All 8 presses",
    ),
    **{
        f"presses that differ in {words}": Case(
            "they are no repeats of one condition", OF_AMPLIFIER, rates=ALL, run=run, read_as=f"differ in {words},"
        )
        for words, run in (
            ("speed (0.1 and 0.3 mm/s)", asked(speed_mm_s=(0.1, 0.3))),
            ("verb (indent and ramp)", asked(verb=("indent", "ramp"))),
            ("duration of the hold (0.6 and 1 s)", asked(hold_s=(0.6, 1.0))),
            ("condition (dry and wet)", asked(condition=("dry", "wet"))),
            ("condition (none and wet) and speed (1 and 10 mm/s)",
             asked(condition=(None, "wet"), speed_mm_s=(10.0, 1.0))),
            ("place along the finger (0 and 1 mm)", _moved_along),
        )
    },
    "presses whose condition is their position": Case(
        "nothing is mixed", OF_AMPLIFIER, rates=ALL, silent="differ", run=_labelled_by_place,
    ),
    "presses that are alike": Case("nothing is said", OF_AMPLIFIER, rates=ALL, silent="differ",
                                   run=asked(speed_mm_s=(0.1, 0.1), repeat=(1, 2), block=(1, 2))),
}  # fmt: skip

CASES = (
    PRESSES_OF_A_RUN
    | UNOBSERVED | PRESENT | UNITS | NUMBERS | ROWS | CLOCKED | IDENTITIES | KINDS | LEVELS | DOUBLES | UNKNOWN_UNITS
    | NO_PULSES_THERE | SHOWN | ORDERS
)  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_recording_says_what_it_lacks(name: str, tmp_path: Path) -> None:
    case = CASES[name]
    run = case.run(run_with_pulses(tmp_path, case.width_s) if case.pulses else journal(tmp_path))
    recorded = [f"bar:3={case.write(tmp_path)}"]
    reading = Reading((0.0, case.window_s))
    if case.code:
        with pytest.raises(RecordingError) as caught:
            read_recordings(recorded, [], [run], replace(reading, columns=column_map(case.columns)))
        problem = str(caught.value)
        assert caught.value.code == case.code, problem
        assert "\n" not in problem
        assert not [word for word in case.says if word not in problem], problem
        return
    found = read_recordings(recorded, [], [run], replace(reading, columns=column_map(case.columns)))["bar:3"]
    np.testing.assert_allclose(found.rate, case.rates, atol=1e-9, err_msg=case.why)
    assert (0 if found.spikes is None else found.spikes.not_observed) == case.lost, case.why
    sentences = " ".join([found.read_as, *recording_sentences(found)])
    assert case.read_as in sentences
    assert case.silent is None or case.silent not in sentences


def test_the_answer_says_how_far_a_shift_of_the_clock_changes_it(tmp_path: Path) -> None:
    """The window of half a second begins with the hold; shifted 0.5 s later, no spike is left in any.

    A unit that is observed from 0.01 s before each hold to 0.6 s after it is not, shifted 0.02 s later or 0.5 s
    earlier.
    """
    run = run_with_pulses(tmp_path)
    path = of_amplifier(**PULSES)(tmp_path)
    found = read_recordings([f"bar:3={path}"], [], [run], Reading((0.0, WINDOW_S)))
    spikes = found["bar:3"].spikes
    assert spikes is not None
    assert spikes.clock.source == "pulses"
    assert spikes.clock.drift_ppm == pytest.approx(20, abs=0.1)
    shift = clock_shift(found, lambda shifted: bool(shifted["bar:3"].rate.any()))
    assert shift == (0.5, 0.5, (0.02, 0.1, 0.5, 2.0))
    assert "later, the answer holds up to 0.1 s and changes at 0.5 s" in shift.sentence
    narrow = of_amplifier(**PULSES, **observed((0, 0.1), *((t - 0.01, t + 0.6) for t in STARTS)))(tmp_path)
    found = read_recordings([f"bar:3={narrow}"], [], [run], Reading((0.0, WINDOW_S)))
    assert clock_shift(found, lambda shifted: len(shifted["bar:3"].rate)) == (0.02, 0.5, (0.02, 0.1, 0.5, 2.0))
    rates = text("position_mm,rate\n0,1\n1,2\n2,3\n")(tmp_path)
    assert clock_shift(read_recordings([f"bar:3={rates}"], [], [run], Reading()), bool) is None


CLOCKS = {
    "pulses": (of_amplifier(**PULSES), "pulses", "20 ppm fast"),
    "pulses of the journal": (nwb(intervals__sync_pulses__start_time=RISES), "run", "equal those of its journal"),
    "a pulse too many": (
        of_amplifier(**pulses_at(np.append(0.001, amplifier(RISES)))), "pulses", "1 time in the file",
    ),
    "a pulse is missing": (
        of_amplifier(**pulses_at(np.delete(amplifier(RISES), 3))), "pulses", "1 pulse of the run not in the file",
    ),
    "nothing": (nwb(), "assumed", "nothing in the file confirms it"),
    "the run's own export": (nwb(identifier="synthetic " + 32 * "a", intervals__trials__start_time=[1.0]), "run",
                             "exported from it"),
}  # fmt: skip


@pytest.mark.parametrize("name", CLOCKS)
def test_every_recording_of_spikes_says_whose_clock_it_used(name: str, tmp_path: Path) -> None:
    write, source, words = CLOCKS[name]
    made = journal(tmp_path) if source == "assumed" else run_with_pulses(tmp_path)
    run = replace(made, start={"uid": 32 * "a"})
    found = read_recordings([f"bar:3={write(tmp_path)}"], [], [run], Reading((0.0, WINDOW_S)))["bar:3"]
    assert found.spikes is not None
    assert found.spikes.clock.source == source
    assert words in found.spikes.clock.text


def skin(path: Path) -> list[float]:
    found = read_skin_deflection(path)
    return [*found.deflection_mm, *found.x_mm]


def along(path: Path) -> list[float]:
    (found,) = read_deflections(path)
    return [*found.deflection_mm, *found.z_mm, found.doi_mm]


def counted(path: Path) -> list[float]:
    presses = [PossiblePress("bar:3", x, "doi_mm", 0.5) for x in (-1.0, 0.5)]
    return [value for one in read_counts(path, presses, 1.0) for value in one]


def afferents(path: Path) -> list[float]:
    (path.parent / "a.csv").write_text("position_mm,rate\n0,1\n1,2\n2,3\n", encoding="utf-8")
    stimulus = SimpleNamespace(shape="step:1", condition="4 gwt")
    found = read_afferents(path, [], [], [stimulus], Reading())  # type: ignore[list-item]
    (key,) = found["a1"]
    return [float(key.partition("@")[2].removesuffix(" gwt"))]


TABLES = {
    "skin deflection": (skin, "deflection ({um})|x ({um})", "100|-500", [0.1, -0.5]),
    "deflection along the finger": (along, "z ({um})|deflection ({um})|doi ({um})", "1000|100|500", [0.1, 1.0, 0.5]),
    "counts of a designed session": (counted, "shape|x ({um})|doi ({um})|count", "bar:3|500|500|7", [1, 7]),
    "afferents": (afferents, "afferent|shape|force ({mN})|file", "a1|step:1|39.2266|a.csv", [4.0]),
}
"""Every other table whose columns have units: its reader, header, a row, and what is right in the program's units."""


@pytest.mark.parametrize("name", TABLES)
def test_units_convert_in_every_table_that_has_them(name: str, tmp_path: Path) -> None:
    read, header, row, right = TABLES[name]
    words = {"um": ("um", "micron", "µm"), "mN": ("mN", "millinewtons")}
    for um, mn in zip(words["um"], (*words["mN"], "mN"), strict=True):
        path = Path(table(header.format(um=um, mN=mn), row)(tmp_path))
        np.testing.assert_allclose(read(path), right, rtol=1e-5)
    path = Path(table(header.format(um="furlong", mN="slug"), row)(tmp_path))
    with raises(RecordingError, "unknown_unit", path=str(path)) as caught:
        read(path)
    assert any(word in str(caught.value) for word in ("furlong", "slug"))


@pytest.mark.parametrize("sign", ["#", "%", "//", ";", "!", "--"])
@pytest.mark.parametrize("name", [*TABLES, "rates", "spikes of units"])
def test_a_row_that_is_commented_out_is_in_no_table(name: str, sign: str, tmp_path: Path) -> None:
    """It does not count, and as a label that begins with the sign it would; above the header it is a comment."""
    others = {
        "rates": (read_srp, "repeat|position_mm|rate", "a|0|1"),
        "spikes of units": (lambda path: read_spike_times(path, journal(tmp_path), "a"), "unit|time_s", "a|10"),
    }
    read, header, row = TABLES[name][:3] if name in TABLES else others[name]
    above = sign if sign in ("#", "%", "//") else "#"
    path = Path(table(f"{above} one", header.format(um="um", mN="mN"), row, f"{sign}{row}")(tmp_path))
    with raises(RecordingError, "comment_row", path=str(path)) as caught:
        read(path)
    assert "row 4" in str(caught.value)
    assert str(caught.value).endswith(f"the sign {sign}")


@pytest.mark.parametrize("name", TABLES)
def test_values_a_thousand_times_beyond_a_finger_are_questioned_in_every_table(name: str, tmp_path: Path) -> None:
    read, header, row, _ = TABLES[name]
    if name == "afferents":
        row = row.replace("39.2266", "39226.6")
    path = Path(table(header.format(um="mm", mN="gwt"), row)(tmp_path))
    with pytest.raises(RecordingError, match="at most"):
        read(path)


@pytest.mark.parametrize(
    ("read", "header", "row"),
    [
        (along, "z_mm|deflection_mm|doi_mm", "1|.1|n/a"),
        (afferents, "afferent|shape|force_gwt|file", "a1|step:1|-|a.csv"),
    ],
)
def test_a_cell_that_need_not_have_a_number_may_be_empty_and_says_so(
    read: Callable[[Path], list[float]], header: str, row: str, tmp_path: Path
) -> None:
    with pytest.raises(RecordingError, match="leave the cell empty"):
        read(Path(table(header, row)(tmp_path)))


def test_decimal_commas_in_a_table_of_afferents(tmp_path: Path) -> None:
    """As Excel writes it in German."""
    path = tmp_path / "synthetic_afferents.csv"
    path.write_text("\ufeffafferent;shape;force_gwt;file\na1;step:1;4,0;a.csv\n", encoding="utf-8")
    assert afferents(path) == [4.0]


def test_a_copied_run_folder_is_one_run(bar_run: Run, tmp_path: Path) -> None:
    """A conflict copy of a cloud folder has the same uid; its holds are not counted twice."""
    runs = tmp_path / "runs"
    name = bar_run.folder.path.name
    for folder in (name, f"{name} (conflicted copy)"):
        shutil.copytree(bar_run.folder.path, runs / folder)
    original, copy = listed(runs)
    assert (original.summary.name, original.summary.problem, len(original.rows)) == (name, "", 12)
    assert (copy.summary.name, copy.rows) == (f"{name} (conflicted copy)", [])
    assert name in copy.summary.problem
    (once,) = _without_copies([read_run(one) for one in sorted(runs.glob(f"{name}*"))])
    assert once.folder.path == runs / name


@pytest.mark.parametrize("suffix", ["nwb", "nix"])
def test_a_file_that_another_program_writes_says_so(suffix: str, tmp_path: Path) -> None:
    """HDF5 locks files: the amplifier's program has not closed this one."""
    path = {"nwb": of_amplifier(**PULSES), "nix": nix()}[suffix](tmp_path)
    hold = f"import h5py, sys; file = h5py.File({path!r}, 'a'); print('open', flush=True); sys.stdin.read()"
    with subprocess.Popen([sys.executable, "-c", hold], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline().strip() == b"open"
        with raises(RecordingError, "locked_hdf5", path=path) as caught:
            read_recordings([f"bar:3={path}"], [], [run_with_pulses(tmp_path)], Reading((0.0, WINDOW_S)))
        other.communicate()
    assert "another program" in str(caught.value)


@pytest.mark.parametrize("suffix", ["nwb", "nix"])
def test_a_truncated_file_of_any_kind_says_so(suffix: str, tmp_path: Path) -> None:
    path = Path({"nwb": of_amplifier(**PULSES), "nix": nix()}[suffix](tmp_path))
    path.write_bytes(path.read_bytes()[:-500])
    with raises(RecordingError, "truncated_hdf5", path=str(path)):
        read_recordings([f"bar:3={path}"], [], [run_with_pulses(tmp_path)], Reading((0.0, WINDOW_S)))


@pytest.mark.parametrize(
    ("rates", "places", "presses", "most"), [((3, 43), 7, 4, 0.01), ((1, 9), 7, 5, 0.03), ((0.3, 3.3), 4, 10, 0.05)]
)
def test_presses_are_rarely_taken_for_sums_or_means(
    rates: tuple[float, float], places: int, presses: int, most: float, tmp_path: Path
) -> None:
    """Poisson counts under a bell of rates, in 200 tables, also of an afferent that hardly fires.

    Of 19 200 tables with 3 to 10 presses at 4, 7 and 13 positions, 0.2 % were refused; of sparse ones up to 2.5 %.
    """
    chance, x, path = np.random.default_rng(0), np.linspace(-1.5, 1.5, places), tmp_path / "synthetic.csv"
    mean = rates[0] + (rates[1] - rates[0]) * np.exp(-((x - 0.2) ** 2) / 0.8)
    refused = []
    for _ in range(200):
        counts = chance.poisson(mean, size=(presses, places)).tolist()
        rows = [f"{at},{one}.0,{n}" for n, some in enumerate(counts) for at, one in zip(x, some, strict=True)]
        path.write_text("\n".join(["position_mm,rate,repeat", *rows]), encoding="utf-8")
        try:
            read_srp(path)
        except RecordingError as error:
            refused.append(error.code)
    assert set(refused) <= {"totals"}
    assert len(refused) <= most * 200
