"""Refined evidence of a long session against a mean over many draws from the prior."""

import numpy as np
import pytest

from rig.design.counts import CountModel, draw_counts, no_counts, with_counts
from rig.design.fibers import Unknowns, draw_fibers, log_rates, relative_rates
from rig.design.refined import FEW, best_draws, effective_draws, refined_evidence
from rig.design.response_table import ResponseTable

MODEL = CountModel(1.0, Unknowns())
MANY = 2**17


@pytest.mark.parametrize(("true", "candidate"), [("ep1", "ep1"), ("sed", "sed"), ("ep1", "sed")])
def test_refined_evidence(table: ResponseTable, true: str, candidate: str) -> None:
    """Of 84 presses: from 512 draws, of which few count, as from 131 072, of which many do."""
    chance = np.random.default_rng(4)
    fiber = draw_fibers(1, table, MODEL.unknowns, 3, evenly=False)
    mean = 60 * relative_rates(table, true, fiber)[0]
    used = np.arange(0, len(mean), 3)
    sums = no_counts(1, len(used), 30.0)
    for n, press in enumerate(np.concatenate([used, used])):
        tau = 3 * (n / (2 * len(used)) - 0.5)
        sums = with_counts(sums, n % len(used), draw_counts(mean[[press]], 1.5, chance), tau)

    def likelihood(draws: int) -> tuple[np.ndarray, np.ndarray]:
        known = draw_fibers(draws, table, MODEL.unknowns, 5)
        log_rate = log_rates(relative_rates(table, candidate, known)[:, used])
        return known.z, MODEL.log_likelihood(sums, log_rate, known)[0]

    _, many = likelihood(MANY)
    exact = many.max() + np.log(np.exp(many - many.max()).mean())
    assert effective_draws(many) > 3 * FEW
    z, few = likelihood(512)
    assert effective_draws(few) < FEW
    best = best_draws(few)
    found = [
        refined_evidence(table, candidate, MODEL, sums, z[best], few[best], np.random.default_rng(seed), used)
        for seed in range(8)
    ]
    assert min(one.effective for one in found) > 2 * FEW
    share = np.exp([one.log_evidence - exact for one in found])
    assert share.mean() == pytest.approx(1.0, abs=0.25)
    assert share.std() < 0.4
