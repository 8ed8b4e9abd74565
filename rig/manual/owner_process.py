"""Process of manual control: owns the ports; one thread moves, others answer requests."""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from rig.control.stop import answer_to_a_stop
from rig.devices.base import Stage, StageError, StageOverridden, StageRejected, StageStatus, is_held
from rig.engine.bench import Bench
from rig.engine.bench_memory import BenchMemory, LastKnown
from rig.engine.sensing import NoReadingError, Sensing
from rig.errors import BadInputError, LimitError
from rig.manual import home_and_zero as at_hand
from rig.manual.jog import ByHand
from rig.manual.orders import HOLD_S, HoldRequest, Orders, Verb
from rig.manual.status import ManualStatus, OverheardSensor
from rig.session.script_run import ENDINGS
from rig.settings import RigSettings
from rig.transport.stop_gate import StopGate
from rig.transport.wire import Sink, TransportError

Request = Mapping[str, Any]
Answers = Mapping[str, Callable[[Request], Mapping[str, Any]]]


def manual_answers(orders: Orders, status: ManualStatus, stage: Stage, gate: StopGate) -> Answers:
    """Return the handlers by request name; an exception refuses the request."""

    def stop(request: Request) -> Mapping[str, Any]:
        """Stop past every queue; pending commands are blocked."""
        orders.stop()
        with gate.stopping():
            return answer_to_a_stop(stage.stop)

    def report(request: Request) -> Mapping[str, Any]:
        found = status.as_json(stopped=orders.stopped, since=_since(request))
        return {**found, "busy": orders.busy, "tab": orders.tab, "stopped": orders.stopped}

    def hold(request: Request) -> Mapping[str, Any]:
        orders.hold(HoldRequest.validated(request))
        return {}

    def release(request: Request) -> Mapping[str, Any]:
        orders.release(*_press(request))
        return {}

    def home(request: Request) -> Mapping[str, Any]:
        orders.do("home")
        return {}

    def zero(request: Request) -> Mapping[str, Any]:
        orders.do("zero anyway" if request.get("anyway") is True else "zero")
        return {}

    def leave(request: Request) -> Mapping[str, Any]:
        orders.leave()
        return {}

    return {"stop": stop, "status": report, "hold": hold, "release": release, "home": home, "zero": zero,
            "leave": leave}  # fmt: skip


def _since(request: Request) -> int | None:
    since = request.get("since")
    if since is None or (isinstance(since, int) and since >= 0):
        return since
    raise LimitError(f"status: since = {since!r} must be a number of readings, at least 0", "invalid_request")


def _press(request: Request) -> tuple[str, int]:
    tab, press = request.get("tab"), request.get("press")
    if isinstance(tab, str) and isinstance(press, int):
        return tab, press
    raise LimitError(
        f"release: tab = {tab!r} must be text and press = {press!r} a whole number, as in a hold", "invalid_request"
    )


LOOK_S = 0.1
"""Interval between stage statuses when idle (s); the force is read at the sensor's rate."""

STOPPED = "stopped at once by the operator"
LAPSED = f"no signal from the button for {HOLD_S:g} s; press it again"
_GATE_S = 0.02


