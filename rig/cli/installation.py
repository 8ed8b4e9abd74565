"""`rig config`, `rig cache`, `rig doctor` and `rig bench`: this installation."""

import os
import platform
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from difflib import get_close_matches
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any, ClassVar, NotRequired

import typer
from serial.tools import list_ports

from rig.bench.checks import (
    ForceLookJson,
    StageLookJson,
    as_words,
    bench_problems,
    expired_calibrations,
    in_one_line,
    look_and_contact,
    sync_problems,
    today,
)
from rig.cli import device_catalogue
from rig.cli.device_catalogue import DeviceKindJson
from rig.cli.options import HTML, FingerConfigOption, JsonOption, checked_file, option
from rig.cli.output import busy, err, out, print_json, print_lines, reporting_errors, writes_json
from rig.cli.progress import counted
from rig.cli.request import Excludes, Needs, Rule, takes
from rig.data.bug_report import LEFT_OUT, bug_report, bundle_name
from rig.data.folder import FileSizeJson
from rig.data.run import PackageJson
from rig.devices import registry
from rig.engine.contact_words import ContactJson
from rig.errors import BadInputError
from rig.plan.config import Config, Key, as_toml, keys, keys_of_other_kinds, load_config
from rig.printable import either
from rig.protocol.script import shipped_protocols
from rig.report.benchmark_page import page
from rig.session.resume import left_on_record
from rig.units import unit_of_key
from rig_shared.outputs import Day, File, Name, Output, Port, Setting, Settings, Time, Unit, listed
from rig_shared.plural import number_of
from sim import benchmark
from sim.benchmark import (
    QUANTITIES,
    QUICK,
    QUICK_SCENES,
    SCENES,
    WHOLE,
    BenchmarkRowJson,
    Measured,
    measure,
    reference_s,
    rows,
    stored,
)
from sim.models.cache import KINDS, CacheEntry, cache_dir, entries, most_bytes, prune

HEAD = """# Configuration reference

Every table and key of a configuration file. `rig config --markdown` writes this page. `rig config` prints the same as
a configuration file to start from, and `rig config KEY` prints one key or table. With `--config rig.toml`, it shows
the values of that file. An unknown key is an error. A key without a default is absent unless you set it.
"""


class BenchmarkJson(Output):
    """All models on this machine."""

    rows: list[BenchmarkRowJson]
    page: File
    reference_s: float


class CacheEntryJson(Output):
    """A cached result."""

    name: Name
    kind: Annotated[str, listed(KINDS)]
    bytes: int
    read_utc: Time


class CacheJson(Output):
    """Cached results."""

    folder: File
    entries: list[CacheEntryJson]
    bytes: int
    limit_gb: float
    removed: int
    removed_bytes: int


class ConfigKeyJson(Output):
    """A key of the configuration; value and default are null where it is not set."""

    key: Name
    value: Setting
    default: Setting
    unit: Unit
    allowed_text: str
    what_text: str


class ConfigurationJson(Output):
    """Keys of the configuration."""

    keys: list[ConfigKeyJson]


class SerialPortJson(Output):
    """A serial port of this machine."""

    port: Port
    description_text: str


class ConfiguredJson(Output):
    """A configured device."""

    kind: Name
    ports: list[Port]


class ConfiguredDevicesJson(Output):
    """Configured devices."""

    stage: ConfiguredJson
    force: ConfiguredJson
    sync: NotRequired[Name]
    """Output for the pulses of the recording amplifier."""


class CalibrationOnRecordJson(Output):
    """A calibration of the configuration."""

    name: Name
    value: float
    unit: Unit
    expires: Day
    expired: bool


class CacheSizeJson(Output):
    """Size of the cache."""

    folder: File
    models: int
    answers: int
    bytes: int


