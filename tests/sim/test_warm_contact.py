"""The study of warm contact: what it serves, and that going on from a sample gives what rest would have given."""

import numpy as np
import pytest

from sim.models.fingertip import Fingertip
from studies.speed.warm_contact import PressSamples, ahead, behind, largest, pressed

TEN_MS, ONE_MS = np.arange(1, 101) / 100, np.arange(1, 1001) / 1000


def known(force: np.ndarray) -> PressSamples:
    return PressSamples(TEN_MS, force, np.zeros(100), np.zeros(100))


@pytest.mark.parametrize("order", [1, 2])
def test_a_polynomial_is_served_exactly(order: int) -> None:
    # Once order + 1 answers on it are a period old; before, the zeros before first touch take part.
    late = 0.01 * (order + 2) < ONE_MS
    np.testing.assert_allclose(behind(known(TEN_MS**order), ONE_MS, order)[late], ONE_MS[late] ** order, atol=1e-12)


def test_nothing_is_served_of_what_is_not_solved_yet() -> None:
    # The answer of an instant is there a period later: a step in the force at 0.5 s is felt at 0.51 s, not before.
    found = behind(known((TEN_MS >= 0.5).astype(float)), ONE_MS, 1)
    assert not found[ONE_MS < 0.51 - 1e-9].any()
    assert found[np.isclose(ONE_MS, 0.51)] > 0


def test_ahead_is_between_its_answers() -> None:
    found = ahead(known(TEN_MS**2), ONE_MS)
    assert np.abs(found - ONE_MS**2).max() == pytest.approx(0.005**2, rel=1e-6)  # h²/8 times the second derivative


@pytest.mark.parametrize(("shape", "x_mm"), [("cylinder:9", 0.0), ("bar:3.0", 0.0)])
def test_going_on_gives_what_rest_gives(finger: Fingertip, shape: str, x_mm: float) -> None:
    # 1e-8 is the residual required of an answer; the bar's corner is reached on the way down.
    samples = pressed(finger, shape, x_mm, np.arange(1, 71) / 100)
    assert (samples.cpu_s > 0).all()
    rest = finger.indent(shape, x_mm, doi_mm=0.7).force_n
    assert samples.force_n[-1] == pytest.approx(rest, rel=1e-7)
    # Served at twice the rate from every second answer; measured 1.2 % behind, 0.1 % ahead.
    every = PressSamples(samples.t_s[1::2], samples.force_n[1::2], samples.wall_s[1::2], samples.cpu_s[1::2])
    assert largest(behind(every, samples.t_s, 2), samples.force_n) < 2.0
    assert largest(ahead(every, samples.t_s), samples.force_n) < 0.3
