"""`--friction` on the command line: what it prints, and what it refuses."""

import pytest

from rig.cli.options import MOST_FRICTION
from rig.compare.stimuli import answers_key
from sim.contact import friction
from sim.models.catalogue import load
from tests.program import Program

pytestmark = pytest.mark.usefixtures("empty_figures")

PRESS = ("indent", "--shape", "cylinder:9", "--doi-mm", "0.3", "--model", "section", "--json")


def test_a_press_with_friction_says_how_well_it_obeys_the_law(program: Program) -> None:
    smooth, none, rubbed = (program(*PRESS, *more).json for more in ((), ("--friction", "0"), ("--friction", "0.3")))
    smooth["solver"]["contact_s"] = none["solver"]["contact_s"] = 0.0
    smooth["solver"]["build_s"] = none["solver"]["build_s"] = 0.0
    assert none == smooth
    assert "friction" not in smooth
    told = rubbed["friction"]
    assert (told["coefficient"], told["increments"]) == (0.3, 6)
    assert max(told["normal_residual"], told["cone_residual"], told["slip_residual"]) < 1e-8
    assert 0 < told["sticking_share"] <= 1
    assert rubbed["force_n_per_mm"] != smooth["force_n_per_mm"]


@pytest.mark.parametrize("value", ["-0.1", "nan", "inf", "10.5"])
@pytest.mark.parametrize("command", [PRESS, ("compare", "no-run", "--json")], ids=["indent", "compare"])
def test_out_of_range(program: Program, command: tuple[str, ...], value: str) -> None:
    ended = program(*command, f"--friction={value}")
    finite = value not in ("nan", "inf")
    assert (ended.code, ended.json["code"]) == (2, "outside_range" if finite else "usage")


@pytest.mark.parametrize(
    "more",
    [
        (*PRESS, "--other-paths"),
        ("indent", "--shape", "cylinder:9", "--doi-mm", "0.3", "--model", "auto", "--json"),
        ("indent", "--shape", "point", "--force-gwt", "1", "--json"),
        ("compare", "no-run", "--json", "--place"),
        ("compare", "no-run", "--json", "--fingers", "ranges.toml"),
    ],
)
def test_not_combined(program: Program, more: tuple[str, ...]) -> None:
    ended = program(*more, "--friction=0.3")
    assert (ended.code, ended.json["code"]) == (2, "friction_with")


def test_responses_are_cached_by_friction() -> None:
    finger = load("section")
    keys = [answers_key(finger.with_friction(mu), "request") for mu in (0.0, 0.3, 0.6)]
    assert len(set(keys)) == 3
    assert keys[0] == answers_key(finger, "request")


def test_both_sides_allow_the_same() -> None:
    assert MOST_FRICTION == friction.MOST_FRICTION
