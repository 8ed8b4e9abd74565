"""Drawings made in a process of its own, which solves what must be solved while the server answers."""

import contextlib
import multiprocessing
import signal
import threading
from multiprocessing.connection import Connection
from typing import Any

from rig.errors import RigError
from rig.panel.drawn.job import Job
from sim.workers import give_way, leaving_ctrl_c_to_us

PATIENCE_S = 120.0
"""A larger patch takes a minute on a busy machine; what takes longer is not waited for."""
_GIVES_WAY = 10
"""To whoever moves something, and to the model that they wait for."""

Drawing = dict[str, Any]
"""Of `section`, with `prediction` where there is a press, or a `problem`."""


class DrawingError(RigError):
    """There is no drawing. One line."""

    default_code = "not_drawn"


class DrawingProcess:
    """One job at a time; begun with the first, and anew where it is lost."""

    def __init__(self) -> None:
        self._process: multiprocessing.process.BaseProcess | None = None
        self._near: Connection[Job, Drawing] | None = None
        self._changing = threading.Lock()

    def ask(self, job: Job) -> Drawing:
        """Waits for it. Raises DrawingError; what cannot be drawn is a `problem` in it."""
        try:
            near = self._begun()
            near.send(job)
            if near.poll(PATIENCE_S):
                return near.recv()
        except (EOFError, OSError):
            self.close()
            raise DrawingError("the process that draws has ended", code="process_ended") from None
        self.close()
        raise DrawingError("not drawn within {within_s:g} s", code="too_slow", within_s=PATIENCE_S)

    def close(self) -> None:
        """End it."""
        with self._changing:
            process, near = self._process, self._near
            self._process = self._near = None
        if process is not None and near is not None:
            process.kill()  # first: whoever waits for its answer sees that it has ended
            process.join()
            near.close()

    def _begun(self) -> "Connection[Job, Drawing]":
        with self._changing:
            if self._near is None:
                context = multiprocessing.get_context("spawn")
                self._near, far = context.Pipe()
                self._process = context.Process(target=_serve, args=(far,), daemon=True)
                with leaving_ctrl_c_to_us():
                    self._process.start()
                far.close()
            return self._near


def _serve(far: "Connection[Drawing, Job]") -> None:
    give_way(_GIVES_WAY)
    from rig.panel.drawn.drawing import drawn  # solver and libraries: here alone

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(EOFError, OSError):
        while True:
            far.send(drawn(far.recv()))
