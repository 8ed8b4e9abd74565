"""What a page asks for: who is asked for it, what is answered, and what is not understood."""

import threading
from collections.abc import Callable
from typing import Any

import pytest

import rig.panel.requests as posts
from rig.control.client import ControlError, RefusedError
from rig.control.stop import SentStop
from rig.panel.owners import GONE_S, STOP_S, NotTakenError
from rig.panel.requests import MOST_BYTES, RequestError, StepButton
from tests.error_codes import raises
from tests.rig.panel.asgi_client import asked
from tests.rig.panel.stub_panel import OWN, StubOwner, StubPanel
from tests.waiting import DEADLINE_S, until

Make = Callable[..., StubPanel]

STEP = {"axis": "x", "sign": 1, "by_mm": 0.5}
CLICK = {**STEP, "unix_s": 1000.0}
OF_THE_RUN, OF_THE_BENCH = ["pause", "go_on"], ["home", "zero", "park", "leave", "step"]
BODIES: dict[str, Any] = {"step": CLICK}
ALL = ["by_hand", "stop", "take", *OF_THE_RUN, *OF_THE_BENCH]


def by_hand(**more: Any) -> StubOwner:
    return StubOwner(kind="by hand", **more)


# --- what is understood ---


NO_OBJECTS = {
    **dict.fromkeys((b"", b"{", b"[]", b'"a"', b"null", b"\xff", b"[" * 4000), (400, "no_json_object")),
    **dict.fromkeys((b'{"speed_mm_s": NaN}', b'{"speed_mm_s": Infinity}'), (400, "no_json_object")),
    b" " * (MOST_BYTES + 1): (413, "body_too_large"),
}


@pytest.mark.parametrize("path", ALL)
def test_what_is_no_object_is_refused_and_does_nothing(path: str, make: Make) -> None:
    panel = make(StubOwner(), by_hand())
    for body, found in NO_OBJECTS.items():
        assert panel.refused(f"/{path}", body) == found, body[:24]
        assert [one.asked for one in panel.owners] == [[], []], body[:24]
        assert (panel.bench.taken, panel.watcher.tabs.holder) == (0, None), body[:24]


@pytest.mark.parametrize("path", ALL)
def test_what_a_form_could_send_is_refused(path: str, panel: StubPanel) -> None:
    for kind in (None, "text/plain", "application/x-www-form-urlencoded", "application/jsonx"):
        assert panel.refused(f"/{path}", content_type=kind) == (415, "content_type"), kind


def test_a_body_in_pieces_is_put_together_and_one_without_end_is_not_waited_for(panel: StubPanel) -> None:
    headers = [*OWN.items(), ("x-rig-tab", "a")]
    assert MOST_BYTES == 4096
    assert asked(panel.app, "POST", "/take", headers, [b"{", b" ", b"}"]).status_code == 200
    pieces = [b" " * MOST_BYTES, b" ", b"}"]
    assert asked(panel.app, "POST", "/take", headers, pieces).status_code == 413
    exactly = b"{}" + b" " * (MOST_BYTES - 2)
    assert panel.post("/take", exactly)[0] == 200
    assert panel.post("/take", content_type="application/json; charset=utf-8")[0] == 200


@pytest.mark.parametrize("path", ALL)
def test_a_tab_has_a_name(path: str, panel: StubPanel) -> None:
    for tab in (None, b"", b"a" * 65, b"t\xe4b", b"a\tb"):
        assert panel.refused(f"/{path}", x_rig_tab=tab) == (400, "no_tab"), tab
    assert panel.owners[0].asked == []
    assert panel.post("/take", tab="a" * 64)[0] == 200
    assert panel.watcher.tabs.holder == "a" * 64


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        ({"axis": "w"}, "unknown_choice"),
        ({"axis": None}, "unknown_choice"),
        ({"axis": ["x"]}, "unknown_choice"),
        ({"sign": 0}, "unknown_choice"),
        ({"sign": 2}, "unknown_choice"),
        ({"sign": True}, "unknown_choice"),
        ({"sign": 1.0}, "unknown_choice"),
        ({"by_mm": 0}, "unknown_choice"),
        ({"by_mm": -1}, "unknown_choice"),
        ({"by_mm": 5.5}, "unknown_choice"),
        ({"by_mm": "1"}, "not_a_number"),
        ({"by_mm": True}, "not_a_number"),
        ({"by_mm": None}, "not_a_number"),
        ({"unix_s": "now"}, "not_a_number"),
        ({"unix_s": -1e13}, "not_a_number"),
    ],
    ids=str,
)
def test_a_button_that_is_not_understood_moves_nothing(wrong: dict[str, Any], code: str, make: Make) -> None:
    panel = make(by_hand())
    assert panel.refused("/step", {**CLICK, **wrong}) == (400, code)
    assert panel.owners[0].asked == []
    with raises(RequestError, code, key=next(iter(wrong))):
        StepButton.of({**CLICK, **wrong})


