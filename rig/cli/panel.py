"""`rig panel` and `rig by-hand`: the page in a browser, and the process that owns the bench for it."""

import os
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from rig.bench.real import PortError, RealBench, open_bench
from rig.cli.options import ConfigOption, JsonOption, option
from rig.cli.output import complain, err, out, print_json, reporting_errors, resting, writes_json
from rig.cli.request import takes
from rig.cli.signals import at_once, leaving_on_signal
from rig.clock import WallClock
from rig.control.client import Announcement
from rig.control.owned_stage import OwnedStage
from rig.control.owner_socket import ControlSocket
from rig.devices.registry import stage_ports
from rig.engine.bench_memory import BenchMemory
from rig.errors import BadInputError
from rig.manual.owner_process import ManualOwner
from rig.manual.session import no_force_readings
from rig.manual.status import ManualLog
from rig.plan.config import Config, load_config
from rig.session.hardware_stop import StopButton
from rig_shared.outputs import Output, Uri

_LOWEST_PORT = 1024


class PanelJson(Output):
    """Address of the panel."""

    url: Uri
    port: int
    pid: int


@dataclass(frozen=True)
class PanelRequest:
    """Options of `rig panel`."""

    config: Annotated[Path | None, option("Configuration of the rig. Default: manual control off.", "TOML")] = None
    out_dir: Annotated[Path, option("Folder that contains the run folders.", "DIR", name="--out")] = Path("runs")
    port: Annotated[int, option("TCP port on this machine, 1024 to 65535; 0 selects a free port.", "N")] = 0
    browser: Annotated[bool, option("Open the page in a browser, or do not.", name="--browser/--no-browser")] = True
    as_json: JsonOption = False


@takes(PanelRequest)
def panel_command(request: PanelRequest) -> None:
    """Print the address of the page, and serve it until Ctrl-C; a run continues without it."""
    if request.port != 0 and not _LOWEST_PORT <= request.port <= 65535:
        raise BadInputError(
            f"--port {request.port}: must be {_LOWEST_PORT} to 65535, or 0 for a free port", "outside_range"
        )
    from rig.panel.app import Offered, Panel  # rig by-hand starts without a web server

    panel = Panel(Offered(request.out_dir, request.config, request.port))
    if writes_json():
        found: PanelJson = {"url": panel.url, "port": panel.port, "pid": os.getpid()}
        print_json(found)
    else:
        out.print(panel.url)
        err.print("press Ctrl-C to close the panel; a running protocol continues")
    with _shown(panel.url) if request.browser and not writes_json() else nullcontext(), resting():
        panel.serve()


@contextmanager
def _shown(url: str) -> Iterator[None]:
    """Open the page in the browser from a file that only this user can read, since command lines are public."""
    from rig.control.client import runtime_folder

    leads_there = runtime_folder() / f"panel-{os.getpid()}.html"
    page = f'<!doctype html><meta http-equiv="refresh" content="0; url={url}"><a href="{url}">rig panel</a>\n'
    with open(os.open(leads_there, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w", encoding="utf-8") as file:
        file.write(page)
    try:
        webbrowser.open(leads_there.as_uri())
        yield
    finally:
        leads_there.unlink(missing_ok=True)


Answers = Mapping[str, Callable[[Mapping[str, Any]], Mapping[str, Any]]]


@reporting_errors
def owning_command(config: ConfigOption) -> None:
    """Own the ports for `rig panel`, and end with it, at rest; ready once it has announced itself."""
    with at_once():
        settings, clock, parent = load_config(config), WallClock(), os.getppid()
        known = BenchMemory(settings).read()  # an open bench adds nothing
        with (
            ManualLog(clock) as log,
            closing(OwnedStage(settings, clock)) as stage,
            closing(_bench(settings, log, stage)) as bench,
            ExitStack() as opened,
        ):
            button = opened.enter_context(StopButton(settings.stop, stage, stage.stop))
            button.arm()
            owner = ManualOwner(settings, bench, stage.gate, log, known)
            announcement = Announcement(
                pid=os.getpid(), kind="by hand", virtual=False, config=os.path.abspath(config),
                ports=(*stage_ports(settings.stage), settings.force.port), began_unix_s=clock.unix_s(),
            )  # fmt: skip
            with (
                owner.begun(),
                leaving_on_signal(owner.leave),
                ControlSocket(announcement, _answers(owner, button)),
                resting(),
            ):
                owner.run(lambda: os.getppid() != parent)
            if log.problem is not None:
                complain(f"the log of manual control is incomplete: {log.problem}")


def _answers(owner: ManualOwner, button: StopButton) -> Answers:
    """Return the handlers of the bench, and the state of the participant's stop button if there is one."""
    if not button.there:
        return owner.answers
    status = owner.answers["status"]
    return {**owner.answers, "status": lambda request: {**status(request), "stop_button": button.last_state}}


def _bench(settings: Config, log: ManualLog, stage: OwnedStage) -> RealBench:
    try:
        return open_bench(settings, stage.clock, log, ask=lambda request: "", in_hand=stage)
    except PortError as error:
        raise no_force_readings(error) if error.device == "force" else error from None
