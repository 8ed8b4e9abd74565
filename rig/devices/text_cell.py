"""Force sensor: a load cell whose board sends each reading as a line of text, by itself or on request.

Sources: examples of the Arduino libraries HX711_ADC and bogde/HX711, SparkFun's OpenScale 1.2, DFRobot's HX711 board.
A board sends what its program prints, so the format of a line is configured.
"""

import re
from functools import cached_property
from typing import ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from rig.clock import Clock
from rig.devices.base import (
    ForceBroken,
    ForceBusy,
    ForceError,
    ForceOverload,
    ForceReading,
    ForceSensor,
    ForceTimeout,
    ForceUnderload,
    no_line,
)
from rig.devices.registry import Evidence, ForceKind, Opener
from rig.errors import RuleError
from rig.settings import BenchSettings, ForceSettings, Settings
from rig.transport import LineReader, Transport
from rig.units import GWT_N

SETTLE_S = 10.0
"""Longest time until a load is steady, and until a board has zeroed itself (s)."""
_STEADY_READINGS = 3
_LONGEST = 500
"""Most characters of a line with a reading."""
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)", re.ASCII)
_NO_NUMBER = re.compile(r"[+-]?(nan|inf|infinity|ovf)", re.IGNORECASE)
_APART = r"\s,;:|"
_FIELDS = {"value": rf"(?P<value>[^{_APART}]+?)", "skip": ".*?"}
_SIDE_BY_SIDE = {
    "value skip": rf"(?P<value>[^{_APART}]++).*?",
    "skip value": rf"(?:|.*?[{_APART}])(?P<value>[^{_APART}]+?)",
    "skip value skip": rf"(?:|.*?[{_APART}])(?P<value>[^{_APART}]++).*?",
}
"""Fields without text between them: a value is a whole word."""
_FIELD = re.compile(r"\{(\w*)\}")
_DASH = r"[-\u2010-\u2015\u2212\ufe63\uff0d]|(?<!\w)\ufffd+"
_LONE_MINUS = re.compile(rf"({_DASH})(?![\w.>\ufffd])|(?<!\w)-(?!\d|\.\d|>)|\b(minus|neg|negative)\b", re.IGNORECASE)
"""A minus that belongs to no number behind it, also at the beginning of a word: `-N 12.5`. `->` is an arrow; a
character that is not ASCII arrives as U+FFFD."""
_WORD = re.compile(r"(?:[^\W\d_]|\ufffd)+")
_BEHIND = re.compile(r"[^\s\d,;:|=<>(){}\[\]\"']+")
_NO_WORD = ".!?*+-_/\\#\u00b7"
_IN_BRACKETS = re.compile(r"([(\[][^()\[\]\d]*[)\]])\W*\Z")
_OPEN_IN_FRONT = re.compile(r"\{skip\}\s*\{value\}")
_NEAREST = re.compile(r"([^\s,;:|=<>(){}\[\]\"']+)[\s,;|]*\Z")
_PART_OF_NUMBER = re.compile(r"[\d.]\{value\}|\{value\}(\d|[.eE]\{)")
_UNIT_WORDS = {
    "g": "g gr gram grams gramm gf gwt gram-force grams-force",
    "kg": "kg kgs kgf kp kilo kilos kilogram kilograms kilogramm kg-f kilogram-force",
    "lb": "lb lbs lbf lb-f pound pounds pound-force",
    "N": "n newton newtons",
    "mN": "mn millinewton millinewtons",
    "": "mg milligram milligrams oz ozs ozf ozt ounce ounces kn kilonewton kilonewtons \ufffdn un dyn dyne dynes "
    "dan decanewton decanewtons cn centinewton centinewtons MN Mn dag hg cg ct carat carats grain grains "
    "ton tons tonne tonnes mv pa kpa psi",
}
"""Words of each unit, in any case unless it is MN; those of "" are units that cannot be set."""
_MINUS = "has a minus apart from its number; have the board print it directly before the number"
_COMMA = "has a comma within a number; have the board print a decimal point and no separators of thousands"
_BLANK = (
    "has digits before and after a blank, which may separate thousands; have the board print no separators, or put "
    "the blank that ends the number into force.text_cell.line"
)
_UNIT_OF = {word: unit for unit, words in _UNIT_WORDS.items() for word in words.split()}


