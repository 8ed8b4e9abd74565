"""Who is let in: each refusal for every request that changes something, walked from the routes themselves."""

import asyncio

import pytest
from starlette.datastructures import Headers
from starlette.routing import Route

from rig.panel.access import FILE_POLICY, Address
from tests.rig.panel.asgi_client import asked
from tests.rig.panel.stub_panel import HERE, OWN, PORT, STOP_PORT, TOKEN, StubPanel

PAGE_POLICY = Address(PORT, STOP_PORT, TOKEN).page_policy
ALL = ["/by_hand", "/go_on", "/home", "/leave", "/park", "/pause", "/step", "/stop", "/take", "/zero"]
ELSEWHERE = "http://evil.example"
WRONG: dict[str, dict[str, str | bytes | None]] = {
    "no token": {"x_rig_token": None},
    "an empty token": {"x_rig_token": ""},
    "another token": {"x_rig_token": TOKEN + "x"},
    "part of the token": {"x_rig_token": TOKEN[:-1]},
    "a token beyond ASCII": {"x_rig_token": b"t\xf6ken"},
    "no origin": {"origin": None},
    "another origin": {"origin": ELSEWHERE},
    "a hidden origin": {"origin": "null"},
    "another port's origin": {"origin": f"http://127.0.0.1:{PORT + 1}"},
    "its other name's origin": {"origin": f"http://localhost:{PORT}"},
    "an origin with more behind": {"origin": f"{HERE}.evil.example"},
    "an origin by https": {"origin": f"https://127.0.0.1:{PORT}"},
    "another host": {"host": "evil.example"},
    "a name that leads here": {"host": f"rebound.evil.example:{PORT}", "origin": f"http://rebound.evil.example:{PORT}"},
    "a name that ends alike": {"host": f"evil-localhost:{PORT}", "origin": f"http://evil-localhost:{PORT}"},
    "this machine elsewhere": {"host": f"0.0.0.0:{PORT}", "origin": f"http://0.0.0.0:{PORT}"},
    "another port": {"host": f"127.0.0.1:{PORT + 1}"},
    "no port": {"host": "127.0.0.1"},
}  # fmt: skip


def test_every_request_that_changes_something_is_walked(panel: StubPanel) -> None:
    routes = [one for one in panel.app._app.routes if isinstance(one, Route)]  # type: ignore[attr-defined]
    assert sorted(one.path for one in routes if "POST" in (one.methods or ())) == ALL
    assert {method for one in routes for method in one.methods or ()} == {"GET", "HEAD", "POST"}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_not_the_page_s_own_is_refused_and_does_nothing(wrong: str, panel: StubPanel) -> None:
    told = WRONG[wrong]
    code = "foreign_host" if "host" in told else "foreign_origin" if "origin" in told else "wrong_token"
    for path in ALL:
        assert panel.refused(path, **told) == (403, code), path
        assert (panel.owners[0].asked, panel.watcher.tabs.holder, panel.bench.taken) == ([], None, 0), path


@pytest.mark.parametrize("path", ALL)
@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "LOCALHOST"])
def test_what_is_the_page_s_own_is_let_in(path: str, host: str, panel: StubPanel) -> None:
    own = f"{host}:{PORT}"
    code, _ = panel.post(path, host=own, origin=f"http://{own.lower()}")
    assert code != 403


@pytest.mark.parametrize("twice", ["host", "origin", "x-rig-token"])
def test_what_is_said_twice_is_refused(twice: str, panel: StubPanel) -> None:
    """One of them may be read here, the other by whoever stands between."""
    headers = [*OWN.items(), ("x-rig-tab", "a"), (twice, OWN[twice])]
    assert asked(panel.app, "POST", "/take", headers, [b"{}"]).status_code == 403
    assert panel.watcher.tabs.holder is None


@pytest.mark.parametrize("method", ["PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "PROPFIND"])
def test_there_are_no_other_methods(method: str, panel: StubPanel) -> None:
    """A preflight is answered with a refusal: no other page may even ask."""
    for path in (*ALL, "/", "/events", "/runs.json", "/runs/a/", "/runs/a/b", "/static/a", "/none"):
        assert panel.get(path, method).status_code == 403, path
        answer = asked(panel.app, method, path, [*OWN.items(), ("x-rig-tab", "a")])
        assert (answer.status_code, answer.json()["code"]) in ((404, "not_found"), (405, "method_not_allowed")), path
        assert "access-control-allow-origin" not in answer.headers, path
        assert panel.owners[0].asked == [], path


@pytest.mark.parametrize("path", ALL)
def test_what_changes_something_is_not_to_be_had_by_looking(path: str, panel: StubPanel) -> None:
    for method in ("GET", "HEAD"):
        assert panel.get(path, method, x_rig_token=TOKEN).status_code == 405
    assert panel.owners[0].asked == []


@pytest.mark.parametrize("path", ["/", "/events", "/runs.json", "/runs/a/", "/runs/a/b", "/static/a", "/none"])
@pytest.mark.parametrize(
    "headers",
    [
        {"host": "evil.example"},
        {"host": f"rebound.evil.example:{PORT}"},
        {"origin": ELSEWHERE},
        {"origin": "null"},
        {"sec_fetch_site": "cross-site", "sec_fetch_mode": "no-cors"},
        {"sec_fetch_site": "same-site", "sec_fetch_mode": "cors"},
        {"sec_fetch_site": "cross-site"},
    ],
    ids=str,
)
def test_looking_is_for_this_machine_s_own_pages(path: str, headers: dict[str, str], panel: StubPanel) -> None:
    answer = panel.get(path, **headers)
    code = "foreign_host" if "host" in headers else "foreign_page"
    assert (answer.status_code, answer.json()["code"]) == (403, code)


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"origin": HERE},
        {"sec_fetch_site": "none", "sec_fetch_mode": "navigate"},
        {"sec_fetch_site": "same-origin", "sec_fetch_mode": "cors"},
        {"sec_fetch_site": "cross-site", "sec_fetch_mode": "navigate"},
    ],
    ids=str,
)
def test_a_link_from_anywhere_leads_to_the_page(headers: dict[str, str], panel: StubPanel) -> None:
    assert panel.get("/", **headers).status_code == 200


