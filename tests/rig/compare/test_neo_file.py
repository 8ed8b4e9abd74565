"""The same spikes and pulses in every format of a recording system: the same rates; wrong files: one line."""

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import neo
import numpy as np
import pytest
import quantities as pq
from neo.rawio import neuroexplorerrawio, plexonrawio, spike2rawio
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings import neo_file
from rig.compare.recordings.columns import column_map
from rig.compare.recordings.neo_file import BY_SUFFIX, OPEN_EPHYS, read_neo
from rig.compare.recordings.reading import Reading, read_recordings
from rig.compare.recordings.recording import Recording
from rig.data import Run
from tests.error_codes import raises
from tests.rig.compare.recording_files import SPIKES, STARTS, TIMES, WINDOW_S, journal

Array = NDArray[np.float64]

RISES = [0.0, 30.0, 60.0, max(STARTS)]
TICKS = 40_000
"""Per second of the formats that count ticks."""


def amplifier_s(run_s: list[float]) -> Array:
    """The amplifier's clock started 100 s earlier and runs 20 ppm fast; on its ticks, so that all formats agree."""
    return np.round((100 + 1.00002 * np.array(run_s)) * TICKS) / TICKS


UNIT, OTHER, PULSES = amplifier_s(TIMES), amplifier_s([5.0, 15.0]), amplifier_s(RISES)


Channels = dict[str, Array]
Segment = tuple[Channels, Channels]
"""Spike trains and event channels."""


def nix(path: Path, *segments: Segment, unit: str = "s") -> Path:
    factor = {"s": 1.0, "ms": 1e3}[unit]
    block = neo.Block()
    for trains, events in segments:
        segment = neo.Segment()
        block.segments.append(segment)
        for name, times in trains.items():
            stop = factor * (float(np.nanmax(times, initial=0.0)) + 1000)
            segment.spiketrains.append(neo.SpikeTrain(factor * times, units=unit, t_stop=stop, name=name))
        for name, times in events.items():
            segment.events.append(
                neo.Event(factor * times * pq.Quantity(1, unit), np.array([""] * len(times)), name=name)
            )
    with neo.NixIO(str(path), mode="ow") as file:
        file.write_block(block)
    return path


def nwb(path: Path) -> Path:
    with h5py.File(path, "w") as file:
        file["units/id"] = [1, 2]
        file["units/spike_times"] = np.concatenate([UNIT, OTHER])
        file["units/spike_times_index"] = [len(UNIT), len(UNIT) + len(OTHER)]
        file["acquisition/sync_pulses/timestamps"] = PULSES
    return path


def open_ephys(folder: Path) -> Path:
    """Two TTL lines: 1 is a spike discriminator, 2 has the pulses."""
    inside = folder / "Record Node 101" / "experiment1" / "recording1"
    stream = inside / "events" / "TTL"
    stream.mkdir(parents=True)
    edges = [(t + after, state * sign) for state, times in ((1, UNIT), (2, PULSES)) for t in times
             for after, sign in ((0.0, 1), (0.001, -1))]  # fmt: skip
    times, states = (np.array(values) for values in zip(*sorted(edges), strict=True))
    np.save(stream / "timestamps.npy", times)
    np.save(stream / "sample_numbers.npy", np.round(TICKS * times).astype(np.int64))
    np.save(stream / "states.npy", states.astype(np.int16))
    about = {"folder_name": "TTL", "channel_name": "TTL", "sample_rate": TICKS, "stream_name": "TTL"}
    structure = {"GUI version": "0.6.7", "continuous": [], "events": [about], "spikes": []}
    (inside / "structure.oebin").write_text(json.dumps(structure), encoding="utf-8")
    (inside.parent.parent / "settings.xml").write_text("<SETTINGS/>", encoding="utf-8")
    return folder


def _filled(description: list[Any], **values: Any) -> bytes:
    made = np.zeros(1, dtype=np.dtype(description))
    for name, value in values.items():
        made[name] = value
    return made.tobytes()


