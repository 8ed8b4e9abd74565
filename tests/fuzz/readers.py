"""Every reader of a file that a person can name, or that the program finds in a folder: examples and the call."""

import io
import json
import os
import shutil
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any, cast

import h5py
import numpy as np
from PIL import Image

from rig.cli.error_exit_codes import outcome
from rig.cli.output import ExitCode
from rig.cli.runs import export_command, runs_command, show_command
from rig.cli.watch import watch_command
from rig.compare.plausible_fingers import read_plausible
from rig.compare.recordings.afferents_table import read_afferents
from rig.compare.recordings.columns import column_map
from rig.compare.recordings.deflection import read_skin_deflection
from rig.compare.recordings.reading import Reading, read_recordings
from rig.control.client import Announced, announced, lock_of
from rig.control.stage_alone import NoStageError, stage_alone
from rig.data.bug_report import bug_report, bundle_name
from rig.data.index import INDEX, listed
from rig.data.run_state import Course
from rig.engine.bench_memory import BenchMemory, LastKnown
from rig.panel.run_view import RunView
from rig.plan.config import config_from, load_config
from rig.plan.finger_file import read_finger_file
from rig.protocol.script import load_script
from rig.report.recording_sections import read_deflections
from rig.session.resume import left_on_record, read_stopped
from rig.study.parameter_study import read_study
from rig_shared.errors import CodedError
from sim.coding.decoder_results import CodingError
from sim.coding.readings_file import read_pressures, read_readings
from sim.config import FingertipConfig
from sim.contact.shapes import parse_shape
from sim.models import cache as model_cache
from sim.tables import TableError
from tests.rig.compare import test_every_kind_of_recording as recorded
from tests.rig.compare import test_neo_file as neo_files
from tests.rig.identify.finger_file import SERIES, identified_file

ROOT = Path(__file__).parents[2]
EXAMPLES, OLD = ROOT / "examples", ROOT / "tests" / "data" / "runs"


@dataclass(frozen=True)
class Reader:
    """A reader of files.

    Attributes
    ----------
    file : str
        Name of the file, below an empty folder.
    examples : callable
        Makes valid files, in a scratch folder.
    read : callable
        Reads the file at a path.
    beside : callable, optional
        Lays other files beside it, once.
    writes : tuple of str
        Patterns of files that the call may write, relative to the folder.
    in_suite : int
        Hostile files that `make test` reads; `make shake` reads a multiple of them.
    """

    file: str
    examples: Callable[[Path], Sequence[bytes]]
    read: Callable[[Path], object]
    beside: Callable[[Path], object] = lambda _: None
    writes: tuple[str, ...] = ()
    in_suite: int = 50


BY_COMMANDS = (TableError, CodingError, NoStageError)
"""Errors that commands print in a sentence of their own."""


def failure_of(read: Callable[[Path], object], path: Path) -> str:
    """Return what is wrong with how a file was read; empty for a success, or one line with a code."""
    said = io.StringIO()
    try:
        with redirect_stderr(said), redirect_stdout(io.StringIO()):
            read(path)
    except SystemExit as ended:
        *before, last = [line for line in said.getvalue().splitlines() if not line.endswith("…")] or [""]
        # What is left out of a run, and that it is incomplete, may be said before.
        notes = (" is damaged, line ", ": the run is incomplete (")
        lines = [*(line for line in before if not any(note in line for note in notes)), last]
        if ended.code not in tuple(ExitCode) or len(lines) != 1 or not lines[0].startswith("rig: "):
            return f"ended with {ended.code!r}: {said.getvalue()[:500]!r}"
    except BY_COMMANDS:
        return ""
    except Exception as error:
        found = outcome(error)
        known = found is not None and (isinstance(error, CodedError) or getattr(error, "errno", None) is not None)
        if not known or not str(error).strip():
            return f"{type(error).__name__}: {str(error)[:500]!r}"
    return ""


# --- examples ---


def _files(*paths: Path) -> Callable[[Path], list[bytes]]:
    return lambda _: [path.read_bytes() for path in paths]


