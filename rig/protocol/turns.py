"""Turns of a script: its verbs come one at a time, from its own thread and process, until it ends or is stopped."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from rig.errors import BadInputError, RunAborted


class _Script:
    """A script under way; `stop` is what a stop raised in one of its verbs."""

    def __init__(self) -> None:
        self.pid = os.getpid()
        self.stop: BaseException | None = None

    def refuse_stopped(self) -> None:
        """Raise the stop again, which the script has swallowed."""
        if self.stop is not None:
            raise self.stop


class _InThisThread(threading.local):
    def __init__(self) -> None:
        self.scripts: list[_Script] = []  # the innermost is last


_here = _InThisThread()


def take_over() -> None:
    """Continue the script in this process, which was forked from its own; the parent must not continue it."""
    for script in _here.scripts:
        script.pid = os.getpid()


@contextmanager
def script_under_way() -> Iterator[None]:
    """Carry out a script here; a stop that it swallowed is raised at its end.

    A process that the script has forked ends with it: journal and ports belong to its parent.
    """
    script, code = _Script(), 1
    _here.scripts.append(script)
    try:
        yield
        code = 0
    except SystemExit as left:
        code = 1 if left.code else 0
        raise
    finally:
        if script.pid != os.getpid():
            os._exit(code)
        _here.scripts.remove(script)
    script.refuse_stopped()


class Turns:
    """Turns of one `Rig`, which belongs to the thread that made it, and to the script that first calls a verb."""

    def __init__(self) -> None:
        self._thread, self._pid = threading.get_ident(), os.getpid()  # the process counts where there is no script
        self._script: _Script | None = None
        self._begun = self._within = False

    @contextmanager
    def verb(self, name: str) -> Iterator[None]:
        """Carry out a verb. Raises BadInputError if it is not its turn; again what stopped the script."""
        script = _here.scripts[-1] if _here.scripts else None
        if not self._begun:
            self._script, self._begun = script, True
        pid = self._pid if self._script is None else self._script.pid
        own = (self._thread, pid) == (threading.get_ident(), os.getpid()) and script is self._script
        if not own or self._within:
            raise BadInputError(
                f"{name}: called in another thread or process, within another verb, or after the end of run(rig); "
                "call the verbs one after the other, in the thread of run(rig)",
                "out_of_turn",
            )
        if script is not None:
            script.refuse_stopped()
        try:
            self._within = True
            yield
        except BaseException as error:
            if script is not None and (isinstance(error, RunAborted) or not isinstance(error, Exception)):
                script.stop = error
            raise
        finally:
            self._within = False
