"""What the process at the bench answers, from threads that wait for nothing it does."""

from collections.abc import Callable, Mapping
from typing import Any

from rig.devices.stage.base import Stage
from rig.engine.errors import LimitError
from rig.session.by_hand.hand_status import HandStatus
from rig.session.by_hand.holds import Hold
from rig.session.by_hand.orders import Orders
from rig.session.control.stop_switch import answer_to_a_stop
from rig.transport.stop_gate import StopGate

Request = Mapping[str, Any]
Answers = Mapping[str, Callable[[Request], Mapping[str, Any]]]


def hand_answers(orders: Orders, status: HandStatus, stage: Stage, gate: StopGate) -> Answers:
    """By what is asked for; what they raise is a refusal, in one line."""

    def stop(request: Request) -> Mapping[str, Any]:
        """Past every queue, from this thread; nothing of what is under way goes out after it."""
        orders.stop()
        with gate.stopping():
            return answer_to_a_stop(stage.stop)

    def told(request: Request) -> Mapping[str, Any]:
        found = status.as_json(stopped=orders.stopped, since=_since(request))
        return {**found, "busy": orders.busy, "tab": orders.tab, "stopped": orders.stopped}

    def hold(request: Request) -> Mapping[str, Any]:
        orders.hold(Hold.asked(request))
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

    return {"stop": stop, "status": told, "hold": hold, "release": release, "home": home, "zero": zero,
            "leave": leave}  # fmt: skip


def _since(request: Request) -> int | None:
    since = request.get("since")
    if since is None or (isinstance(since, int) and since >= 0):
        return since
    raise LimitError("{do}: {key} = {value!r}, expected a number of readings", code="invalid_request", do="status",
                     key="since", value=since)  # fmt: skip


def _press(request: Request) -> tuple[str, int]:
    tab, press = request.get("tab"), request.get("press")
    if isinstance(tab, str) and isinstance(press, int):
        return tab, press
    raise LimitError("{do}: tab = {tab!r}, press = {press!r}, expected those of a hold", code="invalid_request",
                     do="release", tab=tab, press=press)  # fmt: skip