class DoctorJson(Output):
    """Installation; with --config also the devices that answer on the ports."""

    python: Name
    system: Name
    machine: Name
    cores: int | None
    versions: list[PackageJson]
    ports: list[SerialPortJson]
    configured: ConfiguredDevicesJson
    devices: list[DeviceKindJson]
    limits: Settings
    """Table [limits] of the configuration."""
    cache: CacheSizeJson
    protocols: list[Name]
    problems_text: NotRequired[list[str]]
    stage: NotRequired[StageLookJson]
    force: NotRequired[ForceLookJson]
    calibrated: NotRequired[list[CalibrationOnRecordJson]]
    contact: NotRequired[ContactJson]
    last_run_text: NotRequired[str]


class BugReportJson(Output):
    """A file for a bug report."""

    bundle: File
    holds: list[FileSizeJson]
    left_out_text: list[str]


@dataclass(frozen=True)
class ConfigRequest:
    """Arguments and options of `rig config`."""

    key: Annotated[
        str | None, typer.Argument(metavar="KEY", help="Key or table to print, e.g. limits. Default: all.")
    ] = None
    config: FingerConfigOption = None
    devices: Annotated[
        bool, option("Print what each kind of device was tested with, and its speed.", name="--devices")
    ] = False
    markdown: Annotated[bool, option("Print a Markdown table for the documentation.", name="--markdown")] = False
    as_json: JsonOption = False

    rules: ClassVar[Sequence[Rule]] = (Excludes("KEY", ("--devices",), "not_together"),)


@takes(ConfigRequest)
def config_command(request: ConfigRequest) -> None:
    """Print a configuration file with a comment on each key, or on one key or table if named."""
    if request.devices:
        _print_devices(markdown=request.markdown)
        return
    loaded = load_config(request.config)
    others = keys_of_other_kinds(loaded) if request.markdown or request.key is not None else ()
    found = _named([*keys(loaded), *others], request.key)
    if writes_json():
        configuration: ConfigurationJson = {"keys": [_described(one) for one in found]}
        print_json(configuration)
    else:
        out.print(_page(found) if request.markdown else _file(found), end="")


def _print_devices(*, markdown: bool) -> None:
    """Print the catalogue of devices."""
    if writes_json():
        catalogue: device_catalogue.DeviceCatalogueJson = {"devices": device_catalogue.as_json()}
        print_json(catalogue)
        return
    text = device_catalogue.as_markdown() if markdown else device_catalogue.as_text()
    out.print(text, end="")


def _named(every: Sequence[Key], name: str | None) -> list[Key]:
    """Return all keys, those of a table and its tables, or those of a name; raise BadInputError if unknown."""
    if name is None:
        return list(every)
    found = [one for one in every if name in (one.place, one.name) or f"{one.place}.".startswith(f"{name}.")]
    if not found:
        whole = "." in name
        known = dict.fromkeys(word for one in every for word in (one.place if whole else one.name, one.table))
        near = either(get_close_matches(name, known, n=2)) or "a key or table that `rig config` lists"
        raise BadInputError(f"{name}: there is no such key; use {near}", "unknown_key")
    return found


def _file(found: Sequence[Key]) -> str:
    tables = groupby(found, lambda one: one.table)
    return "\n".join(f"[{table}]\n" + "".join(one.lines for one in members) for table, members in tables)


def _page(found: Sequence[Key]) -> str:
    parts = [HEAD]
    for table, members in groupby(found, lambda one: one.table):
        parts += [f"\n## `[{table}]`\n\n| key | default | unit and range | what it is |\n|---|---|---|---|\n"]
        parts += [_row(one) for one in members]
    return "".join(parts)


def _row(one: Key) -> str:
    default = "" if one.default is None else f"`{as_toml(one.default)}`"
    return f"| `{one.name}` | {default} | {one.allowed_in_words.replace('|', 'or')} | {one.what} |\n"


def _described(one: Key) -> ConfigKeyJson:
    return {
        "key": one.place,
        "value": one.value,
        "default": one.default,
        "unit": one.unit,
        "allowed_text": one.allowed,
        "what_text": one.what,
    }