def _texts(*texts: str) -> Callable[[Path], list[bytes]]:
    return lambda _: [text.encode() for text in texts]


def _finger_files(_: Path) -> list[bytes]:
    series: tuple[tuple[tuple[float, float], ...], ...] = ((), SERIES)
    return [identified_file(relaxation=one, draws=4).as_toml().encode() for one in series]


STUDY = """
receptor_depth_mm = [0.7, 0.9]
[finger.tissue]
epidermis_mm = [0.3, 0.5]
[[press]]
shape = "cylinder:9"
force_gwt = [1.0]
x_mm = [0.0, 0.5]
[[press]]
shape = "bar:3.0"
doi_mm = [0.2, 0.4]
"""
PROFILE = "x_mm,height_mm\n-1.0,0.3\n-0.5,0.1\n0.0,0.0\n0.5,0.1\n1.0,0.3\n"
MAP_POINTS = "x_mm,z_mm,height_mm\n" + "".join(
    f"{x / 2},{z / 2},{(x * x + z * z) / 40}\n" for x in range(-2, 3) for z in range(-2, 3)
)
MAP_ROWS = "".join(",".join(f"{(x * x + z * z) / 40}" for x in range(-3, 4)) + "\n" for z in range(-2, 3))
ROW = """# a row of receptors, pressed; from 0.17 to 1.2 mm apart
place_mm,depth_mm,sed_pa,at_rest
-2.10,0.76,91.0,4.1
-1.45,0.80,212.4,-6.0
-0.60,0.71,655.2,2.2
0.00,0.76,802.9,-3.3
0.85,0.78,498.7,5.1
1.90,0.74,120.3,-1.9
"""
SHEET = "x_mm,z_mm,depth_mm,rate,sd\n" + "".join(
    f"{x},{z},0.76,{20 - x * x},1.5\n" for x in (-1.0, 0.0, 1.0) for z in (4.6, 5.7, 6.9)
)
RATES = "position_mm,rate,sd\n-1.0,2,0.5\n-0.5,10,1\n0,30,2\n0.5,12,1\n1.0,1,0.5\n"
REPEATS = "position_mm;rate;repeat\n-1,0;2,5;1\n-1,0;3,5;2\n0,0;30;1\n0,0;28,5;2\n1,0;1;1\n1,0;0;2\n"
COUNTS = "position_mm,count,window_s\n-1.0,2,0.5\n-0.5,10,0.5\n0,30,0.5\n0.5,12,0.5\n1.0,1,0.5\n"
SKIN = "x_mm,z_mm,deflection_mm\n-2,5,0.1\n0,5,0.4\n2,5,0.1\n0,7,0.3\n"
AXIAL = "z_mm,deflection_mm,doi_mm\n3,0.1,0.5\n5,0.4,0.5\n7,0.1,0.5\n3,0.2,1.0\n5,0.9,1.0\n"
AFFERENTS = "afferent,shape,force_gwt,file\na1,step:1,4,rates.csv\na2,step:1,4,counts.csv\na3,bar:3.0,,rates2.csv\n"
SCRIPT = '''"""Presses."""
from rig.protocol import Field, ProtocolParameters
METADATA = {"title": "Bar", "source": "a test"}
class Parameters(ProtocolParameters):
    doi_mm: float = Field(0.4, gt=0, le=1.5)
def run(rig):
    rig.mount("bar:3.0")
'''


def _spike_rows(_: Path) -> list[bytes]:
    rows = [f"{time:.6f},spike" for time in recorded.TIMES] + [f"{time:.6f},sync" for time in neo_files.RISES]
    alone = "\n".join(["time_s", *(f"{time:.6f}" for time in recorded.TIMES)])
    return [alone.encode(), "\n".join(["time_s,kind", *rows]).encode()]


