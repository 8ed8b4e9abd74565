"""Bench under manual control: state between commands, homing and zeroing with force readings."""

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime

from rig.clock import Clock
from rig.data.journal import NoJournal
from rig.devices.base import ForceError, Stage
from rig.engine import Engine, LimitError, verbs
from rig.engine.bench import Bench
from rig.engine.bench_memory import BenchMemory, LastKnown
from rig.engine.contact import KnownContact
from rig.engine.sensing import NoReadingError, Sensing, zero_readings_gwt
from rig.errors import BadInputError, around
from rig.manual.guard import Guard
from rig.manual.jog import ByHand, Show
from rig.session.script_run import stopped_at_once
from rig.settings import RigSettings
from rig.transport.wire import TransportError


def no_force_readings(error: Exception) -> BadInputError:
    """Return the error for a motion without a reading from the sensor."""
    sentence = "{problem}; nothing was moved. To move without force readings, use --without-force"
    return around(BadInputError, sentence, error, code="not_felt")


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

    The position is known if the last command left the homed stage there, and is recorded again at a normal end.
    """
    memory = BenchMemory(settings)
    guard = None
    if sensing is not None:
        sensing.zero, guard = known.zero, Guard(settings, sensing)
    placed = stage.homed or known.is_where_left(stage.status())
    memory.moves()
    hand = ByHand(settings, stage, clock, guard, show, placed=placed)
    hand.keep_contact, hand.may_touch = memory.touched, not (placed and known.is_lifted)
    yield hand
    if hand.placed:
        memory.left(stage.status())


def home(settings: RigSettings, bench: Bench, sensing: Sensing) -> KnownContact:
    """Home with force readings, and return the state of contact.

    Raises ENDINGS but ForceError, BadInputError.
    """
    memory = BenchMemory(settings)
    known = memory.read().contact
    engine = Engine(settings, bench, NoJournal())
    engine.sensing, engine.keep_contact = sensing, memory.touched
    engine.may_touch = known is not None and known.may_touch
    try:
        with stopped_at_once(engine):
            verbs.home(engine)
    except ForceError as error:
        raise no_force_readings(error) from None
    return engine.known_contact


def zero(settings: RigSettings, sensing: Sensing, *, anyway: bool) -> str:
    """Zero the sensor, record the zero, and return the sensor's identification.

    Raises LimitError if there are no readings; if `anyway` is false, also if the last recorded zero shows a contact,
    or without one the record of contact; ForceError, TransportError.
    """
    memory = BenchMemory(settings)
    name, last = sensing.connect(), memory.read()
    if last.zero is not None:
        sensing.zero = last.zero
        if not anyway:
            _refuse_touched(sensing, last)
    elif not anyway and last.contact is not None and last.contact.kind not in ("lifted", "raised"):
        raise LimitError(
            "there is no zero on record, and the indentor is {words}, so nothing was zeroed; free the finger and "
            "home, or, if nothing touches the indentor, use --anyway",
            code="maybe_touched",
            words=last.contact.words,
            contact=last.contact.kind,
        )
    sensing.sensor.zero()
    sensing.zero = None  # Readings now have a new zero.
    memory.forget_zero()
    try:
        zero = sensing.take_zero(zero_readings_gwt(sensing.raw))
        memory.zeroed(sensing.lasting_zero or zero)
    except NoReadingError as error:
        raise around(LimitError, "{problem}; zero the sensor again", error, code="no_reading") from error
    return name


def _refuse_touched(sensing: Sensing, last: LastKnown) -> None:
    """Raise LimitError if the force may be a contact, or does not settle."""
    try:
        force_gwt = sensing.at_rest_gwt()
    except NoReadingError as error:
        remedy = "let the sensor settle, or use --anyway if nothing touches the indentor"
        raise around(LimitError, "{problem}; nothing was zeroed; " + remedy, error) from error
    if abs(force_gwt) >= sensing.touch_gwt:
        taken = datetime.fromtimestamp(last.zero_unix_s).isoformat(" ", "minutes")
        raise LimitError(
            "the sensor reads {force_gwt:.2f} gwt from the last recorded zero ({taken}), more than "
            "{high_gwt:.2f} gwt, so nothing was zeroed; if nothing touches the indentor, use --anyway",
            code="maybe_touched",
            force_gwt=force_gwt,
            taken=taken,
            high_gwt=sensing.touch_gwt,
        )