_ABOUT = {
    "model": "condensed finger models",
    "node": "full builds for interpolation",
    "columns": "strain responses, one file per set of receptors",
    "skin": "apex lines of skins",
    "answers": "simulated responses to runs",
    "sites": "SED under point loads at the 24 sites of the source",
}


@dataclass(frozen=True)
class CacheRequest:
    """Options of `rig cache`."""

    prune: Annotated[bool, option("Delete the least recently used entries.", name="--prune")] = False
    keep_gb: Annotated[float, option("Size of recent entries that --prune retains, in GB.", "G", min=0)] = 0.0
    as_json: JsonOption = False

    rules: ClassVar[Sequence[Rule]] = (Needs("--keep-gb", ("--prune",)),)


@takes(CacheRequest)
def cache_command(request: CacheRequest) -> None:
    """List cached results; with --prune delete the least recently used ones."""
    limit_gb = most_bytes() / 1e9
    removed = prune(1e9 * request.keep_gb) if request.prune else []
    kept = entries()
    if writes_json():
        cache: CacheJson = {
            "folder": str(cache_dir()), "entries": [_as_json(entry) for entry in kept], "bytes": _bytes(kept),
            "limit_gb": limit_gb, "removed": len(removed), "removed_bytes": _bytes(removed),
        }  # fmt: skip
        print_json(cache)
        return
    _print(kept, limit_gb)
    if request.prune:
        out.print(f"removed     {number_of(len(removed), 'files')}, {_megabytes(removed)}")


def _print(kept: Sequence[CacheEntry], limit_gb: float) -> None:
    out.print(f"folder      {cache_dir()} (RIG_CACHE_DIR)")
    for kind in KINDS:
        them = [entry for entry in kept if entry.kind == kind]
        if them:
            last = f"read last on {_read(them[0]):%Y-%m-%d}, least recently on {_read(them[-1]):%Y-%m-%d}"
            out.print(f"{kind:<12}{number_of(len(them), 'files')}, {_megabytes(them)}: {_ABOUT[kind]}; {last}")
    out.print(
        f"total       {_megabytes(kept)}; above {limit_gb:g} GB (RIG_CACHE_GB) the least recently read "
        "entries are deleted"
    )


def _as_json(entry: CacheEntry) -> CacheEntryJson:
    read = _read(entry).isoformat(timespec="seconds")
    return {"name": entry.path.name, "kind": entry.kind, "bytes": entry.size, "read_utc": read}


def _read(entry: CacheEntry) -> datetime:
    return datetime.fromtimestamp(entry.read_ns / 1e9, UTC)


def _bytes(them: Sequence[CacheEntry]) -> int:
    return sum(entry.size for entry in them)


def _megabytes(them: Sequence[CacheEntry]) -> str:
    return f"{_bytes(them) / 1e6:.1f} MB"


_PACKAGES = ("indentation-rig", "numpy", "scipy", "h5py", "pydantic", "pyserial", "pymodbus", "matplotlib")


@reporting_errors
def doctor_command(
    config: Annotated[Path | None, option("Configuration whose devices are checked. Default: none.", "TOML")] = None,
    bundle: Annotated[Path | None, option("Write a bug report of this run, without its subject.", "RUN")] = None,
    as_json: JsonOption = False,
) -> None:
    """Print the contents of a bug report."""
    found: DoctorJson | BugReportJson
    if bundle is None:
        with busy("asking ports and devices …", quick=True):
            found = doctor = _examine(config)
        lines = _lines(doctor)
    else:
        with busy("writing the bug report …", quick=True):
            found = report = _bundled(bundle, load_config(config))
        lines = _bundle_lines(report)
    if writes_json():
        print_json(found)
    else:
        print_lines(((name, value or "none") for name, value in lines.items()), 12)