def spike2(path: Path) -> Path:
    """Three channels of events in SON, system 6, one block each; texts begin with their length."""
    channels = {"unit 1": UNIT, "unit 2": OTHER, "pulses": PULSES}
    size, first = 140, 512 + 140 * len(channels)
    header = _filled(
        spike2rawio.headerDescription, system_id=6, us_per_time=1_000_000 // TICKS, channels=len(channels),
        chan_size=size, dtime_base=1e-6, max_ftime=int(TICKS * 1000),
    )  # fmt: skip
    channel_headers, blocks, at = b"", b"", first
    for number, (name, times) in enumerate(channels.items()):
        ticks = np.round(TICKS * times).astype("<i4")
        block = _filled(
            spike2rawio.blockHeaderDesciption, pred_block=-1, succ_block=-1, start_time=ticks[0], end_time=ticks[-1],
            channel_num=number + 1, items=len(ticks),
        ) + ticks.tobytes()  # fmt: skip
        about = _filled(
            spike2rawio.channelHeaderDesciption1, firstblock=at, lastblock=at, blocks=1, kind=3,
            title=bytes([len(name)]) + name.encode(), max_chan_time=ticks[-1],
        )  # fmt: skip
        channel_headers, blocks, at = channel_headers + about.ljust(size, b"\0"), blocks + block, at + len(block)
    path.write_bytes(header.ljust(512, b"\0") + channel_headers + blocks)
    return path


def plexon(path: Path) -> Path:
    """One channel with two sorted units, and one of events."""
    header = _filled(
        plexonrawio.GlobalHeader, MagicNumber=0x58454C50, Version=106, ADFrequency=TICKS, NumDSPChannels=1,
        NumEventChannels=1, NumPointsWave=1, Year=2026, Month=1, Day=1, WaveformFreq=TICKS, BitsPerSpikeSample=16,
        SpikeMaxMagnitudeMV=3000, SpikePreAmpGain=1000, LastTimestamp=1000.0 * TICKS,
    )  # fmt: skip
    header += _filled(plexonrawio.DspChannelHeader, Name=b"sig001", Channel=1, NUnits=2, Gain=1)
    header += _filled(plexonrawio.EventChannelHeader, Name=b"pulses", Channel=3)
    kinds = [(UNIT, 1, 1, 1), (OTHER, 1, 1, 2), (PULSES, 4, 3, 0)]
    rows = sorted((round(TICKS * t), *what) for times, *what in kinds for t in times)
    blocks = [
        _filled(plexonrawio.DataBlockHeader, Type=kind, TimeStamp=tick, Channel=channel, Unit=unit,
                NumberOfWaveforms=kind == 1, NumberOfWordsInWaveform=kind == 1) + b"\0\0" * (kind == 1)
        for tick, kind, channel, unit in rows
    ]  # fmt: skip
    path.write_bytes(header + b"".join(blocks))
    return path


def neuroexplorer(path: Path) -> Path:
    variables = {"unit 1": (0, UNIT), "unit 2": (0, OTHER), "pulses": (1, PULSES)}
    header = _filled(
        neuroexplorerrawio.GlobalHeader, signature=b"NEX1", version=104, freq=TICKS, tend=1000 * TICKS, nvar=3
    ).ljust(544, b"\0")  # fmt: skip
    at, heads, data = 544 + 208 * len(variables), b"", b""
    for name, (kind, times) in variables.items():
        ticks = np.round(TICKS * times).astype("<i4").tobytes()
        heads += _filled(
            neuroexplorerrawio.EntityHeader, type=kind, varVersion=100, name=name.encode(), offset=at, n=len(times)
        ).ljust(208, b"\0")  # fmt: skip
        at, data = at + len(ticks), data + ticks
    path.write_bytes(header + heads + data)
    return path


@dataclass(frozen=True)
class Format:
    """How a file is written, what chooses the unit and the pulses, and whether times come back bit by bit."""

    write: Callable[[Path], Path]
    name: str
    unit: str
    columns: tuple[str, ...] = ()
    exact: bool = True


TRAINS, SYNC = {"unit 1": UNIT, "unit 2": OTHER}, {"sync_pulses": PULSES}

FORMATS = {
    "NIX": Format(lambda path: nix(path, (TRAINS, SYNC)), "a.nix", "unit 1"),
    "NIX, ms": Format(
        lambda path: nix(path, (TRAINS, {"pulses": PULSES, "rewards": OTHER}), unit="ms"),
        "a.nix", "unit 1", ("sync=pulses",), exact=False,
    ),
    "NIX, unsorted": Format(
        lambda path: nix(path, ({"unit 1": UNIT[::-1]}, {"sync_pulses": PULSES[::-1]})), "a.nix", "unit 1"
    ),
    "NWB": Format(nwb, "a.nwb", "1"),
    "Open Ephys binary": Format(open_ephys, "a", "TTL/1", ("sync=TTL/2",)),
    "Spike2": Format(spike2, "a.smr", "unit 1", ("sync=pulses",), exact=False),
    "Plexon": Format(plexon, "a.plx", "ch1#1", ("sync=pulses",), exact=False),
    "NeuroExplorer": Format(neuroexplorer, "a.nex", "unit 1", ("sync=pulses",), exact=False),
}  # fmt: skip

