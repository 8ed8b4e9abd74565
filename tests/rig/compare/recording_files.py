"""Recordings of one afferent in every kind of file, and what is right for an input.

All files are synthetic: one afferent under eight presses at four places. There is one builder a format; a `Case` has
the right rates and the number of presses that were not observed, or the code of the refusal and the words that it
must contain.
"""

import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import neo
import numpy as np
import pytest
import quantities as pq
import scipy.io
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.columns import column_map
from rig.compare.recordings.reading import Reading, read_recordings
from rig.compare.spike_clock import recording_sentences
from rig.data import Run
from rig.data.folder import RunFolder

Array = NDArray[np.float64]

SPIKES = {-0.5: (2, 4), 0.0: (10, 14), 0.25: (6, 6), 1.0: (0, 1)}
"""Counts of two presses at each place, in half a second."""

WINDOW_S = 0.5
PRESSES = [(x, count, number) for x, counts in SPIKES.items() for number, count in enumerate(counts)]
STARTS = [10.0 * (n + 1) for n in range(len(PRESSES))]
TIMES = [start + 0.01 * (k + 1) for start, (_, count, _) in zip(STARTS, PRESSES, strict=True) for k in range(count)]
REPEAT = [f"{number}" for _, _, number in PRESSES]


def journal(folder: Path, presses: int = len(PRESSES)) -> Run:
    """Of a bar at these places, each press held for 0.6 s."""
    done = list(enumerate(zip(PRESSES, STARTS, strict=True)))[:presses]
    what = {"indentor": "bar:3.0", "target": "doi_mm", "value": 1.0, "increments": 1}
    events = {
        "mount": [{"indentor": "bar:3.0"}],
        "indentation_start": [{"index": n, "t_s": start - 2, "x_mm": p[0], **what} for n, (p, start) in done],
        "hold_start": [{"index": n, "hold": 1, "t_s": start} for n, (_, start) in done],
        "hold_end": [{"index": n, "hold": 1, "x_mm": p[0], "t_s": start + 0.6} for n, (p, start) in done],
        "indentation_end": [{"index": n, "t_s": start + 1} for n, (_, start) in done],
    }
    return Run(RunFolder(folder), {}, None, {}, events, {}, 0.0, max(STARTS) + 0.6)


RISES = [start - before for start, before in zip(STARTS, (0.5, 0.7, 0.45, 0.9, 0.6, 0.8, 0.55, 0.75), strict=True)]
"""Of the pulses of the run, at uneven intervals, one before each press."""

ALL = [6.0, 24.0, 12.0, 1.0]
"""Rates (1/s) at −0.5, 0, 0.25 and 1 mm: means of counts (2, 4), (10, 14), (6, 6), (0, 1) in half a second."""

TWICE = [(x, y + d, n) for n, d in ((1, -1), (2, 1)) for x, y in zip((-0.5, 0, 0.25, 1), ALL, strict=True)]
"""Two repeats at each position, whose means are the rates."""

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


def pulses_at(times: Array) -> dict[str, Any]:
    return {"intervals__sync_pulses__start_time": times}


def write_nix(path: Path, segment: Any) -> str:
    """Write a segment to a NIX file, and return the file's name."""
    block = neo.Block()
    block.segments.append(segment)
    with neo.NixIO(str(path), mode="ow") as file:
        file.write_block(block)
    return str(path)


def nix(
    start: float = 0.0, stop: float = 200.0, spikes: Sequence[float] = TIMES, line_v: bool = False, name: str = "ttl",
    epoch: tuple[str, ...] = (), rises: Sequence[float] = RISES, quality: str = "", **of_line: Any,
) -> Any:  # fmt: skip
    def write(folder: Path) -> str:
        path = folder / "synthetic.nix"
        segment = neo.Segment()
        times = np.array([t for t in spikes if start <= t <= stop])
        train = neo.SpikeTrain(times, units="s", t_start=start, t_stop=stop, name="u")
        train.annotate(**({"quality": quality} if quality else {}))
        segment.spiketrains.append(train)
        if line_v:
            segment.analogsignals.append(
                neo.AnalogSignal(
                    line(np.array(rises), **of_line), units="V", sampling_rate=SAMPLES_HZ * pq.Hz, name=name
                )
            )
        if epoch:
            times, durations = np.array([45.0]) * pq.s, np.array([20.0]) * pq.s
            segment.epochs.append(neo.Epoch(times, durations, labels=np.array(epoch[1:]), name=epoch[0]))
        return write_nix(path, segment)

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


def table(header: str, *rows: str, sep: str = ",") -> Callable[[Path], str]:
    return text("\n".join((header, *rows)).replace("|", sep) + "\n")


RATES_CSV = "position_mm,rate\n" + "".join(f"{x},{y:g}\n" for x, y in zip((-0.5, 0, 0.25, 1), ALL, strict=True))
RATES_ROWS = [["position_mm", "rate"], *([x, y] for x, y in zip((-0.5, 0, 0.25, 1), ALL, strict=True))]
XML = '<?xml version="1.0"?>'
MAIN = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
RELATIONS = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"


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
                f"{XML}<worksheet {MAIN}><sheetData>{''.join(each)}</sheetData></worksheet>"
            )
        names = "".join(
            f'<sheet name="{name}" sheetId="{n}" r:id="rId{n}"' + ' state="hidden"' * (name == hidden) + "/>"
            for n, name in enumerate(sheets, 1)
        )
        book = f'<workbook {MAIN} xmlns:r="{RELATIONS}"><sheets>{names}</sheets></workbook>'
        made["xl/workbook.xml"] = f"{XML}{book}"
        targets = "".join(
            f'<Relationship Id="rId{n}" Target="worksheets/sheet{n}.xml" Type="x"/>'
            for n in range(1, len(sheets) + 1)
        )
        made["xl/_rels/workbook.xml.rels"] = (
            f'{XML}<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">{targets}'
            "</Relationships>"
        )
        texts = "".join(f"<si><t>{text}</t></si>" for text in shared)
        made["xl/sharedStrings.xml"] = f"{XML}<sst {MAIN}>{texts}</sst>"
        made["xl/styles.xml"] = (
            f'{XML}<styleSheet {MAIN}><cellXfs><xf numFmtId="0"/><xf numFmtId="14"/></cellXfs></styleSheet>'
        )
        with zipfile.ZipFile(path, "w") as file:
            for name, content in made.items():
                file.writestr(name, content)
        return f"{path}{choice}"

    return write


def mat(**variables: Any) -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        path = folder / "synthetic.mat"
        scipy.io.savemat(path, variables, do_compression=True)
        return str(path)

    return write


def check(case: Case, folder: Path) -> None:
    """Read the input of a case, and assert that what is right for it comes out."""
    run = case.run(run_with_pulses(folder, case.width_s) if case.pulses else journal(folder))
    recorded = [f"bar:3={case.write(folder)}"]
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
    sentences = " ".join([found.read_as, found.contents, *recording_sentences(found)])
    assert case.read_as in sentences
    assert case.silent is None or case.silent not in sentences
