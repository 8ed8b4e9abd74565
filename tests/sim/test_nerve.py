"""Afferents: filters and integrator against closed forms, and what each class does under a press and a vibration."""

from collections.abc import Callable
from dataclasses import replace
from itertools import cycle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, lsim

from sim.errors import ArgumentError, ModelRangeError
from sim.models.fingertip import Fingertip
from sim.nerve.filters import adapted, derivative_low_pass, fading
from sim.nerve.firing_speed import LEAST_MM_S, MOST_MM_S, firing_speed_mm_s
from sim.nerve.integrator import MOST_STEP_S, Membrane, after_current, spikes
from sim.nerve.models import BUILT_IN, AfferentModel, spikes_of
from sim.nerve.pc import PC
from sim.nerve.ra import RA
from sim.nerve.sa1 import SA1
from sim.nerve.skin import LEVELS, Signal, SkinUnderIndentor
from sim.nerve.spike_stream import SpikeStream
from sim.nerve.stimulus import Stimulus, Vibration
from tests.error_codes import raises

Array = NDArray[np.float64]

DEPTHS_MM = np.linspace(0.0625, 1.5, 24)
SED = {"SA1": 200 * DEPTHS_MM**2, "RA": 240 * DEPTHS_MM**2, "PC": 46 * DEPTHS_MM**2}
"""Some strain energy at the receptors of each class under a small probe."""


def skin(name: str) -> SkinUnderIndentor:
    return SkinUnderIndentor.of_values(DEPTHS_MM, BUILT_IN[name].measure({"sed": SED[name][:, None]}))


def trains(
    name: str, stimulus: Stimulus, gains: Array, step_s: float = 5e-4, lasts_s: float | None = None
) -> list[Array]:
    seeds = [(3, k) for k in range(len(gains))]
    return spikes_of(BUILT_IN[name], skin(name).signal(stimulus, step_s, lasts_s), gains, seeds)


def vibrating(frequency_hz: float, amplitude_um: float, lasts_s: float = 1.0) -> Stimulus:
    """On a preload of 0.5 mm since 0.55 s, from 1 s on."""
    one = Vibration(frequency_hz, amplitude_um, 1.0, lasts_s)
    return Stimulus([0.05, 0.55], [0.0, 0.5], corner_s=0.1, vibrations=[one])


def total(found: list[Array], begin_s: float = 0.0, end_s: float = np.inf) -> int:
    return sum(int(((one >= begin_s) & (one < end_s)).sum()) for one in found)


# --- filters and integrator ---

T = np.arange(0.0, 0.3, 1e-3)
BENT = np.interp(T, [0.0, 0.05, 0.06, 0.2, 0.21], [0.0, 0.0, 2.0, 1.5, -1.0])


def of(numerator: Any, denominator: Any) -> Array:
    return np.asarray(lsim((numerator, denominator), BENT, T)[1])


def butterworth(derivative: int) -> Array:
    above, below = butter(3, 2 * np.pi * 120, analog=True)
    return of(np.polymul(above, [1] + derivative * [0]), below)


@pytest.mark.parametrize(
    ("ours", "exact"),
    [
        (lambda m: fading(m, 0.02, 1e-3), lambda: of([0.02, 0], [0.02, 1])),
        (lambda m: fading(m, np.inf, 1e-3), lambda: BENT),
        (lambda m: derivative_low_pass(m, 120.0, 1e-3, 1), lambda: butterworth(1)),
        (lambda m: derivative_low_pass(m, 120.0, 1e-3, 2), lambda: butterworth(2)),
        (
            lambda m: adapted(np.abs(m), 0.0, 0.02, 1e-3),
            lambda: np.abs(BENT),
        ),
    ],
)
def test_afferent_filters_are_exact_for_linear_input_between_samples(
    ours: Callable[[Array], Array], exact: Callable[[], Array]
) -> None:
    known = exact()
    np.testing.assert_allclose(ours(BENT[None])[0], known, rtol=0, atol=1e-9 * np.abs(known).max())