every_format = pytest.mark.parametrize("name", FORMATS)


@pytest.fixture(scope="module", autouse=True)
def _parsed_once() -> Iterator[None]:
    """A file is parsed once, however often a test asks it for something: no test changes one that was read.

    nixio looks for garbage whenever it closes a file, which takes a second late in a session.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(neo_file, "_segments", cache(neo_file._segments))
        patch.setattr("nixio.file.gc", SimpleNamespace(collect=lambda: 0))
        yield


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The file of a format, written once."""

    @cache
    def write(name: str) -> Path:
        return FORMATS[name].write(tmp_path_factory.mktemp("format") / FORMATS[name].name)

    return write


def pulsed(folder: Path, rises: list[float] = RISES) -> Run:
    run = journal(folder)
    return replace(run, events={**run.events, "sync": [{"t_s": t, "rise_s": t} for t in rises]})


def read(file: str, columns: tuple[str, ...], run: Run) -> Recording:
    """As the command does."""
    reading = Reading((0.0, WINDOW_S), 0.0, column_map(columns))
    return read_recordings([f"bar:3.0={file}"], [], [run], reading)["bar:3"]


@every_format
def test_the_same_rates_whatever_the_format(
    name: str, written: Callable[[str], Path], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    kind, path = FORMATS[name], written(name)
    found = read(f"{path}#{kind.unit}", kind.columns, pulsed(tmp_path))
    assert capfd.readouterr() == ("", "")
    np.testing.assert_array_equal(found.position_mm, list(SPIKES))
    np.testing.assert_array_equal(found.repeats, np.array(list(SPIKES.values())) / WINDOW_S)
    assert len(found.sha256) == 64
    if kind.name.endswith(".nwb"):
        return
    both = read_neo(path, kind.unit, column_map(kind.columns))
    spikes, pulses = np.sort(both.spike_s), both.pulse_s
    for times, expected in ((spikes, UNIT), (pulses, PULSES)):
        assert np.array_equal(times, expected) or not kind.exact
        np.testing.assert_allclose(times, expected, rtol=0, atol=1e-9)


def test_every_format_that_is_called_tried_is_in_the_walk() -> None:
    tried = {one.title for one in (*BY_SUFFIX.values(), OPEN_EPHYS) if one.tried}
    assert tried <= set(FORMATS)


@every_format
def test_without_a_choice_the_error_lists_what_is_in_the_file(
    name: str, written: Callable[[str], Path], tmp_path: Path
) -> None:
    kind, path = FORMATS[name], written(name)
    if name == "NIX, unsorted":
        assert read(str(path), kind.columns, pulsed(tmp_path)).rate.sum() > 0  # its only train needs no choice
    else:
        with raises(RecordingError, "several_units", path=str(path)) as caught:
            read(str(path), kind.columns, pulsed(tmp_path))
        assert kind.unit in str(caught.value)
    with raises(RecordingError, "no_unit", path=str(path), unit="9"):
        read(f"{path}#9", kind.columns, pulsed(tmp_path))
    if kind.columns:
        with raises(RecordingError, "several_channels", path=str(path)) as caught:
            read(f"{path}#{kind.unit}", (), pulsed(tmp_path))
        assert kind.columns[0].partition("=")[2] in str(caught.value)
    with raises(RecordingError, "no_pulses", path=str(path), name="other"):
        read(f"{path}#{kind.unit}", ("sync=other",), pulsed(tmp_path))
    with raises(RecordingError, "number_of_pulses", path=str(path), pulses=4, journalled=3):
        read(f"{path}#{kind.unit}", kind.columns, pulsed(tmp_path, RISES[:3]))


@pytest.mark.parametrize("name", [name for name in FORMATS if "," not in name])
def test_a_truncated_file(name: str, written: Callable[[str], Path], tmp_path: Path) -> None:
    kind, whole = FORMATS[name], written(name)
    for kept in (0, 1, 100, 400):
        path = tmp_path / str(kept) / kind.name
        path.parent.mkdir()
        (shutil.copytree if whole.is_dir() else shutil.copyfile)(whole, path)
        files = [path] if path.is_file() else [one for one in path.rglob("*") if one.suffix in (".npy", ".oebin")]
        for one in files:
            one.write_bytes(one.read_bytes()[:kept])
        with pytest.raises(RecordingError) as caught:
            read(f"{path}#{kind.unit}", kind.columns, pulsed(tmp_path))
        assert caught.value.code in {
            "neo_cannot_read",
            "no_hdf5",
            "truncated_hdf5",
            "no_spikes",
            "no_unit",
            "several_units",
        }, kept
        assert "\n" not in str(caught.value)


ONE, NOT_FINITE = {"unit 1": UNIT}, np.array([1.0, np.nan, 3.0, 4.0])
SEGMENTS: dict[str, Segment] = {
    "as it should be": (ONE, SYNC),
    "no spike": ({"unit 1": np.empty(0)}, SYNC),
    "NaN among spikes": ({"unit 1": NOT_FINITE}, SYNC),
    "NaN among pulses": (ONE, {"sync_pulses": NOT_FINITE}),
    "no events": (ONE, {}),
    "an event too many": (ONE, {"sync_pulses": np.append(PULSES, 300.0)}),
    "pulses elsewhere": (ONE, {"sync_pulses": PULSES + np.array([0, 0.1, 0, 0])}),
    "times of the journal": ({"unit 1": np.array(TIMES)}, {"rewards": OTHER}),
}
"""Of one file: all begin at t_start ≠ 0 and overlap in time; nothing is joined."""


@pytest.fixture(scope="module")
def segments(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return nix(tmp_path_factory.mktemp("segments") / "a.nix", *SEGMENTS.values())


def of_segment(name: str) -> str:
    return f"segment={list(SEGMENTS).index(name) + 1}"


@pytest.mark.parametrize(
    ("columns", "code"),
    [
        ((of_segment("no spike"),), "several_units"),
        ((of_segment("NaN among spikes"),), "not_finite"),
        ((of_segment("NaN among pulses"),), "not_finite"),
        ((of_segment("no events"),), "no_pulses_in_file"),
        ((of_segment("no events"), "sync=none"), "outside_run"),  # on the amplifier's clock
        ((of_segment("pulses elsewhere"),), "pulses_apart"),
        ((of_segment("as it should be"), "sync=none"), "outside_run"),
        ((of_segment("as it should be"), "time=t"), "unused_column"),
        ((), "several_segments"),
        (("segment=99",), "no_segment"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(
    columns: tuple[str, ...], code: str, segments: Path, tmp_path: Path
) -> None:
    run = replace(pulsed(tmp_path), end_s=90.0)
    with raises(RecordingError, code) as caught:
        read(str(segments), columns, run)
    assert "\n" not in str(caught.value)


def test_one_segment_of_several(segments: Path, tmp_path: Path) -> None:
    """Times of the journal need no pulses."""
    rates = np.array(list(SPIKES.values())) / WINDOW_S
    found = read(f"{segments}#unit 1", (of_segment("as it should be"),), pulsed(tmp_path))
    np.testing.assert_array_equal(found.repeats, rates)
    found = read(str(segments), (of_segment("times of the journal"), "sync=none"), journal(tmp_path))
    np.testing.assert_array_equal(found.repeats, rates)


def test_a_file_with_nothing_in_it(tmp_path: Path) -> None:
    with raises(RecordingError, "no_spikes"):
        read(str(nix(tmp_path / "a.nix", ({}, {}))), (), pulsed(tmp_path))


def test_without_neo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.nix"
    path.touch()
    monkeypatch.setitem(__import__("sys").modules, "neo.io", None)
    with raises(RecordingError, "neo_missing", path=str(path)):
        read(str(path), (), pulsed(tmp_path))


@pytest.mark.parametrize("suffix", BY_SUFFIX)
def test_a_file_that_is_not_there_or_of_another_kind(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    with raises(RecordingError, "unreadable", path=str(path)):
        read(str(path), (), pulsed(tmp_path))
    path.write_bytes(b"position_mm,rate\n0,1\n" * 40)
    with raises(RecordingError, "neo_cannot_read", path=str(path)) as caught:
        read(str(path), (), pulsed(tmp_path))
    assert "\n" not in str(caught.value)
