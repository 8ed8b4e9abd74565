"""A script that goes round without end is ended at the stated cap: planned, rehearsed, live or resumed.

A script is run several times; this one goes round at its last.
"""

import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import rig.protocol.handlers as patience
from rig.engine import ScriptError
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.finger_model import FingerModel
from rig.plan.plan import make_plan
from rig.protocol.script import Script, load_script
from rig.session.rehearse import rehearsed
from rig.session.resume import read_stopped
from rig.session.session import FinishedRun, NewRun, NoAttendant, Session, dry_run
from sim.models.fingertip import Fingertip
from tests.error_codes import has_code, raises
from tests.waiting import until

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="needs alarms (POSIX)")

SILENT: tuple[str, dict[str, object]] = ("silent", {"longest_s": 0.2})
MANY: tuple[str, dict[str, object]] = ("too_many_steps", {"verb": "note", "high": 50})
ROUNDS = {
    "silent": ("while True: pass", SILENT),
    "silent, and swallows": ("while True:\n            try: rig.note(3)\n            except Exception: pass", SILENT),
    "many steps": ("while True: rig.note('again')", MANY),
    "many steps, and swallows": (
        "while True:\n            try: rig.note('again')\n            except Exception: pass", SILENT),
}  # fmt: skip
SCRIPT = """\
runs = vars(__import__('sys')).setdefault(__file__, [])
def run(rig):
    runs.append(1)
    rig.mount('bar:3.0'); rig.home(); rig.zero(); rig.move_to(x_mm=0.0)
    rig.indent(doi_mm=0.2)
    if len(runs) == {at}:
        {round}
    rig.indent(doi_mm=0.2)
"""


@pytest.fixture
def going_round(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, int], Script]:
    monkeypatch.setattr(patience, "MOST_STEPS", 50)
    monkeypatch.setattr(patience, "LONGEST_SILENCE_S", 0.2)

    def make(what: str, at: int) -> Script:
        path = tmp_path / "round.py"
        vars(sys).pop(str(path), None)
        path.write_text(SCRIPT.format(at=at, round=what), encoding="utf-8")
        return load_script(str(path))

    return make


def _lifted(done: FinishedRun, code: str, fields: dict[str, object]) -> None:
    assert isinstance(done.problem, ScriptError)
    has_code(done.problem, code, **fields)
    assert re.search(r"\.py, line [78]: ", str(done.problem))
    assert (done.complete, done.indentations, done.at.left) == (False, 1, "lifted")
    assert not 0 < signal.getitimer(signal.ITIMER_REAL)[0] <= 0.2, "nothing is waited for any more"


@pytest.mark.parametrize("round_", ROUNDS)
def test_an_endless_script_is_ended_at_its_cap_with_the_finger_lifted(
    going_round: Callable[[str, int], Script], finger: Fingertip, tmp_path: Path, round_: str
) -> None:
    what, (code, fields) = ROUNDS[round_]
    with raises(BadInputError, code, **fields) as refused:
        make_plan(going_round(what, 1), Config(), finger)
    assert re.search(r"\.py, line [78]: ", str(refused.value))

    if "swallows" in round_:
        return  # handlers end plan, rehearsal and run alike
    script = going_round(what, 2)
    plan = make_plan(script, Config(), finger)
    with raises(ScriptError, code, **fields):
        rehearsed(script, Config(), finger, plan)

    script = going_round(what, 2)
    plan = make_plan(script, Config(), finger)
    done = dry_run(Session(script, Config(), finger, plan, NewRun(tmp_path / "runs")))
    _lifted(done, code, fields)

    stopped = read_stopped(done.folder.path)
    with raises(BadInputError, code, **fields):  # its whole pass is planned before anything moves
        make_plan(stopped.script, stopped.config, finger, stopped.run, stopped.folder.path)


