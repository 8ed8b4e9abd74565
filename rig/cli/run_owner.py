"""What owns the ports is announced from its first second to its last, and answers whatever its main thread does."""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, Literal

import filelock

from rig.cli.interrupts import Pause, interrupt_main, stoppable, unstoppable
from rig.cli.output import complain
from rig.data import FolderBusyError, RunFolder
from rig.plan.config import Config
from rig.protocol.script import Script
from rig.session.control.announcements import Announcement
from rig.session.control.control_socket import ControlSocket
from rig.session.control.recorded_stop import record_after, record_before
from rig.session.control.stage_in_hand import StageInHand
from rig.session.control.stop_switch import StopSwitch, answer_to_a_stop
from rig.session.resume import StoppedRun
from rig.session.session import NewRun
from rig.session.stop_button import StopButton
from rig.transport.clock import WallClock

Phase = Literal["planning", "running", "reporting"]


class Owner:
    """A run that others may ask: what it is at, a pause, that it goes on, a stop. Nothing here waits for the run."""

    def __init__(self, switch: StopSwitch, *, virtual: bool) -> None:
        self.switch, self.pause, self.virtual = switch, Pause(), virtual
        self.folder: RunFolder | None = None
        self.button: StopButton | None = None
        self.told: Callable[[Path], None] = lambda run: None
        self._phase: Phase = "planning"
        self._asks = False
        self._stopped_while = "planning"

    @property
    def answers(self) -> Mapping[str, Callable[[Mapping[str, Any]], dict[str, Any]]]:
        """By the requests of a run."""
        return {"status": self._status, "stop": self._stop, "pause": self._pause, "go_on": self._go_on}

    @property
    def state(self) -> str:
        """In one word."""
        if self._asks:
            return "asking"
        if self._phase != "running" or not self.pause.asked():
            return self._phase
        return "paused" if self.pause.waits else "pausing"

    def at(self, phase: Phase) -> None:
        """The main thread begins with something else."""
        self._phase = phase
        self.switch.ready()

    @contextmanager
    def asking(self) -> Iterator[None]:
        """While a person is asked."""
        self._asks = True
        try:
            yield
        finally:
            self._asks = False

    def begins(self, folder: RunFolder) -> None:
        """The run has its folder, and its ports are open."""
        self.folder = folder
        with suppress(OSError):  # its journal says it, too
            self.told(folder.path)

    def stopped(self) -> bool:
        """Whether somebody has stopped the stage from elsewhere; asked by the main thread."""
        return self.switch.noticed()

    def record(self, script: Script, config: Config, into: NewRun | StoppedRun) -> None:
        """See to it that a stop is in the byte log and the journal, if there was one; from here on none is taken."""
        with unstoppable():
            self.switch.over()
            if not self.switch.stopped:
                return
            try:
                if self.folder is None:
                    self.folder = record_before(script, config, into, virtual=self.virtual)
                    complain(f"the stop is recorded in {self.folder.path}")
                record_after(self.folder, self._stopped_while, self.switch.kept)
            except (OSError, FolderBusyError) as error:
                complain(f"the stop could not be recorded: {error}")

    def _status(self, _: Mapping[str, Any]) -> dict[str, Any]:
        run = None if self.folder is None else str(self.folder.path)
        found = {"state": self.state, "run": run, "stopped": self.switch.stopped}
        return found if self.button is None else found | {"stop_button": self.button.last_state}

    def _stop(self, _: Mapping[str, Any]) -> dict[str, Any]:
        self._stopped_while = self.state
        return answer_to_a_stop(self.switch.stop)

    def _pause(self, _: Mapping[str, Any]) -> dict[str, Any]:
        if self._phase != "running":
            return {"ok": False, "problem": f"it is {self.state}: there is nothing to pause"}
        if not self.pause.asked():
            self.pause.ask_from_elsewhere()
        return {"state": self.state}

    def _go_on(self, _: Mapping[str, Any]) -> dict[str, Any]:
        if self._phase != "running" or not self.pause.asked():
            return {"ok": False, "problem": f"it is {self.state}: it is not paused"}
        self.pause.go_on_from_elsewhere()
        return {"state": self.state}


@contextmanager
def owning(
    script: Script,
    config: Config,
    into: NewRun | StoppedRun,
    stage: StageInHand | None = None,
    config_file: Path | None = None,
) -> Iterator[Owner]:
    """Announce a run, and record the stop that came from elsewhere, if one came.

    stage: None for a virtual bench. It is closed by the caller, when nobody can ask any more. Where the run cannot be
    announced it goes on all the same, and says that no panel can reach it. A stop is recorded, or refused, whenever
    it comes between the announcement and its end.
    """
    out, virtual = into.out if isinstance(into, NewRun) else into.folder.path.parent, stage is None
    owner = Owner(StopSwitch(stage, interrupt_main), virtual=virtual)
    about = Announcement(
        pid=os.getpid(),
        kind="run",
        virtual=virtual,
        ports=() if virtual else (*config.stage.ports, config.force.port),
        out=str(out.resolve()),
        protocol=script.name,
        config=None if config_file is None else str(config_file.resolve()),
        began_unix_s=WallClock().unix_s(),
    )
    with stoppable(), ExitStack() as announced:
        if stage is not None and (config.stop.kind != "off" or config.stop.inputs):
            owner.button = announced.enter_context(StopButton(config.stop, stage, owner.switch.stop))
        try:
            socket = announced.enter_context(ControlSocket(about, owner.answers))
            owner.told = lambda run: socket.tell(run=str(run.resolve()))
        except (OSError, filelock.Timeout) as error:
            complain(f"warning: no panel can reach this run: {error}")
        announced.callback(owner.record, script, config, into)
        try:
            owner.switch.begins()
            yield owner
        finally:
            owner.switch.over()  # what was on its way ends here; recorded is then what nothing can interrupt
