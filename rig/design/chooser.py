"""Choice of presses during a run: read the count of each press, then choose the next press."""

import json
import multiprocessing
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, NamedTuple, Protocol

from threadpoolctl import threadpool_limits

from rig.clock import WallClock
from rig.design.adaptive import AdaptiveRule, PressChoice, SpikeCount
from rig.design.counts import TEN_MINUTES_S, CountModel
from rig.design.counts_from.opened import opened
from rig.design.counts_from.source import AcceptedCounts, MadePress
from rig.design.design import DesignRequest
from rig.design.exceptions import DesignError
from rig.design.press_times import PressTimes
from rig.design.response_table import ResponseTable
from rig.errors import CountError, RigError
from rig.plan.config import Config
from sim.finger_process import belong_to_parent
from sim.workers import leaving_signals_to_us

_POLL_S = 0.002
_BEGINS_S = 120.0
_END_S = 5.0


class Decision(NamedTuple):
    """Choice of a press: the previous count, the number of the next press or None, the reason, and its basis."""

    spikes: int | None
    possible: int | None
    reason: str
    information_bits: float | None
    probabilities: tuple[float, ...]
    chosen_in_s: float


@dataclass(frozen=True, eq=False)
class Choosing:
    """Inputs of a choice: request, source, and the presses within the limits with their responses and times."""

    request: DesignRequest
    source: str
    config: Config
    table: ResponseTable
    times: PressTimes
    history: tuple[SpikeCount, ...] = ()
    made: int = 0  # presses in the journal of a stopped run; the count of the last one may still be missing

    @property
    def model(self) -> CountModel:
        """Window and unknowns of the counts."""
        return CountModel(self.request.hold_s, self.request.unknowns)

    def refuse_too_short(self) -> None:
        """Raise DesignError if not even one press fits into the session."""
        needed_s = self.times.first_s + float(self.times.press_s.min())
        if needed_s > 60 * self.request.minutes:
            raise DesignError(
                f"{self.request.minutes:g} minutes are too short: the shortest press takes {needed_s:.0f} s",
                "too_few_minutes",
            )


class NextPressChooser(Protocol):
    """Chooser of presses that never blocks: begin(), then is_ready() until decision()."""

    truth: Mapping[str, Any] | None

    def begin(self, possible: int | None) -> None:
        """Ask for the next press, after this one was made, or for the first one."""

    def is_ready(self) -> bool:
        """Return whether there is a decision, or an error. Raises CountError."""

    def decision(self) -> Decision:
        """Return the decision."""

    def close(self) -> None:
        """End the source."""


class InProcessChooser:
    """Chooser in this process, for virtual runs and for the process of a real one."""

    def __init__(self, what: Choosing) -> None:
        """Raise CountError if the source cannot be opened, or already has counts that cannot be right."""
        with threadpool_limits(1):
            self._rule = AdaptiveRule.of(
                what.table, what.request.candidates, what.model, what.times, what.request.minutes,
                seed=what.request.seed,
            )  # fmt: skip
            self._posterior, self._state = self._rule.replayed(what.history)
        self._minutes, self._table = what.request.minutes, what.table
        self._source = opened(what.source, what.config, what.table, what.model)
        known = [None if one.spikes is None else int(one.spikes) for one in what.history]
        self._counts = AcceptedCounts(self._source, known)
        self._counts.look(what.made)
        self.truth = _plain(self._source.truth())
        self._press: int | None = None
        self._clock = WallClock()

    def begin(self, possible: int | None) -> None:
        """Note the press, whose count is now awaited."""
        self._press = possible
        if possible is None:
            return
        state, press = self._state, self._table.presses[possible]
        change_s = self._rule.times.change_s if state.shape not in (None, press.shape) else 0.0
        tau = (state.elapsed_s + change_s - 30 * self._minutes) / TEN_MINUTES_S
        self._source.made(MadePress(len(state.made), possible, press, tau))

    def is_ready(self) -> bool:
        """Return whether the count has arrived. Raises CountError."""
        made = len(self._state.made)
        self._counts.look(made + (self._press is not None))
        return self._press is None or self._counts.count(made) is not None

    def decision(self) -> Decision:
        """Take the count in, and choose."""
        began_s = self._clock.monotonic_s()
        count = None
        with threadpool_limits(1):
            if self._press is not None:
                count = self._counts.count(len(self._state.made))
                counted = SpikeCount(self._press, count)
                self._posterior, self._state = self._rule.updated(self._posterior, self._state, counted)
            found = self._rule.chosen(self._posterior, self._state)
            probabilities = tuple(float(p) for p in self._posterior.probabilities[0])
        possible, bits = (found.press, found.information_bits) if isinstance(found, PressChoice) else (None, None)
        took_s = self._clock.monotonic_s() - began_s
        return Decision(count, possible, found.reason, bits, probabilities, took_s)

    def close(self) -> None:
        """Close the source."""
        self._source.close()


