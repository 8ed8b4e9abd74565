"""JSON schema of what a command prints with `--json`, for `--json-schema`, the documentation and the tests."""

from functools import cache
from importlib import import_module
from typing import Any

from rig.cli.failure import FailureJson
from rig_shared.outputs import schema_of

# Names, so that a schema imports only the modules of its own command.
OUTPUTS = {
    "dry-run": "rig.cli.script_execution:FinishedRunJson",
    "run": "rig.cli.script_execution:FinishedRunJson",
    "identify": "rig.cli.identify_finger:IdentificationJson",
    "check": "rig.cli.run:CheckJson",
    "design": "rig.cli.design:DesignJson rig.cli.design:SessionJson",
    "resume": "rig.cli.script_execution:FinishedRunJson",
    "nerve": "rig.cli.nerve:NerveJson",
    "compare": "rig.compare.comparison_rows:CompareJson rig.cli.compare_group:GroupJson",
    "runs": "rig.cli.runs:RunsJson",
    "show": "rig.cli.runs:ShowJson rig.cli.runs:ColumnsJson",
    "watch": "rig.cli.watch:WatchJson",
    "panel": "rig.cli.panel:PanelJson",
    "export": "rig.cli.runs:ExportJson",
    "study": "rig.cli.study:StudyJson",
    "indent": "rig.cli.indent:IndentJson",
    "impulse": "rig.cli.encode:ImpulseJson",
    "shift-invariance": "rig.cli.encode:ShiftInvarianceJson",
    "encode": "rig.cli.encode:EncodeJson",
    "decode": "rig.cli.decode:DecodeJson",
    "finger": "rig.cli.finger:FingerJson",
    "find": "rig.cli.identify_finger:FindJson",
    "serve": "rig.cli.serve:ServedPortsJson rig.cli.serve:RandomFingerJson",
    "init": "rig.cli.init:InitJson",
    "home": "rig.cli.bench:HomedJson",
    "zero": "rig.cli.bench:ZeroedJson",
    "status": "rig.bench.checks:StatusJson",
    "stop": "rig.cli.stop:StoppedJson rig.cli.stop:NotStoppedJson",
    "pulse": "rig.cli.pulse:SentPulsesJson",
    "jog": "rig.cli.jog:JoggedJson",
    "calibrate": "rig.cli.calibrate:CalibrationJson",
    "bench": "rig.cli.installation:BenchmarkJson",
    "cache": "rig.cli.installation:CacheJson",
    "config": "rig.cli.installation:ConfigurationJson rig.cli.device_catalogue:DeviceCatalogueJson",
    "doctor": "rig.cli.installation:DoctorJson rig.cli.installation:BugReportJson",
}
"""Outputs of each command with --json that succeeds, as module:class; any command may print a failure instead."""


@cache
def schema_of_command(command: str) -> dict[str, Any]:
    """Return the JSON schema (2020-12) of all that a command prints with `--json`."""
    places = (place.split(":") for place in OUTPUTS[command].split())
    outputs = [getattr(import_module(module), name) for module, name in places]
    return schema_of(f"rig {command} --json", [*outputs, FailureJson])
