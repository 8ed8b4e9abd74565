"""`rig by-hand`: own the ports of a configuration while somebody works at the bench through the panel."""

import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from typing import Any

from rig.cli.interrupts import asked_to_leave, at_once
from rig.cli.options import ConfigOption
from rig.cli.output import complain, told_in_one_line
from rig.engine.by_hand.bench_memory import BenchMemory
from rig.plan.config import Config, load_config
from rig.session.by_hand.at_hand import unfelt
from rig.session.by_hand.hand_log import HandLog
from rig.session.by_hand.hand_owner import HandOwner
from rig.session.control.announcements import Announcement
from rig.session.control.control_socket import ControlSocket
from rig.session.control.stage_in_hand import StageInHand
from rig.session.real_bench import PortError, RealBench, open_bench
from rig.session.stop_button import StopButton
from rig.transport.clock import WallClock

Answers = Mapping[str, Callable[[Mapping[str, Any]], Mapping[str, Any]]]


def command(config: ConfigOption) -> None:
    """What rig panel starts; it ends with it, at rest. It is ready when it has announced itself."""
    with told_in_one_line(as_json=False), at_once():
        settings, clock, parent = load_config(config), WallClock(), os.getppid()
        known = BenchMemory(settings).read()  # a bench that is open says no more
        with (
            HandLog(clock) as log,
            closing(StageInHand(settings, clock)) as stage,
            closing(_bench(settings, log, stage)) as bench,
            ExitStack() as opened,
        ):
            button = opened.enter_context(StopButton(settings.stop, stage, stage.stop))
            button.arm()
            owner = HandOwner(settings, bench, stage.gate, log, known)
            announcement = Announcement(
                pid=os.getpid(), kind="by hand", virtual=False, ports=(*settings.stage.ports, settings.force.port),
                config=os.path.abspath(config), began_unix_s=clock.unix_s(),
            )  # fmt: skip
            with owner.begun(), asked_to_leave(owner.leave), ControlSocket(announcement, _answers(owner, button)):
                owner.run(lambda: os.getppid() != parent)
            if log.problem is not None:
                complain(f"what was done by hand is not logged from some moment on: {log.problem}")


def _answers(owner: HandOwner, button: StopButton) -> Answers:
    """Those of the bench, and how the participant's stop button is where there is one."""
    if not button.there:
        return owner.answers
    status = owner.answers["status"]
    return {**owner.answers, "status": lambda told: {**status(told), "stop_button": button.last_state}}


def _bench(settings: Config, log: HandLog, stage: StageInHand) -> RealBench:
    try:
        return open_bench(settings, stage.clock, log, ask=lambda request: "", in_hand=stage)
    except PortError as error:
        raise unfelt(error) if error.device == "force" else error from None
