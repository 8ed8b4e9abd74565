"""Load cells that send lines of text: HX711_ADC's example, SparkFun's OpenScale, and serial-scale, when polled."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from rig.devices.base import ForceBroken, ForceBusy, ForceError, ForceOverload, ForceTimeout, ForceUnderload
from tests.contracts.force import SILENCE, UNASKED, ForceBytes, NoWeight, Weight, Zeroing, without_line_end

LB_G = 453.59237
TOO_MUCH = "10000.01"


def _shown(line: str, *grams: str) -> list[bytes]:
    return [f"{line.replace('{value}', value).replace('{skip}', '23.50')}\r\n".encode() for value in grams]


def _line(line: str, value: str) -> bytes:
    return _shown(line, value)[0]


def _weights(line: str, gram: float) -> Mapping[str, Weight]:
    values = {
        "usual": "12.34",
        "negative": "-0.50",
        "nothing": "0.00",
        "whole": "7",
        "a sign": "+1.5",
        "no zero": ".25",
    }
    return {name: Weight(_line(line, value), float(value) * gram, False) for name, value in values.items()}


def _rounded(reply: bytes, line: str) -> bytes:
    """A line with its weight to a hundredth, and 0 for what is not read."""
    form = re.escape(line).replace(r"\{skip\}", ".*").replace(r"\{value\}", "(nan|[-+.0-9]+)")
    found = re.fullmatch(form, reply.decode("ascii", "replace").strip())
    return _line(line, f"{float(found[1]):.2f}") if found else reply


def _refusals(line: str) -> Mapping[str, NoWeight]:
    return {
        "overload": NoWeight(_line(line, TOO_MUCH), ForceOverload, "overload"),
        "underload": NoWeight(_line(line, f"-{TOO_MUCH}"), ForceUnderload, "underload"),
        "nan": NoWeight(_line(line, "nan"), ForceBroken, "no_number"),
        "infinity": NoWeight(_line(line, "-inf"), ForceBroken, "no_number"),
        "Arduino's overflow": NoWeight(_line(line, "ovf"), ForceBroken, "no_number"),
    }


def _garbled(line: str) -> Mapping[str, NoWeight]:
    return {
        "no number": NoWeight(_line(line, "x")),
        "an exponent": NoWeight(_line(line, "1e2")),
        "hexadecimal": NoWeight(_line(line, "0x10")),
        "two points": NoWeight(_line(line, "1.2.3")),
        "two signs": NoWeight(_line(line, "+-1")),
        "a point alone": NoWeight(_line(line, ".")),
        "digits of another script": NoWeight(_line(line, "١٢")),
        "another line": NoWeight(b"Please check the wiring\r\n"),
        "more behind it": NoWeight(_line(line, "1.00").rstrip() + b" oz\r\n"),
        **without_line_end(_line(line, "1.00").rstrip()),
    }


_NOT_STEADY = [f"{2 + n % 7 / 8}" for n in range(600)]  # three of them by 0.25 at least, and 0.75 at most


def _zeroing_by_the_program(line: str) -> Mapping[str, Zeroing]:
    def rows(*grams: str) -> Mapping[bytes, Sequence[bytes]]:
        return {UNASKED: _shown(line, *grams)}

    return {
        "at rest": Zeroing(rows("3", "4", "5.00"), told=0),
        "never at rest": Zeroing(rows(*_NOT_STEADY), ForceBusy, "no_stable_load", told=0),
        "overloaded": Zeroing(rows(TOO_MUCH), ForceOverload, "overload", told=0),
        "underloaded": Zeroing(rows(f"-{TOO_MUCH}"), ForceUnderload, "underload", told=0),
        "silent": Zeroing({UNASKED: [SILENCE]}, ForceTimeout, "no_reply", told=0),
        "not confirmed": Zeroing({UNASKED: [b"menu\r\n"]}, ForceError, "garbled", told=0),
    }


def _device(name: str, table: Mapping[str, Any], source: str, **rest: Any) -> ForceBytes:
    line, unit = table["line"], table.get("unit", "g")
    gram = LB_G if unit == "lb" else 1.0
    poll = table.get("poll", "").encode() or UNASKED
    rest = {"zeroing": _zeroing_by_the_program(line), "zero": b"no command", "usual": {}} | rest
    return ForceBytes(
        name=name,
        kind="text_cell",
        table={"sample_period_s": 0.03, "text_cell": {"full_scale_gwt": 10_000.0, "start_s": 1.0, **table}},
        source=source,
        identity=f"text cell, {line} in {unit}",
        on_connect=[poll] if poll else [],
        on_identify=[poll] if poll else [],
        max_age_s=1.12 if poll else 0.56,
        reading=poll,
        weights=_weights(line, gram),
        refusals=_refusals(line),
        garbled=_garbled(line),
        alike=lambda reply: _rounded(reply, line),
        not_on_twin=dict.fromkeys(("overload", "underload"), "a board knows no limit of its cell; the driver has it"),
        lacks={
            "busy": "a board that is busy sends nothing",
            "cell error": "a board without its cell sends a number, or nan",
            "stable": "a line has no such word",
        },
        stream_s=0.03 if not poll else float("inf"),
        **rest | {"usual": {poll: _line(line, "12.34"), **rest["usual"]}},
    )


VAL = "Load_cell output val: {value}"
HX711_ADC = _device(
    "text_hx711",
    {"line": VAL, "zero": "t", "zero_done": "Tare complete", "ignore": ["Starting", "Startup is complete"]},
    "example Read_1x_load_cell of the Arduino library HX711_ADC",
    usual={b"t": b"Tare complete\r\n"},
    zero=b"t",
    zeroing={
        "at rest": Zeroing({UNASKED: _shown(VAL, "0.05")}),
        "it takes a while": Zeroing({UNASKED: _shown(VAL, *["7.00"] * 40, "0.00")}),
        "never at rest": Zeroing({UNASKED: _shown(VAL, "7.00")}, ForceBusy, "not_zeroed"),
        "a little is left": Zeroing({UNASKED: _shown(VAL, "0.25")}, ForceBusy, "not_zeroed"),
        "a little pull is left": Zeroing({UNASKED: _shown(VAL, "-0.25")}, ForceBusy, "not_zeroed"),
        "overloaded": Zeroing({UNASKED: _shown(VAL, TOO_MUCH)}, ForceOverload, "overload"),
        "silent": Zeroing({UNASKED: [SILENCE]}, ForceTimeout, "no_reply"),
        "not confirmed": Zeroing({b"t": [SILENCE]}, ForceTimeout, "no_reply"),
    },
)
OPENSCALE = _device(
    "text_openscale",
    {"line": "{skip},{value},lbs,{skip},{skip},", "unit": "lb"},
    "SparkFun OpenScale 1.2, its firmware: time, weight, unit, two temperatures, a comma at the end",
)
POLLED = _device(
    "text_polled",
    {"line": "{value}", "poll": "<w>"},
    "program serial-scale: <w> asks for a weight",
    zeroing={
        name: Zeroing({b"<w>": list(row.replies[UNASKED])}, row.kind, row.code, told=0)
        for name, row in _zeroing_by_the_program("{value}").items()
    },
)