def _plain(truth: Mapping[str, Any] | None) -> Mapping[str, Any] | None:
    """Return a source's description of its nerve as JSON values for the journal. Raises TypeError, ValueError."""
    found: dict[str, Any] | None = json.loads(json.dumps(None if truth is None else dict(truth), allow_nan=False))
    return found


class ChooserLostError(CountError):
    """Error of a process of the choice that ended, or that does not answer."""

    default_code = "chooser_lost"


class ChooserProcess:
    """Chooser in a process of its own, for a run whose process must answer a stop at once; close() it.

    Whatever a source does, it delays nothing here: this class only polls a pipe.
    """

    def __init__(self, what: Choosing, look: Callable[[], None] = lambda: None) -> None:
        """Begin the process, and wait until its source is open; `look` is called meanwhile.

        Raises CountError, ChooserLostError.
        """
        context = multiprocessing.get_context("spawn")
        self._near, far = context.Pipe()
        self._process = context.Process(target=_serve, args=(far, what), name="chooser", daemon=True)
        with leaving_signals_to_us():
            self._process.start()
        far.close()
        try:
            clock = WallClock()
            until_s = clock.monotonic_s() + _BEGINS_S
            while not self._near.poll(_POLL_S):
                look()
                if clock.monotonic_s() > until_s:
                    raise ChooserLostError(f"counts={what.source}: the source does not open within {_BEGINS_S:g} s")
            self.truth: Mapping[str, Any] | None = self._received()
        except BaseException:
            self.close()
            raise

    def begin(self, possible: int | None) -> None:
        """Send the press. Raises ChooserLostError."""
        try:
            self._near.send(possible)
        except OSError:
            raise self._lost() from None

    def is_ready(self) -> bool:
        """Return whether an answer waits. Raises ChooserLostError."""
        try:
            return self._near.poll(0.0)
        except OSError:
            raise self._lost() from None

    def decision(self) -> Decision:
        """Return the answer. Raises CountError, ChooserLostError."""
        return Decision(*self._received())

    def close(self) -> None:
        """End the process, whatever it is doing."""
        self._near.close()
        self._process.kill()
        self._process.join(_END_S)

    def _received(self) -> Any:
        try:
            kind, found = self._near.recv()
        except (EOFError, OSError):
            raise self._lost() from None
        if kind == "raised":
            raise found
        return found

    @staticmethod
    def _lost() -> ChooserLostError:
        return ChooserLostError("the process that receives the counts has ended")


def _serve(far: "Connection[Any, Any]", what: Choosing) -> None:
    belong_to_parent()
    os.dup2(2, 1)  # what a source prints must not be in the output of the command
    clock = WallClock()
    kind: type[CountError] = CountError  # until the source is open; then a failure only ends the counts
    try:
        chooser = InProcessChooser(what)
        far.send(("gave", chooser.truth))
        kind = ChooserLostError
        while True:
            chooser.begin(far.recv())
            while not chooser.is_ready():
                clock.wait_s(_POLL_S)
            far.send(("gave", tuple(chooser.decision())))
    except (EOFError, BrokenPipeError):
        return
    except Exception as error:
        if isinstance(error, RigError):
            error = _ours(error)
        else:
            error = kind(f"the source of the counts failed: {type(error).__name__}: {error}", "source_failed")
        far.send(("raised", error))


def _ours(error: RigError) -> RigError:
    """Return an error that the process of the run can read: it must not import a module of the lab."""
    if not type(error).__module__.startswith("rig."):
        return CountError(str(error), str(error.code))
    error.__dict__ = {"code": str(error.code)}  # not what a module of the lab added
    return error


def probabilities_as_text(candidates: Sequence[str], probabilities: Sequence[float]) -> str:
    """Return probabilities for the journal, to the last bit."""
    return json.dumps(dict(zip(candidates, probabilities, strict=True)))
