"""The parts of `rig decode`, on an operator of a few numbers: what is heard, explained, assumed, begun with."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rig.cli import coding_task
from rig.cli.coding_task import (
    NO_NOISE,
    TABLE_ENTRIES,
    Answer,
    DecoderName,
    Encoding,
    Noisy,
    Search,
    Task,
    decode,
    noise_of,
)
from rig.cli.decode import encoding_of, left, operator_of, receptor_of, refuse_together, search_of
from rig.errors import BadInputError
from sim.coding.bayes import FittedReceptor
from sim.coding.encoding import NOISE_PLACES, Encoded, Noise, NoisePlace, Receptor, sd_at_rest
from sim.coding.operators import Operator
from sim.coding.search import Range, table_search

M = 8
SQUARES = Operator("influence", "finite", np.eye(M)[None], np.arange(M) * 1.0, np.arange(M) * 1.0)
PRESSURE = np.arange(1.0, M + 1)
SED = PRESSURE**2


def task(reading: np.ndarray = SED, **more: object) -> Task:
    given: dict[str, object] = {"receptor": None, "noise": Noisy(np.full(M, 0.5), "told")}
    return Task(SQUARES, reading, **(given | more))  # type: ignore[arg-type]


def through(gain: float, threshold: float) -> FittedReceptor:
    return FittedReceptor(Receptor(gain, threshold))


# --- what is heard, and what is explained ---


def test_readings_stand_for_sed() -> None:
    assert_allclose(task().sed, SED)
    assert_allclose(task(2.0 * (SED - 1.0), receptor=through(2.0, 1.0)).sed, SED)


def test_what_is_heard_is_above_silence_or_above_noise() -> None:
    assert task(np.zeros(M)).heard.all()
    rate = np.array([0.0, 0.1, 1.0, 1.5, 1.6, 2.0, 3.0, 0.0])
    receptor = through(2.0, 1.0)
    assert task(rate, receptor=receptor).heard.tolist() == (rate > 0).tolist()
    assert task(rate, receptor=receptor, noise=None).heard.tolist() == (rate > 0).tolist()
    noisy = Noisy(np.full(M, 0.5), "told", "output")
    assert task(rate, receptor=receptor, noise=noisy).heard.tolist() == (rate > 1.5).tolist()  # of three sd


@pytest.mark.parametrize(("receptor", "unit"), [(None, 1.0), (through(4.0, 0.0), 4.0)])
def test_readings_are_explained_up_to_five_deviations_of_chi_squared(
    receptor: FittedReceptor | None, unit: float
) -> None:
    """Of 8 readings: 8 + 5 √16 = 28 sd²."""
    for misfit, said in ((27.9, False), (28.1, True)):
        off = SED.copy()
        off[5] += np.sqrt(misfit) * 0.5
        given = task(unit * off, receptor=receptor, noise=Noisy(np.full(M, 0.5 * unit), "told"))
        problems = given.unexplained(PRESSURE)
        assert bool(problems) is said
        if said:
            assert problems == ("the readings are not explained: misfit 28.1, expected about 8",)


def test_a_share_of_sed_may_be_wrong_too() -> None:
    off = SED * 1.4
    assert task(off).unexplained(PRESSURE)
    assert task(off).unexplained(PRESSURE, share=0.05)
    assert not task(off).unexplained(PRESSURE, share=0.3)
    assert not task(off, noise=None).unexplained(PRESSURE)


def test_silent_receptors_need_no_explanation() -> None:
    rate = SED.copy()
    rate[0] = 0.0  # below its threshold, however far
    given = task(rate, receptor=through(1.0, 0.0))
    assert not given.unexplained(np.append(30.0, PRESSURE[1:]))
    assert left(given, Answer(np.append(30.0, PRESSURE[1:]), True, 0.0)) == 0.0
    off = SED[1:] - 4.0
    assert left(given, Answer(np.full(M, 2.0), True, 0.0)) == pytest.approx(np.sqrt(np.mean(off**2)))


def test_nothing_above_its_noise_is_refused() -> None:
    with pytest.raises(BadInputError, match="no reading is above its noise: expected some that are"):
        decode(task(np.zeros(M), receptor=through(1.0, 0.0)), "ours", Search())


# --- noise ---

SAID = Encoded(SED, 2.0 * SED, 0.25, 0.01)


def test_noise_is_measured_told_or_assumed() -> None:
    rest = 0.25 * np.random.default_rng((7, 1)).normal(size=M)
    measured = noise_of(SAID, None, "receptor", 7)
    assert_allclose(measured.sd, np.full(M, sd_at_rest(rest)))
    assert (measured.known, measured.at) == ("measured at rest of 8 receptors", "receptor")
    before, after = (noise_of(SAID, Receptor(2.0, 0.0), at, 7) for at in ("receptor", "output"))
    assert_allclose(before.sd, np.full(M, 0.5))  # in the unit of rates
    assert_allclose(after.sd, np.full(M, 0.25))
    assert (before.known, before.at, after.at) == ("told", "receptor", "output")
    none = noise_of(replace(SAID, noise_sd=0.0), None, "receptor", 7)
    assert_allclose(none.sd, np.full(M, 1e-3 * 128))
    assert none.known == "assumed, there is none"
    assert NO_NOISE == 1e-3


# --- searches ---


def test_a_search_begins_and_ends_by_the_readings_size() -> None:
    found = decode(task(), "univariate", Search())
    assert found.within == Range(0.0, 2 * 8.0)  # the highest reading is 8 squared, felt by one pressure
    # even pressures of s give s² everywhere: nearest to the readings where s² is their mean
    assert_allclose(found.path[0], np.full(M, np.sqrt(SED.mean())))
    assert_allclose(found.pressure, PRESSURE, rtol=1e-6)
    assert (found.converged, found.problems) == (True, ())
    told = decode(task(), "univariate", Search((3.0,), (1.0, 9.0)))
    assert told.within == Range(1.0, 9.0)
    assert_allclose(told.path[0], np.full(M, 3.0))
    each = decode(task(), "univariate", Search(tuple(PRESSURE), (1.0, 8.0)))
    assert_allclose(each.path[0], PRESSURE)
    low = decode(task(), "univariate", Search(None, (0.0, 2.0)))
    assert_allclose(low.path[0], np.full(M, 2.0))  # within its range
    assert low.problems[0] == "7 of 8 pressures stand at the end of the range, 2"


def test_the_grid_is_a_thirtieth_of_the_range_unless_told() -> None:
    within = (0.0, 12.0)
    values = np.linspace(*within, 31)
    nearest = values[np.abs(values[:, None] ** 2 - SED).argmin(axis=0)]
    assert_allclose(decode(task(), "grid", Search(None, within)).pressure, nearest)
    assert_allclose(decode(task(), "grid", Search(None, within, 0.25)).pressure, PRESSURE)


def test_a_table_is_of_a_thousand_responses() -> None:
    within = Range(0.0, 9.0)
    assert TABLE_ENTRIES == 1000
    expected = table_search(SQUARES, SED, within, 1000, 4)
    assert_allclose(decode(task(), "table", Search(None, within, None, 4)).pressure, expected.pressure)


# --- options ---


def test_operators_by_default() -> None:
    assert operator_of(None, pressures=True) == "convolution"
    assert operator_of(None, pressures=False) == "influence"
    assert operator_of("influence", pressures=True) == "influence"


@pytest.mark.parametrize(
    ("gain", "threshold", "expected"),
    [
        (None, "0", FittedReceptor(Receptor(1.0, 0.0), 0.0, 0.0)),
        ("30", "1.5", FittedReceptor(Receptor(30.0, 1.5), 0.0, 0.0)),
        ("30±2", "1.5±0.25", FittedReceptor(Receptor(30.0, 1.5), 2.0, 0.25)),
        ("3e1+-2e0", "-1.5", FittedReceptor(Receptor(30.0, -1.5), 2.0, 0.0)),
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
    assert search_of("ours", None, None, None, 3) == Search(None, None, None, 3)
    assert search_of("grid", "1,2", "0,1e9", 1e-6, 0) == Search((1.0, 2.0), (0.0, 1e9), 1e-6, 0)
    assert search_of("global", None, "1,2", None, 0).within == (1.0, 2.0)
    for within in ("2,2", "1,2,3", "0,1.1e9"):
        with pytest.raises(BadInputError, match="--range"):
            search_of("grid", None, within, None, 0)
    with pytest.raises(BadInputError, match="--grid-step 1e-07"):
        search_of("grid", None, None, 1e-7, 0)


def test_a_start_lies_within_the_range() -> None:
    for start in ((0.5,), (9.5,)):
        with pytest.raises(BadInputError, match="--start: expected numbers within --range 1 … 9"):
            decode(task(), "grid", Search(start, (1.0, 9.0)))
    with pytest.raises(BadInputError, match="--start: 3 numbers, expected 1 or 8"):
        decode(task(), "grid", Search((1.0, 2.0, 3.0), (1.0, 9.0)))
    assert_allclose(decode(task(), "grid", Search((9.0,), (1.0, 9.0))).path[0], np.full(M, 9.0))


def test_the_range_is_of_what_one_pressure_alone_would_need() -> None:
    parts = np.random.default_rng(3).normal(size=(2, M, 2))
    given = replace(task(), operator=replace(SQUARES, parts=parts, place_mm=np.arange(2.0)))
    most = max(float(parts[0, m, k] ** 2 + parts[1, m, k] ** 2) for m in range(M) for k in range(2))
    within = decode(given, "table", Search()).within
    assert within is not None
    assert within.high == pytest.approx(2 * np.sqrt(64 / most))
    even = (parts.sum(axis=2) ** 2).sum(axis=0)
    start = decode(given, "grid", Search()).path[0]
    assert_allclose(start, np.full(2, np.sqrt(even @ SED / (even @ even))))


@pytest.mark.parametrize("decoder", ["table", "ours"])
def test_milliseconds_are_those_of_the_decoder(decoder: DecoderName, monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter((5.0, 5.25))
    monkeypatch.setattr(coding_task, "time", SimpleNamespace(perf_counter=lambda: next(times)))
    assert decode(two_pressures(), decoder, Search()).ms == 250.0


# --- ours ---

PARTS = np.random.default_rng(2).normal(size=(2, M, 2))
TRUE = np.array([20.0, 14.0])


def two_pressures(sd: float | np.ndarray = 1.0, gain: float = 1.0, at: NoisePlace = "receptor") -> Task:
    """SED without noise, as it is or as rates above a threshold that all of it is above."""
    operator = replace(SQUARES, parts=PARTS, place_mm=np.arange(2.0))
    sed, noise = operator.sed(TRUE), Noisy(gain * np.full(M, sd), "told", at)
    if gain == 1.0:
        return Task(operator, sed, None, noise, TRUE)
    return Task(operator, gain * (sed + 5.0), FittedReceptor(Receptor(gain, -5.0)), noise, TRUE)


def test_ours_goes_by_noise_told_before_or_after_the_receptor() -> None:
    plain = decode(two_pressures(), "ours", Search())
    assert_allclose(plain.pressure, TRUE, rtol=0.05)
    assert plain.profile is not None
    assert plain.converged
    for at in NOISE_PLACES:
        found = decode(two_pressures(gain=30.0, at=at), "ours", Search())
        assert_allclose(found.pressure, plain.pressure, rtol=1e-6)
        assert found.profile is not None
        assert_allclose(found.profile.sd, plain.profile.sd, rtol=1e-6)


@pytest.mark.parametrize("gain", [1.0, 30.0])
def test_noise_that_differs_weighs_readings(gain: float) -> None:
    sd = np.where(np.arange(M) == 2, 1e6, 1.0)
    given = two_pressures(sd, gain)
    wrong = replace(given, reading=np.where(np.arange(M) == 2, 3 * given.reading, given.reading))
    right, found = (decode(one, "ours", Search()) for one in (given, wrong))
    assert_allclose(found.pressure, right.pressure, rtol=0.01)
    assert right.problems == found.problems == ()
    sure = decode(replace(wrong, noise=two_pressures(1.0, gain).noise), "ours", Search())
    assert sure.problems[0].startswith("the readings are not explained: ")
    assert decode(wrong, "table", Search()).problems[-1].startswith("the readings are not explained: ")


def test_ours_says_when_it_was_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    real = coding_task.decode_profile
    monkeypatch.setattr(coding_task, "decode_profile", lambda *a, **b: replace(real(*a, **b), converged=False))
    found = decode(two_pressures(), "ours", Search())
    assert (found.converged, found.problems) == (False, (coding_task.CUT_OFF,))


def test_ours_needs_to_know_the_noise() -> None:
    with pytest.raises(BadInputError, match="--readings: expected a column sd or at_rest, decoder ours goes by"):
        decode(task(noise=None), "ours", Search())


# --- what cannot be told together ---


def test_readings_have_one_source_and_noise_of_their_own() -> None:
    file = Path("r.csv")
    for three in ((None, None, None), ("1", "bar:3", None), ("1", None, file), ("1", "bar:3", file)):
        with pytest.raises(BadInputError, match="expected exactly one of"):
            refuse_together(*three)
    for three in (("1", None, None), (None, "bar:3", None)):
        refuse_together(*three, snr_db=3.0)
    refuse_together(None, None, file, snr_db=None)
    with pytest.raises(BadInputError, match="--snr-db beside --readings: expected it with --pressure or --shape"):
        refuse_together(None, None, file, operator=None, snr_db=0.0)


def test_noise_is_added_where_a_ratio_is_told() -> None:
    assert encoding_of("finite", "output", None, 3, None) == Encoding("finite", None, None, "output")
    told = encoding_of("incompressible", "receptor", -40.0, 2**32, FittedReceptor(Receptor()))
    assert told == Encoding("incompressible", FittedReceptor(Receptor()), Noise(-40.0, "receptor", 2**32), "receptor")
    for snr_db, seed in ((-40.1, 0), (100.1, 0), (3.0, -1), (3.0, 2**32 + 1)):
        with pytest.raises(BadInputError, match="expected"):
            encoding_of("finite", "output", snr_db, seed, None)


@pytest.mark.parametrize(
    ("decoder", "takes"),
    [("ours", ""), ("univariate", "sr"), ("grid", "srg"), ("table", "r"), ("global", "r")],
)
def test_each_decoder_refuses_what_it_does_not_go_by(decoder: DecoderName, takes: str) -> None:
    for letter, told in (("s", ("1", None, None)), ("r", (None, "0,1", None)), ("g", (None, None, 0.5))):
        if letter in takes:
            search_of(decoder, *told, 0)
        else:
            with pytest.raises(BadInputError, match=f"beside --decoder {decoder}: expected .*grid"):
                search_of(decoder, *told, 0)


def test_a_gain_goes_with_a_threshold_and_is_above_its_error() -> None:
    with pytest.raises(BadInputError, match="--gain: expected --threshold beside it"):
        receptor_of("3", None)
    for gain in ("3±3", "3±4"):
        with pytest.raises(BadInputError, match=f"--gain {gain}: expected a standard error below the gain itself"):
            receptor_of(gain, "0")
