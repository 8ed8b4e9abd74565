"""Chapter 6: shift invariance, impulse responses, and two pressures decoded by the source's search."""

from functools import cache

import numpy as np

from sim.coding.decoder_results import Decoded, decoding_errors
from sim.coding.decoders_by_search import PressureRange, converged_search, grid_search
from sim.coding.encoding import Noise, encode
from sim.coding.operators import ForwardOperator, ImpulseResponses, convolution, impulse_responses
from sim.coding.point_spread import mean_over
from sim.coding.raju_table_6_1 import DRAWN, AllSites, Sampled, Where, cached_sites
from sim.coding.section import Sampling, sampled_section
from sim.config import FingertipConfig
from studies.source.answers import FingerAnswers

TRUE, START = np.array([20.0, 14.0]), np.array([10.0, 10.0])
RANGE, WITHIN = PressureRange(0.0, 30.0), PressureRange(0.0, 60.0)
"""Of the worked example, and of the searches under noise."""
DRAWS, SEED = 40, 500


@cache
def _sites(answers: FingerAnswers) -> AllSites:
    """Return sites under equal point loads; twenty seconds, or from the cache."""
    return cached_sites(answers.finger.config, Sampled()).sites


def law(answers: FingerAnswers, where: Where, name: str) -> float:
    """Return a number of the power law's mean over sites: m, m_spread, a_spread."""
    return float(getattr(mean_over(_sites(answers).laws(where)), name))


def site_10(answers: FingerAnswers, name: str) -> float:
    """Return a number of the site that the source draws."""
    return float(getattr(_sites(answers).sites[DRAWN].linear, name))


@cache
def _responses(answers: FingerAnswers) -> ImpulseResponses:
    """Return h, g and f in the source's axes."""
    return impulse_responses(sampled_section(answers.finger.config, Sampling(axes="cartesian")))


def opposite(answers: FingerAnswers, name: str) -> float:
    """Return how nearly h and −g are the same."""
    return float(getattr(_responses(answers).opposite, name))


def at_rest(answers: FingerAnswers, k: int) -> float:
    """Return the amplitude at frequency 0 over the highest, of h, g or f."""
    amplitude = _responses(answers).spectra()[1][k]
    return float(amplitude[0] / amplitude.max())


@cache
def operator() -> ForwardOperator:
    """Return what maps two pressures to SED on the default finger's section."""
    return convolution(impulse_responses(sampled_section(FingertipConfig(), Sampling())), len(TRUE), "finite")


@cache
def search(grid: float | None) -> Decoded:
    """Return the worked example without noise: exact along each coordinate, or on a grid."""
    reading = operator().sed(TRUE)
    if grid is None:
        return converged_search(operator(), reading, START, RANGE)
    return grid_search(operator(), reading, START, RANGE, grid)


def first_move(_: FingerAnswers) -> float:
    """Return the first pressure after the first move."""
    return float(search(None).path[1][0])


def ends_off(_: FingerAnswers, grid: float | None) -> float:
    """Return Eq. 6.8 where a search ends."""
    return decoding_errors(TRUE, search(grid).pressure).eq_6_8


def under_noise(_: FingerAnswers, snr_db: int, draws: int = DRAWS) -> float:
    """Return the mean of Eq. 6.8 of the converged search, truths from U(0, 30)²."""
    errors = []
    for seed in range(SEED, SEED + draws):
        true = np.random.default_rng((seed, snr_db)).uniform(0.0, 30.0, 2)
        said = encode(operator(), true, None, Noise(snr_db, seed=seed + 1000 * snr_db))
        errors.append(decoding_errors(true, converged_search(operator(), said.rate, START, WITHIN).pressure).eq_6_8)
    return float(np.mean(errors))
