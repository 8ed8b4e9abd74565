"""A load cell that sends lines of text: their format, lines that are old or incomplete, and its twin, in bytes."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest
from pydantic import ValidationError

from rig.devices.base import ForceBusy, ForceError, ForceTimeout
from rig.devices.text_cell import TextCellForce, TextCellSettings
from rig.errors import first_problem
from rig.plan.config import Config
from rig.units import GWT_N
from sim.devices.clock import VirtualClock
from sim.devices.line import Load, SerialLine, VirtualForceSpec
from sim.devices.text_cell import text_twin
from tests.error_codes import has_code, raises
from tests.timed_wire import TimedWire

PERIOD_S = 0.1
INSTRUMENT = {"sample_period_s": PERIOD_S, "resolution_gwt": 0.01, "scale": 1.0}


class Board(TimedWire):
    """A wire whose bytes come at given times, and a driver."""

    def __init__(self, *coming: tuple[float, bytes], **table: Any) -> None:
        super().__init__(VirtualClock())
        self.coming, self.sent = list(coming), b""
        self.driver = TextCellForce(self, self.clock, TextCellSettings(**table), **INSTRUMENT)

    def write(self, data: bytes) -> None:
        self.sent += data

    def gwt(self) -> float:
        return self.driver.read().force_n / GWT_N


# --- the format of a line ---


@pytest.mark.parametrize(
    ("line", "unit", "sent", "gwt"),
    [
        ("{skip},{value},lbs,{skip},{skip},", "lb", b"1234,0.52,lbs,23.50,0,", 0.52 * 453.59237),  # OpenScale 1.2
        ("Load_cell output val: {value}", "g", b"Load_cell output val: 12.34", 12.34),  # HX711_ADC
        ("one reading:{skip}| average: {value}", "g", b"one reading:\t12.3\t| average:\t12.4", 12.4),  # bogde/HX711
        ("{value} g", "g", b"12.3 g", 12.3),  # DFRobot
        ("{value}", "kg", b"-0.01234", -12.34),
        ("{value} N", "N", b"0.0980665 N", 10.0),
        ("{value}mN", "mN", b"98.0665mN", 10.0),
    ],
)
def test_lines_that_boards_send(line: str, unit: str, sent: bytes, gwt: float) -> None:
    board = Board((0.05, b"of a line\r\n"), (0.1, sent + b"\r\n"), line=line, unit=unit)
    assert board.gwt() == pytest.approx(gwt, rel=1e-12)


@pytest.mark.parametrize(
    ("line", "sent", "gwt"),
    [
        ("{value}{skip}", b"12.5 g", 12.5),
        ("{value}{skip}", b"12.5g", None),
        ("{skip}{value}", b"load: 12.5", 12.5),
        ("{skip}{value}", b"load12.5", None),
        ("x={skip}{value}", b"x=12.5", 12.5),
        ("{skip}{skip},{value}", b"a b,12.5", 12.5),
        ("{value}{skip}{skip}", b"12.5 g b", 12.5),
        ("{value}{skip}{skip},", b"12.5 g b,", 12.5),
        ("{skip}{value}{skip}{skip}", b"12.5 g b", 12.5),
        ("w{skip}{skip}{value}{skip}{skip}g", b"w 12.5; g", 12.5),
        ("{skip}g {value}", b"1 g 2 g 3", None),  # {skip} ends at the first g
    ],
)
def test_a_value_is_a_whole_word_of_the_line(line: str, sent: bytes, gwt: float | None) -> None:
    board = Board((0.05, b"of a line\r\n"), (0.1, sent + b"\r\n"), line=line)
    if gwt is None:
        with raises(ForceError, "garbled"):
            board.gwt()
    else:
        assert board.gwt() == gwt


SIGN, SCALE, UNIT = "minus apart", "comma within", "set the unit"
_UNKNOWN = (
    *("daN", "cN", "DAN", "dag", "t", "ct", "ozt", "grains", "tonnes", "mV", "kPa", "%", "\ufffdN", "\ufffd\ufffdN"),
    *("MN", "N/mm", "g/cm2", "[daN]", "(t)", ";daN", "|daN"),
)
_BARE = ("quintal ", "Force quintals ", "load: slug ", "kip, ", "kip;", "kip | ", "20 poods ", "N/mm ", "net. ")


@pytest.mark.parametrize(
    ("line", "sent", "gwt"),
    [
        ("{skip}{value} g", "W - 12.5 g", SIGN),  # read as +12.5 once
        ("{skip} {value} g", "W - 12.5 g", SIGN),
        ("{skip}{value} g", "- W 12.5 g", SIGN),
        ("{skip}{value} g", "(-) 12.5 g", SIGN),
        ("{skip}{value} g", "W \u2212 12.5 g", SIGN),
        ("{skip}{value} g", "minus 12.5 g", SIGN),
        ("{value}{skip}", "12.5 - g", SIGN),  # a trailing sign
        *(
            (line, sent, SIGN)
            for line in ("{skip} {value} g", "{skip}{value} g", "{skip}{value}{skip}", "{value} g", "ST,GS,{value} g")
            for sent in (
                "-  29.182 g",
                "ST,GS,-  29.182 g",
                "-\t29.182 g",
                "+-  29.182 g",
            )  # of scales with a sign column
        ),
        *(("{skip}{value} g", f"{sign}29.182 g", SIGN) for sign in ("-N  ", "-kg ", "N- ", "NET- ", "-: ", "-| ")),
        *(("{skip}{value} g", f"{sign}29.182 g", SIGN) for sign in ("-_ ", "-. ", "-,", "[-] ", "neg ", "S,-G,")),
        ("{skip}N {value} g", "-N 29.182 g", SIGN),
        ("{skip}_{value} g", "-_29.182 g", SIGN),
        ("{value} {skip}", "29.182 -g", SIGN),
        ("{value}{skip}", "29.182 g -", SIGN),
        ("{skip}{value} g", "S -> N 12.5 g", 12.5),
        ("{skip}{value} g", "W -12.5 g", -12.5),
        ("{skip}{value} g", "W - -12.5 g", -12.5),
        ("{skip}{value} g", "W -> 12.5 g", 12.5),
        ("{skip}{value} g", "HX-711 load-cell + 12.5 g", 12.5),
        ("{value} {skip}", "12.5 -0.3", 12.5),  # the sign of another number
        ("{value} {skip}", "0.0125 kg", UNIT),
        ("{skip}{value}", "Weight (kg): 0.0125", UNIT),
        ("{skip}{value}", "12.5 oz 0.3", UNIT),
        ("{value} {skip}", "12.5 \u00b5N", UNIT),
        ("{value} {skip}", "12.5 stable g", UNIT),  # any other word may be a unit
        ("{value} stable {skip}", "12.5 stable g", 12.5),
        ("{value} stable {skip}", "12.5 stable daN", UNIT),
        ("{value}{skip} g", "12.5 daN g", UNIT),
        ("{value} {skip}g", "12.5 dag", UNIT),
        ("{value} g{skip}", "12.5 grains", UNIT),
        ("{value}g{skip}", "12.5gr", 12.5),
        ("{value}g{skip}", "12.5g/mm", UNIT),
        ("{value}{skip}", "12.5 G.", 12.5),
        ("{value}{skip}", "12.5 grams (net, stable)", 12.5),
        *(("{value}{skip}", f"12.5 {word}", UNIT) for word in _UNKNOWN),
        *(("{skip}{value}", f"{word}: 12.5", UNIT) for word in ("daN", "CN", "ozt", "mV", "\ufffdN", "MN", "[t]")),
        ("{skip}{value}", "Force (quintals) = 12.5", UNIT),
        *(("{skip}{value}", f"{words}12.5", UNIT) for words in _BARE),
        ("{skip} {value}", "quintal 12.5", UNIT),
        ("Load: {skip}{value}", "Load: net 12.5", UNIT),
        ("Load: net {value}", "Load: net 12.5", 12.5),  # the format spells it out
        ("{skip},{value}", "net,12.5", 12.5),
        ("{skip}{value}", "g 12.5", 12.5),
        ("{skip}{value} g", "quintals 12.5 g", 12.5),  # the unit stands behind the number
        *(("{skip}{value}", f"{label}12.5", 12.5) for label in ("load: ", "F = ", "F -> ", "'net' ", "ch1: ")),
        ("{skip}{value}", "Weight (G): 12.5", 12.5),
        ("Weight (net): {value}", "Weight (net): 12.5", 12.5),
        ("{value}, t={skip}", "12.5, t=20.1 C", 12.5),  # the format spells t out
        ("{value}, {skip}", "12.5, t=20.1 C", UNIT),
        ("{skip}C {value}", "20 \u00b0C 12.5", 12.5),
        ("{skip}{value} g", "0.3 N 12.5 g", 12.5),  # N belongs to the other number
        ("{value}{skip}", "0,85 g", SCALE),  # read as 0 once
        ("{value} g", "12,5 g", SCALE),
        ("{skip}{value} g", "1,234.5 g", SCALE),  # read as 234.5 once
        ("{value}{skip}", "1 250", "a blank"),  # read as 1 once
        ("{skip}{value} g", "W 1 250 g", "a blank"),
        ("{value} {skip}", "12.5 1023", 12.5),  # the blank of the format ends the number
        ("{skip},{value},{skip}", "1234,12.5,0", 12.5),  # the comma of the format is a separator
    ],
)
def test_a_force_is_never_read_with_the_wrong_sign_or_scale(line: str, sent: str, gwt: float | str) -> None:
    board = Board((0.05, b"of a line\r\n"), (0.1, f"{sent}\r\n".encode()), line=line)
    if isinstance(gwt, str):
        with raises(ForceError, "garbled") as caught:
            board.gwt()
        assert gwt in str(caught.value)
    else:
        assert board.gwt() == gwt


@pytest.mark.parametrize(
    "line", ["{skip},{value},lbs,{skip},{skip},", "{skip},{skip},{skip},{value},{skip},{skip},g",
             "{skip}{value}", "{skip}{value}{skip} g", "{skip} " * 20 + "{value}"],
)  # fmt: skip
@pytest.mark.parametrize("piece", ["1,lbs,", "1,", "1", "1 g", "g ", " "])
def test_no_line_takes_long(line: str, piece: str) -> None:
    """A format with five {skip} once took half a minute for 250 characters: for these, longer than a test may."""
    TextCellSettings(line=line, unit="lb" if "lbs" in line else "g").pattern.fullmatch((500 * piece)[:499] + "x")


@pytest.mark.parametrize(
    ("table", "key", "code"),
    [
        ({"line": "weight 12"}, "force.text_cell.line", "bad_line_format"),
        ({"line": "{value} {value}"}, "force.text_cell.line", "bad_line_format"),
        ({"line": "{weight} g {value}"}, "force.text_cell.line", "bad_line_format"),
        ({"line": "{value}\n"}, "force.text_cell.line", "bad_line_format"),
        ({"line": "-{value} g"}, "force.text_cell.line", "sign_beside_value"),
        ({"line": "W - {value} g"}, "force.text_cell.line", "sign_beside_value"),
        ({"line": "-N {value} g"}, "force.text_cell.line", "sign_beside_value"),
        ({"line": "{value} -g"}, "force.text_cell.line", "sign_beside_value"),
        ({"line": "-{skip}{value} g"}, "force.text_cell.line", "sign_beside_value"),
        ({"line": "{skip} - {value} g"}, "force.text_cell.line", "sign_beside_value"),
        ({"line": "{value}.{skip}"}, "force.text_cell.line", "part_of_number"),  # 12 for 12.5
        ({"line": "0.{value}"}, "force.text_cell.line", "part_of_number"),
        ({"line": "{value} N"}, "force.text_cell.unit", "unit_beside_line"),  # 102 times too small once
        ({"line": "{value}kg"}, "force.text_cell.unit", "unit_beside_line"),
        ({"line": "{skip},{value},lbs,{skip}", "unit": "N"}, "force.text_cell.unit", "unit_beside_line"),
        ({"line": "Force [mN]: {value}"}, "force.text_cell.unit", "unit_beside_line"),
        ({"line": "{value} daN", "unit": "N"}, "force.text_cell.unit", "unit_beside_line"),
        ({"line": "{value} MN", "unit": "mN"}, "force.text_cell.unit", "unit_beside_line"),
        ({"line": "{value} oz"}, "force.text_cell.unit", "unit_beside_line"),
        ({"ignore": [""]}, "force.text_cell.ignore", "empty_beginning"),
        ({"unit": "oz"}, "force.text_cell.unit", "invalid_value"),
        ({"silence_s": 0}, "force.text_cell.silence_s", "invalid_value"),
        ({"full_scale_gwt": float("nan")}, "force.text_cell.full_scale_gwt", "invalid_value"),
    ],
)
def test_a_table_that_cannot_be_used(table: dict[str, Any], key: str, code: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Config.model_validate({"force": {"kind": "text_cell", "text_cell": table}})
    has_code(first_problem("", caught.value), code, key=key)


# --- lines that are old, or lack their beginning ---


def test_lines_that_waited_are_old() -> None:
    """Ten seconds of them, the last one cut off where the system's buffer was full: 1 of 15 and 7.50 of the next."""
    board = Board((0.05, b"9.00\r\n"), (0.1, b"10.00\r\n"))
    assert board.gwt() == 10.0
    old = [(0.2 + 0.1 * n, b"11.00\r\n") for n in range(20)]
    board.coming = [*old, (2.2, b"1"), (10.0, b"7.50\r\n"), (10.1, b"18.00\r\n")]
    board.clock.wait_s(9.8)
    assert board.gwt() == 18.0


