"""What a page asks for: who carries it out, what is refused, and what STOP does with the owners of the ports."""

import asyncio
import threading
from collections.abc import Callable
from typing import Any

import pytest

from rig.control.client import ControlError, RefusedError
from rig.control.stop import SentStop
from rig.panel import stops
from rig.panel.owners import GONE_S, NotTakenError
from rig.panel.requests import MOST_BYTES
from tests.rig.panel.asgi_client import answer_to, asked
from tests.rig.panel.stub_panel import OWN, StubOwner, StubPanel
from tests.waiting import DEADLINE_S, until

Make = Callable[..., StubPanel]

CLICK = {"axis": "x", "sign": 1, "by_mm": 0.5, "unix_s": 1000.0}
OF_THE_RUN, OF_THE_BENCH = ["pause", "go_on"], ["home", "zero", "park", "leave", "step"]
ALL = ["by_hand", "stop", "take", *OF_THE_RUN, *OF_THE_BENCH]
BODIES: dict[str, Any] = {"step": CLICK}


def by_hand(**more: Any) -> StubOwner:
    return StubOwner(kind="by hand", **more)


def owner_for(path: str, **more: Any) -> StubOwner:
    return StubOwner(**more) if path in OF_THE_RUN else by_hand(**more)


# --- what is refused ---

NO_OBJECTS = {
    **dict.fromkeys((b"", b"{", b"[]", b'"a"', b"null", b"\xff", b"[" * 4000), (400, "no_json_object")),
    b'{"press": 1, "press": 2}': (400, "no_json_object"),
    b" " * (MOST_BYTES + 1): (413, "body_too_large"),
}
HEADERS: list[tuple[dict[str, Any], tuple[int, str]]] = [
    *(({"content_type": kind}, (415, "content_type")) for kind in (None, "text/plain", "application/jsonx")),
    *(({"x_rig_tab": tab}, (400, "no_tab")) for tab in (None, b"", b"a" * 65, b"t\xe4b", b"a\tb")),
]
VALUES: dict[str, dict[str, list[Any]]] = {
    "step": {
        "axis": ["w", None, ["x"]],
        "sign": [0, 2, True, 1.0, None],
        "by_mm": [0, -1, 5.5, "1", True, None, 1e300, float("inf")],
        "unix_s": ["now", -1e13, None, float("nan")],
    },
    "zero": {"anyway": [1, "true", None]},
    "stop": {"press": ["1", 1.5, True]},
}
"""For each request the values that its keys may not have."""


@pytest.mark.parametrize("path", ALL)
def test_a_request_that_is_not_understood_does_nothing(path: str, make: Make) -> None:
    panel = make(StubOwner(), by_hand())

    def check(expected: tuple[int, str] | None, body: Any, **headers: Any) -> None:
        status, code = panel.refused(f"/{path}", body, **headers)
        assert (status, code) == expected or (expected is None and status == 400), (body, headers)
        assert [one.asked for one in panel.owners] == [[], []], (body, headers)
        assert (panel.bench.taken, panel.watcher.tabs.holder) == (0, None), (body, headers)

    for body, found in NO_OBJECTS.items():
        check(found, body)
    for headers, found in HEADERS:
        check(found, BODIES.get(path, {}), **headers)
    for key, values in VALUES.get(path, {}).items():
        for value in values:
            check(None, {**BODIES.get(path, {}), key: value})
    for key in BODIES.get(path, {}):
        check(None, {name: value for name, value in BODIES[path].items() if name != key})


def test_a_body_in_pieces_is_put_together_and_one_without_end_is_not_waited_for(panel: StubPanel) -> None:
    headers = [*OWN.items(), ("x-rig-tab", "a")]
    assert asked(panel.app, "POST", "/take", headers, [b"{", b" ", b"}"]).status_code == 200
    assert asked(panel.app, "POST", "/take", headers, [b" " * MOST_BYTES, b" ", b"}"]).status_code == 413
    assert panel.post("/take", b"{}" + b" " * (MOST_BYTES - 2))[0] == 200