def test_numbers_beyond_all_numbers_are_refused(make: Make) -> None:
    panel = make(by_hand())
    for speed in (b"1e999", b"1000000000001", b"-1e999", b"9" * 400):
        body = b'{"axis": "x", "sign": 1, "unix_s": 1000, "by_mm": ' + speed + b"}"
        assert panel.refused("/step", body) == (400, "not_a_number"), speed
    assert panel.refused("/zero", {"anyway": 1}) == (400, "not_a_flag")
    assert panel.owners[0].asked == []


# --- who is asked ---


@pytest.mark.parametrize("path", OF_THE_RUN)
def test_a_run_is_asked_for_what_is_its_own(path: str, panel: StubPanel) -> None:
    assert panel.post(f"/{path}") == (200, {"ok": True, "problem": None})
    assert panel.owners[0].asked == [(path, {})]


@pytest.mark.parametrize(
    ("path", "body", "more"),
    [
        ("home", {}, {}),
        ("leave", {}, {}),
        ("zero", {}, {"anyway": False}),
        ("zero", {"anyway": True}, {"anyway": True}),
        ("park", {}, {}),
        ("step", CLICK, {"tab": "a", **STEP}),
        ("step", CLICK | {"axis": "z", "sign": -1}, {"tab": "a", **STEP, "axis": "z", "sign": -1}),
    ],
    ids=str,
)
def test_the_bench_is_asked_for_what_is_its_own(path: str, body: Any, more: Any, make: Make) -> None:
    panel = make(by_hand())
    assert panel.post(f"/{path}", body) == (200, {"ok": True, "problem": None})
    assert panel.owners[0].asked == [(path, more)]


@pytest.mark.parametrize("path", [*OF_THE_RUN, *OF_THE_BENCH])
def test_nobody_is_asked_for_what_is_another_s(path: str, make: Make) -> None:
    other = by_hand() if path in OF_THE_RUN else StubOwner()
    code = "no_run" if path in OF_THE_RUN else "bench_not_taken"
    for owners in ([other], []):
        assert make(*owners).refused(f"/{path}", BODIES.get(path, {})) == (409, code)
    assert other.asked == []


@pytest.mark.parametrize("path", [*OF_THE_RUN, *OF_THE_BENCH])
def test_what_an_owner_says_is_passed_on(path: str, make: Make) -> None:
    owner = StubOwner() if path in OF_THE_RUN else by_hand()
    for error, status in (
        (RefusedError("not now", "later"), 409),
        (ControlError("process 1 has ended", "ended"), 503),
    ):
        owner.answers[path] = error
        told = {"ok": False, "problem": str(error), "code": error.code}
        assert make(owner).post(f"/{path}", BODIES.get(path, {})) == (status, told)
    panel = make(owner)
    owner.answers[path] = {"ok": True, "words": "well"}
    assert panel.post(f"/{path}", BODIES.get(path, {}) | {"press": 8})[1]["words"] == "well"


# --- which tab ---


@pytest.mark.parametrize("path", ["by_hand", *OF_THE_RUN, *OF_THE_BENCH])
def test_only_the_tab_with_the_controls_asks_for_what_moves(path: str, make: Make) -> None:
    owner = StubOwner() if path in OF_THE_RUN else by_hand()
    panel, body = make(owner), BODIES.get(path, {})
    assert panel.post("/take", tab="first")[0] == 200
    refused = (409, "another_tab")
    assert panel.refused(f"/{path}", body, tab="second") == refused
    assert (owner.asked, panel.bench.taken) == ([], 0)
    assert panel.post("/take", tab="second")[0] == 200
    assert panel.refused(f"/{path}", body, tab="first") == refused
    assert panel.post(f"/{path}", body, tab="second")[0] == 200


