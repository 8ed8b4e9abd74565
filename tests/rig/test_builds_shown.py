"""What is seen of a model that is built: in the spinner, in a line without one, and nothing in a pipe."""

import io
import logging
import re
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager

import pytest
from rich.console import Console

from rig.cli import output

LOGGER = logging.getLogger("sim")
BUILDER = logging.getLogger("sim.models.condensed")


@pytest.fixture(autouse=True)
def as_before() -> Iterator[None]:
    """What this process's log does is left as it was."""
    handlers, level = list(LOGGER.handlers), LOGGER.level
    yield
    LOGGER.handlers[:] = handlers
    LOGGER.setLevel(level)


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> io.StringIO:
    """Where standard error goes: a terminal, unless a test says otherwise."""
    written = io.StringIO()
    terminal = getattr(request, "param", True)
    monkeypatch.setattr(output, "err", Console(file=written, force_terminal=terminal, width=200))
    output.show_builds()
    return written


def seen(screen: io.StringIO) -> str:
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", screen.getvalue())


def test_without_a_spinner_a_long_build_has_a_line_and_its_steps_have_none(screen: io.StringIO) -> None:
    BUILDER.info("some %s", "minutes")
    BUILDER.debug("a step")
    assert seen(screen) == "some minutes\n"


@pytest.mark.parametrize("spinner", [lambda: output.busy("the finger"), output.checking_the_script])
@pytest.mark.parametrize("level", [logging.DEBUG, logging.INFO])
def test_a_spinner_says_it_itself(
    screen: io.StringIO, spinner: Callable[[], AbstractContextManager[object]], level: int
) -> None:
    with spinner():
        BUILDER.log(level, "assembly done")
    BUILDER.debug("afterwards")
    drawn = seen(screen)
    assert "assembly done" in drawn
    assert "afterwards" not in drawn
    assert output._activities.current is None


@pytest.mark.parametrize("screen", [False], indirect=True)
def test_in_a_pipe_nothing_is_said(screen: io.StringIO) -> None:
    BUILDER.info("some minutes")
    assert seen(screen) == ""


def test_a_program_that_runs_twice_says_it_once(screen: io.StringIO) -> None:
    output.show_builds()
    BUILDER.info("some minutes")
    assert seen(screen) == "some minutes\n"


def test_a_spinner_that_ends_badly_is_forgotten(screen: io.StringIO) -> None:
    with pytest.raises(RuntimeError), output.busy("the finger"):
        raise RuntimeError
    with pytest.raises(RuntimeError), output.checking_the_script():
        raise RuntimeError
    assert output._activities.current is None