@pytest.mark.parametrize(("late_s", "code"), [(0.0, 200), (0.5, 200), (0.51, 409), (-0.5, 200), (-0.51, 409)])
def test_a_click_that_waited_somewhere_moves_nothing(late_s: float, code: int, make: Make) -> None:
    panel = make(by_hand())
    status, answer = panel.post("/step", CLICK | {"unix_s": 1000.0 - late_s})
    assert (status, answer.get("code")) == (code, None if code == 200 else "too_old")
    assert bool(panel.owners[0].asked) is (code == 200)


# --- who carries it out ---


@pytest.mark.parametrize("path", [*OF_THE_RUN, *OF_THE_BENCH])
def test_a_request_goes_to_the_owner_that_can_carry_it_out(path: str, make: Make) -> None:
    owner, body = owner_for(path), BODIES.get(path, {})
    owner.answers[path] = {"ok": True, "words": "well"}
    assert make(owner).post(f"/{path}", body)[1]["words"] == "well"
    more = {"step": {"axis": "x", "sign": 1, "by_mm": 0.5, "tab": "a"}, "zero": {"anyway": False}}.get(path, {})
    assert owner.asked == [(path, more)]
    missing = (409, "no_run" if path in OF_THE_RUN else "bench_not_taken")
    for others in ([], [by_hand() if path in OF_THE_RUN else StubOwner()]):
        assert make(*others).refused(f"/{path}", body) == missing
        assert [one.asked for one in others] == [[]] * len(others)
    for error, status in ((RefusedError("not now", "later"), 409), (ControlError("has ended", "ended"), 503)):
        owner.answers[path] = error
        told = {"ok": False, "problem": str(error), "code": error.code}
        assert make(owner).post(f"/{path}", body) == (status, told)


@pytest.mark.parametrize("path", ["by_hand", *OF_THE_RUN, *OF_THE_BENCH])
def test_only_the_tab_with_control_asks_for_a_motion(path: str, make: Make) -> None:
    owner = owner_for(path)
    panel, body = make(owner), BODIES.get(path, {})
    assert panel.post("/take", tab="first")[0] == 200
    assert panel.refused(f"/{path}", body, tab="second") == (409, "another_tab")
    assert (owner.asked, panel.bench.taken) == ([], 0)
    assert panel.post("/take", tab="second")[0] == 200
    assert panel.refused(f"/{path}", body, tab="first") == (409, "another_tab")
    assert panel.post(f"/{path}", body, tab="second")[0] == 200


def test_the_first_tab_has_control_until_it_has_left_for_five_seconds(panel: StubPanel) -> None:
    tabs, clock = panel.watcher.tabs, panel.clock
    tabs.opened("first")
    assert panel.post("/pause", tab="first")[0] == 200
    clock.wait_s(100.0)
    tabs.look(clock.monotonic_s())
    assert panel.post("/pause", tab="second")[0] == 409, "the first one still watches"
    tabs.closed("first", clock.monotonic_s())
    for wait_s, status in ((GONE_S, 409), (0.01, 200)):
        clock.wait_s(wait_s)
        tabs.look(clock.monotonic_s())
        assert panel.post("/pause", tab="second")[0] == status


def test_a_request_waits_behind_no_other_one(make: Make) -> None:
    """Four at once; a fifth is refused, and done by nobody later."""
    panel, free = make(StubOwner()), threading.Event()
    panel.owners[0].answers["pause"] = hanging(free)
    codes: list[int] = []

    async def five() -> None:
        headers = [*OWN.items(), ("x-rig-tab", "a")]
        asking = [asyncio.create_task(answer_to(panel.app, "POST", "/pause", headers, [b"{}"])) for _ in range(4)]
        while len(panel.owners[0].asked) < 4:
            await asyncio.sleep(0.001)
        fifth = await answer_to(panel.app, "POST", "/go_on", headers, [b"{}"])
        assert (fifth.status_code, fifth.json()["code"]) == (503, "busy")
        free.set()
        codes.extend([(await one).status_code for one in asking])

    asyncio.run(five())
    assert codes == [200] * 4
    assert ("go_on", {}) not in panel.owners[0].asked