def _unit_of(word: str) -> str | None:
    return _UNIT_OF.get(word, _UNIT_OF.get(re.sub("\ufffd+", "\ufffd", word.casefold())))


def _other_unit(before: str, after: str, unit: str) -> str | None:
    """Return the known unit beside a number, up to the next digit, if it is another one."""
    words = _WORD.findall(re.split(r"\d", after)[0]), _WORD.findall(re.split(r"\d", before)[-1])[::-1]
    known = next((word for side in words for word in side if _unit_of(word) is not None), None)
    return None if known is None or _unit_of(known) == unit else known


def _words_behind(after: str) -> list[str]:
    """Return the words behind a number, with what is attached to them, such as N/mm or %."""
    words = (word.strip(_NO_WORD) for word in _BEHIND.findall(after))
    return [word for word in words if _WORD.search(word) or "%" in word or "‰" in word]


def _not_the_unit(before: str, after: str, unit: str, line: str) -> str | None:
    """Return a word beside a number that may be another unit.

    Behind the number it is the first word that is neither the unit nor in the format. Labels stand in front of a
    number, so there it is the nearest known unit, a word in brackets that is not in the format, or, if the format
    leaves open what stands there, a word without a sign of a label, such as a colon, behind it.
    """
    in_front, _, behind = _FIELD.sub(_placeholder, line).partition(_HERE)
    for word in _words_behind(re.split(r"\d", after)[0]):
        if _unit_of(word) == unit:
            return None
        if word not in _words_behind(behind):
            return word
    brackets = _IN_BRACKETS.search(before)
    if brackets and brackets[1] not in in_front and (word := brackets[1][1:-1].strip()) and _unit_of(word) != unit:
        return word
    if (other := _other_unit(before, "", unit)) or not _OPEN_IN_FRONT.search(line):
        return other
    nearest = _NEAREST.search(before)
    bare = nearest[1].strip(_NO_WORD) if nearest else ""
    return bare if _WORD.search(bare) and not re.search(r"\d", bare) and _unit_of(bare) != unit else None


_HERE = "\0"


def _placeholder(field: re.Match[str]) -> str:
    return _HERE if field[1] == "value" else "0"


