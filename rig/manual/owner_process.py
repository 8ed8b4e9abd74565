"""Process of manual control: owns the ports; one thread moves, others answer requests."""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any, Literal

from rig.control.owned_stage import answer_to_a_stop
from rig.devices.base import Stage, StageError, is_held
from rig.engine.bench import Bench
from rig.engine.bench_memory import LastKnown, ManualEnd
from rig.engine.sensing import NoReadingError
from rig.errors import BadInputError, LimitError
from rig.manual.orders import Order, Orders, StepRequest
from rig.manual.session import ManualSession
from rig.manual.status import ManualStatus
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

    def ordered(order: Callable[[Request], Order]) -> Callable[[Request], Mapping[str, Any]]:
        def taken(request: Request) -> Mapping[str, Any]:
            orders.take(order(request))
            return {}

        return taken

    def leave(request: Request) -> Mapping[str, Any]:
        orders.leave()
        return {}

    return {
        "stop": stop,
        "status": report,
        "step": ordered(StepRequest.validated),
        "home": ordered(lambda request: "home"),
        "zero": ordered(lambda request: "zero anyway" if request.get("anyway") is True else "zero"),
        "park": ordered(lambda request: "park"),
        "leave": leave,
    }


def _since(request: Request) -> int | None:
    since = request.get("since")
    if since is None or (isinstance(since, int) and since >= 0):
        return since
    raise LimitError(f"status: since = {since!r} must be a number of readings, at least 0", "invalid_request")


LOOK_S = 0.1
"""Interval between stage statuses when idle (s); the force is read at the sensor's rate."""

STOPPED = "stopped at once by the operator"
_GATE_S = 0.02


class ManualOwner:
    """Owner of the bench under manual control; run() works until leave(), and `answers` serve other threads."""

    def __init__(self, settings: RigSettings, bench: Bench, gate: StopGate, log: Sink, known: LastKnown) -> None:
        """Prepare manual control. gate: that of the stage's transports. log: receives a line per action. known: state
        of contact after the last command.
        """
        self._gate, self._log, self._known = gate, log, known
        self._clock, self._stage = bench.clock, bench.stage
        self._session = ManualSession(
            settings,
            bench,
            known,
            lambda at, reading: self._status.record_reading(at, reading),
            lambda problem: self._status.record_sensor_problem(problem),
        )
        self._orders, self._status = Orders(bench.clock), ManualStatus(settings, bench.clock, self._session.sensing)
        self.answers = manual_answers(self._orders, self._status, bench.stage, gate)
        self._read_s = self._poll_s = bench.clock.monotonic_s()  # when each is due
        self._lost = False  # whether the stage must be connected again
        self._recorded_end: tuple[bool, str] | None = None

    def leave(self) -> None:
        """End run() at rest; may be called from a signal handler."""
        self._orders.leave()

    @contextmanager
    def begun(self) -> Iterator[None]:
        """Connect both devices, and record the position of the stage at the end.

        Raises StageError, TransportError, BadInputError if a device does not answer.
        """
        self._status.contact = self._known.contact
        with self._session.begun():
            self._show()
            yield
            if self._gate.closed:
                self._lost = True

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
        """Carry out one order, or poll both devices."""
        if self._gate.closed:
            self._lost = True
            if not self._session.tripped:
                self._status.ended_by = STOPPED
            self._show()
            self._record_end()
            if not self._gate.open():
                self._clock.wait_s(_GATE_S)
                return
        order = self._orders.begin_next()
        if order is None:
            self._poll()
        else:
            self._carry_out(order)

    def _carry_out(self, order: Order) -> None:
        begun_s, self._status.ended_by = self._clock.monotonic_s(), None
        self._status.did = order if isinstance(order, str) else "step"
        try:
            ended_by = self._execute(order)
        except (*ENDINGS, BadInputError) as error:
            ended_by = str(error)
            self._lost = self._lost or (isinstance(error, StageError | TransportError) and not self._session.homed)
        self._status.ended_by = STOPPED if self._gate.closed else ended_by
        self._status.contact = self._session.memory.read().contact
        self._show()
        self._record_end()
        self._orders.end()
        self._note(order, begun_s)

    def _execute(self, order: Order) -> str | None:
        """Carry out an order, and return what ended it early."""
        session = self._session
        if order == "home":
            self._status.record_stage(None, homed=False)
            session.home()
            self._orders.clear_stop()
            self._lost = False
        elif order == "zero":
            session.zero()
        elif order == "zero anyway":
            session.zero_anyway()
        else:
            found = session.step(order.direction, order.by_mm) if isinstance(order, StepRequest) else session.park()
            return None if found.ended_by is None else str(found.ended_by)
        return None

    # --- polling ---

    def _poll(self) -> None:
        """Read the force, and the stage if it is due."""
        now_s = self._clock.monotonic_s()
        if now_s >= self._poll_s:
            self._poll_s = max(self._poll_s + LOOK_S, now_s)
            self._poll_stage()
        with suppress(NoReadingError):  # The listener reports it.
            self._session.sensing.now()
        period_s = self._session.sensing.sensor.sample_period_s
        self._read_s = max(self._read_s + period_s, self._clock.monotonic_s())
        self._clock.wait_s(self._read_s - self._clock.monotonic_s())

    def _poll_stage(self) -> None:
        """Poll the stage. Raises TransportError if its port is gone."""
        try:
            at = self._session.ask_stage()
            self._show()
            if self._lost and not is_held(at.state):
                self._stage.connect()
                self._lost = False
        except StageError as error:
            self._lost = self._lost or not self._session.homed
            self._status.record_stage_problem(str(error), homed=not self._lost)
        except TransportError:
            if not self._gate.closed:
                raise

    def _show(self) -> None:
        self._status.record_stage(self._session.at, homed=self._session.homed and not self._lost)
        self._status.zeroed, self._status.tripped = self._session.sensing.absolute, self._session.tripped

    def _record_end(self) -> None:
        """Record a stop or a trip, once, for the commands and pages that come later."""
        stopped, reason = self._orders.stopped, self._status.ended_by or STOPPED
        end = (stopped, reason) if stopped or self._session.tripped else None
        if end not in (None, self._recorded_end):
            status: Literal["aborted", "tripped"] = "aborted" if stopped else "tripped"
            self._session.memory.record_manual_end(
                ManualEnd(status=status, reason=reason, unix_s=self._clock.unix_s())
            )
        self._recorded_end = end

    def _note(self, done: Order, begun_s: float) -> None:
        what = f"step {done.axis} {done.sign * done.by_mm:+g} mm" if isinstance(done, StepRequest) else done
        line = {"t_s": round(self._clock.run_s(begun_s), 6), "did": what, "ended_by": self._status.ended_by}
        self._log.write(json.dumps(line) + "\n")