def _bundled(run: Path, settings: Config) -> BugReportJson:
    """Write the file for a bug report to the current folder, and return its contents and omissions."""
    here = _installation(settings)
    about = ("python", "system", "machine", "cores", "versions", "devices", "protocols")
    contents: dict[str, object] = {name: here.get(name) for name in about}
    to = Path(bundle_name(run))
    shipped = {path.name: path.read_bytes() for path in shipped_protocols().glob("*.py")}
    members = bug_report(run, to, contents | {"problems": list(map(str, registry.problems()))}, shipped)
    holds: list[FileSizeJson] = [{"name": name, "bytes": size} for name, size in members.items()]
    return {"bundle": str(to), "holds": holds, "left_out_text": list(LEFT_OUT)}


def _examine(config: Path | None) -> DoctorJson:
    settings = load_config(config)
    found = _installation(settings)
    broken = list(map(str, registry.problems()))
    if config is not None:
        bench, left = look_and_contact(settings, closely=True), left_on_record(Path("runs"), settings)
        devices = {"stage": bench["stage"], "force": bench["force"]}
        silent = [f"{name}: {one['problem_text']}" for name, one in devices.items() if "problem_text" in one]
        found["problems_text"] = [
            *broken, *bench_problems(settings), *expired_calibrations(settings), *silent, *sync_problems(settings),
        ]  # fmt: skip
        found["stage"], found["force"], found["contact"] = bench["stage"], bench["force"], bench["contact"]
        found["calibrated"] = _calibrations(settings)
        found["last_run_text"] = left or "no run on record left the indentor at the finger"
    elif broken:
        found["problems_text"] = broken
    return found


def _lines(found: DoctorJson) -> dict[str, str]:
    """Return the same for people, by the name of the line."""
    cache, bench = found["cache"], dict[str, str]()
    if "calibrated" in found:
        bench |= {
            "stage": in_one_line(found["stage"]),
            "force": in_one_line(found["force"]),
            "contact": in_one_line(found["contact"]),
        }
        bench["calibrated"] = ", ".join(map(_calibrated, found["calibrated"]))
        bench["last run"] = found["last_run_text"]
    if "problems_text" in found:
        bench["problems"] = ", ".join(found["problems_text"])
    return {
        "python": f"{found['python']} on {found['system']} {found['machine']}, {found['cores']} cores",
        "versions": ", ".join(f"{one['package']} {one['version']}" for one in found["versions"]),
        "ports": ", ".join(f"{one['port']} ({one['description_text']})" for one in found["ports"]),
        "configured": ", ".join(
            f"{room} {one['kind']} on {as_words(one['ports'])}"
            for room, one in (("stage", found["configured"]["stage"]), ("force", found["configured"]["force"]))
        )
        + (f", pulses on {found['configured']['sync']}" if "sync" in found["configured"] else ""),
        "devices": ", ".join(f"{kind.room} {' '.join(_named_kinds(found, kind.room))}" for kind in registry.KINDS),
        "limits": in_one_line(found["limits"]),
        "cache": f"{cache['folder']}, {cache['models']} models, {cache['answers']} answers, "
        f"{cache['bytes'] / 1e6:.0f} MB",
        "protocols": ", ".join(found["protocols"]),
        **bench,
    }


def _bundle_lines(found: BugReportJson) -> dict[str, str]:
    return {
        "bundle": found["bundle"],
        "holds": ", ".join(f"{one['name']} {one['bytes']}" for one in found["holds"]),
        "left out": ", ".join(found["left_out_text"]),
    }


def _named_kinds(found: DoctorJson, room: registry.Room) -> Iterator[str]:
    for one in found["devices"]:
        if one["role"] == room:
            yield one["kind"] if one["package"] is None else f"{one['kind']} ({one['package']})"


def _calibrated(one: CalibrationOnRecordJson) -> str:
    return f"{one['name']} {one['value']:g}, {'expired' if one['expired'] else 'until'} {one['expires']}"


def _calibrations(settings: Config) -> list[CalibrationOnRecordJson]:
    """Return the calibrations of a configuration, and how long they are valid."""
    expired = settings.calibration.expired(today())
    return [
        {
            "name": name,
            "value": one.value,
            "unit": unit_of_key(name) or "1",
            "expires": one.expires.isoformat(),
            "expired": name in expired,
        }
        for name, one in settings.calibration.measured()
    ]


