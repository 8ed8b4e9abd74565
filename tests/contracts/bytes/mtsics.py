"""A balance that speaks MT-SICS level 0 and 1."""

from rig.devices.base import ForceBusy, ForceError, ForceOverload, ForceTimeout, ForceUnderload
from tests.contracts.force import SILENCE, ForceBytes, NoWeight, Weight, Zeroing, without_line_end

ASK, ZERO = b"SI\r\n", b"Z\r\n"
SERIAL = b'I4 A "0123456789"\r\n'

DEVICE = ForceBytes(
    name="mtsics",
    kind="mtsics",
    source="MT-SICS reference manual, levels 0 and 1; that @ answers with the serial number is second-hand",
    identity="MT-SICS balance 0123456789",
    usual={b"@\r\n": SERIAL, b"I4\r\n": SERIAL, ASK: b"S S     100.00 g\r\n", ZERO: b"Z A\r\n"},
    on_connect=[b"@\r\n"],
    on_identify=[b"I4\r\n"],  # @ would forget the tare
    max_age_s=0.5,
    reading=ASK,
    zero=ZERO,
    weights={
        "stable": Weight(b"S S     100.00 g\r\n", 100.0, True),
        "dynamic": Weight(b"S D      -0.01 g\r\n", -0.01, False),
        "white space is no column": Weight(b"S\tS 2.33     g  \r\n", 2.33, True),
        "nothing": Weight(b"S S       0.00 g\r\n", 0.0, True),
    },
    refusals={
        "overload": NoWeight(b"S +\r\n", ForceOverload, "overload"),
        "underload": NoWeight(b"S -\r\n", ForceUnderload, "underload"),
        "unknown command": NoWeight(b"ES\r\n", ForceError, "unknown_command"),
        "garbled command": NoWeight(b"ET\r\n", ForceError, "garbled_command"),
        "not possible": NoWeight(b"EL\r\n", ForceError, "not_possible"),
        "kilograms": NoWeight(b"S S 1.00 kg\r\n", ForceError, "wrong_unit"),
        "ounces": NoWeight(b"S S 1.00 oz\r\n", ForceError, "wrong_unit"),
    },
    garbled={
        "nan": NoWeight(b"S S nan g\r\n"),
        "infinity": NoWeight(b"S S inf g\r\n"),
        "an exponent": NoWeight(b"S S 1e400 g\r\n"),
        "hexadecimal": NoWeight(b"S S 0x10 g\r\n"),
        "a comma": NoWeight(b"S S 1,00 g\r\n"),
        "two signs": NoWeight(b"S S +-1 g\r\n"),
        "a point alone": NoWeight(b"S S . g\r\n"),
        "no unit": NoWeight(b"S S 1.00\r\n"),
        "no space before the unit": NoWeight(b"S S 1.00g\r\n"),
        "two units": NoWeight(b"S S 1.00 g g\r\n"),
        "unit and weight exchanged": NoWeight(b"S S g 1.00\r\n"),
        "neither stable nor dynamic": NoWeight(b"S X 1.00 g\r\n"),
        "an acknowledgement": NoWeight(b"S A\r\n"),
        "one word": NoWeight(b"S\r\n"),
        "the command itself": NoWeight(b"SI S 1.00 g\r\n"),
        "a tare": NoWeight(b"T S 1.00 g\r\n"),
        "a zero": NoWeight(b"Z A\r\n"),
        "a weight alone": NoWeight(b"1.00 g\r\n"),
        "no ASCII": NoWeight(b"\xff\xff\r\n"),
        **without_line_end(b"S S     10.00 g"),
    },
    zeroing={
        "at rest": Zeroing({ZERO: [b"Z A\r\n"]}),
        "never at rest": Zeroing({ZERO: [b"Z I\r\n"]}, ForceBusy, "busy"),
        "overloaded": Zeroing({ZERO: [b"Z +\r\n"]}, ForceOverload, "overload"),
        "underloaded": Zeroing({ZERO: [b"Z -\r\n"]}, ForceUnderload, "underload"),
        "not known": Zeroing({ZERO: [b"ES\r\n"]}, ForceError, "unknown_command"),
        "silent": Zeroing({ZERO: [SILENCE]}, ForceTimeout, "no_reply"),
        "not confirmed": Zeroing({ZERO: [b"Z S\r\n"]}, ForceError, "garbled"),
        "half a confirmation": Zeroing({ZERO: [b"Z\r\n"]}, ForceError, "garbled"),
        "a weight": Zeroing({ZERO: [b"S S 1.00 g\r\n"]}, ForceError, "garbled"),
    },
    not_now={"busy": NoWeight(b"S I\r\n", ForceBusy, "busy")},
    not_on_twin={"white space is no column": "the twin writes columns"},
    lacks={"cell error": "no reply of levels 0 and 1 says so"},
)
