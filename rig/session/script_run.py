"""Run of a script on a rig, and the errors that may end it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rig.devices.base import ForceError, StageError
from rig.engine import Engine, EngineError, ScriptError, TripError
from rig.errors import BadInputError
from rig.protocol.api import Rig
from rig.protocol.handlers import SilentScriptError, impatient
from rig.protocol.script import Script, script_error
from rig.transport import TransportError
from sim.finger_process import FingerLostError

AT_ONCE = "stopped at once by the operator"
FROM_THE_PANEL = "stopped at once from the panel"
ENDINGS = (EngineError, StageError, ForceError, TransportError, FingerLostError)
"""Errors that end a run early; the engine has lifted or stopped before it raises them."""


@contextmanager
def stopped_at_once(
    engine: Engine, stopped: Callable[[], bool] = lambda: False, why: Callable[[], str] = lambda: ""
) -> Iterator[None]:
    """Stop the stage past every queue on a second Ctrl-C or `rig stop`.

    stopped: whether another thread has already stopped it, which then explains any failure. why: reason in words.
    """
    try:
        yield
    except BaseException as error:
        if isinstance(error, Exception) and not stopped():
            raise
        engine.stop()
        reason = with_trip(engine, str(error) if error.args and not isinstance(error, Exception) else why())
        if isinstance(error, Exception):
            raise KeyboardInterrupt(reason) from error
        error.args = (reason,) if reason else ()
        raise


def with_trip(engine: Engine, why: str) -> str:
    """Return the reason of a stop with the trip before it, whose lift it may have interrupted."""
    return f"{engine.problem}; then {why}" if isinstance(engine.problem, TripError) else why


def run_script(script: Script, engine: Engine, rig: Rig) -> None:
    """Run a script. An error outside the engine lifts the indentor, and a trip that the script swallowed is raised.

    A script that makes no step for too long fails; the duration of a step does not count.
    """
    try:
        with impatient():
            script.run(rig)
    except FingerLostError:
        engine.make_safe()
        raise
    except ENDINGS:
        raise
    except (Exception, SystemExit, SilentScriptError) as error:
        engine.make_safe()
        raise script_error(ScriptError, script.path, error, (BadInputError, SilentScriptError)) from error
    if engine.problem is not None:
        raise engine.problem