@pytest.mark.parametrize("membrane", [Membrane(0.02, 0.002, 0.0), Membrane(0.02, 0.002, 0.0, reset=-2.0)])
def test_without_noise_spike_intervals_agree_with_the_closed_form(membrane: Membrane) -> None:
    found = spikes(np.full(2001, 1.5), 1e-3, membrane, 2, np.random.default_rng(1))
    known = 0.002 + 0.02 * np.log((1.5 - membrane.reset) / 0.5)
    np.testing.assert_allclose(np.diff(found), known, atol=MOST_STEP_S)
    np.testing.assert_allclose(np.diff(found).mean(), known, rtol=5e-3)


def test_the_current_after_a_spike_delays_the_next_spike_as_integrated() -> None:
    membrane = Membrane(0.02, 0.002, 0.0, reset=-1.0, after=0.8)
    found = spikes(np.full(2001, 1.6), 1e-3, membrane, 1, np.random.default_rng(1))
    gap_s = float(np.diff(found).mean())
    since_s = np.linspace(membrane.refractory_s, gap_s, 4001)
    flow = 1.6 - membrane.after * after_current(since_s)
    arrives = np.trapezoid(flow * np.exp((since_s - gap_s) / membrane.tau_s), since_s) / membrane.tau_s
    left = membrane.reset * np.exp((membrane.refractory_s - gap_s) / membrane.tau_s)
    assert arrives + left == pytest.approx(1.0, abs=5e-3)
    plain = spikes(np.full(2001, 1.6), 1e-3, replace(membrane, after=0.0), 1, np.random.default_rng(1))
    assert gap_s > 1.1 * float(np.diff(plain).mean())


def test_noisy_spike_rates_do_not_depend_on_the_time_step() -> None:
    membrane, lasts_s = Membrane(0.02, 0.002, 0.4), 40.0
    rates, spreads = [], []
    for step_s in (MOST_STEP_S, MOST_STEP_S / 4):
        current = np.full(round(lasts_s / step_s) + 1, 0.9)
        gaps = np.diff(spikes(current, step_s, membrane, 1, np.random.default_rng(2)))
        rates.append(1 / gaps.mean())
        spreads.append(gaps.std() / gaps.mean())
    assert rates[0] == pytest.approx(rates[1], rel=0.06)
    assert spreads[0] == pytest.approx(spreads[1], abs=0.06)


_STEP_S, _TAU_S = 1e-4, 0.2
_AT_S = np.arange(0.0, 1.6, _STEP_S)
STEADY: dict[str, tuple[AfferentModel, Array]] = {
    "SA1": (SA1(weights=(0.0, 0.0, 0.0, 1.0), threshold=0.0, slow_tau_s=_TAU_S), np.full(len(_AT_S), 3.0)),
    "RA": (RA(slow_tau_s=_TAU_S, most=1e9), 3.0 * _AT_S),
    "PC": (PC(slow_tau_s=_TAU_S, most=1e9, corner_hz=100.0), 1.5 * _AT_S**2),
}
"""Each class without saturation, with a short time constant, and a signal that drives it with 3 at all times."""


@pytest.mark.parametrize("name", STEADY)
def test_the_slow_threshold_of_an_afferent_class_follows_a_share_of_its_drive(name: str) -> None:
    model, value = STEADY[name]
    (found,) = model.current(Signal(_STEP_S, value[None]), np.array([1.0]))
    share = model.slow_share  # type: ignore[attr-defined]
    for at_s in (0.1, 0.2, 0.4, 1.5):
        expected = 3.0 * (1 - share * (1 - np.exp(-at_s / _TAU_S)))
        assert found[round(at_s / _STEP_S)] == pytest.approx(expected, rel=0.02)


# --- stimulus and skin ---


