"""Message and exit code of each error of the packages; the only module that imports them all."""

from rig.cli.output import ExitCode
from rig.compare.exceptions import ComparisonError, RecordingError
from rig.data import FolderBusyError, NwbMissingError, RunError
from rig.data.folder import UnwritableError
from rig.devices.base import ForceError, StageError
from rig.engine import EngineError
from rig.errors import BadInputError, code_of
from rig.study.exceptions import StudyError, WorkersError
from rig.transport import TransportError
from sim.contact.shapes import ShapeError
from sim.errors import ModelRangeError
from sim.finger.mesh import MeshError
from sim.finger.surface import SurfaceError
from sim.finger_process import FingerLostError
from sim.measures.receptors import ReceptorError
from sim.models.cache import CacheError

_BAD_INPUT = (
    *(BadInputError, RunError, FolderBusyError, NwbMissingError),
    *(RecordingError, ComparisonError, StudyError, WorkersError),
    *(ShapeError, ModelRangeError, SurfaceError, MeshError, ReceptorError, CacheError),
)


def outcome(error: Exception) -> tuple[str, str, ExitCode] | None:
    """Return the message, its code and the exit code; None for an unforeseen error."""
    code = code_of(error)
    match error:
        case _ if isinstance(error, _BAD_INPUT):
            return str(error), code, ExitCode.BAD_INPUT
        case EngineError() | StageError() | ForceError() | TransportError() | FingerLostError():
            return f"stopped: {error}", code, ExitCode.STOPPED
        case UnwritableError():
            return f"{error}: free disk space, then repeat the command", code, ExitCode.BAD_INPUT
        case OSError():
            what = error.strerror or str(error)
            return f"{error.filename}: {what}" if error.filename else what, code, ExitCode.BAD_INPUT
    return None