class TextCellSettings(Settings):
    """Settings of a load cell that sends lines of text."""

    NEWTONS: ClassVar[dict[str, float]] = {
        "g": GWT_N, "kg": 1e3 * GWT_N, "lb": 453.59237 * GWT_N, "N": 1.0, "mN": 1e-3,
    }  # fmt: skip

    line: str = Field(
        "{value}",
        min_length=7,
        max_length=200,
        description="a line with a reading: {value} stands for the number, {skip} for any text, all else for itself",
    )
    unit: Literal["g", "kg", "lb", "N", "mN"] = Field("g", validate_default=True, description="unit of the number")
    ignore: tuple[str, ...] = Field((), description="beginnings of lines without a reading, such as a banner")
    poll: str = Field(
        "", max_length=40, description="text that requests a reading; absent: the board sends lines by itself"
    )
    zero: str = Field(
        "", max_length=40, description="text that zeroes the board; absent: the program subtracts the load itself"
    )
    zero_done: str = Field(
        "", max_length=100, description="beginning of the line by which the board confirms its zero"
    )
    full_scale_gwt: float = Field(
        500.0, gt=0, le=1e5, description="a reading of this size or more is an overload, in gwt"
    )
    steady_gwt: float = Field(
        0.2, gt=0, le=100, description="the load is steady if three readings lie within this range, in gwt"
    )
    silence_s: float = Field(
        0.5, ge=0.05, le=10, description="longest wait for a reading beyond two sample periods, in s; then it trips"
    )
    start_s: float = Field(
        3.0, ge=0.05, le=60, description="longest time from the opening of the port to the first reading, in s"
    )

    @field_validator("line")
    @classmethod
    def _has_one_value(cls, line: str) -> str:
        names = _FIELD.findall(line)
        if names.count("value") != 1 or not set(names) <= set(_FIELDS) or not line.isprintable():
            raise RuleError("needs {value} once, and no other field than {skip}", "bad_line_format")
        if _PART_OF_NUMBER.search(line):
            raise RuleError("digits and the point belong to {value}; leave them out", "part_of_number")
        if _LONE_MINUS.search(line):
            raise RuleError("the minus belongs to {value}; leave it out", "sign_beside_value")
        return line

    @field_validator("unit")
    @classmethod
    def _agrees_with_line(cls, unit: str, info: ValidationInfo) -> str:
        before, _, after = _FIELD.sub(_placeholder, info.data.get("line", "")).partition(_HERE)
        if word := _other_unit(before, after, unit):
            raise RuleError(f"is {unit}, but line has {word!r}; make them agree", "unit_beside_line")
        return unit

    @field_validator("ignore")
    @classmethod
    def _none_is_empty(cls, ignore: tuple[str, ...]) -> tuple[str, ...]:
        if not all(ignore):
            raise RuleError("an empty beginning would ignore every line", "empty_beginning")
        return ignore

    @cached_property
    def pattern(self) -> re.Pattern[str]:
        """Pattern of a whole line with a reading; white space matches any white space.

        {skip} ends at the first occurrence of the text that follows it. The pattern never backtracks, so that no line
        takes long.
        """
        parts = _FIELD.split(self.line)
        texts = [r"\s+".join(re.escape(word) for word in re.split(r"\s+", text)) for text in parts[0::2]]
        found, fields = texts[0], list[str]()
        for name, text in zip(parts[1::2], [*texts[1:-1], texts[-1] + r"\Z"], strict=True):
            fields += [name] if fields[-1:] != [name] else []
            if text:
                side_by_side = " ".join(fields)
                found += f"(?>{_SIDE_BY_SIDE.get(side_by_side) or _FIELDS[side_by_side]}{text})"
                fields.clear()
        return re.compile(found)