def test_the_depth_of_a_ramp_stimulus_has_rounded_corners() -> None:
    stimulus = Stimulus.ramp(1.0, 10.0, 0.5, begins_s=0.1, away_mm=0.2, corner_s=0.02)
    np.testing.assert_allclose(
        stimulus.depth_mm([0.0, 0.1, 0.15, 0.4, 0.75, 1.0]), [-0.2, 0.0, 0.5, 1.0, 0.5, -0.2], atol=1e-12
    )
    np.testing.assert_allclose(stimulus.depth_mm(0.2), 1.0 - 10 * 0.02 / 8, atol=1e-12)
    t = np.linspace(0.0, 1.0, 100_001)
    acceleration = np.gradient(np.gradient(stimulus.depth_mm(t), t), t)
    assert np.abs(acceleration).max() == pytest.approx(10 / 0.02, rel=1e-3)


def test_the_skin_table_interpolates_presses_between_its_levels(halfspace: Fingertip) -> None:
    finger, model = halfspace, BUILT_IN["SA1"]
    points = finger.points_below([0.0, 0.5], model.depth_mm)
    found = SkinUnderIndentor(finger, "cylinder:9", points, model.measure, 0.4)
    assert len(found.depths_mm) == LEVELS
    depth_mm = 0.5 * (found.depths_mm[7] + found.depths_mm[8])
    known = model.measure(finger.fields(finger.indent("cylinder:9", doi_mm=depth_mm), points).measures)
    np.testing.assert_allclose(found.value(depth_mm), known, rtol=5e-3)
    signal = found.signal(Stimulus([0.0, 0.1], [0.0, depth_mm]), 1e-3, 0.2)
    np.testing.assert_allclose(signal.value[:, -1], found.value(depth_mm))


# --- classes ---

PRESS = Stimulus.ramp(1.0, 30.0, 1.0, begins_s=0.1)
DOWN_S, UP_S = 0.1 + 1 / 30, 1.1 + 1 / 30
GAINS = np.geomspace(0.4, 2.5, 12)


@pytest.mark.parametrize("name", ["RA", "PC"])
def test_rapidly_adapting_classes_fire_on_and_off_and_are_silent_in_the_hold(name: str) -> None:
    found = trains(name, PRESS, GAINS)
    on, hold, off = (total(found, *w) for w in ((0, DOWN_S + 0.1), (DOWN_S + 0.1, UP_S - 0.02), (UP_S - 0.02, 9)))
    assert hold == 0
    assert on >= len(GAINS)
    assert 0.2 <= off / on <= 1.5


def test_sa1_fires_in_the_hold_and_not_on_retraction() -> None:
    found = trains("SA1", PRESS, GAINS)
    assert min(total([one], DOWN_S + 0.1, UP_S) for one in found) > 5
    assert total(found, UP_S + 0.02) <= len(found)
    assert total(found, UP_S + 0.06) == 0


def test_sa1_declines_irregularly_in_a_hold() -> None:
    hold = Stimulus.ramp(0.6, 10.0, 13.0, begins_s=0.1)
    found = trains("SA1", hold, np.full(16, 1.0), 1e-3, 12.5)
    first, last = total(found, 0.2, 1.2), total(found, 11.2, 12.2)
    assert 0.2 <= 1 - last / first <= 0.6
    late = [np.diff(one[one > 4]) for one in found]
    assert 10 <= np.mean([1 / gaps.mean() for gaps in late]) <= 60
    assert 0.2 <= np.mean([gaps.std() / gaps.mean() for gaps in late]) <= 0.9


def test_an_earlier_press_lowers_the_sa1_response() -> None:
    def press(at_s: float) -> list[float]:
        return [at_s, at_s + 0.1, at_s + 5, at_s + 5.1]

    depths = [0.0, 0.8, 0.8, -0.1]
    alone = trains("SA1", Stimulus(press(6.0), depths), GAINS, 1e-3, 8.0)
    after = trains("SA1", Stimulus(press(0.1) + press(6.0), 2 * depths), GAINS, 1e-3, 8.0)
    assert total(after, 6.0) < 0.95 * total(alone, 6.0)