@pytest.mark.parametrize("method", ["GET", "HEAD"])
@pytest.mark.parametrize("token", [None, "", TOKEN[:-1], TOKEN + "x", "t\xf6ken"])
def test_a_stream_is_for_a_page_with_the_token(method: str, token: str | None, panel: StubPanel) -> None:
    """A page of another site can navigate here, and four streams are all there are."""
    headers = {"sec_fetch_site": "cross-site", "sec_fetch_mode": "navigate"}
    if token is not None:
        headers["x_rig_token"] = token
    answer = panel.get("/events", method, **headers)
    assert (answer.status_code, answer.json()["code"]) == (403, "wrong_token")
    assert panel.watcher.outlet.clients == []


@pytest.mark.parametrize("path", ["/", "/runs.json", "/runs/none/", "/none", "/static/none"])
def test_every_answer_says_what_a_browser_may_do_with_it(path: str, panel: StubPanel) -> None:
    for answer in (panel.get(path), panel.get(path, host="evil.example")):
        assert answer.headers["cache-control"] == "no-store"
        assert answer.headers["content-security-policy"] == PAGE_POLICY
        assert answer.headers["cross-origin-resource-policy"] == "same-origin"
        assert answer.headers["cross-origin-opener-policy"] == "same-origin"
        assert answer.headers["referrer-policy"] == "no-referrer"
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["x-frame-options"] == "DENY"
        assert "access-control-allow-origin" not in answer.headers


@pytest.mark.parametrize("path", ["/", "/static/index.html"])
@pytest.mark.parametrize("part", ["0-1", "0-1,3-4", "1-" + "9" * 5000, "-" + "9" * 5000, "a-b", "", "-1--5", "1.5-"])
def test_a_range_is_not_read_and_the_whole_file_is_sent(path: str, part: str, panel: StubPanel) -> None:
    answer = panel.get(path, range=f"bytes={part}")
    assert (answer.status_code, answer.content) == (200, panel.get(path).content)


def test_nothing_inline_and_nothing_from_elsewhere() -> None:
    stops = [f"http://{name}:{STOP_PORT}" for name in ("127.0.0.1", "localhost")]
    assert [one for one in PAGE_POLICY.split() if "http" in one] == [stops[0], f"{stops[1]};"]
    assert "http" not in FILE_POLICY
    for policy in (PAGE_POLICY, FILE_POLICY):
        assert "default-src 'none'" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe-eval" not in policy
    assert "unsafe" not in PAGE_POLICY
    assert FILE_POLICY.startswith("sandbox; ")
    assert "script" not in FILE_POLICY


STOP_HOST = f"127.0.0.1:{STOP_PORT}"


def at_stop(panel: StubPanel, method: str, **other: str) -> tuple[int, Headers]:
    headers = {**OWN, "host": STOP_HOST, "x-rig-tab": "a", **other}
    answer = asked(panel.stop_app, method, "/stop", list(headers.items()), [b"{}"])
    return answer.status_code, answer.headers


def test_the_port_of_stop_takes_a_stop_from_the_panel_s_own_page_only(panel: StubPanel) -> None:
    status, headers = at_stop(panel, "POST")
    assert (status, headers["access-control-allow-origin"]) == (200, HERE)
    assert panel.owners[0].asked == [("stop", {})]
    status, headers = at_stop(panel, "HEAD")
    assert (status, headers["access-control-allow-origin"]) == (200, HERE)
    for origin in (ELSEWHERE, "null", f"http://127.0.0.1:{STOP_PORT}", f"http://localhost:{PORT}"):
        for method in ("POST", "HEAD", "OPTIONS"):
            status, headers = at_stop(panel, method, origin=origin)
            assert status == 403
            assert "access-control-allow-origin" not in headers
    assert at_stop(panel, "POST", host=f"127.0.0.1:{PORT}")[0] == 403
    status, headers = at_stop(panel, "POST", **{"x-rig-token": "another"})
    assert (status, headers["access-control-allow-origin"]) == (403, HERE), "its page may read why"
    assert panel.owners[0].asked == [("stop", {})]


def test_a_browser_may_ask_once_for_all_whether_its_page_may_stop(panel: StubPanel) -> None:
    status, headers = at_stop(panel, "OPTIONS", **{"x-rig-token": ""})
    assert (status, headers["access-control-allow-origin"]) == (204, HERE)
    assert set(headers["access-control-allow-headers"].split(", ")) == {"content-type", "x-rig-tab", "x-rig-token"}
    assert int(headers["access-control-max-age"]) >= 3600


def test_what_is_no_request_is_not_answered(panel: StubPanel) -> None:
    said = list[object]()

    async def send(message: object) -> None:
        said.append(message)

    asyncio.run(panel.app({"type": "websocket"}, None, send))
    assert said == []
