"""What a page asks for by POST: read strictly, and nothing is done that was not understood."""

import json
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

from starlette.exceptions import HTTPException
from starlette.requests import Request

MOST_BYTES = 4096
_LARGEST = 1e12
_SIGNS = (-1, 1)
_AXES = ("x", "y", "z")


async def body_of(request: Request) -> dict[str, Any]:
    """The JSON object that was sent. Raises HTTPException."""
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise HTTPException(415, "content-type: expected application/json")
    found = bytearray()
    async for piece in request.stream():
        found += piece
        if len(found) > MOST_BYTES:
            raise HTTPException(413, f"body: expected at most {MOST_BYTES} bytes")
    try:
        told = json.loads(found, parse_constant=_no_number)
    except (ValueError, RecursionError):
        raise HTTPException(400, "body: expected a JSON object") from None
    if not isinstance(told, dict):
        raise HTTPException(400, "body: expected a JSON object")
    return told


def _no_number(name: str) -> float:
    raise ValueError(name)


class HeldButton(NamedTuple):
    """A button that is down: which way, how fast, which press of it, and when the page said so."""

    axis: Literal["x", "y", "z"]
    sign: Literal[-1, 1]
    speed_mm_s: float
    press: int
    unix_s: float

    @classmethod
    def of(cls, body: Mapping[str, Any]) -> "HeldButton":
        """Raises HTTPException."""
        axis, sign = body.get("axis"), body.get("sign")
        if axis not in _AXES:
            raise HTTPException(400, "axis: expected x, y or z")
        if type(sign) is not int or sign not in _SIGNS:
            raise HTTPException(400, "sign: expected 1 or -1")
        speed_mm_s = number("speed_mm_s", body)
        if speed_mm_s <= 0:
            raise HTTPException(400, "speed_mm_s: expected more than 0")
        return cls(axis, sign, speed_mm_s, whole("press", body), number("unix_s", body))  # type: ignore[arg-type]


def number(name: str, body: Mapping[str, Any]) -> float:
    """A finite one. Raises HTTPException."""
    found = body.get(name)
    if isinstance(found, bool) or not isinstance(found, int | float) or not abs(found) <= _LARGEST:
        raise HTTPException(400, f"{name}: expected a number")
    return float(found)


def whole(name: str, body: Mapping[str, Any]) -> int:
    """A whole number from 0. Raises HTTPException."""
    found = body.get(name)
    if type(found) is not int or found < 0:
        raise HTTPException(400, f"{name}: expected a whole number")
    return found


def flag(name: str, body: Mapping[str, Any]) -> bool:
    """True or false, which it is where nothing is said. Raises HTTPException."""
    found = body.get(name, False)
    if type(found) is not bool:
        raise HTTPException(400, f"{name}: expected true or false")
    return found
