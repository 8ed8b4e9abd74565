"""The rig in Bluesky: stage, cell and press as devices of its protocols, and a press as a plan.

A `BlueskyBench` starts the same program as `rig run` in a process of its own, which owns the ports, confirms, limits,
trips and journals. Orders reach it over its control socket; all that is known comes back from its journal.
"""

import json
import math
import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rig.clock import WallClock
from rig.control.client import Announced, ControlError, announced
from rig.data.documents import Document
from rig.data.events import TIME, Column, HoldEndEvent, SampleEvent, TouchEvent, columns_of, stream_of
from rig.data.folder import RunFolder
from rig.data.run import Following
from rig.errors import RigError

LOOK_S = 0.01
ANSWER_S = 5.0
REPORT_S = 60.0
"""Longest time that a run writes its report after its last answer (s)."""
GONE = ("ended", "broken_off")
"""Codes of a control socket that is closed."""
NO_REPLY = "no_reply"
"""Code of a process that does not reply in time."""
PROGRAM = ["-m", "rig"]

ROWS = {
    stream_of(event): (TIME, *(column for column in columns_of(event) if not column.is_optional))
    for event in (SampleEvent, TouchEvent, HoldEndEvent)
}
"""Streams of the journal that become events, with their columns."""

_DTYPES = {float: "number", int: "number", bool: "boolean", str: "string"}

STREAM_NAMES = {"sample": "samples", "touch": "touches", "hold_end": "primary"}
"""Streams of the Bluesky documents, by stream of the journal."""

Messages = Generator[Any, Any, Any]
Reading = dict[str, dict[str, Any]]


class BlueskyMissingError(RigError):
    """Error of a missing library."""

    default_code = "bluesky_missing"


class PressFailedError(RigError):
    """Error of an order that was refused, or ended by a trip, a stop or a failure; `code` names the cause."""

    default_code = "not_pressed"


class OrderStatus:
    """Status of an order, as Bluesky's protocol has it."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._over = threading.Event()
        self._problem: Exception | None = None
        self._callbacks: list[Callable[[Any], None]] = []

    @property
    def done(self) -> bool:
        """Whether the order has ended."""
        return self._over.is_set()

    @property
    def success(self) -> bool:
        """Whether the order succeeded."""
        return self.done and self._problem is None

    def exception(self, timeout: float | None = 0.0) -> BaseException | None:
        """Return why it failed, or None. Raises TimeoutError if it has not ended within this time (s)."""
        if not self._over.wait(timeout):
            raise TimeoutError("the order has not ended")
        return self._problem

    def add_callback(self, callback: Callable[[Any], None]) -> None:
        """Call a function with this status once the order has ended."""
        with self._guard:
            if not self.done:
                self._callbacks.append(callback)
                return
        callback(self)

    def end(self, problem: Exception | None = None) -> None:
        """End the order."""
        with self._guard:
            self._problem = problem
            self._over.set()
        for callback in self._callbacks:
            callback(self)


class _Readable:
    """Device with a name and readings."""

    parent = None

    def __init__(self, name: str, columns: Sequence[Column], source: str) -> None:
        self.name = name
        self._columns, self._source = columns, source
        self._row: Mapping[str, Any] = {}
        self._unix_s = 0.0

    def show(self, row: Mapping[str, Any], unix_s: float) -> None:
        """Set the values of the next reading."""
        self._row, self._unix_s = row, unix_s

    def read(self) -> Reading:
        """Return the last values in the journal, with their times; NaN for a value that it lacks."""
        values = {column.name: self._row.get(column.name) for column in self._columns}
        return {
            f"{self.name}_{key}": {"value": math.nan if value is None else value, "timestamp": self._unix_s}
            for key, value in values.items()
        }

    def describe(self) -> dict[str, dict[str, Any]]:
        """Return the data keys of the readings."""
        return {
            f"{self.name}_{column.name}": {
                "source": self._source,
                "dtype": _DTYPES[column.type],
                "shape": [],
                **({"units": column.unit} if column.unit else {}),
            }
            for column in self._columns
        }

    def read_configuration(self) -> Reading:
        """Return nothing: the run's folder has the configuration."""
        return {}

    def describe_configuration(self) -> dict[str, dict[str, Any]]:
        """Return nothing."""
        return {}


