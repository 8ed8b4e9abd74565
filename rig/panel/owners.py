"""Whoever owns ports, as they announce themselves: which of them a page shows, and what each is asked."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Literal, Protocol

from rig.errors import RigError
from rig.session.control.announcements import ControlError, RefusedError

STOP_S = 3.0
"""How long an owner is listened to after a stop, which went at once: drives say when they stand."""


class Owner(Protocol):
    """A process that owns ports (rig/session/control/announcements.py: Announced)."""

    @property
    def pid(self) -> int: ...
    @property
    def kind(self) -> Literal["run", "by hand"]: ...
    @property
    def virtual(self) -> bool: ...
    @property
    def ports(self) -> tuple[str, ...]: ...
    @property
    def run(self) -> str | None: ...
    @property
    def began_unix_s(self) -> float: ...

    def ask(self, do: str, *, within_s: float = ..., **more: Any) -> dict[str, Any]:
        """Its answer. Raises RefusedError, ControlError."""
        ...

    def say_stop(self) -> Callable[[float], dict[str, Any]]:
        """Waits for nothing; what is returned listens to the answer for so many seconds. Raises ControlError."""
        ...


Find = Callable[[], Sequence[Owner]]


def shown(owners: Sequence[Owner]) -> Owner | None:
    """The one that a page shows: what is real goes before what is virtual, the newest before the others."""
    return max(owners, key=lambda one: (not one.virtual, one.began_unix_s), default=None)


def owner_told(owner: Owner, status: dict[str, Any] | None) -> dict[str, Any]:
    """`owner` of the state; status: its last answer, None where it gave none."""
    return {
        "kind": owner.kind,
        "pid": owner.pid,
        "virtual": owner.virtual,
        "ports": list(owner.ports),
        "state": None if status is None else status.get("state"),
        "stopped": None if status is None else status.get("stopped"),
        "reachable": status is not None,
        **({"stop_button": status["stop_button"]} if status is not None and "stop_button" in status else {}),
    }


def run_of(owner: Owner) -> Path | None:
    """The folder of its run, once there is one."""
    return None if owner.run is None else Path(owner.run)


class NobodyError(RigError):
    """There is nobody who could be asked. One line."""

    default_code = "nobody"


def asked(owner: Owner | None, kind: str, do: str, within_s: float, **more: Any) -> dict[str, Any]:
    """An owner's answer. Raises NobodyError where it is none of that kind, RefusedError, ControlError."""
    if owner is None or owner.kind != kind:
        if kind == "run":
            raise NobodyError("no run is going", code="no_run")
        raise NobodyError("nobody has the bench by hand: take it first", code="bench_not_taken")
    return owner.ask(do, within_s=within_s, **more)


Said = Mapping[int, Callable[[float], dict[str, Any]]]
"""Whoever was told to stop, by process, and what listens to the answer."""


def say_stop(owners: Sequence[Owner]) -> Said:
    """Every real owner is told to stop, and the one that is shown, without waiting, but for those that cannot be."""
    said = {}
    for one in _to_be_stopped(owners):
        with suppress(ControlError):
            said[one.pid] = one.say_stop()
    return said


def stop_all(owners: Sequence[Owner], said: Said, pool: ThreadPoolExecutor) -> dict[str, Any]:
    """Whoever has not been told to stop is, all at once and none behind another; what all of them answer.

    Raises NobodyError where there is none, ControlError where one does not answer, RefusedError where all refuse.
    """
    there = _to_be_stopped(owners)
    if not there:
        raise NobodyError("nothing owns the ports: there is nothing to stop", code="nothing_to_stop")
    stopping = partial(_stopped, said)
    others = pool.map(stopping, there[1:])
    answers = [stopping(there[0]), *others]
    for problem in answers:
        if isinstance(problem, ControlError) and not isinstance(problem, RefusedError):
            raise problem
    stopped = [one.pid for one, answer in zip(there, answers, strict=True) if not isinstance(answer, ControlError)]
    if not stopped:
        raise RefusedError("{problems}", code="all_refuse", problems="; ".join(map(str, answers)))
    return {"stopped": stopped, "words": f"told to stop: process {', '.join(map(str, stopped))}"}


def _to_be_stopped(owners: Sequence[Owner]) -> list[Owner]:
    return [one for one in owners if not one.virtual or one is shown(owners)]


def _stopped(said: Said, owner: Owner) -> dict[str, Any] | ControlError:
    answered = said.get(owner.pid)
    try:
        answer = owner.ask("stop", within_s=STOP_S) if answered is None else answered(STOP_S)
    except ControlError as error:
        return error
    if "unconfirmed" in answer:
        return ControlError(
            "process {pid} was told to stop: {problem}",
            code="stop_not_confirmed", pid=owner.pid, problem=answer["unconfirmed"],
        )  # fmt: skip
    return answer