def _nwb(folder: Path) -> list[bytes]:
    one = neo_files.nwb(folder / "one.nwb")
    with h5py.File(one, "r+") as file:
        file["units/id"][0] = 7
    with h5py.File(folder / "other.nwb", "w") as file:
        file["units/id"] = [7]
        file.create_dataset("units/spike_times", data=neo_files.UNIT, chunks=True, compression="gzip")
        file["units/spike_times_index"] = [len(neo_files.UNIT)]
        file["intervals/sync_pulses/start_time"] = neo_files.PULSES
        file["units"].attrs["colnames"] = ["spike_times"]
    return [one.read_bytes(), (folder / "other.nwb").read_bytes()]


def _by_neo(name: str) -> Callable[[Path], list[bytes]]:
    kind = neo_files.FORMATS[name]
    return lambda folder: [kind.write(folder / kind.name).read_bytes()]


def _open_ephys(folder: Path) -> None:
    with TemporaryDirectory() as made:
        shutil.copytree(neo_files.open_ephys(Path(made) / "a"), folder, dirs_exist_ok=True)


OEBIN = "a/Record Node 101/experiment1/recording1/structure.oebin"
STAMPS = "a/Record Node 101/experiment1/recording1/events/TTL/timestamps.npy"


def _inside(name: str) -> Callable[[Path], list[bytes]]:
    return lambda folder: [(neo_files.open_ephys(folder / "a").parent / name).read_bytes()]


def _arrays(_: Path) -> list[bytes]:
    x = np.linspace(-1, 1, 12)
    found = []
    for array in (0.1 * (x**2 + x[:, None] ** 2), np.zeros((4, 5), dtype=np.int16)):
        stream = io.BytesIO()
        np.save(stream, array)
        found.append(stream.getvalue())
    return found


def _pictures(_: Path) -> list[bytes]:
    grey = (np.hypot(*np.mgrid[-6:7, -6:7]) * 25).clip(0, 255).astype(np.uint8)
    found = []
    for image in (
        Image.fromarray(grey),
        Image.fromarray(np.stack([grey] * 3 + [255 - grey], axis=-1)),
        Image.fromarray(grey.astype(np.uint16) * 200),
        Image.fromarray(grey).convert("P"),
        Image.fromarray(grey).convert("1"),
    ):
        stream = io.BytesIO()
        image.save(stream, "png")
        found.append(stream.getvalue())
    return found


def _journals(_: Path) -> list[bytes]:
    """Journals of whole and of stopped runs, with few readings."""
    found = []
    for name in ("complete", "complete_with_a_schedule", "stopped"):
        kept: list[bytes] = []
        for line in (OLD / name / "events.jsonl").read_bytes().splitlines():
            reading = b'sample"' in line and b'"doc": "event"' in line
            if not (reading and kept and b'sample"' in kept[-1] and b'"doc": "event"' in kept[-1]):
                kept.append(line)
        found.append(b"\n".join(kept) + b"\n")
    return found


def _short_journals(folder: Path) -> list[bytes]:
    return [b"\n".join(one.splitlines()[:90]) + b"\n" for one in _journals(folder)]


def _of_runs(name: str) -> Callable[[Path], list[bytes]]:
    return _files(OLD / "stopped" / name)


COURSE = {"duration_s": 9.0, "passes": [["mount", 1, 0, 0.0, "mount bar:3.0"], ["indentation_start", 0, 0, 1.0, "",
          {"block": 1, "repeat": 1, "condition": "0.4"}], ["hold_end", 0, 1, 3.0, ""]]}  # fmt: skip
BYTES = '{"t_s": 0.0, "port": "a", "to": "?"}\n{"t_s": 0.1, "port": "a", "from": "<Idle>"}\n' * 5
NOTE = {"pid": 1, "kind": "run", "virtual": True, "ports": ["a"], "began_unix_s": 1.0, "address": "/nowhere/socket",
        "key": "00" * 32}  # fmt: skip
KNOWN = {"zero_offset_n": 0.1, "zero_noise_gwt": 0.01, "zero_unix_s": 1.0, "left_at_mm": [1.0, 2.0, 3.0]}


def _model_files(_: Path) -> list[bytes]:
    content = model_cache._packed({"a": np.arange(5.0), "b": np.eye(3)})
    return [model_cache._seal("key", content) + bytes(content)]


