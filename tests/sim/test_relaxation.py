"""A Prony series against its closed forms, and a relaxing force on a clock."""

import math

import numpy as np
import pytest

from sim.devices.clock import VirtualClock
from sim.plant.relaxation import PronyForce, PronyTerm, RelaxingForce

TERMS = (PronyTerm(0.3, 0.5), PronyTerm(0.15, 4.0))


def relaxation(t_s: float) -> float:
    """G(t), the force after a unit step of the elastic force."""
    return 1 - sum(term.share * (1 - math.exp(-t_s / term.tau_s)) for term in TERMS)


@pytest.mark.parametrize("step_s", [0.001, 0.05, 0.7])
def test_step_relaxation_is_that_of_the_series(step_s: float) -> None:
    """A step is a ramp within the first sample: its closed form is the mean of G over that ramp, at any sampling."""
    prony = PronyForce(TERMS)
    for n in range(1, 101):
        force = prony.advance(step_s, 2.0)
        t_s = n * step_s
        # ∫ G over the ramp, by hand: Σ g τ / Δ (e^(Δ/τ) − 1) e^(−t/τ) for each term.
        kept = sum(
            g.share * (g.tau_s / step_s * math.expm1(step_s / g.tau_s) * math.exp(-t_s / g.tau_s)) for g in TERMS
        )
        assert force == pytest.approx(2.0 * (1 - sum(g.share for g in TERMS) + kept), rel=1e-12)
        if step_s == 0.001:
            # A ramp over one sample comes, to first order, half a sample later than a step: G' · Δ / 2 at most.
            late = 2.0 * sum(g.share / g.tau_s for g in TERMS) * step_s / 2
            assert force == pytest.approx(2.0 * relaxation(t_s), abs=1.001 * late)
    assert prony.advance(1e3, 2.0) == pytest.approx(2.0 * 0.55, rel=1e-12)


def test_sampling_does_not_matter_where_the_force_is_piecewise_linear() -> None:
    """A ramp, a hold and a ramp back, sampled at its corners and sampled finely: the update is exact, so no tolerance
    but that of rounding."""
    corners = [(0.4, 1.0), (2.0, 1.0), (0.3, 0.4), (1.0, 0.4)]

    def end(pieces: int) -> float:
        prony, before, force = PronyForce(TERMS), 0.0, 0.0
        for length_s, to in corners:
            for k in range(1, pieces + 1):
                force = prony.advance(length_s / pieces, before + (to - before) * k / pieces)
            before = to
        return force

    assert end(1) == pytest.approx(end(50), rel=1e-12)


def test_a_sinusoid_has_the_storage_and_loss_of_the_series() -> None:
    """Ferry, Viscoelastic Properties of Polymers, 3rd ed. 1980, ch. 3: G' and G'' of a generalised Maxwell body."""
    omega, step_s = 2 * math.pi * 0.5, 0.002
    t = np.arange(1, 40_001) * step_s
    prony = PronyForce(TERMS)
    force = np.array([prony.advance(step_s, 1 + 0.5 * math.sin(omega * s)) for s in t])[20_000:]
    last = t[20_000:]  # 40 s on: the slow term (4 s) has settled to e^-10
    basis = np.stack([np.ones_like(last), np.sin(omega * last), np.cos(omega * last)], axis=1)
    _, storage, loss = np.linalg.lstsq(basis, force, rcond=None)[0] / 0.5
    products = [(g.share, omega * g.tau_s) for g in TERMS]
    assert storage == pytest.approx(0.55 + sum(g * p * p / (1 + p * p) for g, p in products), abs=1e-4)
    assert loss == pytest.approx(sum(g * p / (1 + p * p) for g, p in products), abs=1e-4)


def test_contact_never_pulls() -> None:
    prony = PronyForce(TERMS)
    for _ in range(100):
        prony.advance(0.1, 1.0)
    assert prony.advance(0.05, 0.0) == 0.0
    assert prony.advance(100.0, 0.0) == 0.0
    assert prony.advance(1e-6, 1.0) == pytest.approx(1.0, rel=1e-5), "recovered: as stiff as at first"


@pytest.mark.parametrize("terms", [[(1.0, 1.0)], [(0.6, 1.0), (0.4, 2.0)], [(-0.1, 1.0)], [(0.1, 0.0)]])
def test_what_is_no_series(terms: list[tuple[float, float]]) -> None:
    with pytest.raises(ValueError, match="Prony"):
        PronyForce([PronyTerm(*term) for term in terms])


def test_on_a_clock_the_past_counts_whether_or_not_anybody_asked() -> None:
    def elastic_n(t_s: float) -> float:
        return 0.0 if t_s < 1.0 else 0.5

    def force_after(looks_s: list[float]) -> float:
        clock = VirtualClock()
        force = RelaxingForce(clock, elastic_n, TERMS, 0.05)
        for look_s in looks_s:
            clock.wait_until(lambda: False, look_s)
            force.force_n(look_s)
        clock.wait_until(lambda: False, 6.0)
        return force.force_n(6.0)

    assert force_after([]) == force_after([0.5, 1.0, 1.02, 3.3]) == pytest.approx(0.5 * relaxation(5.0), rel=0.01)


def test_an_unknown_force_is_told_and_not_integrated() -> None:
    clock = VirtualClock()
    force = RelaxingForce(clock, lambda t_s: math.nan if 1.0 < t_s < 2.0 else 1.0, TERMS, 0.05)
    clock.wait_s(1.5)
    assert math.isnan(force.force_n(1.5))
    clock.wait_s(1.5)
    assert 0.5 < force.force_n(3.0) < 1.0


def test_a_long_day_keeps_only_the_last_samples() -> None:
    clock = VirtualClock()
    force = RelaxingForce(clock, lambda t_s: 1.0, TERMS, 0.05)
    clock.wait_s(100.0)
    assert force.force_n(95.0) > 0
    assert len(force._forces) <= 256
