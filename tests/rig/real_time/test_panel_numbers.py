"""Every number in a request to the panel: anything else in its place is refused in one line, without a traceback."""

import inspect
import json
import logging
import re
import socket
from collections.abc import Callable

import pytest

from rig.panel import access, app, requests, run_files
from rig.panel.app import Panel
from tests.rig.real_time.panel_page import Serve, post, serve
from tests.rig.real_time.test_panel_served import raw
from tests.waiting import DEADLINE_S

__all__ = ["serve"]  # a fixture

STEP = {"axis": b'"x"', "sign": b"1", "by_mm": b"1", "unix_s": b"0"}
WRONG = {
    "5 000 digits": b"9" * 5000,
    "4 000 digits": b"9" * 4000,
    "20 digits": b"9" * 20,
    "beyond all numbers": b"1e400",
    "negative": b"-1",
    "not a number": b"NaN",
    "infinite": b"-Infinity",
    "empty": b"",
    "digits beyond ASCII": "\u0662".encode(),
    "a float": b"1.5",
    "a text": b'"1"',
    "a list": b"[1]",
}
"""What is no number, or no number that is understood there."""
UNDERSTOOD = {
    ("sign", "negative"),
    *(("press", what) for what in ("4 000 digits", "20 digits", "negative")),
    ("unix_s", "a float"),
    ("unix_s", "negative"),
    ("length of a piece", "20 digits"),  # hexadecimal, as the next one
    ("length of a piece", "beyond all numbers"),
}


def _request(panel: Panel, line: str, body: bytes, *more: bytes) -> bytes:
    here, token = f"127.0.0.1:{panel.port}", panel.url.partition("=")[2]
    head = f"{line} HTTP/1.1\r\nHost: {here}\r\nOrigin: http://{here}\r\nX-Rig-Token: {token}\r\nX-Rig-Tab: a\r\n"
    kind = b"Content-Type: application/json\r\nConnection: close\r\n"
    return head.encode() + kind + b"".join(one + b"\r\n" for one in more) + b"\r\n" + body


def _posted(panel: Panel, path: str, body: bytes) -> bytes:
    return _request(panel, f"POST {path}", body, b"Content-Length: %d" % len(body))


def _object(*pairs: tuple[str, bytes]) -> bytes:
    return b"{" + b", ".join(b'"%s": %s' % (key.encode(), value) for key, value in pairs) + b"}"


def _limit(panel: Panel, *values: bytes) -> bytes:
    query = "&".join("limit=" + "".join(f"%{byte:02x}" for byte in value) for value in values)
    plain = "&".join("limit=" + value.decode() for value in values)
    return _request(panel, f"GET /runs.json?{query if len(query) < 9000 else plain}", b"")


def _length(panel: Panel, *values: bytes) -> bytes:
    return _request(panel, "POST /take", b"{}", *(b"Content-Length: " + value for value in values))


def _piece(panel: Panel, *values: bytes) -> bytes:
    pieces = b"".join(value + b"\r\n{}\r\n" for value in values)
    return _request(panel, "POST /take", pieces + b"0\r\n\r\n", b"Transfer-Encoding: chunked")


def _step(key: str) -> Callable[..., bytes]:
    others = [(name, value) for name, value in STEP.items() if name != key]
    return lambda panel, *values: _posted(panel, "/step", _object(*others, *((key, value) for value in values)))


NUMBERS: dict[str, Callable[..., bytes]] = {
    "limit": _limit,
    "content-length": _length,
    "length of a piece": _piece,
    **{key: _step(key) for key in ("sign", "by_mm", "unix_s")},
    "press": lambda panel, *values: _posted(panel, "/stop", _object(*(("press", value) for value in values))),
}
"""A request with these values of the number, by the name of the number."""
TWICE = dict.fromkeys(NUMBERS, (b"1", b"2")) | {"length of a piece": (b"2", b"-2")}


def _refused(panel: Panel, request: bytes) -> tuple[int, str]:
    """The status and the code of a refusal; the sender stays until it has it."""
    with socket.create_connection(("127.0.0.1", panel.port), timeout=DEADLINE_S) as wire:
        wire.sendall(request)
        answer = b"".join(iter(lambda: wire.recv(65536), b""))
    head, _, body = answer.partition(b"\r\n\r\n")
    if b"transfer-encoding: chunked" in head.lower():
        _, body, *_ = body.split(b"\r\n")
    told = json.loads(body)
    assert (told["ok"], list(told)) == (False, ["ok", "problem", "code"])
    assert told["problem"]
    assert len(body) < 200
    assert b"\n" not in body
    return int(head.split()[1]), told["code"]


def test_every_number_in_a_request_is_refused_in_one_line_unless_it_is_understood(
    serve: Serve, caplog: pytest.LogCaptureFixture
) -> None:
    panel = serve()
    for name, request in NUMBERS.items():
        for what, value in WRONG.items():
            if (name, what) not in UNDERSTOOD:
                assert _refused(panel, request(panel, value))[0] in (400, 413), (name, what)
        assert _refused(panel, request(panel, *TWICE[name]))[0] == 400, name
    assert not [one for one in caplog.records if one.levelno >= logging.ERROR]
    assert post(panel, "/take")[0] == 200


def test_these_are_all_numbers_in_requests() -> None:
    source = "".join(inspect.getsource(module) for module in (requests, run_files, access, app))
    named = set(re.findall(r'\bwhole_of_text\("([\w-]+)"', source))
    fields = {
        name
        for kind in (requests.StepBody, requests.ZeroBody, requests.StopBody)
        for name, field in kind.model_fields.items()
        if name not in ("axis", "anyway")
    }
    assert named | fields | {"length of a piece"} == set(NUMBERS)


def test_a_request_that_breaks_off_logs_no_error(serve: Serve, caplog: pytest.LogCaptureFixture) -> None:
    panel = serve()
    for more in (b"Content-Length: 100", b"Transfer-Encoding: chunked"):
        raw(panel, _request(panel, "POST /take", b"64\r\n{", more))
    assert post(panel, "/take")[0] == 200
    assert not [one for one in caplog.records if one.levelno >= logging.ERROR]
