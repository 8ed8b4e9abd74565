"""Spikes of simulated afferents beside a bench that is served in real time.

The loop of the bench samples where the indentor is and sends that away, without waiting. A process turns it into
spikes and delivers them, another one presses the finger for it, and neither can delay an answer of the bench.
"""

import gc
import heapq
import math
import multiprocessing
import signal
import socket
import struct
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.bench.live_spikes import SAMPLE_S, IndentorPlace, LiveSpikes, PlaceTable
from rig.data.lsl import open_spikes
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.nerve import SpikeRequest
from sim.carriage import STRAIGHT, Carriage, Truth
from sim.config import FingertipConfig
from sim.contact.indentor import Indentor
from sim.contact.patch import Z
from sim.contact.shapes import parse_shape
from sim.devices.clock import Handle, sample_at
from sim.models.pressing import FARTHEST_X_MM
from sim.nerve.population import AfferentPopulation
from sim.nerve.skin import LEVELS
from sim.serve.force_process import Answering, ForceProcess, message_of
from sim.serve.ports import LinePort
from sim.serve.real_time_loop import WallScheduler
from sim.workers import give_way, leaving_ctrl_c_to_us

if TYPE_CHECKING:
    from sim.models.fingertip import Fingertip
    from sim.models.result import IndentationResult

TICK_S = 6 * SAMPLE_S
"""Time between two messages of the bench (s)."""
LATE_S = 0.005
"""Delay behind its own time at which a spike counts as late (s)."""
COLUMNS = "time_s,kind,afferent"
"""Columns of the lines on the port: as in a file for `rig compare`, and which afferent it was."""
_READY_S, _ENDS_S = 60.0, 2.0
_MOST_UNSENT = 1 << 16  # bytes
_RECORD = struct.Struct("4d")  # time, x, height above the apex, along; a time alone is a sync pulse
_CHUNK = 1 << 16
_SYNC = -1


@dataclass
class SpikeStatistics:
    """Number of spikes delivered and of late ones, and the longest delay (s)."""

    delivered: int = 0
    late: int = 0
    worst_s: float = 0.0


# --- the bench's side ---