@pytest.mark.parametrize(("pause_s", "gwt"), [(0.6, 7.5), (0.8, 18.0), (5.0, 18.0)])
def test_after_a_pause_of_the_longest_wait_for_a_line_the_first_one_may_be_cut_off(
    pause_s: float, gwt: float
) -> None:
    """0.5 s and two sample periods; 7.50 may be the end of 17.50."""
    board = Board((0.05, b"9.00\r\n"), (0.1, b"10.00\r\n"))
    assert board.gwt() == 10.0
    board.coming = [(0.1 + pause_s + 0.1 * n, line) for n, line in enumerate((b"7.50\r\n", b"18.00\r\n"), 1)]
    board.clock.wait_s(pause_s)
    assert board.gwt() == gwt


def test_a_line_that_has_begun_is_completed() -> None:
    board = Board((0.05, b"9.00\r\n"), (0.1, b"10.00\r\n"), (0.2, b"11.00\r\n12"), (0.3, b".00\r\n"))
    assert board.gwt() == 10.0
    board.clock.wait_s(0.15)
    assert board.gwt() == 12.0


def test_the_first_line_after_the_port_is_opened_is_no_reading() -> None:
    """Its beginning may be missing: 2.34 of 12.34."""
    board = Board((0.01, b"2.34\r\n"), (0.1, b"12.34\r\n"))
    assert board.gwt() == 12.34


