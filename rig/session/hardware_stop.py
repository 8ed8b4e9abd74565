"""Stop button of the participant and hardware trip of `[stop]`: checked before a run and polled during it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from rig.control.owned_stage import OwnedStage
from rig.devices.base import HasSetPoint, Stage, StageAlarm, StageError, StageHeld, is_held
from rig.devices.stop_key import StopKey, StopKeyError
from rig.engine import Engine, RunAborted, TripError, WatchedBench
from rig.engine.engine import StopInputs, no_stop_inputs
from rig.errors import BadInputError
from rig.settings import BenchSettings, StopSettings
from rig.transport import TransportError

BY_THE_BUTTON = "stopped at once by the participant's stop button"
_SET_POINT_WITHIN = 0.02  # Relative tolerance: a transmitter rounds to its divisions.


class StopButton:
    """Stop button of a real run; close() it, or use it in a `with`."""

    def __init__(self, settings: StopSettings, stage: OwnedStage, stop: Callable[[], object]) -> None:
        """Open the key, if one is configured; BadInputError if it is missing.

        `stop` stops the stage past every queue, from any thread but the main one.
        """
        self._settings, self._stage, self._stop = settings, stage, stop
        self.tested = self.stopped = False
        self._last = "not read yet"
        self.key = _key(settings)

    @property
    def there(self) -> bool:
        """Whether a button is configured."""
        return self._settings.kind != "off"

    def pressed(self) -> bool:
        """Return whether the button is held down. Raises StageError, TransportError."""
        if self.key is not None:
            return self.key.pressed
        return self._settings.input in self._stage.active_inputs()

    def arm(self) -> None:
        """Make a press of the key stop the stage and end the run; an input of the board always does."""
        if self.key is not None:
            self.key.arm(self._pressed)

    def _pressed(self) -> None:
        self.stopped = True
        with suppress(Exception):  # The run may have just ended; if the stage is gone, the run notices by itself.
            self._stop()

    def record_input(self, *, pressed: bool) -> None:
        """Record the state of the controller's input."""
        self._last = "PRESSED" if pressed else "not pressed"

    @property
    def state(self) -> str:
        """State of the button in words, polled now."""
        try:
            self.record_input(pressed=self.pressed())
        except (StageError, TransportError) as error:
            self._last = f"cannot be read: {error}"
        return self.last_state

    @property
    def last_state(self) -> str:
        """Last state in words, without polling the controller; safe from another thread."""
        if self.stopped:
            return "PRESSED; it has stopped the stage"
        if self.key is not None:
            held = self.key.problem or ("PRESSED" if self.key.pressed else "not pressed")
        else:
            held = self._last
        return f"{held}, {'tested' if self.tested else 'not tested'}"

    @property
    def words(self) -> str:
        """Button, its state and the hardware trip, for the summary."""
        settings = self._settings
        found = {
            "off": "no stop button is configured",
            "board": f"the controller's input {settings.input}",
            "key": f"the key {settings.device}",
        }[settings.kind]
        button = f"{found}, {self.state}" if self.there else found
        if settings.trip_input is None:
            return button
        at = "" if settings.trip_gwt is None else f" at {settings.trip_gwt:g} gwt"
        return f"{button}; hardware trip{at} on the controller's input {settings.trip_input}"

    def as_json(self) -> dict[str, Any]:
        """Return the fields for the journal's first document."""
        return {"kind": self._settings.kind, "tested": self.tested}

    def close(self) -> None:
        """Release the key."""
        if self.key is not None:
            self.key.close()

    def __enter__(self) -> "StopButton":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _key(settings: StopSettings) -> StopKey | None:
    """Open the key, if the button is one. Raises BadInputError."""
    if settings.kind != "key" or settings.device is None:
        return None
    try:
        return StopKey(Path(settings.device), settings.key_code)
    except StopKeyError as error:
        raise BadInputError(f"stop.device: {error}", error.code) from None


@contextmanager
def key_interrupting(settings: BenchSettings, interrupt: Callable[[], object]) -> Iterator[None]:
    """Make a press of the key interrupt a command that moves the stage. Raises BadInputError."""
    key = _key(settings.stop)
    if key is None:
        yield
        return
    key.arm(interrupt)
    try:
        yield
    finally:
        key.close()


