"""The options of `rig decode`: what each says, what they mean together, how errors name them."""

from pathlib import Path

import pytest

from rig.cli.coding_options import in_options, press_of, pressures_of
from rig.cli.decode import noise_of, receptor_of, refuse_together, search_of
from rig.errors import BadInputError
from sim.coding.bayes import FittedReceptor
from sim.coding.decoder_results import CodingError, DecodingError
from sim.coding.encoding import Noise, Receptor
from sim.coding.task import DecoderName, SearchOptions, SectionPress
from sim.contact.shapes import parse_shape
from tests.error_codes import has_code, raises


@pytest.mark.parametrize(
    ("gain", "threshold", "expected"),
    [
        (None, "0", FittedReceptor(Receptor(1.0, 0.0), 0.0, 0.0)),
        ("30", "1.5", FittedReceptor(Receptor(30.0, 1.5), 0.0, 0.0)),
        ("30±2", "1.5±0.25", FittedReceptor(Receptor(30.0, 1.5), 2.0, 0.25)),
        ("3e1+-2e0", "-1.5", FittedReceptor(Receptor(30.0, -1.5), 2.0, 0.0)),
        ("30+/-2", "0", FittedReceptor(Receptor(30.0, 0.0), 2.0, 0.0)),
        ("1e9", "1e9±0", FittedReceptor(Receptor(1e9, 1e9), 0.0, 0.0)),
        ("1e-9", "-1e9", FittedReceptor(Receptor(1e-9, -1e9), 0.0, 0.0)),
        (None, None, None),
    ],
)
def test_a_receptor_with_its_errors(gain: str | None, threshold: str | None, expected: FittedReceptor | None) -> None:
    assert receptor_of(gain, threshold) == expected


@pytest.mark.parametrize(
    "text", ["1e9+1", "1.1e9", "1e-10", "3±1±1", "±", "2±", "±2", "2+-nan", "2±-1", "2±inf", "inf", "nan", ""]
)
def test_what_is_no_gain_is_refused(text: str) -> None:
    with pytest.raises(BadInputError, match="--gain"):
        receptor_of(text, "0")


def test_a_search_is_what_was_told() -> None:
    assert search_of("bayes", None, None, None, 3) == SearchOptions(None, None, None, 3)
    assert search_of("grid", "1,2", "0,1e9", 1e-6, 0) == SearchOptions((1.0, 2.0), (0.0, 1e9), 1e-6, 0)
    assert search_of("global", None, "1,2", None, 0).bounds == (1.0, 2.0)
    for within in ("2,2", "1,2,3", "0,1.1e9"):
        with pytest.raises(BadInputError, match="--range"):
            search_of("grid", None, within, None, 0)
    with pytest.raises(BadInputError, match="--grid-step 1e-07"):
        search_of("grid", None, None, 1e-7, 0)


def test_readings_have_one_source_and_noise_of_their_own() -> None:
    file = Path("r.csv")
    for three in ((None, None, None), ("1", "bar:3", None), ("1", None, file), ("1", "bar:3", file)):
        with raises(BadInputError, "exactly_one"):
            refuse_together(*three)
    for three in (("1", None, None), (None, "bar:3", None)):
        refuse_together(*three, snr_db=3.0)
    refuse_together(None, None, file, snr_db=None)
    with raises(BadInputError, "not_together", option="--snr-db", beside="--readings"):
        refuse_together(None, None, file, operator=None, snr_db=0.0)


def test_noise_is_added_where_a_ratio_is_told() -> None:
    assert noise_of(None, "output", 3) is None
    assert noise_of(-40.0, "receptor", 2**32) == Noise(-40.0, "receptor", 2**32)
    for snr_db, seed in ((-40.1, 0), (100.1, 0), (3.0, -1), (3.0, 2**32 + 1)):
        with raises(BadInputError, "outside_range"):
            noise_of(snr_db, "output", seed)


@pytest.mark.parametrize(
    ("decoder", "takes"),
    [("bayes", ""), ("univariate", "sr"), ("grid", "srg"), ("table", "r"), ("global", "r")],
)
def test_each_decoder_refuses_what_it_does_not_go_by(decoder: DecoderName, takes: str) -> None:
    for letter, told in (("s", ("1", None, None)), ("r", (None, "0,1", None)), ("g", (None, None, 0.5))):
        if letter in takes:
            search_of(decoder, *told, 0)
        else:
            with raises(BadInputError, "not_this_decoder", decoder=decoder):
                search_of(decoder, *told, 0)


def test_a_gain_goes_with_a_threshold_and_is_above_its_error() -> None:
    with raises(BadInputError, "needs_option", option="--gain", needs="--threshold"):
        receptor_of("3", None)
    for gain in ("3±3", "3±4"):
        with raises(BadInputError, "error_too_large", value=gain):
            receptor_of(gain, "0")


# --- the simulation's errors, in options ---


def test_arguments_are_called_by_their_options_and_nothing_else_is() -> None:
    error = in_options(
        CodingError("{start}: {n} within {bounds} {low:g}", code="c", start="start", bounds="bounds", n="n", low=1.0)
    )
    assert str(error) == "--start: --n within --range 1"
    has_code(error, "c", start="--start", bounds="--range", low=1.0)
    count = in_options(DecodingError("{readings} readings", code="too_few", readings=3))
    assert str(count) == "3 readings"
    assert str(in_options(CodingError("plain {text}"))) == "plain {text}"


def test_pressures_of_a_command_line_or_a_file(tmp_path: Path) -> None:
    assert pressures_of("20,14", 0.17).tolist() == [20.0, 14.0]
    file = tmp_path / "p.csv"
    file.write_text("pressure\n3\n0\n", encoding="utf-8")
    assert pressures_of(str(file), 0.17).tolist() == [3.0, 0.0]
    with raises(BadInputError, "unreadable"):
        pressures_of("20,x", 0.17)
    with raises(BadInputError, "negative", pressure="--pressure", value=-1.0):
        pressures_of("20,-1", 0.17)
    with raises(BadInputError, "wrong_count", pressure="--pressure", numbers=401, most=400):
        pressures_of(",".join(["1"] * 401), 0.17)


def test_a_press_needs_a_depth() -> None:
    assert press_of("bar:3", 0.5, 0.4) == SectionPress(parse_shape("bar:3"), 0.5, 0.4)
    with raises(BadInputError, "needs_option", option="--shape", needs="--doi-mm"):
        press_of("bar:3", 0.0, None)
