"""Spikes of a simulated amplifier come back on the run's clock, through every kind of file; all of it is synthetic.

A dry run sends its pulses on a virtual output that knows when it really rose. The amplifier records these rises on
its own clock, misses one and has one more, and records spikes at known times of the run.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import neo
import numpy as np
import pytest
import quantities as pq

import rig.bench.sync_line as lines
import rig.session.session as sessions
from rig.compare.recordings.columns import column_map
from rig.compare.recordings.reading import Reading, read_recordings
from rig.compare.recordings.spike_times import SpikeTimes
from rig.compare.recordings.spikes import read_spike_times
from rig.compare.spike_clock import recording_sentences, recordings_as_json
from rig.data import Run, read_run
from rig.plan.config import Config
from rig.plan.plan import make_plan
from rig.protocol.script import load_script
from rig.session.session import NewRun, Session, dry_run
from sim.devices.sync_line import VirtualSyncLine
from sim.models.fingertip import Fingertip
from tests.rig.compare.recording_files import Array, nwb, spikes_csv, syncs, write_nix

WITHIN_S = {"an adapter": 0.0005, "a GRBL board": 0.0005, "a Leadshine drive": 0.00125}
"""Of a drive, whose confirmation takes 3.4 ms, the spikes come back to a millisecond."""
SAMPLES_HZ = 30_000.0
OFFSET_S, DRIFT = 12.5, 100e-6
SCRIPT = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    for x_mm in (-0.5, -0.25, 0.0, 0.25, 0.5, 0.75):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.2, hold_s=1)
"""


class Pulsed(NamedTuple):
    """A dry run, and when its output truly rose (s of the run)."""

    run: Run
    rise_s: Array


class Recorded(NamedTuple):
    """A simulated amplifier's recording: drift of its clock, the pulse that it missed and where it has one more."""

    drift: float
    missed: int
    extra_run_s: float

    def file_s(self, run_s: Any) -> Array:
        """Its own clock."""
        return np.asarray(OFFSET_S + np.asarray(run_s) * (1 + self.drift))

    def pulse_s(self, rise_s: Array) -> Array:
        """The pulses as it has them."""
        return np.sort(self.file_s(np.append(np.delete(rise_s, self.missed), self.extra_run_s)))


def _levels(rise_s: Array) -> np.ndarray[Any, np.dtype[np.float32]]:
    values = np.zeros(int((rise_s.max() + 1) * SAMPLES_HZ), dtype=np.float32)
    for rise in rise_s:
        values[int(np.ceil(rise * SAMPLES_HZ)) : int((rise + 0.01) * SAMPLES_HZ)] = 5.0
    return values


def _nix(spike_s: Array, **of_the_segment: list[Any]) -> Callable[[Path], str]:
    def write(folder: Path) -> str:
        path, segment = folder / "synthetic.nix", neo.Segment()
        segment.spiketrains.append(neo.SpikeTrain(spike_s, units="s", t_start=0, t_stop=spike_s.max() + 60, name="u"))
        for name, values in of_the_segment.items():
            getattr(segment, name).extend(values)
        return write_nix(path, segment)

    return write


WRITERS: dict[str, Callable[[Array, Array], Callable[[Path], str]]] = {
    "NWB, intervals": lambda spike_s, pulse_s: nwb(
        units__spike_times=spike_s, intervals__sync_pulses__start_time=pulse_s
    ),
    "NWB, a sampled line": lambda spike_s, pulse_s: nwb(
        units__spike_times=spike_s, acquisition__sync_pulses__data=_levels(pulse_s),
        acquisition__sync_pulses__starting_time=0.0,
        **{"acquisition__sync_pulses__starting_time.rate": SAMPLES_HZ},
    ),
    "NIX, events": lambda spike_s, pulse_s: _nix(
        spike_s, events=[neo.Event(pulse_s, labels=["sync"] * len(pulse_s), units="s", name="sync_pulses")]
    ),
    "NIX, a sampled line": lambda spike_s, pulse_s: _nix(
        spike_s, analogsignals=[neo.AnalogSignal(
            _levels(pulse_s), units="V", sampling_rate=SAMPLES_HZ * pq.Hz, name="sync_pulses")],
    ),
    "CSV": lambda spike_s, pulse_s: spikes_csv(*syncs(pulse_s), spikes=spike_s.tolist()),
}  # fmt: skip
AMPLIFIERS = {
    "100 ppm fast": Recorded(DRIFT, 4, 7.77),
    "100 ppm slow": Recorded(-DRIFT, 4, 7.77),
    "the first pulse missed": Recorded(DRIFT, 0, 33.3),
    "the last pulse missed, one more after it": Recorded(DRIFT, -1, 70.01),
}
OUTPUTS = {
    "an adapter": {"sync": {"output": "rts:/dev/ttyUSB9"}},
    "a GRBL board": {"sync": {"output": "coolant"}},
    "a Leadshine drive": {
        "stage": {"kind": "leadshine"},
        "sync": {"output": "drive", "register_address": 0x0157, "on_word": 0x80, "off_word": 0},
    },
}
TABLE = [(output, amplifier, file) for output in OUTPUTS for amplifier in AMPLIFIERS for file in WRITERS]