def _indexes(folder: Path) -> list[bytes]:
    shutil.copytree(OLD / "complete", folder / "runs" / "complete")
    listed(folder / "runs")
    return [(folder / "runs" / INDEX).read_bytes()]


# --- calls ---


@cache
def _finger() -> FingertipConfig:
    return FingertipConfig()


def _skin(name: str) -> Callable[[Path], object]:
    tables = tomllib.loads((EXAMPLES / "own_finger" / f"{name}.toml").read_text(encoding="utf-8"))

    def read(path: Path) -> object:
        tables["finger"]["geometry"][name] = path.name
        return config_from("a configuration", tables, path.parent)

    return read


def _recording(unit: str = "", *columns: str) -> Callable[[Path], object]:
    reading = Reading((0.0, recorded.WINDOW_S), 0.0, column_map(columns))

    def read(path: Path) -> object:
        run = recorded.journal(path.parent)
        run = replace(run, events={**run.events, "sync": [{"t_s": t, "rise_s": t} for t in neo_files.RISES]})
        return read_recordings([f"bar:3.0={path}{unit}"], [], [run], reading)

    return read


def _spikes_in_a_table(path: Path) -> object:
    columns = () if b"sync" in path.read_bytes() else ("sync=none",)
    return _recording("", *columns)(path)


def _open_ephys_recording(levels: int) -> Callable[[Path], object]:
    read = _recording("#TTL/1", "sync=TTL/2")
    return lambda path: read(path.parents[levels])


def _afferents(path: Path) -> object:
    stimuli = [SimpleNamespace(shape=shape, condition="4 gwt") for shape in ("step:1", "bar:3")]
    return read_afferents(path, [], [], cast(Any, stimuli), Reading())


def _beside_the_table(path: Path) -> None:
    for name, text in (("rates", RATES), ("counts", COUNTS), ("rates2", REPEATS)):
        (path.parent / f"{name}.csv").write_text(text, encoding="utf-8")


def _run_folder(path: Path) -> None:
    for name in ("config.toml", "provenance.json", "protocol.py", "SHA256SUMS"):
        shutil.copyfile(OLD / "stopped" / name, path.parent / name)
    (path.parent / "events.jsonl").write_bytes(_short_journals(path)[-1])
    (path.parent / "timeline.json").write_text(json.dumps(COURSE), encoding="utf-8")


def _panel(path: Path) -> None:
    seen = RunView(path.parent)
    seen.look(1.0)


def _resume(path: Path) -> object:
    return read_stopped(path.parent)


def _bundle(path: Path) -> object:
    to = path.parent / "out" / bundle_name(path.parent)
    to.parent.mkdir(exist_ok=True)
    return bug_report(path.parent, to, {}, {})


def _all_of(*calls: Callable[[Path], object]) -> Callable[[Path], object]:
    """Return a call that makes all calls, and ends as the first that does not succeed."""

    def read(path: Path) -> None:
        failed: BaseException | None = None
        for call in calls:
            try:
                call(path)
            except SystemExit as ended:
                failed = ended
            except Exception as error:
                if outcome(error) is None and not isinstance(error, BY_COMMANDS):
                    raise
                failed = error
        if isinstance(failed, Exception):
            raise failed

    return read


def _memory(path: Path) -> LastKnown:
    memory = BenchMemory(load_config(None))
    memory._path = path
    return memory.read()


_LIVING: list[Any] = []


def _owner_lives(path: Path) -> None:
    path.parent.chmod(0o700)
    _LIVING.append(lock_of(path))
    _LIVING[-1].acquire()


def _owners(path: Path) -> list[Announced]:
    with _environment("RIG_RUNTIME_DIR", path.parent):
        return announced()


@contextmanager
def _environment(name: str, value: Path) -> Iterator[None]:
    before = os.environ.get(name)
    os.environ[name] = str(value)
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


RUN_WRITES = ("*/out", "*/out/*", "*/*.csv", "*/data.h5", "*/SHA256SUMS", "*/.lock", "*/.rig.lock", f"*{INDEX}*")