@pytest.mark.parametrize(("name", "frequency_hz", "amplitude_um"), [("RA", 40.0, 110.0), ("PC", 250.0, 30.0)])
def test_ra_and_pc_fire_one_phase_locked_spike_per_vibration_cycle(
    name: str, frequency_hz: float, amplitude_um: float
) -> None:
    found = trains(name, vibrating(frequency_hz, amplitude_um), np.ones(6), 2e-4)
    cut = [one[(one > 1.1) & (one < 1.9)] for one in found]
    assert [len(one) / (0.8 * frequency_hz) for one in cut] == pytest.approx(np.ones(6), rel=0.05)
    strength = [abs(np.exp(2j * np.pi * frequency_hz * one).mean()) for one in cut]
    assert min(strength) > 0.8


@pytest.mark.parametrize(("name", "most"), [("SA1", 0.02), ("RA", 0.02), ("PC", 0.04)])
def test_spike_counts_hardly_depend_on_the_time_step_of_the_signal(name: str, most: float) -> None:
    slow, gains = Stimulus.ramp(0.8, 10.0, 0.4, begins_s=0.1), np.geomspace(0.4, 2.5, 150)
    coarse, fine = (total(trains(name, slow, gains, step_s)) for step_s in (1e-3, 2.5e-4))
    assert fine > 100
    assert coarse == pytest.approx(fine, rel=most)


def test_the_spikes_of_a_seed_do_not_depend_on_other_afferents() -> None:
    signal, model = skin("SA1").signal(PRESS, 1e-3), BUILT_IN["SA1"]
    one = spikes_of(model, signal, [1.0], [7])
    several = spikes_of(model, signal, [0.8, 1.0, 1.0], [1, 7, 8])
    np.testing.assert_array_equal(one[0], several[1])
    assert not np.array_equal(several[1], several[2])


@pytest.mark.parametrize("name", BUILT_IN)
@pytest.mark.parametrize("blocks", [[20], [3, 1, 40, 1700]])
def test_spikes_do_not_depend_on_the_blocks_of_a_signal(name: str, blocks: list[int]) -> None:
    """To the last bit: filters, membranes and noise continue."""
    gains, seeds, step_s = [0.5, 1.0, 4.0], [1, 2, 3], MOST_STEP_S
    signal = skin(name).signal(vibrating(100.0, 30.0), step_s, 1.4)
    value = np.repeat(signal.value[:, 9000:], 3, axis=0)
    whole = spikes_of(BUILT_IN[name], Signal(step_s, value), gains, seeds)
    stream, found, at = SpikeStream(BUILT_IN[name], step_s, gains, seeds), [[], [], []], 0
    for size in cycle(blocks):
        for row, time_s in zip(*stream.advance(value[:, at : at + size]), strict=True):
            found[row].append(float(time_s))
        at += size
        if at >= value.shape[1]:
            break
    assert sum(map(len, found)) > 20
    assert found == [one.tolist() for one in whole]


@pytest.mark.parametrize("name", BUILT_IN)
def test_an_afferent_fires_with_its_strongest_end_organ(name: str) -> None:
    """Weaker ones and copies change nothing; where another is stronger, it takes over."""
    model, signal, gains, seeds = BUILT_IN[name], skin(name).signal(PRESS, 1e-3), [0.5, 1.0, 4.0], [1, 2, 3]
    one = spikes_of(model, signal, gains, seeds)
    with_others = np.stack([0.2 * signal.value, signal.value, 0.9 * signal.value, signal.value], axis=1)
    several = spikes_of(model, Signal(1e-3, with_others), gains, seeds)
    assert total(one) > 5
    assert [train.tolist() for train in several] == [train.tolist() for train in one]
    late = np.where(np.arange(signal.value.shape[1]) < 300, 0.0, 3 * signal.value)
    assert total(spikes_of(model, Signal(1e-3, np.stack([signal.value, late], axis=1)), gains, seeds)) > total(one)


# --- bad input ---

QUIET = Signal(1e-3, np.zeros((1, 10)))