def test_the_first_that_asks_has_the_controls_until_it_leaves(panel: StubPanel) -> None:
    assert panel.post("/pause", tab="first")[0] == 200
    assert panel.watcher.tabs.holder == "first"
    assert panel.post("/pause", tab="second")[0] == 409
    panel.clock.wait_s(GONE_S)
    panel.watcher.tabs.look(panel.clock.monotonic_s())
    assert panel.post("/pause", tab="second")[0] == 409
    panel.clock.wait_s(0.01)
    panel.watcher.tabs.look(panel.clock.monotonic_s())
    assert panel.watcher.tabs.holder is None
    assert panel.post("/pause", tab="second")[0] == 200


def test_anybody_stops(panel: StubPanel) -> None:
    panel.post("/take", tab="first")
    assert panel.post("/stop", tab="second")[0] == 200
    assert panel.owners[0].asked == [("stop", {})]
    assert panel.watcher.tabs.holder == "first"


# --- stop ---


def test_a_stop_goes_to_everything_that_is_real_and_to_what_is_shown(make: Make) -> None:
    real, other = StubOwner(pid=1, began_unix_s=1.0), by_hand(pid=2, began_unix_s=2.0)
    rehearsal = StubOwner(pid=3, virtual=True, began_unix_s=3.0)
    answer = make(real, other, rehearsal).post("/stop")
    assert answer == (
        200, {"ok": True, "problem": None, "stopped": [1, 2], "words": "process 1, 2 has stopped the stage"},
    )  # fmt: skip
    assert [one.asked for one in (real, other, rehearsal)] == [[("stop", {})], [("stop", {})], []]
    assert make(rehearsal).post("/stop")[1]["stopped"] == [3]


def test_a_stop_asks_who_is_there_now(make: Make) -> None:
    panel, new = make(), StubOwner()
    panel.watcher.owners = ()
    panel.watcher.find = lambda: [new]
    assert panel.post("/stop")[0] == 200
    assert new.asked == [("stop", {})]

    def gone() -> list[StubOwner]:
        raise PermissionError(1, "not yours", "/run")

    panel.watcher.find, panel.watcher.owners = gone, [new]
    assert panel.post("/stop")[0] == 200
    assert len(new.asked) == 2


def test_a_stop_is_said_by_the_thread_that_read_it(make: Make) -> None:
    """Another one may have to wait for a processor first."""
    real, other, rehearsal = StubOwner(), StubOwner(pid=2), StubOwner(pid=3, virtual=True)
    assert make(real, other, rehearsal).post("/stop")[0] == 200
    here = threading.current_thread().name
    assert (real.said, other.said, rehearsal.said) == ([here], [here], [])
    assert (real.listened, other.listened) == (1, 1), "and nobody is asked besides"


def test_whoever_cannot_be_told_so_is_asked(make: Make) -> None:
    full, well = StubOwner(says=ControlError("process 1 does not answer within 0 s")), StubOwner(pid=2)
    assert make(full, well).post("/stop")[1]["stopped"] == [1, 2]
    assert (full.asked, full.within_s, len(well.said)) == ([("stop", {})], [STOP_S], 1)


def test_a_stop_that_did_not_arrive_is_told(make: Make) -> None:
    assert make(configured=False).refused("/stop") == (409, "nothing_to_stop")
    ended, well = StubOwner(answers={"stop": ControlError("process 1 has ended", "ended")}), StubOwner(pid=2)
    assert make(ended, well, configured=False).refused("/stop") == (503, "ended")
    assert well.asked == [("stop", {})]
    refusing = [StubOwner(pid, answers={"stop": RefusedError(words)}) for pid, words in ((3, "over"), (4, "done"))]
    assert make(*refusing).post("/stop") == (409, {"ok": False, "problem": "over; done", "code": "all_refuse"})
    assert make(*refusing, well).post("/stop")[1]["stopped"] == [2]


def test_a_stop_that_a_stage_has_not_confirmed_is_told_as_one(make: Make) -> None:
    """Its owner did all it could; whoever stands there must not take it for well."""
    unconfirmed = {"ok": True, "stopped": True, "unconfirmed": "x axis still runs"}
    owner, well = StubOwner(pid=7, answers={"stop": lambda: unconfirmed}), StubOwner(pid=8)
    status, answer = make(owner, well, configured=False).post("/stop")
    assert (status, answer["code"]) == (503, "stop_not_confirmed")
    assert "7" in answer["problem"]
    assert answer["problem"].endswith(unconfirmed["unconfirmed"])
    assert well.asked == [("stop", {})]


