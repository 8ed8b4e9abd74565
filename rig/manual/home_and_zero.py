"""Bench under manual control: state between commands, homing and zeroing with force readings."""

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime

from rig.clock import Clock
from rig.data.journal import NoJournal
from rig.devices.base import ForceError, Stage, StageError
from rig.engine import Engine, LimitError, verbs
from rig.engine.bench import Bench
from rig.engine.bench_memory import BenchMemory, LastKnown
from rig.engine.contact import ContactRecord, KnownContact
from rig.engine.dead_man import DOWN, UP, Direction
from rig.engine.limits import AT_MM
from rig.engine.sensing import NoReadingError, Sensing, zero_readings_gwt
from rig.errors import BadInputError
from rig.manual.guard import Guard
from rig.manual.jog import ByHand, Show
from rig.session.script_run import stopped_at_once
from rig.settings import ZERO_LIFT_MM, RigSettings
from rig.transport.wire import TransportError


def no_force_readings(error: Exception) -> BadInputError:
    """Return the error for a motion without a reading from the sensor."""
    return BadInputError(
        f"{error}; nothing was moved. To move without force readings, use --without-force", "not_felt"
    )


def feel(sensing: Sensing) -> Sensing:
    """Connect to a sensor and return it. Raises BadInputError if it does not respond."""
    try:
        sensing.connect()
    except (ForceError, TransportError) as error:
        raise no_force_readings(error) from None
    return sensing


@contextmanager
def at_hand(
    settings: RigSettings, stage: Stage, clock: Clock, sensing: Sensing | None, show: Show, known: LastKnown
) -> Iterator[ByHand]:
    """Yield the manual control of a connected stage; without force readings if `sensing` is None.

    The position is known if the last command left the homed stage there, and is recorded again at the end, also after
    a refusal.
    """
    memory = BenchMemory(settings)
    guard = None
    if sensing is not None:
        sensing.zero, guard = known.zero, Guard(settings, sensing)
    placed = stage.homed or known.is_where_left(stage.status())
    memory.moves()
    hand = ByHand(settings, stage, clock, guard, show, placed=placed)
    hand.keep_contact = memory.touched
    try:
        yield hand
    except LimitError:  # Refused, at rest.
        _leave(hand, stage, memory)
        raise
    _leave(hand, stage, memory)


def _leave(hand: ByHand, stage: Stage, memory: BenchMemory) -> None:
    if hand.placed:
        memory.left(stage.status())


def home(settings: RigSettings, bench: Bench, sensing: Sensing) -> KnownContact:
    """Home with force readings, and return the state of contact.

    Raises ENDINGS but ForceError, BadInputError.
    """
    memory = BenchMemory(settings)
    known = memory.read().contact
    engine = Engine(settings, bench, NoJournal(), memory=memory, sensing=sensing)
    engine.contact = ContactRecord(may_touch=known is not None and known.may_touch)
    try:
        with stopped_at_once(engine):
            verbs.home(engine)
    except ForceError as error:
        raise no_force_readings(error) from None
    return engine.known_contact


def zero(settings: RigSettings, sensing: Sensing, hand: ByHand | None) -> str:
    """Zero the sensor, record the zero, and return the sensor's identification.

    With `hand` the stage lifts by `ZERO_LIFT_MM` and stays there; None zeros unchecked. Raises LimitError without
    readings, if they scatter, or if the last recorded zero or the lift shows a contact; StageError if the stage did
    not lift; ForceError, TransportError.
    """
    memory = BenchMemory(settings)
    name, last = sensing.connect(), memory.read()
    if last.zero is not None:
        sensing.zero = last.zero
    if hand is not None:
        _refuse_touched(sensing, last)
        _make_room(settings, hand)
    sensing.sensor.zero()
    sensing.zero = None  # Readings now have a new zero.
    memory.record_zero(None)
    try:
        zero = sensing.take_zero(zero_readings_gwt(sensing.raw))
        if refused := verbs.refused_zero(sensing, zero):
            raise LimitError(str(refused), refused.code)
        if hand is not None:
            _refuse_changed(settings, sensing, hand)
    except NoReadingError as error:
        sensing.zero = None
        raise LimitError(f"{error}; zero the sensor again", "no_reading") from error
    except BaseException:
        sensing.zero = None
        raise
    memory.record_zero(sensing.lasting_zero or zero)
    return name


def not_checked(error: StageError | TransportError) -> StageError:
    """Return the error for a zero without a stage that could check it by a lift."""
    return StageError(
        f"the zero cannot be checked by a lift of {ZERO_LIFT_MM:g} mm: {error}; home first (`rig home`), or, if "
        "nothing touches the indentor, use --anyway",
        error.code,
    )


def _make_room(settings: RigSettings, hand: ByHand) -> None:
    """Move down where the top of the travel leaves no room for the lift. Raises LimitError for a touch."""
    at = hand.look().at
    down_mm = at.z_mm + ZERO_LIFT_MM + AT_MM
    if hand.placed and down_mm > 0:
        _moved_by(settings, hand, DOWN, down_mm)


def _refuse_changed(settings: RigSettings, sensing: Sensing, hand: ByHand) -> None:
    """Lift after a zero. Raises LimitError if the force changes by a touch."""
    _moved_by(settings, hand, UP, ZERO_LIFT_MM)
    change_gwt = hand.measured_contact().force_gwt
    if change_gwt is None:
        raise LimitError("no steady force after the lift; zero the sensor again", "no_reading")
    if abs(change_gwt) >= sensing.touch_gwt:
        changed = verbs.changed_zero(change_gwt)
        raise LimitError(str(changed), changed.code)


def _moved_by(settings: RigSettings, hand: ByHand, direction: Direction, by_mm: float) -> None:
    """Move straight by a distance. Raises LimitError if it was not covered, StageError."""
    from_mm = hand.look().at.z_mm
    try:
        moved = hand.go(lambda: direction, settings.habits.descent_speed_mm_s, by_mm)
    except StageError as error:
        raise not_checked(error) from error
    if moved.problem is not None:
        raise LimitError(f"{moved.problem}; nothing was zeroed; keep the finger away", moved.problem.code)
    if abs(moved.at.z_mm - from_mm) < by_mm - AT_MM:
        raise not_checked(StageError("the stage did not move", "did_not_move"))


def _refuse_touched(sensing: Sensing, last: LastKnown) -> None:
    """Raise LimitError if the force from the last zero, or without one the record of contact, may be a contact."""
    if last.zero is None:
        if last.contact is not None and last.contact.kind not in ("lifted", "raised"):
            raise LimitError(
                f"there is no zero on record, and the indentor is {last.contact.words}, so nothing was zeroed; "
                "free the finger and home, or, if nothing touches the indentor, use --anyway",
                "maybe_touched",
            )
        return
    try:
        force_gwt = sensing.at_rest_gwt()
    except NoReadingError as error:
        remedy = "let the sensor settle, or use --anyway if nothing touches the indentor"
        raise LimitError(f"{error}; nothing was zeroed; {remedy}", error.code) from error
    if abs(force_gwt) >= sensing.touch_gwt:
        taken = datetime.fromtimestamp(last.zero_unix_s).isoformat(" ", "minutes")
        raise LimitError(
            f"the sensor reads {force_gwt:.2f} gwt from the last recorded zero ({taken}), more than "
            f"{sensing.touch_gwt:.2f} gwt, so nothing was zeroed; if nothing touches the indentor, use --anyway",
            "maybe_touched",
        )