def test_lines_of_a_banner_are_ignored_while_it_starts_and_named_ones_always() -> None:
    lines = [
        b"\x00\xffboot\r\n",
        b"HX711 demo\r\n",
        b"Startup is complete\r\n",
        b"5.00\r\n",
        b"# 20.1 C\r\n",
        b"6.00\r\n",
    ]
    board = Board(*((1.0 + 0.1 * n, line) for n, line in enumerate(lines)), ignore=["#"], silence_s=0.5)
    assert board.driver.connect() == "text cell, {value} in g"
    assert board.gwt() == 6.0


@pytest.mark.parametrize(("shown", "gwt"), [(b"-5.00", -5.0), (b"nan", None), (b"ovf", None)])
def test_a_banner_of_one_word_is_no_reading_and_a_broken_cell_is_one(shown: bytes, gwt: float | None) -> None:
    board = Board(*((1.0 + 0.1 * n, line + b"\r\n") for n, line in enumerate([b"x", b"HX711", shown, shown])))
    assert board.driver.connect() == "text cell, {value} in g"
    assert board.clock.monotonic_s() == pytest.approx(1.2)
    if gwt is None:
        with raises(ForceError, "no_number", value=shown.decode()):
            board.gwt()
    else:
        assert board.gwt() == gwt


