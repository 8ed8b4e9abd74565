"""The states of docs/safety_promises.md: every edge walked, every verb tried in every state."""

from collections.abc import Callable, Mapping
from typing import Any

import pytest

from rig.devices.base import StageError
from rig.engine import EngineError, NotReadyError, Target, TripError, indent, verbs
from rig.engine.engine import State
from tests.error_codes import has_code, raises

Make = Callable[..., Any]
FORCE = Target("force_gwt", 2.33)


def _stop(bench: Any) -> None:
    bench.engine.stop()


def _alarm(bench: Any) -> None:
    bench.stage_line.device_write(b"ALARM:1\r\n")
    bench.clock.wait_s(0.1)
    with pytest.raises(StageError):
        bench.engine.go_to_height(bench.engine.height_mm + 0.01, 1.0)


def _trip(bench: Any) -> None:
    with raises(TripError, "for_the_test"):
        bench.engine.trip(TripError("for the test", "for_the_test"))


def _indent(bench: Any) -> None:
    indent(bench.engine, FORCE, hold_s=0.1)


def _lower(bench: Any) -> None:
    bench.engine.go_to_height(bench.engine.settings.habits.clearance_mm - 0.05, 0.5)


VERBS: dict[str, Callable[[Any], object]] = {
    "mount": lambda bench: verbs.mount(bench.engine, "step:1"),
    "home": lambda bench: verbs.home(bench.engine),
    "zero": lambda bench: verbs.zero(bench.engine),
    "move_to": lambda bench: verbs.move_to(bench.engine, 0.5),
    "indent": _indent,
    "retract": lambda bench: verbs.retract(bench.engine),
    "note": lambda bench: verbs.note(bench.engine, "a word"),
    "rest": lambda bench: verbs.rest(bench.engine, 0.1),
    "checkpoint": lambda bench: verbs.checkpoint(bench.engine, "here"),
    "stop": _stop,
    "trip": _trip,
}
# What each verb leads to; None where it is refused and nothing is sent to the stage.
MACHINE: dict[State, dict[str, State | None]] = {
    State.UNHOMED: {
        "mount": State.UNHOMED, "home": State.READY, "zero": None, "move_to": None, "indent": None, "retract": None,
        "note": State.UNHOMED, "checkpoint": State.UNHOMED, "rest": None,
        "stop": State.UNHOMED, "trip": State.TRIPPED,
    },
    State.READY: {
        "mount": State.READY, "home": State.READY, "zero": State.READY, "move_to": State.READY, "indent": State.READY,
        "retract": State.READY, "note": State.READY, "checkpoint": State.READY, "rest": State.READY,
        "stop": State.UNHOMED, "trip": State.TRIPPED,
    },
    State.IN_CONTACT: {
        "mount": None, "home": State.READY, "zero": None, "move_to": None, "indent": None, "retract": State.READY,
        "note": State.IN_CONTACT, "checkpoint": State.IN_CONTACT, "rest": None,
        "stop": State.UNHOMED, "trip": State.TRIPPED,
    },
    State.TRIPPED: {
        "mount": None, "home": None, "zero": None, "move_to": None, "indent": None, "retract": None,
        "note": State.TRIPPED, "checkpoint": State.TRIPPED, "rest": None,
        "stop": State.TRIPPED, "trip": State.TRIPPED,
    },
}  # fmt: skip


def _in(state: State, spring: Make) -> Any:
    bench = spring()
    if state is State.UNHOMED:
        verbs.mount(bench.engine, "bar:3.0")
        return bench
    bench.ready()
    if state is State.IN_CONTACT:
        _lower(bench)
    elif state is State.TRIPPED:
        _trip(bench)
    assert bench.engine.state is state
    return bench


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("state", State, ids=lambda state: state.value)
def test_every_verb_is_allowed_or_refused_as_the_state_table_says(spring: Make, state: State, verb: str) -> None:
    bench = _in(state, spring)
    leads_to, sent = MACHINE[state][verb], len(bench.sent("stage"))
    if leads_to is None:
        with pytest.raises(NotReadyError) as refused:
            VERBS[verb](bench)
        if verb == "mount":
            has_code(refused.value, "may_touch", state=state.value)
        elif verb == "home":
            has_code(refused.value, "tripped")
        else:
            has_code(refused.value, "not_allowed", verb=verb, state=state.value)
        assert len(bench.sent("stage")) == sent
        leads_to = state
    else:
        VERBS[verb](bench)
    assert bench.engine.state is leads_to


def test_an_indentation_is_in_contact_from_its_first_move_below_clearance_to_its_lift(spring: Make) -> None:
    """An indentation is in contact from its first move below clearance to its lift."""
    bench = spring()
    engine, seen = bench.ready(), []

    def look(stream: str, data: Mapping[str, Any]) -> None:
        seen.append(engine.state)

    bench.on_event = look
    _indent(bench)
    assert list(dict.fromkeys(seen)) == [State.READY, State.IN_CONTACT]
    assert engine.state is State.READY


def test_no_indentor_is_changed_after_a_stop_in_contact(spring: Make) -> None:
    bench = _in(State.IN_CONTACT, spring)
    bench.engine.stop()
    with raises(NotReadyError, "may_touch", state="unhomed"):
        verbs.mount(bench.engine, "step:1")


@pytest.mark.parametrize("state", [State.READY, State.IN_CONTACT], ids=lambda state: state.value)
def test_a_stage_that_fails_is_unhomed(spring: Make, state: State) -> None:
    bench = _in(state, spring)
    _alarm(bench)
    assert bench.engine.state is State.UNHOMED
    with raises(NotReadyError, "not_allowed", verb="move_to", state="unhomed"):
        verbs.move_to(bench.engine, 0.0)


def test_no_verb_leaves_the_tripped_state(spring: Make) -> None:
    """Whatever is tried, in whatever order, twice over."""
    bench = _in(State.TRIPPED, spring)
    for verb in [*VERBS, *reversed(VERBS)]:
        try:
            VERBS[verb](bench)
        except EngineError:
            continue
    assert bench.engine.state is State.TRIPPED
