"""Errors keep their code and fields on their way through processes, and plain text stays as it is."""

import pickle
from tomllib import TOMLDecodeError

import pytest

from rig.errors import RigError, code_of, fields_of
from rig.protocol.handlers import SilentScriptError
from sim.errors import SimError


@pytest.mark.parametrize("kind", [RigError, SimError])
def test_sentence_code_and_fields_survive_a_pickle(kind: type[RigError] | type[SimError]) -> None:
    error = kind("{port}: no reply within {timeout_s:g} s", code="no_reply", port="/dev/a{b}", timeout_s=0.5)
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is kind
    assert str(again) == "/dev/a{b}: no reply within 0.5 s"
    assert (again.code, again.fields) == ("no_reply", {"port": "/dev/a{b}", "timeout_s": 0.5})


def test_a_silent_script_is_one_after_a_pickle_too() -> None:
    again = pickle.loads(pickle.dumps(SilentScriptError(12.0)))
    assert (type(again), again.fields, str(again)) == (
        SilentScriptError,
        {"longest_s": 12.0},
        str(SilentScriptError(12.0)),
    )


@pytest.mark.parametrize("kind", [RigError, SimError])
def test_plain_text_is_no_format(kind: type[RigError] | type[SimError]) -> None:
    """A driver that somebody else wrote raises what it likes."""
    error = kind("odd { text } {0}")
    assert (str(error), error.code, error.fields) == ("odd { text } {0}", "error", {})


@pytest.mark.parametrize(
    ("error", "code", "fields"),
    [
        (RigError("{a}", code="mine", a=1), "mine", {"a": 1}),
        (SimError("plain"), "error", {}),
        (FileNotFoundError(2, "none"), "file_not_found", {}),
        (OSError("full"), "os_error", {}),
        (TOMLDecodeError("no table"), "toml_decode", {}),
        (ZeroDivisionError(), "zero_division", {}),
        (Exception(), "exception", {}),
        (SystemExit("words"), "system_exit", {}),
    ],
    ids=lambda value: str(value)[:20],
)
def test_whatever_fails_has_a_code(error: BaseException, code: str, fields: dict[str, int]) -> None:
    """One of another library by its class."""
    assert (code_of(error), fields_of(error)) == (code, fields)
