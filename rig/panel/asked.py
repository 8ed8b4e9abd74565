"""What a page asks for by POST: read strictly, and nothing is done that was not understood."""

import json
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

from starlette.requests import Request

from rig.errors import RigError

MOST_BYTES = 4096
_LARGEST = 1e12
_SIGNS = (-1, 1)
_AXES = ("x", "y", "z")
_STATUS = {"no_such_run": 404, "no_such_file": 404, "body_too_large": 413, "content_type": 415}


class RequestError(RigError):
    """A request that is not understood, or for something that there is not. One line."""

    default_code = "bad_request"

    @property
    def status(self) -> int:
        """Of HTTP."""
        return _STATUS.get(self.code, 400)


async def body_of(request: Request) -> dict[str, Any]:
    """The JSON object that was sent. Raises RequestError."""
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise RequestError("content-type: expected application/json", code="content_type")
    found = bytearray()
    async for piece in request.stream():
        found += piece
        if len(found) > MOST_BYTES:
            raise RequestError("body: expected at most {most} bytes", code="body_too_large", most=MOST_BYTES)
    try:
        told = json.loads(found, parse_constant=_no_number)
    except (ValueError, RecursionError):
        raise RequestError("body: expected a JSON object", code="no_json_object") from None
    if not isinstance(told, dict):
        raise RequestError("body: expected a JSON object", code="no_json_object")
    return told


def _no_number(name: str) -> float:
    raise ValueError(name)


def _not_understood(code: str, key: str, expected: str) -> RequestError:
    return RequestError("{key}: expected {expected}", code=code, key=key, expected=expected)


class HeldButton(NamedTuple):
    """A button that is down: which way, how fast, which press of it, and when the page said so."""

    axis: Literal["x", "y", "z"]
    sign: Literal[-1, 1]
    speed_mm_s: float
    press: int
    unix_s: float

    @classmethod
    def of(cls, body: Mapping[str, Any]) -> "HeldButton":
        """Raises RequestError."""
        axis, sign = body.get("axis"), body.get("sign")
        if axis not in _AXES:
            raise _not_understood("unknown_choice", "axis", "x, y or z")
        if type(sign) is not int or sign not in _SIGNS:
            raise _not_understood("unknown_choice", "sign", "1 or -1")
        speed_mm_s = number("speed_mm_s", body)
        if speed_mm_s <= 0:
            raise _not_understood("not_positive", "speed_mm_s", "more than 0")
        return cls(axis, sign, speed_mm_s, whole("press", body), number("unix_s", body))  # type: ignore[arg-type]


def number(name: str, body: Mapping[str, Any]) -> float:
    """A finite one. Raises RequestError."""
    found = body.get(name)
    if isinstance(found, bool) or not isinstance(found, int | float) or not abs(found) <= _LARGEST:
        raise _not_understood("not_a_number", name, "a number")
    return float(found)


def whole(name: str, body: Mapping[str, Any]) -> int:
    """A whole number from 0. Raises RequestError."""
    found = body.get(name)
    if type(found) is not int or found < 0:
        raise _not_understood("not_whole", name, "a whole number")
    return found


def flag(name: str, body: Mapping[str, Any]) -> bool:
    """True or false, which it is where nothing is said. Raises RequestError."""
    found = body.get(name, False)
    if type(found) is not bool:
        raise _not_understood("not_a_flag", name, "true or false")
    return found