@pytest.mark.parametrize(
    ("owners", "before"),
    [([], ""), ([StubOwner(answers={"stop": ControlError("process 1 has ended")})], "process 1 has ended. ")],
    ids=["nobody", "gone"],
)
def test_where_no_owner_takes_it_the_panel_sends_the_stop_itself(
    make: Make, sent: list[Any], monkeypatch: pytest.MonkeyPatch, owners: list[StubOwner], before: str
) -> None:
    status, answer = make(*owners).post("/stop")
    words = SentStop(("/dev/ttyUSB0",), problems=["there is no such port"]).words
    assert (status, answer["code"], answer["problem"]) == (503, "not_sent", f"{before}{words}")
    assert len(sent) == 1
    unheard = SentStop(("a",), sent=True, notified=(3,))
    monkeypatch.setattr(posts, "send_stop", lambda settings: unheard)
    assert make(*owners).refused("/stop") == (503, "not_confirmed")
    stopped = SentStop(("a",), sent=True, state="Alarm", notified=(3,))
    monkeypatch.setattr(posts, "send_stop", lambda settings: stopped)
    code, answer = make(*owners).post("/stop")
    assert (code, answer["stopped"], answer["words"]) == (200, [3], "Stop sent to a: the stage reports Alarm.")


def test_an_owner_that_takes_it_or_refuses_is_left_alone(make: Make, sent: list[Any]) -> None:
    assert make(StubOwner()).post("/stop")[0] == 200
    assert make(StubOwner(answers={"stop": RefusedError("it has just ended")})).post("/stop")[0] == 409
    assert sent == []


@pytest.mark.parametrize("lives", [False, True], ids=["hangs", "takes its time"])
def test_the_bytes_go_out_at_once_beside_an_owner_that_hangs(
    make: Make, sent: list[Any], monkeypatch: pytest.MonkeyPatch, lives: bool
) -> None:
    monkeypatch.setattr(posts, "BESIDE_S", 0.01)
    monkeypatch.setattr(posts, "_STOP_S", 0.01)
    free = threading.Event()

    def hangs() -> dict[str, Any]:
        assert free.wait(DEADLINE_S)
        return {"ok": True}

    status = {"ok": True} if lives else ControlError("process 1 does not answer within 0.01 s")
    owner = StubOwner(ports=("/dev/ttyUSB0",), answers={"stop": hangs, "status": status})
    panel = make(owner)
    try:
        panel.post("/stop")
        until(lambda: ("status", {}) in owner.asked)
        until(lambda: lives or sent)
        assert len(sent) == (not lives)
    finally:
        free.set()


