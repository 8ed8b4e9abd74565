"""Message and exit code of each error of the packages.

Errors are known by name: importing their classes would load engine and solver only to print one line.
"""

from rig.cli.output import ExitCode
from rig_shared.errors import code_of

BAD_INPUT = {
    "rig.errors:BadInputError",
    "rig.data.run:RunError",
    "rig.data.folder:FolderBusyError",
    "rig.data.export:NwbMissingError",
    "rig.data.lsl:LslMissingError",
    "rig.compare.exceptions:RecordingError",
    "rig.compare.exceptions:ComparisonError",
    "rig.design.exceptions:DesignError",
    "rig.study.exceptions:StudyError",
    "rig.study.exceptions:WorkersError",
    "sim.contact.shapes:ShapeError",
    "sim.errors:ModelRangeError",
    "sim.finger.surface:SurfaceError",
    "sim.finger.mesh:MeshError",
    "sim.measures.receptors:ReceptorError",
    "sim.models.cache:CacheError",
}
STOPPED = {
    "rig.errors:EngineError",
    "rig.devices.base:StageError",
    "rig.devices.base:ForceError",
    "rig.transport.wire:TransportError",
    "sim.finger_process:FingerLostError",
}
UNWRITABLE = {"rig.data.folder:UnwritableError"}


def outcome(error: Exception) -> tuple[str, str, ExitCode] | None:
    """Return the message, its code and the exit code; None for an unforeseen error."""
    code, classes = code_of(error), {f"{one.__module__}:{one.__qualname__}" for one in type(error).__mro__}
    if classes & BAD_INPUT:
        return str(error), code, ExitCode.BAD_INPUT
    if classes & STOPPED:
        return f"stopped: {error}", code, ExitCode.STOPPED
    if classes & UNWRITABLE:
        from rig.data.folder import how_to_write  # loaded only for an error

        return f"{error}: {how_to_write(error)}, then repeat the command", code, ExitCode.BAD_INPUT
    if isinstance(error, OSError):
        what = error.strerror or str(error)
        return f"{error.filename}: {what}" if error.filename else what, code, ExitCode.BAD_INPUT
    return None