def hanging(free: threading.Event) -> Callable[[], dict[str, Any]]:
    def hang() -> dict[str, Any]:
        assert free.wait(DEADLINE_S)
        return {"ok": True}

    return hang


# --- manual control ---


def test_manual_control_starts_only_with_a_configuration_and_free_ports(make: Make) -> None:
    assert make(configured=False).refused("/by_hand") == (409, "no_bench")
    ports = make().watcher.bench.ports
    for port in ports:
        panel = make(StubOwner(pid=5, ports=(port, "other")))
        assert panel.refused("/by_hand") == (409, "ports_taken")
        assert panel.bench.taken == 0
    for owner in (StubOwner(ports=("others",)), StubOwner(ports=(), virtual=True), by_hand(ports=ports)):
        assert make(owner).post("/by_hand")[0] == 200
    panel = make()
    panel.bench.problem = NotTakenError("/dev/ttyUSB0: no such file")
    assert panel.post("/by_hand")[1]["problem"] == "/dev/ttyUSB0: no such file"


def test_the_end_of_manual_control_is_answered_when_the_ports_are_free_again(make: Make) -> None:
    panel = make(by_hand())
    assert panel.post("/leave")[0] == 200
    assert panel.bench.left == 1
    panel.owners[0].answers["leave"] = RefusedError("busy: home", "homing")
    assert panel.refused("/leave") == (409, "homing")
    assert panel.bench.left == 1


# --- STOP (with real processes: tests/rig/test_stop_matrix.py) ---


def test_any_tab_stops(panel: StubPanel) -> None:
    panel.post("/take", tab="first")
    assert panel.post("/stop", tab="second")[0] == 200
    assert panel.owners[0].asked == [("stop", {})]
    assert panel.watcher.tabs.holder == "first"


def test_a_stop_goes_to_every_real_owner_and_to_the_shown_one(make: Make) -> None:
    real, other = StubOwner(pid=1, began_unix_s=1.0), by_hand(pid=2, began_unix_s=2.0)
    rehearsal = StubOwner(pid=3, virtual=True, began_unix_s=3.0)
    words = "process 1, 2 has stopped the stage"
    answer = (200, {"ok": True, "problem": None, "stopped": [1, 2], "words": words})
    assert make(real, other, rehearsal).post("/stop") == answer
    here = threading.current_thread().name
    assert [one.said for one in (real, other, rehearsal)] == [[here], [here], []], "another thread may have to wait"
    assert make(rehearsal).post("/stop")[1]["stopped"] == [3]


def test_a_stop_reaches_an_owner_that_the_panel_finds_only_now_or_cannot_find_again(make: Make) -> None:
    panel, new = make(), StubOwner()
    panel.watcher.owners, panel.watcher.find = (), lambda: [new]
    assert panel.post("/stop")[0] == 200

    def gone() -> list[StubOwner]:
        raise PermissionError(1, "not yours", "/run")

    panel.watcher.find, panel.watcher.owners = gone, [new]
    assert panel.post("/stop")[0] == 200
    assert new.asked == [("stop", {})] * 2
    full = StubOwner(pid=4, says=ControlError("process 4 does not answer within 0 s"))
    assert make(full).post("/stop")[1]["stopped"] == [4], "it is asked again"


ENDED, UNCONFIRMED = ControlError("process 1 has ended", "ended"), {"ok": True, "unconfirmed": "x axis still runs"}
OUTCOMES: dict[str, tuple[list[Any], int, str | None]] = {
    "no owner": ([], 409, "nothing_to_stop"),
    "one has ended": ([ENDED, {"ok": True}], 503, "ended"),
    "one stage is not confirmed": ([UNCONFIRMED, {"ok": True}], 503, "stop_not_confirmed"),
    "all have just ended by themselves": ([RefusedError("over"), RefusedError("done")], 409, "all_refuse"),
    "one has just ended by itself": ([RefusedError("over"), {"ok": True}], 200, None),
}


