"""Work zero: where the target of a motion is placed and read back before anything can move (decision 0036).

GRBL has no checksums. A target is sent as an offset (G92), which moves nothing, and the board prints where that puts
work zero (WCO in the next status). Only a place that was read back is gone to, by a trigger that is always the same.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from rig.devices.stage.base import LOOK_S, StageError
from rig.devices.stage.grbl.grbl_link import GrblLink
from rig.devices.stage.grbl.grbl_settings import near
from rig.devices.stage.grbl.grbl_words import Xyz, feed_word, number, parse_modes

SHORT_MM = 0.1
"""An increment, which is over before it is fast: at 50 mm/s² the feed hardly matters."""

MODES = "G90G21G94"
_ROUND_OFF_MM = 1e-9
# `$G` prints the feed without decimals.
_FEED_SHOWN_MM_MIN = 0.51


class Doubt(NamedTuple):
    """What the board did not confirm: words, a code and fields for the error that it ends in."""

    words: str
    code: str
    fields: dict[str, Any]


def offset_line(coordinates: Xyz, speed_mm_s: float) -> str:
    """Return the line that makes these the work coordinates of the present place, and sets modes and feed.

    G92 comes first and each word after it is there twice if one bit of G92 turns it into another command that would
    move: `G90`, `G93` and `F92` are then refused, and a lost G leaves no number for it to join.
    """
    x, y, z = map(number, coordinates)
    return f"G92X{x}Y{y}Z{z}{MODES}{feed_word(speed_mm_s)}"


def doubt_about_zero(
    link: GrblLink,
    board: Mapping[int, float],
    present: Xyz,
    coordinates: Xyz,
    speed_mm_s: float,
    *,
    confirm_modes: bool = False,
) -> Doubt | None:
    """Place work zero and read it back; nothing moves. Before a long motion modes and feed are read back, too.

    Parameters
    ----------
    link : GrblLink
        The conversation with the board.
    board : mapping of int to float
        Its settings, by number.
    present : tuple of float
        Where the stage stands, machine mm.
    coordinates : tuple of float
        The work coordinates that this place gets, mm.
    speed_mm_s : float
        The speed of the motion to come, mm/s.
    confirm_modes : bool
        Whether modes and feed are read back before a short motion, too.

    Returns
    -------
    Doubt, optional
        What the board did not confirm; None where all is as it should be.

    Raises
    ------
    StageError
        If the board refuses the line, does not answer, is held, or is not idle.
    """
    link.offset = None  # what was known of it is over: positions in work coordinates wait for the new one
    link.command(offset_line(coordinates, speed_mm_s), look_s=LOOK_S)
    if confirm_modes or max(map(abs, coordinates)) > SHORT_MM + _ROUND_OFF_MM:
        printed = link.command("$G", look_s=LOOK_S)
        if (doubt := _doubt_about_modes(printed, 60 * speed_mm_s)) is not None:
            return doubt
    fields = link.ask_status()
    link.refuse_interference(fields.state)
    if fields.state != "Idle":
        raise StageError("{port}: {state} before a move", code="not_idle", port=link.name, state=fields.state)
    if fields.offset is None:
        return Doubt("the status after G92 holds no WCO", "no_offset", {})
    meant = tuple(mm - coordinate for mm, coordinate in zip(present, coordinates, strict=True))
    wrong = [
        (axis, found, mm)
        for i, (axis, found, mm) in enumerate(zip("XYZ", fields.offset, meant, strict=True))
        if not near(board, i, found, mm)
    ]
    if not wrong:
        return None
    said = ", ".join(f"work zero {axis} is at {found} mm, not at {mm:.4f} mm" for axis, found, mm in wrong)
    zeros = {axis: found for axis, found, _ in wrong}
    return Doubt(said, "wrong_work_zero", {"found_mm": zeros, "meant_mm": {axis: mm for axis, _, mm in wrong}})


def _doubt_about_modes(printed: list[str], feed_mm_min: float) -> Doubt | None:
    words, feed = parse_modes(printed)
    missing = sorted({"G90", "G21", "G94"} - words)
    if missing:
        return Doubt(f"$G does not show {', '.join(missing)}", "modes_missing", {"missing": missing})
    if feed is None or abs(feed - feed_mm_min) > _FEED_SHOWN_MM_MIN:
        said = f"$G shows a feed of {feed} mm/min, not of {feed_mm_min:g} mm/min"
        return Doubt(said, "wrong_feed", {"found_mm_min": feed, "meant_mm_min": feed_mm_min})
    return None
