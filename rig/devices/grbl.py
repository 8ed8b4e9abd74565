"""Stage with a GRBL 1.1 or grblHAL board. Source: GRBL 1.1 interface wiki."""

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from types import MappingProxyType
from typing import NoReturn

from rig.clock import Clock
from rig.devices.base import (
    LOOK_S,
    Axis,
    Looks,
    Stage,
    StageAlarm,
    StageError,
    StageNotHomed,
    StageRejected,
    StageReset,
    StageStatus,
    StageTimeout,
    is_held,
    next_look_s,
)
from rig.devices.counted_axis import HALT_S, HOME_S, LATE_FACTOR, LATE_S, POLL_S
from rig.devices.grbl_link import (
    ASK_TIMES,
    FULL,
    INCHES,
    JOG_CANCEL,
    OUTPUT_WORDS,
    REPLY_S,
    SOFT_LIMITS,
    STEP_DIRECTION,
    STEPS_PER_MM,
    STOP_PINS,
    GrblLink,
    Misplaced,
    Xyz,
    at_home,
    differences,
    differs,
    doubt_about_zero,
    enforced_settings,
    expected_s_of,
    expected_settings,
    feed_word,
    homes_to_origin,
    keys_of,
    machine_from,
    misplaced,
    number,
    on_a_step,
    overrun,
    parse_setting,
    refuse_firmware,
    refuse_missing,
    refuse_move,
    states,
    unsuited,
)
from rig.devices.registry import Evidence, Opener, StageKind
from rig.settings import BenchSettings, StageBounds
from rig.transport import Transport

# Longer than one step at the slowest speed, 1 mm/min.
STANDS_S = 0.5
# A second 0x85 at the very end of a jog leaves GRBL 1.1h suspended: Idle, but it reads no line until `~` or a
# reset.
CANCEL_AGAIN_S = 0.5
ASK_FOR_OFFSET = 35
# Attempts to have a line confirmed, in case noise corrupted it.
ATTEMPTS = 3
# Way up that the soft limits must leave to jogs before homing.
UNHOMED_ROOM_MM = 1.0
# A board that restarts because its port was opened is silent for about 2 s.
PROBE_S = 2.5
# Two pairs of an alarm and the banner after it.
NEWS = 4


