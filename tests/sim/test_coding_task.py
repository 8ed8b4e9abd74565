"""Tasks of encoding and decoding, on an operator of a few numbers: what is heard, explained, assumed, begun with."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sim.coding.bayes import FittedReceptor, ModelError
from sim.coding.decoder_results import CodingError
from sim.coding.decoders_by_search import PressureRange
from sim.coding.encoding import NOISE_PLACES, Encoded, Noise, NoisePlace, Receptor, encode
from sim.coding.operators import ForwardOperator
from sim.coding.receptor_readings import sd_at_rest
from sim.coding.section import Sampling
from sim.coding.task import (
    NO_NOISE,
    DecodeResult,
    DecodeTask,
    EncodeTask,
    Observation,
    ReadingNoise,
    SearchOptions,
    SectionPress,
    best_explained,
    decode_observation,
    decode_task,
    encode_task,
    noise_of,
    observe,
)
from sim.config import FingertipConfig
from tests.error_codes import raises
from tests.sim.coarse_mesh import coarse_mesh

M = 8
SQUARES = ForwardOperator("influence", "finite", np.eye(M)[None], np.arange(M) * 1.0, np.arange(M) * 1.0)
PRESSURE = np.arange(1.0, M + 1)
SED = PRESSURE**2


def observation(reading: np.ndarray = SED, **more: object) -> Observation:
    given: dict[str, object] = {"receptor": None, "noise": ReadingNoise(np.full(M, 0.5), "given")}
    return Observation(SQUARES, reading, **(given | more))  # type: ignore[arg-type]


def through(gain: float, threshold: float) -> FittedReceptor:
    return FittedReceptor(Receptor(gain, threshold))


# --- what is heard, and what is explained ---


def test_receptor_responds_above_silence_or_noise() -> None:
    assert observation(np.zeros(M)).responding.all()
    rate = np.array([0.0, 0.1, 1.0, 1.5, 1.6, 2.0, 3.0, 0.0])
    receptor = through(2.0, 1.0)
    assert observation(rate, receptor=receptor).responding.tolist() == (rate > 0).tolist()
    assert observation(rate, receptor=receptor, noise=None).responding.tolist() == (rate > 0).tolist()
    noisy = ReadingNoise(np.full(M, 0.5), "given", "output")
    exceeding = observation(rate, receptor=receptor, noise=noisy).responding.tolist()
    assert exceeding == (rate > 1.5).tolist()  # three sd


@pytest.mark.parametrize(("receptor", "unit"), [(None, 1.0), (through(4.0, 0.0), 4.0)])
def test_readings_beyond_five_deviations_of_chi_squared_are_reported_as_unexplained(
    receptor: FittedReceptor | None, unit: float
) -> None:
    """Of 8 readings: 8 + 5 √16 = 28 sd²."""
    for misfit, said in ((27.9, False), (28.1, True)):
        off = SED.copy()
        off[5] += np.sqrt(misfit) * 0.5
        given = observation(unit * off, receptor=receptor, noise=ReadingNoise(np.full(M, 0.5 * unit), "given"))
        problems = given.unexplained(PRESSURE)
        assert bool(problems) is said
        if said:
            assert problems == ("the decoded pressures do not explain the readings: misfit 28.1, expected about 8",)


def test_silent_receptors_do_not_count_in_the_remaining_sed_error() -> None:
    rate = np.append(0.0, SED[1:])  # the first is below its threshold, however far
    given = observation(rate, receptor=through(1.0, 0.0))
    assert DecodeResult(given, np.append(30.0, PRESSURE[1:]), True, 0.0).left_of_sed == 0.0
    found = DecodeResult(given, np.full(M, 2.0), True, 0.0)
    assert found.left_of_sed == pytest.approx(np.sqrt(np.mean((SED[1:] - 4.0) ** 2)))


# --- noise ---

SAID = Encoded(SED, 2.0 * SED, 0.25, 0.01)


def test_the_noise_of_readings_is_measured_given_or_assumed() -> None:
    rest = 0.25 * np.random.default_rng((7, 1)).normal(size=M)
    measured = noise_of(SAID, None, Noise(20.0, "receptor", 7))
    assert_allclose(measured.sd, np.full(M, sd_at_rest(rest)))
    assert (measured.known, measured.at) == ("measured from 8 receptors at rest", "receptor")
    before, after = (noise_of(SAID, Receptor(2.0, 0.0), Noise(20.0, at, 7)) for at in NOISE_PLACES)
    assert_allclose(before.sd, np.full(M, 0.5))  # in the unit of rates
    assert_allclose(after.sd, np.full(M, 0.25))
    assert (before.known, before.at, after.at) == ("given", "receptor", "output")
    for none in (noise_of(replace(SAID, noise_sd=0.0), None, Noise(20.0)), noise_of(SAID, None, None)):
        assert_allclose(none.sd, np.full(M, 1e-3 * 128))
        assert none.known == "none; a small sd is assumed"
    assert NO_NOISE == 1e-3


# --- searches ---


def test_start_and_range_of_a_search_follow_the_size_of_the_readings() -> None:
    found = decode_observation(observation(), "univariate", SearchOptions())
    assert found.bounds == PressureRange(0.0, 2 * 8.0)  # the highest reading is 8 squared, felt by one pressure
    # even pressures of s give s² everywhere: nearest to the readings where s² is their mean
    assert_allclose(found.path[0], np.full(M, np.sqrt(SED.mean())))
    assert_allclose(found.pressure, PRESSURE, rtol=1e-6)
    assert (found.converged, found.problems) == (True, ())
    told = decode_observation(observation(), "univariate", SearchOptions((3.0,), (1.0, 9.0)))
    assert told.bounds == PressureRange(1.0, 9.0)
    assert_allclose(told.path[0], np.full(M, 3.0))
    each = decode_observation(observation(), "univariate", SearchOptions(tuple(PRESSURE), (1.0, 8.0)))
    assert_allclose(each.path[0], PRESSURE)
    low = decode_observation(observation(), "univariate", SearchOptions(None, (0.0, 2.0)))
    assert_allclose(low.path[0], np.full(M, 2.0))  # within its range
    assert low.problems[0] == "7 of 8 pressures are at the upper end of the range, 2"


# --- bayes ---

PARTS = np.random.default_rng(2).normal(size=(2, M, 2))
TRUE = np.array([20.0, 14.0])


def two_pressures(sd: float | np.ndarray = 1.0, gain: float = 1.0, at: NoisePlace = "receptor") -> Observation:
    """SED without noise, as it is or as rates above a threshold that all of it is above."""
    operator = replace(SQUARES, parts=PARTS, place_mm=np.arange(2.0))
    sed, noise = operator.sed(TRUE), ReadingNoise(gain * np.full(M, sd), "told", at)
    if gain == 1.0:
        return Observation(operator, sed, None, noise, TRUE)
    return Observation(operator, gain * (sed + 5.0), FittedReceptor(Receptor(gain, -5.0)), noise, TRUE)


def test_bayes_takes_noise_before_or_after_the_receptor() -> None:
    plain = decode_observation(two_pressures(), "bayes", SearchOptions())
    assert_allclose(plain.pressure, TRUE, rtol=0.05)
    assert plain.profile is not None
    assert plain.converged
    for at in NOISE_PLACES:
        found = decode_observation(two_pressures(gain=30.0, at=at), "bayes", SearchOptions())
        assert_allclose(found.pressure, plain.pressure, rtol=1e-6)
        assert found.profile is not None
        assert_allclose(found.profile.sd, plain.profile.sd, rtol=1e-6)


@pytest.mark.parametrize("gain", [1.0, 30.0])
def test_readings_with_larger_noise_have_less_weight(gain: float) -> None:
    sd = np.where(np.arange(M) == 2, 1e6, 1.0)
    given = two_pressures(sd, gain)
    wrong = replace(given, reading=np.where(np.arange(M) == 2, 3 * given.reading, given.reading))
    right, found = (decode_observation(one, "bayes", SearchOptions()) for one in (given, wrong))
    assert_allclose(found.pressure, right.pressure, rtol=0.01)
    assert right.problems == found.problems == ()
    sure = decode_observation(replace(wrong, noise=two_pressures(1.0, gain).noise), "bayes", SearchOptions())
    assert sure.problems[:1] == sure.observation.unexplained(sure.pressure, ModelError().share) != ()
    table = decode_observation(wrong, "table", SearchOptions())
    assert table.problems[-1:] == table.observation.unexplained(table.pressure) != ()


def test_bayes_without_noise_is_refused() -> None:
    silent = observation(noise=None)
    with raises(CodingError, "noise_unknown", readings="readings"):
        decode_observation(silent, "bayes", SearchOptions())
    with raises(CodingError, "noise_unknown"):  # before any axial shape is chosen
        best_explained([silent, silent])


# --- whole tasks ---

COARSE = FingertipConfig(mesh=coarse_mesh(0.3, 0.5))
QUICK = Sampling(half_length=10)


def test_encoding_and_decoding_use_the_named_operator() -> None:
    """Convolution unless told; noise and receptor are those of `encode`."""
    folded = encode_task(EncodeTask((20, 14), sampling=QUICK, finger=COARSE))
    assert folded.load.operator.name == "convolution"
    assert_allclose(folded.load.pressure, [20, 14])
    receptor, noise = Receptor(30.0, 0.1 * float(folded.encoded.sed.max())), Noise(30.0, "output", 3)
    heard = encode_task(EncodeTask((20, 14), receptor=receptor, noise=noise, sampling=QUICK, finger=COARSE))
    expected = encode(folded.load.operator, folded.load.pressure, receptor, noise)
    assert_allclose(heard.encoded.rate, expected.rate, rtol=1e-12)

    task = DecodeTask((20, 14), receptor=FittedReceptor(receptor), noise=noise, sampling=QUICK, finger=COARSE)
    seen = observe(task)
    assert_allclose(seen.reading, expected.rate, rtol=1e-12)
    assert seen.noise is not None
    assert (seen.noise.known, seen.noise.at) == ("given", "output")
    found = decode_task(task)
    assert_allclose(found.pressure, [20, 14], rtol=0.3)
    assert found.errors is not None
    assert found.errors.relative_l2 == pytest.approx(np.linalg.norm(found.pressure - [20, 14]) / np.hypot(20, 14))


def test_a_press_is_encoded_by_finite_elements_unless_an_operator_is_named() -> None:
    press = SectionPress("cylinder:9", 0.5, 0.4)
    elements = encode_task(EncodeTask(press, "influence", sampling=QUICK, finger=COARSE))
    assert elements.load.missed is not None
    assert elements.load.missed["relative_l2"] < 1e-6
    seen = observe(DecodeTask(press, sampling=QUICK, finger=COARSE))
    assert (seen.operator.name, len(seen.operator.place_mm)) == ("influence", 17)  # 0.8 of the half length
    assert_allclose(seen.reading, elements.encoded.sed)
    folded = observe(DecodeTask(press, operator="convolution", sampling=QUICK, finger=COARSE))
    assert folded.operator.name == "convolution"
    beside = SectionPress("bar:1.5", 4.0, 0.3)
    with raises(CodingError, "beside_the_search", shape="shape", x_mm=4.0):
        observe(DecodeTask(beside, sampling=QUICK, finger=COARSE))


def test_readings_of_silent_receptors_cannot_be_decoded() -> None:
    with raises(CodingError, "all_noise"):
        decode_observation(observation(np.zeros(M), receptor=through(1.0, 0.0)), "bayes", SearchOptions())
    with raises(CodingError, "all_silent", threshold="threshold"):
        decode_task(DecodeTask((0.0, 0.0), sampling=QUICK, finger=COARSE))