READERS: dict[str, Reader] = {
    "configuration": Reader(
        "rig.toml",
        _files(OLD / "small.toml", OLD / "complete" / "config.toml"),
        load_config,
        in_suite=25,
    ),
    "configuration, for a stop": Reader(
        "rig.toml", _files(OLD / "small.toml"), stage_alone,
        in_suite=25,
    ),
    "identified finger": Reader("finger.toml", _finger_files, read_finger_file,
        in_suite=31,
    ),
    "plausible fingers": Reader(
        "fingers.toml",
        lambda folder: [
            *_files(*sorted((EXAMPLES / "plausible_fingers").glob("*.toml")))(folder), *_finger_files(folder)
        ],
        read_plausible,
        in_suite=50,
    ),
    "parameter study": Reader("study.toml", _texts(STUDY), read_study),
    "points of a skin": Reader(
        "points.csv", _files(EXAMPLES / "own_finger" / "synthetic_larger_finger_points.csv"),
        _skin("points"),
        in_suite=25,
    ),
    "sections of a finger": Reader(
        "sections.csv", _files(EXAMPLES / "own_finger" / "synthetic_larger_finger_sections.csv"),
        _skin("sections"),
        in_suite=25,
    ),
    "profile": Reader("a.csv", _texts(PROFILE), lambda path: parse_shape(f"profile:{path}")),
    "profile of lines": Reader(
        "a.csv", _texts(PROFILE), lambda path: parse_shape(f"profile:{path},linear")
    ),
    "height map of points": Reader(
        "a.csv", _texts(MAP_POINTS), lambda path: parse_shape(f"heightmap:{path},edge_mm=0.5,raised=low")
    ),
    "height map of rows": Reader(
        "a.csv",
        _texts(MAP_ROWS),
        lambda path: parse_shape(f"heightmap:{path},spacing_mm=0.2,raised=low"),
        in_suite=25,
    ),
    "height map, NumPy": Reader(
        "a.npy", _arrays, lambda path: parse_shape(f"heightmap:{path},spacing_mm=0.2,raised=low"),
        in_suite=50,
    ),
    "height map, picture": Reader(
        "a.png", _pictures, lambda path: parse_shape(f"heightmap:{path},width_mm=4,height_mm=0.3"),
        in_suite=19,
    ),
    "table of rates or counts": Reader("a.csv", _texts(RATES, REPEATS, COUNTS), _recording()),
    "table with named columns": Reader(
        "a.csv", _texts(COUNTS), _recording("", "count=count,position=position_mm,window=0.5")
    ),
    "spike times": Reader("a.csv", _spike_rows, _spikes_in_a_table,
        in_suite=50,
    ),
    "spike times, NWB": Reader("a.nwb", _nwb, _recording("#7"),
        in_suite=31,
    ),
    "spike times, NIX": Reader("a.nix", _by_neo("NIX"), _recording("#unit 1"),
        in_suite=1,
    ),
    "spike times, Spike2": Reader(
        "a.smr", _by_neo("Spike2"), _recording("#unit 1", "sync=pulses"), in_suite=6
    ),
    "spike times, Plexon": Reader(
        "a.plx", _by_neo("Plexon"), _recording("#ch1#1", "sync=pulses"), in_suite=6
    ),
    "spike times, NeuroExplorer": Reader(
        "a.nex", _by_neo("NeuroExplorer"), _recording("#unit 1", "sync=pulses"), in_suite=6
    ),
    "spike times, Blackrock": Reader("a.nev", _by_neo("Plexon"), _recording("#ch1#1"), in_suite=6),
    "Open Ephys, structure": Reader(
        OEBIN, _inside(OEBIN), _open_ephys_recording(3),
        beside=lambda path: _open_ephys(path.parents[3]), in_suite=6,
    ),
    "Open Ephys, times": Reader(
        STAMPS, _inside(STAMPS), _open_ephys_recording(5),
        beside=lambda path: _open_ephys(path.parents[5]), in_suite=6,
    ),
    "table of afferents": Reader("a.csv", _texts(AFFERENTS), _afferents, beside=_beside_the_table,
        in_suite=31,
    ),
    "deflection of the skin": Reader("a.csv", _texts(SKIN), read_skin_deflection),
    "deflection along the finger": Reader("a.csv", _texts(AXIAL), read_deflections),
    "readings of a row": Reader("a.csv", _texts(ROW), lambda path: read_readings(path, _finger()),
        in_suite=7,
    ),
    "readings of a sheet": Reader("a.csv", _texts(SHEET), lambda path: read_readings(path, _finger()),
        in_suite=10,
    ),
    "pressures": Reader("a.csv", _texts("pressure\n0\n1\n5\n2\n0\n"), read_pressures),
    "script": Reader("a.py", _texts(SCRIPT), lambda path: load_script(str(path))),
    "journal": Reader(
        "run/events.jsonl", _short_journals,
        _all_of(
            lambda path: show_command(run=path.parent, as_json=True),
            lambda path: show_command(run=path.parent),
            lambda path: watch_command(path.parent, as_json=True),
            lambda path: runs_command(runs=path.parents[1], as_json=True),
            _panel,
            _bundle,
        ),
        beside=_run_folder, writes=RUN_WRITES,
        in_suite=6,
    ),
    "journal, exported": Reader(
        "run/events.jsonl", _short_journals, lambda path: export_command(run=path.parent, as_csv=True),
        beside=_run_folder, writes=RUN_WRITES,
        in_suite=1,
    ),
    "journal, resumed": Reader(
        "run/events.jsonl", _short_journals, _resume, beside=_run_folder,
        writes=("*/events.jsonl", *RUN_WRITES),
        in_suite=19,
    ),
    "provenance": Reader(
        "run/provenance.json", _of_runs("provenance.json"),
        _all_of(
            _resume, lambda path: show_command(run=path.parent), _bundle,
            lambda path: left_on_record(path.parents[1], load_config(None)),
        ),
        beside=_run_folder, writes=RUN_WRITES,
        in_suite=5,
    ),
    "configuration of a run": Reader(
        "run/config.toml", _of_runs("config.toml"),
        _all_of(_resume, lambda path: show_command(run=path.parent), _panel),
        beside=_run_folder, writes=RUN_WRITES,
        in_suite=7,
    ),
    "checksums": Reader(
        "run/SHA256SUMS", _of_runs("SHA256SUMS"), _resume, beside=_run_folder, writes=RUN_WRITES,
        in_suite=37,
    ),
    "script of a run": Reader(
        "run/protocol.py", _of_runs("protocol.py"), _all_of(_resume, _bundle), beside=_run_folder,
        writes=RUN_WRITES,
        in_suite=7,
    ),
    "course of a run": Reader(
        "run/timeline.json", _texts(json.dumps(COURSE)),
        _all_of(lambda path: Course.load(RunView(path.parent).folder), _panel, _bundle),
        beside=_run_folder, writes=RUN_WRITES,
        in_suite=7,
    ),
    "byte log": Reader(
        "run/bytes.jsonl", _texts(BYTES), _bundle, beside=_run_folder, writes=RUN_WRITES,
        in_suite=7,
    ),
    "index of runs": Reader(
        f"runs/{INDEX}", _indexes, lambda path: runs_command(runs=path.parent, as_json=True),
        beside=lambda path: shutil.copytree(OLD / "complete", path.parent / "complete"),
        writes=(f"*{INDEX}*",),
        in_suite=10,
    ),
    "memory of a bench": Reader("a.json", _texts(json.dumps(KNOWN)), _memory),
    "notes of owners": Reader(
        "a.json", _texts(json.dumps(NOTE)), _owners, beside=_owner_lives, in_suite=25
    ),
    "model in the cache": Reader(
        "a.model", _model_files, lambda path: model_cache._read(path, "key", None)
    ),
}  # fmt: skip

NOT_READ = {"spike times, Blackrock"}
"""Readers without an example that they read."""