def test_a_board_that_resets_during_a_press_is_an_error() -> None:
    board = Board((0.05, b"9.00\r\n"), (0.1, b"10.00\r\n"), (0.2, b"HX711 demo\r\n"))
    assert board.gwt() == 10.0
    with raises(ForceError, "garbled", port="wire", line="HX711 demo"):
        board.driver.read()


@pytest.mark.parametrize("end", [b"\r", b"\x03", b""], ids=repr)
@pytest.mark.parametrize("poll", ["", "r"], ids=["unasked", "polled"])
def test_a_board_without_line_ends_is_told_from_a_dead_cable(end: bytes, poll: str) -> None:
    """When it is connected, and later; what arrives is shown. A line that was cut off before is no sign of life."""
    line = b"\x02  1.25 g" + end
    streams = [(0.1 * n, line) for n in range(1, 60)]
    board = Polled(line) if poll else Board(*streams)
    with raises(ForceTimeout, "no_line_end", port="wire", end="end of line", shown=repr(line)[2:-1]):
        board.driver.connect()
    with raises(ForceTimeout, "no_line_end", port="wire"):
        board.driver.read()
    board.coming = []
    if poll:
        board.reply = b""  # type: ignore[attr-defined]
    with raises(ForceTimeout, "no_reply", port="wire"):
        board.driver.read()


