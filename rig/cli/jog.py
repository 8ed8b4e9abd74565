"""`rig jog`: move an axis while a key is held, or by a distance."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, NotRequired, get_args

import typer

from rig.cli.bench import HomedJson, by_hand, live_line, print_entries
from rig.cli.keyboard import single_keys
from rig.cli.options import ConfigOption, JsonOption, WithoutForceOption
from rig.cli.output import ExitCode, complain, err, one_line_errors, resting
from rig.cli.request import Needs, Rule, refuse, takes
from rig.clock import Clock
from rig.devices.base import Axis
from rig.engine.dead_man import Direction
from rig.errors import BadInputError, LimitError
from rig.manual.jog import FASTEST_MM_S, ByHand, HeldDirection, Moved
from rig.plan.config import load_config
from rig.settings import SLOWEST_MM_S
from rig_shared.outputs import Code

_FARTHEST_MM = 1000.0
KEYS = {
    ord("d"): Direction("x", +1), ord("a"): Direction("x", -1),
    ord("e"): Direction("y", +1), ord("c"): Direction("y", -1),
    ord("w"): Direction("z", +1), ord("s"): Direction("z", -1),
}  # fmt: skip
_QUIT = ord("q")
# Held keys repeat about 30 times a second, after a pause that a tap must not outlast.
RELEASED_S = 0.15
_IDLE_LOOK_S, _KEY_LOOK_S = 0.02, 0.005


class JoggedJson(HomedJson):
    """Position after a manual move."""

    ended_by_text: str | None
    """Cause of the stop."""
    code: NotRequired[Code]


@dataclass(frozen=True)
class JogRequest:
    """Options of `rig jog`."""

    config: ConfigOption
    axis: Annotated[
        str | None, typer.Option(metavar="x|y|z", help="Axis to move by --by-mm: x across, y along, z up.")
    ] = None
    by_mm: Annotated[
        float | None,
        typer.Option(
            metavar="D",
            help="Signed distance, in mm; nonzero, up to 1000 either way. Default: move while a key is held.",
        ),
    ] = None
    speed_mm_s: Annotated[float, typer.Option(metavar="V", help="Speed of the axis, 0.017 to 10 mm/s.")] = 1.0
    without_force: WithoutForceOption = False
    as_json: JsonOption = False

    rules: ClassVar[Sequence[Rule]] = (
        Needs("--axis", ("--by-mm",), "both_or_neither"),
        Needs("--by-mm", ("--axis",), "both_or_neither"),
    )


@takes(JogRequest)
def command(request: JogRequest) -> None:
    """Move an axis; it stops within the travel of 0.2 s if the key, this process or the connection is lost."""
    with one_line_errors(as_json=request.as_json):
        refuse(request)
        settings, speed_mm_s = load_config(request.config), request.speed_mm_s
        if not SLOWEST_MM_S <= speed_mm_s <= FASTEST_MM_S:
            raise BadInputError(
                f"--speed-mm-s {speed_mm_s:g}: must be {SLOWEST_MM_S:.2g} to {FASTEST_MM_S:g} mm/s", "outside_range"
            )
        target = None if request.axis is None or request.by_mm is None else way(request.axis, request.by_mm)
        with (
            live_line(settings) as show,
            by_hand(settings, show, without_force=request.without_force) as (hand, clock),
        ):
            if target is None:
                with resting():
                    moved = _jog_by_keys(hand, clock, speed_mm_s)
            else:
                direction, far_mm = target
                moved = hand.go(lambda: direction, speed_mm_s, far_mm)
            known = hand.measured_contact()
        at, contact = moved.at, known.as_json()
        found: JoggedJson = {
            "state": at.state,
            "x_mm": at.x_mm,
            "y_mm": at.y_mm,
            "z_mm": at.z_mm,
            "contact": contact["contact"],
            "may_touch": contact["may_touch"],
            "force_gwt": moved.force_gwt,
            "measured_unix_s": contact["measured_unix_s"],
            "where_text": contact["where_text"],
            "to_do_text": contact["to_do_text"],
            "ended_by_text": moved.ended_by,
        }
        if moved.problem is not None:
            found["code"] = moved.problem.code
        print_entries(found, as_json=request.as_json)
    if moved.ended_by is not None:
        complain(f"stopped: {moved.ended_by}")
        raise typer.Exit(ExitCode.STOPPED)


def way(axis: str, by_mm: float) -> tuple[Direction, float]:
    """Return direction and distance (mm) from the typed text; raise BadInputError if invalid."""
    axes: tuple[Axis, ...] = get_args(Axis)
    found = next((one for one in axes if one == axis), None)
    if found is None:
        raise BadInputError(f"--axis {axis}: must be x, y or z", "unknown_choice")
    if not 0 < abs(by_mm) <= _FARTHEST_MM:
        raise BadInputError(
            f"--by-mm {by_mm:g}: must be a nonzero distance of at most {_FARTHEST_MM:g} mm", "outside_range"
        )
    return Direction(found, 1 if by_mm > 0 else -1), abs(by_mm)


def _jog_by_keys(hand: ByHand, clock: Clock, speed_mm_s: float) -> Moved:
    """Jog until q; after a motion ends by itself, its key must be pressed again."""
    err.print("hold d/a to move x +/−, e/c for y +/−, w/s for z +/−; press q to quit")
    with single_keys() as read_keys:
        held = HeldKey(clock, read_keys)
        while not held.finished:
            if held() is None:
                hand.look()
                clock.wait_s(_IDLE_LOOK_S)
                continue
            try:
                ended_by = hand.go(held, speed_mm_s).ended_by
            except LimitError as error:
                ended_by = str(error)
            if ended_by is not None:
                complain(f"stopped: {ended_by}")
                while held() is not None:
                    clock.wait_s(_IDLE_LOOK_S)
    return hand.look()


class HeldKey:
    """Direction of the key that is held; finished at q or when the input ends.

    What was typed while nothing read the keys, since this process stood still or a slow sensor was read, may have
    been typed long ago: only a key that is repeated now is held then.
    """

    def __init__(self, clock: Clock, read_keys: Callable[[], bytes | None]) -> None:
        """Take a function that returns the bytes typed since its last call, or None at the end of the input."""
        self._held, self._read_keys = HeldDirection(clock, RELEASED_S), read_keys
        self._clock, self._read_s = clock, clock.monotonic_s()
        self.finished = False

    def __call__(self) -> Direction | None:
        now_s = self._clock.monotonic_s()
        late, self._read_s = now_s - self._read_s > RELEASED_S, now_s
        typed = self._typed()
        if typed and late:
            self._held.say(None)
            while typed:
                typed = self._typed()
            while not (typed or self.finished) and self._clock.monotonic_s() < now_s + RELEASED_S:
                self._clock.wait_s(_KEY_LOOK_S)
                typed = self._typed()
            self._read_s = self._clock.monotonic_s()
        if typed and not self.finished:
            self._held.say(KEYS.get(typed[-1]))
        return None if self.finished else self._held()

    def _typed(self) -> bytes:
        """Return what was typed since the last call."""
        typed = self._read_keys()
        self.finished = self.finished or typed is None or _QUIT in typed
        return typed or b""
