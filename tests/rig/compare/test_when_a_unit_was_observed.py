"""No data is not zero: presses at which a unit was not observed are left out and counted."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import neo
import numpy as np
import pytest
import scipy.io

from rig.data import Run
from tests.rig.compare.recording_files import (
    ALL,
    BEGAN_S,
    LOST_S,
    PULSES,
    RISES,
    STARTS,
    TIMES,
    UNTIL_LOST,
    Case,
    amplifier,
    check,
    nix,
    nwb,
    observed,
    of_amplifier,
    pulses_at,
    spikes_csv,
    syncs,
    text,
)


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


def invalid(begin: Any, end: Any, spikes: Sequence[float] = TIMES) -> Callable[[Path], str]:
    return of_amplifier(spikes, **PULSES, intervals__invalid_times__start_time=begin,
                        intervals__invalid_times__stop_time=end)  # fmt: skip


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
        read_as="6 of 8 presses at 3 positions from -0.5 to 0.25 mm, 4 to 28 1/s (2 to 14 spikes), highest at 0 mm.",
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
            code="beyond_a_finger", says=("intervals/invalid_times", "--columns invalid=invalid_times:ms"),
        )
        for unit, factor in {"ms": 1e3, "us": 1e6, "samples": 3e4}.items()
    },
    **{
        f"NWB, invalid_times in {unit}, early in the recording": Case(
            "as given they lie outside of it, and in this unit inside", invalid(
                amplifier([55.0]) / factor, amplifier([65.0]) / factor, [*TIMES, 1000.0]),
            code="beyond_a_finger", says=("intervals/invalid_times", f"--columns invalid=invalid_times:{unit}"),
        )
        for unit, factor in {"ms": 1e-3, "min": 60.0}.items()
    },
    "NWB, invalid_times outside of the run": Case(
        "nothing is left out by them, and it is said", invalid(amplifier([100.0, 120.0]), amplifier([105.0, 126.0])),
        rates=ALL, read_as="2 intervals of invalid_times (100 to 126 s of the run) leave out no press: they lie "
        "outside the run (0 to 80.6 s)",
    ),
    "NWB, invalid_times before the recording, stated in s": Case(
        "the user knows their unit", invalid(amplifier([55.0]) / 60, amplifier([65.0]) / 60),
        ("invalid=invalid_times:s",), rates=ALL, read_as="1 interval of invalid_times (-11.4 to -11.2 s of the run) "
        "leaves out no press: it lies outside the run",
    ),
    "NWB, one of two invalid_times between presses": Case(
        "the other one leaves out the press at 60 s", invalid(amplifier([15.0, 55.0]), amplifier([16.0, 65.0])),
        rates=ALL, lost=1, read_as="1 of 2 intervals of invalid_times (15 to 16 s of the run) leaves out no press",
    ),
    "NWB, a gap of obs_intervals between presses": Case(
        "nothing is left out by it", of_amplifier(**PULSES, **observed((0, 15), (16, 100))), rates=ALL,
        read_as="1 gap in the times at which the unit was observed (15 to 16 s of the run) leaves out no press",
    ),
    "NIX, an epoch of artifacts during presses": Case(
        "it is not used, and when it was is said", nix(line_v=True, epoch=("artifact", "x")), ("sync=ttl",),
        rates=ALL,
        read_as="The file's artifact (1 interval, 45 to 65 s of the run, during 2 presses) is not used",
    ),
    "NIX, a unit with an annotation": Case(
        "it may not count, and that is said, as in NWB", nix(line_v=True, quality="mua"), ("sync=ttl",), rates=ALL,
        read_as="Annotations of the unit that are not read: quality = mua. If they say that it does not count",
    ),
    "NWB, obs_intervals without the spikes of half of the run": Case(
        "either another unit of time, or spikes that are not the unit's", of_amplifier(
            **PULSES, **observed((0, 15.0))), code="spikes_outside_observed",
        says=("observed=obs_intervals:ms", "if the unit was lost", "delete the spikes"),
    ),
    **{
        f"{kind}, a unit that is lost while another goes on": Case(
            "silent, or lost: it is said", two_units(kind), rates=[*ALL[:3], 0], pulses=False,
            read_as="No spikes of this unit after 60.1 s of the run, while others of the file continue: 2 presses",
        )
        for kind in ("NWB", "CSV", "NIX", "MAT")
    },
    "a recorder that paused within a hold": Case(
        "spikes before and after it, and none for long", of_amplifier(
            [*(t for t in TIMES if t < 80), *(80 + 0.01 * n for n in range(1, 12)), *(80.45, 80.46)], **PULSES),
        rates=[6, 24, 12, 13], read_as="Between 80.11 and 80.45 s of the run, in a hold, no spike, "
        "34 times as long as the next longest interval",
    ),
    "NWB, invalid times of another name": Case(
        "they are used, and are no pulses", of_amplifier(
            **PULSES, intervals__bad__start_time=amplifier([55.0]), intervals__bad__stop_time=amplifier([65.0])),
        ("invalid=bad",), rates=ALL, lost=1, silent="not used",
    ),
    "NWB, invalid times of a name that is not there": Case(
        "what is named is no absence", of_amplifier(**PULSES), ("invalid=bad",), code="bad_invalid_times",
        says=("intervals/bad",),
    ),
    "NWB, invalid_times in ms, stated": Case(
        "each input has its own unit", of_amplifier(
            **PULSES, intervals__invalid_times__start_time=1e3 * amplifier([55.0]),
            intervals__invalid_times__stop_time=1e3 * amplifier([65.0])), ("invalid=invalid_times:ms",),
        rates=ALL, lost=1,
    ),
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


def paused(*lost: int, off_s: float = 0.0, beside: Sequence[float] = (), **more: Any) -> Callable[[Path], str]:
    """Of three pulses a press, those of these numbers are lost, or late, with the spikes of their presses.

    Spikes `beside` those of the presses are there.
    """
    presses_lost = {EDGES[n][0] for n in lost} if len(lost) > 1 else set()
    mine = [any(abs(t - STARTS[n]) < 1 for n in presses_lost) for t in TIMES]
    spikes = sorted([*(t + off_s * own for t, own in zip(TIMES, mine, strict=True) if off_s or not own), *beside])
    rises = [t + off_s * (n in lost) for n, (*_, t) in enumerate(EDGES) if off_s or n not in lost]
    return of_amplifier(spikes, **pulses_at(amplifier(rises)) | more)


ALTHOUGH = ", although it states that the unit was observed"
FEWER = "Between 20.6 and 49.4 s of the run, the file has fewer pulses than the run"

GAPS = {
    "a recorder that paused during two presses": Case(
        "presses 2 and 3, at 0 mm, have no pulse and no spike", paused(*range(6, 12)), rates=[6.0, 12.0, 1.0], lost=2,
        run=of_presses, read_as=FEWER,
    ),
    "a pause, stated as observed": Case(
        "the pulses contradict it, and it is said", paused(*range(6, 12), **observed((0, 100))),
        rates=[6.0, 12.0, 1.0], lost=2, run=of_presses, read_as="although it states that the unit was observed",
    ),
    **{
        f"a pause, observed throughout{what}": Case(
            "the user says so, and the contradiction is said", paused(*range(6, 12), **more),
            ("observed=throughout",), rates=[6.0, 0.0, 12.0, 1.0], run=of_presses,
            read_as="The file has fewer pulses than the run, but presses count as observed",
        )
        for what, more in (("", {}), (", with intervals", observed((0, 100))))
    },
    **{
        f"a recorder that paused during the {which} two presses{what}": Case(
            "it ran before the first press and after the last, and these have no pulse",
            paused(*lost, beside=(1.0, 80.58), **more), rates=rates, lost=2, run=of_presses,
            read_as=f"{where} of the run, the file has fewer pulses than the run, as if the recorder had paused"
            f"{although}: presses there count as not observed",
            silent="before its first or after its last event",
        )
        for which, lost, rates, where in (
            ("first", range(6), ALL[1:], f"Before {EDGES[6][2]:.1f} s"),
            ("last", range(18, 24), ALL[:3], f"After {EDGES[17][2]:.1f} s"),
        )
        for what, more, although in (("", {}, ""), (", stated as observed", observed((0, 100)), ALTHOUGH))
    },
    **{
        f"a recorder that paused during the {which} press": Case(
            "all its pulses are lost", paused(*lost, beside=(1.0, 80.58)), rates=rates, lost=1, run=of_presses,
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
            why, paused(*range(3), *range(21, 24), beside=(1.0, 80.58), **more), columns, run=of_presses,
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
        "its pulses are lost", paused(6, 7, 8), rates=[6.0, 28.0, 12.0, 1.0], lost=1, run=of_presses,
        read_as="Between 20.6 and 39.1 s of the run, the file has fewer pulses",
    ),
    "a pause from one hold into the next": Case(
        "the first press was not observed to its end, nor the second from its beginning", paused(8, 9, 10),
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
        "the other pulses of the press are there", paused(7), rates=ALL, run=of_presses,
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
        "the line of the other pulses is not its clock there", paused(7, 8, off_s=0.3),
        rates=[6.0, 28.0, 12.0, 1.0], lost=1, run=of_presses, read_as="or its clock had wandered",
    ),
    "a clock that wandered, observed throughout": Case(
        "the user does not know its clock either", paused(7, 8, off_s=0.3), ("observed=throughout",),
        rates=[6.0, 28.0, 12.0, 1.0], lost=1, run=of_presses, read_as="or its clock had wandered",
    ),
}  # fmt: skip
CASES = UNOBSERVED | GAPS


@pytest.mark.parametrize("name", CASES)
def test_presses_outside_of_the_times_of_observation_are_left_out_and_counted(name: str, tmp_path: Path) -> None:
    check(CASES[name], tmp_path)
