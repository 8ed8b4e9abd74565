"""Noise and latency of a load cell."""

import numpy as np
import pytest

from sim.devices import SerialLine, VirtualBalance
from sim.devices.clock import VirtualClock
from sim.devices.line import Load, load_cell


def ramp(t_s: float) -> float:
    return 0.1 * t_s


def test_an_ideal_cell_is_the_force_itself() -> None:
    assert load_cell(ramp, sample_period_s=0.05) is ramp


def test_latency_is_the_force_of_a_while_ago() -> None:
    late = load_cell(ramp, sample_period_s=0.05, latency_s=0.3)
    assert late(2.0) == pytest.approx(0.17, abs=1e-15)
    assert late(0.1) == 0.0


def test_a_zero_that_drifts_is_added_to_the_force() -> None:
    drifting = load_cell(ramp, sample_period_s=0.05, drift_n_per_s=-0.02)
    assert drifting(3.0) == pytest.approx(0.3 - 0.06, abs=1e-15)


def test_noise_is_gaussian_of_its_size_and_the_same_whenever_it_is_asked_for() -> None:
    cell = load_cell(lambda t_s: 0.02, sample_period_s=0.05, noise_n=1e-3, seed=7)
    values = np.array([cell(0.05 * k) for k in range(4000)])
    # Standard errors of 4 000 draws: 1e-3 / √4000 = 1.6e-5 and 1e-3 / √8000 = 1.1e-5; bounds at four of them.
    assert values.mean() == pytest.approx(0.02, abs=6.4e-5)
    assert values.std() == pytest.approx(1e-3, abs=4.5e-5)
    assert abs(np.corrcoef(values[1:], values[:-1])[0, 1]) < 4 / np.sqrt(4000)
    again = load_cell(lambda t_s: 0.02, sample_period_s=0.05, noise_n=1e-3, seed=7)
    assert [again(0.05 * k) for k in (3999, 17, 0)] == [values[k] for k in (3999, 17, 0)]
    assert load_cell(lambda t_s: 0.02, sample_period_s=0.05, noise_n=1e-3, seed=8)(0.0) != values[0]


def test_a_force_that_is_not_fresh_is_not_called_stable() -> None:
    clock = VirtualClock()
    line = SerialLine(clock, 9600)
    VirtualBalance(clock, line, Load(lambda t_s: 0.1, lambda t_s: t_s < 1.0))
    heard = []
    for _ in range(2):
        line.host_write(b"SI\r\n")
        clock.wait_s(0.5)
        heard.append(line.host_read()[:3])
        clock.wait_s(0.5)
    assert heard == [b"S S", b"S D"]
