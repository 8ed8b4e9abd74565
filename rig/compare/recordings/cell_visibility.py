"""Cells of a workbook that show nothing to a reader, by the color of their text or by their number format."""

import math
import re
from typing import NamedTuple
from xml.etree import ElementTree

Color = tuple[int, int, int] | None
"""Red, green and blue, 0 to 255; None if unknown."""

BLACK, WHITE = (0, 0, 0), (255, 255, 255)
_INDEXED = (BLACK, WHITE, (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0), (255, 0, 255), (0, 255, 255))
"""Colors 0 to 7, and again 8 to 15."""
_OF_THE_SYSTEM = {64: BLACK, 65: WHITE}
_ALIKE = 16
"""A smaller difference of each of the three is not seen."""


def color_of(element: ElementTree.Element | None) -> Color:
    """Return a color of a font or a fill; black if it is automatic. Of the themes only white and black are known."""
    if element is None or element.get("auto") in ("1", "true"):
        return BLACK
    if (rgb := element.get("rgb")) is not None:
        red, green, blue = bytes.fromhex(rgb[-6:])
        return red, green, blue
    if (indexed := int(element.get("indexed", -1))) >= 0:
        return _OF_THE_SYSTEM.get(indexed) or (_INDEXED[indexed % 8] if indexed < 2 * len(_INDEXED) else None)
    theme, tint = element.get("theme"), float(element.get("tint", 0.0))
    if theme not in ("0", "1"):
        return None
    gray = round(255 * (1 + min(tint, 0.0) if theme == "0" else max(tint, 0.0)))
    return gray, gray, gray


def background_of(pattern: ElementTree.Element | None, namespace: str) -> Color:
    """Return the color of a fill by its only child; white without a fill, None for hatching and gradients."""
    if pattern is None or pattern.get("patternType") == "none":
        return WHITE
    return color_of(pattern.find(f"{namespace}fgColor")) if pattern.get("patternType") == "solid" else None


def are_alike(one: Color, other: Color) -> bool:
    """Return whether a reader does not see one color on the other."""
    return one is not None and other is not None and max(abs(a - b) for a, b in zip(one, other, strict=True)) < _ALIKE


NOT_CODE = re.compile(r'"[^"]*"|\\.|\[[^\]]*\]')
"""Texts, characters and conditions in a number format."""


class EmptyParts(NamedTuple):
    """Which of positive numbers, negative ones, zero and texts a number format shows as nothing."""

    positive: bool
    negative: bool
    zero: bool
    text: bool

    def hide(self, number: float | None) -> bool:
        """Return whether a number, or a text (None), is shown as nothing."""
        if number is None or math.isnan(number):
            return self.text
        return self.zero if number == 0 else self.positive if number > 0 else self.negative


def empty_parts(code: str) -> EmptyParts | None:
    """Return what a number format shows as nothing, None if it shows everything.

    Its parts are for positive numbers, negative ones, zero and texts; without a part of their own, numbers have the
    first one, and texts are shown.
    """
    parts = NOT_CODE.sub("x", code.replace('""', "")).split(";")
    empty = [not part.strip() for part in parts]
    if len(parts) == 1 or not any(empty):
        return None
    positive, negative, zero = (empty[k] if k < len(empty) else empty[0] for k in range(3))
    return EmptyParts(positive, negative, zero, text=len(empty) > 3 and empty[3])