class GrblStage(Stage):
    """Stage with a GRBL board, one move at a time; `output` is the output that set_output() switches.

    expected: settings, by number, that connect() requires of the board. bounds: limits that the board enforces
    through its own settings, which connect() writes if they differ.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        *,
        expected: Mapping[int, float] = MappingProxyType({INCHES: 0}),
        bounds: StageBounds | None = None,
        output: str = "off",
        backlash_mm: Xyz = (0.0, 0.0, 0.0),
    ) -> None:
        self._transport = transport
        self._clock = clock
        self._link = GrblLink(transport, clock)
        self._expected, self._bounds = expected, bounds
        self._output = output
        self._backlash_mm = backlash_mm
        self._settings: dict[int, float] = {}
        self._last: Xyz | None = None
        self._jogs = False  # whether a jog was sent, and no status since showed that it is over
        self._to_origin = False  # whether a homed board counts from where homing ends
        self._unlimited = False  # whether allow_unhomed_jogs() switched the soft limits off

    @property
    def homed(self) -> bool:
        """Whether the position is trusted: homed, and no alarm, reset, timeout or stop since."""
        return self._link.trusted

    def connect(self) -> str:
        """Connect and return the board's identification; ask the board for it, or reset it if it does not answer.

        Raises StageError, also if a setting of the board is not as expected.
        """
        try:
            printed = self._link.hello()
        except (StageTimeout, StageRejected, StageAlarm, StageReset):
            self._link.reset()
            printed = self._link.command("$I")
        refuse_firmware(self._transport.name, printed)
        self._link.full_speed()
        board = self._agreed_settings()
        limited = {} if self._bounds is None else enforced_settings(board, self._bounds)
        refuse_missing(self._transport.name, board, {**self._expected, **limited})
        self._to_origin = homes_to_origin(printed)
        wrong = differences(board, self._expected) + unsuited(printed, board)
        if wrong:
            raise StageError(
                f"{self._transport.name}: the settings of the board differ from the configuration"
                f"{keys_of(board, self._expected)}; send it {', '.join(map(str, wrong))}",
                "not_as_configured",
            )
        if limited:
            self._enforce({**board, **limited})
            self._unlimited = False
        return _identity(printed)

    def settings(self) -> dict[int, float]:
        """Return the settings of the board (`$$`), by number. Raises StageError."""
        lines = self._link.command("$$")
        self._settings = dict(pair for pair in map(parse_setting, lines) if pair)
        return dict(self._settings)

    def _agreed_settings(self) -> dict[int, float]:
        """Return the settings once two answers agree, since a misread number would stay in use."""
        board = self.settings()
        for _ in range(ATTEMPTS):
            before, board = board, self.settings()
            if board == before:
                return board
        raise StageError(
            f"{self._transport.name}: the board reports different settings each time ($$); check the cable and "
            "stage.baud",
            "answers_differ",
        )

    def _enforce(self, required: Mapping[int, float]) -> None:
        """Write the settings that differ and read all of them back."""
        for _ in range(ATTEMPTS):
            wrong = {n: value for n, value in required.items() if differs(self._settings, n, value)}
            if not wrong:
                return
            for n, value in wrong.items():
                self._link.command(f"${n}={number(value, 3)}")
            self._agreed_settings()
        refused = ", ".join(map(str, differences(self._settings, required)))
        raise StageError(f"{self._transport.name}: the board did not accept the settings {refused}", "not_kept")

    def homing(self) -> Looks:
        """Home with `$H`. Most boards do not respond meanwhile, and the position is not trusted.

        It is trusted again only if the board reported homing and rests where homing ends. An `ok` alone may belong
        to `$X`, which differs from `$H` by one bit.
        """
        if not self._link.in_step:
            self._link.reset()
        self._link.refuse_interference(self.status().state)
        if self._unlimited:
            self._enforce({**self._settings, SOFT_LIMITS: 1})
            self._unlimited = False
        self._link.trusted, times = False, self._link.times_stopped
        begun_s, printed, seen = self._clock.monotonic_s(), list[str](), 0
        for printed in self._link.talking("$H", HOME_S, LOOK_S):
            new, seen = states(printed[seen:]), len(printed)
            if self._clock.monotonic_s() - begun_s > REPLY_S and set(new) - {"Home"}:
                self._link.in_step = False
                raise StageTimeout(
                    f"{self._transport.name}: the board neither answers '$H' nor homes (state {new[-1]}); home again",
                    "does_not_home",
                )
            yield None
            self._link.send_now(b"?")
        now = self.status()
        home = at_home(self._settings, to_origin=self._to_origin)
        missed = misplaced(self._settings, home, (now.x_mm, now.y_mm, now.z_mm))
        if "Home" not in states(printed) or missed:
            self._refuse_not_homed(missed)
        self._link.trusted = self._link.times_stopped == times

    def _refuse_not_homed(self, missed: Misplaced | None) -> NoReturn:
        where = "" if missed is None else f": {missed}"
        raise StageError(
            f"{self._transport.name}: the board answered ok to '$H' but did not home{where}", "did_not_home"
        )

    def trust_position(self) -> None:
        self._link.trusted = True

    def unlock(self) -> None:
        self._link.recover()
        self._link.command("$X")

    def allow_unhomed_jogs(self) -> None:
        """Unlock, and switch the soft limits off if they leave no way up; homing switches them on again.

        A board that was switched on believes that it is at the upper end of its travel. Raises StageError.
        """
        self._link.recover()
        at = self._status()
        self._link.refuse_interference(at.state)
        self._link.command("$X")
        if at.z_mm > -UNHOMED_ROOM_MM and not self._unlimited:
            self._unlimited = True
            self._enforce({**self._settings, SOFT_LIMITS: 0})

    def status(self) -> StageStatus:
        """Return the status. Raises StageError, also if a jog is held or overridden at the controller."""
        now = self._status()
        if self._jogs:
            self._link.refuse_interference(now.state)
            self._jogs = now.state == "Jog"
        return now

    def _status(self) -> StageStatus:
        fields = self._link.ask_status()
        requests = 0
        while fields.machine is None and (fields.work is None or self._link.offset is None):
            # Work coordinates ($10) need the offset, which is sent seldom; a garbled line has neither.
            requests += 1
            if requests > (ASK_TIMES if fields.work is None else ASK_FOR_OFFSET):
                raise StageError(
                    f"{self._transport.name}: the status report contains no machine position; check setting $10 "
                    "of the board",
                    "no_position",
                )
            fields = self._link.ask_status()
        self._last = fields.machine or machine_from(fields.work, self._link.offset)
        return StageStatus(fields.state, *self._last)

    def moving(
        self,
        *,
        x_mm: float | None = None,
        y_mm: float | None = None,
        z_mm: float | None = None,
        speed_mm_s: float,
        look_s: float = LOOK_S,
    ) -> Looks:
        """Move straight to machine coordinates (mm) at speed_mm_s; done when the board reports arrival.

        The board is polled every look_s, and every POLL_S after the expected travel time. An axis with backlash
        always arrives in its negative direction: down, for Z. Raises StageError; MoveError, StageNotHomed before
        any byte.
        """
        target = {axis: mm for axis, mm in (("X", x_mm), ("Y", y_mm), ("Z", z_mm)) if mm is not None}
        refuse_move(target, speed_mm_s)
        if self._link.in_step and not self.homed:
            raise StageNotHomed(f"{self._transport.name}: the stage")
        beyond = overrun(target, self._last, self._backlash_mm)
        if beyond != target:
            yield from self._going(beyond, speed_mm_s, look_s)
        yield from self._going(target, speed_mm_s, look_s)

    def _going(self, target: dict[str, float], speed_mm_s: float, look_s: float) -> Looks:
        self._link.refuse_interference("")
        was = self._begin(
            "G1" + "".join(f"{axis}0" for axis in target),
            lambda present: self._to(target, present),
            speed_mm_s,
        )
        expected_s = expected_s_of(self._settings, was, target, speed_mm_s)
        yield from self._arriving(target, expected_s, look_s)

    def _to(self, target: Mapping[str, float], present: Xyz) -> Xyz:
        """Return the work coordinates of the present position that make those of the target zero."""
        x, y, z = (
            present[i] - on_a_step(self._settings, i, target[axis]) if axis in target else 0.0
            for i, axis in enumerate("XYZ")
        )
        return (x, y, z)

    def _begin(self, trigger: str, coordinates: Callable[[Xyz], Xyz], speed_mm_s: float) -> Xyz:
        """Set work zero, send the trigger once the board has confirmed it, and return the start position.

        Nothing moves without the confirmation. Raises StageError.
        """
        self._link.require_in_step(trigger)
        doubt, refused = None, None
        for attempt in range(ATTEMPTS):
            if attempt or self._last is None:
                self._status()
            present = self._present()
            try:
                doubt = doubt_about_zero(self._link, self._settings, present, coordinates(present), speed_mm_s)
                if doubt is None:
                    self._link.command(trigger, look_s=LOOK_S)
                    return present
            except StageRejected as error:
                refused = error
        if doubt is None:
            assert refused is not None
            raise refused
        raise StageError(
            f"{self._transport.name}: the board did not confirm the target ({doubt}); nothing was moved",
            "not_confirmed",
        )

    def _present(self) -> Xyz:
        """Return the position rounded to a step, since the board prints only three decimals."""
        assert self._last is not None
        x, y, z = (on_a_step(self._settings, i, mm) for i, mm in enumerate(self._last))
        return (x, y, z)

    def halt(self) -> None:
        """Feed hold, then reset at rest: no step is lost, and the queue is empty.

        Overrides are cleared first, since some grblHAL boards keep them through a reset.
        """
        if self._link.overrides != FULL:
            self._link.full_speed()
        deadline_s = self._clock.monotonic_s() + HALT_S
        trusted, times = self._link.trusted, self._link.times_stopped
        self.hold()
        while (state := self._status().state) not in ("Hold:0", "Idle"):
            if self._clock.monotonic_s() >= deadline_s:
                raise StageTimeout(
                    f"{self._transport.name}: the stage is not at rest {HALT_S:g} s after a feed hold (state "
                    f"{state}); use the emergency stop",
                    "not_at_rest",
                )
            if not is_held(state):
                self.hold()  # The first byte may have been lost.
            self._listen(POLL_S)
        self._link.reset()
        state = self._status().state
        if state != "Idle":
            raise StageError(
                f"{self._transport.name}: the board is in state {state} after a halt, so the position is lost; "
                "home again",
                "lost_in_halt",
            )
        self._link.trusted = trusted and self._link.times_stopped == times

    def stop(self) -> None:
        """Feed hold and reset in one write: no queue, no lock, no wait. Then home() or unlock()."""
        self._link.stop_now()

    def hold(self) -> None:
        """Slow down and hold; resume() continues, and the position stays trusted. Raises TransportError."""
        self._link.send_now(b"!")

    def resume(self, timeout_s: float = 5.0) -> None:
        """End a hold. A board that still slows down ignores `~`, so it is sent again.

        Raises StageError.
        """
        deadline_s = self._clock.monotonic_s() + timeout_s
        while is_held(self._status().state):
            if self._clock.monotonic_s() >= deadline_s:
                raise StageTimeout(
                    f"{self._transport.name}: the stage is still held after {timeout_s:g} s; release the hold at "
                    "its controller",
                    "still_held",
                )
            self._link.send_now(b"~")
            self._listen(POLL_S)

    def look(self) -> StageStatus:
        # Opening the port may have reset the board, or it was stopped; those messages are not answers.
        for _ in range(NEWS):
            with suppress(StageReset, StageAlarm):
                return self.status()
        return self.status()

    def steps_per_mm(self, axis: Axis) -> float:
        """Return `$100` … `$102`, with the sign of `$3`; known once connected."""
        reversed_axes = int(self._settings.get(STEP_DIRECTION, 0.0))
        sign = -1.0 if reversed_axes >> "xyz".index(axis) & 1 else 1.0
        return sign * self._settings[STEPS_PER_MM + "xyz".index(axis)]

    def jog(self, axis: Axis, by_mm: float, speed_mm_s: float) -> None:
        """Send `$J=` to an idle board, to a work zero that the board has confirmed.

        No single bit error makes the stage go down: the other axes have their work zero where they are. Raises
        StageError; MoveError before any byte.
        """
        refuse_move({axis: by_mm}, speed_mm_s)
        self._link.refuse_interference("")
        name, at = axis.upper(), "xyz".index(axis)
        self._jogs = True
        self._begin(
            f"$J={name}0{feed_word(speed_mm_s)}",
            lambda present: self._to({name: present[at] + by_mm}, present),
            speed_mm_s,
        )

    def end_jog(self, timeout_s: float = 5.0) -> None:
        """Send 0x85 until the board is at rest, since a cancel before the jog begins is lost.

        A reset, as in `halt`, would lock some boards before homing. A board that reports Jog at a constant position,
        as some grblHAL do after a cancel, is at rest. Raises StageError, also if a line may still wait in the board.
        """
        if not self._link.in_step:
            raise StageError(
                f"{self._transport.name}: a command may still wait in the board; stop the stage", "line_waits"
            )
        deadline_s = self._clock.monotonic_s() + timeout_s
        self._jogs = False
        self._link.send_now(JOG_CANCEL)
        stood_at, stood_s, sent_s = None, 0.0, self._clock.monotonic_s()
        while (now := self.status()).state == "Jog":
            now_s = self._clock.monotonic_s()
            if now != stood_at:
                stood_at, stood_s = now, now_s
            if now_s - stood_s >= STANDS_S:
                return
            if now_s >= deadline_s:
                raise StageTimeout(
                    f"{self._transport.name}: the stage still jogs after {timeout_s:g} s", "still_jogging"
                )
            self._listen(POLL_S)
            if self._clock.monotonic_s() - sent_s >= CANCEL_AGAIN_S:
                sent_s = self._clock.monotonic_s()
                self._link.send_now(JOG_CANCEL)

    def set_output(self, on: bool) -> None:
        """Switch coolant (M8, M9) or spindle (M3, M5); the board does so when all earlier motion has ended."""
        if self._output == "off":
            raise StageError(
                f"{self._transport.name}: no output of the board is configured; set sync.output to coolant or "
                "spindle",
                "no_output",
            )
        self._link.command(OUTPUT_WORDS[self._output][on], look_s=LOOK_S)

    def active_inputs(self) -> frozenset[str]:
        """Return the stop inputs that were active in the last status."""
        return frozenset(STOP_PINS[letter] for letter in self._link.pins if letter in STOP_PINS)

    def close(self) -> None:
        self._transport.close()

    def _listen(self, seconds: float) -> None:
        self._link.listen_until(self._clock.monotonic_s() + seconds)

    def _arriving(self, target: dict[str, float], expected_s: float, look_s: float) -> Looks:
        begun_s = self._clock.monotonic_s()
        over_s, deadline_s = begun_s + expected_s, begun_s + LATE_FACTOR * expected_s + LATE_S
        due_s = next_look_s(begun_s, over_s, look_s)
        self._link.listen_until(min(over_s, due_s))
        while (now := self.status()).state != "Idle":
            self._link.refuse_interference(now.state)
            if now.state.startswith(("Alarm", "Sleep", "Check")):
                raise StageError(
                    f"{self._transport.name}: the board changed to state {now.state} during a move; remove the "
                    "cause, then home",
                    "left_move",
                )
            if self._clock.monotonic_s() >= deadline_s:
                raise StageTimeout(
                    f"{self._transport.name}: the move did not end in time (state {now.state})", "not_over"
                )
            if self._clock.monotonic_s() >= due_s:
                yield now
                due_s = next_look_s(self._clock.monotonic_s(), over_s, look_s)
            self._link.listen_until(min(max(over_s, self._clock.monotonic_s() + POLL_S), due_s))
        self._link.refuse_interference(now.state)
        missed = misplaced(self._settings, target, (now.x_mm, now.y_mm, now.z_mm))
        if missed:
            now = self.status()  # A single report may be garbled.
            missed = misplaced(self._settings, target, (now.x_mm, now.y_mm, now.z_mm))
        if missed:
            raise StageError(f"{self._transport.name}: {missed}", "not_there")


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    x, y, z = (settings.calibration.value(f"{axis}_backlash_mm", 0.0) for axis in "xyz")
    return GrblStage(
        opener(settings.stage.port),
        clock,
        expected=expected_settings(settings),
        bounds=settings.bounds,
        output=settings.sync.output if settings.sync.output in OUTPUT_WORDS else "off",
        backlash_mm=(x, y, z),
    )


def _identity(printed: Iterable[str]) -> str:
    return " ".join(line for line in printed if line.startswith("[") and not line.startswith("[MSG"))


def _probe(opener: Opener, clock: Clock, settings: BenchSettings) -> str | None:
    """Ask for the status (`?`), and at rest for the identification (`$I`)."""
    link = GrblLink(opener(settings.stage.port), clock)
    deadline_s = clock.monotonic_s() + PROBE_S
    state = None
    while state is None:
        with suppress(StageReset, StageAlarm, StageTimeout):
            state = link.ask_status().state
        if state is None and clock.monotonic_s() >= deadline_s:
            return None
    if state.partition(":")[0] not in ("Idle", "Alarm"):  # a board in motion or on hold reads no lines
        return f"GRBL board in state {state}"
    try:
        printed = link.hello()
    except StageError:
        return "GRBL board"
    refuse_firmware(link.name, printed)
    return _identity(printed)


DEVICE = StageKind(
    name="grbl",
    device="GRBL 1.1 or grblHAL board",
    driver=_driver,
    outputs=("off", "coolant", "spindle"),
    inputs=("door", "hold"),
    ramps=True,
    twin="sim.devices.grbl.board:grbl_twin",
    probe=_probe,
    tests=("tests/rig/test_grbl_driver.py", "tests/rig/test_grbl_conformance.py"),
    evidence=Evidence(
        manual="GRBL 1.1 wiki: commands, interface, configuration",
        firmware="GRBL 1.1h and grblHAL, each as a process on a host",
    ),
)
