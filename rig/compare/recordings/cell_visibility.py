"""Whether a cell of a workbook shows its number: color of the text, and number format."""

import math
import re
import unicodedata
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
    """Return the color of a fill by its only child; white without a fill, None for hatching and gradients.

    openpyxl writes a pattern without a type where there is no fill.
    """
    if pattern is None or (pattern.tag == f"{namespace}patternFill" and pattern.get("patternType", "none") == "none"):
        return WHITE
    return color_of(pattern.find(f"{namespace}fgColor")) if pattern.get("patternType") == "solid" else None


def are_alike(one: Color, other: Color) -> bool:
    """Return whether a reader does not see one color on the other."""
    return one is not None and other is not None and max(abs(a - b) for a, b in zip(one, other, strict=True)) < _ALIKE


class ConditionalFormat(NamedTuple):
    """How a cell looks where a condition holds."""

    ink: ElementTree.Element | None
    """Color of its text; None for the cell's own."""
    fill: ElementTree.Element | None
    """Its background; None for the cell's own."""
    hides: bool
    """Whether the cell's number is hidden, struck out or shown as another one."""

    @classmethod
    def of(cls, style: ElementTree.Element, namespace: str) -> "ConditionalFormat":
        """Return the format of a differential style (`dxf`)."""
        strike, code = style.find(f"{namespace}font/{namespace}strike"), style.find(f"{namespace}numFmt")
        shown = code is None or _shows_all(int(code.get("numFmtId", 0)), code.get("formatCode", ""))
        return cls(
            style.find(f"{namespace}font/{namespace}color"),
            style.find(f"{namespace}fill/{namespace}patternFill/{namespace}bgColor"),
            not shown or is_on(strike),
        )

    def may_mislead(self, ink: Color, background: Color) -> bool:
        """Return whether a cell of these colors does not show its number where the condition holds."""
        text = ink if self.ink is None else color_of(self.ink)
        return self.hides or are_alike(text, background if self.fill is None else color_of(self.fill))


def is_on(flag: ElementTree.Element | None) -> bool:
    """Return whether a property such as `strike` is there and not switched off."""
    return flag is not None and flag.get("val", "1") not in ("0", "false")


_DATE_FORMATS = {*range(14, 23), *range(27, 37), *range(45, 48), *range(50, 59)}
_PERCENT_FORMATS = (9, 10)
_CURRENCY_FORMATS = (5, 6, 7, 8, 42, 44)
_PADDING = re.compile(r"[_*].|[Ee][+-]")
"""Spaces as wide as a character, repeated characters, and the exponent."""
_NOT_CODE = re.compile(r'"[^"]*"|\\.|\[[^\]]*\]')
"""Texts, characters, colors and conditions."""
_QUOTED = re.compile(r'"([^"]*)"|\\(.)|\[\$([^\]-]*)')
_COLORED = re.compile(r"\[(?![$<>=])[^\]]+\]")
_BRACKETED = re.compile(r"\[[^\]]*\]")
_CONDITION = re.compile(r"\[[<>=][^\]]*\]")
_DATE_CODE = re.compile(r"[ymdhs]", re.IGNORECASE)
_SCALED = re.compile(r"[0#],+(?![0#,])")
_DIGIT = re.compile(r"[0#?]|General", re.IGNORECASE)
_MINUS = re.compile(r"[-−(]")
_ENDS_WITH_MINUS = re.compile(r"[0#?]\s*[-−]")


def shown_as(number: int, code: str) -> str:
    """Return what a number format shows instead of the number, in words; "" for the number itself."""
    plain = _NOT_CODE.sub("", _PADDING.sub("", code.replace("General", "")))
    if number in _DATE_FORMATS or _DATE_CODE.search(plain):
        return "a date or time in Excel"
    if number in _PERCENT_FORMATS or "%" in plain:
        return "a percentage in Excel"
    if number in _CURRENCY_FORMATS:
        return "shown as a currency in Excel"
    if _CONDITION.search(code):
        return "shown by conditions in Excel"
    words = "".join(map("".join, _QUOTED.findall(code))).strip() + "".join(filter(_is_currency, plain))
    if any(sign.isalnum() or _is_currency(sign) or sign in "%‰" for sign in words):
        return f"shown as {words} in Excel"
    return "in thousands in Excel" if _SCALED.search(plain) else ""


def _is_currency(sign: str) -> bool:
    return unicodedata.category(sign) == "Sc"


class NumberFormatParts(NamedTuple):
    """Parts of a number format, for positive numbers, negative ones, zero and texts."""

    positive: str
    negative: str
    zero: str
    text: str
    signed: bool
    """Whether negative numbers have the part of the others, and a minus before it."""

    @classmethod
    def of(cls, code: str) -> "NumberFormatParts":
        """Return the parts of a code; without one of their own, numbers have the first, and texts are shown."""
        parts = [part.strip() for part in _PADDING.sub("", code).split(";")]
        positive, negative, zero = (parts[k] if k < len(parts) else parts[0] for k in range(3))
        return cls(positive, negative, zero, parts[3] if len(parts) > 3 else "@", len(parts) == 1)

    def hides(self, number: float | None) -> bool:
        """Return whether a number has no digits, or a text (None) is not shown."""
        if number is None or math.isnan(number):
            return "@" not in self.text
        code = _NOT_CODE.sub("", self.zero if number == 0 else self.positive if number > 0 else self.negative)
        return _DIGIT.search(code) is None and "@" not in code and _DATE_CODE.search(code) is None

    def sign_problem(self, number: float) -> str:
        """Return how the sign of a number is shown if it is not as it is, in words."""
        if number > 0 or (number < 0 and self.signed):
            visible = _BRACKETED.sub("", self.positive)
            before = visible[: found.start()] if (found := _DIGIT.search(visible)) else ""
            other = _MINUS.search(before) or _ENDS_WITH_MINUS.search(visible)
            return "shown with another sign in Excel" if other else ""
        seen = number == 0 or _MINUS.search(_BRACKETED.sub("", self.negative)) or _COLORED.search(self.negative)
        return "" if seen else "shown without its sign in Excel"


def _shows_all(number: int, code: str) -> bool:
    """Return whether a number format shows every number as it is."""
    parts = NumberFormatParts.of(code)
    return not shown_as(number, code) and not any(parts.hides(x) or parts.sign_problem(x) for x in (-1.0, 0.0, 1.0))


class CellStyle(NamedTuple):
    """How a cell looks: what is shown instead of its number, in words; color and background; and number format."""

    instead: str = ""
    struck: bool = False
    ink: Color = BLACK
    background: Color = WHITE
    parts: NumberFormatParts | None = None
    """Parts of its number format, if the workbook defines that itself."""

    def hides(self, number: float | None) -> bool:
        """Return whether a cell with content, a number or a text (None), shows none."""
        return are_alike(self.ink, self.background) or (self.parts is not None and self.parts.hides(number))

    def shown(self, number: float) -> str:
        """Return what is shown instead of a number, in words; "" for the number itself."""
        return self.instead or (self.parts.sign_problem(number) if self.parts is not None else "")
