"""The notice of a trip, a stop or another early end is the same in every browser and after a restart of the panel."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from rig.engine.bench_memory import BenchMemory
from rig.engine.contact import KnownContact
from rig.engine.contact_words import FREE_THE_FINGER
from rig.engine.sensing import ForceZero
from rig.manual.orders import HOME_FIRST
from rig.panel.watcher import Watcher
from rig.plan.config import Config
from tests.rig.hand_bench import HandBench
from tests.rig.panel.stub_panel import StubOwner, StubPanel
from tests.rig.panel.test_watcher import START, journal, look, sample

Make = Callable[..., StubPanel]
PRESSED = {"left": "held", "x_mm": 0.5, "height_mm": -0.1, "trusted": False, "may_touch": True,
           "contact": "touching", "force_gwt": 1.5}  # fmt: skip
LIFTED = PRESSED | {"left": "lifted", "height_mm": 2.0, "trusted": True, "may_touch": False, "contact": "lifted"}
ENDED_S = 2000.0


@dataclass(frozen=True)
class Case:
    """How a run or manual control ends, and what the notice says then."""

    ends: tuple[dict[str, Any], ...] = ()  # documents of a run
    tail: str = ""  # what a power loss leaves of a line
    status: str = ""
    reason: str = ""
    may_touch: bool = True


RUNS = {
    "trip": Case(
        ({"doc": "stop", "status": "tripped", "reason": "force 21.3 gwt", "indentor": PRESSED},),
        status="tripped", reason="force 21.3 gwt",
    ),
    "trip that lifted": Case(
        ({"doc": "stop", "status": "tripped", "reason": "force 21.3 gwt", "indentor": LIFTED},),
        status="tripped", reason="force 21.3 gwt", may_touch=False,
    ),
    "STOP": Case(
        ({"doc": "stop", "status": "aborted", "reason": "stopped from the panel", "indentor": PRESSED},),
        status="aborted", reason="stopped from the panel",
    ),
    "crash": Case(
        ({"doc": "stop", "status": "failed", "reason": "ValueError: no", "indentor": PRESSED},),
        status="failed", reason="ValueError: no",
    ),
    "kill": Case(status="killed", reason="no end record"),
    "power loss": Case(tail='{"doc": "event", "str', status="killed", reason="no end record"),
}  # fmt: skip


@pytest.fixture
def memory() -> BenchMemory:
    """What the program knows of the bench, as a run leaves it in contact, recorded just after its last entry."""
    found = BenchMemory(Config())
    found.began_unix_s = ENDED_S - 60.0
    found.touched(KnownContact("touching", 1.5, 0.5, -0.1, ENDED_S + 0.502))
    return found


def dated(*documents: dict[str, Any]) -> list[dict[str, Any]]:
    """Documents of the end of a run."""
    return [{"unix_s": ENDED_S + 0.5, **one} for one in documents]


def run_in(out: Path, *documents: dict[str, Any], name: str = "20260101-run", virtual: bool = False) -> Path:
    run = journal(out / name, *dated({**START, "virtual": virtual}, sample(1.5), *documents))
    (run / "config.toml").write_text(Config().as_toml(), encoding="utf-8")
    return at_rest(run)


def at_rest(run: Path, written_s: float = ENDED_S + 0.5) -> Path:
    """A run whose journal was last written to at a time."""
    os.utime(run / "events.jsonl", (written_s, written_s))
    return run


def notice(watcher: Watcher) -> Any:
    look(watcher)
    return watcher.state(0.0)["attention"]


def restarted(make: Make, **more: Any) -> Any:
    """The notice of a panel that has just begun, an hour later."""
    panel = make(**more)
    panel.clock.wait_s(3600.0)
    return notice(panel.watcher)


@pytest.mark.parametrize("configured", [True, False], ids=["with a configuration", "without one"])
@pytest.mark.parametrize("case", RUNS.values(), ids=RUNS)
def test_a_restarted_panel_shows_the_notice_of_a_run(
    case: Case, configured: bool, make: Make, memory: BenchMemory
) -> None:
    panel = make(configured=configured)
    watcher = panel.watcher
    run = run_in(watcher.out)
    panel.owners.append(StubOwner(run=str(run), answers={"status": {"ok": True, "state": "running"}}))
    assert notice(watcher) is None
    journal(run, *dated(*case.ends))
    with (run / "events.jsonl").open("a", encoding="utf-8") as file:
        file.write(case.tail)
    at_rest(run)
    panel.owners.clear()
    panel.clock.wait_s(3600.0)
    shown = notice(watcher)
    assert (shown["status"], shown["may_touch"]) == (case.status, case.may_touch)
    assert case.reason in shown["reason_text"]
    assert (FREE_THE_FINGER in shown["next_text"]) is case.may_touch
    assert all(shown["where_text"].startswith(end["indentor"]["left"]) for end in case.ends if case.may_touch)
    assert restarted(make, configured=configured) == shown


MANUAL = {
    "STOP in contact": (["step down", "stop"], "aborted", True),
    "STOP after a trip": (["trip", "stop"], "aborted", True),
    "trip": (["trip"], "tripped", True),
    "STOP above the finger": (["stop"], "aborted", True),
    "kill in contact": (["step down"], "in contact", True),
}


@pytest.mark.parametrize(("acts", "status", "may_touch"), MANUAL.values(), ids=MANUAL)
def test_a_restarted_panel_shows_the_notice_of_manual_control(
    acts: list[str], status: str, may_touch: bool, make: Make
) -> None:
    hand = HandBench("grbl", zero=ForceZero(0.0, 0.0), lifted=True)
    panel = make()
    live: list[Any] = []

    def person() -> Any:
        for act in acts:
            if act == "step down":
                yield from hand.step("z", -4.0)
            elif act == "trip":
                hand.spring.wall_x_mm = 0.0
                yield from hand.step("x", 5.0)
            else:
                hand("stop")
                yield 0.5
        answers = {"status": hand("status")}
        panel.owners.append(StubOwner(kind="by hand", pid=9, answers=answers))
        live.append(notice(panel.watcher))
        yield 0.1

    hand.run(person())
    panel.owners.clear()
    shown = notice(panel.watcher)
    assert (shown["status"], shown["may_touch"]) == (status, may_touch)
    assert shown == restarted(make)
    if status != "in contact":
        assert {key: live[0][key] for key in ("status", "reason_text")} == {
            key: shown[key] for key in ("status", "reason_text")
        }
        assert "then home" in shown["next_text"] or shown["next_text"] == HOME_FIRST


MOVED_NOTHING: dict[str, Any] = {
    "doc": "stop", "status": "limited", "reason": "too deep", "indentor": {"left": "not moved"},
}  # fmt: skip


@dataclass(frozen=True)
class Lift:
    """A lift after the last entry of a run, or before it, and whether a notice stands then."""

    after_s: float
    by_another: bool
    stands: bool
    behind_s: float = 0.0  # the clock of the server that dates the files


LIFTS = {
    "the run's own, before its end": Lift(-2.0, by_another=False, stands=True),
    "the run's own, before its end, on a server whose clock lags": Lift(-2.0, False, stands=True, behind_s=60.0),
    "the run's own, a while after its last entry": Lift(3.0, by_another=False, stands=True),
    "of a later command": Lift(60.0, by_another=True, stands=False),
    "of a later command, on a server whose clock is ahead": Lift(60.0, True, stands=False, behind_s=-600.0),
}


@pytest.mark.parametrize("lift", LIFTS.values(), ids=LIFTS)
@pytest.mark.parametrize(
    ("ends", "status"),
    [(RUNS["trip"].ends, "tripped"), ((), "killed"), ((MOVED_NOTHING,), "limited")],
    ids=["trip", "kill", "moved nothing"],
)
@pytest.mark.parametrize("kind", ["lifted", "raised"])
def test_a_notice_ends_once_another_command_has_homed_or_lifted(
    kind: Any, ends: tuple[dict[str, Any], ...], status: str, lift: Lift, make: Make, memory: BenchMemory
) -> None:
    run = run_in(make().watcher.out, *ends)
    assert restarted(make)["status"] == status
    of = BenchMemory(Config()) if lift.by_another else memory
    of.touched(KnownContact(kind, 0.0, 0.5, 3.0, ENDED_S + 0.5 + lift.after_s))
    at_rest(run, ENDED_S + 0.5 - lift.behind_s)
    found = restarted(make)
    assert (found and found["status"]) == (status if lift.stands else None)


def test_a_touch_after_a_later_lift_is_noticed_alone(make: Make, memory: BenchMemory) -> None:
    run_in(make().watcher.out, *RUNS["trip"].ends)
    later = BenchMemory(Config())
    later.touched(KnownContact("lifted", 0.0, 0.5, 3.0, ENDED_S + 60.0))
    later.touched(KnownContact("touching", 1.5, 0.5, -0.1, ENDED_S + 120.0))
    found = restarted(make)
    assert (found["status"], found["may_touch"]) == ("in contact", True), "the trip is over, but not this touch"


def test_a_notice_names_where_a_later_command_has_left_the_indentor(make: Make, memory: BenchMemory) -> None:
    run_in(make().watcher.out, *RUNS["trip"].ends)
    BenchMemory(Config()).touched(KnownContact("touching", 0.7, 1.25, -0.3, ENDED_S + 60.0))
    found = restarted(make)
    assert found["status"] == "tripped"
    assert "x = 1.25 mm" in found["where_text"]


def test_a_run_that_moved_nothing_does_not_hide_that_the_finger_may_be_pressed(
    make: Make, memory: BenchMemory
) -> None:
    run_in(make().watcher.out, MOVED_NOTHING)
    found = restarted(make)
    assert (found["status"], found["reason_text"], found["may_touch"]) == ("limited", "too deep", True)
    assert "x = 0.50 mm" in found["where_text"]
    assert FREE_THE_FINGER in found["next_text"]


@pytest.mark.parametrize("other", ["a dry run", "a run that was done", "a run of another rig"])
def test_only_the_last_run_of_the_rig_gives_a_notice(other: str, make: Make) -> None:
    out = make().watcher.out
    older = run_in(out, *RUNS["trip"].ends)
    assert restarted(make)["status"] == "tripped"
    newer = run_in(out, *RUNS["STOP"].ends, name="20260102-run", virtual=other == "a dry run")
    if other == "a run of another rig":
        text = Config().as_toml().replace("/dev/tty", "/dev/other")
        (newer / "config.toml").write_text(text, encoding="utf-8")
    elif other == "a run that was done":
        (newer / "events.jsonl").unlink()
        done = {"doc": "stop", "status": "done", "indentor": LIFTED}
        journal(newer, *dated({**START, "virtual": False, "planned_indentations": 0}, done))
    at_rest(newer, ENDED_S + 9.0)
    found = restarted(make)
    assert (found and found["status"]) == (None if other == "a run that was done" else "tripped"), older


def test_a_rig_on_which_nothing_happened_asks_for_no_attention(make: Make) -> None:
    assert restarted(make) is None
    memory = BenchMemory(Config())
    memory.touched(KnownContact("raised", None, 0.0, 3.0, ENDED_S))
    assert restarted(make) is None


def test_a_notice_long_after_the_run_never_calls_the_indentor_lifted(make: Make, memory: BenchMemory) -> None:
    memory.touched(KnownContact("lifted", 0.0, 0.5, 2.0, ENDED_S))
    run_in(make().watcher.out, *RUNS["trip that lifted"].ends)
    found = restarted(make)
    assert found["status"] == "tripped"
    assert "lifted" not in found["where_text"]