class ManualOwner:
    """Owner of the bench under manual control; run() works until leave(), and `answers` serve other threads."""

    def __init__(self, settings: RigSettings, bench: Bench, gate: StopGate, log: Sink, known: LastKnown) -> None:
        """Prepare manual control. gate: that of the stage's transports. log: receives a line per action. known: state
        of contact after the last command.
        """
        self._settings, self._bench, self._gate, self._log = settings, bench, gate, log
        self._clock, self._stage, self._known = bench.clock, bench.stage, known
        sensor = OverheardSensor(
            bench.force, lambda reading: self._status.read(reading), lambda problem: self._status.unread(problem)
        )
        self._sensing = Sensing(settings, bench.clock, sensor)
        self._orders, self._status = Orders(bench.clock), ManualStatus(settings, bench.clock, self._sensing)
        self.answers = manual_answers(self._orders, self._status, bench.stage, gate)
        self._read_s = self._poll_s = bench.clock.monotonic_s()  # when each is due
        self._lost = False  # whether the stage must be connected again
        self._hand: ByHand

    def leave(self) -> None:
        """End run() at rest; may be called from a signal handler."""
        self._orders.leave()

    @contextmanager
    def begun(self) -> Iterator[None]:
        """Connect both devices, and record the position of the stage at the end.

        Raises StageError, TransportError, BadInputError if a device does not answer.
        """
        self._stage.connect()
        at_hand.feel(self._sensing)
        settings, known = self._settings, self._known
        with at_hand.at_hand(settings, self._stage, self._clock, self._sensing, self._show, known) as self._hand:
            self._status.placed, self._status.zeroed = self._hand.placed, self._sensing.zero is not None
            self._status.contact = known.contact
            self._show(self._stage.status(), None)
            yield
            if self._gate.closed:
                self._lose()

    def run(self, gone: Callable[[], bool] = lambda: False) -> None:
        """Run until leave() or until gone(). Raises StageError, TransportError if the stage is lost."""
        try:
            while not (self._orders.leaving or gone()):
                self._turn()
        except BaseException:
            with suppress(StageError, TransportError):  # The caller reports the first error.
                self._stage.stop()
            raise

    def _turn(self) -> None:
        """Carry out one action, or poll both devices."""
        if self._gate.closed:
            self._lose()
            if not self._gate.open():
                self._clock.wait_s(_GATE_S)
                return
        to_do = self._orders.next()
        if to_do is None:
            self._poll()
        else:
            self._carry_out(to_do)

    def _carry_out(self, to_do: HoldRequest | Verb) -> None:
        begun_s, self._status.ended_by = self._clock.monotonic_s(), None
        try:
            ended_by = self._jog(to_do) if isinstance(to_do, HoldRequest) else self._do(to_do)
        except (*ENDINGS, BadInputError) as error:
            ended_by = str(error)
            self._doubt(error)
        if self._gate.closed:
            ended_by = STOPPED
        self._status.ended_by = ended_by or (LAPSED if self._orders.lapsed(to_do) else None)
        self._status.contact = BenchMemory(self._settings).read().contact
        self._orders.over(to_do)
        self._note(to_do, begun_s)

    def _jog(self, press: HoldRequest) -> str | None:
        try:
            self._hand.steps_per_mm(press.axis)
        except StageError as error:
            return str(error)  # Without this axis nothing moved, and the position is still known.
        moved = self._hand.go(self._orders.held(press), press.speed_mm_s)
        self._show(moved.at, moved.force_gwt)
        return moved.ended_by

    def _do(self, verb: Verb) -> str | None:
        if verb == "home":
            self._status.seen(None)
            self._set_placed(placed=False)
            known = at_hand.home(self._settings, self._bench, self._sensing)
            self._set_placed(placed=True)
            self._hand.may_touch = known.may_touch
            self._orders.homed()
            self._lost = False
            self._show(self._stage.status(), None)
            return None
        try:
            at_hand.zero(self._settings, self._sensing, None if verb == "zero anyway" else self._hand)
        finally:
            self._set_placed(placed=self._hand.placed)
            self._status.zeroed = BenchMemory(self._settings).read().zero is not None
        return None

    # --- polling ---

    def _poll(self) -> None:
        """Read the force, and the stage if it is due."""
        now_s = self._clock.monotonic_s()
        if now_s >= self._poll_s:
            self._poll_s = now_s + LOOK_S
            self._poll_stage()
        with suppress(NoReadingError):  # The listener reports it.
            self._sensing.now()
        self._read_s = max(self._read_s + self._sensing.sensor.sample_period_s, self._clock.monotonic_s())
        self._clock.wait_s(self._read_s - self._clock.monotonic_s())

    def _poll_stage(self) -> None:
        """Poll the stage. Raises TransportError if its port is gone."""
        try:
            at = self._stage.status()
            self._show(at, None)
            if self._hand.placed and not at.referenced:
                self._set_placed(placed=False)
            if self._lost and not is_held(at.state):
                self._stage.connect()
                self._lost = False
        except StageError as error:
            self._status.unseen(str(error))
            self._doubt(error)
        except TransportError:
            if not self._gate.closed:
                raise

    def _show(self, at: StageStatus, force_gwt: float | None) -> None:
        self._status.seen(at)

    def _doubt(self, error: Exception) -> None:
        """Discard the position after a failure, unless the driver still trusts it."""
        trusted = self._stage.homed or isinstance(error, StageOverridden | StageRejected)
        if isinstance(error, StageError | TransportError) and not trusted:
            self._lose()

    def _lose(self) -> None:
        """Forget the position; the driver must connect again."""
        self._set_placed(placed=False)
        self._lost = True

    def _set_placed(self, *, placed: bool) -> None:
        self._hand.set_placed(placed=placed)
        self._status.placed = placed

    def _note(self, done: HoldRequest | Verb, begun_s: float) -> None:
        what = f"jog {done.axis}{done.sign:+d} at {done.speed_mm_s:g} mm/s" if isinstance(done, HoldRequest) else done
        line = {"t_s": round(self._clock.run_s(begun_s), 6), "did": what, "ended_by": self._status.ended_by}
        self._log.write(json.dumps(line) + "\n")