@pytest.fixture(scope="module")
def pulsed(finger: Fingertip, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Pulsed]:
    """A dry run of six presses with each output."""
    found = {}
    for output, tables in OUTPUTS.items():
        folder = tmp_path_factory.mktemp("pulsed")
        (folder / "six.py").write_text(SCRIPT, encoding="utf-8")
        script, config = load_script(str(folder / "six.py")), Config.model_validate(tables)
        session = Session(script, config, finger, make_plan(script, config, finger), NewRun(folder / "runs"))
        with _true_edges() as edges:
            done = dry_run(session)
        (switched,) = filter(None, edges)
        run = read_run(done.folder.path)
        found[output] = Pulsed(run, np.array([at_s for at_s, _ in switched][::2]))
        known_ms = [1000 * one["uncertainty_s"] for one in run.stream("sync")]
        print(f"{output}: rise known to {np.median(known_ms):.2f} ms (median), {max(known_ms):.2f} ms (worst)")
    return found


@contextmanager
def _true_edges() -> Iterator[list[Any]]:
    """Yield the edges of the board's output and of the adapter's line, of a dry run in this block."""
    edges, usual = list[Any](), sessions.virtual_bench

    def virtual_bench(*given: Any) -> Any:
        bench = usual(*given)
        edges.append(getattr(bench.board, "z", bench.board).outputs)
        return bench

    def line(clock: Any) -> VirtualSyncLine:
        made = VirtualSyncLine(clock)
        edges.append(made.edges)
        return made

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sessions, "virtual_bench", virtual_bench)
        patch.setattr(lines, "VirtualSyncLine", line)
        yield edges


def _read(pulsed: Pulsed, amplifier: Recorded, file: str, folder: Path) -> tuple[SpikeTimes, Array]:
    spike_s = np.sort(np.random.default_rng(1).uniform(1.0, pulsed.rise_s.max(), 300))
    write = WRITERS[file](amplifier.file_s(spike_s), amplifier.pulse_s(pulsed.rise_s))
    columns = column_map(("sync=sync_pulses",) if "sampled" in file or "NIX" in file else ())
    return read_spike_times(Path(write(folder)), pulsed.run, columns=columns), spike_s


@pytest.mark.parametrize(("output", "amplifier", "file"), TABLE)
def test_spikes_of_an_amplifier_with_its_own_clock_come_back_within_the_uncertainty_of_the_output(
    output: str, amplifier: str, file: str, pulsed: dict[str, Pulsed], tmp_path: Path
) -> None:
    recorded = AMPLIFIERS[amplifier]
    times, spike_s = _read(pulsed[output], recorded, file, tmp_path)
    worst_s = float(np.abs(times.spike_s - spike_s).max())
    print(f"synthetic, {output}, {amplifier}, {file}: worst {1000 * worst_s:.3f} ms")
    assert worst_s <= WITHIN_S[output]
    assert 1000 * worst_s <= times.clock.known_ms + 0.01
    assert times.clock.drift_ppm == pytest.approx(1e6 * recorded.drift, abs=10)
    assert times.clock.unpaired is not None
    made = pulsed[output].run.stream("sync")
    missed = made[recorded.missed]
    assert times.clock.unpaired.missing == ((missed["index"], missed["at"]),)
    assert times.clock.unpaired.presses == ()
    assert times.clock.unpaired.others_s == pytest.approx([recorded.extra_run_s], abs=WITHIN_S[output])
    assert f"press {missed['index']} ({missed['at']}) a pulse is missing" in times.clock.text
    assert f"pulses without a press at {times.clock.unpaired.others_s[0]:.3f} s" in times.clock.text


WINDOW = Reading((0.0, 0.5))
LOST: dict[str, tuple[tuple[int, ...], tuple[int, ...], str]] = {
    "none": ((), (), "Every press has its pulses, within 5 ms."),
    "the adapter, from press 4 on": ((4, 5), (), "In the file, within 5 ms: presses 4 and 5 without any pulse."),
    "the amplifier, in press 2": ((), (2,), "In the file, within 5 ms: press 2 without any pulse."),
}
"""Presses whose pulses were not sent, those whose pulses are not in the file, and the sentence."""


@pytest.mark.parametrize("lost", LOST)
def test_every_press_without_a_pulse_is_named_on_page_terminal_and_json(
    lost: str, pulsed: dict[str, Pulsed], tmp_path: Path
) -> None:
    unsent, unheard, sentence = LOST[lost]
    run, rise_s = pulsed["an adapter"]
    made = run.stream("sync")
    run = replace(run, events={**run.events, "sync": [one for one in made if one["index"] not in unsent]})
    kept = np.array([one["index"] not in (*unsent, *unheard) for one in made])
    amplifier = Recorded(DRIFT, 0, 0.0)
    path = WRITERS["CSV"](amplifier.file_s(rise_s + 0.1), amplifier.file_s(rise_s[kept]))(tmp_path)
    found = read_recordings([f"bar:3.0={path}"], [], [run], WINDOW)
    ((key, recording),) = found.items()
    assert sentence in " ".join(recording_sentences(recording))
    (printed,) = recordings_as_json({"": {key: recording}})
    assert printed["clock"] is not None
    assert sentence in printed["clock"]["clock_text"]
    assert printed["clock"]["known_ms"] == pytest.approx(0.5)
    assert printed["clock"]["unpaired"] is not None
    assert printed["clock"]["unpaired"]["presses"] == [*unsent, *unheard]
    assert printed["clock"]["unpaired"]["tolerance_s"] == 0.005
    assert {one["press"] for one in printed["clock"]["unpaired"]["missing"]} == set(unheard)
