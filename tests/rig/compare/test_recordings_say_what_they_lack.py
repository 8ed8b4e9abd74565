"""No data is not zero, and what is not understood is not absent: each row is an input, and what is right for it.

All files are synthetic: one afferent under eight presses at four places. A row has the right rates and the number
of presses that were not observed, or the code of the refusal and the words that it must contain.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import neo
import numpy as np
import pytest
import quantities as pq
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.columns import column_map
from rig.compare.recordings.reading import Reading, read_recordings
from rig.compare.spike_clock import clock_shift
from rig.data import Run
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


def run_with_pulses(folder: Path) -> Run:
    run = journal(folder)
    return replace(run, events={**run.events, "sync": [{"t_s": t, "rise_s": t} for t in RISES]})


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


def line(edges: Array, volts: float = 5.0) -> NDArray[np.float32]:
    """A sampled line that is high for 10 ms from each rise."""
    values = np.zeros(int(110 * SAMPLES_HZ), dtype=np.float32)
    for rise in edges:
        values[int(np.ceil(rise * SAMPLES_HZ)) : int((rise + 0.01) * SAMPLES_HZ)] = volts
    return values


def sampled(place: str) -> dict[str, Any]:
    return {
        f"{place}__data": line(amplifier(RISES)),
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


def nix(start: float = 0.0, stop: float = 200.0, spikes: Sequence[float] = TIMES, line_v: bool = False) -> Any:
    def write(folder: Path) -> str:
        path = folder / "synthetic.nix"
        segment = neo.Segment()
        times = np.array([t for t in spikes if start <= t <= stop])
        segment.spiketrains.append(neo.SpikeTrain(times, units="s", t_start=start, t_stop=stop, name="u"))
        if line_v:
            segment.analogsignals.append(
                neo.AnalogSignal(line(np.array(RISES)), units="V", sampling_rate=SAMPLES_HZ * pq.Hz, name="ttl")
            )
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


UNOBSERVED = {
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
    "NWB, malformed obs_intervals": Case(
        "what is there and not understood is no absence",
        nwb(units__obs_intervals=[[0.0, 50.0]]), ("sync=none",), code="bad_obs_intervals", says=("obs_intervals",),
    ),
    "NWB, invalid_times": Case(
        "the press at 60 s is invalid; the other at 0.25 mm has 6 spikes in half a second",
        of_amplifier(**PULSES, intervals__invalid_times__start_time=amplifier([55.0]),
                     intervals__invalid_times__stop_time=amplifier([65.0])), rates=ALL, lost=1,
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
        "the amplifier was off before the last two presses",
        spikes_csv(*syncs(amplifier(RISES[:6])), spikes=amplifier(UNTIL_LOST).tolist()), rates=ALL[:3], lost=2,
    ),
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
    "NIX, that line": Case("named", nix(line_v=True), ("sync=ttl",), rates=ALL),
    "CSV, several units": Case(
        "spikes of two units are not one afferent's",
        text("unit,t_s\n" + "".join(f"a,{t}\nb,{t + 0.1}\n" for t in TIMES)), ("time=t_s",), code="several_units",
        says=("one of a, b",), pulses=False,
    ),
    "CSV, one of several units": Case(
        "chosen", lambda folder: text("unit,t_s\n" + "".join(f"a,{t}\nb,{t + 0.1}\n" for t in TIMES))(folder) + "#a",
        ("time=t_s",), rates=ALL, pulses=False,
    ),
}  # fmt: skip

CASES = UNOBSERVED | PRESENT


@pytest.mark.parametrize("name", CASES)
def test_a_recording_says_what_it_lacks(name: str, tmp_path: Path) -> None:
    case = CASES[name]
    run = run_with_pulses(tmp_path) if case.pulses else journal(tmp_path)
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


def test_the_answer_says_how_far_a_shift_of_the_clock_changes_it(tmp_path: Path) -> None:
    """The window of half a second begins with the hold; shifted 0.5 s later, no spike is left in any."""
    run = run_with_pulses(tmp_path)
    path = of_amplifier(**PULSES)(tmp_path)
    found = read_recordings([f"bar:3={path}"], [], [run], Reading((0.0, WINDOW_S)))
    spikes = found["bar:3"].spikes
    assert spikes is not None
    assert spikes.clock.source == "pulses"
    assert spikes.clock.drift_ppm == pytest.approx(20, abs=0.1)
    shift = clock_shift(found, lambda shifted: bool(shifted["bar:3"].rate.any()))
    assert shift == (0.5, 0.5, (0.02, 0.1, 0.5, 2.0))
    assert "0.5 s later" in shift.sentence
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
    run = replace(run_with_pulses(tmp_path), start={"uid": 32 * "a"})
    found = read_recordings([f"bar:3={write(tmp_path)}"], [], [run], Reading((0.0, WINDOW_S)))["bar:3"]
    assert found.spikes is not None
    assert found.spikes.clock.source == source
    assert words in found.spikes.clock.text