class TextCellForce:
    """ForceSensor with a load cell that sends lines of text.

    A reading is the reply to a request, or the next line of a stream. scale is true force divided by its reading.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        settings: TextCellSettings,
        *,
        sample_period_s: float,
        resolution_gwt: float,
        scale: float,
    ) -> None:
        self.sample_period_s, self.resolution_gwt = sample_period_s, scale * resolution_gwt
        self._transport, self._clock, self._settings, self._scale = transport, clock, settings, scale
        self._reader = LineReader(transport, clock)
        self._silence_s = settings.silence_s + 2 * sample_period_s
        self._in_step, self._heard_s, self._offset_gwt = False, 0.0, 0.0

    def connect(self) -> str:
        """Wait for a reading, past the banner that boards send after a reset. Raises ForceError."""
        return self.identify()

    def identify(self) -> str:
        """Wait for a reading and return the configuration, since such a board has no identity. Raises ForceError."""
        settings = self._settings
        deadline_s = self._clock.monotonic_s() + settings.start_s
        last, heard = "", None
        while (left_s := deadline_s - self._clock.monotonic_s()) > 0:
            try:
                last = self._line(min(self._silence_s, left_s))
            except ForceTimeout as error:
                heard = error if error.code == "no_line_end" else heard
            value = self._value(last)
            if value is not None and (_NUMBER.fullmatch(value) or _NO_NUMBER.fullmatch(value)):
                return f"text cell, {settings.line} in {settings.unit}"
        if last:
            raise self._garbled(last)
        raise heard or ForceTimeout(
            f"{self._transport.name}: no line within {settings.start_s:g} s; check the power, the cable, "
            "force.baud and force.text_cell.poll",
            "no_device",
        )

    def read(self) -> ForceReading:
        """Return the next value, never marked as stable. Raises ForceError."""
        return ForceReading((self._shown_gwt() - self._offset_gwt) * GWT_N, False, self._clock.monotonic_s())

    def zero(self) -> None:
        """Zero the board, or subtract the present load until the program ends, and verify. Raises ForceError."""
        if self._settings.zero:
            self._zero_board()
        else:
            self._offset_gwt = self._steady_gwt()
        deadline_s = self._clock.monotonic_s() + SETTLE_S
        while abs(left_gwt := self._shown_gwt() - self._offset_gwt) > self._settings.steady_gwt:
            if self._clock.monotonic_s() < deadline_s:
                self._clock.wait_s(self.sample_period_s)
                continue
            raise ForceBusy(
                f"{self._transport.name}: the load is {left_gwt:.3g} gwt after zeroing; let it settle and zero again",
                "not_zeroed",
            )

    @property
    def subtracted_n(self) -> float:
        """Load that the driver subtracts; 0 if the board zeroes itself."""
        return self._offset_gwt * GWT_N

    def close(self) -> None:
        self._transport.close()

    # --- zero ---

    def _zero_board(self) -> None:
        self._offset_gwt, self._in_step = 0.0, False
        self._drop_arrived()
        self._transport.write(self._settings.zero.encode("utf-8"))
        deadline_s = self._clock.monotonic_s() + SETTLE_S
        while (line := self._reader.read_line(deadline_s)) is not None:
            if line.startswith(self._settings.zero_done):
                return
        raise self._timeout(SETTLE_S)

    def _steady_gwt(self) -> float:
        """Return the mean of three readings that lie close together."""
        deadline_s, last = self._clock.monotonic_s() + SETTLE_S, [self._shown_gwt()]
        while len(last) < _STEADY_READINGS or max(last) - min(last) > self._settings.steady_gwt:
            if self._clock.monotonic_s() >= deadline_s:
                raise ForceBusy(
                    f"{self._transport.name}: no steady load within {SETTLE_S:g} s; let it settle and zero again",
                    "no_stable_load",
                )
            self._clock.wait_s(self.sample_period_s)
            last = [*last, self._shown_gwt()][-_STEADY_READINGS:]
        return sum(last) / len(last)

    # --- lines ---

    def _shown_gwt(self) -> float:
        """Return the value that the board sends, corrected by the calibration (gwt)."""
        settings, port = self._settings, self._transport.name
        line = self._line(self._silence_s)
        value = self._value(line)
        if value is not None and _NO_NUMBER.fullmatch(value):
            raise ForceBroken(
                f"{port}: the board sends {value} instead of a number; check the cell and its cable", "no_number"
            )
        if value is None or not _NUMBER.fullmatch(value):
            raise self._garbled(line)
        shown_gwt = float(value) * settings.NEWTONS[settings.unit] / GWT_N
        if abs(shown_gwt) >= settings.full_scale_gwt:
            kind, code = (ForceOverload, "overload") if shown_gwt > 0 else (ForceUnderload, "underload")
            raise kind(
                f"{port}: {shown_gwt:.4g} gwt is not within force.text_cell.full_scale_gwt; remove the load", code
            )
        return shown_gwt * self._scale

    def _value(self, line: str) -> str | None:
        """Return the text of the value in a line with a reading; None for another line."""
        found = self._match(line)
        return None if found is None or self._doubt(found) else found["value"]

    def _match(self, line: str) -> re.Match[str] | None:
        return self._settings.pattern.fullmatch(line) if len(line) <= _LONGEST else None

    def _doubt(self, found: re.Match[str]) -> str | None:
        """Return why the sign, the scale or the unit of a number may not be what it seems."""
        line, value, unit = found.string, found["value"], self._settings.unit
        before, after = line[: found.start("value")], line[found.end("value") :]
        signed = value.startswith(("-", "+"))
        if value in ("-", "+-") or (not signed and (_LONE_MINUS.search(before) or _LONE_MINUS.search(after))):
            return _MINUS
        template = self._settings.line
        in_front = re.search(r"\d,\Z", before) and ",{value}" not in template
        if in_front or (re.match(r",\d", after) and "{value}," not in template):
            return _COMMA
        split = re.match(r"[\s'’]\d", after) and not re.search(r"\{value\}\s", template)
        if split or (re.search(r"\d[\s'’]\Z", before) and not re.search(r"\s\{value\}", template)):
            return _BLANK
        if word := _not_the_unit(before, after, unit, template):
            return (
                f"has {word!r} beside its number, but force.text_cell.unit is {unit}; set the unit that the board "
                "sends, or put a word that is no unit into force.text_cell.line"
            )
        return None

    def _line(self, within_s: float) -> str:
        """Return a line that is no older than the request, or than the last line of a stream."""
        in_step, self._in_step = self._in_step, False
        polled = bool(self._settings.poll)
        if polled:
            self._ask(in_step=in_step)
        else:
            self._drop_arrived()
        began_s, begun = self._clock.monotonic_s(), self._reader.unended
        deadline_s = began_s + within_s
        # The first line may lack its beginning: the port was opened within it, or the system's buffer was full.
        if not polled and (not in_step or began_s - self._heard_s > self._silence_s):
            self._reader.read_line(deadline_s)
        while (line := self._reader.read_line(deadline_s)) is not None:
            if not line.startswith(self._settings.ignore):
                self._in_step, self._heard_s = True, self._clock.monotonic_s()
                return line
        raise self._timeout(within_s, begun)

    def _ask(self, *, in_step: bool) -> None:
        """Request a reading when no earlier reply can be on its way."""
        until_s = self._clock.monotonic_s() + SETTLE_S
        while not in_step and self._transport.read(self._silence_s):
            if self._clock.monotonic_s() >= until_s:
                raise ForceError(
                    f"{self._transport.name}: the board sends lines without a request; remove force.text_cell.poll",
                    "not_polled",
                )
        self._reader.discard()
        self._transport.write(self._settings.poll.encode("utf-8"))

    def _drop_arrived(self) -> None:
        """Drop whole lines that have arrived; a line that has begun is completed by the next bytes."""
        for _ in self._reader.pending():
            pass

    def _timeout(self, timeout_s: float, begun: bytes = b"") -> ForceTimeout:
        """Return the error of a wait for a line, whose beginning may have arrived before."""
        silence = f"no line within {timeout_s:g} s; check the power and the cable"
        heard = b"" if self._reader.unended == begun else self._reader.unended
        return no_line(self._transport.name, heard, silence, "no_reply")

    def _garbled(self, line: str) -> ForceError:
        found = self._match(line)
        reason = None if found is None else self._doubt(found)
        if found is None and re.search(r"\d,\d", line):
            reason = _COMMA
        elif found is None and _LONE_MINUS.search(line) and re.search(r"\d", line):
            reason = _MINUS
        if reason is None:
            reason = (
                f"does not match force.text_cell.line = {self._settings.line!r} with a number such as -12.5; correct "
                "it, or add the beginning of the line to force.text_cell.ignore"
            )
        return ForceError(f"{self._transport.name}: {line!r} {reason}", "garbled")


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> ForceSensor:
    force = settings.force
    return TextCellForce(
        opener(force.port),
        clock,
        force.own(TextCellSettings),
        sample_period_s=force.sample_period_s,
        resolution_gwt=force.resolution_gwt,
        scale=settings.calibration.value("force_scale", 1.0),
    )


def _max_age_s(force: ForceSettings) -> float:
    """Return the longest wait for a line, or after an error for silence and a reply."""
    settings = force.own(TextCellSettings)
    wait_s = settings.silence_s + 2 * force.sample_period_s
    return 2 * wait_s if settings.poll else wait_s


DEVICE = ForceKind(
    name="text_cell",
    device="load cell with an HX711 or other board that sends lines of text",
    driver=_driver,
    settings=TextCellSettings,
    twin="sim.devices.text_cell:text_twin",
    max_age_s=_max_age_s,
    tests=("tests/rig/test_text_cell_driver.py",),
    evidence=Evidence(
        manual="examples of HX711_ADC and bogde/HX711, SparkFun OpenScale 1.2, DFRobot HX711, serial-scale",
    ),
)