def test_a_stop_is_not_behind_anything(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever is asked for something else hangs, and the stop's own answer does not come either."""
    monkeypatch.setattr(posts, "_STOP_S", 0.01)
    free = threading.Event()

    def hangs() -> dict[str, Any]:
        assert free.wait(DEADLINE_S)
        return {"ok": True}

    panel = make(StubOwner(answers={"pause": hangs, "stop": hangs}))
    hung = [threading.Thread(target=panel.post, args=["/pause"]) for _ in range(12)]
    for one in hung:
        one.start()
    for _ in range(10):
        assert panel.refused("/stop") == (503, "not_answered_yet")
    until(lambda: panel.owners[0].asked.count(("stop", {})) == 10)
    free.set()
    for one in hung:
        one.join(DEADLINE_S)
    assert panel.post("/stop")[0] in (200, 503)


def test_no_stop_waits_behind_others_that_are_not_answered(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would go out when everybody has forgotten it; those before it are on their way."""
    assert posts._MOST_STOPS == 16
    monkeypatch.setattr(posts, "_STOP_S", 0.01)
    monkeypatch.setattr(posts, "_MOST_STOPS", 2)
    free = threading.Event()

    def hangs() -> dict[str, Any]:
        assert free.wait(DEADLINE_S)
        return {"ok": True}

    panel = make(StubOwner(answers={"stop": hangs}))
    for _ in range(5):
        assert panel.refused("/stop") == (503, "not_answered_yet")
    assert len(panel.owners[0].said) == 2
    until(lambda: len(panel.owners[0].asked) == 2)
    free.set()
    until(lambda: panel.post("/stop")[0] == 200)


def test_what_is_asked_for_waits_behind_nothing(make: Make) -> None:
    """Four at once; a fifth is refused, and done by nobody later."""
    free = threading.Event()

    def hangs() -> dict[str, Any]:
        assert free.wait(DEADLINE_S)
        return {"ok": True}

    panel = make(StubOwner(answers={"pause": hangs}))
    codes: list[int] = []
    asking = [threading.Thread(target=lambda: codes.append(panel.post("/pause")[0])) for _ in range(4)]
    for one in asking:
        one.start()
    until(lambda: len(panel.owners[0].asked) == 4)
    assert panel.refused("/go_on") == (503, "busy")
    free.set()
    for one in asking:
        one.join(DEADLINE_S)
    assert codes == [200] * 4
    assert ("go_on", {}) not in panel.owners[0].asked


# --- steps ---


@pytest.mark.parametrize(("late_s", "code"), [(0.0, 200), (0.5, 200), (0.51, 409), (-0.5, 200), (-0.51, 409)])
def test_a_click_that_waited_somewhere_moves_nothing(late_s: float, code: int, make: Make) -> None:
    panel = make(by_hand())
    status, answer = panel.post("/step", CLICK | {"unix_s": 1000.0 - late_s})
    assert (status, answer.get("code")) == (code, None if code == 200 else "too_old")
    assert bool(panel.owners[0].asked) is (code == 200)


def test_a_step_that_the_bench_refuses_is_told_in_its_words(make: Make) -> None:
    panel = make(by_hand(answers={"step": RefusedError("busy: step", "busy")}))
    assert panel.post("/step", CLICK)[1]["problem"] == "busy: step"
    assert panel.refused("/step", CLICK) == (409, "busy")


def test_another_tab_moves_nothing(make: Make) -> None:
    panel = make(by_hand())
    panel.post("/take", tab="a")
    assert panel.post("/step", CLICK, tab="b")[0] == 409
    assert panel.owners[0].asked == []


# --- the bench ---


def test_a_leave_is_answered_when_the_bench_is_free_again(make: Make) -> None:
    panel = make(by_hand())
    assert panel.post("/leave")[0] == 200
    assert (panel.owners[0].asked, panel.bench.left) == ([("leave", {})], 1)
    panel.owners[0].answers["leave"] = RefusedError("busy: home", "homing")
    assert panel.refused("/leave") == (409, "homing")
    assert panel.bench.left == 1


def test_the_bench_is_taken_where_there_is_one_and_it_is_free(make: Make) -> None:
    panel = make()
    assert panel.post("/by_hand") == (200, {"ok": True, "problem": None})
    assert panel.bench.taken == 1
    panel.bench.problem = NotTakenError("/dev/ttyUSB0: no such file")
    assert panel.refused("/by_hand") == (503, "not_taken")
    assert panel.post("/by_hand")[1]["problem"] == "/dev/ttyUSB0: no such file"


def test_the_bench_is_not_taken_from_a_run(make: Make) -> None:
    ports = make().watcher.bench.ports
    assert len(ports) == 2
    for port in ports:
        panel = make(StubOwner(pid=5, ports=(port, "other")))
        assert panel.refused("/by_hand") == (409, "ports_taken")
        assert "5" in panel.post("/by_hand")[1]["problem"]
        assert panel.bench.taken == 0
    for owner in (StubOwner(ports=("others",)), StubOwner(ports=(), virtual=True), by_hand(ports=ports)):
        assert make(owner).post("/by_hand")[0] == 200


def test_without_a_configuration_there_is_no_bench(make: Make) -> None:
    panel = make(configured=False)
    assert panel.refused("/by_hand") == (409, "no_bench")
    assert panel.watcher.bench.ports == ()


def test_a_stop_that_fails_where_it_is_said_keeps_no_other_from_being_said(make: Make) -> None:
    panel = make(StubOwner())
    post_stop, panel.owners[0].post_stop = panel.owners[0].post_stop, _fails  # type: ignore[method-assign]
    for _ in range(posts._MOST_STOPS):
        with pytest.raises(ZeroDivisionError):
            panel.post("/stop")
    panel.owners[0].post_stop = post_stop  # type: ignore[method-assign]
    assert panel.post("/stop")[0] == 200


def _fails(**_: object) -> Any:
    raise ZeroDivisionError