class IndentorFeed:
    """Poses of the indentor and sync pulses of the stage, sampled and sent by the loop of the bench."""

    def __init__(
        self,
        scheduler: WallScheduler,
        carriage: Carriage,
        pulses_after: Callable[[float], list[float]],
        to: socket.socket,
        complain: Callable[[str], object],
    ) -> None:
        """pulses_after: returns the times of the sync output's rises after a time."""
        self._scheduler, self._carriage, self._pulses_after, self._to = scheduler, carriage, pulses_after, to
        self._complain = complain
        self._origin_s = time.monotonic() - scheduler.monotonic_s()
        self._next = sample_at(scheduler.monotonic_s(), SAMPLE_S)
        self._pulse_s = scheduler.monotonic_s()
        self._unsent = b""
        to.setblocking(False)
        self._timer: Handle | None = None
        self._tick()

    def close(self) -> None:
        """End sampling."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer = None

    def _tick(self) -> None:
        now_s = self._scheduler.monotonic_s()
        self._timer = self._scheduler.call_at(now_s + TICK_S, self._tick)
        newest = sample_at(now_s, SAMPLE_S)
        records = []
        for index in range(max(self._next, newest - round(1.0 / SAMPLE_S)), newest + 1):
            pose = self._carriage.pose_at(index * SAMPLE_S)
            at_s = self._origin_s + index * SAMPLE_S
            records.append(_RECORD.pack(at_s, pose.x_mm, pose.above_apex_mm, pose.along_mm))
        self._next = newest + 1
        for rise_s in self._pulses_after(self._pulse_s):
            self._pulse_s = rise_s
            records.append(_RECORD.pack(self._origin_s + rise_s, math.nan, math.nan, math.nan))
        if len(self._unsent) < _MOST_UNSENT:  # else the other process is stuck: it misses these poses
            self._unsent += b"".join(records)
        try:
            self._unsent = self._unsent[self._to.send(self._unsent) :]
        except BlockingIOError:
            pass
        except OSError:
            self.close()
            self._complain("the process of the simulated afferents ended; the bench continues without spikes")


class ReceptorProcess(ForceProcess[IndentorPlace | None, PlaceTable | AfferentPopulation]):
    """Process that computes tables by pressing the finger; the request None returns the afferents."""

    nice = 3

    def __init__(
        self, config: FingertipConfig, indentor: str, truth: Truth, request: SpikeRequest, deepest_mm: float
    ) -> None:
        """Load the finger, draw the afferents, and wait. Raises FingerNotLoadedError."""
        super().__init__(partial(_pressing, config, indentor, truth, request, deepest_mm))

    def afferents(self) -> AfferentPopulation:
        """Return the afferents."""
        self.ask(None)
        found = self.answer()
        assert isinstance(found, AfferentPopulation)
        return found


def _pressing(
    config: FingertipConfig, indentor: str, truth: Truth, request: SpikeRequest, deepest_mm: float
) -> Answering[IndentorPlace | None, PlaceTable | AfferentPopulation]:
    from sim.models.fingertip import Fingertip

    finger = Fingertip.load(config).keeping_ways()
    afferents = request.drawn(finger)
    organs_mm = afferents.points_mm(finger)
    answer = partial(_answer, finger, parse_shape(indentor), truth, afferents, organs_mm, deepest_mm)
    answer(IndentorPlace(0.0, 0.0))  # the first one takes seconds
    return answer


def _answer(
    finger: "Fingertip",
    indentor: Indentor,
    truth: Truth,
    afferents: AfferentPopulation,
    organs_mm: NDArray[np.float64],
    deepest_mm: float,
    place: IndentorPlace | None,
) -> PlaceTable | AfferentPopulation:
    if place is None:
        return afferents
    z_mm = finger.config.receptor_plane_mm + place.along_mm if Z in indentor.placed_by else None
    if abs(place.x_mm) > FARTHEST_X_MM or not 0 <= (z_mm or 0.0) <= finger.config.geometry.length_mm:
        return PlaceTable(place)
    lateral_mm, problem = indentor.lateral_mm(place.x_mm), ""
    presses: list[IndentationResult] = []
    try:
        touch_mm = finger.touch_height_mm(indentor, lateral_mm, z_mm=z_mm) - finger.apex_height_mm
        for doi_mm in deepest_mm * np.linspace(0.0, 1.0, LEVELS + 1)[1:]:
            presses.append(finger.indent(indentor, lateral_mm, z_mm=z_mm, doi_mm=float(doi_mm)))
    except Exception as error:  # a press outside the model must not end this process
        problem = message_of(error)
    if not presses:
        return PlaceTable(place, problem=problem)
    fields = finger.fields(presses, organs_mm)
    give_mm = truth.compliance_mm_per_n * truth.stiffness
    ways_mm = tuple(one.doi_mm + give_mm * one.force_n for one in presses)
    return PlaceTable(place, touch_mm, ways_mm, np.array([afferents.measure(one.measures) for one in fields]))


class ServedSpikes:
    """Processes of the afferents, and the feed of their poses."""

    def __init__(
        self,
        config: Config,
        truth: Truth,
        request: SpikeRequest,
        server: socket.socket,
        *,
        lsl: bool,
        complain: Callable[[str], object],
    ) -> None:
        """Start both processes and wait; complain is importable. Raises FingerNotLoadedError, BadInputError."""
        refuse_turned(truth)
        self._complain = complain
        deepest_mm = config.limits.max_doi_mm
        self._receptors = ReceptorProcess(config.finger, config.virtual.indentor, truth, request, deepest_mm)
        self._feed: IndentorFeed | None = None
        self._near, far = socket.socketpair()
        context = multiprocessing.get_context("spawn")
        self._said, saying = context.Pipe(duplex=False)
        settings = _DeliverySettings(self._receptors.afferents(), request, lsl, complain)
        self._process = context.Process(
            target=_deliver, args=(settings, far, server, self._receptors.connection, saying), daemon=True
        )
        with leaving_ctrl_c_to_us():
            self._process.start()
        far.close()
        server.close()
        saying.close()
        problem = self._heard(_READY_S)
        if problem is not None:
            self.close()
            raise BadInputError("simulated afferents: {problem}", code="not_started", problem=str(problem))

    def begin(
        self, scheduler: WallScheduler, carriage: Carriage, pulses_after: Callable[[float], list[float]]
    ) -> None:
        """Follow a carriage from now on."""
        self._feed = IndentorFeed(scheduler, carriage, pulses_after, self._near, self._complain)

    def close(self) -> SpikeStatistics:
        """End both processes and return the delivery statistics."""
        if self._feed is not None:
            self._feed.close()
        self._near.close()
        found = self._heard(_ENDS_S)
        self._process.join(_ENDS_S)
        self._process.terminate()
        self._receptors.close()
        return found if isinstance(found, SpikeStatistics) else SpikeStatistics()

    def _heard(self, within_s: float) -> Any:
        try:
            return self._said.recv() if self._said.poll(within_s) else "their process does not answer"
        except (EOFError, OSError):
            return "their process ended"


def refuse_turned(truth: Truth) -> None:
    """Raise BadInputError for a finger that is rolled or tilted."""
    if truth.turn != STRAIGHT:
        raise BadInputError(
            "--afferents: not available for a virtual finger that is rolled or tilted; set virtual.finger_roll_deg "
            "and virtual.finger_tilt_deg to 0",
            code="turned_finger",
        )


# --- the process that delivers ---


@dataclass(frozen=True)
class _DeliverySettings:
    """Arguments of the process that delivers the spikes."""

    afferents: AfferentPopulation
    request: SpikeRequest
    lsl: bool
    complain: Callable[[str], object]


def _deliver(
    settings: _DeliverySettings,
    poses: socket.socket,
    server: socket.socket,
    receptors: "Connection[IndentorPlace, PlaceTable]",
    saying: "Connection[Any, Any]",
) -> None:
    give_way(0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        push = (
            open_spikes([_described(settings, k) for k in range(len(settings.afferents))]) if settings.lsl else None
        )
        scheduler = WallScheduler()
        delivery = Delivery(settings, scheduler, LinePort(scheduler, server, _greeting(settings)), push)
        warm(settings.afferents)
    except Exception as error:
        saying.send(message_of(error))
        return
    follower = _Follower(settings, scheduler, poses, receptors, delivery, settings.complain)
    gc.freeze()
    saying.send(None)
    scheduler.run()
    follower.close()
    saying.send(delivery.statistics)


def _described(settings: _DeliverySettings, k: int) -> Mapping[str, Any]:
    one = settings.afferents[k]
    return {
        "label": one.name,
        "class": one.model,
        "x_mm": one.x_mm,
        "along_mm": one.along_mm,
        "delay_s": one.delay_s(settings.request.path_m),
    }


def _greeting(settings: _DeliverySettings) -> bytes:
    names = " ".join(one.name for one in settings.afferents)
    return f"# synthetic spikes, not data: {names}\n{COLUMNS}\n".encode("ascii")


def warm(afferents: AfferentPopulation) -> None:
    """Compute a few unused spikes, so that the first real ones are not late."""
    spikes = LiveSpikes(afferents, lambda place: None)
    for k in range(3):
        spikes.known(k * SAMPLE_S, 0.0, 1.0, 0.0)
        spikes.advance()


class Delivery:
    """Spikes and sync pulses that wait for their time, and go out on the port and as a stream."""

    def __init__(
        self,
        settings: _DeliverySettings,
        scheduler: WallScheduler,
        port: LinePort,
        push: Callable[[str, float], object] | None,
    ) -> None:
        self.statistics = SpikeStatistics()
        self._names = [one.name for one in settings.afferents]
        self._delays_s = [one.delay_s(settings.request.path_m) for one in settings.afferents]
        self._scheduler, self._port, self._push = scheduler, port, push
        self._waiting: list[tuple[float, int]] = []
        self._timer: Handle | None = None

    def add(self, afferent: int, at_receptor_s: float) -> None:
        """Deliver a spike when it reaches the electrode."""
        heapq.heappush(self._waiting, (at_receptor_s + self._delays_s[afferent], afferent))

    def sync(self, rise_s: float) -> None:
        """Deliver a sync pulse."""
        heapq.heappush(self._waiting, (rise_s, _SYNC))

    def go(self) -> None:
        """Deliver the spikes that are due, and set the timer for the next one."""
        now_s, lines = time.monotonic(), []
        while self._waiting and self._waiting[0][0] <= now_s:
            due_s, afferent = heapq.heappop(self._waiting)
            lines.append(self._line(due_s, afferent))
            if afferent != _SYNC:
                self._count(now_s - due_s)
                if self._push is not None:
                    self._push(self._names[afferent], due_s)
        if lines:
            self._port.write("".join(lines).encode("ascii"))
        if self._timer is not None:
            self._timer.cancel()
        self._timer = None
        if self._waiting:
            left_s = self._waiting[0][0] - time.monotonic()
            self._timer = self._scheduler.call_at(self._scheduler.monotonic_s() + max(left_s, 0.0), self.go)

    def _line(self, due_s: float, afferent: int) -> str:
        return f"{due_s:.6f},sync,\n" if afferent == _SYNC else f"{due_s:.6f},spike,{self._names[afferent]}\n"

    def _count(self, behind_s: float) -> None:
        found = self.statistics
        found.delivered += 1
        found.late += behind_s > LATE_S
        found.worst_s = max(found.worst_s, behind_s)


class _Follower:
    """Reader of the bench's poses and of presses for tables."""

    def __init__(
        self,
        settings: _DeliverySettings,
        scheduler: WallScheduler,
        poses: socket.socket,
        receptors: "Connection[IndentorPlace, PlaceTable]",
        delivery: Delivery,
        complain: Callable[[str], object],
    ) -> None:
        self._scheduler, self._poses, self._receptors, self._delivery = scheduler, poses, receptors, delivery
        self._spikes = LiveSpikes(settings.afferents, receptors.send, complain)
        self._unread = b""
        poses.setblocking(False)
        scheduler.watch(poses, self._read)
        scheduler.watch(receptors, self._take)

    def close(self) -> None:
        self._poses.close()
        self._receptors.close()

    def _read(self) -> None:
        try:
            data = self._poses.recv(_CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._scheduler.unwatch(self._poses)
            self._scheduler.stop()
            return
        data = self._unread + data
        whole = len(data) - len(data) % _RECORD.size
        self._unread = data[whole:]
        for at_s, x_mm, above_mm, along_mm in _RECORD.iter_unpack(data[:whole]):
            if math.isnan(x_mm):
                self._delivery.sync(at_s)
            else:
                self._spikes.known(at_s, x_mm, above_mm, along_mm)
        self._go()

    def _take(self) -> None:
        try:
            made = self._receptors.recv()
        except (EOFError, OSError):
            self._scheduler.unwatch(self._receptors)
            return
        self._spikes.take(made)
        self._go()

    def _go(self) -> None:
        who, times_s = self._spikes.advance()
        for afferent, at_s in zip(who.tolist(), times_s.tolist(), strict=True):
            self._delivery.add(afferent, at_s)
        self._delivery.go()