def test_the_silence_limit_is_off_while_a_step_is_carried_out(
    going_round: Callable[[str, int], Script], finger: Fingertip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No alarm is set while a step is carried out. Plan and rehearsal ask the model, the run no more."""
    solved, solve, during = list[float](), FingerModel._solved, list[float]()

    def counted(self: FingerModel, *asked: object) -> object:
        solved.append(asked[2].value)  # type: ignore[attr-defined]
        return solve(self, *asked)  # type: ignore[arg-type]

    monkeypatch.setattr(FingerModel, "_solved", counted)
    script = going_round("rig.rest(5.0)", 3)
    plan = make_plan(script, Config(), finger)
    assert solved == [0.2]
    rehearsed(script, Config(), finger, plan)
    assert solved == [0.2, 0.1]

    class Watching(NoAttendant):
        def watch(self, stream: str, data: object) -> None:
            during.append(signal.getitimer(signal.ITIMER_REAL)[0])

    done = dry_run(Session(script, Config(), finger, plan, NewRun(tmp_path / "runs"), Watching()))
    assert (done.complete, solved) == (True, [0.2, 0.1])
    assert set(during) == {0.0}
    assert len(during) > 50


def test_a_script_with_exactly_the_highest_number_of_steps_is_accepted(
    going_round: Callable[[str, int], Script], finger: Fingertip
) -> None:
    """Six are the script's own."""
    assert make_plan(going_round("[rig.note('again') for _ in range(44)]", 1), Config(), finger)
    with raises(BadInputError, "too_many_steps", verb="indent", high=50):  # the last step is one too many
        make_plan(going_round("[rig.note('again') for _ in range(45)]", 1), Config(), finger)


def test_a_script_that_is_silent_before_its_first_step_is_ended(
    finger: Fingertip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(patience, "LONGEST_SILENCE_S", 0.3)
    path = tmp_path / "mute.py"
    path.write_text("import time\ndef run(rig):\n    time.sleep(3600)\n", encoding="utf-8")
    with raises(BadInputError, "silent", longest_s=0.3):
        make_plan(load_script(str(path)), Config(), finger)


@pytest.fixture
def somebodys() -> Iterator[list[int]]:
    """Somebody else's alarms, as they strike."""
    struck = list[int]()
    before = signal.signal(signal.SIGALRM, lambda number, frame: struck.append(number))
    yield struck
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize(("their_s", "took_s", "left_s"), [(100.0, 40.0, 60.0), (0.0, 40.0, 0.0)])
def test_planning_restores_an_earlier_timer_with_its_remaining_time(
    somebodys: list[int], monkeypatch: pytest.MonkeyPatch, their_s: float, took_s: float, left_s: float
) -> None:
    now_s = iter([1000.0, 1000.0 + took_s])
    signal.setitimer(signal.ITIMER_REAL, their_s)
    theirs = signal.getsignal(signal.SIGALRM)
    with monkeypatch.context() as patch:
        patch.setattr(patience.time, "monotonic", lambda: next(now_s))
        with patience.impatient():
            assert signal.getsignal(signal.SIGALRM) is not theirs
            assert 0 < signal.getitimer(signal.ITIMER_REAL)[0] <= patience.LONGEST_SILENCE_S
    assert signal.getsignal(signal.SIGALRM) is theirs
    assert left_s - 20.0 < signal.getitimer(signal.ITIMER_REAL)[0] <= left_s + 1e-3 * bool(left_s)
    assert not somebodys


def test_an_earlier_timer_that_was_due_during_planning_strikes_after_it(
    somebodys: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = iter([1000.0, 1040.0])
    signal.setitimer(signal.ITIMER_REAL, 30.0)
    with monkeypatch.context() as patch:
        patch.setattr(patience.time, "monotonic", lambda: next(now_s))
        with patience.impatient():
            pass
    until(lambda: somebodys == [signal.SIGALRM])


def test_planning_outside_the_main_thread_sets_no_timer() -> None:
    went = list[str]()

    def impatiently() -> None:
        with patience.impatient():
            went.append("through")

    thread = threading.Thread(target=impatiently)
    thread.start()
    thread.join()
    assert went == ["through"]
