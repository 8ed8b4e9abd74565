"""Run a script on a rig, and what may end it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rig.devices.base import ForceError, StageError
from rig.engine import Engine, EngineError, ScriptError
from rig.errors import BadInputError
from rig.protocol.api import Rig
from rig.protocol.handlers import SilentScriptError, impatient
from rig.protocol.script import Script, said_of_script
from rig.transport import TransportError
from sim.finger_process import FingerLostError

AT_ONCE = "stopped at once by the operator"
FROM_THE_PANEL = "stopped at once from the panel"
ENDINGS = (EngineError, StageError, ForceError, TransportError, FingerLostError)
"""What ends a run before its end: the engine has lifted or stopped before it raises these."""


@contextmanager
def stopped_at_once(
    engine: Engine, stopped: Callable[[], bool] = lambda: False, why: Callable[[], str] = lambda: ""
) -> Iterator[None]:
    """A second Ctrl-C, or `rig stop`, stops the stage past every queue, whatever is being done.

    stopped: whether another thread has done so already; then whatever fails here has failed for that. why: in words.
    """
    try:
        yield
    except BaseException as error:
        if isinstance(error, Exception) and not stopped():
            raise
        engine.stop()
        if isinstance(error, Exception):
            raise KeyboardInterrupt(why()) from error
        error.args = error.args or (why(),)
        raise


def run_script(script: Script, engine: Engine, rig: Rig) -> None:
    """Run it; a failure elsewhere than in the engine lifts the indentor, and no swallowed trip ends well.

    A script that makes no step for too long has failed; what a step takes is none of its silence.
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
        raise said_of_script(ScriptError, script.path, error, (BadInputError, SilentScriptError)) from error
    if engine.problem is not None:
        raise engine.problem
