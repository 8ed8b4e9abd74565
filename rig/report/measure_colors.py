"""The color of each measure, the same on every page and in every figure."""

from rig.report.style import BLUE, GREEN, GREY, ORANGE, PURPLE
from sim.measures.measures import MEASURES

_FIRST = {"ep1": BLUE, "sed": ORANGE, "ep3": GREEN, "e13": PURPLE}
_OTHERS = (
    "#7B3FA0", "#8C6D1F", "#2E8C8C", "#B5304F", "#4A7C99", "#B07D00", "#9A5B2E", "#5B6ABF", "#A13D8E", "#3D8B37",
    "#C0504D", "#6B8E23", "#7A5C8E", "#1A7FC4",
)  # fmt: skip
_COLORS = _FIRST | dict(zip((name for name in MEASURES if name not in _FIRST), _OTHERS, strict=False))


def color_of(name: str) -> str:
    """Return the color of a measure or of its rate of change; gray for a control."""
    return _COLORS.get(name.removeprefix("mean rate of ").removeprefix("peak rate of "), GREY)
