"""Whose clock tells the spikes: pulses in every form, other units of time, and what a shift changes."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.compare.recordings.reading import Reading, read_recordings
from rig.compare.spike_clock import clock_shift
from tests.rig.compare.recording_files import (
    ALL,
    LOST_S,
    PULSES,
    RISES,
    STARTS,
    TIMES,
    UNTIL_LOST,
    WINDOW_S,
    Case,
    amplifier,
    check,
    journal,
    nix,
    nwb,
    observed,
    of_amplifier,
    pulses_at,
    run_with_pulses,
    sampled,
    spikes_csv,
    syncs,
    text,
)


def both_edges() -> dict[str, Any]:
    rises = amplifier(RISES)
    return {
        "acquisition__sync_pulses__timestamps": np.sort(np.concatenate([rises, rises + 0.0105])),
        "acquisition__sync_pulses__data": np.tile([1, 0], len(rises)),
    }


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
        rates=ALL, read_as="The file's bad (1 interval, 45 to 65 s of the run, during 2 presses) is not used",
    ),
    "NWB, trials with a column of rejections": Case(
        "it is not used, and said", of_amplifier(
            **PULSES, intervals__trials__start_time=amplifier(STARTS), intervals__trials__rejected=[0] * 8),
        rates=ALL, read_as="trials (8 intervals, column rejected, ",
    ),
    "NWB, epochs with tags": Case(
        "they are not used, and said", of_amplifier(
            **PULSES, intervals__epochs__start_time=[45.0], intervals__epochs__tags=["artifact"]),
        rates=ALL,
        read_as="The file's epochs (1 interval, artifact, 32.5 s of the run, during 0 presses) is not used",
    ),
    "NWB, epochs and no pulses": Case(
        "said, whatever the clock", nwb(intervals__epochs__start_time=[45.0]), ("sync=none",), rates=ALL,
        pulses=False, read_as="The file's epochs (1 interval, 45 s of the run, during 0 presses) is not used",
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
    "NWB, intervals of more than a day, stated in s": Case(
        "the user says so", of_amplifier(
            UNTIL_LOST, **PULSES, units__obs_intervals=[[0.0, 200_000.0]], units__obs_intervals_index=[1],
        ), ("observed=obs_intervals:s",), rates=[*ALL[:3], 0],
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
CASES = PRESENT | CLOCKED | LEVELS | NO_PULSES_THERE


@pytest.mark.parametrize("name", CASES)
def test_sync_pulses_in_a_file_set_the_clock_or_are_refused(name: str, tmp_path: Path) -> None:
    check(CASES[name], tmp_path)


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


@pytest.mark.parametrize("name", CLOCKS)
def test_every_recording_of_spikes_says_whose_clock_it_used(name: str, tmp_path: Path) -> None:
    write, source, words = CLOCKS[name]
    made = journal(tmp_path) if source == "assumed" else run_with_pulses(tmp_path)
    run = replace(made, start={"uid": 32 * "a"})
    found = read_recordings([f"bar:3={write(tmp_path)}"], [], [run], Reading((0.0, WINDOW_S)))["bar:3"]
    assert found.spikes is not None
    assert found.spikes.clock.source == source
    assert words in found.spikes.clock.text