@pytest.mark.parametrize(("answers", "status", "code"), OUTCOMES.values(), ids=OUTCOMES)
def test_a_stop_is_confirmed_only_if_every_owner_confirms(
    answers: list[Any], status: int, code: str | None, make: Make, sent: list[Any]
) -> None:
    owners = [StubOwner(pid, answers={"stop": answer}) for pid, answer in enumerate(answers)]
    found, answer = make(*owners, configured=False).post("/stop")
    assert (found, answer.get("code")) == (status, code)
    assert all(one.asked == [("stop", {})] for one in owners), "a problem of one keeps no other from being asked"
    assert sent == []


@pytest.mark.parametrize(
    ("stop", "status", "code"),
    [
        (SentStop(("a",), problems=["no such port"]), 503, "not_sent"),
        (SentStop(("a",), sent=True), 503, "not_confirmed"),
        (SentStop(("a",), sent=True, state="Alarm", notified=(3,)), 200, None),
    ],
    ids=["not sent", "not confirmed", "confirmed"],
)
@pytest.mark.parametrize("owners", [[], [StubOwner(answers={"stop": ENDED})]], ids=["no owner", "one that has ended"])
def test_the_panel_sends_the_stop_itself_if_no_owner_takes_it(
    make: Make,
    monkeypatch: pytest.MonkeyPatch,
    owners: list[StubOwner],
    stop: SentStop,
    status: int,
    code: str | None,
) -> None:
    monkeypatch.setattr(stops, "send_stop", lambda settings: stop)
    found, answer = make(*owners).post("/stop")
    assert (found, answer.get("code")) == (status, code)
    assert stop.words in (answer.get("words") or answer["problem"])


@pytest.mark.parametrize("lives", [False, True], ids=["hangs", "takes its time"])
def test_the_bytes_go_out_at_once_beside_an_owner_that_hangs(
    make: Make, sent: list[Any], monkeypatch: pytest.MonkeyPatch, lives: bool
) -> None:
    monkeypatch.setattr(stops, "BESIDE_S", 0.01)
    monkeypatch.setattr(stops, "_ANSWER_S", 0.01)
    free = threading.Event()
    status = {"ok": True} if lives else ControlError("process 1 does not answer within 0.01 s")
    owner = StubOwner(ports=("/dev/ttyUSB0",), answers={"stop": hanging(free), "status": status})
    try:
        assert make(owner).refused("/stop") == (503, "not_answered_yet")
        until(lambda: ("status", {}) in owner.asked)
        until(lambda: lives or sent)
        assert len(sent) == (not lives)
    finally:
        free.set()


def test_a_stop_waits_behind_no_other_stop_and_no_request(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stops, "_ANSWER_S", 0.01)
    free = threading.Event()
    panel = make(StubOwner(answers={"pause": hanging(free), "stop": hanging(free)}))
    paused = [threading.Thread(target=panel.post, args=["/pause"]) for _ in range(12)]
    for one in paused:
        one.start()
    for _ in range(20):
        assert panel.refused("/stop") == (503, "not_answered_yet")
    assert len(panel.owners[0].said) == 20
    until(lambda: panel.owners[0].asked.count(("stop", {})) == 20)
    free.set()
    for one in paused:
        one.join(DEADLINE_S)


def test_repeats_of_one_press_share_the_attempt_and_another_press_is_another_stop(
    make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without an owner; two programs that read one port would take each other's replies."""
    free, begun = threading.Event(), list[object]()

    def send(settings: object) -> SentStop:
        begun.append(settings)
        assert free.wait(DEADLINE_S)
        return SentStop(("a",), sent=True, state="Alarm")

    monkeypatch.setattr(stops, "send_stop", send)
    panel, codes = make(), list[int]()

    def press(number: int) -> threading.Thread:
        thread = threading.Thread(target=lambda: codes.append(panel.post("/stop", {"press": number})[0]))
        thread.start()
        return thread

    first = press(1)
    until(lambda: len(begun) == 1)
    repeats = [press(1), press(1), press(2)]
    until(lambda: len(begun) == 2)
    free.set()
    for one in (first, *repeats):
        one.join(DEADLINE_S)
    assert (codes, len(begun)) == ([200] * 4, 2)
