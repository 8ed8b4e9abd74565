"""`rig doctor`: what this installation has and where things are."""

import os
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
from serial.tools import list_ports

from rig.cli.looking import contact, in_one_line, look
from rig.cli.options import JsonOption
from rig.cli.output import out, print_json, told_in_one_line
from rig.data.bug_report import LEFT_OUT, bug_report, bundle_name
from rig.devices import catalogue
from rig.plan.config import Config, load_config
from rig.protocol.script import shipped_protocols
from rig.session.bench_problems import bench_problems
from rig.session.calibration import today
from rig.session.resume import left_on_record
from sim.fem import pardiso
from sim.models.cache import KINDS, cache_dir

_PACKAGES = ("indentation-rig", "numpy", "scipy", "h5py", "pydantic", "pyserial", "pymodbus", "matplotlib")


def command(
    config: Annotated[Path | None, typer.Option(metavar="TOML", help="Also look at the devices it names.")] = None,
    bundle: Annotated[
        Path | None,
        typer.Option(metavar="RUN", help="Instead: one file of that run for a bug report, no subject in it."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Print what a bug report should say."""
    with told_in_one_line(as_json=as_json):
        found = _examine(config) if bundle is None else _bundled(bundle, load_config(config))
        if as_json:
            print_json(found)
            return
        for name, value in found.items():
            if isinstance(value, dict):
                value = in_one_line(value) or "none"
            elif isinstance(value, list):
                value = ", ".join(str(v) for v in value) or "none"
            out.print(f"{name:<12}{value}")


def _bundled(run: Path, settings: Config) -> dict[str, Any]:
    """Write the file for a bug report beside where the command is given; what is in it, and what is not."""
    here = _installation(settings)
    told = {name: here[name] for name in ("python", "versions", "devices", "solver", "protocols")}
    to = Path(bundle_name(run))
    shipped = {path.name: path.read_bytes() for path in shipped_protocols().glob("*.py")}
    members = bug_report(run, to, told | {"problems": list(map(str, catalogue.problems()))}, shipped)
    return {"bundle": str(to), "holds": members, "left out": list(LEFT_OUT)}


def _examine(config: Path | None) -> dict[str, Any]:
    settings = load_config(config)
    found = _installation(settings)
    broken = list(map(str, catalogue.problems()))
    if config is not None:
        return found | {"problems": [*broken, *bench_problems(settings)]} | _bench(settings)
    return found | ({"problems": broken} if broken else {})


def _kinds() -> dict[str, str]:
    """Those of packages with their packages."""
    added = catalogue.third_party()
    return {
        kind.room: " ".join(
            f"{name} ({added[f'{kind.room}.{name}']})" if name not in catalogue.built_in(kind.room) else name
            for name in catalogue.names(kind.room)
        )
        for kind in catalogue.KINDS
    }


def _bench(settings: Config) -> dict[str, Any]:
    """On the ports: what answers; how long calibrations hold; how the last run left the indentor."""
    expired = settings.calibration.expired(today())
    left = left_on_record(Path("runs"), settings)
    return look(settings, closely=True) | {
        "calibrated": {
            name: f"{one.value:g}, {'expired' if name in expired else 'until'} {one.expires}"
            for name, one in settings.calibration.measured()
        },
        "contact": contact(settings),
        "last run": left or "clear of the finger, as far as is on record",
    }


def _installation(settings: Config) -> dict[str, Any]:
    folder = cache_dir()
    stored = {kind: list(folder.glob(f"*.{kind}")) for kind in KINDS}
    size = sum(path.stat().st_size for paths in stored.values() for path in paths)
    return {
        "python": f"{platform.python_version()} on {platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "versions": {name: version(name) for name in _PACKAGES},
        "ports": [f"{port.device} ({port.description})" for port in list_ports.comports()],
        "configured": {
            "stage": f"{settings.stage.kind} on {settings.stage.port}",
            "force": f"{settings.force.kind} on {settings.force.port}",
        },
        "devices": _kinds(),
        "limits": settings.limits.model_dump(),
        "solver": "MKL PARDISO"
        if pardiso.available()
        else "nested dissection (portable; MKL PARDISO is not installed)",
        "cache": f"{folder}, {len(stored['model'])} models, {len(stored['answers'])} answers, {size / 1e6:.0f} MB",
        "protocols": [path.stem for path in sorted(shipped_protocols().glob("*.py"))],
    }
