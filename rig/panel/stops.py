"""STOP from a page: to every owner at once, and to the drives where no owner takes it."""

import asyncio
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, suppress
from functools import partial
from typing import Any

from rig.control.client import BESIDE_S, ControlError, RefusedError
from rig.control.stop import SentStop, send_stop
from rig.devices.registry import stage_ports
from rig.panel.owners import NoOwnerError, Owner, shown
from rig.panel.watcher import Watcher
from rig.settings import BenchSettings

STOP_S = 3.0
"""Time for an owner to confirm a stop (s), until the drives report rest."""

_ANSWER_S = 0.25  # for a stop that owners carry out; the page then repeats it
_THREADS = 64
_NOT_YET = ControlError("stop sent, no answer yet: use the emergency stop", "not_answered_yet")

Answer = Mapping[str, Any]
SentStops = Mapping[int, Callable[[float], dict[str, Any]]]
"""Owners that received a stop, by process, with the functions that wait for their replies."""


class Stops:
    """STOP of all pages. One press comes several times, over both ports, until it is answered."""

    def __init__(self, watcher: Watcher, room_for_stop: Callable[[], AbstractContextManager[None]]) -> None:
        self._watcher, self._room_for_stop = watcher, room_for_stop
        self._pool, self._each = ThreadPoolExecutor(_THREADS, "stop"), ThreadPoolExecutor(_THREADS, "stopped")
        self._lock, self._direct = threading.Lock(), dict[object, Future[SentStop | None]]()

    async def stop(self, tab: str, press: int | None) -> Answer:
        """Send the stop at once, in this thread, to every known owner, and return the result.

        Other threads find new owners and wait for the replies. Raises NoOwnerError, ControlError.
        """
        with self._room_for_stop():
            sent = _posted(self._watcher.owners)
            asking = asyncio.get_running_loop().run_in_executor(self._pool, self._stop_all, sent, (tab, press))
            done, _ = await asyncio.wait({asking}, timeout=_ANSWER_S if self._watcher.owners else STOP_S)
        if not done:
            raise _NOT_YET
        answer = asking.result()
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _stop_all(self, sent: SentStops, press: tuple[str, int | None]) -> Answer | NoOwnerError | ControlError:
        """Return the result of a stop; a failure is also returned, since the page may have gone."""
        try:
            owners = self._watcher.find()
        except OSError:
            owners = self._watcher.owners
        settings, confirmed = self._watcher.bench.settings, threading.Event()
        direct = None if settings is None else self._sent_directly(settings, owners, confirmed, press)
        try:
            return self._stop_owners(owners, sent)
        except RefusedError as error:
            return error
        except (NoOwnerError, ControlError) as error:
            confirmed.set()
            if settings is None or direct is None:
                return error
            stop = direct.result() or send_stop(settings)
            if stop.done:
                return {"stopped": list(stop.notified), "words": stop.words}
            words = stop.words if isinstance(error, NoOwnerError) else f"{error}. {stop.words}"
            return ControlError(words, "not_confirmed" if stop.sent else "not_sent")
        finally:
            confirmed.set()

    def _stop_owners(self, owners: Sequence[Owner], sent: SentStops) -> Answer:
        """Wait for the owners, and ask those that did not receive the stop.

        Raises NoOwnerError without an owner, ControlError if one does not respond, RefusedError if all refuse.
        """
        targets = _to_be_stopped(owners)
        if not targets:
            raise NoOwnerError("no process owns the ports, so there is nothing to stop", "nothing_to_stop")
        others = self._each.map(partial(_stopped, sent), targets[1:])
        problems = dict(zip([one.pid for one in targets], [_stopped(sent, targets[0]), *others], strict=True))
        for problem in problems.values():
            if problem is not None and not isinstance(problem, RefusedError):
                raise problem
        stopped = [pid for pid, problem in problems.items() if problem is None]
        if not stopped:
            raise RefusedError("; ".join(map(str, problems.values())), "all_refuse")
        return {"stopped": stopped, "words": f"process {', '.join(map(str, stopped))} has stopped the stage"}

    def _sent_directly(
        self,
        settings: BenchSettings,
        owners: Sequence[Owner],
        confirmed: threading.Event,
        press: tuple[str, int | None],
    ) -> "Future[SentStop | None]":
        """Begin to send the stop to the drives.

        A repeat of the same press shares the attempt under way: two readers would take each other's replies.
        """
        with self._lock:
            for done in [key for key, one in self._direct.items() if one.done()]:
                del self._direct[done]
            found = None if owners else self._direct.get(press)
            if found is None:
                found = self._each.submit(_sent_without_owner, settings, owners, confirmed)
                if not owners and press[1] is not None:
                    self._direct[press] = found
            return found


def _to_be_stopped(owners: Sequence[Owner]) -> list[Owner]:
    """Return every real owner, and the shown one."""
    return [one for one in owners if not one.virtual or one is shown(owners)]


def _posted(owners: Sequence[Owner]) -> SentStops:
    """Send a stop without waiting; skip unreachable owners."""
    sent = {}
    for one in _to_be_stopped(owners):
        with suppress(ControlError):
            sent[one.pid] = one.post_stop(by="panel")
    return sent


def _stopped(sent: SentStops, owner: Owner) -> ControlError | None:
    """Wait until an owner has stopped; return what is wrong, or None."""
    wait_for_reply = sent.get(owner.pid)
    try:
        answer = owner.ask("stop", within_s=STOP_S) if wait_for_reply is None else wait_for_reply(STOP_S)
    except ControlError as error:
        return error
    if "unconfirmed" in answer:
        return ControlError(f"stop sent to process {owner.pid}: {answer['unconfirmed']}", "stop_not_confirmed")
    return None


def _sent_without_owner(
    settings: BenchSettings, owners: Sequence[Owner], confirmed: threading.Event
) -> SentStop | None:
    """Send the stop directly to the drives if no owner responds at once; None if one does."""
    if owners and confirmed.wait(BESIDE_S):
        return None
    of_the_bench = [one for one in owners if set(one.ports) & set(stage_ports(settings.stage))]
    for one in of_the_bench or owners:
        with suppress(ControlError):
            one.ask("status", within_s=BESIDE_S)
            return None
    return send_stop(settings)