def test_silence_is_an_error_after_two_samples_and_the_configured_time() -> None:
    board = Board((0.05, b"9.00\r\n"), (0.1, b"10.00\r\n"), silence_s=0.3)
    board.driver.read()
    with raises(ForceTimeout, "no_reply", port="wire"):
        board.driver.read()
    assert board.clock.monotonic_s() == pytest.approx(0.1 + 0.3 + 2 * PERIOD_S)


class Polled(Board):
    """A board that replies 10 ms after each request, from a time on."""

    def __init__(self, reply: bytes, from_s: float = 0.0, **table: Any) -> None:
        super().__init__(**{"poll": "r", "silence_s": 0.3, **table})
        self.reply, self.from_s, self.asked_s = reply, from_s, list[float]()

    def write(self, data: bytes) -> None:
        super().write(data)
        if data == b"r":
            self.asked_s.append(self.clock.monotonic_s())
            if self.asked_s[-1] >= self.from_s:
                self.coming.append((self.asked_s[-1] + 0.01, self.reply))


def test_a_polled_board_that_is_still_starting_is_asked_again() -> None:
    """What it did not reply to within the longest wait it never heard; then its line is waited for as long again."""
    board = Polled(b"5.00\r\n", from_s=2.2)
    assert board.driver.connect() == "text cell, {value} in g"
    assert board.asked_s == pytest.approx([0.5, 1.5, 2.5])
    assert board.gwt() == 5.0
    assert len(board.asked_s) == 4


@pytest.mark.parametrize(("zero", "code"), [("", "no_stable_load"), ("t", "not_zeroed")])
def test_while_it_is_zeroed_a_polled_board_is_asked_once_a_sample(zero: str, code: str) -> None:
    board = Polled(b"9.00\r\n", zero=zero)
    board.clock.wait_s(1000.0)
    swing = iter(range(10000))
    write = board.write

    def swinging(data: bytes) -> None:
        board.reply = f"{9 + next(swing) % 2}.00\r\n".encode()
        write(data)
        if data == b"t":
            board.coming.append((board.clock.monotonic_s() + 0.01, b"done\r\n"))

    board.write = swinging  # type: ignore[method-assign]
    with raises(ForceBusy, code, port="wire"):
        board.driver.zero()
    waits_s = [after - before for before, after in pairwise(board.asked_s)]
    assert waits_s == pytest.approx([PERIOD_S + 0.01] * len(waits_s))
    assert board.clock.monotonic_s() == pytest.approx(1010.0, abs=PERIOD_S + 0.02)


def test_the_mean_of_three_readings_within_the_range_is_subtracted() -> None:
    shown = [b"7.00", b"5.00", b"5.06", b"5.18", b"5.18", b"7.00"]
    board = Board((0.05, b"1\r\n"), *((0.15 * n, line + b"\r\n") for n, line in enumerate(shown, 1)), steady_gwt=0.2)
    board.driver.zero()
    assert board.driver.subtracted_n == pytest.approx(5.08 * GWT_N)
    assert board.gwt() == pytest.approx(7.00 - 5.08)


def test_a_board_is_not_zeroed_by_what_it_said_before() -> None:
    """Two lines of an earlier zero, of which one was heard half, and a load that is no longer 0 when it is asked."""
    board = Board((0.05, b"1\r\n"), (0.1, b"0.00\r\n"), zero="t", zero_done="Tare")
    board.driver.read()
    board.coming = [(0.2, b"Tare\r\nTare\r\n"), (0.6, b"x\r\nTare\r\n"), (0.7, b"9\r\n"), (0.8, b"0.00\r\n")]
    board.clock.wait_s(0.3)
    board.driver.zero()
    assert board.clock.monotonic_s() == pytest.approx(0.8)


