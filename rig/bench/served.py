"""Virtual bench in real time, behind ports that any program can open."""

import socket
import sys
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, TypeVar

from rig.bench.virtual import (
    load_on_sensor,
    refuse_twinless,
    relaxation,
    rises_of,
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
from rig.errors import BadInputError, around
from rig.plan.config import Config
from rig.settings import ForceSettings, StageSettings
from sim.carriage import Carriage
from sim.contact.shapes import parse_shape
from sim.devices.line import Load, SerialLine, VirtualStage
from sim.serve.force_process import FingerNotLoadedError, PressProcess, TrajectoryProcess
from sim.serve.ports import HOST, PortBusyError, PtyPort, TcpPort, UdpPort, bound
from sim.serve.prefetch import ForcePrefetcher, PressAhead, PressStatistics, TrajectoryPrefetcher
from sim.serve.real_time_loop import WallScheduler

if TYPE_CHECKING:  # slow to import, and for simulated afferents only
    from rig.bench.served_spikes import ServedSpikes, SpikeStatistics
    from rig.plan.nerve import SpikeRequest

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
        spikes: "SpikeRequest | None" = None,
        lsl: bool = False,
        complain: Callable[[str], object] = print,
    ) -> None:
        """Start the devices; return when all of them respond. Raises BadInputError.

        stage, force: kinds of device, None for none. tcp: number of the first port; None: pseudo-terminals, or free
        TCP ports on Windows. spikes: simulated afferents, whose spikes get a TCP port; lsl: also stream them over
        LSL.

        Returns when all devices respond. Raises BadInputError.
        """
        if tcp is None and sys.platform == "win32":  # without pseudo-terminals
            tcp = 0
        config = with_framing(with_kinds(config, stage, force), "rtu" if tcp is None else "tcp")
        self.scheduler = WallScheduler()
        self.ports: dict[str, str] = {}
        self.pages: dict[str, int] = {}
        self.tables = {"stage": "stage", "force": "force"}
        self.press: ForcePrefetcher | None = None
        self.spikes: ServedSpikes | None = None
        self.spike_port: dict[str, str] = {}
        self._tcp, self._wanted, self._lsl = tcp, spikes, lsl
        self._refusing: list[TcpPort | UdpPort] = []
        self.spike_statistics: SpikeStatistics | None = None
        self._closing = ExitStack()
        self._closing.callback(self.scheduler.close)
        try:
            self._build(config, stage, force, complain)
        except PortBusyError as error:
            self.close()
            raise around(BadInputError, "{problem}; choose another number for --tcp", error) from None
        except FingerNotLoadedError as error:
            self.close()
            raise around(BadInputError, "{problem}", error) from None
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
        if self._wanted is not None:
            from rig.bench.served_spikes import refuse_turned

            refuse_turned(truth(config))
        refuse_twinless(*(device for device, kind in ((config.stage, stage), (config.force, force)) if kind))
        stage_line = self._open("stage", config.stage) if stage else None
        force_line = self._open("force", config.force) if force else None
        if stage_line:
            further = find(StageKind, config.stage.kind).further_ports
            stage_line.further = tuple(self._open(key, config.stage) for key in further)
            self.tables |= dict.fromkeys(further, f"stage.{kind_of(config.stage).place}")
        server = None if self._wanted is None else self._bound_for_spikes()
        board = virtual_stage(self.scheduler, stage_line, config) if stage_line else None
        if force_line:
            load = self._finger(config, board, complain) if board else Load(lambda t_s: 0.0)
            sensor = virtual_force(self.scheduler, force_line, config, load_on_sensor(load, config))
            wire_hardware_trip(config, board, sensor)
        if board and server and self._wanted:
            self._begin_spikes(config, board, server, complain)
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

    def _bound_for_spikes(self) -> socket.socket:
        server = bound(self._tcp + len(self.ports) if self._tcp else 0)
        self._closing.callback(server.close)
        self.spike_port = {"spikes": f"tcp://{HOST}:{server.getsockname()[1]}"}
        return server

    def _begin_spikes(
        self, config: Config, board: VirtualStage, server: socket.socket, complain: Callable[[str], object]
    ) -> None:
        from rig.bench.served_spikes import ServedSpikes

        assert self._wanted is not None
        spikes = ServedSpikes(config, truth(config), self._wanted, server, lsl=self._lsl, complain=complain)
        self._closing.callback(self._end_spikes)
        self.spikes = spikes
        spikes.begin(self.scheduler, true_carriage(board, config, smooth=True), rises_of(board, config))

    def _end_spikes(self) -> None:
        if self.spikes is not None:
            self.spike_statistics = self.spikes.close()
            self.spikes = None

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
