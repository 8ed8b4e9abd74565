"""`rig jog`: move an axis by steps, with keys or by one distance."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, NotRequired, get_args

import typer

from rig.cli.bench import HomedJson, Show, live_line, manual_session, print_entries
from rig.cli.keyboard import ReadKeys, single_keys
from rig.cli.options import ConfigOption, JsonOption, WithoutForceOption, option
from rig.cli.output import ExitCode, complain, err, resting
from rig.cli.request import Needs, Rule, takes
from rig.clock import Clock, WallClock
from rig.devices.base import Axis, ForceError, StageError
from rig.engine.motion import Direction
from rig.engine.steps import MOST_MM, StepEnd
from rig.errors import BadInputError, EngineError
from rig.manual.session import FASTEST_MM_S, SIZES_MM, SPEED_MM_S, ManualSession
from rig.manual.without_force import SessionWithoutForce
from rig.plan.config import load_config
from rig.settings import SLOWEST_MM_S
from rig_shared.outputs import Code

Session = ManualSession | SessionWithoutForce

KEYS = {
    "d": Direction("x", +1), "a": Direction("x", -1),
    "e": Direction("y", +1), "c": Direction("y", -1),
    "w": Direction("z", +1), "s": Direction("z", -1),
}  # fmt: skip
_SIZE_KEYS = {str(number): mm for number, mm in enumerate(SIZES_MM, start=1)}
_QUIT = b"q"
QUIET_S = 0.8
"""Time without a key after which it counts as released; a held key repeats after 0.7 s at the latest."""
_LOOK_S = 0.02
HELP = (
    "d/a steps x +/−, e/c y +/−, w/s z +/−; "
    + ", ".join(f"{key}: {mm:g}" for key, mm in _SIZE_KEYS.items())
    + " mm, + and − the next size; h homes, z zeroes, p parks, q quits"
)


class JoggedJson(HomedJson):
    """Position after a manual move."""

    ended_by_text: str | None
    """Cause of the stop."""
    code: NotRequired[Code]


@dataclass(frozen=True)
class JogRequest:
    """Options of `rig jog`."""

    config: ConfigOption
    axis: Annotated[str | None, option("Axis to move by --by-mm: x across, y along, z up.", "x|y|z")] = None
    by_mm: Annotated[
        float | None, option("Signed distance, in mm; nonzero, up to 5 either way. Default: steps by keys.", "D")
    ] = None
    speed_mm_s: Annotated[float, option("Highest speed, 0.017 to 10 mm/s; down and sideways it is lower.", "V")] = (
        SPEED_MM_S
    )
    without_force: WithoutForceOption = False
    as_json: JsonOption = False

    rules: ClassVar[Sequence[Rule]] = (
        Needs("--axis", ("--by-mm",), "both_or_neither"),
        Needs("--by-mm", ("--axis",), "both_or_neither"),
    )


@takes(JogRequest)
def command(request: JogRequest) -> None:
    """Move an axis by steps of at most 5 mm; a touch ends a step."""
    settings, speed_mm_s = load_config(request.config), request.speed_mm_s
    if not SLOWEST_MM_S <= speed_mm_s <= FASTEST_MM_S:
        raise BadInputError(
            f"--speed-mm-s {speed_mm_s:g}: must be {SLOWEST_MM_S:.2g} to {FASTEST_MM_S:g} mm/s", "outside_range"
        )
    axis, by_mm = request.axis, request.by_mm
    target = None if axis is None or by_mm is None else way(axis, by_mm, MOST_MM)
    with (
        live_line(settings) as show,
        manual_session(settings, show, without_force=request.without_force) as session,
    ):
        if target is None:
            with resting(), single_keys() as read_keys:
                KeySteps(session, WallClock(), read_keys, show, speed_mm_s).run()
            found = session.contact()
        else:
            found = session.step(*target, speed_mm_s)
        at = session.look()
    contact, problem = found.known.as_json(), found.ended_by
    jogged: JoggedJson = {
        "state": at.state,
        "x_mm": at.x_mm,
        "y_mm": at.y_mm,
        "z_mm": at.z_mm,
        "contact": contact["contact"],
        "may_touch": contact["may_touch"],
        "force_gwt": found.force_gwt,
        "measured_unix_s": contact["measured_unix_s"],
        "where_text": contact["where_text"],
        "to_do_text": contact["to_do_text"],
        "ended_by_text": None if problem is None else str(problem),
    }
    if problem is not None:
        jogged["code"] = problem.code
    print_entries(jogged)
    if problem is not None:
        complain(f"stopped: {problem}")
        raise typer.Exit(ExitCode.STOPPED)


def way(axis: str, by_mm: float, most_mm: float) -> tuple[Direction, float]:
    """Return direction and distance (mm) from the typed text; raise BadInputError if invalid."""
    axes: tuple[Axis, ...] = get_args(Axis)
    found = next((one for one in axes if one == axis), None)
    if found is None:
        raise BadInputError(f"--axis {axis}: must be x, y or z", "unknown_choice")
    if not 0 < abs(by_mm) <= most_mm:
        raise BadInputError(
            f"--by-mm {by_mm:g}: must be a nonzero distance of at most {most_mm:g} mm either way", "outside_range"
        )
    return Direction(found, 1 if by_mm > 0 else -1), abs(by_mm)


class KeySteps:
    """Steps by keys, one a key; keys typed while something moves are dropped, so that no repeat runs ahead."""

    def __init__(self, session: Session, clock: Clock, read_keys: ReadKeys, show: Show, speed_mm_s: float) -> None:
        """read_keys: returns the bytes typed since its last call, or None at the end of the input."""
        self._session, self._clock, self._read_keys = session, clock, read_keys
        self._show, self._speed_mm_s, self.size_mm = show, speed_mm_s, 0.1
        self._over = False

    def run(self) -> None:
        """Carry out a key at a time until q or the end of the input. Raises StageError, TransportError."""
        err.print(HELP)
        while not self._over:
            key = self._typed()[:1].decode(errors="replace")
            if not key:
                self._show(self._session.look(), self._session.force_gwt)
                self._clock.wait_s(_LOOK_S)
            elif not self._over:
                self._press(key)

    def _press(self, key: str) -> None:
        if key in _SIZE_KEYS or key in ("+", "-"):
            self._choose(key)
            return
        problem = self._carried_out(key)
        self._drop()
        if problem is not None:
            complain(f"stopped: {problem}")
            self._wait_for_release()

    def _choose(self, key: str) -> None:
        place = SIZES_MM.index(self.size_mm) + (1 if key == "+" else -1)
        self.size_mm = _SIZE_KEYS.get(key) or SIZES_MM[min(max(place, 0), len(SIZES_MM) - 1)]
        err.print(f"step {self.size_mm:g} mm")

    def _carried_out(self, key: str) -> Exception | None:
        """Carry out a key, and return what refused it or ended it early."""
        session, found = self._session, None
        try:
            if key in KEYS:
                found = session.step(KEYS[key], self.size_mm, self._speed_mm_s)
            elif key == "h":
                session.home()
            elif key == "z":
                session.zero()
            elif key == "p":
                found = session.park()
        except (EngineError, ForceError, StageError, BadInputError) as error:
            return error
        return found.ended_by if isinstance(found, StepEnd) else None

    def _wait_for_release(self) -> None:
        """After a step that ended early, wait until no key has been typed for a while: a held key starts no other."""
        quiet_s = self._clock.monotonic_s() + QUIET_S
        while not self._over and self._clock.monotonic_s() < quiet_s:
            if self._typed():
                quiet_s = self._clock.monotonic_s() + QUIET_S
            self._clock.wait_s(_LOOK_S)

    def _drop(self) -> None:
        while self._typed():
            pass

    def _typed(self) -> bytes:
        """Return what was typed since the last call; note q and the end of the input."""
        typed = self._read_keys()
        self._over = self._over or typed is None or _QUIT in typed
        return typed or b""