def test_a_board_that_does_not_confirm_its_zero_has_ten_seconds() -> None:
    board = Board(*((1000.0 + 0.5 * n, b"7.00\r\n") for n in range(100)), zero="t", zero_done="Tare")
    board.clock.wait_s(1000.0)
    with raises(ForceTimeout, "no_reply", port="wire", timeout_s=10.0):
        board.driver.zero()
    assert board.clock.monotonic_s() == pytest.approx(1010.0)


@pytest.mark.parametrize(
    ("shown", "code"), [("0.6", "overload"), ("-0.6", "underload"), ("0.5", "overload"), ("-0.5", "underload")]
)
def test_a_reading_of_full_scale_is_an_overload_by_its_sign(shown: str, code: str) -> None:
    board = Board((0.05, b"1\r\n"), (0.1, shown.encode() + b"\r\n"), full_scale_gwt=0.5)
    with raises(ForceError, code, port="wire", shown_gwt=float(shown)):
        board.driver.read()
    assert Board((0.05, b"1\r\n"), (0.1, b"0.49\r\n"), full_scale_gwt=0.5).gwt() == pytest.approx(0.49)


def test_what_came_before_a_request_is_no_reply_to_it() -> None:
    board = Polled(b"5.00\r\n")
    assert board.gwt() == 5.0
    for late in (b"1\r\n", b"1"):
        board.coming.append((board.clock.monotonic_s(), late))
        board.clock.wait_s(0.1)
        assert board.gwt() == 5.0


def test_a_reply_to_an_earlier_request_does_not_verify_a_zero() -> None:
    """Polled in vain, the board still owes a reply: it comes when the zero has been confirmed, and the load stays."""
    late, still = [(1.1, b"Tare\r\n"), (1.2, b"0.10\r\n")], [(1.9 + 0.2 * n, b"50.00\r\n") for n in range(60)]
    board = Board(*late, *still, poll="r", zero="t", zero_done="Tare", silence_s=0.3)
    with raises(ForceTimeout, "no_reply"):
        board.driver.read()
    assert board.clock.monotonic_s() == pytest.approx(1.0)
    with raises(ForceBusy, "not_zeroed", left_gwt=50.0):
        board.driver.zero()


def test_a_board_that_sends_unasked_is_not_polled() -> None:
    board = Board(*((1000.0 + 0.1 * n, b"10.00\r\n") for n in range(300)), poll="r")
    board.clock.wait_s(1000.0)
    with raises(ForceError, "not_polled", port="wire"):
        board.driver.read()
    assert board.sent == b""
    assert board.clock.monotonic_s() == pytest.approx(1010.0, abs=0.11)


# --- its twin ---


def _twin(force_n: Callable[[float], float], **table: Any) -> tuple[VirtualClock, SerialLine]:
    clock = VirtualClock()
    line = SerialLine(clock, 9600)
    spec = VirtualForceSpec(PERIOD_S, 0.01, own=TextCellSettings(**table).model_dump())
    text_twin(clock, line, spec, Load(force_n))
    return clock, line


def test_the_twin_sends_a_line_with_each_sample() -> None:
    clock, line = _twin(
        lambda t_s: 12.34 * GWT_N * (t_s < 0.25), line="{skip},{value},g,", zero="t", zero_done="Tare"
    )
    clock.wait_s(0.35)
    assert line.host_read() == b"0,12.340,g,\r\n0,12.340,g,\r\n0,0.000,g,\r\n"


@pytest.mark.parametrize(
    ("unit", "shown"), [("g", b"100.000"), ("kg", b"0.100000"), ("lb", b"0.220462"), ("N", b"0.98066")]
)
def test_the_twin_answers_a_poll_in_its_unit(unit: str, shown: bytes) -> None:
    clock, line = _twin(lambda t_s: 100 * GWT_N, poll="<w>", unit=unit)
    clock.wait_s(1.0)
    assert line.host_read() == b""
    line.host_write(b"<w>")
    clock.wait_s(0.1)
    assert line.host_read() == shown + b"\r\n"
