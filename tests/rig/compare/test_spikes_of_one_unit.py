"""Which unit is read, spikes that cannot be right, and presses that differ."""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rig.cli.compare import _without_copies
from rig.data import Run, read_run
from rig.data.index import listed
from tests.rig.compare.recording_files import (
    ALL,
    PULSES,
    RATES_CSV,
    RATES_ROWS,
    RISES,
    STARTS,
    TIMES,
    Array,
    Case,
    amplifier,
    check,
    nix,
    nwb,
    of_amplifier,
    spikes_csv,
    syncs,
    table,
    text,
    xlsx,
)


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
    "#row=0": Case("rows count from 1", units([0, 1, 0, 1], "#row=0"), code="no_unit", says=("row=1 to row=4",)),
    "#cluster=7": Case("a column of whole numbers", lambda folder: nwb(
        units__id=[0, 1], units__cluster=[7, 8], units__spike_times=[*amplifier(TIMES), 1.0],
        units__spike_times_index=[len(TIMES), len(TIMES) + 1], **PULSES)(folder) + "#cluster=7",
        ("observed=throughout",), rates=ALL),
    "no such unit": Case("the error lists the names", units([0, 1, 0, 1], "#C0", **NAMED), code="no_unit",
                         says=("unit_name A0",)),
    "a column of MATLAB": Case(
        "MatNWB writes (N, 1)",
        nwb(units__spike_times=amplifier(TIMES)[:, None], units__spike_times_index=[len(TIMES)], **PULSES),
        rates=ALL,
    ),
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
    "CSV, 0.2 ms apart": spikes_csv(*syncs(amplifier(RISES)), spikes=amplifier([*TIMES, *np.add(TIMES, 2e-4)])),
    "CSV, rounded to 0.1 s": spikes_csv(*syncs(amplifier(RISES)), spikes=np.round(amplifier(TIMES), 1)),
}

DOUBLES = {
    f"{name}, spikes twice": Case("no neuron fires twice within 0.5 ms", write, code="spikes_twice", says=(
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
CASES = IDENTITIES | ORDERS | DOUBLES | PRESSES_OF_A_RUN


@pytest.mark.parametrize("name", CASES)
def test_spikes_are_those_of_one_unit_under_presses_of_one_condition(name: str, tmp_path: Path) -> None:
    check(CASES[name], tmp_path)


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
