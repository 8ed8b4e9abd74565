"""The moves of a GRBL stage as its wire tells them: a target is confirmed before a trigger goes to it."""

import re
from collections.abc import Iterable
from typing import NamedTuple


class Confirmed(NamedTuple):
    """A move: when it was begun (s), where to (machine mm, by axis), and its feed (mm/min)."""

    t_s: float
    target_mm: dict[str, float]
    feed: float


def confirmed_moves(chunks: Iterable[tuple[float, str, bytes]]) -> list[Confirmed]:
    """Read moves from what was written ("tx") and heard ("rx"): the last work zero before each trigger."""
    found, heard, begun_s, feed = list[Confirmed](), b"", 0.0, 0.0
    for t_s, direction, data in chunks:
        if direction == "rx":
            heard += data
        elif data.startswith(b"G92"):
            heard, begun_s, feed = b"", t_s, float(data.split(b"F")[1])
        elif re.fullmatch(rb"G1([XYZ]0)+\n", data):
            zeros = re.findall(rb"WCO:([-\d.]+),([-\d.]+),([-\d.]+)", heard)
            work_zero = dict(zip("XYZ", map(float, zeros[-1]), strict=True))
            axes = data.decode().removeprefix("G1").strip().split("0")[:-1]
            found.append(Confirmed(begun_s, {axis: work_zero[axis] for axis in axes}, feed))
    return found
