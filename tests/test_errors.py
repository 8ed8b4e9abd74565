"""Errors keep their code on their way through processes, and their sentence is printed as it is."""

import pickle
from tomllib import TOMLDecodeError

import pytest

from rig.engine.motion import InterruptedMotionError
from rig.errors import RigError, TripError
from rig_shared.errors import CodedError, code_of
from sim.errors import SimError
from tests.error_codes import shows


def _failed_lift() -> TripError:
    error = TripError("the soft trip; and the lift failed: no reply", "soft_trip")
    error.lift_code = "no_reply"
    return error


@pytest.mark.parametrize(
    "error",
    [
        RigError("/dev/a{b}: no reply within 0.5 s", "no_reply"),
        SimError("/dev/a{b}: no reply within 0.5 s"),
        InterruptedMotionError("touched", "touched", 1.5),
        _failed_lift(),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_keeps_sentence_code_and_attributes_when_pickled(error: CodedError) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), vars(again)) == (type(error), str(error), vars(error))


@pytest.mark.parametrize("kind", [RigError, SimError])
def test_an_error_prints_its_sentence_with_braces_unchanged(kind: type[CodedError]) -> None:
    """A driver that somebody else wrote raises what it likes."""
    error = kind("odd { text } {0}")
    assert (str(error), error.code) == ("odd { text } {0}", "error")


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (RigError("mine", "mine"), "mine"),
        (SimError("plain"), "error"),
        (FileNotFoundError(2, "none"), "file_not_found"),
        (OSError("full"), "os_error"),
        (TOMLDecodeError("no table"), "toml_decode"),
        (ZeroDivisionError(), "zero_division"),
        (Exception(), "exception"),
        (SystemExit("words"), "system_exit"),
    ],
    ids=lambda value: str(value)[:20],
)
def test_every_exception_has_a_code(error: BaseException, code: str) -> None:
    """One of another library by its class."""
    assert code_of(error) == code


@pytest.mark.parametrize(
    ("sentence", "value", "is_shown"),
    [
        ("force 12.50 gwt", 12.504, True),
        ("force 12.50 gwt", 12.506, False),
        ("at x = -3 mm", -3.0, True),
        ("at x = -3 mm", 3.0, False),
        ("3 of 20 presses", 20, True),
        ("1e-05 mm", 1e-5, True),
        ("down to −2.5 mm", -2.5, True),
        ("one of a, b", ["a", "b"], True),
        ("one of a, b", ["a", "c"], False),
    ],
)
def test_a_number_counts_as_shown_in_a_sentence_to_its_printed_digits(
    sentence: str, value: object, is_shown: bool
) -> None:
    assert shows(sentence, value) is is_shown
