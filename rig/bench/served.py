"""Virtual bench in real time, behind ports that any program can open."""

import sys
from collections.abc import Callable
from contextlib import ExitStack
from typing import TypeVar

from rig.bench.virtual import (
    load_on_sensor,
    refuse_twinless,
    relaxation,
    true_carriage,
    truth,
    virtual_force,
    virtual_line,
    virtual_stage,
    wire_hardware_trip,
    with_framing,
    with_kinds,
)
from rig.devices.registry import StageKind, find, kind_of
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.settings import ForceSettings, StageSettings
from sim.carriage import Carriage
from sim.contact.shapes import parse_shape
from sim.devices.line import Load, SerialLine, VirtualStage
from sim.serve.force_process import FingerNotLoadedError, PressProcess, TrajectoryProcess
from sim.serve.ports import PortBusyError, PtyPort, TcpPort, UdpPort
from sim.serve.prefetch import ForcePrefetcher, PressAhead, PressStatistics, TrajectoryPrefetcher
from sim.serve.real_time_loop import WallScheduler

Process = TypeVar("Process", PressProcess, TrajectoryProcess)


class ServedBench:
    """Served stage, force sensor or both, with a finger between them; close it, or use it in a `with`.

    ports: names by which clients open the devices; those of further ports of a stage have the name of their key.
    pages: numbers of the TCP ports of web pages, by their keys. tables: table of the configuration that names each.
    """

    def __init__(
        self,
        config: Config,
        *,
        stage: str | None,
        force: str | None,
        tcp: int | None = None,
        complain: Callable[[str], object] = print,
    ) -> None:
        """Start the devices; return when all of them respond. Raises BadInputError.

        stage, force: kinds of device, None for none. tcp: number of the first port; None: pseudo-terminals, or free
        TCP ports on Windows.
        """
        if tcp is None and sys.platform == "win32":  # without pseudo-terminals
            tcp = 0
        config = with_framing(with_kinds(config, stage, force), "rtu" if tcp is None else "tcp")
        self.scheduler = WallScheduler()
        self.ports: dict[str, str] = {}
        self.pages: dict[str, int] = {}
        self.tables = {"stage": "stage", "force": "force"}
        self.press: ForcePrefetcher | None = None
        self._tcp = tcp
        self._refusing: list[TcpPort | UdpPort] = []
        self._closing = ExitStack()
        self._closing.callback(self.scheduler.close)
        try:
            self._build(config, stage, force, complain)
        except PortBusyError as error:
            self.close()
            raise BadInputError(f"{error}; choose another number for --tcp", error.code) from None
        except FingerNotLoadedError as error:
            self.close()
            raise BadInputError(str(error), error.code) from None
        except BaseException:
            self.close()
            raise

    @property
    def statistics(self) -> PressStatistics | None:
        """Statistics of the computed forces, if there is a finger."""
        return None if self.press is None else self.press.statistics

    def run(self) -> None:
        """Serve until stop()."""
        self.scheduler.run()

    def stop(self) -> None:
        """End run(), also from a signal handler or another thread."""
        self.scheduler.stop()

    def close(self) -> None:
        """Close the ports and end the finger's process."""
        self._closing.close()

    def __enter__(self) -> "ServedBench":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _build(self, config: Config, stage: str | None, force: str | None, complain: Callable[[str], object]) -> None:
        parse_shape(config.virtual.indentor)
        refuse_twinless(*(device for device, kind in ((config.stage, stage), (config.force, force)) if kind))
        stage_line = self._open("stage", config.stage) if stage else None
        force_line = self._open("force", config.force) if force else None
        if stage_line:
            further = find(StageKind, config.stage.kind).further_ports
            stage_line.further = tuple(self._open(key, config.stage) for key in further)
            self.tables |= dict.fromkeys(further, f"stage.{kind_of(config.stage).place}")
        board = virtual_stage(self.scheduler, stage_line, config) if stage_line else None
        if force_line:
            load = self._finger(config, board, complain) if board else Load(lambda t_s: 0.0)
            sensor = virtual_force(self.scheduler, force_line, config, load_on_sensor(load, config))
            wire_hardware_trip(config, board, sensor)
        for port in self._refusing:  # Not earlier, because clients would wait for a reply.
            port.listen()

    def _open(self, name: str, device: StageSettings | ForceSettings) -> SerialLine:
        line, number = virtual_line(self.scheduler, device), self._tcp + len(self.ports) if self._tcp else 0
        port: PtyPort | TcpPort | UdpPort
        if self._tcp is None and not kind_of(device).datagrams:
            port = PtyPort(self.scheduler, line)
        else:
            of = UdpPort if kind_of(device).datagrams else TcpPort
            port = of(self.scheduler, line, number)
            self._refusing.append(port)
        self._closing.callback(port.close)
        self.ports[name] = port.name
        if page := kind_of(device).page_port:
            self.pages[page] = int(port.name.rpartition(":")[2])
            self.tables[page] = f"{name}.{kind_of(device).place}"
        return line

    def _finger(self, config: Config, board: VirtualStage, complain: Callable[[str], object]) -> Load:
        carriage: Carriage = true_carriage(board, config)
        indentor, terms, period_s = config.virtual.indentor, relaxation(config), config.force.sample_period_s
        if terms:
            way = self._closed_with_it(TrajectoryProcess(config.finger, indentor, terms, truth(config)))
            self.press = TrajectoryPrefetcher(self.scheduler, carriage, way, period_s, complain)
        else:
            press = self._closed_with_it(PressProcess(config.finger, indentor, truth(config)))
            self.press = PressAhead(self.scheduler, carriage, press, period_s, complain)
        return Load(self.press.force_n, self.press.fresh)

    def _closed_with_it(self, process: Process) -> Process:
        self._closing.callback(process.close)
        return process
