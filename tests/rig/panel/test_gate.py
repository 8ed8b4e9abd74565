"""Who is let in: the panel's own page on this machine, for every request that its routes name."""

import asyncio

import pytest
from starlette.datastructures import Headers
from starlette.routing import Route

from rig.panel.access import FILE_POLICY, Address
from tests.rig.panel.asgi_client import asked
from tests.rig.panel.stub_panel import HERE, OWN, PORT, STOP_PORT, TOKEN, StubPanel

PAGE_POLICY = Address(PORT, STOP_PORT, TOKEN).page_policy
POSTS = ["/by_hand", "/go_on", "/home", "/leave", "/park", "/pause", "/step", "/stop", "/take", "/zero"]
PAGES = ["/", "/events", "/runs.json", "/runs/a/", "/runs/a/b", "/static/a", "/none"]
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
FOREIGN: list[dict[str, str]] = [
    {"host": "evil.example"},
    {"host": f"rebound.evil.example:{PORT}"},
    {"origin": ELSEWHERE},
    {"origin": "null"},
    {"sec_fetch_site": "cross-site", "sec_fetch_mode": "no-cors"},
    {"sec_fetch_site": "same-site", "sec_fetch_mode": "cors"},
    {"sec_fetch_site": "cross-site"},
]
OWN_PAGE: list[dict[str, str]] = [
    {},
    {"origin": HERE},
    {"sec_fetch_site": "none", "sec_fetch_mode": "navigate"},
    {"sec_fetch_site": "same-origin", "sec_fetch_mode": "cors"},
    {"sec_fetch_site": "cross-site", "sec_fetch_mode": "navigate"},  # a link from anywhere
]


def test_these_are_all_requests_that_change_something(panel: StubPanel) -> None:
    routes = [one for one in panel.app._app.routes if isinstance(one, Route)]  # type: ignore[attr-defined]
    assert sorted(one.path for one in routes if "POST" in (one.methods or ())) == POSTS
    assert {method for one in routes for method in one.methods or ()} == {"GET", "HEAD", "POST"}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_request_from_elsewhere_is_refused_and_does_nothing(wrong: str, panel: StubPanel) -> None:
    told = WRONG[wrong]
    code = "foreign_host" if "host" in told else "foreign_origin" if "origin" in told else "wrong_token"
    for path in POSTS:
        assert panel.refused(path, **told) == (403, code), path
        assert (panel.owners[0].asked, panel.watcher.tabs.holder, panel.bench.taken) == ([], None, 0), path


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "LOCALHOST"])
def test_a_request_from_the_panel_s_own_page_is_let_in(host: str, panel: StubPanel) -> None:
    own = f"{host}:{PORT}"
    for path in POSTS:
        assert panel.post(path, host=own, origin=f"http://{own.lower()}")[0] != 403, path


@pytest.mark.parametrize("twice", ["host", "origin", "x-rig-token"])
def test_a_header_that_comes_twice_is_refused(twice: str, panel: StubPanel) -> None:
    headers = [*OWN.items(), ("x-rig-tab", "a"), (twice, OWN[twice])]
    assert asked(panel.app, "POST", "/take", headers, [b"{}"]).status_code == 403
    assert panel.watcher.tabs.holder is None