def refuse_stop_inputs(settings: BenchSettings, bench: WatchedBench) -> None:
    """Refuse a run if a stop input is active, or if the transmitter trips at another force than configured.

    Raises BadInputError, with the key of `[stop]`, before a motion; StageError, ForceError or TransportError if a
    device does not respond.
    """
    stop = settings.stop
    if stop.inputs:
        bench.stage.look()
        active = bench.stage.active_inputs()
        for key, name in stop.inputs.items():
            if name in active:
                remedy = (
                    "release the stop button" if key == "input" else "unload the force sensor and check its relay"
                )
                raise BadInputError(
                    f"stop.{key} = {name!r}: this input is active, so nothing may move; {remedy}", "input_active"
                )
    if stop.trip_gwt is not None and isinstance(bench.force, HasSetPoint):
        found_gwt = bench.force.set_point_gwt(stop.trip_register)
        if abs(found_gwt - stop.trip_gwt) > _SET_POINT_WITHIN * stop.trip_gwt:
            raise BadInputError(
                f"stop.trip_gwt = {stop.trip_gwt:g} gwt, but the set-point of the transmitter (register "
                f"{stop.trip_register}) is {found_gwt:g} gwt; make them equal",
                "another_set_point",
            )


@contextmanager
def explained_by_stop_inputs(settings: BenchSettings, stage: Stage) -> Iterator[None]:
    """Raise what a stop input means where the controller stopped first and reported it: by an alarm, while homing.

    Raises RunAborted if the participant pressed the button on the controller, and TripError if the hardware trip
    stopped the stage.
    """
    stop = settings.stop
    try:
        yield
    except (StageHeld, StageAlarm) as error:
        if stop.kind == "off" and not stop.inputs:
            raise
        held, active = isinstance(error, StageHeld), _active_now(stage)
        if stop.trip_input in active:
            raise _relay_trip(stop) from error
        if stop.kind == "board" and (held or stop.input in active):
            raise RunAborted(BY_THE_BUTTON, "stop_button") from error
        raise


def stop_inputs_of(settings: BenchSettings, button: StopButton | None) -> StopInputs:
    """Return the check of the stop inputs that a run makes with each force reading.

    At rest the controller is polled, in motion its last status counts. The check returns a trip or None, and raises
    RunAborted, with the stage at rest, if the button was pressed.
    """
    stop, key = settings.stop, None if button is None else button.key
    if stop.kind == "off" and not stop.inputs:
        return no_stop_inputs
    with_its_state = bool({"door", "hold"} & set(stop.inputs.values()))  # A board reports both in one line.

    def check(engine: Engine, *, at_rest: bool) -> TripError | None:
        if key is not None and key.problem:
            return TripError(f"the stop button no longer answers: {key.problem}; connect it again", "button_gone")
        if not stop.inputs:
            return None
        stage = engine.bench.stage

        def poll() -> tuple[frozenset[str], bool]:
            held = is_held(stage.status().state) if at_rest and with_its_state else False
            return stage.active_inputs(), held

        active, held = engine.guarded(poll)
        if stop.trip_input in active:
            return _relay_trip(stop)
        if stop.kind == "board":
            pressed = held or stop.input in active
            if button is not None:
                button.record_input(pressed=pressed)
            if pressed:
                engine.stop()
                raise RunAborted(BY_THE_BUTTON, "stop_button")
        return None

    return check


def _active_now(stage: Stage) -> frozenset[str]:
    """Return the inputs active in the last status, or now that the controller was stopped."""
    active: frozenset[str] = frozenset()
    with suppress(StageError, TransportError):
        active = stage.active_inputs()
        stage.look()
        active |= stage.active_inputs()
    return active


def _relay_trip(stop: StopSettings) -> TripError:
    at = "" if stop.trip_gwt is None else f" at {stop.trip_gwt:g} gwt"
    return TripError(
        f"the hardware trip{at} has stopped the stage (stop.trip_input = {stop.trip_input!r})", "hardware_trip"
    )