def _configured(settings: Config) -> ConfiguredDevicesJson:
    found: ConfiguredDevicesJson = {
        "stage": {"kind": settings.stage.kind, "ports": list(registry.stage_ports(settings.stage))},
        "force": {"kind": settings.force.kind, "ports": [settings.force.port]},
    }
    if settings.sync.output != "off":
        found["sync"] = settings.sync.output
    return found


def _installation(settings: Config) -> DoctorJson:
    folder = cache_dir()
    stored = {kind: list(folder.glob(f"*.{kind}")) for kind in KINDS}
    size = sum(path.stat().st_size for paths in stored.values() for path in paths)
    return {
        "python": platform.python_version(),
        "system": platform.system(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "versions": [{"package": name, "version": version(name)} for name in _PACKAGES],
        "ports": [{"port": port.device, "description_text": port.description} for port in list_ports.comports()],
        "configured": _configured(settings),
        "devices": device_catalogue.kinds(),
        "limits": settings.limits.model_dump(),
        "cache": {
            "folder": str(folder),
            "models": len(stored["model"]),
            "answers": len(stored["answers"]),
            "bytes": size,
        },
        "protocols": [path.stem for path in sorted(shipped_protocols().glob("*.py"))],
    }


_STEPS = ("mesh", "assembly", "condensation", "inverse", "receptors")


@reporting_errors
def speed_command(
    quick: Annotated[bool, option("Measure coarse meshes only (about 2 min).", name="--quick")] = False,
    page_file: Annotated[Path, option("HTML page to write.", "HTML", name="--out")] = Path("bench.html"),
    as_json: JsonOption = False,
) -> None:
    """Benchmark every model, element and refinement in its own process, and write the page."""
    checked_file("--out", page_file, *HTML)
    start = time.perf_counter()
    reference = stored()
    measured = []
    candidates = QUICK if quick else WHOLE
    found_one = measure(candidates, QUICK_SCENES if quick else SCENES)
    for found in counted(found_one, len(candidates), "candidates"):
        measured.append(found)
        err.print(f"{_name(found)}: {found.nodes} nodes, {found.build_s:.1f} s, {found.memory_mb:.0f} MB")
    with busy("reference computation …", quick=True):
        table, unit_s = list(rows(measured, reference)), reference_s()
    with busy("comparing with CalculiX …", quick=True):
        calculix = _calculix(quick=quick)
    text = page(
        table,
        machine=f"{platform.machine()}, {os.cpu_count()} processors, Python {platform.python_version()}",
        wall_s=time.perf_counter() - start,
        quick=quick,
        quantities=QUANTITIES,
        reference=reference,
        reference_s=unit_s,
        steps=_STEPS,
        breakdown=[_breakdown(found) for found in measured if found.candidate.model == "finger"],
        **calculix,
    )
    page_file.write_text(text, encoding="utf-8")
    if writes_json():
        found_all: BenchmarkJson = {"rows": table, "page": str(page_file), "reference_s": unit_s}
        print_json(found_all)
    else:
        out.print(f"{page_file}: {number_of(len(measured), 'candidates')}, {time.perf_counter() - start:.0f} s")
        out.print(f"reference computation: {unit_s:.3f} processor seconds")


def _name(found: Measured) -> str:
    return f"{found.candidate.model} {found.candidate.element} {found.candidate.refinement}"


def _breakdown(found: Measured) -> dict[str, Any]:
    return {
        "name": _name(found),
        "timing": found.timing_s,
        "factor_s": found.factor_s,
        "contact_s": found.contact_s,
        "limit_s": found.limit_s,
    }


def _calculix(*, quick: bool) -> dict[str, Any]:
    if quick:
        return {"calculix": None, "no_calculix": "skipped with --quick"}
    if not benchmark.available():
        return {"calculix": None, "no_calculix": "ccx is not installed (Debian: apt-get install calculix-ccx)"}
    return {"calculix": asdict(benchmark.compare()), "no_calculix": ""}