@pytest.mark.parametrize("method", ["PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "PROPFIND", "GET", "HEAD"])
def test_other_methods_change_nothing_and_allow_no_other_page(method: str, panel: StubPanel) -> None:
    shows = method in ("GET", "HEAD")
    for path in POSTS if shows else (*POSTS, *PAGES):
        assert shows or panel.get(path, method).status_code == 403, path
        answer = asked(panel.app, method, path, [*OWN.items(), ("x-rig-tab", "a")])
        assert answer.status_code in (404, 405), path
        assert "access-control-allow-origin" not in answer.headers, path
    assert panel.owners[0].asked == []


@pytest.mark.parametrize("headers", FOREIGN, ids=str)
def test_pages_of_other_sites_can_read_nothing(headers: dict[str, str], panel: StubPanel) -> None:
    code = "foreign_host" if "host" in headers else "foreign_page"
    for path in PAGES:
        answer = panel.get(path, **headers)
        assert (answer.status_code, answer.json()["code"]) == (403, code), path


@pytest.mark.parametrize("headers", OWN_PAGE, ids=str)
def test_a_browser_on_this_machine_can_open_the_page(headers: dict[str, str], panel: StubPanel) -> None:
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
def test_every_answer_forbids_other_sites_to_use_it(path: str, panel: StubPanel) -> None:
    for answer in (panel.get(path), panel.get(path, host="evil.example")):
        assert answer.headers["content-security-policy"] == PAGE_POLICY
        for name, value in {
            "cache-control": "no-store",
            "cross-origin-resource-policy": "same-origin",
            "cross-origin-opener-policy": "same-origin",
            "referrer-policy": "no-referrer",
            "x-content-type-options": "nosniff",
            "x-frame-options": "DENY",
        }.items():
            assert answer.headers[name] == value
        assert "access-control-allow-origin" not in answer.headers


@pytest.mark.parametrize("part", ["0-1", "0-1,3-4", "1-" + "9" * 5000, "a-b", "", "1.5-"])
def test_a_request_for_a_part_of_a_file_gets_the_whole_file(part: str, panel: StubPanel) -> None:
    for path in ("/", "/static/index.html"):
        answer = panel.get(path, range=f"bytes={part}")
        assert (answer.status_code, answer.content) == (200, panel.get(path).content)


def test_no_policy_allows_inline_scripts_or_another_site() -> None:
    stops = [f"http://{name}:{STOP_PORT}" for name in ("127.0.0.1", "localhost")]
    assert [one for one in PAGE_POLICY.split() if "http" in one] == [stops[0], f"{stops[1]};"]
    assert "unsafe" not in PAGE_POLICY
    for policy in (PAGE_POLICY, FILE_POLICY):
        assert "default-src 'none'" in policy
        assert "frame-ancestors 'none'" in policy
    assert FILE_POLICY.startswith("sandbox; ")
    assert not {"http", "script", "unsafe-eval"} & set(FILE_POLICY.replace(";", "").split())


def at_stop(panel: StubPanel, method: str, **other: str) -> tuple[int, Headers]:
    headers = {**OWN, "host": f"127.0.0.1:{STOP_PORT}", "x-rig-tab": "a", **other}
    answer = asked(panel.stop_app, method, "/stop", list(headers.items()), [b"{}"])
    return answer.status_code, answer.headers


def test_the_port_of_stop_takes_a_stop_from_the_panel_s_own_page_only(panel: StubPanel) -> None:
    for method in ("POST", "HEAD"):
        status, headers = at_stop(panel, method)
        assert (status, headers["access-control-allow-origin"]) == (200, HERE)
    for origin in (ELSEWHERE, "null", f"http://127.0.0.1:{STOP_PORT}", f"http://localhost:{PORT}"):
        for method in ("POST", "HEAD", "OPTIONS"):
            status, headers = at_stop(panel, method, origin=origin)
            assert status == 403
            assert "access-control-allow-origin" not in headers
    assert at_stop(panel, "POST", host=f"127.0.0.1:{PORT}")[0] == 403
    status, headers = at_stop(panel, "POST", **{"x-rig-token": "another"})
    assert (status, headers["access-control-allow-origin"]) == (403, HERE), "its page may read why"
    status, headers = at_stop(panel, "OPTIONS", **{"x-rig-token": ""})
    assert (status, headers["access-control-allow-origin"]) == (204, HERE), "a browser asks once for all"
    assert set(headers["access-control-allow-headers"].split(", ")) == {"content-type", "x-rig-tab", "x-rig-token"}
    assert int(headers["access-control-max-age"]) >= 3600
    assert panel.owners[0].asked == [("stop", {})]


def test_a_web_socket_is_not_answered(panel: StubPanel) -> None:
    said = list[object]()

    async def send(message: object) -> None:
        said.append(message)

    asyncio.run(panel.app({"type": "websocket"}, None, send))
    assert said == []