@pytest.mark.parametrize(
    ("code", "wrong"),
    [
        ("afferents_differ", lambda: spikes_of(BUILT_IN["RA"], QUIET, [1.0, 1.0], [1])),
        (
            "afferents_differ",
            lambda: spikes_of(BUILT_IN["RA"], Signal(1e-3, np.zeros((2, 10))), 3 * [1.0], [1, 2, 3]),
        ),
        ("bad_sensitivity", lambda: spikes_of(BUILT_IN["RA"], QUIET, [0.0], [1])),
        ("bad_signal", lambda: spikes_of(BUILT_IN["RA"], replace(QUIET, value=np.full((1, 9), np.nan)), [1.0], [1])),
        ("bad_stimulus", lambda: Stimulus([0.0, 0.0], [0.0, 1.0])),
        ("bad_vibration", lambda: vibrating(0.0, 10.0)),
    ],
)
def test_malformed_arguments_of_afferents_are_refused_with_a_code(code: str, wrong: Callable[[], object]) -> None:
    with raises(ArgumentError, code):
        wrong()


@pytest.mark.parametrize(
    ("code", "stimulus", "step_s"),
    [
        ("doi_beyond_table", Stimulus.ramp(1.6, 10.0, 0.1), 1e-3),
        ("doi_beyond_table", vibrating(50.0, 1200.0), 1e-3),
        ("step_too_long", vibrating(250.0, 10.0), 1e-3),
    ],
)
def test_a_stimulus_beyond_depth_or_step_limits_is_refused_with_a_code(
    code: str, stimulus: Stimulus, step_s: float
) -> None:
    with raises(ModelRangeError, code):
        skin("SA1").signal(stimulus, step_s)


# --- the slowest press at which an afferent fires ---

DOI_MM, STEP_S = 0.5, 1e-4
SPEEDS = {  # class and sensitivity, lowest and highest speed (mm/s); the measure is that of the reference SED at 1 mm
    ("SA1", 100.0): (LEAST_MM_S, LEAST_MM_S),  # it follows strain, and fires in a hold however slowly that begins
    ("RA", 1.0): (1.0, 1.05),  # its current is the rate of the measure: 1, the rheobase, at 1 mm/s
    ("RA", 10.0): (0.1, 0.105),  # ten times as sensitive, at a tenth of the speed
    ("RA", 1e-6): (None, None),  # 1e6 mm/s, which no press reaches
    ("PC", 1e-3): (LEAST_MM_S, MOST_MM_S),  # it follows the onset of a press, so that the speed counts
    ("PC", 1e-9): (None, None),
}


def skin_at_rest_to(model: str) -> SkinUnderIndentor:
    depths = np.linspace(0.05, DOI_MM, 10)
    there: Any = BUILT_IN[model]
    return SkinUnderIndentor.of_values(depths, there.measure({"sed": there.reference_sed * depths**2})[:, None])


def fires(model: str, sensitivity: float, speed_mm_s: float) -> bool:
    noisy: Any = BUILT_IN[model]
    quiet = replace(noisy, membrane=replace(noisy.membrane, noise=0.0))
    t_s: NDArray[np.float64] = np.arange(0, DOI_MM / speed_mm_s + 0.3, STEP_S)
    value = skin_at_rest_to(model).value(np.minimum(speed_mm_s * t_s, DOI_MM)).T
    return len(spikes_of(quiet, Signal(STEP_S, value[None]), [sensitivity], [0])[0]) > 0


@pytest.mark.parametrize("case", SPEEDS, ids=str)
def test_an_afferent_fires_at_and_above_its_firing_speed_only(case: tuple[str, float]) -> None:
    low, high = SPEEDS[case]
    found = firing_speed_mm_s(BUILT_IN[case[0]], case[1], skin_at_rest_to(case[0]), DOI_MM)
    if low is None or high is None:
        assert found is None
        assert not fires(*case, MOST_MM_S)
        return
    assert found is not None
    assert low <= found <= high
    assert fires(*case, found)
    assert found == LEAST_MM_S or not fires(*case, 0.95 * found)  # the search ends within 3 %
