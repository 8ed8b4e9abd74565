"""The verbs of a script: what each hands on, where it stands, what must come before it, and what the plan answers."""

from collections.abc import Callable

import pytest

from rig.protocol import Rig
from rig.protocol.api import ProtocolParameters
from rig.protocol.handlers import SilentScriptError
from rig.records import PressId
from tests.error_codes import has_code
from tests.rig.script_state import Walked, ready, refused, walked

Script = Callable[[Rig], object]

VERBS: dict[str, Script] = {
    "mount": lambda rig: rig.mount("step"),
    "home": lambda rig: rig.home(),
    "zero": lambda rig: rig.zero(),
    "move_to": lambda rig: rig.move_to(x_mm=1.0),
    "touch": lambda rig: rig.touch(),
    "indent": lambda rig: rig.indent(doi_mm=0.3),
    "ramp": lambda rig: rig.ramp(doi_mm=0.3, speed_mm_s=0.2),
    "precondition": lambda rig: rig.precondition(presses=2, force_gwt=1.0),
    "reference": lambda rig: rig.reference(x_mm=0.5, doi_mm=0.3),
    "retract": lambda rig: rig.retract(),
    "rest": lambda rig: rig.rest(3.0),
    "checkpoint": lambda rig: rig.checkpoint("a"),
    "note": lambda rig: rig.note("a"),
}
"""As briefly as a script may say it."""


def _from_ready(script: Script, parameters: ProtocolParameters | None = None) -> Walked:
    """What a script hands on from where everything is ready."""

    def whole(rig: Rig) -> None:
        ready(rig)
        rig.note("ready")
        script(rig)

    found = walked(whole, parameters=parameters, stage={"kind": "zaber"})  # It has every verb.
    for kept in (found.steps, found.places, found.expected, found.answers):
        del kept[:5]
    return found


def test_every_method_of_a_script_is_a_known_verb() -> None:
    """The rest of what a script sees are `parameters`, `mark`, and `do` for steps of its own."""
    assert {name for name in vars(Rig) if not name.startswith("_")} == {*VERBS, "parameters", "mark", "do"}


# --- where a step stands ---


def test_each_step_of_a_script_has_the_indentor_and_place_of_the_steps_before() -> None:
    def script(rig: Rig) -> None:
        rig.mount("step")
        rig.home()
        rig.zero()
        rig.move_to(x_mm=1.0, along_mm=-2.0)
        rig.retract()
        rig.rest(1.0)
        rig.checkpoint("here")
        rig.note("here")
        rig.touch()
        rig.reference(x_mm=-0.5, doi_mm=0.3)
        rig.indent(doi_mm=0.3)

    places = walked(script).places
    assert [(s.indentor, s.x_mm, s.along_mm) for s in places[3:9]] == 6 * [("step", 1.0, -2.0)]
    assert [(s.indentor, s.x_mm, s.along_mm) for s in places[9:]] == 2 * [("step", -0.5, 0.0)]
    assert [len(s.ids) for s in places] == 8 * [0] + 3 * [1]


def test_presses_are_numbered_by_purpose() -> None:
    def script(rig: Rig) -> None:
        for _ in range(2):
            rig.indent(doi_mm=0.3)
            rig.precondition(presses=3, doi_mm=0.3)
            rig.reference(x_mm=0.0, doi_mm=0.3)
            rig.touch()

    assert [s.ids for s in _from_ready(script).places] == [
        (PressId(0),),
        tuple(PressId(n, "precondition") for n in (0, 1, 2)),
        (PressId(0, "reference"),),
        (PressId(0, "find"),),
        (PressId(1),),
        tuple(PressId(n, "precondition") for n in (3, 4, 5)),
        (PressId(1, "reference"),),
        (PressId(1, "find"),),
    ]


PRESSING = ("indent", "precondition", "reference")


@pytest.mark.parametrize("verb", PRESSING)
def test_a_press_carries_the_marks_of_its_schedule(verb: str) -> None:
    def script(rig: Rig) -> None:
        rig.mark({"block": 2, "condition": "wide"})
        VERBS[verb](rig)

    (place,) = _from_ready(script).places
    assert [press.marks for press in place.ids] == len(place.ids) * [{"block": 2, "condition": "wide"}]


# --- what must come before ---

FREE = ("mount", "home", "note", "checkpoint")
AFTER_HOMING = ("zero", "move_to", "retract", "rest", "reference")


@pytest.mark.parametrize("verb", VERBS)
def test_only_notes_mounting_and_homing_may_come_first_in_a_script(verb: str) -> None:
    script = VERBS[verb]
    if verb in FREE:
        walked(script)
    else:
        first = "home()" if verb in AFTER_HOMING else "mount()"
        said = "move_to" if verb == "reference" else verb  # it goes there first
        has_code(refused(script), "comes_too_early", verb=said, before=first)


def _without(left_out: str) -> Script:
    def script(rig: Rig) -> None:
        for verb in ("mount", "home", "zero", "move_to"):
            if verb != left_out:
                VERBS[verb](rig)

    return script


@pytest.mark.parametrize("verb", ["indent", "precondition", "touch"])
@pytest.mark.parametrize("left_out", ["mount", "zero", "move_to"])
def test_a_press_is_refused_before_mount_zero_and_move(verb: str, left_out: str) -> None:
    def script(rig: Rig) -> None:
        _without(left_out)(rig)
        VERBS[verb](rig)

    has_code(refused(script), "comes_too_early", verb=verb, before=f"{left_out}()")


@pytest.mark.parametrize("verb", ["indent", "precondition", "touch"])
def test_after_homing_a_press_needs_a_new_move(verb: str) -> None:
    def script(rig: Rig) -> None:
        ready(rig).home()
        VERBS[verb](rig)

    has_code(refused(script), "comes_too_early", verb=verb, before="move_to()")


@pytest.mark.parametrize("verb", ["indent", "precondition"])
def test_a_press_outside_the_receptor_plane_is_refused_and_a_touch_is_not(verb: str) -> None:
    def script(rig: Rig) -> None:
        ready(rig).move_to(x_mm=0.0, along_mm=1.5)
        rig.touch()
        VERBS[verb](rig)

    has_code(refused(script), "along_the_finger", verb=verb, along_mm=1.5)


def test_a_checkpoint_name_may_be_used_once() -> None:
    def script(rig: Rig) -> None:
        rig.checkpoint("a")
        rig.checkpoint("b")
        rig.checkpoint("a")

    has_code(refused(script), "passed_already", verb="checkpoint", name="a")


FIRST_ASKED = {"x_mm": 0.5, "doi_mm": 0.3, "increments": 2}
FIRST = {**FIRST_ASKED, "hold_s": 0.5}


@pytest.mark.parametrize("change", [{"x_mm": 0.6}, {"doi_mm": 0.4}, {"increments": 3}, {"hold_s": 0.6}, "step"])
def test_a_reference_press_that_differs_from_the_first_is_refused(change: dict[str, float] | str) -> None:
    def script(rig: Rig) -> None:
        ready(rig).reference(**FIRST)  # type: ignore[arg-type]
        rig.reference(**FIRST)  # type: ignore[arg-type]
        if isinstance(change, str):
            rig.mount(change)
        rig.reference(**{**FIRST, **(change if isinstance(change, dict) else {})})  # type: ignore[arg-type]

    has_code(refused(script), "another_reference", verb="reference", indentor="bar", **FIRST_ASKED)


def test_a_script_that_made_no_step_is_told_for_how_long() -> None:
    assert str(SilentScriptError()) == "the script timed out: no step for 30 s"