class _Movable(_Readable):
    """Device that takes orders."""

    def __init__(
        self,
        name: str,
        columns: Sequence[Column],
        source: str,
        order: Callable[..., OrderStatus],
        stop: Callable[[], None],
    ) -> None:
        super().__init__(name, columns, source)
        self._order, self._stop = order, stop

    def stop(self, *, success: bool = False) -> None:
        """End an order that is being carried out, and the run: lift from a press, stop a move at once."""
        self._stop()


class StageDevice(_Movable):
    """Bluesky device of the stage; its position is x at clearance (mm)."""

    def set(self, value: float) -> OrderStatus:
        """Move to a confirmed position."""
        return self._order(what="move", x_mm=float(value))


class PressDevice(_Movable):
    """Bluesky device of the press; its value is a mapping of the arguments of `press`."""

    def set(self, value: Mapping[str, Any]) -> OrderStatus:
        """Press once."""
        return self._order(what="press", **value)


def _of_sample(*names: str) -> list[Column]:
    return [column for column in columns_of(SampleEvent) if column.name in names]


class BlueskyBench:
    """Bluesky devices of a rig, which a process of its own homes and zeroes.

    Parameters
    ----------
    config : Path or str, optional
        Configuration of rig and finger. Default: the built-in virtual bench.
    indentor : str
        Indentor of all presses.
    x_mm : sequence of float
        Positions of the presses (mm).
    doi_mm, force_gwt : float, optional
        Deepest press (mm), or highest force (gwt): one of them.
    presses, increments : int
        Maximum numbers of presses, and of increments of a press.
    hold_s : float
        Longest hold (s).
    virtual : bool
        Whether to press on the virtual bench.
    speed : float, optional
        Simulated seconds per real second of a virtual bench. Default: no limit.
    out : Path or str
        Parent folder of the run folder.
    options : sequence of str
        Further options of `rig run`: `--yes`, `--mounted`, `--subject` or `--finger`, with their values.

    Attributes
    ----------
    stage, cell, press : devices
        What plans read and set.

    Examples
    --------
    >>> from bluesky import RunEngine  # doctest: +SKIP
    >>> with BlueskyBench("rig.toml", indentor="bar:3.0", force_gwt=2.33) as rig:  # doctest: +SKIP
    ...     RunEngine()(indent(rig, force_gwt=2.33))
    """

    def __init__(
        self,
        config: Path | str | None = None,
        *,
        indentor: str,
        x_mm: Sequence[float] = (0.0,),
        doi_mm: float | None = None,
        force_gwt: float | None = None,
        presses: int = 1,
        increments: int = 1,
        hold_s: float = 1.0,
        virtual: bool = False,
        speed: float | None = None,
        out: Path | str = "runs",
        options: Sequence[str] = (),
    ) -> None:
        words = {
            "indentor": indentor, "x-mm": ",".join(f"{x:.9g}" for x in x_mm), "doi-mm": doi_mm,
            "force-gwt": force_gwt, "presses": presses, "increments": increments, "hold-s": hold_s,
            "config": config, "speed": speed, "out": out,
        }  # fmt: skip
        self._words = [f"--{name}={value}" for name, value in words.items() if value is not None]
        self._words += [*(["--virtual"] if virtual else []), *options]
        self._virtual = virtual
        self._clock = WallClock()
        self._guard = threading.Lock()
        self._status: OrderStatus | None = None
        self._what = ""
        self._ended: PressFailedError | None = None
        self._rows: list[Document] = []
        source = "journal"
        self.stage = StageDevice("rig_stage", _of_sample("x_mm", "height_mm"), source, self._order, self._stop)
        self.cell = _Readable("rig_cell", _of_sample("force_gwt"), source)
        self.press = PressDevice("rig_press", _of_sample("index"), source, self._order, self._stop)
        self.rows = {stream: _Readable(f"rig_{stream}", columns, source) for stream, columns in ROWS.items()}
        self.start: Document = {}

    def __enter__(self) -> Self:
        """Start the program, and wait until it is ready for orders. Raises PressFailedError."""
        self._process = subprocess.Popen(
            [sys.executable, *PROGRAM, "take-orders", *self._words],
            stdout=subprocess.PIPE,
            stdin=subprocess.DEVNULL if self._virtual else None,
            stderr=subprocess.DEVNULL if self._virtual else None,  # The page of a real run needs the terminal.
            text=True,
        )
        try:
            self._owner = self._announced()
            self.folder = RunFolder(Path(str(self._owner.run)))
            self._journal = Following(self.folder)
            self._follower = threading.Thread(target=self._follow, name="journal", daemon=True)
            self._follower.start()
            self._wait_until_ready()
        except BaseException:
            self.__exit__(*sys.exc_info())
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the run at clearance, lift from a press if need be, and wait for the report."""
        try:
            if self._process.poll() is None and hasattr(self, "_owner"):
                self._leave()
            elif self._process.poll() is None:
                self._process.terminate()
        finally:
            self._process.wait()
            if hasattr(self, "_follower") and self._follower.ident is not None:
                self._follower.join()
            elif self._process.stdout is not None:
                self._process.stdout.close()

    @property
    def journalled(self) -> list[Document]:
        """Documents of the journal so far."""
        return list(self._rows)

    # --- the other process ---

    def _announced(self) -> Announced:
        """Wait for the run, which begins once a person has confirmed it."""
        while self._process.poll() is None:
            found = next((one for one in announced() if one.pid == self._process.pid), None)
            if found is not None and found.run is not None:
                return found
            self._clock.wait_s(LOOK_S)
        raise self._failure()

    def _wait_until_ready(self) -> None:
        while not any(one["doc"] == "event" and one["stream"] == "zero" for one in list(self._rows)):
            if self._ended is not None:
                raise self._ended
            self._clock.wait_s(LOOK_S)

    def _follow(self) -> None:
        """Read the journal until the process has ended."""
        alive = True
        while alive:
            alive = self._process.poll() is None  # first, so that the last documents are read
            for document in self._journal.new():
                self._rows.append(document)
                self._take(document)
            self._clock.wait_s(LOOK_S)
        failure = self._failure()
        with self._guard:
            self._ended, status, self._status = failure, self._status, None
        if status is not None:
            status.end(failure)

    def _take(self, document: Document) -> None:
        if document["doc"] == "start":
            self.start = document
        if document["doc"] != "event":
            return
        stream, data, unix_s = document["stream"], document["data"], document["unix_s"]
        if stream.endswith("sample"):
            self.cell.show(data, unix_s)
        if stream.endswith("sample") or stream == "move":
            self.stage.show(data, unix_s)
        if stream == "indentation_start":
            self.press.show(data, unix_s)
        if stream == {"move": "move", "press": "indentation_end"}.get(self._what):
            with self._guard:
                status, self._status, self._what = self._status, None, ""
            if status is not None:
                status.end()

    def _failure(self) -> PressFailedError:
        """Return why the process has ended, from its result."""
        assert self._process.stdout is not None
        with self._process.stdout as printed:
            text = printed.read()
        self._process.wait()
        found = json.loads(text) if text.strip() else {}
        words = found.get("error_text") or (found.get("ending") or {}).get("reason_text") or "the run has ended"
        return PressFailedError(words, found.get("code", "ended"))

    # --- orders ---

    def _order(self, **order: Any) -> OrderStatus:
        status = OrderStatus()
        with self._guard:
            problem: Exception | None = self._ended
            if problem is None and self._status is not None:
                problem = PressFailedError("another order is still running", "busy")
            if problem is None:
                self._status, self._what = status, order["what"]
        if problem is None:
            refused = self._refusal(order)
            if refused is not None and refused.code in GONE:
                self._follower.join(REPORT_S)  # The result of the run says why it has ended.
            with self._guard:
                if refused is None or self._status is not status:
                    return status
                self._status, self._what = None, ""
            problem = refused
        status.end(problem)
        return status

    def _refusal(self, order: Mapping[str, Any]) -> PressFailedError | None:
        """Send an order, again while the last one is about to end; return why it is refused.

        An order without a reply may have begun, and nothing could end it as one later: it is ended now.
        """
        deadline_s = self._clock.monotonic_s() + ANSWER_S
        while True:
            try:
                self._owner.ask("order", **order)
                return None
            except ControlError as error:
                if error.code == NO_REPLY and order["what"] != "leave":
                    with suppress(ControlError):  # The first error is reported.
                        self._stop()
                if error.code != "busy" or self._clock.monotonic_s() >= deadline_s:
                    return PressFailedError(str(error), error.code)
            self._clock.wait_s(LOOK_S)

    def _stop(self) -> None:
        """End an order that is being carried out, and the run. Raises ControlError.

        A run that does not reply to the request to lift is stopped at once, as a move is.
        """
        if self._status is None or self._process.poll() is not None:
            return
        if self._what == "press":
            with suppress(ControlError):
                self._owner.ask("order", what="lift")
                return
        answer = self._owner.post_stop()
        threading.Thread(target=_wait_for_reply, args=(answer,), name="answer", daemon=True).start()

    def _leave(self) -> None:
        """End the run; if it no longer answers, wait while it ends by itself and writes its report."""
        code = ""
        try:
            if self._status is not None:
                self._stop()
            elif problem := self._refusal({"what": "leave"}):
                code = problem.code
        except ControlError as error:
            code = error.code
        if not code:
            return
        try:
            self._process.wait(REPORT_S if code in GONE else 0.0)
        except subprocess.TimeoutExpired:
            self._process.terminate()  # pauses at the next safe point, and ends there


def _wait_for_reply(answer: Callable[[float], Any]) -> None:
    try:
        answer(ANSWER_S)
    except ControlError:  # The status of the order reports the end.
        return


def press(rig: BlueskyBench, **order: Any) -> Messages:
    """Press once, within a run of Bluesky, and emit its touch, holds and readings as events.

    `order` is `doi_mm` or `force_gwt` of the last increment, optionally `x_mm`, `increments` and `hold_s`. Raises
    FailedStatus if the press is refused, tripped or stopped, after the events up to then.
    """
    plans, failed = _plans()
    begins = len(rig.journalled)
    try:
        yield from plans.abs_set(rig.press, order, wait=True)
    except failed:
        rig.press.stop()  # Another device may have failed.
        yield from _emitted(rig, begins, plans)
        raise
    except BaseException:  # An abort or a halt: the indentor lifts before any cleanup of an outer plan.
        rig.press.stop()
        raise
    yield from _emitted(rig, begins, plans)


def indent(rig: BlueskyBench, *, md: Mapping[str, Any] | None = None, **order: Any) -> Messages:
    """Run one press as a run of Bluesky; its start document names the run folder.

    Parameters
    ----------
    rig : BlueskyBench
    md : mapping, optional
        Metadata.
    order : float
        As in `press`.

    Yields
    ------
    Msg
    """
    from bluesky import preprocessors

    wrapped: Any = preprocessors.run_wrapper
    about = {
        "plan_name": "indent",
        "plan_args": order,
        "rig_run": rig.folder.path.name,
        "rig_journal": rig.start["uid"],
    }
    return (yield from wrapped(press(rig, **order), md={**about, **(md or {})}))


def _emitted(rig: BlueskyBench, begins: int, plans: Any) -> Messages:
    """Emit the events of the journal from the next beginning of a press on, in its order."""
    begun = False
    for document in rig.journalled[begins:]:
        stream = document["stream"] if document["doc"] == "event" else ""
        begun = begun or stream == "indentation_start"
        device = rig.rows.get(stream)
        if begun and device is not None:
            device.show({**document["data"], "t_s": document["t_s"]}, document["unix_s"])
            yield from plans.create(STREAM_NAMES[stream])
            yield from plans.read(device)
            yield from plans.save()


def _plans() -> tuple[Any, type[Exception]]:
    """Return the plan stubs of Bluesky, and its error of a failed status. Raises BlueskyMissingError."""
    try:
        from bluesky import plan_stubs
        from bluesky.utils import FailedStatus
    except ImportError:
        raise BlueskyMissingError(
            "rig.bluesky requires bluesky; install it with pip install 'indentation-rig[bluesky]'"
        ) from None
    return plan_stubs, FailedStatus
